"""Capture of the linear inverted pendulum on level ground: closed forms to hold the exact answers against.

Koolen et al. 2012: T. Koolen et al., "Capturability-based analysis and control of legged locomotion, part 1", IJRR 31.

With its CoM at a constant height h and omega^2 = g / h, the capture point xi = c + v / omega of a robot obeys

    d xi / dt = omega (xi - p) - omega (kdot x e_z) / (M g)

p being the centre of pressure. It comes to rest only if xi_0 = omega int exp(-omega t) (p + kdot x e_z / (M g)) dt, so
that xi_0 lies no farther outside the ground that p can reach than the angular momentum allows.
"""

from __future__ import annotations

import numpy as np
import shapely
from shapely import MultiPoint
from shapely.geometry.base import BaseGeometry

from optimization.centroidal.options import CentroidalOptions
from scenes.contact import patch_corners
from scenes.gravity import GRAVITY
from scenes.robots.robot import Robot
from scenes.stance import Stance


def frequency(height: float) -> float:
    """omega = sqrt(g / h) of a CoM this high over the ground [1/s]."""
    return float(np.sqrt(GRAVITY / height))


def capture_point(com: np.ndarray, velocity: np.ndarray, ground: float = 0.0) -> np.ndarray:
    """(2,) xi = c + v / omega on the ground [m], for com (3,) [m], velocity (3,) [m/s] and ground height [m].

    Args:
        com: (3,) in W [m].
        velocity: (3,) of the CoM in W [m/s].
        ground: height of the ground [m].
    """
    return np.asarray(com[:2] + velocity[:2] / frequency(com[2] - ground))


def support_polygon(stance: Stance, robot: Robot) -> BaseGeometry:
    """Convex hull of the feet's supports in x and y [m]; for level ground without palms.

    Args:
        stance: its feet count.
        robot: gives the half extents of the feet.
    """
    corners = []
    for contact, half in zip(stance.contacts[:2], robot.half_extents, strict=False):
        if contact is not None:
            support = patch_corners(half) if contact.support is None else contact.support
            corners.append(contact.p_WC[:2] + support @ contact.R_WC[:2, :2].T)
    if not corners:
        raise ValueError("no foot is on the ground")
    return MultiPoint(np.concatenate(corners)).convex_hull


def one_step_region(before: BaseGeometry, after: BaseGeometry, swing_time: float, omega: float) -> BaseGeometry:
    """Capture points from which a step in `swing_time` [s] captures the pendulum (Koolen et al. 2012 sec. 3.3).

    xi(d) = p + (xi_0 - p) exp(omega d) must lie in the support after the step, p anywhere in the one before:
    xi_0 in exp(-omega d) after + (1 - exp(-omega d)) before, a Minkowski sum.

    Args:
        before: support until the step [m].
        after: support from the step on [m].
        swing_time: time until the step [s].
        omega: frequency of the pendulum [1/s].
    """
    shrink = float(np.exp(-omega * swing_time))
    first, second = (np.array(polygon.exterior.coords)[:-1] for polygon in (after, before))  # type: ignore[attr-defined]
    sums = shrink * first[:, None] + (1.0 - shrink) * second[None]
    return MultiPoint(sums.reshape(-1, 2)).convex_hull


def depth_inside(region: BaseGeometry, point: np.ndarray) -> float:
    """Distance of a point (2,) to the region's edge, positive inside [m].

    Args:
        region: in x and y of W [m].
        point: (2,) [m].
    """
    return float(depths_inside(region, point[None])[0])


def depths_inside(region: BaseGeometry, points: np.ndarray) -> np.ndarray:
    """(n,) distances of points to the region's edge, positive inside [m].

    Args:
        region: a polygon in x and y of W [m].
        points: (n, 2) [m].
    """
    places = shapely.points(points)
    away = shapely.distance(region.exterior, places)  # type: ignore[attr-defined]
    return np.where(shapely.contains(region, places), away, -away)


def angular_allowance(options: CentroidalOptions, mass: float, omega: float) -> float:
    """How far outside its support a capture point may lie that angular momentum still brings back [m].

    |kdot|max / (M g) + omega |k|max / (M g), the maxima over the horizontal axes.

    Args:
        options: limits on the angular momentum [N m s] and its rate [N m].
        mass: M [kg].
        omega: frequency of the pendulum [1/s].
    """
    rate = max(options.angular_momentum_rate_limit[:2])
    most = max(options.angular_momentum_limit[:2])
    return (rate + omega * most) / (mass * GRAVITY)
