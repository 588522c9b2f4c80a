"""What a plan has the robot do at one moment."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from drakeplan.plan.arrays import read_only
from scenes.stance import Stance


@dataclass(frozen=True, eq=False)
class PlanState:
    """A plan at one moment; see `drakeplan.plan.plan.Plan.at`. All vectors are in W.

    Attributes:
        t: time [s].
        q: (nq,) positions: base quaternion (w, x, y, z), base position [m], joints [rad].
        v: (nv,) velocities: base angular [rad/s] and linear [m/s], joints [rad/s].
        com: (3,) centre of mass [m].
        linear_momentum: (3,) [kg m/s].
        angular_momentum: (3,) about the centre of mass [kg m^2/s].
        forces: (E, 3) contact force on the robot at each end effector [N]; 0 where it carries nothing.
        contacts: that may carry load then, one entry for each end effector, None where it is free; `contacts.held` are those
            that exist.
    """

    t: float
    q: np.ndarray
    v: np.ndarray
    com: np.ndarray
    linear_momentum: np.ndarray
    angular_momentum: np.ndarray
    forces: np.ndarray
    contacts: Stance

    def __post_init__(self) -> None:
        for name in ("q", "v", "com", "linear_momentum", "angular_momentum", "forces"):
            object.__setattr__(self, name, read_only(np.array(getattr(self, name), float)))
