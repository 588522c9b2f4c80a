"""Setting the robot down: from "here, facing there" to the first stance."""

from __future__ import annotations

import dataclasses

import numpy as np

from scenes.effector import EFFECTORS
from scenes.footholds.projection import set_down
from scenes.input_error import InputError
from scenes.robots.robot import Robot
from scenes.scene import Goal, Scene
from scenes.stance import Stance
from scenes.terrain.packed_terrain import PackedTerrain

NUDGES = (
    0.0,
    0.03,
    -0.03,
    0.06,
    -0.06,
    0.1,
    -0.1,
)  # [m] tried forward and sideways where the exact place takes no sole
Z_WINDOW = 0.5  # [m] around a start's z in which its ground is looked for


def start_stance(scene: Scene, packed: PackedTerrain, robot: Robot) -> Stance:
    """The stance a scene's start describes: as given, or the feet set down around its point.

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
        return stance
    x, y, z = start.xyz
    z_range = (z - Z_WINDOW, z + Z_WINDOW) if np.isfinite(z) else (-np.inf, np.inf)
    half_width = 0.5 * robot.foot_separation[1]
    c, s = np.cos(start.yaw), np.sin(start.yaw)
    for forward in NUDGES:
        feet = []
        for k, side in enumerate((1.0, -1.0)):
            for sideways in NUDGES:
                across = side * max(half_width + side * sideways, 0.5 * robot.foot_separation[0])
                px, py = x + c * forward - s * across, y + s * forward + c * across
                foot = set_down(
                    packed,
                    EFFECTORS[k],
                    px,
                    py,
                    start.yaw,
                    robot.effectors[k].half_extent,
                    z_range,
                    overhang=robot.effectors[k].overhang,
                )
                if foot is not None:
                    feet.append(foot)
                    break
        if len(feet) == 2 and abs(feet[0].p_WC[2] - feet[1].p_WC[2]) <= robot.max_step_height:
            return Stance((feet[0], feet[1], None, None))
    raise InputError(
        f"scene {scene.name}: start: no ground takes both soles near x {x:g}, y {y:g}; {extent_text(scene)}"
    )


def check_goal(scene: Scene, packed: PackedTerrain, robot: Robot) -> Goal:
    """The scene's goal, once some sole is known to fit near it; a height that is not a number becomes the ground's.

    Raises:
        InputError: no goal, or no ground for a foot within the goal region.
    """
    goal = scene.goal
    if goal is None:
        raise _missing(scene, "goal")
    reach = goal.radius + robot.foot_separation[1]
    for radius in np.linspace(0.0, reach, 5):
        for angle in np.linspace(0.0, 2 * np.pi, 1 if radius == 0 else 12, endpoint=False):
            x, y = goal.xyz[0] + radius * np.cos(angle), goal.xyz[1] + radius * np.sin(angle)
            for yaw in (goal.yaw or 0.0, (goal.yaw or 0.0) + np.pi / 2):
                foot = set_down(packed, EFFECTORS[0], x, y, yaw, robot.effectors[0].half_extent)
                if foot is not None:
                    z = goal.xyz[2] if np.isfinite(goal.xyz[2]) else float(foot.p_WC[2])
                    return dataclasses.replace(goal, xyz=(goal.xyz[0], goal.xyz[1], z))
    raise InputError(
        f"scene {scene.name}: goal: no ground takes a sole within {reach:.2f} m of x {goal.xyz[0]:g}, "
        f"y {goal.xyz[1]:g}; {extent_text(scene)}"
    )


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
