"""Floors above each other: at which heights the robot can stand over a point, and which of them is meant."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from scenes.effector import EFFECTORS
from scenes.footholds.partial_support import rest_down
from scenes.footholds.projection import FOOT_CLEARANCE, set_down
from scenes.input_error import InputError
from scenes.robots.robot import Robot
from scenes.terrain.free_boxes import box_is_free
from scenes.terrain.packed_terrain import PackedTerrain

Z_WINDOW = 0.5  # [m] around a start's or goal's z in which its floor is looked for
COLUMN = 0.05  # [m] edge of the column over a point that must be free for the robot to stand there
SAME_LEVEL = 0.02  # [m] surfaces closer than this are looked at as one


@dataclass(frozen=True)
class Floor:
    """Ground at a point, with what lies at the same point further up and down.

    Attributes:
        z: height [m].
        low: halfway down to the floor below [m], -inf where there is none.
        high: halfway up to the floor above [m], inf where there is none.
        head_room: whether nothing is in the way of a robot that stands there.
    """

    z: float
    low: float
    high: float
    head_room: bool

    def window(self, z: float) -> tuple[float, float]:
        """Least and greatest height of its footholds [m], `Z_WINDOW` about z where z is a number."""
        if not np.isfinite(z):
            return self.low, self.high
        return max(self.low, z - Z_WINDOW), min(self.high, z + Z_WINDOW)


def floors_at(
    packed: PackedTerrain, robot: Robot, x: float, y: float, yaw: float, full_soles: bool = True
) -> tuple[Floor, ...]:
    """The floors that take a sole at a point, lowest first.

    Surfaces that take a sole less than the torso's height apart are one floor, at the height of the highest: nobody
    stands between them.

    Args:
        packed: the terrain.
        robot: who stands there.
        x: of the point in W [m].
        y: of the point in W [m].
        yaw: heading of the sole in W [rad].
        full_soles: whether all of the sole has to rest on them.
    """
    tops: list[float] = []
    bottoms: list[float] = []
    knee = float(robot.torso_box_centre[2] - 0.5 * robot.torso_box_size[2])
    below = np.inf
    spec = robot.effectors[0]
    while True:
        if full_soles:
            foot = set_down(packed, EFFECTORS[0], x, y, yaw, spec.half_extent, (-np.inf, below), overhang=spec.overhang)
        else:
            foot = rest_down(packed, spec, (x, y, yaw), (-np.inf, below))
        if foot is None:
            break
        z = float(foot.p_WC[2])
        if bottoms and bottoms[-1] - z < knee:
            bottoms[-1] = z
        else:
            tops.append(z)
            bottoms.append(z)
        below = z - SAME_LEVEL
    if not tops:
        return ()
    tops, bottoms = tops[::-1], bottoms[::-1]
    lows = [-np.inf, *(0.5 * (a + b) for a, b in zip(tops[:-1], bottoms[1:], strict=True))]
    return tuple(
        Floor(z, low, high, has_head_room(packed, robot, x, y, z))
        for z, low, high in zip(tops, lows, [*lows[1:], np.inf], strict=True)
    )


def has_head_room(packed: PackedTerrain, robot: Robot, x: float, y: float, z: float) -> bool:
    """Whether a thin column over a point is free up to the top of the torso.

    Args:
        packed: the terrain.
        robot: who would stand there.
        x: of the point in W [m].
        y: of the point in W [m].
        z: of the ground there in W [m].
    """
    top = float(robot.torso_box_centre[2] + 0.5 * robot.torso_box_size[2])
    centre = np.array([0.0, 0.0, 0.5 * (FOOT_CLEARANCE + top)])
    size = np.array([COLUMN, COLUMN, top - FOOT_CLEARANCE])
    return bool(box_is_free(packed, np.array([x, y, z], float), 0.0, centre, size))


def floors_around(
    packed: PackedTerrain,
    robot: Robot,
    points: Iterable[tuple[float, float]],
    yaw: float,
    z: float,
    full_soles: bool = True,
) -> tuple[Floor, ...]:
    """The floors at the first of some points that has one with head room, within `Z_WINDOW` of z where that is a number.

    Where no point has head room, those of the first point that has ground; empty where none has.

    Args:
        packed: the terrain.
        robot: who stands there.
        points: (x, y) in W [m], the one that is meant first.
        yaw: heading of the sole in W [rad].
        z: height that is meant in W [m], NaN for any.
        full_soles: whether all of a sole has to rest on them; else that is tried first.
    """
    if not full_soles:
        points = list(points)
        whole = _floors_around(packed, robot, points, yaw, z, full_soles=True)
        if in_window(whole, z):
            return whole
        part = _floors_around(packed, robot, points, yaw, z, full_soles=False)
        return part if in_window(part, z) else whole or part
    return _floors_around(packed, robot, points, yaw, z, full_soles=True)


def _floors_around(
    packed: PackedTerrain,
    robot: Robot,
    points: Iterable[tuple[float, float]],
    yaw: float,
    z: float,
    full_soles: bool,
) -> tuple[Floor, ...]:
    without: tuple[Floor, ...] = ()
    for x, y in points:
        found = floors_at(packed, robot, x, y, yaw, full_soles)
        if any(f.head_room for f in in_window(found, z)):
            return found
        if in_window(found, z) and not in_window(without, z):
            without = found
        without = without or found
    return without


def in_window(floors: Iterable[Floor], z: float) -> list[Floor]:
    """The floors within `Z_WINDOW` of z; all where z is not a number.

    Args:
        floors: to choose from.
        z: height that is meant in W [m], NaN for any.
    """
    return [f for f in floors if not np.isfinite(z) or abs(f.z - z) <= Z_WINDOW]


def by_preference(floors: Iterable[Floor], z: float, beside: float) -> list[Floor]:
    """The floors that may be meant, best first: with head room, then nearest to z; without z nearest to `beside`.

    Args:
        floors: at one point.
        z: height that is meant in W [m], NaN for any.
        beside: height to be near where z is NaN [m]; NaN: the lowest floor comes first.
    """
    wanted = z if np.isfinite(z) else beside

    def rank(floor: Floor) -> tuple[bool, float, float]:
        return not floor.head_room, abs(floor.z - wanted) if np.isfinite(wanted) else floor.z, floor.z

    return sorted(in_window(floors, z), key=rank)


def choice_note(key: str, floors: Iterable[Floor], taken: float) -> str:
    """One line where a start or goal without a height lies on several floors, "" where it does not.

    Args:
        key: "start" or "goal".
        floors: at the place.
        taken: height that was taken [m].
    """
    heights = [f.z for f in floors if f.head_room]
    if len(heights) < 2:
        return ""
    return f"{key}: there are floors at z {heights_text(heights)} m: took {taken:.2f}; --{key}-z chooses another"


def heights_text(heights: Iterable[float]) -> str:
    """Heights for a message, "0.00, 1.20 and 2.40"."""
    texts = [f"{z:.2f}" for z in heights]
    return texts[0] if len(texts) == 1 else f"{', '.join(texts[:-1])} and {texts[-1]}"


def no_floor_near(where: str, floors: Iterable[Floor], z: float) -> InputError:
    """The error for a height that no floor is near.

    Args:
        where: what the message begins with: scene and key.
        floors: that are there.
        z: the height that was asked for [m].
    """
    return InputError(
        f"{where}: no floor within {Z_WINDOW:g} m of z {z:g}; there are floors at z {heights_text(f.z for f in floors)} m"
    )
