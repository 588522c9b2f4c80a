"""Whether a capture motion holds, judged from its configurations and forces alone, and where it fails first.

Nothing that the solvers say of themselves is used: poses, momenta and speeds are computed again.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from optimization.capture.question import CaptureQuestion
from optimization.centroidal.check import violations
from optimization.centroidal.contact_schedule import ContactSchedule
from optimization.centroidal.options import CentroidalOptions
from optimization.centroidal.problem import CentroidalProblem
from optimization.centroidal.trajectory import CentroidalTrajectory
from optimization.kinodynamic.joint_torques import TorqueRows
from optimization.kinodynamic.momentum_gap import Gap, MomentumGap
from optimization.multibody.kinematics import Kinematics
from scenes.effector import EFFECTORS

CONTACT, ANGLE = 5e-3, np.deg2rad(1.0)  # [m, rad] that a held end effector may be off its contact
LIMIT = 1e-6  # [rad] beyond a joint's limit
SPEED, TORQUE = 1.0 + 1e-3, 1.0 + 1e-3  # of a joint's limits
REST_LINEAR, REST_ANGULAR = 2.0, 2.0  # [kg m/s, N m s] momenta of the motion that count as rest at the end


@dataclass(frozen=True)
class Fault:
    """What fails, where in time.

    Attributes:
        block: the constraint.
        detail: by how much, in words.
        time: when, since the push [s].
    """

    block: str
    detail: str
    time: float

    def told(self, question: CaptureQuestion, swing_time: float) -> str:
        """One line that names the phase, the block and the amount.

        Args:
            question: that the fault belongs to.
            swing_time: time of the swing [s], 0 where there is none.
        """
        phase = "standing"
        if question.new_contact is not None:
            effector = EFFECTORS[question.moving]
            phase = f"swing of {effector}" if self.time < swing_time - 1e-9 else f"after contact of {effector}"
        return f"{phase}, {self.time:.2f} s: {self.block} {self.detail}".rstrip()


def dynamics_faults(
    problem: CentroidalProblem, options: CentroidalOptions, trajectory: CentroidalTrajectory
) -> list[Fault]:
    """What of the centroidal problem a trajectory breaks, the worst first.

    Args:
        problem: the centroidal problem, in SI.
        options: its limits and cone.
        trajectory: to check.
    """
    found = violations(problem, options, trajectory)
    faults = []
    for v in found:
        who = f" of {v.effector}" if v.effector else ""
        amount = f"exceeded by {v.amount:.3g} {v.unit}" if np.isfinite(v.amount) else "left"
        faults.append(Fault(f"{v.block}{who}", amount, v.time))
    return faults


def motion_faults(
    kinematics: Kinematics,
    schedule: ContactSchedule,
    trajectory: CentroidalTrajectory,
    q: np.ndarray,
    agreement: MomentumGap,
) -> list[Fault]:
    """What a motion q (N, nq) breaks: contacts, joint limits, speeds, momenta, rest at the end; in this order.

    Args:
        kinematics: frames in the order of `EFFECTORS`.
        schedule: contacts at the knots.
        trajectory: the momenta that it should bring about.
        q: configurations at the knots.
        agreement: how far the momenta may be off.
    """
    t = schedule.times
    if q.shape != (len(t), kinematics.num_positions) or not np.isfinite(q).all():
        return [Fault("motion", "is not there or not finite", 0.0)]
    tree = kinematics.tree
    v = np.array([kinematics.difference(a, b) for a, b in pairwise(q)]) / schedule.dt[:, None]
    faults = _contact_faults(kinematics, schedule, q)
    beyond = np.maximum(tree.lower - q[:, 7:], q[:, 7:] - tree.upper)
    n, j = np.unravel_index(int(beyond.argmax()), beyond.shape)
    if beyond[n, j] > LIMIT:
        faults.append(Fault(f"limit of {kinematics.joint_names[j]}", f"exceeded by {beyond[n, j]:.3g} rad", t[n]))
    share = np.abs(v[:, 6:]) / tree.speed
    n, j = np.unravel_index(int(share.argmax()), share.shape)
    if share[n, j] > SPEED:
        faults.append(Fault(f"speed of {kinematics.joint_names[j]}", f"at {share[n, j]:.2f} of its limit", t[n]))
    return faults + _momentum_faults(kinematics, schedule, trajectory, q, v, agreement)


def torque_fault(
    kinematics: Kinematics,
    problem: CentroidalProblem,
    trajectory: CentroidalTrajectory,
    q: np.ndarray,
    v_start: np.ndarray,
    effort: np.ndarray,
) -> Fault | None:
    """The joint that must push hardest beyond its limit to bring a motion about under these forces, None where none must.

    Args:
        kinematics: frames in the order of `EFFECTORS`.
        problem: contacts and mass.
        trajectory: the contact forces.
        q: (N, nq) configurations at the knots.
        v_start: (nv,) velocity at the first one.
        effort: (nv - 6,) limits [N m]; inf where there is none.
    """
    schedule = problem.schedule
    v = np.array([kinematics.difference(a, b) for a, b in pairwise(q)]) / schedule.dt[:, None]
    rows = TorqueRows(kinematics, problem, effort, q, np.vstack([v_start, v]))
    share = np.abs(rows.torques(trajectory)) / effort
    n, j = np.unravel_index(int(share.argmax()), share.shape)
    if share[n, j] <= TORQUE:
        return None
    return Fault(f"torque of {kinematics.joint_names[j]}", f"at {share[n, j]:.2f} of its limit", schedule.times[n])


def _contact_faults(kinematics: Kinematics, schedule: ContactSchedule, q: np.ndarray) -> list[Fault]:
    """Held end effectors off their contacts; a contact is held at both ends of every interval that it is active in."""
    p_WC, R_WC, _ = schedule.poses()
    place, turn = np.zeros(schedule.active.shape), np.zeros(schedule.active.shape)
    poses = np.array([kinematics.effector_poses(row) for row in q])[:, : len(EFFECTORS)]
    n, e = np.nonzero(schedule.active >= 0)
    c = schedule.active[n, e]
    for at in (n, n + 1):
        X = poses[at, e]
        away = np.linalg.norm(X[:, :3, 3] - p_WC[c], axis=1)
        cosine = (np.einsum("kab,kab->k", X[:, :3, :3], R_WC[c]) - 1.0) / 2.0
        place[n, e] = np.maximum(place[n, e], away)
        turn[n, e] = np.maximum(turn[n, e], np.arccos(np.clip(cosine, -1.0, 1.0)))
    faults = []
    for error, limit, words in (
        (place, CONTACT, lambda x: f"off by {1e3 * x:.1f} mm"),
        (turn, ANGLE, lambda x: f"turned by {np.rad2deg(x):.1f} deg"),
    ):
        n, e = np.unravel_index(int(error.argmax()), error.shape)
        if error[n, e] > limit:
            faults.append(Fault(f"contact of {EFFECTORS[e]}", words(error[n, e]), schedule.times[n]))
    return faults


def _momentum_faults(
    kinematics: Kinematics,
    schedule: ContactSchedule,
    trajectory: CentroidalTrajectory,
    q: np.ndarray,
    v: np.ndarray,
    agreement: MomentumGap,
) -> list[Fault]:
    """Momenta that are not those of the forces, from each knot to the next, and motion that is left at the end."""
    mass = kinematics.total_mass
    com = np.array([kinematics.com(row) for row in q])
    matrices = np.array([kinematics.momentum_matrix(row)[:3] for row in q])
    linear = mass * np.diff(com, axis=0) / schedule.dt[:, None]
    angular = np.einsum("nai,ni->na", (matrices[:-1] + matrices[1:]) / 2, v)
    faults = []
    for block, off, limit, scale, unit in (
        ("CoM", com[1:] - trajectory.com[1:], agreement.com, 1e3, "mm"),
        ("linear momentum", linear - trajectory.linear_momentum[1:], agreement.linear, 1.0, "kg m/s"),
        ("angular momentum", angular - trajectory.angular_momentum[1:], agreement.angular, 1.0, "N m s"),
    ):
        gap = Gap.of(off)
        if not gap.within(limit):
            n = int(np.linalg.norm(off, axis=1).argmax())
            detail = (
                f"of motion and forces differ by {scale * gap.rms:.1f} {unit} rms, {scale * gap.worst:.1f} at worst"
            )
            faults.append(Fault(block, detail, schedule.times[n]))
    for block, left, limit, unit in (
        ("linear momentum", float(np.linalg.norm(linear[-1])), REST_LINEAR, "kg m/s"),
        ("angular momentum", float(np.linalg.norm(angular[-1])), REST_ANGULAR, "N m s"),
    ):
        if left > limit:
            faults.append(Fault(block, f"of {left:.1f} {unit} left at the end", schedule.times[-1]))
    return faults
