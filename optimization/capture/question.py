"""The question of capture: can the robot come to rest from here, where it stands or with one new contact?

Lin 2020: Y.-C. Lin, "Learning for Humanoid Multi-Contact Navigation Planning" (dissertation), sec. 7.5 and 7.6.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

from scenes.contact import Contact
from scenes.effector import EFFECTORS
from scenes.input_error import InputError
from scenes.stance import Stance

MIRROR = np.diag([1.0, -1.0, 1.0])  # of points and vectors at the plane y = 0
MIRROR_TURN = np.array([-1.0, 1.0, -1.0])  # of axial vectors, angular momentum among them
OTHER_SIDE = (1, 0, 3, 2)  # end effector of the same kind on the other side


@dataclass(frozen=True, eq=False)
class CaptureQuestion:
    """One stance, one state right after a push, and one new contact or none.

    Zero-step capture keeps the stance. One-step capture makes `new_contact`; where its end effector is held in the
    stance, that contact is broken first (Lin 2020 sec. 7.8).

    Attributes:
        stance: contacts held at the start, at least one.
        com: (3,) in W [m].
        linear_momentum: (3,) in W [kg m/s].
        angular_momentum: (3,) about the CoM, in W [N m s].
        new_contact: what is made; None for zero-step capture.
    """

    stance: Stance
    com: np.ndarray
    linear_momentum: np.ndarray
    angular_momentum: np.ndarray = field(default_factory=lambda: np.zeros(3))
    new_contact: Contact | None = None

    def __post_init__(self) -> None:
        for name in ("com", "linear_momentum", "angular_momentum"):
            array = np.array(getattr(self, name), dtype=float)
            if array.shape != (3,) or not np.isfinite(array).all():
                raise InputError(f"capture question: {name} must be three finite numbers, got {getattr(self, name)}")
            array.setflags(write=False)
            object.__setattr__(self, name, array)
        if not self.stance.held:
            raise InputError("capture question: the stance must hold at least one contact")
        if self.new_contact is not None and self.new_contact in self.stance.held:
            raise InputError("capture question: the new contact is in the stance already")
        if self.new_contact is not None and not self.swing_stance.held:
            raise InputError("capture question: nothing is held while the new contact is made")

    @property
    def moving(self) -> int:
        """Index of the end effector that makes the new contact, -1 for none."""
        return -1 if self.new_contact is None else EFFECTORS.index(self.new_contact.effector)

    @property
    def swing_stance(self) -> Stance:
        """The contacts that are held until the new one is made."""
        return self.stance if self.new_contact is None else self.stance.replace(self.moving, None)

    @property
    def final_stance(self) -> Stance:
        """The contacts that are held in the end."""
        return self.stance if self.new_contact is None else self.stance.replace(self.moving, self.new_contact)

    def pushed(self, impulse: np.ndarray) -> CaptureQuestion:
        """The question after an impulse (3,) [kg m/s]: l0 becomes l_b + delta (sec. 7.5)."""
        return replace(self, linear_momentum=self.linear_momentum + np.asarray(impulse, float))

    def mirrored(self) -> CaptureQuestion:
        """The question seen in a mirror at the plane y = 0, left for right."""
        contacts = [_mirrored(self.stance.contacts[e]) for e in OTHER_SIDE]
        return CaptureQuestion(
            Stance(tuple(contacts)),
            MIRROR @ self.com,
            MIRROR @ self.linear_momentum,
            MIRROR_TURN * self.angular_momentum,
            _mirrored(self.new_contact),
        )


def _mirrored(contact: Contact | None) -> Contact | None:
    """The contact in the mirror; its y axis is turned about so that the frame stays right-handed."""
    if contact is None:
        return None
    X_WC = np.eye(4)
    X_WC[:3, :3] = MIRROR @ contact.R_WC @ MIRROR
    X_WC[:3, 3] = MIRROR @ contact.p_WC
    effector = EFFECTORS[OTHER_SIDE[EFFECTORS.index(contact.effector)]]
    support = None if contact.support is None else contact.support[::-1] * [1.0, -1.0]
    return Contact(effector, contact.surface, X_WC, contact.friction, -contact.heading, support)
