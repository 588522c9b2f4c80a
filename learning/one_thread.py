"""NumPy's products on the calling thread alone, for as long as a block lasts.

OpenBLAS hands products as large as a network's layer to all processors and waits for them busily. On a machine that has
other work, one prediction then took 300 ms instead of 0.3; alone on the machine it gains little. Drake, and whoever else
calls NumPy outside of the block, keep their threads.
"""

from __future__ import annotations

from functools import lru_cache
from pathlib import Path
from types import TracebackType
from typing import Any

from threadpoolctl import ThreadpoolController


class OneThread:
    """`with OneThread(): ...`, about 2 us; nothing where there is one thread already."""

    __slots__ = ("_changed",)

    def __enter__(self) -> None:
        self._changed: list[tuple[Any, int]] = []
        for library in _libraries():
            count = library.get_num_threads()
            if count is not None and count > 1:
                library.set_num_threads(1)
                self._changed.append((library, count))

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        for library, count in self._changed:
            library.set_num_threads(count)


@lru_cache(maxsize=1)
def _libraries() -> tuple[Any, ...]:
    """The BLAS of NumPy; SciPy's wheels bring one of their own, which no network uses."""
    found = ThreadpoolController().lib_controllers
    return tuple(lib for lib in found if lib.user_api == "blas" and Path(lib.filepath).parent.name != "scipy.libs")
