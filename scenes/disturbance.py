"""Pushes that may hit the robot: sets of impulses, where they act, and how likely they are.

Lin 2020: Y.-C. Lin, "Learning for Humanoid Multi-Contact Navigation Planning" (dissertation), sec. 7.4 and 7.8.
A push is an instant change of linear momentum. In any short time at most one happens, so that with "none" the
probabilities of a place's set add up to one (Lin 2020 eq. 7.2).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from scenes.input_error import InputError

PERIOD = 0.1  # [s] that probabilities of scene files refer to (Lin 2020 sec. 7.8)
ROUNDING = 1e-9  # by which a sum of probabilities may exceed one


@dataclass(frozen=True, eq=False)
class Disturbance:
    """Pushes that may happen in a region (Lin 2020 sec. 7.4): one of the impulses, each as likely as the others.

    Attributes:
        impulses: (K, 3) changes of linear momentum in W [kg m/s].
        probability: that one of them happens within `PERIOD` [-].
        box_size: (3,) edges of the region [m], None for everywhere.
        X_WR: (4, 4) pose of the region's centre in W, None for the origin.
    """

    impulses: np.ndarray
    probability: float
    box_size: tuple[float, float, float] | None = None
    X_WR: np.ndarray | None = None

    def __post_init__(self) -> None:
        impulses = np.array(self.impulses, dtype=float)
        if impulses.ndim != 2 or impulses.shape[1] != 3 or not len(impulses) or not np.isfinite(impulses).all():
            raise InputError("disturbance: impulses must be a list of finite [x, y, z], at least one")
        if not 0.0 <= self.probability <= 1.0:
            raise InputError(f"disturbance: probability must be within 0 and 1, got {self.probability}")
        if self.box_size is not None and not (np.isfinite(self.box_size).all() and min(self.box_size) > 0):
            raise InputError(f"disturbance: the region's box must have edges > 0 m, got {self.box_size}")
        impulses.setflags(write=False)
        object.__setattr__(self, "impulses", impulses)

    def acts_at(self, points: np.ndarray) -> np.ndarray:
        """(N,) bool, whether points (N, 3) in W [m] lie in the region; its faces belong to it."""
        points = np.reshape(points, (-1, 3))
        if self.box_size is None:
            return np.ones(len(points), bool)
        X_WR = np.eye(4) if self.X_WR is None else self.X_WR
        p_RP = (points - X_WR[:3, 3]) @ X_WR[:3, :3]
        return np.asarray((np.abs(p_RP) <= np.asarray(self.box_size) / 2).all(axis=1))


@dataclass(frozen=True, eq=False)
class PushDistribution:
    """What may happen at one place: D(x) of Lin 2020 eq. 7.2, "no push" left out.

    Periods are independent, so that within a time T the place stays calm with (1 - p)^(T / PERIOD), p the sum of the
    probabilities, and otherwise one push happens, impulse i with the share p_i / p:

        sum_i P(delta_i, T) + P(none, T) = 1                                            (Lin 2020 eq. 7.2)

    Attributes:
        impulses: (K, 3) [kg m/s].
        probability: (K,) of each within `PERIOD` [-].
    """

    impulses: np.ndarray
    probability: np.ndarray

    def __post_init__(self) -> None:
        if self.probability.sum() > 1.0 + ROUNDING:
            raise InputError(
                f"disturbances: where regions overlap their probabilities add up to {self.probability.sum():.4g} in "
                f"{PERIOD} s, expected at most 1, since only one push happens at a time"
            )

    def none_within(self, duration: float | np.ndarray) -> np.ndarray:
        """Probability that no push happens within this time [s]."""
        if np.any(np.asarray(duration) < 0) or not np.isfinite(duration).all():
            raise InputError(f"disturbances: a duration must be a finite number >= 0 s, got {duration}")
        calm = 1.0 - min(float(self.probability.sum()), 1.0)
        return np.power(calm, np.asarray(duration, float) / PERIOD)

    def any_within(self, duration: float | np.ndarray) -> np.ndarray:
        """Probability that at least one push happens within this time [s]."""
        return 1.0 - self.none_within(duration)

    def within(self, duration: float) -> np.ndarray:
        """(K,) P(delta_i, T) of Lin 2020 eq. 7.2: that the push of a time T [s] is impulse i."""
        total = self.probability.sum()
        return self.probability * (self.any_within(duration) / total if total > 0 else 0.0)


def pushes_at(disturbances: Sequence[Disturbance], point: np.ndarray) -> PushDistribution:
    """What may happen at a point (3,) in W [m]; the sets of regions that overlap are put together.

    Args:
        disturbances: of the scene.
        point: (3,) where the centre of mass is, in W [m].

    Raises:
        InputError: their probabilities add up to more than one there.
    """
    return pushes_along(disturbances, np.reshape(point, (1, 3)))[0]


def pushes_along(disturbances: Sequence[Disturbance], points: np.ndarray) -> list[PushDistribution]:
    """What may happen at each of several points; points in the same regions share one.

    Args:
        disturbances: of the scene.
        points: (N, 3) in W [m].

    Raises:
        InputError: as `pushes_at`.
    """
    acts = np.zeros((len(points), len(disturbances)), bool)
    for i, disturbance in enumerate(disturbances):
        acts[:, i] = disturbance.acts_at(points)
    sets, which = np.unique(acts, axis=0, return_inverse=True)
    known = [_together([d for d, here in zip(disturbances, row, strict=True) if here]) for row in sets]
    return [known[k] for k in which.ravel()]


def _together(acting: Sequence[Disturbance]) -> PushDistribution:
    if not acting:
        return PushDistribution(np.zeros((0, 3)), np.zeros(0))
    shares = [np.full(len(d.impulses), d.probability / len(d.impulses)) for d in acting]
    return PushDistribution(np.concatenate([d.impulses for d in acting]), np.concatenate(shares))


def any_along(disturbances: Sequence[Disturbance], t: np.ndarray, com: np.ndarray) -> float:
    """Probability of at least one push on a way: 1 - prod_n (1 - p(com_n))^((t_n+1 - t_n) / PERIOD).

    Args:
        disturbances: of the scene.
        t: (N,) times, ascending [s].
        com: (N, 3) where the centre of mass is; row n holds from t[n] to t[n + 1] [m].

    Raises:
        InputError: as `pushes_at`, or times that do not ascend.
    """
    dt = _steps(t, com)
    here = pushes_along(disturbances, com[:-1])
    calm = [pushes.none_within(step) for pushes, step in zip(here, dt, strict=True)]
    return float(1.0 - np.prod(calm))


@dataclass(frozen=True, eq=False)
class Pushes:
    """Pushes that were drawn, in the order of time.

    Attributes:
        interval: (n,) the interval of the way in which each happens, at its start.
        impulse: (n, 3) [kg m/s].
    """

    interval: np.ndarray
    impulse: np.ndarray


def sample_pushes(
    disturbances: Sequence[Disturbance], t: np.ndarray, com: np.ndarray, rng: np.random.Generator
) -> Pushes:
    """Draws what happens on a way, at most one push an interval; arguments as for `any_along`.

    Two numbers are drawn for every interval, whatever happens in it, so that a way that is changed in one place
    keeps its pushes elsewhere.

    Args:
        disturbances: of the scene.
        t: (N,) times, ascending [s].
        com: (N, 3) where the centre of mass is in W; row n holds from t[n] to t[n + 1] [m].
        rng: source of the draws.
    """
    dt = _steps(t, com)
    draws = rng.random((len(dt), 2))
    interval, impulse = [], []
    for n, here in enumerate(pushes_along(disturbances, com[:-1])):
        happens, which = draws[n]
        if len(here.impulses) and happens < here.any_within(dt[n]):
            edges = np.cumsum(here.probability)
            i = int(np.searchsorted(edges, which * edges[-1], side="right"))
            interval.append(n)
            impulse.append(here.impulses[min(i, len(edges) - 1)])
    return Pushes(np.array(interval, int), np.reshape(impulse, (-1, 3)))


def discretised(
    representatives: np.ndarray,
    samples: np.ndarray,
    probability: float,
    *,
    box_size: tuple[float, float, float] | None = None,
    X_WR: np.ndarray | None = None,
) -> tuple[Disturbance, ...]:
    """A continuous distribution of impulses as a few, each with the probability of its Voronoi cell (sec. 7.4).

    Args:
        representatives: (K, 3) impulses that stand for all [kg m/s].
        samples: (M, 3) drawn from the distribution [kg m/s].
        probability: that any push happens within `PERIOD` [-].
        box_size: of the region [m].
        X_WR: pose of its centre.

    Returns:
        one entry for each representative whose cell holds a sample.
    """
    representatives, samples = np.reshape(representatives, (-1, 3)), np.reshape(samples, (-1, 3))
    if not len(representatives) or not len(samples):
        raise InputError("disturbances: expected at least one representative and one sample")
    distance = np.linalg.norm(samples[:, None] - representatives[None], axis=2)
    share = np.bincount(distance.argmin(axis=1), minlength=len(representatives)) / len(samples)
    return tuple(
        Disturbance(impulse[None], probability * float(part), box_size, X_WR)
        for impulse, part in zip(representatives, share, strict=True)
        if part > 0
    )


def _steps(t: np.ndarray, com: np.ndarray) -> np.ndarray:
    """(N-1,) intervals [s] of a way that has been looked at."""
    if np.ndim(t) != 1 or np.shape(com) != (len(t), 3) or len(t) < 1:
        raise InputError(f"disturbances: expected times (N,) and positions (N, 3), got {np.shape(t)}, {np.shape(com)}")
    if not (np.isfinite(t).all() and np.isfinite(com).all() and (np.diff(t) > 0).all()):
        raise InputError("disturbances: times must ascend, times and positions must be finite")
    return np.diff(t)
