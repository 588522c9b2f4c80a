"""A guiding path cut into segments of one motion mode and one way of planning each (Lin 2020 sec. 5.6).

    cut wherever the mode changes; then each piece of n steps with hardness g_j into segments of N_seg steps or more
        maximise  sum over segments | sum_j (g_j - T_tr) |                       Lin 2020 eq. 5.9

by dynamic programming over where the last segment begins, n^2 / 2 sums; the document enumerates all 2^(n - 1). What the objective
rewards is that segments are clearly easy or clearly hard. Of equally good cuts the one with fewest segments is taken.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from drakeplan.guide.guiding_path import GuidingPath

HARD = 0.3  # T_tr, Lin 2020 sec. 5.11
SHORTEST = 5  # N_seg, ibid.
EQUAL = 1e-9
Decision = Literal["mean", "max"]
Method = Literal["search", "adapt"]


@dataclass(frozen=True)
class Segment:
    """Consecutive steps of a guiding path.

    Attributes:
        first: its first step.
        end: the step after its last one; the torso poses are first to end, both included.
        mode: number of its motion mode.
        method: how its contacts are found: "search" from scratch, or "adapt" a stored plan.
    """

    first: int
    end: int
    mode: int
    method: Method

    def __len__(self) -> int:
        """How many steps."""
        return self.end - self.first


def cut(hardness: Sequence[float] | np.ndarray, threshold: float = HARD, shortest: int = SHORTEST) -> list[int]:
    """Where the segments of one mode begin, by Lin 2020 eq. 5.9; the first begins at 0.

    Args:
        hardness: (n,) traversability cost of each step.
        threshold: T_tr.
        shortest: N_seg; a piece with fewer than twice as many steps stays whole.
    """
    n = len(hardness)
    total = np.concatenate([[0.0], np.cumsum(np.asarray(hardness, float) - threshold)])
    if n < 2 * shortest:
        return [0]
    best, count = np.full(n + 1, -np.inf), np.zeros(n + 1, int)
    begins = np.zeros(n + 1, int)
    best[0] = 0.0
    for end in range(shortest, n + 1):
        for first in range(end - shortest + 1):
            if not np.isfinite(best[first]):
                continue
            value = best[first] + abs(total[end] - total[first])
            better = value > best[end] + EQUAL
            if better or (value > best[end] - EQUAL and count[first] + 1 < count[end]):
                best[end], count[end], begins[end] = value, count[first] + 1, first
    starts, end = [], n
    while end > 0:
        end = int(begins[end])
        starts.append(end)
    return starts[::-1]


def method_of(hardness: np.ndarray, decision: Decision, threshold: float = HARD) -> Method:
    """How the contacts of a segment are found: a stored plan where it is hard (Lin 2020 sec. 5.6).

    Args:
        hardness: (n,) of its steps.
        decision: whether the mean or the greatest of them decides.
        threshold: T_tr.
    """
    value = hardness.mean() if decision == "mean" else hardness.max()
    return "adapt" if value > threshold else "search"


def segments(
    path: GuidingPath,
    decision: Decision = "mean",
    *,
    threshold: float = HARD,
    shortest: int = SHORTEST,
    adapt: bool = True,
) -> list[Segment]:
    """The segments of a guiding path, in order; none of a path without steps.

    Args:
        path: of the torso.
        decision: how a segment's method is chosen.
        threshold: T_tr.
        shortest: N_seg.
        adapt: whether stored plans may be used; without them a path is cut at changes of mode alone.
    """
    found: list[Segment] = []
    if not len(path):
        return found
    changes = np.flatnonzero(np.diff(path.modes)) + 1
    for first, end in zip([0, *changes.tolist()], [*changes.tolist(), len(path)], strict=True):
        starts = cut(path.hardness[first:end], threshold, shortest) if adapt else [0]
        for a, b in zip(starts, [*starts[1:], end - first], strict=True):
            part = slice(first + a, first + b)
            method = method_of(path.hardness[part], decision, threshold) if adapt else "search"
            found.append(Segment(part.start, part.stop, int(path.modes[first]), method))
    return found
