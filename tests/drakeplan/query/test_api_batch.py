"""Many queries at once: in order, the same whoever works, and what happens to one says nothing about the others."""

from __future__ import annotations

import dataclasses
import gc
import multiprocessing
import os
import signal
import threading
from pathlib import Path

import pytest

from drakeplan.plan.plan import Plan
from drakeplan.plan.plan_file import write_plan
from drakeplan.progress import ProgressEvent
from drakeplan.query import batch
from drakeplan.query.batch import plan_many
from drakeplan.query.options import PlanOptions
from drakeplan.query.planning import plan_scene
from drakeplan.query.result import PlanResult
from scenes.input_error import InputError

SHORT = PlanOptions(goal=(0.5, 0.0), expansions=60, deadline=300.0)  # as the small plan of test_same_plan


def content(result: PlanResult, folder: Path) -> bytes:
    """The bytes of a plan's file."""
    assert isinstance(result.plan, Plan), result.reason
    write_plan(result.plan, folder / "plan.h5")
    return (folder / "plan.h5").read_bytes()


@pytest.mark.slow
def test_one_workers_death_is_the_failure_of_one_query_and_the_others_are_those_of_one_process(tmp_path: Path) -> None:
    """The only worker is killed while it does the second of four queries; the third has no goal to reach."""
    far = dataclasses.replace(SHORT, goal=(50.0, 0.0))
    told: list[str] = []

    def kill_the_next(event: ProgressEvent) -> None:
        if event.stage != "batch":
            return
        told.append(event.message)
        if len(told) == 1:
            (worker,) = multiprocessing.active_children()
            assert worker.pid is not None
            threading.Timer(0.3, os.kill, (worker.pid, signal.SIGKILL)).start()

    # The second one searches for half a minute, so that the signal finds it at work.
    long = PlanOptions(seed=0, improve=30.0, deadline=60.0)
    asked = [SHORT, long, far, dataclasses.replace(SHORT, seed=1)]
    results = plan_many(["flat", "random_surfaces", "flat", "flat"], "escher", asked, 1, kill_the_next)
    assert [result.status for result in results] == ["complete", "none", "none", "complete"]
    assert results[1].reason == "its process died (exit code -9)"
    assert "no ground takes a sole within" in results[2].reason
    assert told[0] == "1 of 4: flat: complete" and told[-1].startswith("4 of 4: ")
    assert not multiprocessing.active_children()
    for k in (0, 3):
        assert content(results[k], tmp_path) == content(plan_scene("flat", "escher", asked[k]), tmp_path)
        assert results[k].verification is not None and results[k].verification.holds


@pytest.mark.slow
def test_ctrl_c_ends_all_workers_at_once() -> None:
    looks = []

    def press() -> bool:
        looks.append(1)
        if len(looks) == 3:
            os.kill(os.getpid(), signal.SIGINT)
        return False

    with pytest.raises(KeyboardInterrupt):
        plan_many(["random_surfaces"] * 3, "escher", PlanOptions(stop=press, improve=60.0, deadline=100.0))
    assert len(looks) == 3
    assert not multiprocessing.active_children()


@pytest.mark.slow
def test_a_batch_that_is_stopped_says_so_of_every_query_that_was_not_answered() -> None:
    results = plan_many(["flat", "stairs"], options=dataclasses.replace(SHORT, stop=lambda: True), progress=False)
    assert [(r.status, r.reason, r.plan) for r in results] == [("none", "stopped before it was answered", None)] * 2
    assert not multiprocessing.active_children()


def test_no_scenes_have_no_results() -> None:
    assert plan_many([]) == []


@pytest.mark.parametrize(
    ("scenes", "options", "workers", "said"),
    [
        ("flat", None, 2, "scenes: expected a list of scenes, got one"),
        (["flat", "flatt"], None, 2, "unknown scene 'flatt'"),
        (["flat"], [PlanOptions(), PlanOptions()], 2, "expected one, or one for each of 1 scenes, got 2"),
        (["flat"], PlanOptions(planner="none"), 2, "unknown planner 'none'"),
        (["flat"], None, 0, "workers: expected 1 or more, got 0"),
    ],
)
def test_what_is_wrong_with_all_is_said_before_anything_starts(scenes, options, workers: int, said: str) -> None:
    with pytest.raises(InputError, match=said):
        plan_many(scenes, "escher", options, workers)
    assert not multiprocessing.active_children()


def test_no_thread_of_the_pool_collects_garbage_that_must_die_in_its_own_thread():
    assert gc.isenabled()
    with batch._garbage_of_this_thread():
        assert not gc.isenabled()
        with batch._garbage_of_this_thread():
            pass
        assert not gc.isenabled()
    assert gc.isenabled()
