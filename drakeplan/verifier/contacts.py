"""Whether every contact rests on terrain that allows it, with as much of its patch as the plan says, uncovered."""

from __future__ import annotations

import numpy as np
import shapely

from .geometry import clip, in_world
from .limits import (
    ALONG_NORMAL,
    BESIDE,
    COVERED,
    EFFECTORS,
    HEAD_ROOM,
    IN_PATCH,
    INNER_RADIUS,
    MOST_CORNERS,
    ON_SURFACE,
    SAME_PLANE,
    SUPPORTED,
    TOUCHES,
)
from .plan_file import PlanFile
from .report import Place, Sheet
from .scene import Plate, Scene


def check_contacts(sheet: Sheet, plan: PlanFile, scene: Scene) -> bool:
    """Poses, surfaces, friction and supports of all contacts, and the room over their patches.

    Args:
        sheet: takes the checks.
        plan: the plan file.
        scene: the plan's scene.

    Returns:
        Whether the supports are polygons, so that forces on them can be judged.
    """
    X_WC, effector, surface = plan["contacts/X_WC"], plan["contacts/effector"], plan["contacts/surface"]
    half = plan["effectors_half_extent"]
    rows = range(len(X_WC))
    orthonormal = np.abs(np.swapaxes(X_WC[:, :3, :3], 1, 2) @ X_WC[:, :3, :3] - np.eye(3)).max(axis=(1, 2))
    off = np.maximum(orthonormal, np.abs(X_WC[:, 3] - [0, 0, 0, 1]).max(axis=1))
    off = np.maximum(off, np.abs(np.linalg.det(X_WC[:, :3, :3]) - 1))
    sheet.add("contact pose", off, 1e-6, "", lambda i: plan.held(i[0]))
    used = np.isin(np.arange(len(EFFECTORS)), plan["contacts/effector"])
    has = used | half.any(axis=1)  # a robot without palms has patches of size 0 there, which nothing may use
    sheet.add("patch size", np.where(has[:, None], 1e-3 - half, 0.0), 0, "m", lambda i: EFFECTORS[i[0]])
    beyond = [_beyond_patch(plan.support(c), half[effector[c]]) for c in rows]
    sheet.add("support in patch", beyond, IN_PATCH, "m", lambda i: plan.held(i[0]))
    usable = bool(np.isfinite(beyond).all())
    known = surface < len(scene.plates)
    if not sheet.add("contact surface exists", ~known, 0, "", lambda i: plan.held(i[0])) or not usable:
        return usable
    plates = [scene.plates[k] for k in surface]
    forbidden = [EFFECTORS[effector[c]] not in plates[c].allowed for c in rows]

    def on(index: tuple[int, ...]) -> str:
        return f"{plan.held(index[0])} on {plates[index[0]].name}"

    sheet.add("contact allowed", forbidden, 0, "", on)
    under = [_near_support(scene, EFFECTORS[effector[c]], X_WC[c], plan.support(c)) for c in rows]
    friction = [
        _wrong_friction(plan["contacts/friction"][c], plates[c], under[c], X_WC[c], plan.support(c)) for c in rows
    ]
    sheet.add("contact friction", friction, 1e-9, "", on)
    found = [_off_terrain(under[c], X_WC[c], plan.support(c)) for c in rows]
    on_edges = np.array([edges for _, edges in found])  # the sole then has a normal of its own
    distance = [abs((X_WC[c, :3, 3] - plates[c].vertices[0]) @ plates[c].normal) for c in rows]
    sheet.add("contact on surface", np.where(on_edges, 0.0, distance), ON_SURFACE, "m", on)
    # atan2 of cross and dot keeps small angles exact, where arccos does not.
    normals = np.array([plate.normal for plate in plates])
    across = np.linalg.norm(np.cross(X_WC[:, :3, 2], normals), axis=1)
    angle = np.arctan2(across, (X_WC[:, :3, 2] * normals).sum(1))
    sheet.add("contact normal", np.where(on_edges, 0.0, angle), ALONG_NORMAL, "rad", on)
    sheet.add("support on terrain", [far for far, _ in found], SUPPORTED, "m", on)
    small = [_short_of_radius(plan.support(c), half[effector[c]]) for c in rows]
    sheet.add("support size", small, 0, "m", on)
    sheet.add("patch uncovered", *_covered(plan, scene))
    return usable


def _beyond_patch(support: np.ndarray, half: np.ndarray) -> float:
    """How far a support (n, 2) reaches beyond its patch [m]; infinite where it is no convex polygon, counter-clockwise."""
    if not 3 <= len(support) <= MOST_CORNERS or not np.isfinite(support).all():
        return np.inf
    edge = np.roll(support, -1, axis=0) - support
    after = np.roll(edge, -1, axis=0)
    turn = np.arctan2(edge[:, 0] * after[:, 1] - edge[:, 1] * after[:, 0], (edge * after).sum(axis=1))
    if turn.min() < -1e-6 or abs(turn.sum() - 2 * np.pi) > 1e-3:
        return np.inf
    return float((np.abs(support) - half).max())


def _near_support(scene: Scene, effector: str, X_WC: np.ndarray, support: np.ndarray) -> list[Plate]:
    """The plates for an end effector whose bounds come within `SUPPORTED` of those of a contact's support (n, 2)."""
    corners = in_world(X_WC, support)
    low, high = corners.min(axis=0) - SUPPORTED, corners.max(axis=0) + SUPPORTED
    allowed = [plate for plate in scene.plates if effector in plate.allowed]
    return [plate for plate in allowed if np.all(plate.low <= high) and np.all(plate.high >= low)]


def _wrong_friction(friction: float, own: Plate, under: list[Plate], X_WC: np.ndarray, support: np.ndarray) -> float:
    """How far a contact's friction is above the least that the scene says under its support, or off its only one.

    Args:
        friction: of the contact.
        own: the contact's plate; where it carries all of the support, no other counts.
        under: plates near the support.
        X_WC: (4, 4) pose of the contact [m].
        support: (n, 2) corners [m].
    """
    if _off_terrain([own], X_WC, support)[0] <= TOUCHES:
        return abs(friction - own.friction)
    _, on_edges = _off_terrain(under, X_WC, support)
    window, outline = np.array([*np.abs(support).max(axis=0), SUPPORTED]), shapely.Polygon(support)
    said = {own.friction}
    for plate in under:
        part = clip((plate.vertices - X_WC[:3, 3]) @ X_WC[:3, :3], -window, window)
        if not len(part):
            continue
        touched = shapely.MultiPoint(part[:, :2]).convex_hull.intersection(outline)
        if touched.area > TOUCHES or (on_edges and not touched.is_empty):
            said.add(plate.friction)
    return max(friction - min(said), 0.0) if len(said) > 1 else abs(friction - own.friction)


def _off_terrain(under: list[Plate], X_WC: np.ndarray, support: np.ndarray) -> tuple[float, bool]:
    """How far the worst corner of a support (n, 2) is from terrain that carries it [m], and whether all lie on edges.

    A plate carries what lies on its face where it faces the sole within `SAME_PLANE`, and what lies on its edges always:
    a sole that rests on edges pushes along its own normal.
    """
    off, off_edges = np.full(len(support), np.inf), np.full(len(support), np.inf)
    corners = in_world(X_WC, support)
    for plate in under:
        axes = _axes(plate.normal)
        outline = shapely.Polygon((plate.vertices - plate.vertices[0]) @ axes[:2].T)
        seen = (corners - plate.vertices[0]) @ axes.T
        points = shapely.points(seen[:, :2])
        off_edges = np.minimum(off_edges, np.hypot(shapely.distance(points, outline.exterior), seen[:, 2]))
        if plate.normal @ X_WC[:3, 2] >= np.cos(SAME_PLANE):
            off = np.minimum(off, np.hypot(shapely.distance(points, outline), seen[:, 2]))
    return float(np.minimum(off, off_edges).max()), bool((off_edges <= SUPPORTED).all() and (off > SUPPORTED).any())


def _axes(normal: np.ndarray) -> np.ndarray:
    """(3, 3) rows: two axes of the plane with this unit normal, and the normal."""
    x = np.cross(normal, np.eye(3)[np.argmin(np.abs(normal))])
    x /= np.linalg.norm(x)
    return np.stack([x, np.cross(normal, x), normal])


def _short_of_radius(support: np.ndarray, half: np.ndarray) -> float:
    """How much a support's inner radius is less than `INNER_RADIUS` [m]; a whole patch is as large as it is."""
    if shapely.Polygon(support).area >= 4 * half.prod() * (1 - 1e-9):
        return 0.0
    middle = shapely.maximum_inscribed_circle(shapely.Polygon(support), tolerance=1e-6)
    return INNER_RADIUS - float(middle.length)


def _covered(plan: PlanFile, scene: Scene) -> tuple[np.ndarray, float, str, Place]:
    """How high surfaces and obstacles stand in the column over each patch, and what is the highest.

    The column is the patch less `BESIDE` all around, up to the head room: neighbours that touch at edges are outside.
    """
    X_WC, effector = plan["contacts/X_WC"], plan["contacts/effector"]
    plates, triangles = scene.plates, plan["scene/triangles"]
    low = np.concatenate([np.array([p.low for p in plates]).reshape(-1, 3), triangles.min(axis=1)])
    high = np.concatenate([np.array([p.high for p in plates]).reshape(-1, 3), triangles.max(axis=1)])
    heights, by = np.zeros(len(X_WC)), np.full(len(X_WC), -1)
    for c, X in enumerate(X_WC):
        half = np.maximum(plan["effectors_half_extent"][effector[c]] - BESIDE, 1e-4)
        room = HEAD_ROOM["foot" if effector[c] < 2 else "palm"]
        reach = np.hypot(np.linalg.norm(half), room)
        near = np.all((low <= X[:3, 3] + reach) & (high >= X[:3, 3] - reach), axis=1)
        for k in np.flatnonzero(near):
            polygon = plates[k].vertices if k < len(plates) else triangles[k - len(plates)]
            inside = clip((polygon - X[:3, 3]) @ X[:3, :3], [*-half, 0.0], [*half, room])
            if len(inside) and inside[:, 2].max() > heights[c]:
                heights[c], by[c] = inside[:, 2].max(), k
        for k, (X_WO, size) in enumerate(scene.boxes):
            middle = X_WO[:3, :3].T @ (X[:3, 3] + 0.5 * room * X[:3, 2] - X_WO[:3, 3])
            if np.all(np.abs(middle) < size / 2):
                heights[c], by[c] = room, len(low) + k

    def where(index: tuple[int, ...]) -> str:
        k, names = by[index[0]], [plate.name for plate in plates]
        kind = "nothing" if k < 0 else names[k] if k < len(names) else f"obstacle triangle {k - len(names)}"
        if k >= len(low):
            kind = f"box {k - len(low)}"
        return f"{plan.held(index[0])} under {kind}"

    return heights, COVERED, "m", where
