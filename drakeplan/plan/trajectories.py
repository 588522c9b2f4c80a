"""What a plan says of every moment: contacts that may carry load, momentum and forces, configurations."""

from __future__ import annotations

import os
from dataclasses import dataclass

import numpy as np

from drakeplan.plan.arrays import Shape, freeze, last_before, require_same_length

BASE_POSITIONS = 7  # quaternion (w, x, y, z) and place of the floating base come first in q
BASE_VELOCITIES = 6  # angular and linear velocity of the floating base come first in v


@dataclass(frozen=True, eq=False)
class PlanPhases:
    """Stretches of time in which the set of contacts that may carry load is constant.

    Attributes:
        start: (P,) [s].
        end: (P,) [s], each the start of the next phase.
        contact: (P, E) index into the plan's contacts, -1 where the end effector is free.
    """

    start: np.ndarray
    end: np.ndarray
    contact: np.ndarray

    def __post_init__(self) -> None:
        freeze(self, "phases", floats={"start": (None,), "end": (None,)}, indices={"contact"})
        require_same_length(self, "phases", "start", "end", "contact")

    def __len__(self) -> int:
        return len(self.start)


@dataclass(frozen=True, eq=False)
class PlanCentroidal:
    """Momentum and contact forces. Row n of the forces acts over [t_n, t_n+1):

        l[n+1]   = l[n] + dt (sum_e f_e[n] + M g)
        com[n+1] = com[n] + dt l[n+1] / M
        k[n+1]   = k[n] + dt sum_e ((p_cop_e[n] - com[n+1]) x f_e[n] + torque_n_e[n] n_e)

    The last row of contact, force_W, cop_C and torque_n repeats the one before.

    Attributes:
        t: (N,) [s].
        com: (N, 3) centre of mass in W [m].
        linear_momentum: (N, 3) l in W [kg m/s].
        angular_momentum: (N, 3) k about the centre of mass, in W [kg m^2/s].
        contact: (N, E) index into the plan's contacts, -1 where the end effector carries nothing.
        force_W: (N, E, 3) force on the robot in W [N].
        cop_C: (N, E, 2) centre of pressure in the contact frame [m].
        torque_n: (N, E) torque on the robot about the contact normal at the centre of pressure [N m].
    """

    t: np.ndarray
    com: np.ndarray
    linear_momentum: np.ndarray
    angular_momentum: np.ndarray
    contact: np.ndarray
    force_W: np.ndarray
    cop_C: np.ndarray
    torque_n: np.ndarray

    def __post_init__(self) -> None:
        three = (None, 3)
        floats: dict[str, Shape] = {"t": (None,), "com": three, "linear_momentum": three, "angular_momentum": three}
        floats |= {"force_W": (None, None, 3), "cop_C": (None, None, 2), "torque_n": (None, None)}
        freeze(self, "centroidal", floats=floats, indices={"contact"})
        require_same_length(self, "centroidal", *floats, "contact")

    def __len__(self) -> int:
        return len(self.t)

    def com_at(self, t: np.ndarray | float) -> np.ndarray:
        """(..., 3) centre of mass at times t [m]: linear between knots, as the equations above have it."""
        return _linear(self.t, self.com, t)

    def momenta_at(self, t: np.ndarray | float) -> tuple[np.ndarray, np.ndarray]:
        """(..., 3) linear [kg m/s] and angular [kg m^2/s] momentum at times t, linear between knots."""
        return _linear(self.t, self.linear_momentum, t), _linear(self.t, self.angular_momentum, t)

    def forces_at(self, t: np.ndarray | float) -> np.ndarray:
        """(..., E, 3) forces on the robot at times t in W [N]: those of the last knot."""
        return self.force_W[last_before(self.t, t)]


@dataclass(frozen=True, eq=False)
class PlanMotion:
    """Whole-body configurations of the plant that `Parser().AddModels(robot_model)` alone gives.

    Attributes:
        t: (T,) [s].
        q: (T, nq) positions: base quaternion (w, x, y, z), base position [m], joints [rad].
        v: (T, nv) velocities: base angular [rad/s] and linear [m/s] in W, joints [rad/s].
        position_names: (nq,) as `MultibodyPlant.GetPositionNames` gives them.
        velocity_names: (nv,) as `MultibodyPlant.GetVelocityNames` gives them.
        tau: (T, A) torques of the actuators [N m]: inverse dynamics of q, v and the change of v to the next frame, under
            the planned contact forces. Row i acts over [t_i, t_i+1), the last repeats the one before. None in files of
            earlier releases.
        actuator_names: (A,) in the plant's order of actuators; () without `tau`.
    """

    t: np.ndarray
    q: np.ndarray
    v: np.ndarray
    position_names: tuple[str, ...]
    velocity_names: tuple[str, ...]
    tau: np.ndarray | None = None
    actuator_names: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        object.__setattr__(self, "position_names", tuple(self.position_names))
        object.__setattr__(self, "velocity_names", tuple(self.velocity_names))
        object.__setattr__(self, "actuator_names", tuple(self.actuator_names))
        widths: dict[str, Shape] = {"q": (None, len(self.position_names)), "v": (None, len(self.velocity_names))}
        if self.tau is not None:
            widths["tau"] = (None, len(self.actuator_names))
        freeze(self, "motion", floats={"t": (None,), **widths}, indices=set())
        require_same_length(self, "motion", "t", *widths)

    def __len__(self) -> int:
        return len(self.t)

    @property
    def joint_names(self) -> tuple[str, ...]:
        """(nq - 7,) names of the joints in the model, in the order of q[:, 7:] and v[:, 6:].

        Drake calls the position of joint `left_knee` of model `escher` `escher_left_knee_q`.
        """
        model = os.path.commonprefix(list(self.position_names)).rpartition("_")[0]  # noqa: RUF071 (letters, no paths)
        prefix = f"{model}_" if model else ""
        return tuple(name.removeprefix(prefix).rpartition("_")[0] for name in self.position_names[BASE_POSITIONS:])

    def at(self, t: float) -> tuple[np.ndarray, np.ndarray]:
        """(nq,) positions and (nv,) velocities at time t [s] between the first and the last frame.

        The base turns at constant rate from one frame to the next (slerp); all else is linear.
        """
        from scipy.spatial.transform import Rotation, Slerp  # 0.1 s, for whoever asks

        q, v = _linear(self.t, self.q, t), _linear(self.t, self.v, t)
        i = int(np.clip(last_before(self.t, t), 0, max(len(self) - 2, 0)))
        if i + 1 < len(self):
            turn = Slerp(self.t[i : i + 2], Rotation.from_quat(np.roll(self.q[i : i + 2, :4], -1, axis=1)))
            q[:4] = np.roll(turn(np.clip(t, *self.t[i : i + 2])).as_quat(), 1)
            q[:4] *= 1.0 if q[:4] @ self.q[i, :4] >= 0.0 else -1.0  # the sign is continuous from frame to frame
        return q, v


def _linear(times: np.ndarray, rows: np.ndarray, t: np.ndarray | float) -> np.ndarray:
    """Rows (N, n) at times t, linear in between: (..., n)."""
    return np.stack([np.interp(t, times, column) for column in rows.T], axis=-1)
