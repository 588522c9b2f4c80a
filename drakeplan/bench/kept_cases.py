"""Cases of a long benchmark, kept in a file as they come, so that it goes on where it was stopped."""

from __future__ import annotations

import json
import os
from collections.abc import Callable, Mapping
from pathlib import Path

RESUME = "DRAKEPLAN_BENCH_RESUME"  # names a file of JSON lines: what stands there is not run again

Case = dict[str, object]
Key = Mapping[str, str | int | float]


class KeptCases:
    """Runs each case once: in this process, or in one before it that kept the same file.

    Args:
        file: JSON lines, made when missing; None keeps nothing.
    """

    def __init__(self, file: Path | None) -> None:
        self._file = file
        self._known = _read(file)

    @classmethod
    def asked_for(cls) -> KeptCases:
        """Those of the file that `DRAKEPLAN_BENCH_RESUME` names, if it names one."""
        return cls(Path(os.environ[RESUME]) if os.environ.get(RESUME) else None)

    def __call__(self, key: Key, run: Callable[[], Case]) -> Case:
        """The case of this key, run now where it is not known yet; both must be as JSON allows."""
        name = _name(key)
        if name not in self._known:
            self._known[name] = run()
            self._append({"key": dict(key), "case": self._known[name]})
        return self._known[name]

    def _append(self, line: Case) -> None:
        if self._file is None:
            return
        file = self._file
        file.parent.mkdir(parents=True, exist_ok=True)
        cut_off = file.exists() and not file.read_bytes().endswith(b"\n")  # by a kill in the middle of a line
        with file.open("a", encoding="utf-8") as out:
            out.write(("\n" if cut_off and file.stat().st_size else "") + json.dumps(line) + "\n")


def _name(key: Key) -> str:
    return json.dumps(dict(key), sort_keys=True)


def _read(file: Path | None) -> dict[str, Case]:
    known: dict[str, Case] = {}
    if file is None or not file.exists():
        return known
    for line in file.read_text(encoding="utf-8").splitlines():
        try:
            kept = json.loads(line)
            known[_name(kept["key"])] = kept["case"]
        except (ValueError, KeyError, TypeError):  # cut off by a kill, or of another format
            continue
    return known
