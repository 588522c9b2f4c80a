"""Low ceilings, narrow doors and walls beside the shoulder: passed by a verified plan, or refused at once with the reason."""

from __future__ import annotations

import time

import numpy as np
import pytest

from drakeplan.plan.plan import Plan
from drakeplan.query.options import PlanOptions
from drakeplan.query.planning import plan_scene
from drakeplan.query.result import PlanResult
from optimization.inverse_kinematics.whole_body_ik import WholeBodyIK
from optimization.multibody.robot_shapes import read_shapes
from optimization.multibody.terrain_distance import near_terrain
from scenes.pose import pose_matrix
from scenes.robots.plant import build_plant
from scenes.robots.robot import load_robot
from scenes.scene import Goal, Scene, Start
from scenes.terrain.packed_terrain import pack_terrain
from scenes.terrain.surface import Surface
from scenes.terrain.terrain import Box, Terrain

ROBOT = load_robot("escher")
IK = WholeBodyIK(ROBOT)
SUNK = 5e-3  # [m] that a body may be in the terrain at most


def rectangle(name: str, x: tuple[float, float], y: tuple[float, float]) -> Surface:
    return Surface(name, np.array([[x[0], y[0], 0.0], [x[1], y[0], 0.0], [x[1], y[1], 0.0], [x[0], y[1], 0.0]]))


def box(name: str, size: tuple[float, float, float], at: tuple[float, float, float]) -> Box:
    return Box(name, np.array(size), pose_matrix(at, (0.0, 0.0, 0.0)))


def beam(height: float, depth: float = 0.6) -> Scene:
    """A corridor under a beam of its whole width."""
    floor = rectangle("floor", (-0.8, 3.0), (-0.8, 0.8))
    over = box("beam", (depth, 1.6, 0.3), (1.1, 0.0, height + 0.15))
    return Scene("beam", Terrain((floor,), (over,)), Start((0.0, 0.0, 0.0)), Goal((2.2, 0.0, 0.0)))


def door(width: float) -> Scene:
    """A wall across the way, with an opening."""
    floor = rectangle("floor", (-0.8, 3.0), (-1.5, 1.5))
    jambs = tuple(
        box(name, (0.15, 1.5 - 0.5 * width, 2.2), (1.0, side * (0.75 + 0.25 * width), 1.1))
        for name, side in (("left", 1.0), ("right", -1.0))
    )
    return Scene("door", Terrain((floor,), jambs), Start((0.0, 0.0, 0.0)), Goal((2.2, 0.0, 0.0)))


def wall(beside: float) -> Scene:
    """A wall beside the shoulder, and a goal at which the robot faces it."""
    floor = rectangle("floor", (-2.0, 3.0), (-2.0, 2.0))
    corners = [[-2.0, beside, 0.0], [3.0, beside, 0.0], [3.0, beside, 2.0], [-2.0, beside, 2.0]]
    goal = Goal((1.5, 0.0, 0.0), 0.1, 0.5 * np.pi)
    return Scene("wall", Terrain((floor, Surface("wall", np.array(corners)))), Start((0.0, 0.0, 0.0)), goal)


def planned(scene: Scene) -> Plan:
    result = plan_scene(scene, ROBOT, PlanOptions(seed=0, deadline=60.0, improve=0.3))
    assert result.status == "complete", result.reason
    assert result.plan is not None
    return result.plan


def deepest(plan: Plan, scene: Scene) -> float:
    """How deep a body other than feet is in the terrain, all frames together [m], by our own distances."""
    assert plan.motion is not None
    shapes, _ = read_shapes(build_plant(ROBOT), IK.kinematics)
    met = near_terrain(IK.kinematics.tree, shapes, pack_terrain(scene.terrain), plan.motion.q, 0.02)
    own = shapes.effector[met.shape] < 0
    return float(-met.distance[own].min(initial=0.0))


def head_top(plan: Plan) -> np.ndarray:
    """(T,) height of the top of the head's capsule, upright as the trunk is nearly always [m]."""
    assert plan.motion is not None
    poses = [IK.kinematics.body_pose(q, "head") for q in plan.motion.q]
    return np.array([(X @ [0.0, 0.0, 0.115, 1.0])[2] + 0.085 for X in poses])


@pytest.mark.slow
@pytest.mark.parametrize("height", [1.4, 1.5, 1.6])
def test_the_robot_ducks_under_a_beam_and_stands_up_behind_it(height: float) -> None:
    scene = beam(height)
    plan = planned(scene)
    assert plan.motion is not None
    under = np.abs(plan.motion.q[:, 4] - 1.1) < 0.25
    assert under.any()
    top = head_top(plan)
    assert top[under].max() < height
    assert top[[0, -1]].min() > 1.62
    assert deepest(plan, scene) < SUNK


@pytest.mark.slow
@pytest.mark.parametrize("width", [0.5, 0.56])
def test_the_robot_passes_a_door_narrower_than_its_elbows(width: float) -> None:
    scene = door(width)
    assert deepest(planned(scene), scene) < SUNK


@pytest.mark.slow
def test_the_robot_walks_along_a_wall_beside_its_shoulder_and_turns_to_face_it() -> None:
    scene = wall(0.45)
    assert deepest(planned(scene), scene) < SUNK


def refused(scene: Scene) -> tuple[PlanResult, float]:
    began = time.perf_counter()
    result = plan_scene(scene, ROBOT, PlanOptions(seed=0, deadline=20.0))
    return result, time.perf_counter() - began


@pytest.mark.parametrize("height", [0.7, 1.15])
def test_a_beam_that_nobody_passes_is_refused_before_any_search(height: float) -> None:
    refused(beam(height))  # kernels are loaded
    result, seconds = refused(beam(height))
    assert result.status == "none"
    assert f"box 'beam' leaves {height:.2f} m over the floor, the robot needs 1.20 m" in result.reason
    assert result.report["expansions"] == 0
    obstacle = result.report["obstacle"]
    assert isinstance(obstacle, dict)
    assert obstacle["limit"]["clearance_m"] == pytest.approx(height)
    assert seconds < 5.0  # of 20: the machine may be busy


def partition() -> Scene:
    """A wall that is too high to step over and low enough to look over, with a dead end before it and a lane beside it."""
    floor = rectangle("floor", (-1.35, 1.25), (-0.65, 0.65))
    walls = (box("along", (0.48, 0.02, 0.4), (-0.02, 0.0, 0.2)), box("across", (0.02, 0.6, 0.4), (0.21, -0.3, 0.2)))
    return Scene("partition", Terrain((floor,), walls), Start((-1.2, 0.0, 0.0)), Goal((1.0, 0.0, 0.0)))


@pytest.mark.slow
def test_feet_go_round_a_wall_that_no_swing_gets_over() -> None:
    """Every foothold is in reach of another across the wall: the search has to learn that no foot gets there."""
    scene = partition()
    result = plan_scene(scene, ROBOT, PlanOptions(deadline=60.0))
    assert result.status == "complete", result.reason
