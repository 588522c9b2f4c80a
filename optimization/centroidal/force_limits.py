"""How hard each contact may be pressed in each interval: within the robot's limits, gently at its first and last moments."""

from __future__ import annotations

import numpy as np

from optimization.centroidal.contact_schedule import ContactSchedule
from optimization.centroidal.options import CentroidalOptions
from scenes.effector import FEET


def force_limits(schedule: ContactSchedule, options: CentroidalOptions) -> np.ndarray:
    """(N-1, E) greatest normal force of each end effector in each interval [M g].

    Args:
        schedule: which contacts are active when.
        options: limits of the end effectors, and the reserve's on the first and the last interval of a contact. Those hold where
            a foot that carries stays.
    """
    active, brief = schedule.active, options.reserve.brief
    limits = np.tile(np.asarray(options.force_limit, float), (len(active), 1))
    if brief is None or len(active) < 2:
        return limits
    before, after = active[:-1], active[1:]
    stays = (before == after) & (after >= 0)
    for e in range(active.shape[1]):
        carried = stays[:, [foot for foot in range(len(FEET)) if foot != e]].any(axis=1)
        changes = (before[:, e] != after[:, e]) & carried
        for n in (*np.flatnonzero(changes & (before[:, e] >= 0)), *np.flatnonzero(changes & (after[:, e] >= 0)) + 1):
            limits[n, e] = min(limits[n, e], brief)
    return limits
