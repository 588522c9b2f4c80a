"""Which stored plans fit a terrain: clusters by their representatives, then the plans of a cluster (Lin 2020 algorithm 3)."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from drakeplan.context import QueryContext
from drakeplan.experience.alignment import Alignment, RegionTable, align
from drakeplan.experience.library import Entry, clusters
from drakeplan.experience.plan_distance import PlanBatch
from drakeplan.experience.stored_plan import MODE_PALMS, MODES, Outline, plan_pose

# [m] added to the distance for each palm that a plan uses: its motion takes two to five times as long to make
PALM_COST = 0.03


@dataclass(frozen=True, eq=False)
class Candidate:
    """A stored plan laid on the terrain.

    Attributes:
        entry: of the library.
        end: stance at which it is cut.
        reaches: whether it leads into the goal; else it leads towards it.
        X_WL: (4, 4) pose of the plan's frame in W.
        distance: from the terrain, Xi of Lin 2020 eq. 4.8 [m].
        worst: greatest distance of a contact from the terrain [m].
    """

    entry: Entry
    end: int
    reaches: bool
    X_WL: np.ndarray
    distance: float
    worst: float


def usable_modes(context: QueryContext, use_palms: bool) -> tuple[str, ...]:
    """The motion modes whose palms all find a surface.

    Args:
        context: of the query.
        use_palms: whether palms may be used at all.
    """
    usable = set(context.usable_palms) if use_palms else set()
    return tuple(mode for mode, palms in MODE_PALMS.items() if usable.issuperset(palms))


def candidates(
    entries: Sequence[Entry], regions: RegionTable, feet: np.ndarray, goal: np.ndarray, radius: float
) -> Iterator[Candidate]:
    """Plans that lead from the feet into the goal, in the order in which they are to be tried.

    Where none leads that far, those that lead towards it, whole.

    Args:
        entries: of the library, of the modes that may be used.
        regions: of the terrain.
        feet: (2, 3) where they stand [m].
        goal: (3,) [m].
        radius: of the goal [m].
    """
    far = float(np.hypot(*(goal - feet.mean(axis=0))[:2]))
    ends = np.array([_end(entry.outline, far, radius) for entry in entries], dtype=np.int64)
    reaches = bool((ends >= 0).any())
    if not reaches:
        ends = np.array([_whole(entry.outline, far, radius) for entry in entries], dtype=np.int64)
    towards = _places_on_the_way(entries, ends, reaches, feet.mean(axis=0)[:2], goal[:2])
    groups = [[k for k in group if ends[k] >= 0] for group in _clusters_of_modes(entries)]
    groups = [group for group in groups if group]
    first = [group[0] for group in groups]  # the representative, or whoever comes first of those that lead far enough
    ranked = _lay([entries[k] for k in first], ends[first], regions, feet, towards[first], radius)
    palms = np.array([len(MODE_PALMS[entry.mode]) for entry in entries])
    for g in np.argsort(ranked.mean + PALM_COST * palms[first], kind="stable"):
        if not np.isfinite(ranked.mean[g]):
            return
        group = groups[g]
        laid = _lay([entries[k] for k in group], ends[group], regions, feet, towards[group], radius)
        for i in np.argsort(laid.mean, kind="stable"):
            if np.isfinite(laid.mean[i]):
                pose, k = laid.pose[i], group[i]
                X_WL = plan_pose(pose[:3], float(pose[3]))
                yield Candidate(entries[k], int(ends[k]), reaches, X_WL, float(laid.mean[i]), float(laid.worst[i]))


def _clusters_of_modes(entries: Sequence[Entry]) -> list[list[int]]:
    """The members of every cluster of every mode, representatives first, by index into `entries`."""
    groups = []
    for mode in MODES:
        own = [k for k, entry in enumerate(entries) if entry.mode == mode]
        groups += [[own[i] for i in group] for group in clusters([entries[k] for k in own])]
    return groups


def _lay(
    entries: Sequence[Entry], ends: np.ndarray, regions: RegionTable, feet: np.ndarray, goal: np.ndarray, radius: float
) -> Alignment:
    return align(PlanBatch.of([e.outline for e in entries]), ends, regions, feet, goal, radius)


def _places_on_the_way(
    entries: Sequence[Entry], ends: np.ndarray, reaches: bool, here: np.ndarray, goal: np.ndarray
) -> np.ndarray:
    """(M, 2) where each plan is to end: the goal, or the point of the straight way that is as far as the plan leads [m]."""
    if reaches:
        return np.tile(goal, (len(entries), 1))
    lengths = np.array([entry.outline.distance[end] for entry, end in zip(entries, ends, strict=True)])
    ahead = (goal - here) / max(float(np.hypot(*(goal - here))), 1e-9)
    return here + lengths[:, None] * ahead


def _end(outline: Outline, far: float, radius: float) -> int:
    """The stance whose feet come nearest to the goal's distance; -1 where none is within its radius (sec. 5.8.2)."""
    ends = outline.ends()
    off = np.abs(outline.distance[ends] - far)
    best = int(np.argmin(off))
    return int(ends[best]) if off[best] <= radius and ends[best] > 0 else -1


def _whole(outline: Outline, far: float, radius: float) -> int:
    """The last stance that leads ahead, where the plan is too short to reach the goal; -1 where it is too long."""
    end = int(outline.ends()[-1])
    return end if end > 0 and outline.distance[end] < far - radius else -1
