"""Folders for what is made once on a machine: the user's cache, or a temporary one where that cannot be written."""

from __future__ import annotations

import getpass
import os
import sys
import tempfile
from functools import lru_cache
from pathlib import Path

import platformdirs

KERNELS = "NUMBA_CACHE_DIR"


def is_writable(folder: Path) -> bool:
    """Whether files can be made in a folder, which is made where it is missing."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=folder):
            return True
    except OSError:
        return False


def cache_folder(kind: str) -> Path:
    """A folder that can be written, for one kind of content.

    Args:
        kind: name of the folder below the user's cache of drakeplan.
    """
    folder = Path(platformdirs.user_cache_dir("drakeplan")) / kind
    if not is_writable(folder):
        folder = _temporary(f"nothing can be written below {folder}") / kind
        folder.mkdir(parents=True, exist_ok=True)
    return folder


@lru_cache(maxsize=1)
def _temporary(why: str) -> Path:
    """This user's temporary folder, private; said once on standard error."""
    folder = Path(tempfile.gettempdir()) / f"drakeplan-{_user()}"
    folder.mkdir(mode=0o700, exist_ok=True)
    if folder.stat().st_uid != os.getuid():  # someone else's: a fresh one, that others cannot have prepared
        folder = Path(tempfile.mkdtemp(prefix="drakeplan-"))
    print(f"drakeplan: {why}: {folder} is used instead, and kernels compile once for each new one", file=sys.stderr)
    return folder


def _user() -> str:
    try:
        return getpass.getuser()
    except (KeyError, OSError, ImportError):  # a user without a name, as in containers
        return str(os.getuid())
