"""What came of a plan that was played in physics."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np


@dataclass(frozen=True, eq=False)
class ExecutionReport:
    """One run.

    Attributes:
        reached: whether the robot stands at the goal at the end.
        reason: why not, one line; "" where it does.
        fell_at_s: when it fell or the simulation ended early [s of simulated time]; None where it did not.
        at_plan_s: how far the plan was played [s of plan time].
        plan_s: length of the plan [s].
        simulated_s: length of the run [s].
        real_time_factor: seconds simulated in a second.
        goal_distance_m: of the mean of the feet from the goal at the end; None for a plan without one.
        slips_m: greatest slip of a contact, by end effector.
        com_error_m: greatest distance of the CoM from the plan's.
        torque_share: greatest share of a torque limit that was used.
        saturated_share: share of the time in which a torque was at its limit.
        late_touches: how long the plan waited for each touch that came late [s].
        early_touches: how many contacts came before their phase ended.
        collisions: pairs of bodies that touched and should not, with the number of control steps.
        programs_failed: control steps without an answer.
        notes: what the simulation leaves out, one line each.
        plan_time: (T,) plan time of the recorded states [s].
        q: (T, nq) recorded configurations.
    """

    reached: bool
    reason: str
    fell_at_s: float | None
    at_plan_s: float
    plan_s: float
    simulated_s: float
    real_time_factor: float
    goal_distance_m: float | None
    slips_m: dict[str, float]
    com_error_m: float
    torque_share: float
    saturated_share: float
    late_touches: tuple[float, ...]
    early_touches: int
    collisions: dict[str, int]
    programs_failed: int
    notes: tuple[str, ...] = ()
    plan_time: np.ndarray = field(default_factory=lambda: np.zeros(0))
    q: np.ndarray = field(default_factory=lambda: np.zeros((0, 0)))

    def as_dict(self) -> dict[str, object]:
        """Plain data for JSON, without the recorded states."""
        return {
            "reached": self.reached,
            "reason": self.reason,
            "fell_at_s": self.fell_at_s,
            "at_plan_s": self.at_plan_s,
            "plan_s": self.plan_s,
            "simulated_s": self.simulated_s,
            "real_time_factor": self.real_time_factor,
            "goal_distance_m": self.goal_distance_m,
            "slips": self.slips_m,
            "com_error_m": self.com_error_m,
            "torque_share": self.torque_share,
            "saturated_share": self.saturated_share,
            "late_touches_s": list(self.late_touches),
            "early_touches": self.early_touches,
            "collisions": self.collisions,
            "programs_failed": self.programs_failed,
            "notes": list(self.notes),
        }

    def text(self) -> str:
        """A few lines for people."""
        if self.reached:
            state = "the robot stands at the goal"
        elif self.fell_at_s is not None:
            state = f"it fell after {self.fell_at_s:.2f} s, at {self.at_plan_s:.2f} s of the plan: {self.reason}"
        else:
            state = self.reason
        slips = ", ".join(f"{name} {1e3 * slip:.0f} mm" for name, slip in self.slips_m.items() if slip > 0.0)
        lines = [
            state,
            f"  simulated {self.simulated_s:.1f} s for {self.plan_s:.1f} s of the plan, "
            f"{self.real_time_factor:.2f} times as fast as real time",
            f"  CoM at most {1e3 * self.com_error_m:.0f} mm from the plan; slips: {slips or 'none'}",
            f"  torques up to {100 * self.torque_share:.0f} % of a limit, at it in {100 * self.saturated_share:.1f} % of the time",
            f"  {self.early_touches} touches before their phase ended, {len(self.late_touches)} after it"
            + (f" (up to {max(self.late_touches):.2f} s)" if self.late_touches else ""),
        ]
        if self.collisions:
            lines.append(
                "  touched and should not: " + ", ".join(f"{k} ({n} steps)" for k, n in self.collisions.items())
            )
        if self.programs_failed:
            lines.append(f"  {self.programs_failed} control steps without an answer")
        return "\n".join(lines + [f"  note: {note}" for note in self.notes])
