"""What a described robot can do: stand, shift its weight, step, lean a palm on a wall, climb a stair."""

# pydrake's stubs read "float64[m, 1]" as a shape and refuse every array.
# pyright: reportArgumentType=false, reportReturnType=false

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from itertools import product

import numpy as np

from drakeplan.robot_setup.link_tree import shape_points
from scenes.effector import EFFECTORS, LEFT_PALM
from scenes.input_error import InputError
from scenes.library.plates import GOAL_RADIUS, START, level_plate
from scenes.library.stairs import flight
from scenes.robots.plant import RobotPlant
from scenes.robots.robot import Robot
from scenes.scene import Goal, Scene
from scenes.terrain.terrain import Terrain

OVER_FOOT = 0.02  # [m] half edge of the square over a sole that the CoM is shifted into
DEADLINE = 60.0  # [s] of each planned crossing
RISE, MOST_OF_STEP = 0.15, 0.6  # [m] of a stair, and the share of the highest step where that is less
TREADS = 3
WALL_SHARES, WALL_DROPS = (0.5, 0.65, 0.8), (0.15, 0.35, 0.55)  # of the arm's reach: to the wall, below the shoulder
WALL_AHEAD = (0.0, 0.3)  # the same, before the shoulder
FLAT_LENGTH = 1.0  # [m] of the walk on level ground


@dataclass(frozen=True)
class Finding:
    """The answer to one question about the robot.

    Attributes:
        name: of the question.
        ok: whether it can.
        says: how, or why not.
        keys: keys of the robot file to look at where it cannot.
    """

    name: str
    ok: bool
    says: str
    keys: tuple[str, ...] = ()


def check_robot(robot: Robot, *, seed: int = 0, say: Callable[[str], None] = lambda line: None) -> Iterator[Finding]:
    """Asks one question after the other; the rest needs that the robot stands.

    Args:
        robot: to check.
        seed: of the planned crossings.
        say: takes a line before each question.
    """
    say("stand")
    stands = _stands(robot)
    yield stands
    if not stands.ok:
        return
    say("shift")
    yield _shifts(robot)
    say("step on level ground")
    yield _crosses("steps", robot, level_ground(robot), seed, ("leg_reach", "com_height", "foot_separation", "nominal"))
    if robot.palms:
        say("lean on a wall")
        yield _leans(robot)
    say("climb a stair")
    yield _crosses("climbs", robot, stair(robot), seed, ("max_step_height", "leg_reach", "com_height", "torso_box"))


def _stands(robot: Robot) -> Finding:
    from scenes.robots.nominal_stance import check_nominal_stance
    from scenes.robots.plant import build_plant, nominal_posture

    try:
        check_nominal_stance(robot)
    except InputError as error:
        says = str(error).removeprefix(f"{robot.source}: ")
        return Finding("stands", False, says, (says.partition(":")[0],))
    plant = build_plant(robot).plant
    context = plant.CreateDefaultContext()
    plant.SetPositions(context, nominal_posture(robot))
    com = plant.CalcCenterOfMassPositionInWorld(context)
    reach = min(e.half_extent[0] for e in robot.effectors[:2])
    if abs(com[0]) > reach:
        return Finding(
            "stands", False, f"the CoM is {1e3 * com[0]:+.0f} mm before the middle of the feet, the soles reach {1e3 * reach:.0f} mm",
            ("nominal", "effectors.left_foot"),
        )  # fmt: skip
    return Finding("stands", True, f"soles flat, CoM {1e3 * com[0]:+.0f} mm before their middle, {com[2]:.2f} m high")


def _shifts(robot: Robot) -> Finding:
    from optimization.inverse_kinematics.drake_posture import PostureSolver
    from scenes.robots.plant import build_plant, nominal_posture

    robot_plant, q = build_plant(robot), nominal_posture(robot)
    X_WE = _feet(robot)
    solver = PostureSolver(robot_plant)
    square = OVER_FOOT * np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]])
    for e in (0, 1):
        answer = solver.solve([*X_WE, None, None], square + X_WE[e][:2, 3], q)
        if not answer.ok:
            worst = answer.violations[0]
            return Finding(
                "shifts", False, f"the CoM does not come over the {EFFECTORS[e]}: {worst.name} by {worst.value:.3g}",
                ("nominal", "foot_separation", "package.ignored_pairs or changes.ignored_pairs"),
            )  # fmt: skip
    return Finding("shifts", True, "the CoM comes over either foot")


def _feet(robot: Robot) -> list[np.ndarray]:
    """(4, 4) poses of both soles in the nominal posture."""
    from scenes.robots.plant import build_plant, nominal_posture

    robot_plant = build_plant(robot)
    context = robot_plant.plant.CreateDefaultContext()
    robot_plant.plant.SetPositions(context, nominal_posture(robot))
    return [robot_plant.plant.EvalBodyPoseInWorld(context, b).GetAsMatrix4() for b in robot_plant.effector_bodies[:2]]


def _leans(robot: Robot) -> Finding:
    """Each palm flat on a wall beside the robot, in any of some places; the feet stay."""
    from optimization.inverse_kinematics.drake_posture import PostureSolver
    from scenes.robots.plant import build_plant, nominal_posture

    robot_plant, q = build_plant(robot), nominal_posture(robot)
    for palm in robot.palms:
        if _faces_its_hand(robot_plant, palm):
            name = EFFECTORS[palm]
            return Finding(
                "leans", False, f"the z axis of the {name}'s frame points out of the hand: it points from the wall into the hand",
                (f"effectors.{name}.frame", "frames"),
            )  # fmt: skip
    solver, feet = PostureSolver(robot_plant), _feet(robot)
    found: list[int] = []
    for palm in robot.palms:
        side = 1.0 if palm == LEFT_PALM else -1.0
        count = 0
        for share, drop, ahead in product(WALL_SHARES, WALL_DROPS, WALL_AHEAD):
            X_WC = np.eye(4)
            X_WC[:3, :3] = np.column_stack([(0, 0, 1), (-side, 0, 0), (0, -side, 0)])  # up, z x x, out of the wall
            X_WC[:3, 1] = np.cross(X_WC[:3, 2], X_WC[:3, 0])
            X_WC[:3, 3] = robot.shoulder * [1, side, 1] + robot.arm_reach[1] * np.array([ahead, side * share, -drop])
            X_WE: list[np.ndarray | None] = [*feet, None, None]
            X_WE[palm] = X_WC
            count += solver.solve(X_WE, None, q).ok
        found.append(count)
    places = len(WALL_SHARES) * len(WALL_DROPS) * len(WALL_AHEAD)
    if min(found) == 0:
        which = EFFECTORS[robot.palms[int(np.argmin(found))]]
        return Finding(
            "leans", False, f"the {which} lies flat on a wall beside the robot in none of {places} places",
            (f"effectors.{which}.frame", "frames (its z axis points out of the wall, its x axis up)", "arm_reach"),
        )  # fmt: skip
    return Finding(
        "leans",
        True,
        f"palms lie flat on a wall beside the robot in {' and '.join(map(str, found))} of {places} places",
    )


def _faces_its_hand(robot_plant: RobotPlant, palm: int) -> bool:
    """Whether most of the hand lies where the wall would be, behind its patch."""
    plant, inspector = robot_plant.plant, robot_plant.scene_graph.model_inspector()
    frame, context = robot_plant.effector_bodies[palm].body_frame(), plant.CreateDefaultContext()
    z = []
    for geometry in robot_plant.effector_geometry[palm]:
        body = plant.GetBodyFromFrameId(inspector.GetFrameId(geometry)).body_frame()
        X_EG = plant.CalcRelativeTransform(context, frame, body) @ inspector.GetPoseInFrame(geometry)
        z += list((X_EG @ shape_points(inspector, geometry).T)[2])
    return bool(z) and min(z) + max(z) < 0.0


def _crosses(name: str, robot: Robot, scene: Scene, seed: int, keys: tuple[str, ...]) -> Finding:
    from drakeplan.query.options import PlanOptions
    from drakeplan.query.planning import plan_scene

    result = plan_scene(scene, robot, PlanOptions(seed=seed, deadline=DEADLINE, improve=0.0), False)
    if result.plan is None or result.status != "complete":
        return Finding(name, False, result.reason, keys)
    stances, duration = len(result.plan.stances), result.plan.duration
    return Finding(name, True, f"{scene.name.replace('_', ' ')}: verified, {stances} stances, {duration:.0f} s")


def level_ground(robot: Robot) -> Scene:
    """A metre of level ground.

    Args:
        robot: that is to cross it.
    """
    half = 0.5 * (robot.foot_separation[1] + 1.0)
    ground = level_plate("ground", (-0.5, FLAT_LENGTH + 0.5), (-half, half))
    return Scene("level_ground", Terrain((ground,)), START, Goal((FLAT_LENGTH, 0.0, 0.0), GOAL_RADIUS))


def stair(robot: Robot) -> Scene:
    """Three steps as high as the robot's file promises comfortably, at most 0.15 m each.

    Args:
        robot: that is to climb it.
    """
    rise = min(RISE, MOST_OF_STEP * robot.max_step_height)
    foot = robot.effectors[0]
    going = max(0.28, 2 * foot.half_extent[0] + sum(foot.overhang[:2]) + 0.06)
    half = 0.5 * (robot.foot_separation[1] + 0.8)
    name = f"a stair of {100 * rise:.0f} cm steps"
    return flight(name, rise, going, TREADS - 1, foot=0.5, half_width=half)
