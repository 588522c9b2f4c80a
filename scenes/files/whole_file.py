"""Atomic writing: a file is complete or absent, also if the writer is killed."""

from __future__ import annotations

import contextlib
import os
import secrets
from pathlib import Path
from typing import BinaryIO

from scenes.input_error import InputError


def write_whole(path: str | Path, content: bytes) -> None:
    """Writes a file in one step: whoever looks at `path` sees the old file or the whole new one.

    Args:
        path: of the file, in a folder that exists.
        content: all of it.

    Raises:
        InputError: the file cannot be written there.
    """
    path = Path(path)
    require_writable(path)
    try:
        _replace_file(path, content)
    except OSError as error:
        raise InputError(f"{path}: cannot be written ({error.strerror or error})") from None


def require_writable(path: str | Path) -> None:
    """Says early, before a long computation, that a file cannot be written at `path`.

    Raises:
        InputError: no such folder, not a folder, not permitted, a name that no file has, or `path` is a folder.
    """
    path = Path(path)
    if "\0" in str(path):
        raise InputError(f"{str(path)!r}: cannot be written (a name has no null characters)")
    folder = path.parent
    try:
        if path.exists() and not path.is_file():
            raise InputError(f"{path}: cannot be written (it is {'a folder' if path.is_dir() else 'not a plain file'})")
    except OSError as error:  # a name that no file can have
        raise InputError(f"{path}: cannot be written ({error.strerror})") from None
    if not folder.is_dir():
        raise InputError(f"{path}: cannot be written (there is no folder {folder})")
    if not os.access(folder, os.W_OK | os.X_OK):
        raise InputError(f"{path}: cannot be written (no permission to write in {folder})")


def _replace_file(path: Path, content: bytes) -> None:
    """Puts `content` at `path` in one step, on the disk before it is seen."""
    temporary = path.parent / f".{path.name}.{secrets.token_hex(4)}.tmp"
    try:
        try:
            _write_nameless(temporary, content)
        except (OSError, AttributeError):  # no such thing on this system or file system
            _write_named(temporary, content)
        os.replace(temporary, path)
    except BaseException:
        with contextlib.suppress(OSError):
            temporary.unlink()
        raise
    directory = os.open(path.parent, os.O_RDONLY)
    try:
        os.fsync(directory)
    finally:
        os.close(directory)


def _write_nameless(path: Path, content: bytes) -> None:
    """Writes a file that gets its name only when it is whole: a writer that is killed leaves nothing behind (Linux)."""
    descriptor = os.open(path.parent, os.O_WRONLY | os.O_TMPFILE, 0o666)
    root = os.open("/", os.O_RDONLY)
    try:
        with os.fdopen(descriptor, "wb") as file:
            _fill(file, content)
            # Given a directory, os.link calls linkat with AT_SYMLINK_FOLLOW, which is what names such a file.
            os.link(f"/proc/self/fd/{descriptor}", path, src_dir_fd=root, follow_symlinks=True)
    finally:
        os.close(root)


def _write_named(path: Path, content: bytes) -> None:
    with path.open("xb") as file:
        _fill(file, content)


def _fill(file: BinaryIO, content: bytes) -> None:
    file.write(content)
    file.flush()
    os.fsync(file.fileno())
