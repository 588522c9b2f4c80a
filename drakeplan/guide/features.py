"""What a regressor sees of the ground about a torso pose: exact and approximate contact checks (Lin & Berenson 2017 alg. 2, 4).

    ACC   S_f(v) = sum over steps with translation v of S(left) S(right) S(new)      Lin 2020 alg. 5; S of eq. 5.6
          S_p[i] = sum over palm rays that end in quadrant i of S(contact point)     i = 1, 2 left, 3, 4 right, front first
    ECC   N_f(phi) = pairs of feet that both fit, from which some step in direction phi fits
          N_p[i] = palm rays in quadrant i that end where a whole palm fits

Beside them stands S_pairs, the sum over pairs of feet of S(left) S(right): it is ours.
"""

# An element of an integer array is an integer to a kernel, and an array to the type checker.
# pyright: reportArgumentType=false

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit

from drakeplan.guide.contact_scores import PITCH, FootScores, PalmRays, PalmSpaces, palm_score, scores_about
from drakeplan.guide.torso_steps import DIRECTIONS, TorsoSteps
from scenes.footholds.projection import PatchShape, cast_ray, contact_axes, near_patches, patch_fits, project_foot
from scenes.terrain.packed_terrain import PackedTerrain, near

QUADRANTS = 4  # left front, left back, right front, right back
WINDOW = 81  # points of the grid of scores along a side of the square about the torso
FARTHEST = (WINDOW // 2 - 1) * PITCH  # [m] of a foot from the torso that the square holds


class StepTables(NamedTuple):
    """`TorsoSteps` as arrays for compiled code.

    Attributes:
        pairs, mover, place, translation, direction: as there.
        first: (G + 1,) the further steps from pair g are first[g] to first[g + 1].
    """

    pairs: np.ndarray
    first: np.ndarray
    mover: np.ndarray
    place: np.ndarray
    translation: np.ndarray
    direction: np.ndarray


def step_tables(steps: TorsoSteps) -> StepTables:
    """The arrays of all steps."""
    farthest = max(np.abs(steps.place[:, :2]).max(), np.abs(steps.pairs[:, :, :2]).max())
    assert np.sqrt(2.0) * farthest < FARTHEST, "the window of scores is too small for these steps"
    first = np.searchsorted(steps.pair, np.arange(len(steps.pairs) + 1))
    return StepTables(steps.pairs, first, steps.mover, steps.place, steps.translation, steps.direction)


@njit(cache=True)
def foot_features(
    steps: StepTables, scores: FootScores, x: float, y: float, z: float, yaw: float, rise: float, out: np.ndarray
) -> float:
    """Writes S_f for every translation; S_pairs is returned.

    Args:
        steps: of the feet.
        scores: of foot contact points.
        x: of the torso in W [m].
        y: of the torso in W [m].
        z: height of the ground under it in W [m].
        yaw: its heading in W [rad].
        rise: how far above or below that ground a foot may be [m].
        out: (V,) is written here.
    """
    c, s = np.cos(yaw) / PITCH, np.sin(yaw) / PITCH
    score = np.empty((WINDOW, WINDOW))
    i0, j0 = scores_about(scores, x, y, z, rise, score)
    u0, v0 = (x - scores.origin[0]) / PITCH - i0 + 0.5, (y - scores.origin[1]) / PITCH - j0 + 0.5
    out[:] = 0.0
    total = 0.0
    for g in range(steps.pairs.shape[0]):
        both = 1.0
        for foot in range(2):
            u, v = steps.pairs[g, foot, 0], steps.pairs[g, foot, 1]
            both *= score[int(u0 + c * u - s * v), int(v0 + s * u + c * v)]
        total += both
        if both > 0.0:
            for a in range(steps.first[g], steps.first[g + 1]):
                u, v = steps.place[a, 0], steps.place[a, 1]
                out[steps.translation[a]] += both * score[int(u0 + c * u - s * v), int(v0 + s * u + c * v)]
    return total


@njit(cache=True)
def palm_features(
    packed: PackedTerrain,
    rays: PalmRays,
    spaces: PalmSpaces,
    x: float,
    y: float,
    z: float,
    yaw: float,
    out: np.ndarray,
) -> None:
    """Writes S_p for the four quadrants.

    Args:
        packed: the terrain.
        rays: of the palms.
        spaces: where a point of a palm fits.
        x: of the torso in W [m].
        y: of the torso in W [m].
        z: height of the ground under it in W [m].
        yaw: its heading in W [rad].
        out: (4,) is written here.
    """
    p = np.empty(3)
    out[:] = 0.0
    around = _in_reach(packed, rays, x, y)
    for side in range(2):
        for m in range(rays.rays.shape[0]):
            k, quadrant = _cast(packed, rays, side, m, x, y, z, yaw, around, p)
            if k >= 0:
                out[quadrant] += palm_score(packed, spaces, k, p, rays.inner, rays.outer)


@njit(cache=True)
def _in_reach(packed: PackedTerrain, rays: PalmRays, x: float, y: float) -> np.ndarray:
    """(m,) polygons that the palms' rays may meet about a torso, ascending."""
    far = rays.reach[1] + abs(rays.shoulder[0]) + abs(rays.shoulder[1])
    return near(packed, x - far, y - far, x + far, y + far)


@njit(cache=True)
def _cast(
    packed: PackedTerrain,
    rays: PalmRays,
    side: int,
    m: int,
    x: float,
    y: float,
    z: float,
    yaw: float,
    around: np.ndarray,
    p: np.ndarray,
) -> tuple[int, int]:
    """The surface that ray m of a side meets, -1 for none, and the quadrant of the torso that point p, written here, is in."""
    c, s = np.cos(yaw), np.sin(yaw)
    sign = 1.0 if side == 0 else -1.0
    u, v = rays.shoulder[0], sign * rays.shoulder[1]
    du, dv = rays.rays[m, 0], sign * rays.rays[m, 1]
    origin = np.array([x + c * u - s * v, y + s * u + c * v, z + rays.shoulder[2]])
    ray = np.array([c * du - s * dv, s * du + c * dv, rays.rays[m, 2]])
    k, t = cast_ray(packed, 2 + side, origin, ray, rays.reach, around)
    for b in range(3):
        p[b] = origin[b] + t * ray[b]
    return k, 2 * side + (0 if u + t * du >= 0.0 else 1)


@njit(cache=True)
def exact_features(
    packed: PackedTerrain,
    steps: StepTables,
    sole: PatchShape,
    x: float,
    y: float,
    z: float,
    yaw: float,
    rise: float,
    out: np.ndarray,
) -> int:
    """Writes N_f for every direction of motion; the number of pairs of feet that fit is returned.

    Args:
        packed: the terrain.
        steps: of the feet.
        sole: the room that a foot takes.
        x: of the torso in W [m].
        y: of the torso in W [m].
        z: height of the ground under it in W [m].
        yaw: its heading in W [rad].
        rise: how far above or below that ground a foot may be [m].
        out: (12,) is written here.
    """
    c, s = np.cos(yaw), np.sin(yaw)
    out[:] = 0.0
    work = np.empty((2, packed.vertices.shape[1] + 8, 3))
    p, R, at, z_range = np.empty(3), np.empty((3, 3)), np.empty(3), (z - rise, z + rise)
    here = np.array([[x - FARTHEST, y - FARTHEST, 0.0], [x + FARTHEST, y + FARTHEST, 0.0]])
    around = near_patches(packed, here, sole, 0.0)
    found = np.zeros(DIRECTIONS, np.bool_)
    fits = 0
    for g in range(steps.pairs.shape[0]):
        both = True
        for foot in range(2):
            u, v = steps.pairs[g, foot, 0], steps.pairs[g, foot, 1]
            at[0], at[1], at[2] = x + c * u - s * v, y + s * u + c * v, yaw + steps.pairs[g, foot, 2]
            both = both and project_foot(packed, foot, at, z_range, sole, around, p, R, work) >= 0
        fits += both
        found[:] = False
        for a in range(steps.first[g], steps.first[g + 1]):
            way = steps.direction[a]
            if both and way >= 0 and not found[way]:
                u, v = steps.place[a, 0], steps.place[a, 1]
                at[0], at[1], at[2] = x + c * u - s * v, y + s * u + c * v, yaw + steps.place[a, 2]
                found[way] = project_foot(packed, steps.mover[a], at, z_range, sole, around, p, R, work) >= 0
        for way in range(DIRECTIONS):
            out[way] += found[way]
    return fits


@njit(cache=True)
def exact_palm_features(
    packed: PackedTerrain,
    rays: PalmRays,
    palm: PatchShape,
    x: float,
    y: float,
    z: float,
    yaw: float,
    out: np.ndarray,
) -> None:
    """Writes N_p for the four quadrants.

    Args:
        packed: the terrain.
        rays: of the palms.
        palm: the room that a palm takes.
        x: of the torso in W [m].
        y: of the torso in W [m].
        z: height of the ground under it in W [m].
        yaw: its heading in W [rad].
        out: (4,) is written here.
    """
    work = np.empty((2, packed.vertices.shape[1] + 8, 3))
    p, R = np.empty(3), np.empty((3, 3))
    out[:] = 0.0
    around = _in_reach(packed, rays, x, y)
    for side in range(2):
        for m in range(rays.rays.shape[0]):
            k, quadrant = _cast(packed, rays, side, m, x, y, z, yaw, around, p)
            if k >= 0:
                contact_axes(packed.normal[k], yaw, True, R)
                out[quadrant] += patch_fits(packed, k, p, R, palm, around, work)
