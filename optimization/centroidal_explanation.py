"""Puts into words why a centroidal program has no answer: which block, where, and what it would take."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from optimization.infeasibility import Relaxable, smallest_relaxation
from scenes.effector import EFFECTORS

if TYPE_CHECKING:
    from optimization.centroidal import CentroidalProgram

# Unit and price of each constraint that may give way: a metre or a metre per second counts as ten times the weight.
BLOCKS = {
    "friction cone": ("M g", 1.0),
    "force limit": ("M g", 1.0),
    "com height": ("m", 10.0),
    "com box": ("m", 10.0),
    "final com box": ("m", 10.0),
    "rest: linear momentum": ("m/s", 10.0),
}


def explain(program: CentroidalProgram) -> str:
    """The constraint that must give way most for the convex program to have an answer, with place and amount."""
    intervals, contacts = np.arange(len(program.dt)), np.arange(len(program.interval))
    cones = len(program.prog.lorentz_cone_constraints()) or 4 * len(contacts) * program.corners.rows.shape[1]
    groups = (np.repeat(contacts, cones // max(len(contacts), 1)), contacts, intervals, np.repeat(intervals, 3))
    groups = (*groups, np.zeros(3, int), np.zeros(program.v[-2:].size, int))
    may_give = {name: Relaxable(group, price) for group, (name, (_, price)) in zip(groups, BLOCKS.items(), strict=True)}
    found = smallest_relaxation(program.prog, may_give)
    if not found:
        return "the convex program has no answer, and no constraint that could give way explains it"
    worst = found[0]
    knot, who = len(program.dt), ""
    if worst.block in ("friction cone", "force limit"):
        knot = int(program.interval[worst.group])
        who = f" of {EFFECTORS[program.effector[worst.group]]}"
    elif worst.block in ("com height", "com box"):
        knot = worst.group + 1
    place = f"knot {knot} ({program.problem.schedule.times[knot]:.2f} s)"
    return f"{worst.block}{who} cannot be met at {place}: {worst.amount:.3g} {BLOCKS[worst.block][0]} short"
