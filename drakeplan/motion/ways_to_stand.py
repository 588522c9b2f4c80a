"""Which way of standing each posture of a motion stays near: upright, or lower or with other arms where that is in the way.

Arms and height that change from one posture to the next would flail. Where the nominal posture is in the way, all postures
in a row keep one way to stand that serves all of them; two postures more on either side do so already.
"""

from __future__ import annotations

import numpy as np

from optimization.inverse_kinematics.standing_postures import NOMINAL, StandingPostures, Way
from scenes.terrain.packed_terrain import PackedTerrain

AHEAD = 2  # postures before and after those that are in the way


def ways_to_stand(
    standing: StandingPostures, packed: PackedTerrain | None, places: np.ndarray, headings: np.ndarray
) -> list[Way]:
    """The way to stand that each posture stays near, n of them.

    Args:
        standing: the ways in which the robot stands.
        packed: the terrain, None for none.
        places: (n, 3) over which the CoM is, at the height of the soles, in W [m].
        headings: (n,) about W's z [rad].
    """
    ways = [NOMINAL] * len(places)
    if packed is None:
        return ways
    around = [[_towards(places, headings, k, step) for step in (0, -1, 1)] for k in range(len(places))]
    taken = np.array([not _all_free(standing, packed, near) for near in around])
    if not taken.any():
        return ways
    wide = np.convolve(taken, np.ones(2 * AHEAD + 1))[AHEAD : AHEAD + len(taken)] > 0.5
    edges = np.flatnonzero(np.diff(np.concatenate([[False], wide, [False]]).astype(int)))
    for first, last in zip(edges[::2].tolist(), edges[1::2].tolist(), strict=True):
        everywhere = [place for near in around[first:last] for place in near]
        ways[first:last] = [standing.way_at(packed, everywhere)] * (last - first)
    return ways


def _all_free(standing: StandingPostures, packed: PackedTerrain, near: list[tuple[np.ndarray, float]]) -> bool:
    """Whether the nominal posture is free at all places."""
    return all(standing.is_free(packed, standing.over(NOMINAL, *place)) for place in near)


def _towards(places: np.ndarray, headings: np.ndarray, k: int, step: int) -> tuple[np.ndarray, float]:
    """Place and heading halfway from a posture to the one that is `step` after it."""
    other = min(max(k + step, 0), len(places) - 1)
    turn = (headings[other] - headings[k] + np.pi) % (2 * np.pi) - np.pi
    return 0.5 * (places[k] + places[other]), float(headings[k] + 0.5 * turn)
