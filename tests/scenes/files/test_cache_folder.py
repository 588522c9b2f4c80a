"""Kernels and robots go where files can be written, and what was compiled before is taken along."""

from __future__ import annotations

import os
import tempfile
from pathlib import Path

import platformdirs
import pytest

import scenes.files.cache_folder as cache_folder


@pytest.fixture(autouse=True)
def machine(tmp_path, monkeypatch):
    """A machine whose folders named "closed" cannot be written."""
    cache_folder.temporary_folder.cache_clear()
    monkeypatch.delenv(cache_folder.KERNELS, raising=False)
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    monkeypatch.setattr(platformdirs, "user_cache_dir", lambda name: str(tmp_path / "closed" / name))
    writable = cache_folder.is_writable
    monkeypatch.setattr(cache_folder, "is_writable", lambda f: "closed" not in f.parts and writable(f))
    monkeypatch.setattr(cache_folder, "_use", lambda f: monkeypatch.setenv(cache_folder.KERNELS, str(f)))
    yield
    cache_folder.temporary_folder.cache_clear()


def kernel(path: Path, content: bytes = b"kernel") -> Path:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(content)
    return path


def test_an_installation_that_can_be_written_is_left_alone(tmp_path):
    cache_folder.choose_kernel_cache(tmp_path / "open")
    assert cache_folder.KERNELS not in os.environ


def test_elsewhere_kernels_go_to_a_private_folder_and_that_is_said_once(tmp_path, capsys):
    kernel(tmp_path / "closed" / "scenes" / "terrain" / "__pycache__" / "a.f-1.py311.nbi")
    for _ in range(2):
        os.environ.pop(cache_folder.KERNELS, None)
        cache_folder.choose_kernel_cache(tmp_path / "closed")
    chosen = Path(os.environ[cache_folder.KERNELS])
    assert chosen.is_relative_to(tmp_path) and "closed" not in chosen.parts
    assert chosen.parent.stat().st_mode & 0o077 == 0
    assert capsys.readouterr().err.count("can be written") == 1
    (copy,) = chosen.rglob("*.nbi")
    assert copy.read_bytes() == b"kernel"


def test_the_copy_lies_where_numba_looks(tmp_path):
    caching = pytest.importorskip("numba.core.caching")
    source = tmp_path / "closed" / "scenes" / "terrain" / "a.py"
    kernel(source.parent / "__pycache__" / "a.f-1.py311.nbi")
    cache_folder.choose_kernel_cache(tmp_path / "closed")
    (copy,) = Path(os.environ[cache_folder.KERNELS]).rglob("*.nbi")
    assert copy.parent.name == caching._CacheLocator.get_suitable_cache_subpath(str(source))


def test_a_prepared_folder_that_cannot_be_written_is_copied(tmp_path, monkeypatch):
    prepared = tmp_path / "closed" / "kernels"
    kernel(prepared / "terrain_123" / "a.f-1.py311.nbi", b"prepared")
    monkeypatch.setenv(cache_folder.KERNELS, str(prepared))
    cache_folder.choose_kernel_cache(tmp_path / "open")
    chosen = Path(os.environ[cache_folder.KERNELS])
    assert (chosen / "terrain_123" / "a.f-1.py311.nbi").read_bytes() == b"prepared"


def test_a_folder_that_another_user_has_made_is_not_trusted(tmp_path, monkeypatch):
    (tmp_path / "elsewhere").mkdir()
    (tmp_path / f"drakeplan-{cache_folder._user()}").symlink_to(tmp_path / "elsewhere")
    assert cache_folder.temporary_folder().resolve() != tmp_path / "elsewhere"


def test_robots_have_a_folder_too(tmp_path):
    folder = cache_folder.cache_folder("robots")
    assert folder.is_dir() and folder.name == "robots" and "closed" not in folder.parts
