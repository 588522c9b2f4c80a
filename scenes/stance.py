"""The contacts held at one moment, and the step from one stance to the next."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from scenes.contact import Contact
from scenes.effector import EFFECTORS


@dataclass(frozen=True)
class Stance:
    """The contacts held at one moment, at most one per end effector, in the order of `EFFECTORS`.

    Attributes:
        contacts: one entry per end effector, None where it is free.
    """

    contacts: tuple[Contact | None, ...]

    def __post_init__(self) -> None:
        if len(self.contacts) != len(EFFECTORS):
            raise ValueError(f"a stance has {len(EFFECTORS)} entries, got {len(self.contacts)}")
        for effector, contact in zip(EFFECTORS, self.contacts, strict=True):
            if contact is not None and contact.effector != effector:
                raise ValueError(f"the entry of {effector} holds a contact of {contact.effector}")

    @property
    def held(self) -> tuple[Contact, ...]:
        """The contacts that exist."""
        return tuple(c for c in self.contacts if c is not None)

    def replace(self, effector: int, contact: Contact | None) -> Stance:
        """The stance after this end effector (index into `EFFECTORS`) makes, moves or breaks its contact.

        Args:
            effector: index into `EFFECTORS`.
            contact: what it holds afterwards, None for nothing.
        """
        contacts = list(self.contacts)
        contacts[effector] = contact
        return Stance(tuple(contacts))

    def feet_mean(self) -> np.ndarray:
        """(3,) mean of the foot contact points in W [m]."""
        feet = [c.p_WC for c in self.contacts[:2] if c is not None]
        if not feet:
            raise ValueError("no foot is on the ground")
        return np.mean(feet, axis=0)


def changed_effector(before: Stance, after: Stance) -> int:
    """Index of the one end effector in which two consecutive stances differ.

    Args:
        before: the first stance.
        after: the second stance.

    Raises:
        ValueError: they differ in none or in more than one.
    """
    changed = [i for i in range(len(EFFECTORS)) if before.contacts[i] != after.contacts[i]]
    if len(changed) != 1:
        raise ValueError(f"consecutive stances must differ in one end effector, these differ in {len(changed)}")
    return changed[0]
