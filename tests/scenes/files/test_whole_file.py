"""A file is written whole or not at all, with the permissions that any new file gets."""

from __future__ import annotations

import errno
import os
from pathlib import Path

import pytest

from scenes.files.whole_file import require_writable, write_whole
from scenes.input_error import InputError


def test_a_full_disk_leaves_the_old_file_alone(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def full(descriptor: int) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")

    write_whole(tmp_path / "facts.json", b"old")
    monkeypatch.setattr(os, "fsync", full)
    with pytest.raises(InputError, match=r"facts\.json: cannot be written.*No space left"):
        write_whole(tmp_path / "facts.json", b"new")
    assert (tmp_path / "facts.json").read_bytes() == b"old"
    assert [p.name for p in tmp_path.iterdir()] == ["facts.json"]


def test_a_writer_that_is_interrupted_before_the_exchange_leaves_the_old_file_alone(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def interrupted(source: Path, target: Path) -> None:
        raise KeyboardInterrupt

    write_whole(tmp_path / "facts.json", b"old")
    monkeypatch.setattr(os, "replace", interrupted)
    with pytest.raises(KeyboardInterrupt):
        write_whole(tmp_path / "facts.json", b"new")
    assert (tmp_path / "facts.json").read_bytes() == b"old"
    assert [p.name for p in tmp_path.iterdir()] == ["facts.json"]


@pytest.mark.parametrize(("mask", "mode"), [(0o022, 0o644), (0o077, 0o600)])
def test_a_new_file_has_the_permissions_that_the_user_chose(tmp_path: Path, mask: int, mode: int) -> None:
    before = os.umask(mask)
    try:
        write_whole(tmp_path / "facts.json", b"{}")
    finally:
        os.umask(before)
    assert (tmp_path / "facts.json").stat().st_mode & 0o777 == mode


def test_a_name_with_a_null_character_is_refused_in_one_line(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="null characters"):
        require_writable(f"{tmp_path}/a\0b.h5")
