"""Centroidal trajectories: integrated exactly from contact wrenches, in the plan file's discrete equations.

l[n+1]   = l[n]   + dt (sum f[n] + M g)
com[n+1] = com[n] + dt l[n+1] / M
k[n+1]   = k[n]   + dt (sum (p_cop[n] - com[n+1]) x f[n] + tau[n] n)
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from optimization.balance.contact_wrench import cross
from optimization.centroidal.contact_schedule import ContactSchedule
from scenes.gravity import GRAVITY

LEAST_LOAD = 1e-9  # [M g]: below it a contact carries nothing and its centre of pressure is put at the centre


@dataclass(frozen=True, eq=False)
class CentroidalTrajectory:
    """A trajectory at N knots with the contact forces between them; the last row of the forces repeats the one before.

    Attributes:
        t: (N,) [s].
        com: (N, 3) in W [m].
        linear_momentum: (N, 3) in W [kg m/s].
        angular_momentum: (N, 3) about the CoM, in W [N m s].
        contact: (N, E) index into the schedule's contacts, or -1.
        force_W: (N, E, 3) force on the robot at each contact, in W [N]; acts over [t_n, t_n+1).
        cop_C: (N, E, 2) centre of pressure in each contact frame [m].
        torque_n: (N, E) torque about the contact's normal at the centre of pressure [N m].
    """

    t: np.ndarray
    com: np.ndarray
    linear_momentum: np.ndarray
    angular_momentum: np.ndarray
    contact: np.ndarray
    force_W: np.ndarray
    cop_C: np.ndarray
    torque_n: np.ndarray


@dataclass(frozen=True, eq=False)
class CentroidalState:
    """What the wrenches bring about, at knots 1..N-1, in units of m, s and M g.

    Attributes:
        com: (N-1, 3) [m].
        velocity: (N-1, 3) l / M [m/s].
        k: (N-1, 3) angular momentum over M g [m s].
        total_force: (N-1, 3) sum of the contact forces in each interval [M g].
        k_rate: (N-1, 3) [M g m].
    """

    com: np.ndarray
    velocity: np.ndarray
    k: np.ndarray
    total_force: np.ndarray
    k_rate: np.ndarray


class WrenchIntegrator:
    """Integrates contact wrenches over a schedule. A wrench is force and moment at the contact point, in its frame.

    Args:
        schedule: the contacts and the knots.
        initial: (3, 3) rows com [m], l / M [m/s], k / (M g) [m s] at knot 0.
    """

    def __init__(self, schedule: ContactSchedule, initial: np.ndarray) -> None:
        self.dt = schedule.dt[:, None]
        self.initial = initial
        self.interval, self.effector = np.nonzero(schedule.active >= 0)
        p_WC, R_WC, _ = schedule.poses()
        held = schedule.active[self.interval, self.effector]
        self.p_WC, self.R_WC = p_WC[held], R_WC[held]

    def sums(self, force_W: np.ndarray, moment_W: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """(N-1, 3) sums over the contacts of each interval of two (J, 3) arrays.

        Args:
            force_W: (J, 3) forces of the active contacts in W [M g].
            moment_W: (J, 3) moments in W [M g m].
        """
        shape = (len(self.dt), 3)
        force, moment = np.zeros(shape), np.zeros(shape)
        np.add.at(force, self.interval, force_W)
        np.add.at(moment, self.interval, moment_W)
        return force, moment

    def integrate(self, force_C: np.ndarray, moment_C: np.ndarray) -> CentroidalState:
        """The state after (J, 3) contact forces [M g] and moments [M g m] in their contact frames.

        Args:
            force_C: (J, 3) forces of the active contacts, in C [M g].
            moment_C: (J, 3) moments about the contact points, in C [M g m].
        """
        force_W = np.einsum("jab,jb->ja", self.R_WC, force_C)
        turned = np.einsum("jab,jb->ja", self.R_WC, moment_C)
        total_force, _ = self.sums(force_W, turned)
        acceleration = GRAVITY * (total_force - np.array([0.0, 0.0, 1.0]))
        com0, velocity0, k0 = self.initial
        velocity = velocity0 + np.cumsum(self.dt * acceleration, axis=0)
        com = com0 + np.cumsum(self.dt * velocity, axis=0)
        lever = self.p_WC - com[self.interval]  # about the CoM from the start: no large moments to cancel
        _, k_rate = self.sums(force_W, cross(lever, force_W) + turned)
        return CentroidalState(com, velocity, k0 + np.cumsum(self.dt * k_rate, axis=0), total_force, k_rate)

    def trajectory(
        self, schedule: ContactSchedule, force_C: np.ndarray, moment_C: np.ndarray, mass: float
    ) -> CentroidalTrajectory:
        """The plan file's arrays for (J, 3) forces [M g] and moments [M g m] in their contact frames.

        Args:
            schedule: that the integrator was made for.
            force_C: (J, 3) forces of the active contacts, in C [M g].
            moment_C: (J, 3) moments about the contact points, in C [M g m].
            mass: M [kg].
        """
        weight = mass * GRAVITY
        state = self.integrate(force_C, moment_C)
        cop, torque = pressure_centre(force_C, moment_C)
        knots, effectors = schedule.num_knots, schedule.active.shape[1]
        force_W, cop_C = (np.zeros((knots, effectors, 3)), np.zeros((knots, effectors, 2)))
        torque_n = np.zeros((knots, effectors))
        at = self.interval, self.effector
        force_W[at] = weight * np.einsum("jab,jb->ja", self.R_WC, force_C)
        cop_C[at] = cop
        torque_n[at] = weight * torque
        for array in (force_W, cop_C, torque_n):
            array[-1] = array[-2]
        whole = [np.vstack([self.initial[i], a]) for i, a in enumerate((state.com, state.velocity, state.k))]
        return CentroidalTrajectory(
            t=schedule.times,
            com=whole[0],
            linear_momentum=mass * whole[1],
            angular_momentum=weight * whole[2],
            contact=np.vstack([schedule.active, schedule.active[-1:]]),
            force_W=force_W,
            cop_C=cop_C,
            torque_n=torque_n,
        )

    def wrenches(self, trajectory: CentroidalTrajectory, mass: float) -> tuple[np.ndarray, np.ndarray]:
        """(J, 3) forces [M g] and moments [M g m] in their contact frames: what `trajectory` was made of.

        Args:
            trajectory: over the same schedule.
            mass: M [kg].
        """
        weight = mass * GRAVITY
        at = self.interval, self.effector
        force_C = np.einsum("jba,jb->ja", self.R_WC, trajectory.force_W[at]) / weight
        p_cop_C = np.concatenate([trajectory.cop_C[at], np.zeros((len(force_C), 1))], axis=1)
        torque_C = np.zeros_like(force_C)
        torque_C[:, 2] = trajectory.torque_n[at] / weight
        return force_C, np.cross(p_cop_C, force_C) + torque_C


def pressure_centre(force_C: np.ndarray, moment_C: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(J, 2) centres of pressure [m] and (J,) normal torques there [M g m] of wrenches in their contact frames.

    The moment at the centre of pressure (cx, cy, 0) is along the normal alone: cx = -m_y / f_z, cy = m_x / f_z and
    torque = m_z - (cx f_y - cy f_x).

    Args:
        force_C: (J, 3) forces in C [M g].
        moment_C: (J, 3) moments about the contact points, in C [M g m].
    """
    loaded = force_C[:, 2] > LEAST_LOAD
    fz = np.where(loaded, force_C[:, 2], 1.0)
    cop = np.where(loaded[:, None], np.stack([-moment_C[:, 1] / fz, moment_C[:, 0] / fz], axis=1), 0.0)
    torque = moment_C[:, 2] - (cop[:, 0] * force_C[:, 1] - cop[:, 1] * force_C[:, 0])
    return cop, torque
