"""Setting the robot down: from "here, facing there" to the first stance."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator

import numpy as np

from scenes.contact import Contact
from scenes.effector import EFFECTORS
from scenes.footholds.floors import Floor, by_preference, choice_note, floors_around, has_head_room, no_floor_near
from scenes.footholds.free_polygon import footholds_near
from scenes.footholds.partial_support import rest_down, rests_whole
from scenes.footholds.projection import FOOT_CLEARANCE, set_down
from scenes.footholds.what_stands import patch_off_surface, what_stands
from scenes.input_error import InputError
from scenes.robots.robot import Robot
from scenes.scene import Goal, Scene
from scenes.stance import Stance
from scenes.terrain.packed_terrain import PackedTerrain
from scenes.terrain.solids import solid_at

NUDGES = (
    0.0,
    0.03,
    -0.03,
    0.06,
    -0.06,
    0.1,
    -0.1,
)  # [m] tried forward and sideways for soles that rest on part of themselves
NEAR = 0.14  # [m] a whole sole is set down no farther from its usual place: both nudges at their largest
STANCE_OFF = 1e-3  # [m] how far a patch of a given stance may reach beyond its surface, as the verifier has it


def start_stance(scene: Scene, packed: PackedTerrain, robot: Robot, full_soles: bool = False) -> Stance:
    """The stance a scene's start describes: as given, or the feet set down around its point.

    Args:
        scene: with a start.
        packed: its terrain.
        robot: who starts there.
        full_soles: whether all of each sole has to rest on the ground; else that is tried first.

    Raises:
        InputError: no start, or no ground that takes both soles there.
    """
    start = scene.start
    if start is None:
        raise _missing(scene, "start")
    if start.stance:
        by_name = {c.effector: c for c in start.stance}
        stance = Stance(tuple(by_name.get(e) for e in EFFECTORS))
        if stance.contacts[0] is None or stance.contacts[1] is None:
            raise InputError(f"scene {scene.name}: start.stance: expected both left_foot and right_foot")
        check_given_stance(scene, packed, robot, stance)
        return stance
    x, y, z = start.xyz
    floors = start_floors(scene, packed, robot, full_soles)
    wanted = by_preference(floors, z, np.nan)
    if floors and not wanted:
        raise no_floor_near(f"scene {scene.name}: start", floors, z)
    cramped: Stance | None = None
    for floor in wanted:
        stance = feet_down(packed, robot, (x, y, start.yaw), floor.window(z), full_soles)
        if stance is not None:
            if has_head_room(packed, robot, *stance.feet_mean()):
                return stance
            cramped = cramped or stance
    if cramped is not None:
        _refuse_inside(scene, packed, robot, cramped)
        return cramped
    standing = what_stands(scene.terrain, packed, ((x, y),), z)
    why = f"{standing} stands there" if standing else extent_text(scene)
    raise InputError(f"scene {scene.name}: start: no ground takes both soles near x {x:g}, y {y:g}: {why}")


def feet_down(
    packed: PackedTerrain,
    robot: Robot,
    place: tuple[float, float, float],
    z_range: tuple[float, float],
    full_soles: bool = False,
) -> Stance | None:
    """Both feet around a place on ground in a range of heights; None where the soles do not fit.

    Args:
        packed: the terrain.
        robot: whose feet.
        place: mean of the feet x, y [m] and heading [rad] in W.
        z_range: least and greatest height of the footholds in W [m].
        full_soles: whether all of each sole has to rest on the ground; else that is tried first.
    """

    stance = _whole_feet(packed, robot, place, z_range)
    return stance if stance is not None or full_soles else _partial_feet(packed, robot, place, z_range)


def _whole_feet(
    packed: PackedTerrain, robot: Robot, place: tuple[float, float, float], z_range: tuple[float, float]
) -> Stance | None:
    """Feet at their usual places about a point where they fit there, else on the footholds nearest to these places."""
    exact = [
        set_down(packed, spec.name, x, y, place[2], spec.half_extent, z_range, overhang=spec.overhang)
        for spec, (x, y) in zip(robot.effectors, _usual_places(robot, place), strict=False)
    ]
    if exact[0] is not None and exact[1] is not None and _one_step(robot, exact[0], exact[1]):
        return Stance((exact[0], exact[1], None, None))
    left, right = (_near_usual_place(packed, robot, k, place, z_range) for k in (0, 1))
    pairs = [(a + b, one, other) for a, one in left for b, other in right if _one_step(robot, one, other)]
    if not pairs:
        return None
    _, one, other = min(pairs, key=lambda pair: pair[0])
    return Stance((one, other, None, None))


def _usual_places(robot: Robot, place: tuple[float, float, float]) -> list[tuple[float, float]]:
    """x, y of the left and of the right foot about a point [m]."""
    x, y, yaw = place
    half_width = 0.5 * robot.foot_separation[1]
    return [(x - side * np.sin(yaw) * half_width, y + side * np.cos(yaw) * half_width) for side in (1.0, -1.0)]


def _near_usual_place(
    packed: PackedTerrain, robot: Robot, k: int, place: tuple[float, float, float], z_range: tuple[float, float]
) -> list[tuple[float, Contact]]:
    """Footholds of foot k about its usual place, on its own side, nearest first, and their distances [m]."""
    x, y, yaw = place
    side = 1.0 if k == 0 else -1.0
    across = side * np.array([-np.sin(yaw), np.cos(yaw)])
    own = np.array([[*-across, 0.0, -float(across @ (x, y)) - 0.5 * robot.foot_separation[0]]])
    return footholds_near(packed, robot.effectors[k], (*_usual_places(robot, place)[k], yaw), z_range, NEAR, own)


def _one_step(robot: Robot, one: Contact, other: Contact) -> bool:
    """Whether two feet are within a step's height of each other."""
    return abs(float(one.p_WC[2] - other.p_WC[2])) <= robot.max_step_height


def _partial_feet(
    packed: PackedTerrain, robot: Robot, place: tuple[float, float, float], z_range: tuple[float, float]
) -> Stance | None:
    """The first feet around a point, of all nudges, that rest on part of themselves within a step's height of each other."""
    x, y, yaw = place
    half_width = 0.5 * robot.foot_separation[1]
    c, s = np.cos(yaw), np.sin(yaw)
    for forward in NUDGES:
        feet = []
        for k, side in enumerate((1.0, -1.0)):
            for sideways in NUDGES:
                across = side * max(half_width + side * sideways, 0.5 * robot.foot_separation[0])
                px, py = x + c * forward - s * across, y + s * forward + c * across
                foot = rest_down(packed, robot.effectors[k], (px, py, yaw), z_range)
                if foot is not None:
                    feet.append(foot)
                    break
        if len(feet) == 2 and _one_step(robot, *feet):
            return Stance((feet[0], feet[1], None, None))
    return None


def _refuse_inside(scene: Scene, packed: PackedTerrain, robot: Robot, stance: Stance) -> None:
    """Raises where the middle of the torso would be inside a box or a closed mesh."""
    x, y, z = stance.feet_mean()
    inside = solid_at(scene.terrain, packed, x, y, z + float(robot.torso_box_centre[2]))
    if inside:
        raise InputError(f"scene {scene.name}: start: the robot would stand inside {inside} at x {x:.2f}, y {y:.2f}")


def check_given_stance(scene: Scene, packed: PackedTerrain, robot: Robot, stance: Stance) -> None:
    """Checks that the contacts of a given start lie on their surfaces, and that the robot is inside nothing.

    Args:
        scene: with the terrain.
        packed: the same terrain.
        robot: whose soles and palms they are.
        stance: as given.

    Raises:
        InputError: a patch reaches beyond its surface and those that continue it, or is inside a solid.
    """
    for contact in stance.held:
        where = f"scene {scene.name}: start.stance.{contact.effector}"
        patch = robot.effectors[EFFECTORS.index(contact.effector)].half_extent
        off = patch_off_surface(scene.terrain, contact, patch)
        if off > STANCE_OFF and not rests_whole(packed, contact, patch):
            name = scene.terrain.surfaces[contact.surface].name
            raise InputError(f"{where}: expected a patch on {name!r}, this one reaches {off:.3f} m beyond it")
        inside = solid_at(scene.terrain, packed, *(contact.p_WC + 0.5 * FOOT_CLEARANCE * contact.R_WC[:, 2]))
        if inside:
            raise InputError(f"{where}: the contact is inside {inside}")
    _refuse_inside(scene, packed, robot, stance)


def start_floors(scene: Scene, packed: PackedTerrain, robot: Robot, full_soles: bool = False) -> tuple[Floor, ...]:
    """The floors at a scene's start, lowest first: between the feet, or under them where there is nothing in between.

    Args:
        scene: with a start.
        packed: its terrain.
        robot: who starts there.
        full_soles: whether all of a sole has to rest on them; else that is tried first.
    """
    start = scene.start
    if start is None or start.stance:
        return ()
    x, y, z = start.xyz
    c, s = np.cos(start.yaw), np.sin(start.yaw)
    half_width = 0.5 * robot.foot_separation[1]
    across = [0.0, half_width, -half_width]
    across += [side * half_width + shift for side in (1.0, -1.0) for shift in NUDGES[1:]]
    points = [(x + c * f - s * a, y + s * f + c * a) for f in NUDGES for a in across]
    # What lies between the nudges comes after the place itself and the feet's.
    place, anywhere = (x, y, start.yaw), (-np.inf, np.inf)
    near = [one for k in (0, 1) for one in _near_usual_place(packed, robot, k, place, anywhere)]
    points[3:3] = [(float(c.p_WC[0]), float(c.p_WC[1])) for _, c in sorted(near, key=lambda one: one[0])]
    return floors_around(packed, robot, points, start.yaw, z, full_soles)


def check_goal(
    scene: Scene, packed: PackedTerrain, robot: Robot, start_z: float = np.nan, full_soles: bool = False
) -> Goal:
    """The scene's goal at the height of its floor, once some sole is known to fit near it.

    The floor is the one nearest to the goal's z, within `Z_WINDOW`; without a z, the one nearest to the start's height.

    Args:
        scene: with a goal.
        packed: its terrain.
        robot: who goes there.
        start_z: height of the start in W [m], NaN where it is not known: then the lowest floor is taken.
        full_soles: whether all of a sole has to rest on it; else that is tried first.

    Raises:
        InputError: no goal, no ground for a foot within the goal region, or no floor near the goal's z.
    """
    goal = scene.goal
    if goal is None:
        raise _missing(scene, "goal")
    floors = goal_floors(scene, packed, robot, full_soles)
    wanted = by_preference(floors, goal.xyz[2], start_z)
    if wanted:
        return dataclasses.replace(goal, xyz=(*goal.xyz[:2], wanted[0].z))
    if floors:
        raise no_floor_near(f"scene {scene.name}: goal", floors, goal.xyz[2])
    x, y, z = goal.xyz
    standing = what_stands(scene.terrain, packed, _rings(x, y, goal.radius), z if np.isfinite(z) else start_z)
    if standing:
        raise InputError(f"scene {scene.name}: goal: no foothold within the radius: {standing} stands there")
    raise InputError(
        f"scene {scene.name}: goal: no ground takes a sole within {_goal_reach(goal, robot):.2f} m of "
        f"x {x:g}, y {y:g}; {extent_text(scene)}"
    )


def goal_floors(scene: Scene, packed: PackedTerrain, robot: Robot, full_soles: bool = False) -> tuple[Floor, ...]:
    """The floors in a scene's goal region, as near to its middle as there are any, lowest first.

    Args:
        scene: with a goal.
        packed: its terrain.
        robot: who goes there.
        full_soles: whether all of a sole has to rest on them; else that is tried first.
    """
    goal = scene.goal
    if goal is None:
        return ()
    found: tuple[Floor, ...] = ()
    for turn in (0.0, 0.5 * np.pi):
        points = _rings(goal.xyz[0], goal.xyz[1], _goal_reach(goal, robot))
        floors = floors_around(packed, robot, points, (goal.yaw or 0.0) + turn, goal.xyz[2], full_soles)
        if any(f.head_room for f in by_preference(floors, goal.xyz[2], np.nan)):
            return floors
        found = found or floors
    return found


def _goal_reach(goal: Goal, robot: Robot) -> float:
    """How far from the goal's middle a foot may stand when the robot is there [m]."""
    return goal.radius + robot.foot_separation[1]


def _rings(x: float, y: float, reach: float) -> Iterator[tuple[float, float]]:
    """A point and rings about it, nearest first."""
    for radius in np.linspace(0.0, reach, 5):
        for angle in np.linspace(0.0, 2 * np.pi, 1 if radius == 0 else 12, endpoint=False):
            yield x + radius * np.cos(angle), y + radius * np.sin(angle)


def floor_notes(
    scene: Scene, packed: PackedTerrain, robot: Robot, start: Stance, goal: Goal, full_soles: bool = False
) -> list[str]:
    """A line for each of start and goal that gives no height where there are several floors.

    Args:
        scene: as asked.
        packed: its terrain.
        robot: who crosses it.
        start: the stance that was taken.
        goal: with the height that was taken.
        full_soles: whether all of a sole has to rest on the floors.
    """
    notes = []
    if scene.start is not None and not np.isfinite(scene.start.xyz[2]):
        notes.append(choice_note("start", start_floors(scene, packed, robot, full_soles), float(start.feet_mean()[2])))
    if scene.goal is not None and not np.isfinite(scene.goal.xyz[2]):
        notes.append(choice_note("goal", goal_floors(scene, packed, robot, full_soles), goal.xyz[2]))
    return [note for note in notes if note]


def standing_com(robot: Robot, stance: Stance) -> np.ndarray:
    """(3,) where the CoM is taken to be in a stance at rest [m]: over the mean of the feet, at its usual height.

    Args:
        robot: whose CoM.
        stance: with both feet held.
    """
    return stance.feet_mean() + np.array([0.0, 0.0, robot.com_height[1]])


def extent_text(scene: Scene) -> str:
    """Where the terrain is, for messages."""
    low, high = scene.terrain.extent
    return f"the terrain spans x {low[0]:.2f} to {high[0]:.2f}, y {low[1]:.2f} to {high[1]:.2f} m"


def _missing(scene: Scene, key: str) -> InputError:
    return InputError(f"scene {scene.name} has no {key}: give one with --{key} X Y; {extent_text(scene)}")
