"""All that a plan says, at the instants of its motion."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from drakeplan.plan.arrays import last_before
from drakeplan.plan.plan import Plan, PlanContacts, PlanMotion
from scenes.input_error import InputError

BASE_POSITIONS, BASE_VELOCITIES = 7, 6  # of a base that floats: quaternion and position; angular and linear velocity
BASE_ENDS = ["qw", "qx", "qy", "qz", "x", "y", "z"]


@dataclass(frozen=True, eq=False)
class MotionSamples:
    """A motion with its momenta and forces at T instants. W is the world, C a contact's frame.

    Attributes:
        t: (T,) [s].
        base_name: the floating body, as the robot's model has it.
        base_position: (T, 3) in W [m].
        base_quaternion: (T, 4) w, x, y, z of the base in W.
        base_angular_velocity: (T, 3) in W [rad/s].
        base_linear_velocity: (T, 3) in W [m/s].
        joint_names: (J,) in the order of Drake's positions.
        joint_position: (T, J) [rad], of sliding joints [m].
        joint_velocity: (T, J) [rad/s], [m/s].
        joint_torque: (T, J) [N m], [N]; 0 where a joint has no motor; None where the plan has no torques.
        com: (T, 3) centre of mass in W [m], linear between the plan's knots.
        linear_momentum: (T, 3) in W [kg m/s], linear between knots.
        angular_momentum: (T, 3) about the centre of mass in W [kg m^2/s], linear between knots.
        contact: (T, E) row of the plan's contacts, -1 where the end effector carries nothing; held from knot to knot,
            and so are the forces.
        force: (T, E, 3) on the robot in W [N].
        cop: (T, E, 3) centre of pressure in W [m], NaN without contact.
        cop_C: (T, E, 2) the same in the contact's frame [m].
        torque_n: (T, E) torque on the robot about the contact's normal at the centre of pressure [N m].
    """

    t: np.ndarray
    base_name: str
    base_position: np.ndarray
    base_quaternion: np.ndarray
    base_angular_velocity: np.ndarray
    base_linear_velocity: np.ndarray
    joint_names: tuple[str, ...]
    joint_position: np.ndarray
    joint_velocity: np.ndarray
    joint_torque: np.ndarray | None
    com: np.ndarray
    linear_momentum: np.ndarray
    angular_momentum: np.ndarray
    contact: np.ndarray
    force: np.ndarray
    cop: np.ndarray
    cop_C: np.ndarray
    torque_n: np.ndarray

    def moved(self, offset: np.ndarray) -> MotionSamples:
        """The same with `offset` (3,) [m] added to every point."""
        points = {key: getattr(self, key) + offset for key in ("base_position", "com", "cop")}
        return replace(self, **points)

    def base_acceleration(self) -> tuple[np.ndarray, np.ndarray]:
        """(T, 3) angular [rad/s^2] and (T, 3) linear [m/s^2] acceleration of the base in W, from each sample to the next."""
        return forward_rate(self.t, self.base_angular_velocity), forward_rate(self.t, self.base_linear_velocity)

    def joint_acceleration(self) -> np.ndarray:
        """(T, J) [rad/s^2], [m/s^2] from each sample to the next."""
        return forward_rate(self.t, self.joint_velocity)


def forward_rate(t: np.ndarray, values: np.ndarray) -> np.ndarray:
    """(T, n) change of values per second from each sample to the next; the last repeats the one before.

    Args:
        t: (T,) [s], growing.
        values: (T, n).
    """
    if len(t) < 2:
        return np.zeros_like(values)
    rate = np.diff(values, axis=0) / np.diff(t)[:, None]
    return np.vstack([rate, rate[-1:]])


def sample_motion(plan: Plan) -> MotionSamples:
    """A complete plan at the instants of its motion.

    Raises:
        InputError: the motion's names are not those of a floating base with joints of one degree of freedom, or its times
            do not grow.
    """
    motion, course = plan.motion, plan.centroidal
    if motion is None or course is None or not len(motion) or not len(course):
        raise InputError("the plan has no motion")
    if (np.diff(motion.t) <= 0.0).any() or (np.diff(course.t) <= 0.0).any():
        raise InputError("the plan's times do not grow: motion/t and centroidal/t")
    names = motion.joint_names
    held = last_before(course.t, motion.t)
    contact = course.contact[held]
    linear_momentum, angular_momentum = course.momenta_at(motion.t)
    return MotionSamples(
        t=motion.t,
        base_name=_base_name(motion),
        base_position=motion.q[:, 4:7],
        base_quaternion=motion.q[:, :4],
        base_angular_velocity=motion.v[:, :3],
        base_linear_velocity=motion.v[:, 3:6],
        joint_names=names,
        joint_position=motion.q[:, BASE_POSITIONS:],
        joint_velocity=motion.v[:, BASE_VELOCITIES:],
        joint_torque=_torques(motion, names),
        com=course.com_at(motion.t),
        linear_momentum=linear_momentum,
        angular_momentum=angular_momentum,
        contact=contact,
        force=course.force_W[held],
        cop=pressure_points(plan.contacts, contact, course.cop_C[held]),
        cop_C=course.cop_C[held],
        torque_n=course.torque_n[held],
    )


def pressure_points(contacts: PlanContacts, contact: np.ndarray, cop_C: np.ndarray) -> np.ndarray:
    """(T, E, 3) centres of pressure in W [m], NaN without contact.

    Args:
        contacts: of the plan.
        contact: (T, E) rows of them, -1 without.
        cop_C: (T, E, 2) in each contact's frame [m].
    """
    points = np.full((*contact.shape, 3), np.nan)
    held = contact >= 0
    X_WC = contacts.X_WC[contact[held]]
    points[held] = X_WC[:, :3, 3] + np.einsum("kij,kj->ki", X_WC[:, :3, :2], cop_C[held])
    return points


def _base_name(motion: PlanMotion) -> str:
    """The floating body, as the robot's model has it; Drake calls its positions `<model>_<body>_qw` and so on."""
    positions, velocities = motion.position_names, motion.velocity_names
    base = {name.rpartition("_")[0] for name in positions[:BASE_POSITIONS]}
    ends = [name.rpartition("_")[2] for name in positions[:BASE_POSITIONS]]
    joints = [name.rpartition("_")[0] for name in positions[BASE_POSITIONS:]]
    moving = [name.rpartition("_")[0] for name in velocities[BASE_VELOCITIES:]]
    if ends != BASE_ENDS or len(base) != 1 or joints != moving:
        raise InputError(
            "motion: expected positions of a floating base (quaternion, position) and of joints with one degree of freedom, "
            f"got {', '.join(positions[:8])}, ..."
        )
    model = joints[0].removesuffix(motion.joint_names[0]) if joints else ""
    return base.pop().removeprefix(model)


def _torques(motion: PlanMotion, names: tuple[str, ...]) -> np.ndarray | None:
    """(T, J) torques in the joints' order, None where the plan has none or an actuator's joint cannot be told."""
    if motion.tau is None or not set(motion.actuator_names) <= set(names):
        return None
    torque = np.zeros((len(motion), len(names)))
    torque[:, [names.index(name) for name in motion.actuator_names]] = motion.tau
    return torque
