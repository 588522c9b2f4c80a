"""All contacts that a search has generated, by number, so that a stance is four integers."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from scenes.contact import Contact, patch_corners
from scenes.effector import EFFECTORS
from scenes.terrain.packed_terrain import PackedTerrain

Held = tuple[int, ...]  # contact numbers by end effector, -1 where free
CELL = 0.02  # [m] contacts of one end effector nearer than this, on one surface, are one contact
TURN = np.deg2rad(5.0)  # the same for the heading of a foot


class Rest(NamedTuple):
    """What a contact that may not rest on all of its patch rests on.

    Attributes:
        support: (V, 2) corners in the contact frame [m]; None: the whole patch after all.
        friction: least Coulomb coefficient of what touches.
    """

    support: np.ndarray | None
    friction: float


class ContactPool:
    """Contacts by number, with their poses in growing arrays.

    Attributes:
        p: (n, 3) contact points in W [m].
        R: (n, 3, 3) contact frames in W.
        yaw: (n,) headings [rad].
        surface: (n,) surface indices.
        effector: (n,) indices into `EFFECTORS`.
        frictions: (n,) Coulomb coefficients where the contacts are.
        on_part: (n,) whether the contacts rest on part of their patch only.
        supports: number -> (V, 2) corners of the support [m], for contacts that do not rest on all of their patch.
    """

    def __init__(self, packed: PackedTerrain) -> None:
        self._packed = packed
        self._number: dict[tuple[int, ...], int] = {}
        self.size = 0
        self._p, self._R = np.zeros((256, 3)), np.zeros((256, 3, 3))
        self._yaw, self._surface, self._effector = np.zeros(256), np.zeros(256, int), np.zeros(256, int)
        self._friction, self._on_part = np.zeros(256), np.zeros(256, bool)
        self.supports: dict[int, np.ndarray] = {}

    @property
    def p(self) -> np.ndarray:
        return self._p[: self.size]

    @property
    def R(self) -> np.ndarray:
        return self._R[: self.size]

    @property
    def yaw(self) -> np.ndarray:
        return self._yaw[: self.size]

    @property
    def surface(self) -> np.ndarray:
        return self._surface[: self.size]

    @property
    def effector(self) -> np.ndarray:
        return self._effector[: self.size]

    @property
    def frictions(self) -> np.ndarray:
        return self._friction[: self.size]

    @property
    def on_part(self) -> np.ndarray:
        return self._on_part[: self.size]

    def add(
        self,
        effector: int,
        p: np.ndarray,
        R: np.ndarray,
        yaw: np.ndarray,
        surface: np.ndarray,
        rests: Sequence[Rest | None] = (),
    ) -> np.ndarray:
        """(n,) numbers of these contacts; near duplicates get the number of the first.

        Args:
            effector: index into `EFFECTORS` of the one end effector of all n contacts.
            p: (n, 3) contact points in W [m].
            R: (n, 3, 3) contact frames in W.
            yaw: (n,) headings [rad].
            surface: (n,) surface indices.
            rests: for each of the contacts, None where the whole patch is on its surface; or none at all.
        """
        cells = np.round(p / CELL).astype(int).tolist()
        turns = np.round(yaw / TURN).astype(int).tolist()
        numbers = np.empty(len(p), int)
        for k, ((i, j, m), turn, s) in enumerate(zip(cells, turns, surface.tolist(), strict=True)):
            rest = rests[k] if rests else None
            key = (effector, s, i, j, m, turn) if rest is None else (effector, s, i, j, m, turn, 1)
            number = self._number.get(key)
            if number is None:
                number = self._append(effector, p[k], R[k], float(yaw[k]), s)
                self._number[key] = number
                if rest is not None:
                    self._friction[number] = rest.friction
                    if rest.support is not None:
                        self.supports[number], self._on_part[number] = rest.support, True
            numbers[k] = number
        return numbers

    def add_contact(self, contact: Contact) -> int:
        """The number of a given contact, kept exactly as it is; near duplicates that come later get its number."""
        effector = EFFECTORS.index(contact.effector)
        number = self._append(effector, contact.p_WC, contact.R_WC, contact.heading, contact.surface)
        self._friction[number] = contact.friction
        if contact.support is not None:
            self.supports[number], self._on_part[number] = contact.support, True
        cell = np.round(contact.p_WC / CELL).astype(int).tolist()
        self._number.setdefault((effector, contact.surface, *cell, round(contact.heading / TURN)), number)
        return number

    def contact(self, number: int) -> Contact:
        """The contact of this number."""
        X_WC = np.eye(4)
        X_WC[:3, :3], X_WC[:3, 3] = self._R[number], self._p[number]
        surface = int(self._surface[number])
        effector = EFFECTORS[self._effector[number]]
        friction, support = float(self._friction[number]), self.supports.get(number)
        return Contact(effector, surface, X_WC, friction, float(self._yaw[number]), support)

    def friction(self, number: int) -> float:
        """Coulomb coefficient where this contact is."""
        return float(self._friction[number])

    def corners(self, numbers: Sequence[int], half_extents: np.ndarray) -> np.ndarray:
        """(n, V, 2) corners of the supports of contacts in their frames [m], the last one repeated.

        Args:
            numbers: n contact numbers.
            half_extents: (E, 2) of each end effector's patch [m].
        """
        whole = patch_corners(half_extents[self._effector[list(numbers)]])
        partial = {k: self.supports[n] for k, n in enumerate(numbers) if n in self.supports}
        if not partial:
            return whole
        most = max(4, *(len(corners) for corners in partial.values()))
        filled = np.concatenate([whole, np.repeat(whole[:, -1:], most - 4, axis=1)], axis=1)
        for k, corners in partial.items():
            filled[k, : len(corners)], filled[k, len(corners) :] = corners, corners[-1]
        return filled

    def _append(self, effector: int, p: np.ndarray, R: np.ndarray, yaw: float, surface: int) -> int:
        if self.size == len(self._p):
            for name in ("_p", "_R", "_yaw", "_surface", "_effector", "_friction", "_on_part"):
                old = getattr(self, name)
                grown = np.zeros((2 * len(old), *old.shape[1:]), old.dtype)
                grown[: len(old)] = old
                setattr(self, name, grown)
        k = self.size
        self._p[k], self._R[k], self._yaw[k], self._surface[k], self._effector[k] = p, R, yaw, surface, effector
        self._friction[k] = self._packed.friction[surface]
        self.size += 1
        return k
