"""The clock of a query."""

from __future__ import annotations

import time

import numpy as np
import pytest
from numba import njit

from drakeplan.deadline import Deadline, OutOfTimeError, compile_clock


def test_without_a_limit_there_is_always_time() -> None:
    deadline = Deadline()
    deadline.start()
    deadline.check("anywhere")
    assert deadline.left() == np.inf and deadline.why() == ""


def test_time_runs_from_the_start_and_what_was_used_before_counts() -> None:
    deadline = Deadline(1.0, used=0.4)
    assert deadline.left() == pytest.approx(0.6)
    deadline.start()
    time.sleep(0.2)
    assert deadline.left() <= 0.4
    time.sleep(0.45)
    assert deadline.left() == 0.0 and deadline.why() == "deadline"
    with pytest.raises(OutOfTimeError, match="deadline of 1 s ended during the motion"):
        deadline.check("during the motion")


def test_a_user_who_asks_to_stop_ends_it() -> None:
    deadline = Deadline(100.0, stop=lambda: True)
    deadline.start()
    with pytest.raises(OutOfTimeError, match="stopped during the motion"):
        deadline.check("during the motion")


def test_kernels_that_compile_do_not_count_and_calls_of_compiled_ones_do() -> None:
    @njit
    def inner(x: np.ndarray) -> float:
        return np.linalg.norm(x) + np.sort(x)[0]

    @njit
    def outer(x: np.ndarray) -> float:
        return inner(x) + inner(2 * x)

    deadline, before = Deadline(1000.0), compile_clock.seconds()
    deadline.start()
    began = time.perf_counter()
    outer(np.ones(3))
    took, compiled = time.perf_counter() - began, compile_clock.seconds() - before
    assert 0.5 * took < compiled <= took  # nested compilations count once
    assert 1000.0 - deadline.left() == pytest.approx(took - compiled, abs=0.1)
    outer(np.ones(3))
    assert compile_clock.seconds() - before == compiled
