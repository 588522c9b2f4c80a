"""Free timing of whole plans: less effort, no more time, and the same verifier."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import drakeplan
from drakeplan.motion.free_timing import effort, free_durations, planned_schedule, round_to_grid
from drakeplan.query.options import PlanOptions
from drakeplan.timing.phases import make_schedule
from drakeplan.timing.step_timing import Timing
from scenes.contact import Contact
from scenes.files.scene_source import load_scene
from scenes.robots.robot import load_robot
from scenes.stance import Stance

ROBOT = load_robot("escher")


@pytest.mark.slow
def test_a_plan_with_free_timing_takes_less_effort_in_no_more_time_and_is_verified(tmp_path: Path) -> None:
    efforts, times = [], []
    for free in (False, True):
        options = PlanOptions(seed=0, expansions=100, timing=Timing(free=free))
        result = drakeplan.plan_scene(load_scene("flat", seed=0), ROBOT, options)
        assert result.status == "complete", result.reason
        plan = result.plan
        assert plan is not None
        drakeplan.write_plan(plan, tmp_path / "plan.h5")
        assert drakeplan.verify(tmp_path / "plan.h5").holds
        efforts.append(effort(ROBOT, planned_schedule(plan), "inner", plan.centroidal))
        times.append(plan.centroidal.t[-1])
        durations = plan.phases.end - plan.phases.start
        assert np.allclose(durations, 1.0) != free
    assert efforts[1] < 0.995 * efforts[0]  # the key postures leave it little room on level ground
    assert times[1] <= times[0] + 1e-6


def test_free_durations_are_multiples_of_the_knots_within_the_same_time() -> None:
    stances = _steps()
    schedule = make_schedule(stances)
    found = free_durations(ROBOT, schedule, "inner", 0.2, (0.5, 2.0))
    assert found is not None
    shift, swing, rest = found
    durations = np.concatenate([shift, swing, [rest]])
    assert np.allclose(durations / 0.2, np.round(durations / 0.2))
    assert durations.sum() <= schedule.duration + 1e-9
    assert not np.allclose(durations, 1.0)
    assert (swing >= 1.0 - 1e-9).all()  # limbs that swing faster turn the body more
    assert make_schedule(stances, shift=shift, swing=swing, rest=rest).duration == pytest.approx(durations.sum())


def test_where_nothing_may_change_nothing_is_better() -> None:
    assert free_durations(ROBOT, make_schedule(_steps()), "inner", 0.2, (1.0, 1.0)) is None


@given(st.lists(st.floats(0.05, 3.0), min_size=1, max_size=12), st.sampled_from([0.05, 0.1, 0.2]))
def test_rounding_keeps_within_the_total_and_near(durations: list[float], step: float) -> None:
    wanted = np.array(durations)
    total = np.ceil(wanted.sum() / step) * step
    rounded = round_to_grid(wanted, step, total)
    assert np.allclose(rounded / step, np.round(rounded / step))
    assert (rounded >= step - 1e-9).all()
    assert (np.abs(rounded - wanted) < step * (1 + 1e-6)).all()
    if (wanted >= step).all():  # else each takes at least a step
        assert rounded.sum() <= total + 1e-6
        assert rounded.sum() >= min(total, wanted.sum()) - step


def _steps() -> list[Stance]:
    from scenes.contact import contact_pose

    def foot(name: str, x: float) -> Contact:
        y = 0.1 if name == "left_foot" else -0.1
        return Contact(name, 0, contact_pose(name, np.array([x, y, 0.0]), np.array([0.0, 0.0, 1.0]), 0.0), 0.6)

    stances = [Stance((foot("left_foot", 0.0), foot("right_foot", 0.0), None, None))]
    for effector, name, x in ((0, "left_foot", 0.25), (1, "right_foot", 0.5), (0, "left_foot", 0.5)):
        stances.append(stances[-1].replace(effector, foot(name, x)))
    return stances
