"""What of a plan is adapted to other terrain: its contacts and the key configurations between which they are made.

Dynamics and the rest of the motion are made anew once the contacts have a place.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial.transform import Rotation

from drakeplan.plan.plan import Plan, PlanMotion, PlanPhases
from scenes.contact import Contact, contact_heading
from scenes.effector import is_foot
from scenes.input_error import InputError

PER_PHASE = 3  # configurations of each phase; more make the elastic strip slower and no better
MAX_PER_PHASE = 10


@dataclass(frozen=True, eq=False)
class KeyMotion:
    """A contact sequence with N configurations of the motion through it.

    Attributes:
        contacts: (C) in order of appearance.
        stances: (S, 4) index into `contacts`, -1 where free.
        phases: (P, 4) the same for each stretch of time in which what carries is constant.
        t: (N,) [s], ascending.
        q: (N, nq) configurations in the plant's order: base quaternion (w, x, y, z), base position [m], joints [rad].
        phase: (N,) index into `phases`.
        share: (N,) how far along its phase each configuration is, 0 to 1; 0 at a boundary.
    """

    contacts: tuple[Contact, ...]
    stances: np.ndarray
    phases: np.ndarray
    t: np.ndarray
    q: np.ndarray
    phase: np.ndarray
    share: np.ndarray

    def carries_alone(self) -> np.ndarray:
        """(C,) bool, which contacts carry the robot alone in some phase."""
        alone = np.zeros(len(self.contacts), dtype=bool)
        for row in self.phases:
            held = row[row >= 0]
            if len(held) == 1:
                alone[held[0]] = True
        return alone

    def feet_means(self) -> np.ndarray:
        """(S, 3) mean of the feet in each stance [m]."""
        points = np.array([c.p_WC for c in self.contacts])
        return points[self.stances[:, :2]].mean(axis=1)

    def placed(self, X_WL: np.ndarray) -> KeyMotion:
        """The same motion moved as one rigid body.

        Args:
            X_WL: (4, 4) pose of the frame that it is given in so far; a turn about z and a shift.
        """
        q = self.q.copy()
        turned = Rotation.from_matrix(X_WL[:3, :3]) * Rotation.from_quat(q[:, [1, 2, 3, 0]])  # SciPy: x y z w
        q[:, :4] = turned.as_quat()[:, [3, 0, 1, 2]]
        q[:, 4:7] = q[:, 4:7] @ X_WL[:3, :3].T + X_WL[:3, 3]
        contacts = tuple(_moved(contact, X_WL) for contact in self.contacts)
        return replace(self, contacts=contacts, q=q)

    def until(self, stance: int) -> KeyMotion:
        """The part of the motion that ends in this stance.

        Args:
            stance: index into `stances`, 1 or more.
        """
        if stance >= len(self.stances) - 1:
            return self
        reached, last = 0, len(self.phases) - 1
        for p, row in enumerate(self.phases):
            while reached < stance and np.array_equal(row, self.stances[reached + 1]):
                reached += 1
            if reached == stance:
                last = p
                break
        keep = self.phase <= last
        used = int(self.stances[: stance + 1].max()) + 1  # contacts are in order of appearance
        phases = self.phases[: last + 1]
        return KeyMotion(
            self.contacts[:used],
            self.stances[: stance + 1],
            np.where(phases < used, phases, -1),
            self.t[keep],
            self.q[keep],
            self.phase[keep],
            self.share[keep],
        )


def _moved(contact: Contact, X_WL: np.ndarray) -> Contact:
    X_WC = X_WL @ contact.X_WC
    heading = contact_heading(X_WC) if is_foot(contact.effector) else float(np.arctan2(X_WC[1, 0], X_WC[0, 0]))
    return replace(contact, X_WC=X_WC, heading=heading)


def complete_parts(plan: Plan) -> tuple[PlanPhases, PlanMotion]:
    """Phases and motion of a complete plan.

    Raises:
        InputError: the plan has none.
    """
    if plan.phases is None or plan.motion is None:
        raise InputError(f"expected a complete plan, the one of {plan.scene_name!r} has no motion")
    return plan.phases, plan.motion


def key_motion(plan: Plan, per_phase: int = PER_PHASE) -> KeyMotion:
    """Contacts and key configurations of a complete plan.

    Args:
        plan: complete, with phases and motion.
        per_phase: configurations of each phase, its start among them; 1 to `MAX_PER_PHASE`.

    Raises:
        InputError: the plan has no motion.
    """
    phases, motion = complete_parts(plan)
    frames: list[int] = []
    phase: list[int] = []
    share: list[float] = []
    for p, (start, end) in enumerate(zip(phases.start, phases.end, strict=True)):
        for i in range(per_phase):
            frame = int(np.argmin(np.abs(motion.t - (start + (end - start) * i / per_phase))))
            if not frames or frame > frames[-1]:
                frames.append(frame)
                phase.append(p)
                share.append(i / per_phase)
    if len(motion.t) - 1 > frames[-1]:
        frames, phase, share = [*frames, len(motion.t) - 1], [*phase, len(phases) - 1], [*share, 0.0]
    contacts = tuple(plan.contact(c) for c in range(len(plan.contacts)))
    where = np.array(frames)
    return KeyMotion(
        contacts, plan.stances, phases.contact, motion.t[where], motion.q[where], np.array(phase), np.array(share)
    )
