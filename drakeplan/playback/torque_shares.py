"""Joint torques as shares of what the actuators can give."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from drakeplan.plan.arrays import last_before
from drakeplan.plan.plan import PlanMotion
from scenes.robots.plant import build_plant
from scenes.robots.robot import Robot


@dataclass(frozen=True, eq=False)
class TorqueShares:
    """|torque| / limit of the actuators that have a limit.

    Attributes:
        names: (A,) of the actuators.
        share: (F, A) at the times that were asked for.
    """

    names: tuple[str, ...]
    share: np.ndarray


def torque_shares(motion: PlanMotion, robot: Robot, t: np.ndarray) -> TorqueShares | None:
    """The shares at some times; None for a plan without torques or a robot without limits.

    Args:
        motion: with the torques; a row acts from its frame to the next.
        robot: whose model has the limits.
        t: (F,) seconds since the motion began.
    """
    if motion.tau is None or not len(motion.actuator_names):
        return None
    plant = build_plant(robot).plant
    actuators = [plant.get_joint_actuator(index) for index in plant.GetJointActuatorIndices()]
    limit_of = {a.name(): a.effort_limit() for a in actuators}
    limit = np.array([limit_of.get(name, np.inf) for name in motion.actuator_names])
    limited = np.flatnonzero(np.isfinite(limit) & (limit > 0.0))
    if not len(limited):
        return None
    tau = motion.tau[last_before(motion.t - motion.t[0], t)]
    names = tuple(motion.actuator_names[a] for a in limited)
    return TorqueShares(names, np.abs(tau[:, limited]) / limit[limited])
