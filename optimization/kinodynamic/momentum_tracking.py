"""Whole motions that hold contacts, follow a CoM and bring about given momenta: all configurations at once.

    min   sum_t   tasks of frame t                                         see `frame_task`
                  + |W_h (h_t - h_t*)|^2                                   momentum from frame t to frame t + 1
                  + |W_s (v_t - v_t-1) / tau|^2                            accelerations
                  + w_v^2 max(0, |v_t| - speed)^2                          speed limits of the joints
                  + w_a^2 max(0, |v_t - v_t-1| / tau - acceleration)^2     acceleration limits of the joints
    s.t.  joint limits

with v_t the velocity that takes q_t to q_t+1 in dt_t, and h_t = (k, l): the angular momentum k = (A_k(q_t) + A_k(q_t+1))/2 v_t
with A the centroidal momentum matrix (Orin, Goswami & Lee 2013), the linear one M (com_t+1 - com_t) / dt_t. This is the
kinematic half of Herzog et al. 2016 sec. III-B (as used in Lin 2020 sec. 7.3), solved for all knots together.

Gauss-Newton with joint limits by projection (Bertsekas 1982); a step that does not help is damped and tried again. Each
frame meets only its two neighbours on either side, so that the normal equations are a band of 2 nv + 1 diagonals, and a
step costs as much per frame as solving the frames one by one.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numba import njit

from optimization.convex.banded_cholesky import solve_band
from optimization.inverse_kinematics.frame_task import (
    FrameErrors,
    FrameTask,
    TrackingTargets,
    add_missing_distances,
    frame_tasks,
    normal_equations,
    task_of_frame,
)
from optimization.multibody.kinematic_tree import (
    KinematicTree,
    difference,
    forward,
    integrate,
    momentum_matrix,
)

SPEED_WEIGHT = 10.0  # [s/rad] of what a joint is too fast
ACCELERATION_WEIGHT = 0.1  # [s^2/rad] of what a joint accelerates too hard
STEP = 0.3  # [rad, m] greatest change of any unknown in one step
FIRST_DAMPING = 1e-3  # after a step that did not help, relative to the diagonal; tenfold each time
TRIES = 8  # of damping one step


@dataclass(frozen=True, eq=False)
class MomentumTargets:
    """What joins T frames.

    Attributes:
        dt: (T - 1,) time from each frame to the next [s].
        momentum: (T - 1, 6) angular momentum about the CoM [N m s] and linear momentum [kg m/s] wanted on the way.
        weight: (T - 1, 6) of its errors [1/(N m s), s/(kg m)], 0 where it is free.
        smooth: (nv,) weights of accelerations, or (T, nv) of those at each frame [s^2/rad, s^2/m].
        speed: (nv - 6,) speed limits of the joints [rad/s]; inf where there is none.
        acceleration: of every joint, limit [rad/s^2]; inf where there is none.
        v_start, v_end: (nv,) velocities before the first and after the last frame that accelerations count from and
            to; None where they are free.
        fixed: (T,) bool, frames that stay as they are; None for none.
    """

    dt: np.ndarray
    momentum: np.ndarray
    weight: np.ndarray
    smooth: np.ndarray
    speed: np.ndarray
    v_start: np.ndarray | None = None
    v_end: np.ndarray | None = None
    fixed: np.ndarray | None = None
    acceleration: float = np.inf

    def window(self, first: int, last: int, fixed: np.ndarray) -> MomentumTargets:
        """What joins frames first to last - 1; at the ends of the window velocities are free.

        Args:
            first: number of the first frame.
            last: number after the last frame.
            fixed: (last - first,) frames that stay as they are: two at each end join the window to what is outside.
        """
        dt, momentum, weight = (array[first : last - 1] for array in (self.dt, self.momentum, self.weight))
        smooth = self.smooth[first:last] if self.smooth.ndim == 2 else self.smooth
        v_start, v_end = (self.v_start if first == 0 else None), (self.v_end if last == len(self.dt) + 1 else None)
        return MomentumTargets(dt, momentum, weight, smooth, self.speed, v_start, v_end, fixed, self.acceleration)


@dataclass(frozen=True, eq=False)
class TrackedMotion:
    """Answer of `track_momentum`.

    Attributes:
        q: (T, nq).
        momentum: (T - 1, 6) angular and linear momentum from each frame to the next [N m s, kg m/s].
        com: (T, 3) centre of mass [m].
        effector_error: (T, E) as in `TrackedPostures` [m].
        iterations: steps taken.
        cost: of the program above.
    """

    q: np.ndarray
    momentum: np.ndarray
    com: np.ndarray
    effector_error: np.ndarray
    iterations: int
    cost: float


class _Links(NamedTuple):
    """`MomentumTargets` for kernels: free velocities are NaN."""

    dt: np.ndarray
    momentum: np.ndarray
    weight: np.ndarray
    smooth: np.ndarray
    speed: np.ndarray
    v_start: np.ndarray
    v_end: np.ndarray
    fixed: np.ndarray
    acceleration: float


class _Normal(NamedTuple):
    """The normal equations and what is measured on the way, written by `_assemble`.

    Fields: band (T nv, 2 nv + 1), row j holds column j of the lower triangle from the diagonal down; g (T nv,);
    effector_error (T, E); com (T, 3); momentum (T - 1, 6).
    """

    band: np.ndarray
    g: np.ndarray
    effector_error: np.ndarray
    com: np.ndarray
    momentum: np.ndarray


def track_momentum(
    tree: KinematicTree,
    targets: TrackingTargets,
    links: MomentumTargets,
    q: np.ndarray,
    *,
    max_iterations: int = 10,
    tolerance: float = 1e-3,
    check: Callable[[], None] = lambda: None,
) -> TrackedMotion:
    """Solves all frames together, from the motion q (T, nq).

    Args:
        tree: the robot.
        targets: what each frame should do.
        links: what joins them.
        q: (T, nq) motion to start from.
        max_iterations: of Gauss-Newton.
        tolerance: relative decrease of the cost at which it ends.
        check: called before each step; it may raise.
    """
    q = np.array(q, dtype=float, order="C")
    T, E = targets.place_weight.shape
    nv = q.shape[1] - 1
    frames, between = frame_tasks(targets), _links(links, T, nv)
    normal, other = (
        _Normal(
            np.empty((T * nv, 2 * nv + 1)), np.empty(T * nv), np.zeros((T, E)), np.empty((T, 3)), np.empty((T - 1, 6))
        )
        for _ in range(2)
    )
    _clamp(q, frames.lower, frames.upper, between.fixed)
    cost = _assemble(tree, frames, between, q, normal)
    trial, damping, taken = np.empty_like(q), 0.0, 0
    for _ in range(max_iterations):
        before = cost
        for _ in range(TRIES):
            check()
            expected = _step(frames, between.fixed, normal, damping, q, trial)
            if expected is None:
                damping = max(10.0 * damping, FIRST_DAMPING)
                continue
            new = _assemble(tree, frames, between, trial, other)
            if new < cost:
                break
            if expected < tolerance * cost and damping == 0.0:  # nothing worth a damped step is left
                return TrackedMotion(q, normal.momentum, normal.com, normal.effector_error, taken, cost)
            damping = max(10.0 * damping, FIRST_DAMPING)
        else:
            break
        q, trial, normal, other, cost = trial, q, other, normal, new
        damping *= 0.1
        taken += 1
        if cost > (1.0 - tolerance) * before:
            break
    return TrackedMotion(q, normal.momentum, normal.com, normal.effector_error, taken, cost)


def _links(links: MomentumTargets, num_frames: int, nv: int) -> _Links:
    nan = np.full(nv, np.nan)
    fixed = np.zeros(num_frames, np.bool_) if links.fixed is None else np.array(links.fixed, dtype=np.bool_)
    arrays = (
        links.dt,
        links.momentum,
        links.weight,
        np.broadcast_to(links.smooth, (num_frames, nv)),
        links.speed,
        nan if links.v_start is None else links.v_start,
        nan if links.v_end is None else links.v_end,
    )
    return _Links(*(np.array(array, dtype=float, order="C") for array in arrays), fixed, float(links.acceleration))  # type: ignore[call-arg]


def _step(
    frames: FrameTask, fixed: np.ndarray, normal: _Normal, damping: float, q: np.ndarray, trial: np.ndarray
) -> float | None:
    """Writes the trial motion that one step makes of q; by how much the cost would fall were it quadratic.

    None where the equations cannot be solved.
    """
    band, g = normal.band.copy(), normal.g.copy()
    _hold(frames, fixed, damping, q, band, g)
    step = g.copy()
    if not solve_band(band, step):
        return None
    _move(frames, fixed, q, step, trial)
    return float(g @ step) if np.isfinite(trial).all() else None


@njit(cache=True)
def _clamp(q: np.ndarray, lower: np.ndarray, upper: np.ndarray, fixed: np.ndarray) -> None:
    """Puts the joints of frames that may move within their limits."""
    for t in range(q.shape[0]):
        if not fixed[t]:
            for i in range(lower.shape[0]):
                q[t, 7 + i] = min(max(q[t, 7 + i], lower[i]), upper[i])


@njit(cache=True)
def _hold(frames: FrameTask, fixed: np.ndarray, damping: float, q: np.ndarray, band: np.ndarray, g: np.ndarray) -> None:
    """Takes out of the equations what may not move: fixed frames, and joints at a limit that would go beyond."""
    T, nv = fixed.shape[0], frames.posture_weight.shape[0]
    held = np.zeros(T * nv, np.bool_)
    for t in range(T):
        for i in range(nv):
            j = t * nv + i
            band[j, 0] *= 1.0 + damping
            held[j] = fixed[t]
            if i >= 6:
                x = q[t, 1 + i]
                low, high = frames.lower[i - 6], frames.upper[i - 6]
                held[j] |= (x <= low + 1e-9 and g[j] < 0.0) or (x >= high - 1e-9 and g[j] > 0.0)
    for j in range(T * nv):
        if held[j]:
            g[j] = 0.0
            band[j, 0] = 1.0
            for d in range(1, band.shape[1]):
                band[j, d] = 0.0
                if j >= d:
                    band[j - d, d] = 0.0


@njit(cache=True)
def _move(frames: FrameTask, fixed: np.ndarray, q: np.ndarray, dv: np.ndarray, trial: np.ndarray) -> None:
    T, nv = fixed.shape[0], frames.posture_weight.shape[0]
    step = np.empty(nv)
    for t in range(T):
        if fixed[t]:
            trial[t] = q[t]
            continue
        for i in range(nv):
            step[i] = min(max(dv[t * nv + i], -STEP), STEP)
        integrate(q[t], step, 1.0, trial[t])
    _clamp(trial, frames.lower, frames.upper, fixed)


@njit(cache=True)
def _assemble(tree: KinematicTree, frames: FrameTask, links: _Links, q: np.ndarray, out: _Normal) -> float:
    """Writes the normal equations at q and returns the cost."""
    T, nv, n = q.shape[0], frames.posture_weight.shape[0], tree.parent.shape[0]
    R, p = np.empty((n, 3, 3)), np.empty((n, 3))
    H, g, A, errors_com = np.empty((nv, nv)), np.empty(nv), np.empty((T, 6, nv)), np.empty(3)
    out.band[:] = 0.0
    cost = 0.0
    for t in range(T):
        task = task_of_frame(frames, t)
        forward(tree, q[t], R, p)
        cost += normal_equations(tree, task, R, p, q[t], H, g, FrameErrors(out.effector_error[t], errors_com))
        cost += add_missing_distances(tree, task, R, p, H, g)
        momentum_matrix(tree, R, p, out.com[t], A[t])
        for a in range(nv):
            out.g[t * nv + a] = g[a]
            for b in range(a, nv):
                out.band[t * nv + a, b - a] = H[a, b]
    v, v_last = np.empty(nv), links.v_start.copy()
    for t in range(T - 1):
        difference(q[t], q[t + 1], v)
        for i in range(nv):
            v[i] /= links.dt[t]
        cost += _add_momentum(tree, links, A, v, t, out)
        cost += _add_speeds(links, v, t, out)
        before = links.dt[t - 1] if t > 0 else links.dt[t]
        cost += _add_accelerations(links, v_last, v, t, before, out)
        v_last[:] = v
    if T > 1:
        cost += _add_accelerations(links, v_last, links.v_end, T - 1, links.dt[T - 2], out)  # type: ignore[arg-type]
    return cost


@njit(cache=True)
def _add_momentum(tree: KinematicTree, links: _Links, A: np.ndarray, v: np.ndarray, t: int, out: _Normal) -> float:
    """Rows of the momentum between frames t and t + 1; their part of the cost."""
    nv, dt, cost = v.shape[0], links.dt[t], 0.0
    ahead, behind = np.empty(nv), np.empty(nv)
    for r in range(6):
        h = 0.0
        for i in range(nv):
            # The linear momentum's rows are those of the CoM: exact, where the mean of the matrices is not.
            ahead[i] = A[t + 1, r, i] / dt if r >= 3 else 0.5 * (A[t, r, i] + A[t + 1, r, i]) / dt
            behind[i] = A[t, r, i] / dt if r >= 3 else ahead[i]
            h += 0.5 * (A[t, r, i] + A[t + 1, r, i]) * v[i]
        if r >= 3:
            h = tree.total_mass * (out.com[t + 1, r - 3] - out.com[t, r - 3]) / dt
        out.momentum[t, r] = h
        w = links.weight[t, r]
        if w <= 0.0:
            continue
        miss = links.momentum[t, r] - h
        cost += (w * miss) ** 2
        o = t * nv
        for a in range(nv):
            x, y = w * w * ahead[a], w * w * behind[a]
            out.g[o + nv + a] += x * miss
            out.g[o + a] -= y * miss
            for b in range(a, nv):
                out.band[o + nv + a, b - a] += x * ahead[b]
                out.band[o + a, b - a] += y * behind[b]
            for b in range(nv):
                out.band[o + a, nv + b - a] -= y * ahead[b]
    return cost


@njit(cache=True)
def _add_speeds(links: _Links, v: np.ndarray, t: int, out: _Normal) -> float:
    """Rows of joints that are too fast from frame t to t + 1; their part of the cost."""
    nv, cost = v.shape[0], 0.0
    w = SPEED_WEIGHT / links.dt[t]
    for i in range(6, nv):
        over = abs(v[i]) - links.speed[i - 6]
        if over > 0.0:
            miss = -over if v[i] > 0.0 else over
            j = t * nv + i
            cost += (SPEED_WEIGHT * over) ** 2
            out.g[j + nv] += w * SPEED_WEIGHT * miss
            out.g[j] -= w * SPEED_WEIGHT * miss
            out.band[j + nv, 0] += w * w
            out.band[j, 0] += w * w
            out.band[j, nv] -= w * w
    return cost


@njit(cache=True)
def _add_accelerations(links: _Links, v0: np.ndarray, v1: np.ndarray, t: int, before: float, out: _Normal) -> float:
    """Rows of the acceleration at frame t, between v0 and v1; at either end one of them is given. Part of the cost."""
    nv, last, cost = v0.shape[0], t == links.dt.shape[0], 0.0
    after = before if last else links.dt[t]
    tau = 0.5 * (before + after)
    # v1 = (q[t + 1] - q[t]) / after, v0 = (q[t] - q[t - 1]) / before
    up, down = (0.0 if last else 1.0 / (tau * after)), (0.0 if t == 0 else 1.0 / (tau * before))
    middle = -up - down
    for i in range(nv):
        if np.isnan(v0[i]) or np.isnan(v1[i]):
            continue
        a = (v1[i] - v0[i]) / tau
        weight = links.smooth[t, i] ** 2
        pull = -weight * a
        cost += weight * a * a
        over = abs(a) - links.acceleration
        if i >= 6 and over > 0.0:
            hard = ACCELERATION_WEIGHT**2
            weight += hard
            pull -= hard * over if a > 0.0 else -hard * over
            cost += hard * over * over
        j = t * nv + i
        out.g[j] += middle * pull
        out.band[j, 0] += middle * middle * weight
        if not last:
            out.g[j + nv] += up * pull
            out.band[j + nv, 0] += up * up * weight
            out.band[j, nv] += middle * up * weight
        if t > 0:
            out.g[j - nv] += down * pull
            out.band[j - nv, 0] += down * down * weight
            out.band[j - nv, nv] += down * middle * weight
            if not last:
                out.band[j - nv, 2 * nv] += down * up * weight
    return cost
