"""The curve of an end effector from one contact to the next, clear of the terrain."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numba import njit

from scenes.contact import Contact
from scenes.effector import is_foot
from scenes.terrain.packed_terrain import PackedTerrain, near, polygon_meets_box

RISE = 0.4  # share of the swing that it takes to leave the old contact, or to land on the new one
WAIT = 0.06  # share of the swing after which a foot also rises straight up and turns
TURN = 0.42  # share of the swing in which a foot turns level, and from level to its new tilt
OUT, IN = 0.16, 0.3  # shares of the swing in which a foot draws back, and comes forth again
ALONG = 0.03  # [m] a foot leaves and lands along the normal, a palm all the way
TRAVELS = (0.1, 0.22)  # share at either end without travel; the usual one first
MARGINS = (1.0, 0.5, 0.2)  # shares of the clearance, tried in this order
HIT = 0.04  # [m] of height that a sample that meets something costs where no curve is clear
LATE = 0.05  # [m] of height that the usual share of travel is worth: a late one travels faster
LIFTS = (0.05, 0.08, 0.11, 0.14, 0.18, 0.22, 0.27, 0.32, 0.38)  # [m] tried from the lowest
BACKS = (0.0, 0.06, 0.12)  # [m] away from what overhangs a contact, tried where no height does
SIDES = (0.0, 0.05, 0.10, 0.15)  # [m] away from the other foot, tried in this order
MIDDLE = (0.5, 0.35, 0.65)  # of the swing, where what is between two contacts is met first
SAMPLES = 33  # poses tested along the curve; two of them are never further apart than a third of a sole
GRAZE = 0.003  # [m] what a contact's neighbours may rise above its patch, as in scenes.footholds.projection
HOVER = 0.10  # [m] where a palm waits before its wall and after it
SHIN_HALF, SHIN_TOP = 0.055, 0.40  # [m] half width and height of the box that stands for the standing leg


@dataclass(frozen=True, eq=False)
class SwingCurve:
    """An end effector's pose over a swing, u from 0 to 1.

        p(u) = p_A + a(u) + (p_B + b(1) - p_A - a(1)) s(v) + b(1 - u) - b(1) + side bump(v)
               + way (beyond h(1 - u) - back h(u))
        a(u) = min(lift, along) n_A s(u / RISE) + max(lift - along, 0) e_z s((u - WAIT) / RISE),  b alike for B
        R(u) = exp(tilt_A (1 - s((u - WAIT) / TURN)) + tilt_B (1 - s((1 - u - WAIT) / TURN))) L(v)        feet
        R(u) = R_A exp(theta s(v))                                                                        palms
        h(u) = s((u - WAIT) / OUT) (1 - s((u - WAIT - OUT) / IN)),  way the level direction from A to B
        v = (u - travel) / (1 - 2 travel),  L(v) level with a heading that goes from A's to B's,  R_A = exp(tilt_A) L(0)

    with s the quintic smooth step and a smooth bump between the ends of the travel. Each term has zero velocity and
    acceleration at its ends, so the curve leaves p_A along its normal n_A and lands on p_B along n_B at rest. Further
    up a foot rises straight and turns level: a tilted stone's normal would take it out of the leg's reach, and its
    tilt out of the ankle's.

    Attributes:
        X_WA, X_WB: (4, 4) first and last pose [m]; z axes are the contact normals.
        lift, lower: heights over the first and the last contact [m].
        side: (3,) greatest sideways displacement in W [m].
        travel: share of the swing at either end in which it does not travel.
        along: how much of the heights is along the normals, the rest is upwards [m].
        back, beyond: how far it first draws back from the way, and how far it goes past its end before it lands [m].
        clear: whether no sample meets the terrain.
    """

    X_WA: np.ndarray
    X_WB: np.ndarray
    lift: float
    lower: float
    side: np.ndarray
    travel: float = TRAVELS[0]
    along: float = ALONG
    back: float = 0.0
    beyond: float = 0.0
    clear: bool = True

    def poses(self, u: np.ndarray) -> np.ndarray:
        """(n, 4, 4) pose in W at every u (n,) in [0, 1]."""
        u = np.ascontiguousarray(np.clip(u, 0.0, 1.0))
        shape = _Shape(self.lift, self.lower, self.travel, self.back, self.beyond)
        return _curve(
            np.array(self.X_WA), np.array(self.X_WB), shape, np.asarray(self.side, dtype=float), self.along, u
        )


class _Shape(NamedTuple):
    """The numbers of a curve that are searched for; see `SwingCurve`."""

    lift: float
    lower: float
    travel: float
    back: float
    beyond: float


def hover(contact: Contact, height: float = HOVER) -> SwingCurve:
    """Leaves the contact along its normal up to a height and comes back: the part of a free palm's path near the wall.

    A palm that makes a contact follows the second half, one that breaks a contact the first.

    Args:
        contact: the palm's contact.
        height: along the contact normal [m].
    """
    return SwingCurve(contact.X_WC, contact.X_WC, height, height, np.zeros(3), along=np.inf)


class _Obstacles(NamedTuple):
    """What a swing must not meet.

    Attributes:
        packed: the terrain.
        around: (K,) indices of its polygons near the swing.
        blocks: (B, 4, 3) rectangles of the other leg in W [m].
    """

    packed: PackedTerrain
    around: np.ndarray
    blocks: np.ndarray


def plan_swing(
    packed: PackedTerrain,
    before: Contact,
    after: Contact,
    half_extent: tuple[float, float],
    thickness: float,
    *,
    clearance: float = 0.025,
    other: Contact | None = None,
    raised: float = 0.0,
    pushed: float = 0.0,
    probe: bool = False,
) -> SwingCurve:
    """The lowest curve whose moving box keeps the clearance to the terrain, less where it must, and misses the other leg.

    The box is the patch with `thickness` above it; its margin grows from nothing at the contacts to `clearance`.

    Args:
        packed: the terrain.
        before: the contact that is left.
        after: the contact that is made.
        half_extent: half length and half width of the patch [m].
        thickness: height of the foot or hand above the patch [m].
        clearance: margin to the terrain, below and at the sides [m].
        other: the contact of the other foot, whose shin is in the way.
        raised: added to both heights [m], for a caller for whom the lowest curve is not high enough.
        pushed: added to the sideways displacement [m].
        probe: whether it only matters if there is a clear curve: then the least clearance alone is tried, and curves that
            are not clear are given up at once.

    Returns:
        `clear` is False where every curve tried meets something, even with a fifth of the clearance.
    """
    X_WA, X_WB = np.array(before.X_WC), np.array(after.X_WC)  # for arrays that are read-only kernels compile anew
    foot = is_foot(before.effector)
    away = _away(before, after, other) if foot else X_WA[:3, 2].copy()
    blocks = np.zeros((0, 4, 3)) if other is None else _standing_leg(other)
    box = np.array([*half_extent, thickness, clearance])
    reach = float(np.hypot(*half_extent)) + clearance + SIDES[-1] + abs(pushed)
    low = np.minimum(X_WA[:2, 3], X_WB[:2, 3]) - reach - LIFTS[-1]
    high = np.maximum(X_WA[:2, 3], X_WB[:2, 3]) + reach + LIFTS[-1]
    obstacles = _Obstacles(packed, near(packed, low[0], low[1], high[0], high[1]), blocks)
    along = ALONG if foot else np.inf
    for share in MARGINS[-1:] if probe else MARGINS:
        box[3] = share * clearance
        shape, push, hits = _lowest(obstacles, X_WA, X_WB, away, box, along, raised, pushed, probe)
        if hits == 0:
            break
    lift, lower, travel, back, beyond = shape
    return SwingCurve(X_WA, X_WB, lift, lower, push * away, travel, along, back, beyond, clear=hits == 0)


def mirrored(curve: SwingCurve) -> SwingCurve:
    """The same way walked from its end to its start."""
    return replace(
        curve,
        X_WA=curve.X_WB,
        X_WB=curve.X_WA,
        lift=curve.lower,
        lower=curve.lift,
        back=curve.beyond,
        beyond=curve.back,
    )


def _away(before: Contact, after: Contact, other: Contact | None) -> np.ndarray:
    """(3,) horizontal unit vector square to the way, from the standing foot if there is one, else outwards."""
    outwards = before.R_WC[:, 1] * (1.0 if before.effector.startswith("left") else -1.0)
    outwards /= np.linalg.norm(outwards)
    if other is None:
        return outwards
    way = after.p_WC - before.p_WC
    away = 0.5 * (before.p_WC + after.p_WC) - other.p_WC
    way[2] = away[2] = 0.0
    if np.linalg.norm(way) > 0.02:
        way /= np.linalg.norm(way)
        away -= (away @ way) * way
    length = np.linalg.norm(away)
    return away / length if length > 0.02 else outwards


def _standing_leg(other: Contact) -> np.ndarray:
    """(4, 4, 3) upright faces of a box around the standing ankle and shin [m]."""
    corners = SHIN_HALF * np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]])
    ring = other.p_WC + corners @ other.R_WC[:, :2].T
    top = ring + np.array([0.0, 0.0, SHIN_TOP])
    return np.array([[ring[i], ring[i - 3], top[i - 3], top[i]] for i in range(4)])


@njit(cache=True)
def smooth_step(x: float) -> float:
    """Quintic from 0 to 1 with zero slope and curvature at both ends, constant outside [0, 1]."""
    if x <= 0.0:
        return 0.0
    if x >= 1.0:
        return 1.0
    return x * x * x * (10.0 + x * (6.0 * x - 15.0))


@njit(cache=True)
def _draw(u: float) -> float:
    """From 0 to 1 and back to 0 soon after the start of the swing."""
    return smooth_step((u - WAIT) / OUT) * (1.0 - smooth_step((u - WAIT - OUT) / IN))


@njit(cache=True)
def _curve(
    X_WA: np.ndarray, X_WB: np.ndarray, shape: _Shape, side: np.ndarray, along: float, u: np.ndarray
) -> np.ndarray:
    R_WA, R_WB = np.ascontiguousarray(X_WA[:3, :3]), np.ascontiguousarray(X_WB[:3, :3])
    theta = _rotation_vector(R_WA.T @ R_WB)
    yaw_a, yaw_b = np.arctan2(R_WA[1, 0], R_WA[0, 0]), np.arctan2(R_WB[1, 0], R_WB[0, 0])
    tilt_a, tilt_b = _rotation_vector(R_WA @ _level(yaw_a).T), _rotation_vector(R_WB @ _level(yaw_b).T)
    turn = (yaw_b - yaw_a + np.pi) % (2.0 * np.pi) - np.pi
    lift, lower, travel = shape.lift, shape.lower, shape.travel
    normal_a, normal_b = min(lift, along), min(lower, along)
    way = X_WB[:3, 3] - X_WA[:3, 3]
    way[2] = 0.0
    length = np.sqrt(way @ way)
    way = way / length if length > 0.02 else 0.0 * way
    poses = np.zeros((u.shape[0], 4, 4))
    for i in range(u.shape[0]):
        v = min(max((u[i] - travel) / (1.0 - 2.0 * travel), 0.0), 1.0)
        s = smooth_step(v)
        bump = 64.0 * (v * (1.0 - v)) ** 3
        out = shape.beyond * _draw(1.0 - u[i]) - shape.back * _draw(u[i])
        along_a, up_a = smooth_step(u[i] / RISE), smooth_step((u[i] - WAIT) / RISE)
        along_b, up_b = smooth_step((1.0 - u[i]) / RISE), smooth_step((1.0 - u[i] - WAIT) / RISE)
        for a in range(3):
            n_a, n_b, e_z = normal_a * X_WA[a, 2], normal_b * X_WB[a, 2], 1.0 if a == 2 else 0.0
            top_a, top_b = n_a + (lift - normal_a) * e_z, n_b + (lower - normal_b) * e_z
            leave = n_a * along_a + (lift - normal_a) * e_z * up_a
            land = n_b * along_b + (lower - normal_b) * e_z * up_b
            step = X_WB[a, 3] + top_b - X_WA[a, 3] - top_a
            poses[i, a, 3] = X_WA[a, 3] + leave + step * s + land - top_b + side[a] * bump + way[a] * out
        if np.isinf(along):
            poses[i, :3, :3] = R_WA @ _rotation(s * theta)
        else:
            level_a, level_b = smooth_step((u[i] - WAIT) / TURN), smooth_step((1.0 - u[i] - WAIT) / TURN)
            tilt = tilt_a * (1.0 - level_a) + tilt_b * (1.0 - level_b)
            poses[i, :3, :3] = _rotation(tilt) @ _level(yaw_a + s * turn)
        poses[i, 3, 3] = 1.0
    return poses


@njit(cache=True)
def _rotation_vector(R: np.ndarray) -> np.ndarray:
    """(3,) axis times angle [rad] of a rotation matrix; any axis of the two at exactly half a turn."""
    w = np.array([R[2, 1] - R[1, 2], R[0, 2] - R[2, 0], R[1, 0] - R[0, 1]]) * 0.5
    sine = np.sqrt(w @ w)
    cosine = 0.5 * (R[0, 0] + R[1, 1] + R[2, 2] - 1.0)
    angle = np.arctan2(sine, cosine)
    if sine > 1e-8:
        return w * (angle / sine)
    if cosine > 0.0:
        return w
    axis = np.sqrt(np.maximum((np.diag(R) + 1.0) * 0.5, 0.0))
    k = int(np.argmax(axis))
    for a in range(3):
        if a != k and R[a, k] < 0.0:
            axis[a] = -axis[a]
    return axis * np.pi


@njit(cache=True)
def _rotation(theta: np.ndarray) -> np.ndarray:
    """(3, 3) rotation by the rotation vector theta (3,) [rad] (Rodrigues)."""
    R = np.eye(3)
    angle = np.sqrt(theta @ theta)
    if angle < 1e-12:
        return R
    k = theta / angle
    K = np.array([[0.0, -k[2], k[1]], [k[2], 0.0, -k[0]], [-k[1], k[0], 0.0]])
    return R + np.sin(angle) * K + (1.0 - np.cos(angle)) * (K @ K)


@njit(cache=True)
def _level(yaw: float) -> np.ndarray:
    """(3, 3) rotation about the vertical."""
    c, s = np.cos(yaw), np.sin(yaw)
    return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])


@njit(cache=True)
def _lowest(
    obstacles: _Obstacles,
    X_WA: np.ndarray,
    X_WB: np.ndarray,
    away: np.ndarray,
    box: np.ndarray,
    along: float,
    raised: float,
    pushed: float,
    probe: bool,
) -> tuple[_Shape, float, int]:
    """(shape, push, hits) of the cheapest clear curve at the least push, else of the cheapest of all.

    To `probe`, one hit in either half is enough: the cheapest curve of those that are not clear then means nothing.

    Heights grow one at a time: the first while the first half meets something, the second while the second does.
    Where no height does, the foot draws back on that side, and the heights grow anew.
    """
    u, middle = np.linspace(0.0, 1.0, SAMPLES), np.array(MIDDLE)
    free = np.array([_free_margin(obstacles, X, box) for X in (X_WA, X_WB)])
    heights = len(LIFTS)
    last = heights * (len(BACKS) if np.isfinite(along) else 1)
    best, best_push, best_hits, cost = _Shape(LIFTS[0], LIFTS[0], TRAVELS[0], 0.0, 0.0), pushed, 2 * SAMPLES, np.inf
    for push in SIDES:
        side = (push + pushed) * away
        for travel in TRAVELS:
            i = j = 0
            while i < last and j < last:
                back, beyond = BACKS[i // heights], BACKS[j // heights]
                shape = _Shape(LIFTS[i % heights] + raised, LIFTS[j % heights] + raised, travel, back, beyond)
                early = late = 0
                if probe:
                    poses = _curve(X_WA, X_WB, shape, side, along, middle)
                    early, late = _hits(obstacles, poses, middle, box, free, travel, probe)
                if early == 0 or late == 0:
                    poses = _curve(X_WA, X_WB, shape, side, along, u)
                    early, late = _hits(obstacles, poses, u, box, free, travel, probe)
                hits = early + late
                price = shape.lift + shape.lower + back + beyond + HIT * hits + (LATE if travel > TRAVELS[0] else 0.0)
                if (hits == 0 and best_hits > 0) or (price < cost and (hits == 0 or best_hits > 0)):
                    best, best_push, best_hits, cost = shape, push + pushed, hits, price
                if hits == 0:
                    break
                i += 1 if early > 0 else 0
                j += 1 if late > 0 else 0
        if best_hits == 0:
            break
    return best, best_push, best_hits


@njit(cache=True)
def _hits(
    obstacles: _Obstacles,
    poses: np.ndarray,
    u: np.ndarray,
    box: np.ndarray,
    free: np.ndarray,
    travel: float,
    probe: bool,
) -> tuple[int, int]:
    """Samples of the first and of the second half whose box meets a polygon of the terrain or a block.

    Below, the margin grows from nothing as the effector rises; at the sides it grows from what the contact has
    (`free`), as a foot beside a riser can only rise.
    """
    early = late = 0
    for i in range(u.shape[0]):
        if probe and (late > 0 or (early > 0 and u[i] < 0.5)):
            continue
        margin = box[3] * smooth_step(min(u[i], 1.0 - u[i]) / RISE)
        beside = free[0] if u[i] <= 0.5 else free[1]
        beside += (box[3] - beside) * smooth_step(2.0 * (min(u[i], 1.0 - u[i]) - travel) / (1.0 - 2.0 * travel))
        low = GRAZE * (1.0 - margin / box[3]) - margin if box[3] > 0.0 else GRAZE
        if _meets(obstacles, poses[i], box, low, margin, beside):
            early += 1 if u[i] <= 0.5 else 0
            late += 1 if u[i] >= 0.5 else 0
    return early, late


@njit(cache=True)
def _free_margin(obstacles: _Obstacles, X_WC: np.ndarray, box: np.ndarray) -> float:
    """Margin at the sides that a contact leaves while the effector rises [m]: a share of `clearance`, else a graze."""
    for share in (1.0, 0.5, 0.25, 0.0):
        if not _meets(obstacles, X_WC, box, GRAZE, LIFTS[-1], share * box[3]):
            return share * box[3]
    return -GRAZE


@njit(cache=True)
def _meets(
    obstacles: _Obstacles,
    X_WC: np.ndarray,
    box: np.ndarray,
    z_low: float,
    above: float,
    beside: float,
) -> bool:
    """Whether the box over the patch, from z_low to its thickness and `above`, wider by `beside`, meets a polygon."""
    packed, blocks = obstacles.packed, obstacles.blocks
    work = np.empty((2, packed.vertices.shape[1] + 10, 3))
    low = np.array([-box[0] - beside, -box[1] - beside, z_low])
    high = np.array([box[0] + beside, box[1] + beside, box[2] + above])
    p, R = X_WC[:3, 3].copy(), X_WC[:3, :3].copy()
    reach = np.sqrt(high[0] ** 2 + high[1] ** 2 + max(high[2], -z_low) ** 2)
    for k in obstacles.around:
        apart = False
        for a in range(3):
            if packed.low[k, a] > p[a] + reach or packed.high[k, a] < p[a] - reach:
                apart = True
        if not apart and polygon_meets_box(packed.vertices[k], int(packed.count[k]), R, p, low, high, work):
            return True
    hit = False
    for k in range(blocks.shape[0]):
        hit = hit or polygon_meets_box(blocks[k], 4, R, p, low, high, work)
    return hit
