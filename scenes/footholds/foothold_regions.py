"""Where on a surface an end effector may be placed: convex regions of contact points, one per surface and heading interval.

A point of a region takes the whole patch inside the surface at every heading of the interval, with nothing standing
above it, so that whatever an optimisation picks from a region is a real contact (Deits & Tedrake 2014 call these safe
regions; there they grow by IRIS, here terrain already comes as convex polygons that shrink by the sole).
"""

from __future__ import annotations

import itertools
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import shapely

from scenes.contact import Contact, contact_pose, contact_rotation
from scenes.effector import EFFECTORS, is_foot
from scenes.footholds.free_space import FreeSpace, free_space, turned_footprint
from scenes.footholds.projection import patch_shape
from scenes.robots.robot import Robot
from scenes.terrain.floors import JOINT
from scenes.terrain.packed_terrain import PackedTerrain
from scenes.terrain.polygon import area, clip, edge_normals

MARGIN = 1e-3  # [m] regions stay this far inside, so that a solver's tolerance never puts a patch outside
LEAST_AREA = 1e-4  # [m^2] smaller pieces are dropped
MAX_PIECES = 3  # of one surface
MOST_CUT = 8  # pieces that are cut further, while there are polygons to take from them
WORTH = 0.15  # share of what is kept already that a further piece must add: each costs a binary variable a contact


@dataclass(frozen=True, eq=False)
class FootholdRegion:
    """Contact points of one end effector on one surface at the headings of an interval.

    Attributes:
        effector: index into `EFFECTORS`.
        surface: index into the terrain's surfaces.
        heading: least and greatest heading [rad].
        vertices: (K, 3) of the region in W [m], counter-clockwise seen from outside.
        A, b: (K, 3), (K,) with A p <= b [m] for the points p of the region, in W; rows are unit vectors in the plane.
        normal, offset: of the plane normal @ p = offset.
        friction: Coulomb coefficient.
        R_WC: (3, 3) contact frame at the middle of the heading interval.
    """

    effector: int
    surface: int
    heading: tuple[float, float]
    vertices: np.ndarray
    A: np.ndarray
    b: np.ndarray
    normal: np.ndarray
    offset: float
    friction: float
    R_WC: np.ndarray

    @property
    def middle(self) -> np.ndarray:
        """(3,) mean of the vertices [m]."""
        return self.vertices.mean(axis=0)

    def contact(self, p: np.ndarray, heading: float) -> Contact:
        """The contact at the point p (3,) [m], moved onto the plane, with this heading.

        Args:
            p: (3,) point in W [m].
            heading: yaw of the contact in W [rad].
        """
        on_plane = p - (self.normal @ p - self.offset) * self.normal
        name = EFFECTORS[self.effector]
        return Contact(
            name, self.surface, contact_pose(name, on_plane, self.normal, heading), self.friction, float(heading)
        )


def foothold_regions(
    packed: PackedTerrain,
    robot: Robot,
    effector: int,
    heading: tuple[float, float],
    *,
    holds: Callable[[float, np.ndarray], bool] | None = None,
) -> list[FootholdRegion]:
    """Every region where an end effector may be placed.

    Args:
        packed: surfaces to stand on, and what stands above them.
        robot: whose patches.
        effector: index into `EFFECTORS`.
        heading: least and greatest heading [rad].
        holds: whether a contact with this friction coefficient and orientation R_WC (3, 3) is good enough; surfaces on
            which it is not are left out (quasi-static walking: one contact must carry the weight by itself).
    """
    spec = robot.effectors[effector]
    patch, anywhere = patch_shape(spec), np.empty((0, 3))
    found = []
    for number in np.flatnonzero(packed.allowed[: packed.num_surfaces, effector]).tolist():
        normal = packed.normal[number]
        if is_foot(spec.name) and normal[2] < 1e-3:
            continue
        R_WC = contact_rotation(spec.name, normal, float(np.mean(heading)))
        if holds is not None and not holds(float(packed.friction[number]), R_WC):
            continue
        footprint = turned_footprint(patch, *_turns(spec.name, normal, heading, R_WC), MARGIN, MARGIN)
        space = free_space(packed, number, R_WC, footprint, anywhere)
        found += [_region(packed, number, effector, heading, R_WC, piece) for piece in convex_pieces(space)]
    return found


def disc_region(packed: PackedTerrain, number: int, effector: int, radius: float) -> FootholdRegion | None:
    """The region for any heading whatever of a patch that holds a disc of this radius: for bounds, not for plans.

    On a piece of a floor the disc may reach beyond the piece.

    Args:
        packed: has the surface.
        number: of the surface.
        effector: index into `EFFECTORS`.
        radius: of the disc [m].
    """
    R_WC = contact_rotation(EFFECTORS[effector], packed.normal[number], 0.0)
    outline = shapely.Polygon(packed.vertices[number, : packed.count[number]] @ R_WC[:, :2])
    inside = outline.buffer(JOINT if packed.floor[number] >= 0 else -radius, join_style="mitre")
    if inside.is_empty:
        return None
    corners = shapely.get_coordinates(shapely.orient_polygons(inside))[:-1]
    return _region(packed, number, effector, (0.0, 0.0), R_WC, corners)


def convex_pieces(space: FreeSpace) -> list[np.ndarray]:
    """(K, 2) the largest convex parts of a free space, which may overlap; what they leave out is small.

    Args:
        space: one outline, less convex polygons.
    """
    pieces = [space.outline] if len(space.outline) else []
    for first, end in itertools.pairwise(space.start):
        parts = [part for piece in pieces for part in _beside(piece, space.corner[first:end])]
        pieces = _worth_keeping(parts, MOST_CUT, 0.0) if len(parts) > len(pieces) else parts
    return _worth_keeping(pieces, MAX_PIECES, WORTH)


def _beside(piece: np.ndarray, polygon: np.ndarray) -> list[np.ndarray]:
    """The parts of a convex piece beyond each edge of a convex polygon; the piece where they are apart."""
    own, first = edge_normals(piece)
    if ((polygon @ own.T).min(axis=0) >= (piece[first] * own).sum(axis=1)).any():
        return [piece]  # the polygon is beyond one of its edges
    normals, start = edge_normals(polygon)
    parts = []
    for normal, corner in zip(normals, polygon[start], strict=True):
        height = (corner - piece) @ normal
        if height.max() <= 0.0:
            return [piece]  # all of it is beyond this edge
        if height.min() < 0.0:
            parts.append(clip(piece, height))
    return [part for part in parts if area(part) > LEAST_AREA]


def _worth_keeping(pieces: list[np.ndarray], most: int, worth: float) -> list[np.ndarray]:
    """The largest piece and those that add enough to it, a share of what is kept already; pieces may overlap."""
    kept: list[np.ndarray] = []
    covered = shapely.Polygon()
    for piece in sorted(pieces, key=area, reverse=True):
        if len(kept) == most:
            break
        outline = shapely.Polygon(piece)
        if not kept or outline.difference(covered).area > max(worth * covered.area, LEAST_AREA):
            kept.append(piece)
            covered = covered.union(outline)
    return kept


def _turns(effector: str, normal: np.ndarray, heading: tuple[float, float], R_WC: np.ndarray) -> tuple[float, float]:
    """Turns about the normal from a contact frame to those at the least and at the greatest heading [rad]."""
    ends = [R_WC[:, :2].T @ contact_rotation(effector, normal, yaw)[:, 0] for yaw in heading]
    turns = [float(np.arctan2(x[1], x[0])) for x in ends]
    return min(turns), max(turns)


def _region(
    packed: PackedTerrain,
    number: int,
    effector: int,
    heading: tuple[float, float],
    R_WC: np.ndarray,
    polygon: np.ndarray,
) -> FootholdRegion:
    """The region of contact points (K, 2), coordinates x and y of the contact frame at the origin of W."""
    normal, offset = packed.normal[number], float(packed.offset[number])
    vertices = polygon @ R_WC[:, :2].T + offset * normal
    outward, start = edge_normals(polygon)
    A = outward @ R_WC[:, :2].T
    b = (A * vertices[start]).sum(axis=1)
    return FootholdRegion(
        effector, number, heading, vertices, A, b, normal, offset, float(packed.friction[number]), R_WC
    )
