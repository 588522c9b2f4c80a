"""The numbers of one query while it runs: results with their times, and the time of each step."""

from __future__ import annotations

import dataclasses
import resource
import time
from dataclasses import dataclass, field

from drakeplan.deadline import compile_clock
from drakeplan.verifier import Report


@dataclass
class SearchClock:
    """Seconds of search: stands still while something else is done."""

    _offset: float = 0.0
    _paused_at: float | None = None

    def __call__(self) -> float:
        return (self._paused_at if self._paused_at is not None else time.perf_counter()) - self._offset

    def pause(self) -> None:
        """Stops the clock."""
        self._paused_at = time.perf_counter()

    def resume(self) -> None:
        """Lets it run on from where it stood."""
        if self._paused_at is not None:
            self._offset += time.perf_counter() - self._paused_at
            self._paused_at = None


@dataclass
class QueryRecord:
    """What `drakeplan plan --json` reports.

    Attributes:
        began: by the system's clock [s].
        planner: that was asked last.
        dynamics: what the search asked of transitions; "" for planners with dynamics of their own.
        cost, bound: of the contact sequence that was chosen.
        contacts, stances, palms_used: its size.
        adapted_from: stored plans that it comes from, by name.
        guide: segments of the guiding path that it follows; see `ContactPlan.guide`.
        predicted_success: probability that no push fells the robot, as the search saw it; None where it did not ask.
        expansions: of all rounds of search.
        time_to_first_s: seconds of search until the first contact sequence.
        time_to_first_feasible_s: and until one was known to be dynamically feasible, its program included.
        sequences_tested: contact sequences whose whole dynamics were solved before the motion stage.
        transitions_judged: transitions whose dynamics were evaluated, by "learned" and "exact".
        planning_s, dynamics_s, motion_s, verification_s: where the time went.
        simulation_s: seconds of playing plans in physics.
        simulated: what came of the last one; None where none was played.
        torque: greatest share of a joint's torque limit that the motion needs, its joint and time [s]; None without one.
        repairs: times that a refused transition was forbidden and the search resumed.
        limits_fired: by name.
        notes: what was done otherwise than asked, one line each.
        start: mean of the feet at the start [m], at the height of the floor that was taken.
        goal: middle of the goal [m], the same.
    """

    began: float = field(default_factory=time.perf_counter)
    planner: str = ""
    dynamics: str = ""
    cost: float | None = None
    bound: float | None = None
    contacts: int = 0
    stances: int = 0
    palms_used: int = 0
    adapted_from: list[str] = field(default_factory=list)
    guide: list[dict[str, object]] = field(default_factory=list)
    predicted_success: float | None = None
    expansions: int = 0
    time_to_first_s: float | None = None
    time_to_first_feasible_s: float | None = None
    sequences_tested: int = 0
    transitions_judged: dict[str, int] = field(default_factory=dict)
    planning_s: float = 0.0
    dynamics_s: float = 0.0
    motion_s: float = 0.0
    verification_s: float = 0.0
    simulation_s: float = 0.0
    simulated: dict[str, object] | None = None
    torque: dict[str, float | str] | None = None
    repairs: int = 0
    limits_fired: list[str] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)
    start: list[float] | None = None
    goal: list[float] | None = None

    def as_dict(self, status: str, reason: str, verification: Report | None) -> dict[str, object]:
        """The report: these numbers with status, reason and the result of the verification.

        Args:
            status: of the query's result.
            reason: one line; "" when complete.
            verification: the verifier's report; None where it did not run.
        """
        values = {f.name: getattr(self, f.name) for f in dataclasses.fields(self) if f.name != "began"}
        failed = [] if verification is None else [c.name for c in verification.checks if not c.ok]
        verified = verification is not None and verification.holds
        return {
            "status": status,
            "reason": reason,
            **values,
            "compile_s": compile_clock.seconds(),  # outside the deadline
            "total_s": time.perf_counter() - self.began,
            "peak_rss_mb": resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024.0,
            "verified": {"holds": verified, "failed": failed},
        }
