"""Why a contact sequence did not become a verified plan, and which of its transitions to forbid."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from drakeplan.contact_planning.contact_plan import ContactPlan
from drakeplan.motion.maker import MotionResult
from drakeplan.verifier import Report


@dataclass(frozen=True, eq=False)
class Refusal:
    """A contact sequence and the step of the query that refused it.

    Attributes:
        step: "dynamics" of the whole sequence, "motion" or "verification".
        reason: one line.
        sequence: what was refused.
        motion: how far the motion got; None where it was not tried.
        verification: the verifier's report; None where it was not asked.
    """

    step: Literal["dynamics", "motion", "verification"]
    reason: str
    sequence: ContactPlan
    motion: MotionResult | None = None
    verification: Report | None = None

    @staticmethod
    def of_motion(sequence: ContactPlan, motion: MotionResult, verification: Report | None) -> Refusal:
        """The refusal of a motion: by the verifier where the motion stage reported nothing against it.

        Args:
            sequence: contacts.
            motion: what was made of them.
            verification: the verifier's report; None where it was not asked.
        """
        if motion.ok and verification is not None:
            reason = f"verification failed: {', '.join(verification.failed)}"
            return Refusal("verification", reason, sequence, motion, verification)
        return Refusal("motion", motion.reason, sequence, motion, verification)

    @property
    def without_dynamics(self) -> bool:
        """Whether no momentum trajectory came of the sequence."""
        return self.step == "dynamics" or (self.motion is not None and self.motion.centroidal is None)

    def transitions(self) -> list[int]:
        """Transitions to forbid, ascending; empty where none can be named.

        A swing that fails forbids its own transition. What fails while all contacts of a stance are held is that stance's
        fault, so the transition that led to it is forbidden.
        """
        if self.motion is None:
            return []
        at = set(self.motion.failed_transitions)
        for problem in self.motion.problems:
            phase = int(self.motion.schedule.phase_at(np.array([problem.time]))[0])
            at.add(phase // 2 if phase % 2 else phase // 2 - 1)
            if phase % 2 == 0:
                at.discard(problem.transition)
        return sorted(k for k in at if 0 <= k < len(self.sequence.stances) - 1)
