"""How long a robot can do without contacts: ballistic flight between two phases on the ground, in closed form."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from optimization.centroidal.options import CentroidalOptions
from optimization.centroidal.problem import CentroidalProblem
from scenes.effector import is_foot
from scenes.gravity import GRAVITY


@dataclass(frozen=True)
class Ground:
    """What the contacts of one phase can do for the height of the CoM.

    Attributes:
        low, high: least and greatest height of the CoM [m].
        lift: greatest total force upwards [M g].
    """

    low: float
    high: float
    lift: float

    @property
    def speed(self) -> float:
        """Greatest change of the vertical speed over the whole stroke [m/s]: v^2 = 2 g (lift - 1) (high - low)."""
        return float(np.sqrt(2 * GRAVITY * max(self.lift - 1, 0.0) * max(self.high - self.low, 0.0)))


def longest_flight(before: Ground, after: Ground) -> float:
    """Longest time from take-off to landing [s]: pushed off over the whole stroke before, caught over the one after.

    With take-off speed v from `high` before to `low` after: T = (v + sqrt(v^2 + 2 g (high - low))) / g, and the landing
    speed g T - v must be one that can be stopped.

    Args:
        before: contacts that push off.
        after: contacts that catch.
    """
    rise = after.low - before.high
    room = before.speed**2 - 2 * GRAVITY * rise
    return 0.0 if room < 0 else float(min(before.speed + np.sqrt(room), before.speed + after.speed)) / GRAVITY


def impossible_flight(problem: CentroidalProblem, options: CentroidalOptions) -> str:
    """Which force-free phase is too long to survive, and why; "" where none is by closed form.

    One interval is granted: between knots nothing is asked of the height.

    Args:
        problem: the data, in SI.
        options: limits on height, reach and force.
    """
    schedule = problem.schedule
    phases, times = schedule.phases, schedule.times
    for phase in np.unique(phases[(schedule.active < 0).all(axis=1)]):
        within = np.flatnonzero(phases == phase)
        first, last = int(within[0]), int(within[-1])
        duration = float(times[last + 1] - times[first])
        if last + 1 == len(schedule.dt):
            if options.rest_at_end:
                return f"{schedule.phase_name(last)}: no contact is left to come to rest on"
            continue
        after = _ground(problem, options, last + 1)
        if first == 0:
            height, speed = problem.initial_com[2], problem.initial_linear_momentum[2] / problem.mass
            room = max(speed**2 + 2 * GRAVITY * (height - after.low), 0.0)
            longest = min((speed + np.sqrt(room)) / GRAVITY, (speed + after.speed) / GRAVITY)
            leaves = f"it starts with {speed:.2f} m/s upwards"
        else:
            before = _ground(problem, options, first - 1)
            longest = longest_flight(before, after)
            leaves = f"the contacts before it give {before.speed:.2f} m/s upwards at most"
        if duration > max(longest, 0.0) + float(schedule.dt[first]):
            fall = GRAVITY * duration**2 / 2
            return (
                f"{schedule.phase_name(first)}: without contact for {duration:.2f} s, in which the CoM falls "
                f"g T^2 / 2 = {fall:.2f} m; {leaves}, which lasts {max(longest, 0.0):.2f} s to where it can be caught"
            )
    return ""


def _ground(problem: CentroidalProblem, options: CentroidalOptions, interval: int) -> Ground:
    """Of the contacts that are active in this interval."""
    schedule = problem.schedule
    held = [(e, schedule.contacts[c]) for e, c in enumerate(schedule.active[interval]) if c >= 0]
    low = max(c.p_WC[2] - options.com_reach[e] for e, c in held)
    high = min(c.p_WC[2] + options.com_reach[e] for e, c in held)
    feet = [c.p_WC[2] for _, c in held if is_foot(c.effector)]
    if feet:
        low = max(low, float(np.mean(feet)) + options.com_height[0])
        high = min(high, float(np.mean(feet)) + options.com_height[2])
    # a corner's tangential force is at most sqrt(2) mu times its normal one under any of the cones
    lift = sum(options.force_limit[e] * (abs(c.R_WC[2, 2]) + np.sqrt(2) * c.friction) for e, c in held)
    return Ground(low, high, float(lift))
