"""Draws where pushes may happen and what they are: a tinted box for each region, an arrow for each impulse."""

# pydrake's stubs take the first parameter of ndarray for its type, and reject every array.
# pyright: reportArgumentType=false, reportCallIssue=false

from __future__ import annotations

import numpy as np
from pydrake.geometry import Box, Cylinder, Meshcat, MeshcatCone, Rgba
from pydrake.math import RigidTransform, RotationMatrix

from scenes.disturbance import Disturbance
from scenes.scene import Scene

PUSH_COLOUR = Rgba(0.55, 0.20, 0.75)
REGION_TINT = Rgba(0.55, 0.20, 0.75, 0.13)
ARROW_LENGTH = 0.015  # [m] for each kg m/s: a push of 0.6 m/s on a robot of 76 kg is 0.7 m long
SHAFT, HEAD, HEAD_LENGTH = 0.012, 0.04, 0.1  # [m] radii of shaft and head, length of the head
LEAST_SHAFT = 0.02  # [m] so that weak pushes show too
CHEST = 1.0  # [m] over the start, where the arrows of pushes without a region stand


def draw_pushes(meshcat: Meshcat, scene: Scene, root: str) -> np.ndarray:
    """Draws the scene's disturbances below `root`.

    Args:
        meshcat: to draw in.
        scene: with its disturbances.
        root: meshcat path below which they are drawn.

    Returns:
        (M, 3) points in W that a picture of them must hold [m].
    """
    shown = [np.zeros((0, 3))]
    for d, disturbance in enumerate(scene.disturbances):
        path = f"{root}/disturbances/{d}"
        tail = _tail(disturbance, scene)
        if disturbance.box_size is not None:
            X_WR = np.eye(4) if disturbance.X_WR is None else disturbance.X_WR
            pose = RigidTransform(RotationMatrix.ProjectToRotationMatrix(X_WR[:3, :3]), X_WR[:3, 3])
            meshcat.SetObject(f"{path}/region", Box(*disturbance.box_size), REGION_TINT)
            meshcat.SetTransform(f"{path}/region", pose)
            meshcat.SetProperty(f"{path}/region/<object>", "castShadow", False)  # a place, not a body
            corners = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)]) / 2
            corners = (corners * disturbance.box_size) @ X_WR[:3, :3].T + X_WR[:3, 3]
            meshcat.SetLineSegments(f"{path}/edges", *_edges(corners), 1.0, PUSH_COLOUR)
            shown.append(corners)
        for i, impulse in enumerate(disturbance.impulses):
            shown.append(draw_arrow(meshcat, f"{path}/impulse_{i}", tail, impulse))
    return np.concatenate(shown)


def _tail(disturbance: Disturbance, scene: Scene) -> np.ndarray:
    """(3,) where the arrows start: the region's centre, else over the start or the middle of the terrain."""
    if disturbance.box_size is not None:
        return np.zeros(3) if disturbance.X_WR is None else disturbance.X_WR[:3, 3]
    if scene.start is not None:
        return np.asarray(scene.start.xyz, float) + np.array([0.0, 0.0, CHEST])
    lowest, highest = scene.terrain.extent
    return np.array([*(lowest + highest)[:2] / 2, highest[2] + CHEST])


def _edges(corners: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(3, 12) starts and ends of the edges of a box: pairs of corners whose numbers differ in one bit."""
    pairs = [(a, a | bit) for a in range(8) for bit in (1, 2, 4) if not a & bit]
    first, last = np.array(pairs).T
    return corners[first].T, corners[last].T


def draw_arrow(
    meshcat: Meshcat, path: str, tail: np.ndarray, impulse: np.ndarray, colour: Rgba = PUSH_COLOUR
) -> np.ndarray:
    """Draws one arrow along an impulse, as long as it is great; (2, 3) its ends [m].

    Args:
        meshcat: to draw in.
        path: of the arrow.
        tail: (3,) where it begins, in the frame of what it is drawn in [m].
        impulse: (3,) [kg m/s].
        colour: of all of it.
    """
    size = float(np.linalg.norm(impulse))
    if size == 0.0:
        return np.zeros((0, 3))
    shaft = max(ARROW_LENGTH * size - HEAD_LENGTH, LEAST_SHAFT)
    meshcat.SetObject(f"{path}/shaft", Cylinder(SHAFT, shaft), colour)
    meshcat.SetTransform(f"{path}/shaft", RigidTransform([0.0, 0.0, shaft / 2]))
    meshcat.SetObject(f"{path}/head", MeshcatCone(HEAD_LENGTH, HEAD, HEAD), colour)
    # The cone's apex is its origin and it opens along z: turned about x, its apex at the arrow's point.
    tip = RigidTransform(RotationMatrix.MakeXRotation(np.pi), [0.0, 0.0, shaft + HEAD_LENGTH])
    meshcat.SetTransform(f"{path}/head", tip)
    direction = impulse / size
    meshcat.SetTransform(path, RigidTransform(RotationMatrix.MakeFromOneVector(direction, 2), tail))
    return np.stack([tail, tail + (shaft + HEAD_LENGTH) * direction])
