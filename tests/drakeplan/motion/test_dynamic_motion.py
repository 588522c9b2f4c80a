"""A way down a slope on which nobody can stand still: possible for who keeps moving, by the true friction cone and the verifier."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from drakeplan.contact_planning.sequence_dynamics import sequence_dynamics, sequence_problem
from drakeplan.context import QueryContext
from drakeplan.motion.assembly import assemble_plan
from drakeplan.motion.course_dynamics import ComCourse
from drakeplan.motion.maker import MotionMaker, MotionOptions
from drakeplan.plan.plan_file import write_plan
from drakeplan.timing.step_timing import Timing
from drakeplan.verifier import verify
from optimization.balance.friction import FrictionCone, frame_stands_alone
from optimization.inverse_kinematics.whole_body_ik import WholeBodyIK
from scenes.contact import Contact
from scenes.library import steep_slope
from scenes.robots.robot import load_robot
from scenes.scene import Goal, Scene, Start
from scenes.stance import Stance

ROBOT = load_robot("escher")
TILT, LENGTH, STEP = np.deg2rad(27.0), 0.8, 0.35  # atan(0.5) is 26.57 deg
TIMING = Timing(0.4, 0.8)
EDGES = (0.5, 0.5 + LENGTH)  # along the way, where the slope begins and ends


def foot(effector: int, way: float, tilt: float = TILT) -> Contact:
    """A foot this far along the way [m], toes ahead."""
    side = 0.1 if effector == 0 else -0.1
    c, s = np.cos(tilt), np.sin(tilt)
    on = np.clip(way - EDGES[0], 0.0, LENGTH)
    X_WC = np.eye(4)
    X_WC[:3, 3] = min(way, EDGES[0]) + c * on + max(way - EDGES[1], 0.0), side, -s * on
    surface = 0 if way < EDGES[0] else 1 if way < EDGES[1] else 2
    if surface == 1:
        X_WC[:3, :3] = [[c, 0, s], [0, 1, 0], [-s, 0, c]]
    return Contact(("left_foot", "right_foot")[effector], surface, X_WC, 0.5)


def walk(tilt: float = TILT, step: float = STEP) -> list[Stance]:
    way, mover = 0.2, 0
    stances = [Stance((foot(0, way, tilt), foot(1, way, tilt), None, None))]
    while way < EDGES[1] + 0.5:
        way += step
        for edge in EDGES:
            if abs(way - edge) < 0.13:
                way = edge + 0.13
        stances.append(stances[-1].replace(mover, foot(mover, way, tilt)))
        mover = 1 - mover
    return [*stances, stances[-1].replace(mover, foot(mover, way, tilt))]


def test_nobody_stands_on_that_slope() -> None:
    for cone in ("inner", "second_order"):
        assert not frame_stands_alone(FrictionCone(cone).code, 0.5, foot(0, 0.9).R_WC)


def test_the_com_course_passes_through_key_postures_and_keeps_its_shape_between() -> None:
    t = np.linspace(0.0, 2.0, 21)
    com_course = ComCourse(t, np.column_stack([t**2, np.zeros(21), np.ones(21)]))
    key_t = np.array([0.0, 1.0, 2.0])
    keys = com_course.at(key_t) + np.array([[0.0, 0.0, 0.0], [0.01, 0.02, 0.0], [0.0, 0.0, 0.0]])
    np.testing.assert_allclose(com_course.meeting(key_t, keys, key_t), keys, atol=1e-12)
    np.testing.assert_allclose(com_course.meeting(key_t, com_course.at(key_t), t), com_course.at(t), atol=1e-12)


@pytest.mark.slow
def test_the_published_tilt_of_30_deg_is_possible_under_the_true_cone_for_who_moves_fast() -> None:
    stances = walk(np.deg2rad(30.0), 0.4)
    estimate = sequence_dynamics(ROBOT, stances, "second_order", Timing(0.3, 0.6))
    assert estimate.feasible, estimate.reason
    force, contact = estimate.trajectory.force_W[:-1], estimate.trajectory.contact[:-1]
    contacts = sequence_problem(ROBOT, stances, Timing(0.3, 0.6)).schedule.contacts
    for n, e in zip(*np.nonzero(contact >= 0), strict=True):
        f = contacts[contact[n, e]].R_WC.T @ force[n, e]
        assert np.hypot(f[0], f[1]) <= 0.5 * f[2] + 1e-3


@pytest.mark.slow
def test_who_keeps_moving_gets_down_and_the_verifier_agrees(tmp_path: Path) -> None:
    stances = walk()
    scene = steep_slope.named(tilt=TILT, length=LENGTH)
    estimate = sequence_dynamics(ROBOT, stances, "inner", TIMING)
    assert estimate.feasible, estimate.reason
    assert np.linalg.norm(estimate.trajectory.linear_momentum, axis=1).max() > 0.2 * ROBOT.mass
    context = QueryContext(scene, ROBOT, WholeBodyIK(ROBOT))
    maker = MotionMaker(context, MotionOptions(dt=0.2, shift=TIMING.shift, swing=TIMING.swing))
    assert not maker.run(stances, lambda event: None).ok  # resting places are what it looks for
    motion = maker.run(stances, lambda event: None, ComCourse(estimate.trajectory.t, estimate.trajectory.com))
    assert motion.ok, motion.reason
    plan = assemble_plan(_goal_at_the_end(scene, stances), ROBOT, stances, motion, cone=context.cone, provenance={})
    write_plan(plan, tmp_path / "plan.h5")
    report = verify(tmp_path / "plan.h5")
    assert report.holds, [c.name for c in report.checks if not c.ok]


def _goal_at_the_end(scene: Scene, stances: list[Stance]) -> Scene:
    start, end = stances[0].feet_mean(), stances[-1].feet_mean()
    return replace(scene, start=Start(tuple(start), 0.0), goal=Goal(tuple(end), 0.2))
