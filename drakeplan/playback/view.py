"""Where to look from: a three-quarter view along the way that the terrain hides least."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

FIELD_OF_VIEW = 35.0  # [deg] vertical; a long lens shows slopes more truly
ASPECT = 1.6  # width by height of the window that the distance is chosen for
# degrees between the way ahead and the camera, and above the ground, the most pleasant ones first
SIDES = (-65.0, 65.0, -80.0, 80.0, -45.0, 45.0, -110.0, 110.0, -145.0, 145.0)
HEIGHTS = (22.0, 36.0, 55.0)
MAX_TRIANGLES = 20_000  # more are thinned out: occlusion is a matter of taste, not of safety


@dataclass(frozen=True, eq=False)
class View:
    """A camera.

    Attributes:
        eye: (3,) where it is in W [m].
        target: (3,) what it looks at in W [m].
    """

    eye: np.ndarray
    target: np.ndarray


def choose_view(path: np.ndarray, points: np.ndarray, triangles: np.ndarray, aspect: float = ASPECT) -> View:
    """The view on a way through the terrain.

    Args:
        path: (N, 3) the way, in the order of travel [m].
        points: (M, 3) what the picture must hold [m].
        triangles: (K, 3, 3) what may hide them [m]; only faces turned towards the camera do.
        aspect: width by height of the picture.
    """
    lowest, highest = points.min(axis=0), points.max(axis=0)
    target = (lowest + highest) / 2
    ahead = np.arctan2(*(path[-1] - path[0])[[1, 0]]) if np.ptp(path, axis=0)[:2].max() > 0.2 else 0.0
    step = -(-len(triangles) // MAX_TRIANGLES) or 1
    seen = path[np.linspace(0, len(path) - 1, min(len(path), 12)).astype(int)]
    best, best_score = View(target + np.array([3.0, -3.0, 2.0]), target), np.inf
    for h, height in enumerate(np.deg2rad(HEIGHTS)):
        for s, side in enumerate(np.deg2rad(SIDES)):
            azimuth = ahead + side
            towards = np.array([np.cos(height) * np.cos(azimuth), np.cos(height) * np.sin(azimuth), np.sin(height)])
            eye = target + _distance(points - target, towards, aspect) * towards
            score = 2.0 * _hidden(eye, seen, triangles[::step]) + 0.04 * s + 0.15 * h
            if score < best_score:
                best, best_score = View(eye, target), score
    return best


def _distance(points: np.ndarray, towards: np.ndarray, aspect: float) -> float:
    """How far along `towards` the camera must be to see all points, given relative to the target, with a margin."""
    right = np.cross([0.0, 0.0, 1.0], towards)
    right /= np.linalg.norm(right)
    up = np.cross(towards, right)
    half = np.tan(np.deg2rad(FIELD_OF_VIEW / 2))
    margin = 0.35  # [m] around the points: arms and the ground beside the feet
    depth = points @ towards
    wide = depth + (np.abs(points @ right) + margin) / (half * aspect)
    high = depth + (np.abs(points @ up) + margin) / half
    return float(max(wide.max(), high.max()))


def _hidden(eye: np.ndarray, points: np.ndarray, triangles: np.ndarray) -> float:
    """Share of the points that a triangle facing the camera hides (Moeller & Trumbore 1997)."""
    if not len(triangles):
        return 0.0
    a, ab, ac = triangles[:, 0], triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0]
    hidden = 0
    for point in points:
        ray = point - eye
        across = np.cross(ray, ac)
        det = np.einsum("ij,ij->i", ab, across)
        facing = det > 1e-12
        inverse = 1.0 / np.where(facing, det, 1.0)
        offset = eye - a
        u = np.einsum("ij,ij->i", offset, across) * inverse
        around = np.cross(offset, ab)
        v = around @ ray * inverse
        t = np.einsum("ij,ij->i", ac, around) * inverse
        hidden += bool((facing & (u >= 0) & (v >= 0) & (u + v <= 1) & (t > 0.02) & (t < 0.97)).any())
    return hidden / len(points)
