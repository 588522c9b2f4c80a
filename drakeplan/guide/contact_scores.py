"""How much room a contact point has, as a score from 0 to 1, for feet in the plan view and for palms along rays.

    S(c) = 0                                    delta < r_ins          Lin & Berenson 2017 eq. 9, Lin 2020 eq. 5.6
           (delta - r_ins) / (r_cir - r_ins)    between
           1                                    delta >= r_cir

delta is the distance of the contact point from the edge of where a point fits; r_ins and r_cir are the radii of the inscribed
and the circumscribed circle of the patch. The documents measure delta on a grid of points; here it is exact.
"""

# An element of an integer array is an integer to a kernel, and an array to the type checker.
# pyright: reportArgumentType=false

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit

from scenes.effector import LEFT_PALM
from scenes.footholds.circle_cover import polygon_distance
from scenes.footholds.free_space import FreeSpace, footprint_of, free_space
from scenes.footholds.projection import PALM_CLEARANCE, PatchShape, contact_axes, patch_shape
from scenes.robots.robot import Robot
from scenes.terrain.packed_terrain import PackedTerrain, height_at, near, over_polygon
from scenes.terrain.solids import in_solid

PITCH = 0.025  # [m] of the grid of foot scores
POINT = 1e-3  # [m] half edge of the patch that stands for a point
LAYERS = 3  # floors above each other at most; scores of higher ones are left out
SAME_FLOOR = 0.3  # [m] heights nearer than this are one floor


class FootScores(NamedTuple):
    """Scores of foot contact points over a grid in the plan view.

    Attributes:
        origin: (2,) x and y of point (0, 0) in W [m].
        z: (L, n, m) height of the contact point [m], NaN where a layer has none.
        score: (L, n, m) from 0 to 1.
    """

    origin: np.ndarray
    z: np.ndarray
    score: np.ndarray


class PalmSpaces(NamedTuple):
    """Where a point of a palm fits: for each surface an outline and convex polygons that are taken from it.

    Attributes:
        number: (S,) row of each surface, -1 where no palm fits.
        polygon: (n + 1,) the polygons of row k are polygon[k] to polygon[k + 1], its outline first.
        first: (P + 1,) the corners of polygon b are first[b] to first[b + 1].
        corner: (C, 2) x and y in the contact frame of heading 0 at the origin of W [m].
    """

    number: np.ndarray
    polygon: np.ndarray
    first: np.ndarray
    corner: np.ndarray


class PalmRays(NamedTuple):
    """Where palms are looked for.

    Attributes:
        shoulder: (3,) left shoulder over the mean of the feet, in T [m]; the right one mirrors y.
        rays: (K, 3) unit vectors from the left shoulder in T; the right ones mirror y.
        reach: least and greatest distance of a contact point from the shoulder [m].
        inner: radius of the palm's inscribed circle [m].
        outer: radius of its circumscribed circle [m].
    """

    shoulder: np.ndarray
    rays: np.ndarray
    reach: tuple[float, float]
    inner: float
    outer: float


def foot_scores(packed: PackedTerrain, robot: Robot, low: np.ndarray, high: np.ndarray) -> FootScores:
    """Scores over a rectangle of the plan view.

    Args:
        packed: the terrain.
        robot: whose soles.
        low: (2,) least x and y [m].
        high: (2,) greatest x and y [m].
    """
    sole = patch_shape(robot.effectors[0])
    half = np.array([sole.half_length, sole.half_width])
    origin = np.floor(low / PITCH) * PITCH
    shape = (LAYERS, *(np.ceil((high - origin) / PITCH).astype(int) + 1).tolist())
    scores = FootScores(origin, np.full(shape, np.nan), np.zeros(shape))
    point = PatchShape(POINT, POINT, 0.0, 0.0, 0.0, sole.clearance)
    _fill(packed, point, float(half.min()), float(np.hypot(*half)), scores)
    used = max(int(np.isfinite(scores.z).any(axis=(1, 2)).sum()), 1)
    return scores._replace(z=scores.z[:used].copy(), score=scores.score[:used].copy())


def within_reach(scores: FootScores, radius: float) -> FootScores:
    """The best score within a radius of each point, with its height: that of feet that move to the nearest foothold.

    Args:
        scores: of feet.
        radius: how far a foot moves [m].
    """
    n = round(radius / PITCH)
    best_z, best = scores.z.copy(), scores.score.copy()
    for u in range(-n, n + 1):
        for v in range(-n, n + 1):
            if 0 < u * u + v * v <= n * n:
                z, score = (_shifted(array, u, v, fill) for array, fill in ((scores.z, np.nan), (scores.score, 0.0)))
                better = (score > best) & (np.isnan(best_z) | (np.abs(z - scores.z) < SAME_FLOOR))
                best_z, best = np.where(better, z, best_z), np.where(better, score, best)
    return FootScores(scores.origin, best_z, best)


def _shifted(array: np.ndarray, u: int, v: int, fill: float) -> np.ndarray:
    """(L, n, m) the values of the points (u, v) farther along the grid."""
    out = np.full_like(array, fill)
    n, m = array.shape[1:]
    to = (slice(None), slice(max(-u, 0), n - max(u, 0)), slice(max(-v, 0), m - max(v, 0)))
    source = (slice(None), slice(max(u, 0), n - max(-u, 0)), slice(max(v, 0), m - max(-v, 0)))
    out[to] = array[source]
    return out


def palm_spaces_near(packed: PackedTerrain, robot: Robot, low: np.ndarray, high: np.ndarray) -> PalmSpaces:
    """Where a point of a palm fits on the surfaces of a rectangle of the plan view.

    Args:
        packed: the terrain.
        robot: whose palms.
        low: (2,) least x and y [m].
        high: (2,) greatest x and y [m].
    """
    surfaces = near(packed, float(low[0]), float(low[1]), float(high[0]), float(high[1]))
    surfaces = surfaces[packed.allowed[surfaces][:, list(robot.palms)].any(axis=1)]
    clearance = patch_shape(robot.effectors[LEFT_PALM]).clearance
    return palm_spaces(packed, surfaces, PatchShape(POINT, POINT, 0.0, 0.0, 0.0, clearance))


def palm_rays(robot: Robot, rays: np.ndarray, slack: float) -> PalmRays:
    """How a robot looks for palm contacts.

    Args:
        robot: whose shoulder, arms and palms.
        rays: (K, 3) from the left shoulder.
        slack: of the arm's reach.
    """
    half = np.array(robot.effectors[LEFT_PALM].half_extent)
    low, high = robot.arm_reach
    return PalmRays(
        np.array(robot.shoulder, float),
        rays,
        (float(low), float(slack * high)),
        float(half.min()),
        float(np.hypot(*half)),
    )


@njit(cache=True)
def score_of(room: float, inner: float, outer: float) -> float:
    """The score of a contact point (Lin & Berenson 2017 eq. 9).

    Args:
        room: distance from the edge of where a point fits [m].
        inner: radius of the patch's inscribed circle [m].
        outer: radius of its circumscribed circle [m].
    """
    if room < inner:
        return 0.0
    return 1.0 if room >= outer else (room - inner) / (outer - inner)


@njit(cache=True)
def room_around(x: np.ndarray, space: FreeSpace, alone: bool) -> float:
    """Distance of a point from the edge of where a point fits [m]; negative where it does not fit.

    Args:
        x: (2,) the point in the surface's plane [m].
        space: of a point on the surface.
        alone: whether the surface is no piece of a floor; a piece's own outline is no edge.
    """
    room = -polygon_distance(x, space.outline, space.outline.shape[0]) if alone or not space.complete else np.inf
    for b in range(space.start.shape[0] - 1):
        first, end = space.start[b], space.start[b + 1]
        room = min(room, polygon_distance(x, space.corner[first:end], end - first))
    return room


@njit(cache=True)
def _fill(packed: PackedTerrain, point: PatchShape, inner: float, outer: float, scores: FootScores) -> None:
    """Writes the scores of all surfaces that feet may use."""
    R, x, anywhere = np.empty((3, 3)), np.empty(2), np.empty((0, 3))
    n, m = scores.z.shape[1:]
    right, top = scores.origin[0] + (n - 1) * PITCH, scores.origin[1] + (m - 1) * PITCH
    footprint = footprint_of(point)
    for k in near(packed, scores.origin[0], scores.origin[1], right, top):
        if k >= packed.num_surfaces:
            break  # ascending: triangles follow
        if not (packed.allowed[k, 0] or packed.allowed[k, 1]) or packed.normal[k, 2] < 1e-3:
            continue
        contact_axes(packed.normal[k], 0.0, False, R)
        space = free_space(packed, k, R, footprint, anywhere)
        if space.outline.shape[0] < 3:
            continue
        alone = packed.floor[k] < 0
        i0 = max(int(np.ceil((packed.low[k, 0] - scores.origin[0]) / PITCH)), 0)
        i1 = min(int(np.floor((packed.high[k, 0] - scores.origin[0]) / PITCH)), n - 1)
        j0 = max(int(np.ceil((packed.low[k, 1] - scores.origin[1]) / PITCH)), 0)
        j1 = min(int(np.floor((packed.high[k, 1] - scores.origin[1]) / PITCH)), m - 1)
        for i in range(i0, i1 + 1):
            for j in range(j0, j1 + 1):
                px, py = scores.origin[0] + i * PITCH, scores.origin[1] + j * PITCH
                pz = height_at(packed, k, px, py)
                if not over_polygon(packed, k, px, py, pz, 0.0):
                    continue
                for a in range(2):
                    x[a] = R[0, a] * px + R[1, a] * py + R[2, a] * pz
                score = score_of(room_around(x, space, alone), inner, outer)
                if score > 0.0 and _in_solid(packed, k, px, py, pz, point.clearance):
                    score = 0.0
                _keep(scores, i, j, pz, score)


@njit(cache=True)
def _in_solid(packed: PackedTerrain, k: int, x: float, y: float, z: float, clearance: float) -> bool:
    """Whether a solid fills the room over a point of a surface: where it does, none of its faces need be near."""
    n, height = packed.normal[k], 0.5 * clearance
    return in_solid(packed, x + height * n[0], y + height * n[1], z + height * n[2])


@njit(cache=True)
def _keep(scores: FootScores, i: int, j: int, z: float, score: float) -> None:
    """Puts a score into the layer of its floor, where it is better than what is there."""
    for layer in range(scores.z.shape[0]):
        there = scores.z[layer, i, j]
        if np.isnan(there) or (abs(there - z) < SAME_FLOOR and score > scores.score[layer, i, j]):
            scores.z[layer, i, j], scores.score[layer, i, j] = z, score
            return
        if abs(there - z) < SAME_FLOOR:
            return


@njit(cache=True)
def scores_about(scores: FootScores, x: float, y: float, z: float, rise: float, out: np.ndarray) -> tuple[int, int]:
    """Writes the best scores within a range of heights over a square about a point, 0 off the grid.

    Args:
        scores: of feet.
        x: of the square's middle in W [m].
        y: of the square's middle in W [m].
        z: height of the ground under the torso in W [m].
        rise: how far from that a foot may be [m].
        out: (n, n) is written here.

    Returns:
        The grid's indices of out[0, 0].
    """
    half = (out.shape[0] - 1) // 2
    i0 = int(np.rint((x - scores.origin[0]) / PITCH)) - half
    j0 = int(np.rint((y - scores.origin[1]) / PITCH)) - half
    out[:] = 0.0
    for layer in range(scores.z.shape[0]):
        for i in range(max(i0, 0), min(i0 + out.shape[0], scores.z.shape[1])):
            for j in range(max(j0, 0), min(j0 + out.shape[1], scores.z.shape[2])):
                if abs(scores.z[layer, i, j] - z) <= rise:
                    out[i - i0, j - j0] = max(out[i - i0, j - j0], scores.score[layer, i, j])
    return i0, j0


@njit(cache=True)
def palm_spaces(packed: PackedTerrain, surfaces: np.ndarray, point: PatchShape) -> PalmSpaces:
    """Where a point of a palm fits on each of some surfaces.

    Args:
        packed: the terrain.
        surfaces: (n,) their numbers.
        point: the patch that stands for a point.
    """
    number, R = np.full(packed.num_surfaces, -1, np.int64), np.empty((3, 3))
    polygon, first = np.zeros(len(surfaces) + 1, np.int64), np.zeros(64, np.int64)
    corner, used, corners = np.empty((256, 2)), 0, 0
    footprint, anywhere = footprint_of(point), np.empty((0, 3))
    for n in range(len(surfaces)):
        k = surfaces[n]
        polygon[n + 1] = used
        contact_axes(packed.normal[k], 0.0, True, R)
        space = free_space(packed, k, R, footprint, anywhere)
        if space.outline.shape[0] < 3:
            continue
        number[k] = n
        blockers, more = space.start.shape[0] - 1, space.outline.shape[0] + space.corner.shape[0]
        while used + blockers + 2 > len(first):
            first = np.concatenate((first, np.zeros_like(first)))
        while corners + more > len(corner):
            corner = np.concatenate((corner, np.empty_like(corner)))
        first[used] = corners
        corner[corners : corners + space.outline.shape[0]] = space.outline
        corners += space.outline.shape[0]
        for b in range(blockers):
            first[used + 1 + b] = corners + space.start[b]
        corner[corners : corners + space.corner.shape[0]] = space.corner
        corners += space.corner.shape[0]
        used += 1 + blockers
        first[used] = corners
        polygon[n + 1] = used
    return PalmSpaces(number, polygon, first[: used + 1].copy(), corner[:corners].copy())


@njit(cache=True)
def palm_score(
    packed: PackedTerrain, spaces: PalmSpaces, surface: int, p: np.ndarray, inner: float, outer: float
) -> float:
    """The score of a palm's contact point.

    Args:
        packed: the terrain.
        spaces: where a point fits.
        surface: number of the surface that the point is on.
        p: (3,) contact point in W [m].
        inner: radius of the palm's inscribed circle [m].
        outer: radius of its circumscribed circle [m].
    """
    n = spaces.number[surface]
    if n < 0:
        return 0.0
    R, x = np.empty((3, 3)), np.empty(2)
    contact_axes(packed.normal[surface], 0.0, True, R)
    for a in range(2):
        x[a] = R[0, a] * p[0] + R[1, a] * p[1] + R[2, a] * p[2]
    room = np.inf
    for b in range(spaces.polygon[n], spaces.polygon[n + 1]):
        first, end = spaces.first[b], spaces.first[b + 1]
        is_outline = b == spaces.polygon[n]
        if is_outline and packed.floor[surface] >= 0:
            continue
        distance = polygon_distance(x, spaces.corner[first:end], end - first)
        room = min(room, -distance if is_outline else distance)
    score = score_of(room, inner, outer)
    inside = score > 0.0 and _in_solid(packed, surface, p[0], p[1], p[2], PALM_CLEARANCE)
    return 0.0 if inside else score
