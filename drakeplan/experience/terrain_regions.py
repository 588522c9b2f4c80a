"""Contact regions near a way, found once for each end effector and heading and then shared by all plans that are tried."""

from __future__ import annotations

import numpy as np

from drakeplan.context import QueryContext
from drakeplan.experience.alignment import RegionTable
from drakeplan.experience.strip_setup import carries_alone_on
from optimization.balance.friction import FrictionCone
from scenes.contact import Contact
from scenes.effector import EFFECTORS, is_foot
from scenes.footholds.contact_regions import ContactRegions, cover_terrain
from scenes.terrain.packed_terrain import near

NARROW = 0.8  # [m] extent of a surface up to which samples get as fine as documented
FINE, COARSE = 0.01, 0.04  # [m] how fine samples get on narrow surfaces and on others
SMALL = 3.0  # [m] greatest extent of a surface that is covered whole
BESIDE = 1.2  # [m] how far from the straight way, and beyond its ends, contacts are looked for
TURN = 0.06  # [rad] that a foot may turn about its normal, to either side
AHEAD = 6.0  # [m] of the way that is covered: no stored plan is longer
BIN = 0.04  # [rad] headings within one share their regions


class TerrainRegions:
    """Circles on the surfaces between the feet and the goal (Lin 2020 sec. 4.5.1)."""

    def __init__(self, context: QueryContext, feet: np.ndarray, goal: np.ndarray, turn: float) -> None:
        """Nothing is covered before it is asked for.

        Args:
            context: of the query.
            feet: (2, 3) where they stand [m].
            goal: (3,) [m].
            turn: how far feet may turn about their normals [rad].
        """
        self._context, self._turn = context, turn
        here = feet.mean(axis=0)
        goal = here + (goal - here) * min(1.0, AHEAD / max(float(np.linalg.norm(goal - here)), 1e-9))
        low, high = np.minimum(here, goal)[:2] - BESIDE, np.maximum(here, goal)[:2] + BESIDE
        packed = context.packed
        around = near(packed, low[0], low[1], high[0], high[1])
        self._surfaces = [int(k) for k in around if k < packed.num_surfaces]
        self._middle, self._reach = (here + goal) / 2.0, float(np.linalg.norm(goal - here)) / 2.0 + BESIDE
        self._heading = float(np.arctan2(*(goal - here)[1::-1]))
        self._covers: dict[tuple[int, int], ContactRegions] = {}
        self._alone: dict[tuple[int, int], bool] = {}

    def table(self, use_palms: bool) -> RegionTable:
        """The circles of all end effectors, feet turned towards the goal.

        Args:
            use_palms: whether palms are asked for.
        """
        chosen = (0, 1, *(self._context.usable_palms if use_palms else ()))
        return RegionTable.of({e: self._cover(e, self._heading) for e in chosen})

    def near(self, contact: Contact, furthest: float, cone: FrictionCone | None) -> ContactRegions:
        """Circles that a contact could move to, with about its heading.

        Args:
            contact: where it is now.
            furthest: distance (Lin 2020 eq. 4.4) beyond which a region is no place for it [m].
            cone: friction cone where the contact must carry the robot alone; None elsewhere.
        """
        e = EFFECTORS.index(contact.effector)
        regions = self._cover(e, contact.heading)
        keep = regions.distance(contact.X_WC) <= furthest
        if cone is not None:
            keep &= np.array([self._stands(e, int(k), contact, cone) for k in regions.surface], dtype=bool)
        return regions.where(keep)

    def _cover(self, e: int, heading: float) -> ContactRegions:
        """The circles of all surfaces here; those of small surfaces serve the whole query, wherever a plan begins."""
        foot = is_foot(EFFECTORS[e])
        key = e, round(heading / BIN) if foot else 0
        if key not in self._covers:
            turn = self._turn + BIN / 2.0 if foot else 0.0
            kept = self._context.made.setdefault(f"regions of {EFFECTORS[e]} at {key[1]} within {turn:.3f}", {})
            assert isinstance(kept, dict)
            extent = (self._context.packed.high - self._context.packed.low)[self._surfaces].max(axis=1, initial=0.0)
            small = [k for k, size in zip(self._surfaces, extent, strict=True) if size <= SMALL]
            missing = [k for k in small if k not in kept]
            wide = {k for k, size in zip(self._surfaces, extent, strict=True) if size > NARROW}
            for finest, some in (
                (FINE, [k for k in missing if k not in wide]),
                (COARSE, [k for k in missing if k in wide]),
            ):
                found = self._find(e, key[1] * BIN, turn, some, np.inf, finest)
                for k in some:
                    kept[k] = found.where(found.surface == k)
            large = [k for k, size in zip(self._surfaces, extent, strict=True) if size > SMALL]
            parts = [*(kept[k] for k in small), self._find(e, key[1] * BIN, turn, large, self._reach, COARSE)]
            self._covers[key] = ContactRegions(
                np.concatenate([part.surface for part in parts]),
                np.concatenate([part.X_WR for part in parts]),
                np.concatenate([part.radius for part in parts]),
            )
        return self._covers[key]

    def _find(
        self, e: int, heading: float, turn: float, surfaces: list[int], reach: float, finest: float
    ) -> ContactRegions:
        return cover_terrain(
            self._context.packed,
            self._context.robot.effectors[e],
            heading=heading,
            turn=turn,
            surfaces=surfaces,
            around=self._middle if np.isfinite(reach) else None,
            reach=reach,
            finest=finest,
        )

    def _stands(self, e: int, surface: int, contact: Contact, cone: FrictionCone) -> bool:
        """Whether the surface is flat enough to stand on alone; it depends little on the heading."""
        if (e, surface) not in self._alone:
            self._alone[e, surface] = carries_alone_on(contact, self._context.packed, surface, cone)
        return self._alone[e, surface]
