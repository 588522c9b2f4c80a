"""Where on a surface an end effector may be placed: convex regions of contact points, one per surface and heading interval.

A point of a region takes the whole patch inside the surface at every heading of the interval, with nothing standing
above it, so that whatever an optimisation picks from a region is a real contact (Deits & Tedrake 2014 call these safe
regions; there they grow by IRIS, here terrain already comes as convex polygons that shrink by the sole).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import shapely

from scenes.contact import Contact, contact_pose, contact_rotation
from scenes.effector import EFFECTORS
from scenes.footholds.projection import COVER_GAP, FOOT_CLEARANCE, PALM_CLEARANCE
from scenes.robots.robot import EffectorSpec, Robot
from scenes.terrain.polygon import area, clip, edge_normals
from scenes.terrain.surface import Surface
from scenes.terrain.terrain import Terrain

MARGIN = 1e-3  # [m] regions stay this far inside, so that a solver's tolerance never puts a patch outside
LEAST_AREA = 1e-4  # [m^2] smaller pieces are dropped
MAX_PIECES = 3  # of one surface
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
    terrain: Terrain,
    robot: Robot,
    effector: int,
    heading: tuple[float, float],
    *,
    holds: Callable[[float, np.ndarray], bool] | None = None,
) -> list[FootholdRegion]:
    """Every region where an end effector may be placed.

    Args:
        terrain: surfaces to stand on, and what stands above them.
        robot: whose patches.
        effector: index into `EFFECTORS`.
        heading: least and greatest heading [rad].
        holds: whether a contact with this friction coefficient and orientation R_WC (3, 3) is good enough; surfaces on
            which it is not are left out (quasi-static walking: one contact must carry the weight by itself).
    """
    spec = robot.effectors[effector]
    bodies = _bodies(terrain)
    found = []
    for number, surface in enumerate(terrain.surfaces):
        if not surface.allows(spec.name) or (effector < 2 and surface.normal[2] < 1e-3):
            continue
        if holds is not None:
            R_WC = contact_rotation(spec.name, surface.normal, float(np.mean(heading)))
            if not holds(surface.friction, R_WC):
                continue
        for polygon in _worth_keeping(_usable(surface, number, spec, heading, bodies)):
            found.append(_region(surface, number, effector, spec.name, heading, polygon))
    return found


def disc_region(surface: Surface, number: int, effector: int, radius: float) -> FootholdRegion | None:
    """The region for any heading whatever of a patch that holds a disc of this radius [m]: for bounds, not for plans.

    Args:
        surface: the surface.
        number: its index in the terrain.
        effector: index into `EFFECTORS`.
        radius: of the disc [m].
    """
    X, origin = _axes(surface)
    polygon = _inset(_flat(surface.vertices, X, origin), lambda normal: radius)
    if len(polygon) < 3:
        return None
    return _region(surface, number, effector, EFFECTORS[effector], (0.0, 0.0), polygon)


def support(half: tuple[float, float], low: float, high: float, direction: float) -> float:
    """Greatest reach [m] of a rectangle's points along a direction [rad], over its turns between low and high [rad].

    At turn t it is hx |cos(t - d)| + hy |sin(t - d)|, greatest where the diagonal points along d.

    Args:
        half: half length and half width of the rectangle [m].
        low: least turn [rad].
        high: greatest turn [rad].
        direction: angle in the plane of the rectangle [rad].
    """
    turns = np.array([low, high]) - direction
    reach = half[0] * np.abs(np.cos(turns)) + half[1] * np.abs(np.sin(turns))
    diagonal = np.arctan2(half[1], half[0])
    for angle in (diagonal, -diagonal):
        if np.floor((turns[1] - angle) / np.pi) > np.floor((turns[0] - angle) / np.pi):
            return float(np.hypot(*half))
    return float(reach.max())


# ---- one surface, in its own plane


def _usable(
    surface: Surface, number: int, spec: EffectorSpec, heading: tuple[float, float], bodies: list[np.ndarray]
) -> list[np.ndarray]:
    """Convex polygons (K, 2) of contact points in the surface's plane, which may overlap."""
    X, origin = _axes(surface)
    low, high = _turns(surface, spec.name, heading, X)
    inside = _inset(
        _flat(surface.vertices, X, origin), lambda n: support(spec.half_extent, low, high, np.arctan2(n[1], n[0]))
    )
    if len(inside) < 3:
        return []
    clearance = FOOT_CLEARANCE if spec.name.endswith("_foot") else PALM_CLEARANCE
    front, back, side = spec.overhang
    half = (spec.half_extent[0] + max(front, back), spec.half_extent[1] + side)
    centre = surface.centroid
    reach = np.linalg.norm(surface.vertices - centre, axis=1).max() + np.hypot(*half) + clearance
    pieces = [inside]
    for k, body in enumerate(bodies):
        if k == number or (body.min(axis=0) > centre + reach).any() or (body.max(axis=0) < centre - reach).any():
            continue
        shadow = _shadow(body, surface.normal, X, origin, clearance)
        if shadow is None:
            continue
        pieces = [part for piece in pieces for part in _cut(piece, shadow, half, low, high)]
    return pieces


def _worth_keeping(pieces: list[np.ndarray]) -> list[np.ndarray]:
    """The largest piece and those that add enough to it; pieces may overlap."""
    kept: list[np.ndarray] = []
    covered = shapely.Polygon()
    for piece in sorted(pieces, key=area, reverse=True):
        outline = shapely.Polygon(piece)
        if not kept or (len(kept) < MAX_PIECES and outline.difference(covered).area > WORTH * covered.area):
            kept.append(piece)
            covered = covered.union(outline)
    return kept


def _bodies(terrain: Terrain) -> list[np.ndarray]:
    """Every polygon that may stand above a patch: surfaces first, then the triangles of obstacles."""
    return [s.vertices for s in terrain.surfaces] + list(terrain.triangles)


def _turns(surface: Surface, effector: str, heading: tuple[float, float], X: np.ndarray) -> tuple[float, float]:
    """Angles of the contact frame's x axis in the surface's plane, from the least heading to the greatest."""
    angles = []
    for yaw in heading:
        x = contact_rotation(effector, surface.normal, yaw)[:, 0] @ X
        angles.append(np.arctan2(x[1], x[0]))
    turn = (angles[1] - angles[0] + np.pi) % (2 * np.pi) - np.pi
    return min(angles[0], angles[0] + turn), max(angles[0], angles[0] + turn)


def _axes(surface: Surface) -> tuple[np.ndarray, np.ndarray]:
    """(3, 2) in-plane axes of a surface, right-handed with its normal, and its origin (3,)."""
    edge = surface.vertices[1] - surface.vertices[0]
    x = edge - (edge @ surface.normal) * surface.normal
    x = x / np.linalg.norm(x)
    return np.stack([x, np.cross(surface.normal, x)], axis=1), surface.vertices[0]


def _flat(points: np.ndarray, X: np.ndarray, origin: np.ndarray) -> np.ndarray:
    return (points - origin) @ X


def _inset(polygon: np.ndarray, reach: Callable[[np.ndarray], float]) -> np.ndarray:
    """The polygon (K, 2) with every edge moved inwards by reach(outward normal) and the margin [m]."""
    result = polygon
    for a, b in zip(polygon, np.roll(polygon, -1, axis=0), strict=True):
        along = b - a
        if np.linalg.norm(along) < 1e-9:
            continue
        normal = np.array([along[1], -along[0]]) / np.linalg.norm(along)
        result = clip(result, result @ normal - (normal @ a - reach(normal) - MARGIN))
    return result


def _shadow(
    body: np.ndarray, normal: np.ndarray, X: np.ndarray, origin: np.ndarray, clearance: float
) -> np.ndarray | None:
    """(K, 2) outline of the part of a polygon (V, 3) within the clearance above a plane; None where there is none."""
    for level, sign in ((COVER_GAP, -1.0), (clearance, 1.0)):
        height = sign * ((body - origin) @ normal)
        if height.min() >= sign * level:  # what only touches the level is no part of it
            return None
        body = clip(body, height, sign * level)
    return (body - origin) @ X


def _cut(piece: np.ndarray, shadow: np.ndarray, half: tuple[float, float], low: float, high: float) -> list[np.ndarray]:
    """The piece where the patch, its overhang included, does not meet the shadow: at most one part per edge direction."""
    directions = _normals(shadow)
    parts = []
    for normal in directions:
        reach = support(half, low, high, np.arctan2(normal[1], normal[0]))
        # On the far side of this edge: normal @ p >= greatest of the shadow + reach
        part = clip(piece, piece @ -normal + (np.max(shadow @ normal) + reach + MARGIN))
        if len(part) == len(piece) and np.allclose(part, piece):
            return [piece]  # separated as a whole
        if len(part) >= 3 and area(part) > LEAST_AREA:
            parts.append(part)
    return sorted(parts, key=area, reverse=True)[:MAX_PIECES]


def _normals(shadow: np.ndarray) -> np.ndarray:
    """(K, 2) outward unit normals of the outline's edges; both sides and both ends of one that is a line."""
    normals, _ = edge_normals(shadow)
    if not len(normals):
        return np.array([[1.0, 0], [0, 1], [-1, 0], [0, -1]])
    x = np.array([[-normals[0, 1], normals[0, 0]]])
    # The direction of the first edge too: a thin shadow has no edge normals along itself.
    return np.concatenate([normals, -normals, x, -x])


def _region(
    surface: Surface, number: int, effector: int, name: str, heading: tuple[float, float], polygon: np.ndarray
) -> FootholdRegion:
    X, origin = _axes(surface)
    vertices = origin + polygon @ X.T
    outward, start = edge_normals(polygon)
    A = outward @ X.T
    b = (A * vertices[start]).sum(axis=1)
    R_WC = contact_rotation(name, surface.normal, float(np.mean(heading)))
    return FootholdRegion(
        effector,
        number,
        heading,
        vertices,
        A,
        b,
        surface.normal,
        float(surface.normal @ origin),
        surface.friction,
        R_WC,
    )
