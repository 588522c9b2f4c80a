"""Pushes of the published scenes: velocities that wind gives the document's robot, as impulses (Lin 2020 sec. 7.8)."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from scenes.disturbance import Disturbance

PUBLISHED_MASS = 63.47  # [kg] of the robot in Lin 2020 ch. VII
HIGH = 10.0  # [m] of a region, about the ground
PROBABILITY = 0.01  # that one of the pushes happens within 0.1 s


def gusts(
    direction: Sequence[float],
    speeds: Sequence[float],
    region: tuple[tuple[float, float], tuple[float, float]] | None = None,
) -> Disturbance:
    """Pushes along one direction, each as likely as the others.

    Args:
        direction: (3,) unit vector in W.
        speeds: changes of the published robot's velocity [m/s].
        region: least and greatest x, least and greatest y where they act [m]; None for everywhere.
    """
    impulses = PUBLISHED_MASS * np.outer(speeds, direction)
    if region is None:
        return Disturbance(impulses, PROBABILITY)
    (x0, x1), (y0, y1) = region
    X_WR = np.eye(4)
    X_WR[:2, 3] = (x0 + x1) / 2, (y0 + y1) / 2
    return Disturbance(impulses, PROBABILITY, (x1 - x0, y1 - y0, HIGH), X_WR)
