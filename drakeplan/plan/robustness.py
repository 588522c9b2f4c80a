"""What pushes do to a plan."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from drakeplan.plan.arrays import Shape, freeze


@dataclass(frozen=True, eq=False)
class PlanRobustness:
    """What pushes do to the plan: each of D impulses at each of R moments, by the exact kino-dynamic question.

    Attributes:
        t: (R,) moments [s].
        impulse: (D, 3) in W [kg m/s].
        probability: (R, D) that the impulse happens within 0.1 s there [-].
        captured: (R, D) 0 the robot falls, 1 it stands with what it holds, 2 with one new contact; -1 not tried.
        capture_point: (R, D, 3) where the new contact is made, in W [m]; 0 where none is.
        effector: (R, D) index of the end effector that makes it, -1 for none.
        p_success: probability that no push fells the robot on the way (Lin 2020 eq. 7.6).
        method: how it was found, as JSON.
    """

    t: np.ndarray
    impulse: np.ndarray
    probability: np.ndarray
    captured: np.ndarray
    capture_point: np.ndarray
    effector: np.ndarray
    p_success: float
    method: str

    def __post_init__(self) -> None:
        shape = len(np.atleast_1d(self.t)), len(np.atleast_2d(self.impulse))
        floats: dict[str, Shape] = {
            "t": (None,),
            "impulse": (None, 3),
            "probability": shape,
            "capture_point": (*shape, 3),
        }
        freeze(self, "robustness", floats=floats, indices={"captured", "effector"})
        for name in ("captured", "effector"):
            if getattr(self, name).shape != shape:
                raise ValueError(f"robustness/{name} must be {shape[0]} x {shape[1]}, got {getattr(self, name).shape}")
        if self.captured.size and not (self.captured.min() >= -1 and self.captured.max() <= 2):
            raise ValueError("robustness/captured: expected -1, 0, 1 or 2")
        if not 0.0 <= self.p_success <= 1.0:
            raise ValueError(f"robustness: p_success must lie in [0, 1], got {self.p_success}")
