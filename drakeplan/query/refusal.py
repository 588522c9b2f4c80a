"""Why a contact sequence did not become a verified plan, and which of its transitions to forbid."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

import numpy as np

from drakeplan.contact_planning.contact_plan import ContactPlan
from drakeplan.motion.maker import MotionResult
from drakeplan.verifier import Report

if TYPE_CHECKING:
    from drakeplan.execution import ExecutionReport


@dataclass(frozen=True, eq=False)
class Refusal:
    """A contact sequence and the step of the query that refused it.

    Attributes:
        step: "dynamics" of the whole sequence, "motion", "verification" or "execution" in physics.
        reason: one line.
        sequence: what was refused.
        motion: how far the motion got; None where it was not tried.
        verification: the verifier's report; None where it was not asked.
        fell_at: plan time at which the robot fell in physics [s]; None where it did not.
    """

    step: Literal["dynamics", "motion", "verification", "execution"]
    reason: str
    sequence: ContactPlan
    motion: MotionResult | None = None
    verification: Report | None = None
    fell_at: float | None = None

    @staticmethod
    def of_execution(
        sequence: ContactPlan, motion: MotionResult, verification: Report, played: ExecutionReport
    ) -> Refusal:
        """The refusal of a verified plan by physics.

        Args:
            sequence: contacts.
            motion: what was made of them.
            verification: the verifier's report.
            played: what came of playing it.
        """
        reason = f"played in physics it failed at {played.at_plan_s:.1f} s: {played.reason}"
        return Refusal("execution", reason, sequence, motion, verification, played.at_plan_s)

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
        if self.fell_at is not None:
            at.add(self._fault(self.fell_at))
        for problem in self.motion.problems:
            phase = int(self.motion.schedule.phase_at(np.array([problem.time]))[0])
            at.add(self._fault(problem.time))
            if phase % 2 == 0:
                at.discard(problem.transition)
        return sorted(k for k in at if 0 <= k < len(self.sequence.stances) - 1)

    def _fault(self, time: float) -> int:
        """The transition at fault for what goes wrong at this time of the plan [s]."""
        assert self.motion is not None
        phase = int(self.motion.schedule.phase_at(np.array([time]))[0])
        return phase // 2 if phase % 2 else phase // 2 - 1
