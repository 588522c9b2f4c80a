"""The plates that the named scenes are made of: level rectangles, upright ones, and rectangles tilted at random."""

from __future__ import annotations

import numpy as np

from scenes.scene import Start
from scenes.terrain.surface import Surface

FRICTION = 0.5  # Lin et al. 2019, sec. VII
GOAL_RADIUS = 0.2  # [m] Lin et al. 2019, sec. VII
START = Start((0.025, 0.0, 0.0))  # mean of the feet in every published scene
MAX_TILT = np.deg2rad(20.0)  # roll and pitch of rubble, Lin 2020 sec. 6.7.3
MAX_RISE = 0.05  # [m] height of a stone's centre over or under the platforms


def level_plate(name: str, x: tuple[float, float], y: tuple[float, float], z: float = 0.0) -> Surface:
    """A level rectangle, face up, between two x and two y at height z [m].

    Args:
        name: of the surface.
        x: least and greatest x in W [m].
        y: least and greatest y in W [m].
        z: height in W [m].
    """
    return Surface(name, np.array([[x[0], y[0], z], [x[1], y[0], z], [x[1], y[1], z], [x[0], y[1], z]]), FRICTION)


def wall_plate(name: str, x: tuple[float, float], y: float, z: tuple[float, float]) -> Surface:
    """An upright rectangle along x at this y, its face turned to the line y = 0 [m].

    Args:
        name: of the surface.
        x: least and greatest x in W [m].
        y: where the wall stands in W [m].
        z: least and greatest height in W [m].
    """
    corners = np.array([[x[0], y, z[0]], [x[1], y, z[0]], [x[1], y, z[1]], [x[0], y, z[1]]])
    return Surface(name, corners if y > 0 else corners[::-1], FRICTION)


def tilt_rotation(roll: float, pitch: float, yaw: float = 0.0) -> np.ndarray:
    """(3, 3) rotation Rx(roll) Ry(pitch) Rz(yaw) [rad], the order in which the published scenes are tilted.

    It is not Drake's RollPitchYaw, which is Rz Ry Rx.

    Args:
        roll: about x [rad].
        pitch: about y [rad].
        yaw: about z [rad].
    """
    (sr, sp, sy), (cr, cp, cy) = np.sin((roll, pitch, yaw)), np.cos((roll, pitch, yaw))
    return np.array(
        [
            [cp * cy, -cp * sy, sp],
            [sr * sp * cy + cr * sy, cr * cy - sr * sp * sy, -sr * cp],
            [sr * sy - cr * sp * cy, cr * sp * sy + sr * cy, cr * cp],
        ]
    )


def tilted_plate(
    name: str, centre: tuple[float, float, float], outline: np.ndarray, roll: float, pitch: float, yaw: float = 0.0
) -> Surface:
    """A flat outline, tilted about its origin and put at `centre`.

    Args:
        name: of the surface.
        centre: (3,) where the outline's origin goes [m].
        outline: (K, 2) counter-clockwise corners in the plate's own plane [m].
        roll: first angle of `tilt_rotation` [rad].
        pitch: second angle [rad].
        yaw: third angle [rad].
    """
    return Surface(name, outline @ tilt_rotation(roll, pitch, yaw)[:, :2].T + np.asarray(centre), FRICTION)


def rectangle(length: float, width: float) -> np.ndarray:
    """(4, 2) corners of a rectangle about the origin, length along x and width along y [m].

    Args:
        length: along x [m].
        width: along y [m].
    """
    return np.array([[-length, -width], [length, -width], [length, width], [-length, width]]) / 2


def rubble(
    rng: np.random.Generator,
    *,
    rows: int,
    lanes: int,
    length: float,
    width: float,
    near_edge: float,
) -> list[Surface]:
    """Stones edge to edge in plan view, each tilted and raised at random (Lin 2020 sec. 6.7.3).

    Roll and pitch are uniform within `MAX_TILT`, the height of the centre within `MAX_RISE`.

    Args:
        rng: source of the draws.
        rows: stones along x.
        lanes: stones along y, the middle of the lanes at y = 0.
        length: edge along x [m].
        width: edge along y [m].
        near_edge: x where the first row begins [m].
    """
    outline = rectangle(length, width)
    tilts = rng.uniform(-MAX_TILT, MAX_TILT, (rows, lanes, 2))
    rises = rng.uniform(-MAX_RISE, MAX_RISE, (rows, lanes))
    stones = []
    for row in range(rows):
        for lane in range(lanes):
            centre = (near_edge + (row + 0.5) * length, (lane + 0.5 - lanes / 2) * width, rises[row, lane])
            stones.append(tilted_plate(f"stone_{row}_{lane}", centre, outline, *tilts[row, lane]))
    return stones
