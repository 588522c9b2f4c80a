"""Sets a single sole or palm down on the terrain, for contact sequences that a user makes."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from numpy.typing import ArrayLike

from drakeplan.query.inputs import AnyRobot, AnyScene, as_robot, as_scene
from scenes.contact import Contact, contact_pose
from scenes.effector import EFFECTORS, is_foot
from scenes.footholds.floors import floors_at, heights_text
from scenes.footholds.partial_support import rest_down
from scenes.footholds.projection import patch_fits, patch_shape, set_down
from scenes.input_error import InputError, unknown_name
from scenes.robots.robot import Robot
from scenes.scene import Scene
from scenes.terrain.packed_terrain import PackedTerrain, near, pack_terrain
from scenes.terrain.terrain import Terrain

WINDOW = (
    0.1  # [m] from the given point in which the terrain is looked for: above and below for soles, all around for palms
)


def make_contact(
    scene: AnyScene, effector: str, xyz: ArrayLike, yaw: float = 0.0, *, robot: AnyRobot | None = None
) -> Contact:
    """Sets a sole or palm down on the terrain, nearest to a point.

    A sole stands over the point's x and y, on ground within 0.1 m of its z, whole where it can, else on part of itself. A
    palm lies on the nearest wall within 0.1 m, whole.

    Args:
        scene: with the terrain; see `plan_scene`.
        effector: "left_foot", "right_foot", "left_palm" or "right_palm".
        xyz: (3,) point in W [m]; a sole's z may be left out where there is one floor alone.
        yaw: heading of the toes in W [rad]; a palm's fingers point up on walls, and along the heading on level ground.
        robot: whose sole or palm it is; None: the scene's robot, else escher.

    Raises:
        InputError: no such end effector, or nothing there takes the patch.
    """
    ground = as_scene(scene)
    who = as_robot(robot, ground)
    if effector not in EFFECTORS:
        raise unknown_name("end effector", effector, EFFECTORS)
    try:
        point = np.array(xyz, float)
    except (TypeError, ValueError):
        point = np.full(0, np.nan)
    if point.shape not in ((2,), (3,)) or not np.isfinite([*point.ravel(), yaw]).all():
        raise InputError(f"make_contact: {effector}: expected finite x, y, z and yaw, got {xyz} and {yaw}")
    if is_foot(effector):
        return _sole(ground, who, effector, point, float(yaw))
    if len(point) < 3:
        raise InputError(f"make_contact: {effector}: expected x, y, z, got {xyz}")
    return _palm(ground, who, effector, point, float(yaw))


def _sole(scene: Scene, robot: Robot, effector: str, point: np.ndarray, yaw: float) -> Contact:
    packed, spec = _packed(scene.terrain), robot.effectors[EFFECTORS.index(effector)]
    x, y = float(point[0]), float(point[1])
    window = (-np.inf, np.inf) if len(point) < 3 else (float(point[2]) - WINDOW, float(point[2]) + WINDOW)
    found = set_down(packed, effector, x, y, yaw, spec.half_extent, window, overhang=spec.overhang)
    found = found or rest_down(packed, spec, (x, y, yaw), window)
    if found is not None:
        return found
    floors = floors_at(packed, robot, x, y, yaw) or floors_at(packed, robot, x, y, yaw, full_soles=False)
    there = f"a sole fits at z {heights_text(f.z for f in floors)} m there" if floors else "no sole fits at any height"
    near_z = "" if len(point) < 3 else f" within {WINDOW:g} m of z {point[2]:g}"
    raise InputError(
        f"make_contact: scene {scene.name}: no ground takes {effector} at x {x:g}, y {y:g}{near_z}; {there}"
    )


def _palm(scene: Scene, robot: Robot, effector: str, point: np.ndarray, yaw: float) -> Contact:
    packed, number = _packed(scene.terrain), EFFECTORS.index(effector)
    if number not in robot.palms:
        raise InputError(f"make_contact: robot {robot.name} has no {effector}")
    patch = patch_shape(robot.effectors[number])
    x, y, reach = float(point[0]), float(point[1]), WINDOW + patch.half_length + patch.half_width + patch.clearance
    around = near(packed, x - reach, y - reach, x + reach, y + reach)
    work = np.empty((2, packed.vertices.shape[1] + 8, 3))
    best: tuple[float, Contact] | None = None
    for k in around[around < packed.num_surfaces].tolist():
        surface = scene.terrain.surfaces[k]
        off = float((point - surface.vertices[0]) @ surface.normal)
        if abs(off) > WINDOW or not surface.allows(effector) or (best is not None and abs(off) >= best[0]):
            continue
        X_WC = contact_pose(effector, point - off * surface.normal, surface.normal, yaw)
        p, R = np.array(X_WC[:3, 3]), np.ascontiguousarray(X_WC[:3, :3])
        if patch_fits(packed, k, p, R, patch, around, work):
            best = abs(off), Contact(effector, k, X_WC, surface.friction, yaw)
    if best is None:
        raise InputError(
            f"make_contact: scene {scene.name}: no surface takes {effector} within {WINDOW:g} m of x {x:g}, y {y:g}, "
            f"z {point[2]:g}"
        )
    return best[1]


@lru_cache(maxsize=4)
def _packed(terrain: Terrain) -> PackedTerrain:
    return pack_terrain(terrain)
