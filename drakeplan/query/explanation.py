"""Why the dynamics of a contact sequence are infeasible, and which change would make them feasible."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass

from drakeplan.contact_planning.sequence_dynamics import sequence_problem
from drakeplan.context import QueryContext
from drakeplan.timing.step_timing import Timing
from optimization.centroidal.remedies import InfeasibilityReport, unblock
from scenes.stance import Stance

TIME_LIMIT = 30.0  # [s]


@dataclass(frozen=True)
class Explanation:
    """Why the dynamics of a contact sequence are infeasible, from the least relaxation of its centroidal program.

    Attributes:
        stances: of the sequence.
        refused: why the query refused it.
        found: blockages and remedies; `feasible` where the sequence itself has dynamics and the motion asks for more.
    """

    stances: int
    refused: str
    found: InfeasibilityReport

    def lines(self) -> list[str]:
        """Lines to read: where the sequence is blocked, and each change that makes it feasible."""
        head = f"dynamics of the whole sequence ({self.stances} stances)"
        if self.found.feasible:
            return [f"{head}: feasible by themselves; the motion asks for more: {self.refused}"]
        lines = [f"{head}: infeasible"]
        lines += [f"  blocked: {self.found.flight}"] if self.found.flight else []
        lines += [f"  blocked: {blockage}" for blockage in self.found.blockages]
        lines += [f"  enough: {remedy}" for remedy in self.found.remedies]
        if not self.found.remedies:
            lines.append("  no change that was tried is enough")
        if not self.found.complete:
            lines.append(
                f"  the search for changes stopped after {self.found.solves} programs; there may be smaller ones"
            )
        return lines

    def as_dict(self) -> dict[str, object]:
        """The same as plain data for JSON."""
        return {"stances": self.stances, "refused": self.refused, **asdict(self.found), "lines": self.lines()}


def explain_sequence(context: QueryContext, stances: Sequence[Stance], timing: Timing, refused: str) -> Explanation:
    """Finds why the centroidal program of a whole contact sequence is infeasible, and which changes make it feasible.

    Args:
        context: robot and friction cone.
        stances: consecutive ones differ in one end effector.
        timing: of every transition.
        refused: why the query refused it.
    """
    problem = sequence_problem(context.robot, stances, timing)
    options = timing.options(context.robot, context.cone, rest_at_end=True, reserve=context.reserve)
    return Explanation(len(stances), refused, unblock(problem, options, time_limit=TIME_LIMIT))
