"""The search under low ceilings: states with a crouching posture pass, heads inside a box do not, and no proof contradicts a way."""

from __future__ import annotations

import time

import numpy as np
import pytest

from drakeplan.contact_planning.contact_plan import PlannerOptions
from drakeplan.contact_planning.search_planner import SearchPlanner
from drakeplan.contact_planning.torso_room import torso_closed
from drakeplan.context import QueryContext
from drakeplan.search.ana_star import Limits
from optimization.inverse_kinematics.whole_body_ik import WholeBodyIK
from scenes.pose import pose_matrix
from scenes.robots.robot import load_robot, robot_names
from scenes.scene import Goal, Scene, Start
from scenes.terrain.surface import Surface
from scenes.terrain.terrain import Box, Terrain

ROBOT = load_robot("escher")
IK = WholeBodyIK(ROBOT)
FEET = PlannerOptions(use_palms=False)
HALF = 0.6  # [m] half width of the corridor


def corridor(*boxes: Box) -> QueryContext:
    corners = [[-0.8, -HALF, 0.0], [3.0, -HALF, 0.0], [3.0, HALF, 0.0], [-0.8, HALF, 0.0]]
    terrain = Terrain((Surface("floor", np.array(corners)),), boxes)
    scene = Scene("corridor", terrain, Start((0.0, 0.0, 0.0)), Goal((2.2, 0.0, 0.0)))
    return QueryContext(scene, ROBOT, IK, full_soles=True)


def beam(height: float, x: tuple[float, float], y: tuple[float, float] = (-1.0, 1.0), thick: float = 0.3) -> Box:
    size = np.array([x[1] - x[0], y[1] - y[0], thick])
    return Box("beam", size, pose_matrix((0.5 * sum(x), 0.5 * sum(y), height + 0.5 * thick), (0.0, 0.0, 0.0)))


@pytest.mark.parametrize("height", [1.25, 1.3, 1.4, 1.5, 1.6, 1.66])
def test_a_stance_under_a_ceiling_has_a_posture_below_it(height: float) -> None:
    planner = SearchPlanner(corridor(beam(height, (-0.5, 0.5))), FEET)
    held = planner._start_state[:4]
    assert planner.check.stance(held) == ""
    q = planner.check.posture(held, held)
    assert q is not None
    head = IK.kinematics.body_pose(q, "head")
    assert (head @ [0.0, 0.0, 0.115, 1.0])[
        2
    ] + 0.085 < height + 0.03  # limbs may be 2 cm deep here, the motion keeps clear


@pytest.mark.parametrize(("height", "thick"), [(0.7, 0.3), (0.9, 0.1), (0.5, 0.5)])
def test_no_stance_has_a_posture_under_a_ceiling_that_is_too_low(height: float, thick: float) -> None:
    planner = SearchPlanner(corridor(beam(height, (-0.7, 0.7), thick=thick)), FEET)
    assert planner.check.stance(planner._start_state[:4]) == "collision"


@pytest.mark.parametrize("height", [1.4, 1.55])
def test_the_search_leads_under_a_beam_in_few_expansions(height: float) -> None:
    planner = SearchPlanner(corridor(beam(height, (0.8, 1.4))), FEET)
    plan = next(iter(planner.plans(Limits(expansions=400, improve=0.0))))
    assert plan.stances[-1].feet_mean()[0] > 1.8


def test_what_is_proved_closed_the_search_finds_no_way_through() -> None:
    outcomes = set()
    for gap, low in ((0.0, 1.15), (0.2, 0.9), (0.4, 1.15), (0.9, 0.9)):
        context = corridor(beam(low, (0.8, 1.4), (-1.0, HALF - gap)))
        planner = SearchPlanner(context, FEET)
        stride, reach = FEET.longest_travel(ROBOT), FEET.step_reach(ROBOT)
        scene, packed = context.scene, context.packed
        closed = torso_closed(scene.terrain, packed, ROBOT, stride, reach, context.start, context.goal)
        planner.domain.beyond_grid = True
        found = next(iter(planner._run(Limits(expansions=40, improve=0.0), time.perf_counter, 0)), None)
        assert closed is None or found is None, f"gap {gap}"
        outcomes.add((closed is not None, found is not None))
    assert {(True, False), (False, True)} <= outcomes


@pytest.mark.parametrize("name", [n for n in robot_names() if n != "jvrc1"])
def test_what_is_left_of_the_torso_box_is_part_of_it_and_comes_down_with_the_com(name: str) -> None:
    robot = load_robot(name)
    centre, size = robot.lowest_torso_box
    upright, low = (
        (c - 0.5 * s, c + 0.5 * s) for c, s in ((robot.torso_box_centre, robot.torso_box_size), (centre, size))
    )
    np.testing.assert_allclose(low[0], upright[0], atol=1e-12)
    np.testing.assert_allclose(low[1][:2], upright[1][:2], atol=1e-12)
    assert upright[1][2] - low[1][2] == pytest.approx(robot.com_height[1] - robot.com_height[0])
    assert size[2] > 0.3 * robot.torso_box_size[2]
