"""What a centroidal program answers."""

from __future__ import annotations

from dataclasses import dataclass

from optimization.centroidal.trajectory import CentroidalTrajectory
from optimization.convex.solver import SolveRecord


@dataclass(frozen=True, eq=False)
class CentroidalEstimate:
    """What the centroidal program says of a contact sequence or transition.

    Attributes:
        feasible: whether the trajectory satisfies every constraint, checked on the recomputed numbers.
        cost: the documents' objective, without the pull towards a CoM reference; inf where there is no trajectory.
        reason: "" where feasible, else the constraint block that fails, with knot and end effector where known.
        records: one per convex program that was solved.
        trajectory: the best one found, also where it is not feasible; None where there is none.
        stopped: the limit that ended the iteration before the cost stood still ("time" or "iterations"), "" where none
            did: the trajectory is then the best so far.
    """

    feasible: bool
    cost: float
    reason: str
    records: tuple[SolveRecord, ...]
    trajectory: CentroidalTrajectory | None
    stopped: str = ""
