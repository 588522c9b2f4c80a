"""Folders for what is made once on a machine: the user's cache, or a temporary folder where nothing can be written there."""

from __future__ import annotations

import contextlib
import getpass
import hashlib
import os
import shutil
import sys
import tempfile
from functools import lru_cache
from pathlib import Path

import platformdirs

KERNELS = "NUMBA_CACHE_DIR"  # where numba keeps compiled kernels, if it is set
COMPILED = "*.nb[ic]"


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
        folder = temporary_folder() / kind
        folder.mkdir(parents=True, exist_ok=True)
    return folder


@lru_cache(maxsize=1)
def temporary_folder() -> Path:
    """This user's own folder for temporary files; said once on standard error."""
    folder = Path(tempfile.gettempdir()) / f"drakeplan-{_user()}"
    with contextlib.suppress(OSError):
        folder.mkdir(mode=0o700, exist_ok=True)
    if not folder.is_dir() or folder.is_symlink() or folder.stat().st_uid != os.getuid() or not is_writable(folder):
        folder = Path(tempfile.mkdtemp(prefix="drakeplan-"))  # what others made cannot be trusted
    print(
        f"drakeplan: neither the installation nor the user's cache folder can be written: {folder} is used for compiled "
        f"kernels and robots; `drakeplan warm-up --cache DIR` prepares a folder for {KERNELS}",
        file=sys.stderr,
    )
    return folder


def choose_kernel_cache(packages: Path) -> None:
    """Gives numba a folder for compiled kernels where it would find none; at best before numba is imported.

    Kernels that were compiled before, in a folder that can only be read, are copied there.

    Args:
        packages: the folder that the installed packages lie in.
    """
    given = os.environ.get(KERNELS)
    if given:
        if not is_writable(Path(given)):
            _use(_copied_kernels(Path(given)))
        return
    in_tree = packages / "scenes" / "__pycache__"
    if is_writable(in_tree) or is_writable(Path(platformdirs.user_cache_dir("numba"))):
        return
    target = temporary_folder() / "kernels"
    for package in ("scenes", "optimization", "learning", "drakeplan"):
        for kernel in (packages / package).rglob(COMPILED):
            source = kernel.parent.parent  # the folder of the source file: numba names its folder after that
            name = f"{source.name}_{hashlib.sha1(str(source).encode()).hexdigest()}"
            _copy_newer(kernel, target / name / kernel.name)
    target.mkdir(parents=True, exist_ok=True)
    _use(target)


def _use(folder: Path) -> None:
    os.environ[KERNELS] = str(folder)
    if "numba" in sys.modules:  # imported by the program that uses drakeplan
        sys.modules["numba"].config.CACHE_DIR = str(folder)


def _copied_kernels(folder: Path) -> Path:
    target = temporary_folder() / "kernels"
    for kernel in folder.rglob(COMPILED):
        _copy_newer(kernel, target / kernel.relative_to(folder))
    target.mkdir(parents=True, exist_ok=True)
    return target


def _copy_newer(source: Path, target: Path) -> None:
    """Copies a file unless the copy is there already, whole or not at all."""
    if target.is_file() and target.stat().st_mtime_ns >= source.stat().st_mtime_ns:
        return
    target.parent.mkdir(parents=True, exist_ok=True)
    partial = target.with_name(f".{target.name}.{os.getpid()}")
    shutil.copy2(source, partial)
    os.replace(partial, target)


def _user() -> str:
    try:
        return getpass.getuser()
    except (KeyError, OSError, ImportError):  # a user without a name, as in containers
        return str(os.getuid())
