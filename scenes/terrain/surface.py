"""A convex planar polygon that end effectors may touch."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import shapely

from scenes.effector import EFFECTORS, is_foot
from scenes.input_error import InputError
from scenes.terrain.polygon import polygon_normal

PLANARITY = 1e-3  # [m] how far a vertex may lie off the polygon's plane
MIN_AREA = 1e-6  # [m^2] below this a polygon is a line or a point
FOOT_MAX_TILT = np.deg2rad(45.0)  # feet use surfaces up to here from level
PALM_TILT = (np.deg2rad(45.0), np.deg2rad(135.0))  # palms use surfaces between these


@dataclass(frozen=True, eq=False)
class Surface:
    """A convex planar polygon with an outward normal, seen counter-clockwise from outside.

    Attributes:
        name: unique in its terrain.
        vertices: (K, 3) [m] in W, counter-clockwise when the outward normal points at the viewer.
        friction: Coulomb coefficient [-].
        effectors: names of the end effectors that may touch it; None means "by tilt" (feet up to
            45 deg from level, palms from 45 to 135 deg).

    Raises:
        InputError: not finite, fewer than three vertices, not planar, self-intersecting, not convex or empty.
    """

    name: str
    vertices: np.ndarray
    friction: float = 0.5
    effectors: frozenset[str] | None = None

    def __post_init__(self) -> None:
        vertices = np.array(self.vertices, dtype=float)
        vertices.setflags(write=False)
        object.__setattr__(self, "vertices", vertices)
        _check_polygon(self.name, vertices)
        if not np.isfinite(self.friction) or self.friction < 0:
            raise InputError(f"surface {self.name!r}: friction must be finite and not negative, got {self.friction}")
        if self.effectors is not None:
            object.__setattr__(self, "effectors", frozenset(self.effectors))
            unknown = sorted(self.effectors - set(EFFECTORS))
            if unknown:
                raise InputError(f"surface {self.name!r}: contact names {unknown}, expected some of {list(EFFECTORS)}")

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, Surface):
            return NotImplemented
        return (
            self.name == other.name
            and np.array_equal(self.vertices, other.vertices)
            and self.friction == other.friction
            and self.effectors == other.effectors
        )

    def __hash__(self) -> int:
        return hash((self.name, self.vertices.tobytes(), self.friction, self.effectors))

    @cached_property
    def normal(self) -> np.ndarray:
        """(3,) outward unit normal in W."""
        normal = polygon_normal(self.vertices)
        normal.setflags(write=False)
        return normal

    @cached_property
    def tilt(self) -> float:
        """Angle between the outward normal and the vertical [rad], 0 level floor, pi ceiling."""
        return float(np.arccos(np.clip(self.normal[2], -1.0, 1.0)))

    @cached_property
    def centroid(self) -> np.ndarray:
        """(3,) mean of the vertices in W [m]."""
        return self.vertices.mean(axis=0)

    def allows(self, effector: str) -> bool:
        """Whether the end effector of this name may touch the surface."""
        if self.effectors is not None:
            return effector in self.effectors
        if is_foot(effector):
            return self.tilt <= FOOT_MAX_TILT + 1e-9
        return PALM_TILT[0] - 1e-9 <= self.tilt <= PALM_TILT[1] + 1e-9

    def flipped(self) -> Surface:
        """The same polygon with the opposite outward normal."""
        return Surface(self.name, self.vertices[::-1], self.friction, self.effectors)


def _check_polygon(name: str, vertices: np.ndarray) -> None:
    where = f"surface {name!r}: vertices"
    if vertices.ndim != 2 or vertices.shape[1:] != (3,) or len(vertices) < 3:
        raise InputError(f"{where} must be at least three [x, y, z] triples")
    if not np.isfinite(vertices).all():
        raise InputError(f"{where} must be finite numbers")
    # A self-crossing outline can have any Newell normal, so planarity is judged by the best-fit plane.
    centred = vertices - vertices.mean(axis=0)
    _, spread, axes = np.linalg.svd(centred)
    if spread[1] < 1e-9:
        raise InputError(f"{where} enclose no area")
    off_plane = np.abs(centred @ axes[2]).max()
    if off_plane > PLANARITY:
        raise InputError(
            f"{where} must lie in one plane, one is {off_plane:.3g} m off it; cut the polygon into flat pieces"
        )
    outline = shapely.Polygon(centred @ axes[:2].T)
    if not outline.is_valid:
        raise InputError(f"{where} cross themselves ({shapely.is_valid_reason(outline)})")
    if outline.area < MIN_AREA:
        raise InputError(f"{where} enclose no area ({outline.area:.3g} m^2)")
    if outline.convex_hull.area - outline.area > 1e-6 + 1e-4 * outline.area:
        raise InputError(f"{where} must be convex; cut the polygon into convex pieces")
