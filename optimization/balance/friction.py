"""Friction cones by name, and what a flat patch can transmit through them.

Forces are written in the contact frame C: z along the surface's outward normal. A cone is one of

    inner         regular octagon inscribed in the true cone, corners at multiples of 45 deg (the default)
    square        |fx|, |fy| <= mu/sqrt(2) fz: the square inscribed in the true cone
    second_order  hypot(fx, fy) <= mu fz: the true cone; linear programs use the 16-gon inscribed in it
    diamond       |fx| + |fy| <= sqrt(2) mu fz: contains the true cone and is up to 41 % larger; for reproduction only

A contact is a rectangular patch. It can transmit a wrench exactly when four forces at the patch's corners, each inside
the cone, add up to it, so friction, centre of pressure and yaw torque hold together (Caron et al. 2015).

Caron et al. 2015: "Stability of surface contacts for humanoid robots: closed-form formulae of the contact wrench cone
for rectangular support areas", ICRA.
"""

from __future__ import annotations

from enum import StrEnum

import numpy as np
from numba import njit
from numpy.typing import ArrayLike

from scenes.input_error import unknown_name

INNER, SQUARE, SECOND_ORDER, DIAMOND = range(4)  # the cones for compiled code


class FrictionCone(StrEnum):
    """A friction cone; `FrictionCone("inner")` makes one of its name, and a wrong name raises `InputError`.

    A cone compares equal to its name and is written to files as its name.
    """

    INNER = "inner"
    SQUARE = "square"
    SECOND_ORDER = "second_order"
    DIAMOND = "diamond"

    @classmethod
    def _missing_(cls, value: object) -> FrictionCone:
        raise unknown_name("friction cone", str(value), [cone.value for cone in cls])

    @property
    def code(self) -> int:
        """The cone for compiled code: INNER, SQUARE, SECOND_ORDER or DIAMOND of this module."""
        return _CODES[self]


_CODES = {
    FrictionCone.INNER: INNER,
    FrictionCone.SQUARE: SQUARE,
    FrictionCone.SECOND_ORDER: SECOND_ORDER,
    FrictionCone.DIAMOND: DIAMOND,
}
CONES = tuple(FrictionCone)
DEFAULT_CONE = FrictionCone.INNER  # lies inside the true cone: friction is never optimistic

COS_22, SIN_22 = float(np.cos(np.pi / 8)), float(np.sin(np.pi / 8))
SQRT2 = float(np.sqrt(2.0))

# Cross-section of each cone at fz = 1, mu = 1: (number of corners, angle of the first one, distance to the corners).
_SECTION = {
    FrictionCone.INNER: (8, 0.0, 1.0),
    FrictionCone.SQUARE: (4, np.pi / 4, 1.0),
    FrictionCone.SECOND_ORDER: (16, 0.0, 1.0),
    FrictionCone.DIAMOND: (4, 0.0, SQRT2),
}


def cone_generators(cone: FrictionCone, mu: float) -> np.ndarray:
    """Edges of the (polyhedral) cone: every admissible force is a nonnegative combination of them.

    Args:
        cone: which cone; `second_order` gives the 16-gon inscribed in the true cone.
        mu: Coulomb coefficient [-], not negative.

    Returns:
        (G, 3) rays in C with fz = 1, counter-clockwise about the normal.

    Raises:
        InputError: no cone has this name.
        ValueError: `mu` is negative or not finite.
    """
    corners, first, radius = _section(cone, mu)
    angle = first + 2 * np.pi * np.arange(corners) / corners
    return np.stack([mu * radius * np.cos(angle), mu * radius * np.sin(angle), np.ones(corners)], axis=1)


def cone_rows(cone: FrictionCone, mu: float) -> np.ndarray:
    """Faces of the same cone: a force f in C is admissible when rows @ f <= 0.

    A row's tangential part has unit length, so rows @ f is the force [N] that sticks out. The last row is fz >= 0.

    Args:
        cone: one of `CONES`.
        mu: Coulomb coefficient of the true cone [-].

    Returns:
        (G + 1, 3).
    """
    corners, first, radius = _section(cone, mu)
    angle = first + 2 * np.pi * (np.arange(corners) + 0.5) / corners
    apothem = mu * radius * np.cos(np.pi / corners)
    rows = np.stack([np.cos(angle), np.sin(angle), np.full(corners, -apothem)], axis=1)
    return np.vstack([rows, [0.0, 0.0, -1.0]])


def _section(cone: FrictionCone, mu: float) -> tuple[int, float, float]:
    if not np.isfinite(mu) or mu < 0:
        raise ValueError(f"friction must be finite and not negative, got {mu}")
    return _SECTION[FrictionCone(cone)]


@njit(cache=True)
def excess(cone: int, mu: float, fx: float, fy: float, fz: float) -> float:
    """How far a force in C sticks out of a cone [unit of f]; not positive inside, NaN if any input is.

    The largest entry of `cone_rows(...) @ f`, except that SECOND_ORDER is the true cone here. By symmetry only the
    face nearest to the force counts: with a >= b >= 0 the sorted |fx|, |fy|,

        inner   a cos 22.5 + b sin 22.5 - mu cos 22.5 fz        square        a - mu/sqrt(2) fz
        diamond (a + b)/sqrt(2) - mu fz                         second_order  hypot(a, b) - mu fz

    Args:
        cone: INNER, SQUARE, SECOND_ORDER or DIAMOND.
        mu: Coulomb coefficient [-].
        fx, fy, fz: the force in C, in any unit.
    """
    a, b = abs(fx), abs(fy)
    if a < b:
        a, b = b, a
    if cone == INNER:
        out = COS_22 * (a - mu * fz) + SIN_22 * b
    elif cone == SQUARE:
        out = a - mu / SQRT2 * fz
    elif cone == SECOND_ORDER:
        out = np.sqrt(a * a + b * b) - mu * fz
    else:
        out = (a + b) / SQRT2 - mu * fz
    return out if out > -fz or np.isnan(out) else -fz


@njit(cache=True)
def excess_many(cone: int, mu: np.ndarray, f: np.ndarray) -> np.ndarray:
    """(n,) `excess` of the forces f (n, 3) under the coefficients mu (n,).

    Args:
        cone: index of the cone in `CONES`.
        mu: (n,) Coulomb coefficients [-].
        f: (n, 3) forces in C [N, or any unit: the answer has the same].
    """
    out = np.empty(f.shape[0])
    for i in range(f.shape[0]):
        out[i] = excess(cone, mu[i], f[i, 0], f[i, 1], f[i, 2])
    return out


def contains(cone: FrictionCone, mu: ArrayLike, f: ArrayLike, tol: float = 1e-9) -> np.ndarray:
    """Whether forces lie inside the cone; the true cone for `second_order`.

    Args:
        cone: which cone.
        mu: (...) Coulomb coefficients [-], broadcast against f.
        f: (..., 3) forces in C.
        tol: force that may stick out [unit of f].

    Returns:
        (...) bool; False where anything is NaN.
    """
    f = np.asarray(f, float)
    mu = np.ascontiguousarray(np.broadcast_to(np.asarray(mu, float), f.shape[:-1]))
    out = excess_many(FrictionCone(cone).code, mu.ravel(), np.ascontiguousarray(f.reshape(-1, 3)))
    return (out <= tol).reshape(f.shape[:-1])


@njit(cache=True)
def frame_stands_alone(cone: int, mu: float, R_WC: np.ndarray) -> bool:
    """Whether one contact with this orientation (3, 3) can carry a resting robot by itself; see `stands_alone`.

    Args:
        cone: index of the cone in `CONES`.
        mu: Coulomb coefficient [-].
        R_WC: (3, 3) contact orientation.
    """
    return excess(cone, mu, R_WC[2, 0], R_WC[2, 1], R_WC[2, 2]) <= 1e-12


def stands_alone(cone: FrictionCone, mu: ArrayLike, R_WC: ArrayLike) -> np.ndarray:
    """Whether a single contact can carry a robot at rest, its weight being the only other force.

    The contact must push with M g e_z. In C that is M g times the last row of R_WC, so the answer is whether that row
    lies in the cone; the centre of mass then stands over the patch. It depends on the heading as well as on the tilt
    (except for `second_order`), because the polyhedral cones turn with the frame.

    Args:
        cone: which cone; the true cone for `second_order`.
        mu: (...) Coulomb coefficients [-].
        R_WC: (..., 3, 3) contact orientations.

    Returns:
        (...) bool.
    """
    R_WC = np.asarray(R_WC, float)
    return contains(cone, mu, R_WC[..., 2, :], tol=1e-12)


def corner_points(half_extent: ArrayLike) -> np.ndarray:
    """(4, 3) corners of a patch in C [m], counter-clockwise from (+x, +y).

    Args:
        half_extent: (2,) half length along x and half width along y [m].
    """
    hx, hy = np.asarray(half_extent, float)
    return np.array([[hx, hy, 0.0], [-hx, hy, 0.0], [-hx, -hy, 0.0], [hx, -hy, 0.0]])


def wrench_rows(mu: float, half_extent: ArrayLike) -> np.ndarray:
    """Faces of all wrenches that a patch can transmit under the `square` cone: rows @ (f, m) <= 0.

    Caron et al. 2015, eq. 15 to 19 with their mu (of one axis) equal to m = mu/sqrt(2) here; X, Y the half extents:

        |fx|, |fy| <= m fz         friction (4)             fz >= 0         unilateral (1)
        |mx| <= Y fz, |my| <= X fz centre of pressure (4)
        |mz| + ...                 yaw (8):  mz <= m (X+Y) fz - |Y fx + m mx| - |X fy + m my|
                                            -mz <= m (X+Y) fz - |Y fx - m mx| - |X fy - m my|

    They hold exactly for sums of four corner forces inside the cone. The other cones have no form this short: use
    corner forces there (an octagon wants its own yaw rows, not these with the full mu).

    Args:
        mu: Coulomb coefficient of the true cone [-].
        half_extent: (2,) half length along x and half width along y [m].

    Returns:
        (17, 6) rows on (fx, fy, fz, mx, my, mz) in C, moments about the patch's centre. Friction, unilateral, centre of
        pressure, yaw.
    """
    X, Y = (float(h) for h in np.asarray(half_extent, float))
    m = mu / SQRT2
    rows = [
        [1.0, 0, -m, 0, 0, 0],
        [-1.0, 0, -m, 0, 0, 0],
        [0, 1.0, -m, 0, 0, 0],
        [0, -1.0, -m, 0, 0, 0],
        [0, 0, -1.0, 0, 0, 0],
        [0, 0, -Y, 1.0, 0, 0],
        [0, 0, -Y, -1.0, 0, 0],
        [0, 0, -X, 0, 1.0, 0],
        [0, 0, -X, 0, -1.0, 0],
    ]
    for side in (1.0, -1.0):
        for a in (1.0, -1.0):
            for b in (1.0, -1.0):
                rows.append([a * Y, b * X, -m * (X + Y), side * a * m, side * b * m, side])
    return np.array(rows)
