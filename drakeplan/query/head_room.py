"""What leaves the torso no room, however far the robot lowers itself: named, with its height over the floor."""

from __future__ import annotations

import numpy as np

from drakeplan.contact_planning.contact_plan import PlannerOptions
from drakeplan.contact_planning.torso_room import torso_closed
from drakeplan.context import QueryContext
from scenes.robots.robot import Robot
from scenes.terrain.solids import solid_at
from scenes.terrain.terrain import Terrain

Found = tuple[str, tuple[float, float, float], dict[str, float], str]
LOOKED_AT = 0.02  # [m] between the heights at which a column is looked at
FLOOR = 0.3  # [m] what is not higher over the feet than this is the floor


def no_head_room(context: QueryContext, options: PlannerOptions) -> Found | None:
    """What closes every way for the torso: its name, a place, numbers and words; None where nothing is proved to.

    Args:
        context: of the query.
        options: of its search.
    """
    terrain, robot = context.scene.terrain, context.robot
    stride, reach = options.longest_travel(robot), options.step_reach(robot)
    full = context.full_soles
    closed = torso_closed(terrain, context.packed, robot, stride, reach, context.start, context.goal, full)
    if closed is None:
        return None
    for place in closed:
        name, under = _in_the_way(context, place)
        if name:
            return name, (float(place[0]), float(place[1]), float(place[2])), *too_low(name, under, robot)
    return None


def too_low(name: str, under: float, robot: Robot) -> tuple[dict[str, float], str]:
    """Numbers and words of something that leaves less room over the floor than the robot needs at its lowest.

    Args:
        name: of that.
        under: what it leaves [m].
        robot: which needs more.
    """
    centre, size = robot.lowest_torso_box
    needed = float(centre[2] + 0.5 * size[2])
    upright = float(robot.torso_box_centre[2] + 0.5 * robot.torso_box_size[2])
    what = f"{name} leaves {under:.2f} m over the floor, the robot needs {needed:.2f} m lowered as far as it can"
    return {"clearance_m": under, "needed_m": needed, "upright_m": upright}, what


def _in_the_way(context: QueryContext, place: np.ndarray) -> tuple[str, float]:
    """What is over the floor at a place and how high [m]; "" where that is no ceiling: it reaches down to the legs."""
    terrain, robot = context.scene.terrain, context.robot
    centre, size = robot.lowest_torso_box
    bottom, top = float(centre[2] - 0.5 * size[2]), float(centre[2] + 0.5 * size[2])
    floor = float(place[2]) - 0.5 * (bottom + top)  # where the ground is level; elsewhere near it
    heights = floor + np.arange(bottom, top, LOOKED_AT)
    found = (solid_at(terrain, context.packed, place[0], place[1], z) for z in heights.tolist())
    name = next((name for name in found if name), "")
    if name:
        solid = next(o for o in terrain.obstacles if name.endswith(f"'{o.name}'"))
        under = float(solid.triangles()[..., 2].min()) - floor
        return (name, under) if under > FLOOR else ("", 0.0)
    return _surface_over(terrain, place, floor)


def _surface_over(terrain: Terrain, place: np.ndarray, floor: float) -> tuple[str, float]:
    """The lowest surface over a place, more than `FLOOR` over the ground, and how high over it [m]."""
    found = ("", np.inf)
    for surface in terrain.surfaces:
        normal = surface.normal
        if abs(normal[2]) < 1e-3:
            continue
        z = float(normal @ surface.vertices[0] - normal[:2] @ place[:2]) / float(normal[2])
        edges = np.roll(surface.vertices, -1, axis=0) - surface.vertices
        inside = np.cross(edges, np.array([place[0], place[1], z]) - surface.vertices) @ normal >= 0.0
        if inside.all() and floor + FLOOR < z < floor + found[1]:
            found = (f"surface {surface.name!r}", z - floor)
    return found
