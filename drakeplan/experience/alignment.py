"""Plans laid on a terrain as rigid bodies, and how far their contacts are from it then (Lin 2020 sec. 4.5.2, 5.8.2).

A plan moves in x, y, z and yaw. It begins at the start, turned towards the goal (eq. 5.15), and is then moved by Gauss-Newton
steps (eq. 4.6, 4.7) that bring every contact nearer to its nearest contact region, the first feet to where the robot stands and
the last feet into the goal:

    T' = J^+ [c'_1; ...; c'_C],   J_i = [1  z x (c_i - o)]

The distance of plan and terrain (eq. 4.8) is the mean of the distances (eq. 4.4) of the contacts from their nearest regions:

    Xi = 1/C sum_i xi(c_i, nearest region),   xi = sqrt(d_xy^2 + d_z^2) + w_r (1 - n_c . n_region)

Circles are sorted by x: those further off in x than the best one found need not be looked at.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numba import njit

from drakeplan.experience.plan_distance import PlanBatch
from scenes.footholds.contact_regions import TILT_WEIGHT, ContactRegions

MAX_STEPS = 20
STILL = 1e-3  # [m] a step that moves no contact further ends the alignment


@dataclass(frozen=True, eq=False)
class RegionTable:
    """Circles of all end effectors, those of one after those of another, each sorted by x.

    Attributes:
        start: (E + 1,) where the circles of each end effector begin.
        centre: (K, 3) in W [m].
        normal: (K, 3) outward normals in W.
        radius: (K,) [m].
        widest: (E,) greatest radius [m].
    """

    start: np.ndarray
    centre: np.ndarray
    normal: np.ndarray
    radius: np.ndarray
    widest: np.ndarray

    @staticmethod
    def of(regions: Mapping[int, ContactRegions], num_effectors: int = 4) -> RegionTable:
        """The circles of these regions.

        Args:
            regions: by index of the end effector; one that is missing has none.
            num_effectors: how many there are.
        """
        centre, normal, radius, widest, counts = [np.zeros((0, 3))], [np.zeros((0, 3))], [np.zeros(0)], [], []
        for e in range(num_effectors):
            own = regions.get(e)
            if own is not None and len(own):
                order = np.argsort(own.X_WR[:, 0, 3], kind="stable")
                centre.append(own.X_WR[order, :3, 3])
                normal.append(own.X_WR[order, :3, 2])
                radius.append(own.radius[order])
            counts.append(0 if own is None else len(own))
            widest.append(float(own.radius.max()) if own is not None and len(own) else 0.0)
        return RegionTable(
            np.concatenate([[0], np.cumsum(counts)]).astype(np.int64),
            np.ascontiguousarray(np.concatenate(centre)),
            np.ascontiguousarray(np.concatenate(normal)),
            np.concatenate(radius),
            np.array(widest),
        )


@dataclass(frozen=True, eq=False)
class Alignment:
    """Where M plans lie best, as far as a local search says.

    Attributes:
        pose: (M, 4) x, y, z [m] and yaw [rad] of each plan's frame in W.
        mean: (M,) Xi of eq. 4.8 [m]; infinite where a contact has no region at all.
        worst: (M,) greatest distance of a contact from its nearest region [m].
    """

    pose: np.ndarray
    mean: np.ndarray
    worst: np.ndarray


def align(
    plans: PlanBatch, end: np.ndarray, regions: RegionTable, feet: np.ndarray, goal: np.ndarray, radius: float
) -> Alignment:
    """Lays plans on a terrain, from where the robot stands towards the goal.

    Args:
        plans: each in its own frame.
        end: (M,) stance at which each plan is cut; contacts that appear later do not count.
        regions: of the terrain.
        feet: (2, 3) where the left and the right foot stand [m].
        goal: (2,) that the mean of the last feet shall come to in plan view, or (M, 2) one for each plan [m].
        radius: how near, in plan view [m].
    """
    pose, mean, worst = _align(
        plans.start, plans.position, _normals(plans.quaternion), plans.effector, plans.first,
        np.asarray(end, np.int64), regions.start, regions.centre, regions.normal, regions.radius, regions.widest,
        np.ascontiguousarray(feet, dtype=np.float64),
        np.array(np.broadcast_to(np.asarray(goal, np.float64), (len(plans), 2))), float(radius),
    )  # fmt: skip
    return Alignment(pose, mean, worst)


def _normals(quaternion: np.ndarray) -> np.ndarray:
    """(K, 3) z axes of frames given by quaternions (w, x, y, z)."""
    w, x, y, z = quaternion.T
    return np.ascontiguousarray(np.column_stack([2 * (x * z + w * y), 2 * (y * z - w * x), 1 - 2 * (x * x + y * y)]))


@njit(cache=True)
def _align(
    start: np.ndarray, position: np.ndarray, normal: np.ndarray, effector: np.ndarray, first: np.ndarray, end: np.ndarray,
    r_start: np.ndarray, r_centre: np.ndarray, r_normal: np.ndarray, r_radius: np.ndarray, r_widest: np.ndarray,
    feet: np.ndarray, goal: np.ndarray, radius: float,
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:  # fmt: skip
    num = len(start) - 1
    pose, mean, worst = np.zeros((num, 4)), np.full(num, np.inf), np.full(num, np.inf)
    here = (feet[0] + feet[1]) / 2.0
    for m in range(num):
        a, b = start[m], start[m + 1]
        used = first[a:b] <= end[m]
        p, n, e = position[a:b][used], normal[a:b][used], effector[a:b][used]
        begins = first[a:b][used] == 0
        last = _last_feet(e, first[a:b][used])
        x = np.empty(4)
        x[:3] = here
        x[3] = np.arctan2(goal[m, 1] - here[1], goal[m, 0] - here[0])
        near = np.full(len(p), -1, np.int64)
        xi = np.zeros(len(p))
        for _ in range(MAX_STEPS):
            _nearest_regions(x, p, n, e, r_start, r_centre, r_normal, r_radius, r_widest, near, xi)
            step = _step(x, p, n, e, begins, last, near, r_centre, r_normal, r_radius, feet, goal[m], radius)
            x += step
            reach = np.abs(p).max() if len(p) else 0.0
            if np.abs(step[:3]).max() + abs(step[3]) * reach < STILL:
                break
        _nearest_regions(x, p, n, e, r_start, r_centre, r_normal, r_radius, r_widest, near, xi)
        pose[m], total, most = x, 0.0, 0.0
        for i in range(len(p)):
            if begins[i] and e[i] < 2:  # it will stand where the robot stands
                continue
            total += xi[i]
            most = max(most, xi[i])
        mean[m], worst[m] = total / max(len(p), 1), most
    return pose, mean, worst


@njit(cache=True)
def _last_feet(e: np.ndarray, first: np.ndarray) -> np.ndarray:
    """(2,) the contact that each foot made last."""
    last, when = np.zeros(2, np.int64), np.full(2, -1)
    for i in range(len(e)):
        if e[i] < 2 and first[i] > when[e[i]]:
            when[e[i]], last[e[i]] = first[i], i
    return last


@njit(cache=True)
def _turned(x: np.ndarray, v: np.ndarray) -> np.ndarray:
    c, s = np.cos(x[3]), np.sin(x[3])
    return np.array([c * v[0] - s * v[1], s * v[0] + c * v[1], v[2]])


@njit(cache=True)
def _nearest_regions(
    x: np.ndarray, p: np.ndarray, n: np.ndarray, e: np.ndarray,
    start: np.ndarray, centre: np.ndarray, normal: np.ndarray, radius: np.ndarray, widest: np.ndarray,
    near: np.ndarray, xi: np.ndarray,
) -> None:  # fmt: skip
    """Writes the nearest circle of each contact and its distance by eq. 4.4; the one of the last call is looked at first."""
    for i in range(len(p)):
        point, up = _turned(x, p[i]) + x[:3], _turned(x, n[i])
        low, high = start[e[i]], start[e[i] + 1]
        best, which = np.inf, -1
        if near[i] >= 0:
            which = int(near[i])
            best = _distance(point, up, centre[which], normal[which], float(radius[which]))
        middle = low + np.searchsorted(centre[low:high, 0], point[0])
        k = middle
        while k < high and centre[k, 0] - point[0] - widest[e[i]] < best:
            found = _distance(point, up, centre[k], normal[k], radius[k])
            if found < best:
                best, which = found, k
            k += 1
        k = middle - 1
        while k >= low and point[0] - centre[k, 0] - widest[e[i]] < best:
            found = _distance(point, up, centre[k], normal[k], radius[k])
            if found < best:
                best, which = found, k
            k -= 1
        near[i], xi[i] = which, best


@njit(cache=True)
def _distance(point: np.ndarray, up: np.ndarray, centre: np.ndarray, normal: np.ndarray, radius: float) -> float:
    """xi of Lin 2020 eq. 4.4 [m]."""
    x, y, z = point[0] - centre[0], point[1] - centre[1], point[2] - centre[2]
    along = x * normal[0] + y * normal[1] + z * normal[2]
    across = np.sqrt(max(x * x + y * y + z * z - along * along, 0.0))
    sideways = max(across - radius, 0.0)
    tilt = 1.0 - (up[0] * normal[0] + up[1] * normal[1] + up[2] * normal[2])
    return np.sqrt(sideways * sideways + along * along) + TILT_WEIGHT * tilt


@njit(cache=True)
def _step(
    x: np.ndarray, p: np.ndarray, n: np.ndarray, e: np.ndarray, begins: np.ndarray, last: np.ndarray, near: np.ndarray,
    centre: np.ndarray, normal: np.ndarray, radius: np.ndarray, feet: np.ndarray, goal: np.ndarray, goal_radius: float,
) -> np.ndarray:  # fmt: skip
    """(4,) the Gauss-Newton step of eq. 4.7."""
    A, g = np.eye(4) * 1e-9, np.zeros(4)
    for i in range(len(p)):
        arm = _turned(x, p[i])
        point = arm + x[:3]
        if begins[i] and e[i] < 2:
            _pull(A, g, arm, feet[e[i]] - point)
            continue
        k = near[i]
        if k < 0:
            continue
        away = point - centre[k]
        along = away @ normal[k]
        across = away - along * normal[k]
        length = np.sqrt(across @ across)
        pull = -along * normal[k]
        if length > radius[k]:
            pull = pull - across * (1.0 - radius[k] / length)
        _pull(A, g, arm, pull)
        up = _turned(x, n[i])
        level, wanted = np.hypot(up[0], up[1]), np.hypot(normal[k, 0], normal[k, 1])
        if level > 0.5 and wanted > 0.5:  # a wall says which way it faces
            off = np.arctan2(normal[k, 1], normal[k, 0]) - np.arctan2(up[1], up[0])
            off = (off + np.pi) % (2.0 * np.pi) - np.pi
            A[3, 3] += TILT_WEIGHT * TILT_WEIGHT
            g[3] += TILT_WEIGHT * TILT_WEIGHT * off
    arm = (_turned(x, p[last[0]]) + _turned(x, p[last[1]])) / 2.0
    short = goal - (arm + x[:3])[:2]
    away_from_goal = np.hypot(short[0], short[1])
    if away_from_goal > goal_radius:
        pull = np.array([short[0], short[1], 0.0]) * (1.0 - goal_radius / away_from_goal)
        for _ in range(2):  # one for each foot
            _pull(A, g, arm, pull)
    return np.linalg.solve(A, g)


@njit(cache=True)
def _pull(A: np.ndarray, g: np.ndarray, arm: np.ndarray, pull: np.ndarray) -> None:
    """Adds the rows of one contact: J = [1  z x arm]."""
    A[0, 0] += 1.0
    A[1, 1] += 1.0
    A[2, 2] += 1.0
    A[0, 3] -= arm[1]
    A[3, 0] -= arm[1]
    A[1, 3] += arm[0]
    A[3, 1] += arm[0]
    A[3, 3] += arm[0] * arm[0] + arm[1] * arm[1]
    g[:3] += pull
    g[3] += arm[0] * pull[1] - arm[1] * pull[0]
