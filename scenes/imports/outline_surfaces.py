"""Outlines with holes cut into convex surfaces; what is no region is dropped, and why is said."""

from __future__ import annotations

import numpy as np
import shapely
from shapely import Polygon
from shapely.geometry.base import BaseGeometry

from scenes.effector import EFFECTORS, is_foot
from scenes.footholds.convex_cover import convex_pieces
from scenes.imports.import_report import Change
from scenes.imports.outline import Outline
from scenes.input_error import InputError
from scenes.meshes.planar_regions import plane_axes
from scenes.terrain.polygon import polygon_normal
from scenes.terrain.surface import Surface

OFF_PLANE = 5e-3  # [m] as for a scene file's surfaces
FLAT = 1e-5  # [m] corners farther off their plane than this are moved onto it, and that is said
SMALLEST = 1e-4  # [m^2] smaller regions carry nothing
SAME = 1e-4  # [m] outlines whose corners are this near are one
DENTED = 1e-6  # share of its hull's area that a convex polygon may lack
MOST_CORNERS = 60  # of one surface
FINE = 5e-4  # [m] corners of a round outline that stand out by less are left out first


def surfaces_of_outlines(outlines: list[Outline], friction: float) -> tuple[tuple[Surface, ...], list[Change]]:
    """Convex surfaces that make up the outlines, and what was changed on the way.

    A convex outline stays one surface with its corners. Others are covered by convex pieces (`convex_pieces`), called
    `<name>/0` and so on.

    Args:
        outlines: z up [m].
        friction: of those that do not give theirs [-].

    Raises:
        InputError: a corner is not finite.
    """
    surfaces: list[Surface] = []
    dropped: dict[str, list[str]] = {}
    twins, flattened, turned, cut = 0, 0, 0, 0
    seen: set[tuple[object, ...]] = set()
    names: set[str] = set()
    for number, outline in enumerate(outlines):
        name = _free_name(outline.name or f"polygon_{number}", names)
        if not all(np.isfinite(ring).all() for ring in (*outline.rings, *outline.holes)):
            raise InputError(f"{name}: a corner is not finite, expected numbers")
        key = _key(outline)
        if key in seen:
            twins += 1
            continue
        seen.add(key)
        shape, origin, axes, off = _flat(outline)
        reason = _refusal(shape, off)
        if reason:
            dropped.setdefault(reason, []).append(name)
            continue
        flattened += off > FLAT
        if _faces_down(axes[2], outline):
            axes = np.stack([axes[1], axes[0], -axes[2]])
            shape = shapely.transform(shape, lambda xy: xy[:, ::-1])
            turned += 1
        own = friction if outline.friction is None else outline.friction
        contact = None if outline.contact is None else frozenset(outline.contact)
        pieces = _pieces(shape)
        cut += len(pieces) > 1
        for k, corners in enumerate(pieces):
            label = f"{name}/{k}" if len(pieces) > 1 else name
            surfaces.append(Surface(label, origin + corners @ axes[:2], own, contact))
    changes = [Change("dropped", len(found), "regions", f"{why}: {_some(found)}") for why, found in dropped.items()]
    changes += [
        Change("merged", twins, "regions", "listed more than once"),
        Change("flattened", flattened, "regions", f"their corners lay up to {1e3 * OFF_PLANE:g} mm off a plane"),
        Change("turned", turned, "regions", "they faced down, where nothing can touch them"),
        Change("cut", cut, "regions", "not convex: covered by convex pieces"),
    ]
    return tuple(surfaces), [change for change in changes if change.count]


def _free_name(name: str, names: set[str]) -> str:
    name = "".join(c if c.isprintable() else "_" for c in name)[:180]
    free, number = name, 1
    while free in names:
        number += 1
        free = f"{name}_{number}"
    names.add(free)
    return free


def _key(outline: Outline) -> tuple[object, ...]:
    """Equal for outlines that are one, from whichever corner they start."""
    corners = np.concatenate([*outline.rings, *outline.holes])
    return tuple(sorted(map(tuple, np.round(corners / SAME).astype(np.int64).tolist())))


def _flat(outline: Outline) -> tuple[BaseGeometry, np.ndarray, np.ndarray, float]:
    """The region in its best plane, that plane's origin (3,) and axes (3, 3), and how far off it a corner is [m]."""
    corners = np.concatenate([*outline.rings, *outline.holes])
    origin = corners.mean(axis=0)
    normal = np.linalg.svd(corners - origin, full_matrices=False)[2][2]
    toward = polygon_normal(outline.rings[0]) if outline.normal is None else outline.normal
    axes = plane_axes(normal if normal @ toward >= 0 else -normal)

    def ring(points: np.ndarray) -> Polygon:
        return Polygon((points - origin) @ axes[:2].T)

    shape: BaseGeometry = ring(outline.rings[0])
    if len(outline.rings) > 1:
        shape = shapely.union_all([shapely.make_valid(ring(points)) for points in outline.rings])
    for hole in outline.holes:
        shape = shape.difference(shapely.make_valid(ring(hole))) if shape.is_valid else shape
    return shape, origin, axes, float(np.abs((corners - origin) @ axes[2]).max())


def _refusal(shape: BaseGeometry, off: float) -> str:
    """Why a region is none; "" where it is one."""
    if not np.isfinite(off) or off > OFF_PLANE:
        return f"not flat within {1e3 * OFF_PLANE:g} mm"
    if not shape.is_valid:
        return "their outline crosses itself"
    if shape.area < SMALLEST:
        return "they have no area to speak of"
    return ""


def _faces_down(normal: np.ndarray, outline: Outline) -> bool:
    """Whether a region has to be turned over: feet should stand on it, or nobody could touch it as it lies."""
    if normal[2] >= 0:
        return False
    if outline.contact is not None:
        return any(map(is_foot, outline.contact))
    corner = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
    axes = plane_axes(normal)
    return outline.normal is None and not any(map(Surface("", corner @ axes).allows, EFFECTORS))


def _pieces(shape: BaseGeometry) -> list[np.ndarray]:
    """(K, 2) counter-clockwise corners of convex polygons that make up a region [m]."""
    pieces: list[np.ndarray] = []
    for part in shapely.get_parts(shape):
        if not isinstance(part, Polygon) or part.area < SMALLEST:
            continue
        if not part.interiors and part.convex_hull.area - part.area <= DENTED * part.area:
            plain = shapely.orient_polygons(part)
            if len(plain.exterior.coords) > MOST_CORNERS:
                plain = shapely.orient_polygons(shapely.simplify(part, FINE))
            pieces.append(shapely.get_coordinates(shapely.remove_repeated_points(plain, 1e-6))[:-1])
        else:
            pieces += convex_pieces(part)
    return pieces


def _some(names: list[str]) -> str:
    return ", ".join(names[:3]) + (f" and {len(names) - 3} more" if len(names) > 3 else "")
