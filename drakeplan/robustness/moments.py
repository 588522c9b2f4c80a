"""The states of a plan at which pushes are tried: every 0.1 s, in swings and double support (Lin 2020 sec. 7.8)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from drakeplan.plan.plan import Plan
from scenes.disturbance import PERIOD
from scenes.effector import LEFT_FOOT, RIGHT_FOOT
from scenes.input_error import InputError
from scenes.stance import Stance


@dataclass(frozen=True, eq=False)
class Moment:
    """One state of a plan.

    Attributes:
        t: [s].
        stance: contacts held.
        com: (3,) in W [m].
        linear_momentum: (3,) in W [kg m/s].
        angular_momentum: (3,) about the CoM, in W [N m s].
    """

    t: float
    stance: Stance
    com: np.ndarray
    linear_momentum: np.ndarray
    angular_momentum: np.ndarray

    @property
    def swing(self) -> bool:
        """Whether a foot is in the air."""
        return any(self.stance.contacts[foot] is None for foot in (LEFT_FOOT, RIGHT_FOOT))


def moments_of(plan: Plan, step: float = PERIOD) -> list[Moment]:
    """The states of a complete plan every `step` seconds, the end left out.

    Momenta are those of the plan's dynamics, linear between knots as forces are constant there.

    Args:
        plan: with dynamics.
        step: between moments [s].

    Raises:
        InputError: a plan of contacts only.
    """
    if plan.phases is None or plan.centroidal is None:
        raise InputError("a plan of contacts only: it has no states that could be pushed")
    phases, centroidal = plan.phases, plan.centroidal
    end = float(phases.end[-1])
    t = step * np.arange(max(int(np.ceil(end / step - 1e-6)), 1))
    rows = [
        np.column_stack([np.interp(t, centroidal.t, values[:, a]) for a in range(3)])
        for values in (centroidal.com, centroidal.linear_momentum, centroidal.angular_momentum)
    ]
    which = np.clip(np.searchsorted(phases.start, t + 1e-6, side="right") - 1, 0, len(phases) - 1)
    moments = []
    for n, p in enumerate(which.tolist()):
        held = tuple(plan.contact(c) if c >= 0 else None for c in phases.contact[p].tolist())
        moments.append(Moment(float(t[n]), Stance(held), rows[0][n], rows[1][n], rows[2][n]))
    return moments
