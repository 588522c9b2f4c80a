"""Finds a user's file or folder that Python takes for one of our packages, before anything is imported from it."""

from __future__ import annotations

import sys
from importlib.util import find_spec
from pathlib import Path

BESIDE = ("scenes", "optimization", "learning")  # packages with plain names that are installed beside drakeplan


def refuse_shadows() -> None:
    """Raises ImportError where one of our packages is not what its name leads to."""
    home = Path(__file__).absolute().parents[1]
    for name in BESIDE:
        found = _place(name)
        if found is None:
            raise ImportError(f"drakeplan: its package {name!r} is not beside it in {home}: install drakeplan again")
        if found != home / name and found.resolve() != (home / name).resolve():
            raise ImportError(
                f"drakeplan: {found} shadows its package {name!r}: rename that {'folder' if found.is_dir() else 'file'}, "
                "or run the script from elsewhere"
            )


def _place(name: str) -> Path | None:
    """The folder of the package that `import name` would load, or has loaded; the file where it is no package."""
    if name in sys.modules:
        loaded = sys.modules[name]
        folders, origin = getattr(loaded, "__path__", None), getattr(loaded, "__file__", None)
    else:
        spec = find_spec(name)
        if spec is None:
            return None
        folders, origin = spec.submodule_search_locations, spec.origin
    place = next(iter(folders or ()), origin)
    return None if place is None else Path(place).absolute()
