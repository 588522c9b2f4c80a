"""A second process compiles while the first one does, and is gone when the first one is done."""

from __future__ import annotations

import subprocess
import threading

import pytest

from drakeplan.query import first_compilation
from drakeplan.query.first_compilation import compile_beside, compile_the_rest
from scenes.robots.robot import load_robot


class Helpers:
    """Counts processes that are started."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self.started: list[subprocess.Popen] = []
        self.one = threading.Event()
        popen = subprocess.Popen

        def start(*args, **kwargs):
            self.started.append(popen(*args, **kwargs))
            self.one.set()
            return self.started[-1]

        monkeypatch.setattr(first_compilation.subprocess, "Popen", start)


def test_the_helper_starts_when_loading_takes_long_and_ends_with_it(monkeypatch: pytest.MonkeyPatch) -> None:
    helpers, told = Helpers(monkeypatch), threading.Event()
    monkeypatch.setattr(first_compilation, "COMPILING", 0.01)
    monkeypatch.setattr(first_compilation.os, "cpu_count", lambda: 2)
    with compile_beside(load_robot("escher"), told.set):
        assert helpers.one.wait(30.0)
        assert told.is_set()
        assert helpers.started[0].poll() is None
    assert helpers.started[0].poll() is not None


@pytest.mark.parametrize(("cores", "patience"), [(2, 60.0), (1, 0.0)])
def test_no_helper_where_loading_is_quick_or_there_is_one_core(
    monkeypatch: pytest.MonkeyPatch, cores: int, patience: float
) -> None:
    helpers, told = Helpers(monkeypatch), threading.Event()
    monkeypatch.setattr(first_compilation, "COMPILING", patience)
    monkeypatch.setattr(first_compilation.os, "cpu_count", lambda: cores)
    with compile_beside(load_robot("escher"), told.set):
        assert patience or told.wait(30.0)
    assert helpers.started == []


@pytest.mark.parametrize("name", ["escher", "jvrc1"])
def test_what_the_helper_does_makes_a_motion(name: str) -> None:
    compile_the_rest(name)
