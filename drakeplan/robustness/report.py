"""What pushes do to a plan: its probability of arriving, and its weakest moments (Lin 2020 sec. 7.8)."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from drakeplan.plan.plan import PlanRobustness
from drakeplan.robustness.moments import Moment
from drakeplan.robustness.push_trial import CATCHES, FALLS, STANDS
from scenes.effector import EFFECTORS, is_foot

UNTRIED = -1
CONFIDENCE = 1.96  # standard deviations of the interval
WEAKEST = 3  # stretches of time that are named


@dataclass(frozen=True, eq=False)
class Stretch:
    """Moments in a row with the same contacts.

    Attributes:
        start, end: [s].
        swing: whether a foot is in the air.
        tried: pushes.
        fell: of them.
        risk: probability of a fall within it.
        words: what is held, for people.
    """

    start: float
    end: float
    swing: bool
    tried: int
    fell: int
    risk: float
    words: str


@dataclass(frozen=True, eq=False)
class RobustnessReport:
    """Pushes tried on one plan.

    Attributes:
        found: moments, impulses and what came of them.
        stretches: of the plan, in order of time.
        interval: of `found.p_success`: (low, high); both equal to it where every push was tried.
        asked: exact questions that it took.
    """

    found: PlanRobustness
    stretches: tuple[Stretch, ...]
    interval: tuple[float, float]
    asked: int

    @property
    def pairs(self) -> int:
        """Moments and impulses that were tried."""
        return int((self.found.captured != UNTRIED).sum())

    def count(self, captured: int) -> int:
        """How many of them ended this way."""
        return int((self.found.captured == captured).sum())

    @property
    def weakest(self) -> list[Stretch]:
        """The stretches that risk most, the worst first."""
        return [s for s in sorted(self.stretches, key=lambda s: -s.risk) if s.fell][:WEAKEST]

    def as_dict(self) -> dict[str, object]:
        """Plain data for JSON."""
        feet = [is_foot(EFFECTORS[e]) for e in self.found.effector[self.found.captured == CATCHES].tolist()]
        swings, double = ([s for s in self.stretches if s.swing == air] for air in (True, False))
        return {
            "p_success": self.found.p_success,
            "interval": list(self.interval),
            "pairs": self.pairs,
            "failed": self.count(FALLS),
            "stood": self.count(STANDS),
            "caught_by_foot": int(np.sum(feet)),
            "caught_by_palm": len(feet) - int(np.sum(feet)),
            "swing": {"pairs": sum(s.tried for s in swings), "failed": sum(s.fell for s in swings)},
            "double_support": {"pairs": sum(s.tried for s in double), "failed": sum(s.fell for s in double)},
            "asked": self.asked,
            "weakest": [
                {"start": s.start, "end": s.end, "what": s.words, "pairs": s.tried, "failed": s.fell, "risk": s.risk}
                for s in self.weakest
            ],
        }

    def text(self) -> str:
        """A few lines for people."""
        facts = self.as_dict()
        low, high = self.interval
        sure = "every push tried" if low == high else f"95 % interval {100 * low:.1f} to {100 * high:.1f} %"
        swing, double = ([s for s in self.stretches if s.swing == air] for air in (True, False))
        lines = [
            f"  success   {100 * self.found.p_success:.1f} % that no push fells the robot ({sure})",
            f"  pushes    {self.pairs}: {facts['stood']} stood, {facts['caught_by_foot']} caught by a foot, "
            f"{facts['caught_by_palm']} by a palm, {facts['failed']} fell",
            f"  fell      {_fell(swing)} in swings, {_fell(double)} in double support",
        ]
        for number, s in enumerate(self.weakest):
            head = "  weakest   " if number == 0 else "            "
            lines.append(
                f"{head}{s.start:.1f} to {s.end:.1f} s, {s.words}: {s.fell} of {s.tried} fell, risk {100 * s.risk:.1f} %"
            )
        return "\n".join(lines)


def report_of(
    moments: Sequence[Moment], rows: Mapping[str, np.ndarray], method: Mapping[str, object], share: float = 1.0
) -> RobustnessReport:
    """The report of pushes that were tried.

    Args:
        moments: of the plan.
        rows: columns of the trials: moment, impulse (n, 3), probability, captured, effector, p_new (n, 3), asked.
        method: how they were tried, as JSON values.
        share: of the pushes that were drawn to be tried, in (0, 1].
    """
    impulse, which = np.unique(np.round(rows["impulse"].reshape(-1, 3), 6), axis=0, return_inverse=True)
    R, D = len(moments), len(impulse)
    probability, captured = np.zeros((R, D)), np.full((R, D), UNTRIED)
    point, effector = np.zeros((R, D, 3)), np.full((R, D), -1)
    at = rows["moment"].astype(int), which.ravel()
    np.add.at(probability, at, rows["probability"])  # a push that several regions have counts as often
    captured[at] = rows["captured"]
    point[at], effector[at] = rows["p_new"].reshape(-1, 3), rows["effector"]
    risk = np.where(captured == FALLS, probability, 0.0).sum(axis=1)
    exhaustive = share >= 1.0
    p_success = float(np.prod(1.0 - risk)) if exhaustive else _extrapolated(captured, probability, share, None)
    interval = (
        (p_success, p_success)
        if exhaustive
        else (_extrapolated(captured, probability, share, 1.0), _extrapolated(captured, probability, share, -1.0))
    )
    t = np.array([m.t for m in moments])
    found = PlanRobustness(
        t, impulse, probability, captured, point, effector, p_success, json.dumps(dict(method), sort_keys=True)
    )
    return RobustnessReport(found, _stretches(moments, found, risk / share), interval, int(rows["asked"].sum()))


def _fell(stretches: Sequence[Stretch]) -> str:
    return f"{sum(s.fell for s in stretches)} of {sum(s.tried for s in stretches)}"


def wilson(successes: float, tries: int, side: float) -> float:
    """One end of the interval of a probability that was estimated from tries (Wilson 1927).

    Args:
        successes: of the tries.
        tries: how many.
        side: 1 for the upper end, -1 for the lower.
    """
    if not tries:
        return 1.0 if side > 0 else 0.0
    z2, p = CONFIDENCE**2 / tries, successes / tries
    middle, half = p + z2 / 2, CONFIDENCE * np.sqrt(p * (1 - p) / tries + z2 / (4 * tries))
    return float(np.clip((middle + side * half) / (1 + z2), 0.0, 1.0))


def _extrapolated(captured: np.ndarray, probability: np.ndarray, share: float, side: float | None) -> float:
    """P_success from a random share of the pushes: the share of falls, weighted by probability, holds for the others too.

    Args:
        captured: (R, D).
        probability: (R, D) of those that were tried.
        share: that was tried.
        side: 1 and -1 for the ends of the interval of the share of falls; None for the share itself.
    """
    tried = captured != UNTRIED
    total = probability[tried].sum()
    if not total:  # no push can happen, or none was tried: then nothing is known
        return 0.0 if side == 1.0 and not tried.any() else 1.0
    falls = probability[tried & (captured == FALLS)].sum() / total
    if side is not None:
        falls = wilson(falls * tried.sum(), int(tried.sum()), side)
    return float(np.exp(-falls * total / share))


def _stretches(moments: Sequence[Moment], found: PlanRobustness, risk: np.ndarray) -> tuple[Stretch, ...]:
    """Moments in a row with the same contacts."""
    edges = [0]
    edges += [n for n in range(1, len(moments)) if moments[n].stance.contacts != moments[n - 1].stance.contacts]
    edges.append(len(moments))
    step = float(found.t[1] - found.t[0]) if len(found.t) > 1 else 0.1
    made = []
    for first, last in pairwise(edges):
        if first == last:
            continue
        rows = found.captured[first:last]
        air = [e for e in EFFECTORS[:2] if moments[first].stance.contacts[EFFECTORS.index(e)] is None]
        words = f"{air[0].replace('_', ' ')} in the air" if air else "double support"
        made.append(
            Stretch(
                moments[first].t, moments[last - 1].t + step, bool(air), int((rows != UNTRIED).sum()),
                int((rows == FALLS).sum()), float(1.0 - np.prod(1.0 - risk[first:last])), words,
            )
        )  # fmt: skip
    return tuple(made)
