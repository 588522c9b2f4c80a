"""What `ContactDomain` asks of others: whether the body can do a step, and how far the goal is."""

from __future__ import annotations

from typing import Protocol

import numpy as np

from drakeplan.contact_planning.contact_pool import ContactPool, Held


class StepCheck(Protocol):
    """Decides whether the body can do a step, as `TransitionCheck` does for humanoids."""

    pool: ContactPool
    """contacts by number"""

    def stands_alone(self, number: int) -> bool:
        """Whether a single contact can carry the weight at all."""
        ...

    def can_lift(self, held: Held, mover: int) -> str:
        """Why an end effector cannot be lifted, "" if it can; see `TransitionCheck.can_lift`."""
        ...

    def stance(self, held: Held) -> str:
        """Why the robot cannot stand still with these contacts, "" if it can."""
        ...

    def transition(self, before: Held, after: Held) -> str:
        """Why a step cannot be made, "" if it can; see `TransitionCheck.transition`."""
        ...


class DistanceToGo(Protocol):
    """Distances of the torso to the goal, as `TorsoGrid` gives them."""

    def distance(self, x: np.ndarray, y: np.ndarray, z: np.ndarray, yaw: np.ndarray) -> np.ndarray:
        """(n,) distances [m]; see `TorsoGrid.distance`."""
        ...
