"""The result of a query."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Literal, get_args

from drakeplan.contact_planning.reachability import UNREACHABLE
from drakeplan.plan.plan import Plan
from drakeplan.query.explanation import Explanation
from drakeplan.query.refusal import Refusal
from drakeplan.verifier import Report

Status = Literal["none", "contacts", "complete"]  # in ascending order


@dataclass(frozen=True)
class PlanResult:
    """The result of a query.

    Attributes:
        status: "complete" (the verifier holds), "contacts" (a contact sequence without a verified motion) or "none".
        reason: one line; "" when complete.
        plan: None when there is none.
        report: numbers for people and programs, as JSON allows.
        verification: the verifier's report on the complete plan, else None.
        notes: where the query deviated from its options, one line each.
        refusal: the contact sequence that was refused last, and why; None where none was.
        explanation: why its dynamics are infeasible, where that was asked for and is so.
    """

    status: Status
    reason: str
    plan: Plan | None = field(repr=False)
    report: dict[str, object] = field(repr=False)
    verification: Report | None = field(default=None, repr=False)
    notes: tuple[str, ...] = ()
    refusal: Refusal | None = field(default=None, repr=False)
    explanation: Explanation | None = None

    @property
    def rank(self) -> int:
        """The more, the better: 0 for nothing, 1 for contacts, 2 for a verified plan."""
        return get_args(Status).index(self.status)

    @property
    def hopeless(self) -> bool:
        """Whether every transition failed for one cause, so that other contacts of the same kind would not help."""
        return self.refusal is not None and self.refusal.motion is not None and self.refusal.motion.alike

    @property
    def proved(self) -> bool:
        """Whether the goal is proved to be unreachable, so that no other search can find a way."""
        return self.status == "none" and self.reason.startswith(UNREACHABLE)
