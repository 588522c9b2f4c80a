"""How robust a momentum trajectory is: columns (5) to (12) of Lin et al. 2019 fig. 8 (Lin 2020 fig. 6.9)."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from optimization.centroidal.contact_schedule import ContactSchedule
from optimization.centroidal.trajectory import LEAST_LOAD, CentroidalTrajectory
from scenes.gravity import GRAVITY

COLUMNS = (
    "(5) |l| kg m/s", "(6) |ldot| N", "(7) |k| N m s", "(8) |kdot| N m", "(9) RMS |f| Mg", "(10) |torque| N m",
    "(11) lateral |f| Mg", "(12) CoP to edge m",
)  # fmt: skip


def robustness(
    cases: Sequence[tuple[ContactSchedule, CentroidalTrajectory]], mass: float, half_extent: np.ndarray
) -> tuple[float, ...]:
    """Means over all time steps of all trajectories, in the order of `COLUMNS`; NaN without any.

    Args:
        cases: contacts and dynamics of each sequence.
        mass: M [kg].
        half_extent: (E, 2) half length and half width of each sole or palm [m].
    """
    sums = [robustness_sums(schedule, trajectory, mass, half_extent) for schedule, trajectory in cases]
    return pooled_means(np.array(sums).reshape(-1, 2, len(COLUMNS)))


def robustness_sums(
    schedule: ContactSchedule, trajectory: CentroidalTrajectory, mass: float, half_extent: np.ndarray
) -> np.ndarray:
    """(2, 8) sums and numbers of the samples of each of `COLUMNS` in one trajectory.

    The momenta are those at the end of each time step, their rates the changes over it. Contact forces are in units of
    M g; the root mean square is taken over the contacts of a time step. Torque, lateral force (Lin 2020 eq. 6.4: in the contact
    frame) and the distance of the centre of pressure to the nearest edge of its patch are samples of one contact in one
    time step; a contact without load has no centre of pressure.

    Args:
        schedule: contacts in each interval.
        trajectory: over the same intervals.
        mass: of the robot [kg].
        half_extent: (E, 2) half length and half width of each contact patch [m].
    """
    samples = _samples(schedule, trajectory, mass * GRAVITY, half_extent)
    return np.array([[s.sum() for s in samples], [len(s) for s in samples]], float)


def pooled_means(sums: np.ndarray) -> tuple[float, ...]:
    """Means over all samples, from (n, 2, 8) sums and numbers of n trajectories."""
    total, number = np.asarray(sums, float).sum(axis=0)
    return tuple(float(t / n) if n else float("nan") for t, n in zip(total, number, strict=True))


def _samples(
    schedule: ContactSchedule, trajectory: CentroidalTrajectory, weight: float, half_extent: np.ndarray
) -> tuple[np.ndarray, ...]:
    dt = np.diff(trajectory.t)[:, None]
    l, k = trajectory.linear_momentum, trajectory.angular_momentum
    held = schedule.active >= 0
    knot, effector = np.nonzero(held)
    _, R_WC, _ = schedule.poses()
    force_W = trajectory.force_W[:-1] / weight
    force_C = np.einsum("jba,jb->ja", R_WC[schedule.active[knot, effector]], force_W[knot, effector])
    square = np.where(held, (force_W**2).sum(axis=2), 0.0)
    margin = (half_extent[effector] - np.abs(trajectory.cop_C[knot, effector])).min(axis=1)
    return (
        np.linalg.norm(l[1:], axis=1),
        np.linalg.norm(np.diff(l, axis=0) / dt, axis=1),
        np.linalg.norm(k[1:], axis=1),
        np.linalg.norm(np.diff(k, axis=0) / dt, axis=1),
        np.sqrt(square.sum(axis=1) / np.maximum(held.sum(axis=1), 1)),
        np.abs(trajectory.torque_n[knot, effector]),
        np.hypot(force_C[:, 0], force_C[:, 1]),
        margin[force_C[:, 2] > LEAST_LOAD],
    )
