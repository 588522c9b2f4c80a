"""How deep a posture's limbs reach into the terrain, in microseconds: capsules of the body against polygons.

A cheap stand-in for Drake's collision query where thousands of postures are judged. Feet and hands are left out, since
they are meant to touch. Polygons count from both sides, so a limb wholly behind a face is not seen; one cannot get there
without crossing it.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from optimization.multibody.body_capsules import BodyCapsules
from optimization.multibody.kinematic_tree import KinematicTree, forward
from scenes.terrain.packed_terrain import PackedTerrain, near, over_polygon

BODY_REACH = 1.0  # [m] no part of a body is further from its base than this in plan view


def limbs(tree: KinematicTree, capsules: BodyCapsules) -> np.ndarray:
    """(S,) bool, True for the shapes that are no end effector's.

    Args:
        tree: of the robot.
        capsules: its shape, S shapes.
    """
    return ~np.isin(capsules.link, tree.frame_link)


@njit(cache=True)
def penetration(
    tree: KinematicTree, capsules: BodyCapsules, counted: np.ndarray, packed: PackedTerrain, q: np.ndarray
) -> float:
    """Greatest depth [m] of a counted shape's capsule in a polygon, at most its radius; negative when all are clear.

    Args:
        tree: of the robot.
        capsules: its shape.
        counted: (S,) bool, which shapes of `capsules` count.
        packed: the terrain.
        q: (nq,) posture.
    """
    num_links = tree.parent.shape[0]
    R, p = np.empty((num_links, 3, 3)), np.empty((num_links, 3))
    forward(tree, q, R, p)
    around = near(packed, q[4] - BODY_REACH, q[5] - BODY_REACH, q[4] + BODY_REACH, q[5] + BODY_REACH)
    a, b, c = np.empty(3), np.empty(3), np.empty(3)
    deepest = -np.inf
    for s in range(capsules.link.shape[0]):
        if not counted[s]:
            continue
        link = capsules.link[s]
        place(R[link], p[link], capsules.p_LC[s], c)
        reach = capsules.reach[s]
        for i in range(around.shape[0]):
            k = around[i]
            if not packed.body[k] or not may_touch(packed, k, c, reach):
                continue
            for m in range(capsules.first[s], capsules.first[s + 1]):
                place(R[link], p[link], capsules.p_LA[m], a)
                place(R[link], p[link], capsules.p_LB[m], b)
                deepest = max(deepest, capsules.radius[m] - segment_distance(packed, k, a, b))
    return deepest


@njit(cache=True)
def segment_distance(packed: PackedTerrain, k: int, a: np.ndarray, b: np.ndarray) -> float:
    """Distance [m] between the segment from a to b and polygon k; 0 where it passes through.

    Args:
        packed: the terrain.
        k: index of the polygon.
        a, b: (3,) ends of the segment in W [m].
    """
    n = packed.normal[k]
    height_a = n[0] * a[0] + n[1] * a[1] + n[2] * a[2] - packed.offset[k]
    height_b = n[0] * b[0] + n[1] * b[1] + n[2] * b[2] - packed.offset[k]
    if height_a * height_b < 0.0:
        t = height_a / (height_a - height_b)
        if over_polygon(packed, k, a[0] + t * (b[0] - a[0]), a[1] + t * (b[1] - a[1]), a[2] + t * (b[2] - a[2]), 0.0):
            return 0.0
    best = np.inf
    if over_polygon(packed, k, a[0], a[1], a[2], 0.0):
        best = abs(height_a)
    if over_polygon(packed, k, b[0], b[1], b[2], 0.0):
        best = min(best, abs(height_b))
    count = packed.count[k]
    for e in range(count):
        best = min(best, _between(a, b, packed.vertices[k, e], packed.vertices[k, (e + 1) % count]))
    return best


@njit(cache=True)
def place(R: np.ndarray, p: np.ndarray, local: np.ndarray, out: np.ndarray) -> None:
    """Writes the point `local` of a link at (R, p) in W to `out`, (3,) each [m].

    Args:
        R, p: (3, 3) and (3,) pose of the link in W [m].
        local: (3,) point in the link [m].
        out: (3,) written, in W [m].
    """
    for r in range(3):
        out[r] = p[r] + R[r, 0] * local[0] + R[r, 1] * local[1] + R[r, 2] * local[2]


@njit(cache=True)
def in_link(R: np.ndarray, p: np.ndarray, point: np.ndarray, out: np.ndarray) -> None:
    """Writes a point of W in the frame of a link at (R, p) to `out`, (3,) each [m]: the inverse of `place`.

    Args:
        R, p: (3, 3) and (3,) pose of the link in W [m].
        point: (3,) in W [m].
        out: (3,) written, in the link [m].
    """
    for r in range(3):
        out[r] = 0.0
        for k in range(3):
            out[r] += R[k, r] * (point[k] - p[k])


@njit(cache=True)
def may_touch(packed: PackedTerrain, k: int, c: np.ndarray, reach: float) -> bool:
    """Whether polygon k may have a point within `reach` of c (3,), by its box and its plane [m].

    Args:
        packed: the terrain.
        k: index of the polygon.
        c: (3,) point in W [m].
        reach: [m].
    """
    for r in range(3):
        if packed.low[k, r] > c[r] + reach or packed.high[k, r] < c[r] - reach:
            return False
    n = packed.normal[k]
    return abs(n[0] * c[0] + n[1] * c[1] + n[2] * c[2] - packed.offset[k]) < reach


@njit(cache=True)
def _between(a: np.ndarray, b: np.ndarray, c: np.ndarray, d: np.ndarray) -> float:
    """Distance between segments ab and cd (Ericson 2004, Real-Time Collision Detection, sec. 5.1.9)."""
    aa = ad = dd = ar = dr = 0.0
    for i in range(3):
        u, v, r = b[i] - a[i], d[i] - c[i], a[i] - c[i]
        aa += u * u
        ad += u * v
        dd += v * v
        ar += u * r
        dr += v * r
    denominator = aa * dd - ad * ad
    s = min(max((ad * dr - ar * dd) / denominator, 0.0), 1.0) if denominator > 1e-12 else 0.0
    t = (ad * s + dr) / dd if dd > 1e-12 else 0.0
    if t < 0.0 or t > 1.0:
        t = min(max(t, 0.0), 1.0)
        s = min(max((ad * t - ar) / aa, 0.0), 1.0) if aa > 1e-12 else 0.0
    total = 0.0
    for i in range(3):
        gap = a[i] + s * (b[i] - a[i]) - c[i] - t * (d[i] - c[i])
        total += gap * gap
    return np.sqrt(total)
