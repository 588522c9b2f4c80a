"""Puts into words why a centroidal program has no answer: which block, where, and what it would take."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from pydrake.solvers import MathematicalProgram

from optimization.centroidal.data import CentroidalData
from optimization.convex.infeasibility import Relaxable, smallest_relaxation
from scenes.effector import EFFECTORS

# Unit and price of each constraint that may give way: a metre or a metre per second counts as ten times the weight.
BLOCKS = {
    "friction cone": ("M g", 1.0),
    "force limit": ("M g", 1.0),
    "com height": ("m", 10.0),
    "com box": ("m", 10.0),
    "final com box": ("m", 10.0),
    "rest: linear momentum": ("m/s", 10.0),
}


@dataclass(frozen=True)
class Shortfall:
    """A constraint of the convex program that cannot be met, and by how much it must give way.

    Attributes:
        block: name of the constraint.
        knot: where; of a contact, that at the start of its interval.
        time: of that knot [s].
        effector: whose, "" where it belongs to none.
        amount: by how much.
        unit: of the amount.
    """

    block: str
    knot: int
    time: float
    effector: str
    amount: float
    unit: str

    def __str__(self) -> str:
        who = f" of {self.effector}" if self.effector else ""
        place = f"knot {self.knot} ({self.time:.2f} s)"
        return f"{self.block}{who} cannot be met at {place}: {self.amount:.3g} {self.unit} short"


def shortfalls(prog: MathematicalProgram, data: CentroidalData) -> list[Shortfall]:
    """The least that the convex program's constraints must give way for it to have an answer, the worst first.

    Args:
        prog: the convex program, its constraints named as in `CentroidalProgram`.
        data: the numbers that it was made of.
    """
    intervals, contacts = np.arange(len(data.dt)), np.arange(len(data.interval))
    cones = sum(b.evaluator().get_description() == "friction cone" for b in prog.lorentz_cone_constraints())
    cones = cones or data.corners.count * len(contacts) * data.corners.rows.shape[1]
    groups = (np.repeat(contacts, cones // max(len(contacts), 1)), contacts, intervals, np.repeat(intervals, 3))
    groups = (*groups, np.zeros(3, int), np.zeros(data.index["v"][-2:].size, int))
    may_give = {name: Relaxable(group, price) for group, (name, (_, price)) in zip(groups, BLOCKS.items(), strict=True)}
    found = []
    for relaxation in smallest_relaxation(prog, may_give):
        knot, who = len(data.dt), ""
        if relaxation.block in ("friction cone", "force limit"):
            knot = int(data.interval[relaxation.group])
            who = EFFECTORS[data.effector[relaxation.group]]
        elif relaxation.block in ("com height", "com box"):
            knot = relaxation.group + 1
        time = float(data.problem.schedule.times[knot])
        unit = BLOCKS[relaxation.block][0]
        found.append(Shortfall(relaxation.block, knot, time, who, relaxation.amount, unit))
    return found


def explain(prog: MathematicalProgram, data: CentroidalData) -> str:
    """The constraint that must give way most for the convex program to have an answer, with place and amount.

    Args:
        prog: the convex program.
        data: the numbers that it was made of.
    """
    found = shortfalls(prog, data)
    if found:
        return str(found[0])
    return "the convex program has no answer, and no constraint that could give way explains it"
