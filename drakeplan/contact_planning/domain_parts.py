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
        """Why an end effector cannot be lifted, "" if it can.

        Args:
            held: contact numbers by end effector, -1 where free.
            mover: index into `EFFECTORS` of the one to lift.
        """
        ...

    def stance(self, held: Held) -> str:
        """Why the robot cannot stand still with these contacts, "" if it can."""
        ...

    def transition(self, before: Held, after: Held) -> str:
        """Why a step cannot be made, "" if it can.

        Args:
            before: contact numbers by end effector, -1 where free.
            after: the same for the next stance, which differs in one end effector.
        """
        ...


class DistanceToGo(Protocol):
    """Distances of the torso to the goal, as `TorsoGrid` gives them."""

    def distance(self, x: np.ndarray, y: np.ndarray, z: np.ndarray, yaw: np.ndarray) -> np.ndarray:
        """(n,) distances to the goal [m], inf where there is no way.

        Args:
            x: (n,) of the means of the feet in W [m].
            y: (n,) of the means of the feet in W [m].
            z: (n,) of the means of the feet in W [m].
            yaw: (n,) headings in W [rad].
        """
        ...
