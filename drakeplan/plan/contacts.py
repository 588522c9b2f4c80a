"""The table of a plan's contacts, and how stances are told by it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from drakeplan.plan.arrays import freeze, require_same_length
from scenes.contact import Contact, patch_corners, require_support
from scenes.effector import EFFECTORS
from scenes.stance import Stance

if TYPE_CHECKING:
    import pandas as pd


@dataclass(frozen=True, eq=False)
class PlanContacts:
    """Every contact that any stance of the plan holds, one row each.

    Attributes:
        X_WC: (C, 4, 4) pose of the contact frame in W [m].
        effector: (C,) index into the plan's effectors.
        surface: (C,) index into the surfaces of the plan's scene.
        friction: (C,) Coulomb coefficient there [-].
        support: (C, V, 2) corners of what of the patch rests on something, convex, counter-clockwise in the contact frame
            [m], padded with NaN; a row without numbers is the whole patch, and so are all rows where it is None.
    """

    X_WC: np.ndarray
    effector: np.ndarray
    surface: np.ndarray
    friction: np.ndarray
    support: np.ndarray | None = None

    def __post_init__(self) -> None:
        freeze(self, "contacts", floats={"X_WC": (None, 4, 4), "friction": (None,)}, indices={"effector", "surface"})
        require_same_length(self, "contacts", "X_WC", "effector", "surface", "friction")
        support = np.full((len(self), 4, 2), np.nan) if self.support is None else np.array(self.support, float)
        if support.ndim != 3 or support.shape[0] != len(self) or support.shape[2] != 2:
            raise ValueError(f"contacts/support must be {len(self)} x any x 2, got shape {support.shape}")
        for corners in support:
            filled = int(np.isfinite(corners).all(axis=1).sum())
            if not np.isnan(corners[filled:]).all():
                raise ValueError("contacts/support holds a number that is not finite")
            if filled:
                require_support(corners[:filled])
        support.setflags(write=False)
        object.__setattr__(self, "support", support)

    def __len__(self) -> int:
        return len(self.effector)

    def corners(self, index: int) -> np.ndarray:
        """(n, 2) corners of one contact's support in its frame [m]; none where the whole patch is meant."""
        assert self.support is not None  # filled in where it was made
        return self.support[index][np.isfinite(self.support[index, :, 0])]

    def with_whole_patches(self, half_extent: np.ndarray) -> PlanContacts:
        """The same contacts with the corners of the patch in the rows that have none.

        Args:
            half_extent: (E, 2) half extents of each end effector's patch [m].
        """
        whole = patch_corners(half_extent)[self.effector].reshape(-1, 4, 2)
        rows = [c if len(c) else w for c, w in zip(map(self.corners, range(len(self))), whole, strict=True)]
        most = max((len(row) for row in rows), default=4)
        support = np.full((len(rows), most, 2), np.nan)
        for k, row in enumerate(rows):
            support[k, : len(row)] = row
        return replace(self, support=support)

    def to_pandas(self) -> pd.DataFrame:
        """One row a contact: effector, surface, friction, x, y, z [m], nx, ny, nz and yaw [rad].

        The row's number is the contact's index. x, y, z is the contact point and nx, ny, nz the contact normal, both in
        W; yaw is the heading of the contact frame's x axis in the plan view.

        Raises:
            ImportError: pandas is not installed.
        """
        try:
            import pandas as pd
        except ImportError:
            raise ImportError("to_pandas needs pandas: pip install 'drakeplan[pandas]'") from None
        columns: dict[str, object] = {
            "effector": [EFFECTORS[e] for e in self.effector],
            "surface": self.surface,
            "friction": self.friction,
        }
        for axis, letter in enumerate("xyz"):
            columns[letter] = self.X_WC[:, axis, 3]
        for axis, letter in enumerate("xyz"):
            columns[f"n{letter}"] = self.X_WC[:, axis, 2]
        columns["yaw"] = np.arctan2(self.X_WC[:, 1, 0], self.X_WC[:, 0, 0])
        return pd.DataFrame(columns, index=pd.RangeIndex(len(self), name="contact"))


def tabulate_stances(stances: Sequence[Stance]) -> tuple[PlanContacts, np.ndarray]:
    """The table of all contacts in `stances`, in order of appearance, and (S, E) indices into it.

    A contact held through several stances gets one row; one that is broken and made again at the same place another.
    """
    rows: list[Contact] = []
    indices = np.full((len(stances), len(EFFECTORS)), -1, dtype=np.int64)
    for s, stance in enumerate(stances):
        for e, contact in enumerate(stance.contacts):
            if contact is None:
                continue
            before = indices[s - 1, e] if s else -1
            if before >= 0 and rows[before] == contact:
                indices[s, e] = before
            else:
                indices[s, e] = len(rows)
                rows.append(contact)
    support = np.full((len(rows), max((len(c.support) for c in rows if c.support is not None), default=4), 2), np.nan)
    for k, contact in enumerate(rows):
        if contact.support is not None:
            support[k, : len(contact.support)] = contact.support
    table = PlanContacts(
        X_WC=np.array([c.X_WC for c in rows]).reshape(-1, 4, 4),
        effector=np.array([EFFECTORS.index(c.effector) for c in rows], dtype=np.int64),
        surface=np.array([c.surface for c in rows], dtype=np.int64),
        friction=np.array([c.friction for c in rows], dtype=float),
        support=support,
    )
    return table, indices
