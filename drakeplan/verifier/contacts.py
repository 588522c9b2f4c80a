"""Whether every contact lies on surfaces that allow it, inside their outline and uncovered."""

from __future__ import annotations

import numpy as np
import shapely

from .geometry import clip, corners
from .limits import (
    ALONG_NORMAL,
    BESIDE,
    COVERED,
    EFFECTORS,
    FLUSH,
    HEAD_ROOM,
    INSIDE,
    JOINT,
    ON_SURFACE,
    SAME_PLANE,
)
from .plan_file import PlanFile
from .report import Place, Sheet
from .scene import Plate, Scene


def check_contacts(sheet: Sheet, plan: PlanFile, scene: Scene) -> None:
    """Poses, surfaces and friction of all contacts, and the room of their patches.

    Args:
        sheet: takes the checks.
        plan: the plan file.
        scene: the plan's scene.
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
    known = surface < len(scene.plates)
    if not sheet.add("contact surface exists", ~known, 0, "", lambda i: plan.held(i[0])):
        return
    plates = [scene.plates[k] for k in surface]
    forbidden = [EFFECTORS[effector[c]] not in plates[c].allowed for c in rows]

    def on(index: tuple[int, ...]) -> str:
        return f"{plan.held(index[0])} on {plates[index[0]].name}"

    sheet.add("contact allowed", forbidden, 0, "", on)
    friction = np.array([plate.friction for plate in plates])
    sheet.add("contact friction", np.abs(plan["contacts/friction"] - friction), 1e-9, "", on)
    distance = [abs((X_WC[c, :3, 3] - plates[c].vertices[0]) @ plates[c].normal) for c in rows]
    sheet.add("contact on surface", distance, ON_SURFACE, "m", on)
    # atan2 of cross and dot keeps small angles exact, where arccos does not.
    normals = np.array([plate.normal for plate in plates])
    across = np.linalg.norm(np.cross(X_WC[:, :3, 2], normals), axis=1)
    sheet.add("contact normal", np.arctan2(across, (X_WC[:, :3, 2] * normals).sum(1)), ALONG_NORMAL, "rad", on)
    outside = [_outside(plates[c], corners(X_WC[c], half[effector[c]])) for c in rows]
    outside = [
        min(far, _outside_floor(scene, plates[c], X_WC[c], half[effector[c]])) if far > INSIDE else far
        for c, far in enumerate(outside)
    ]
    sheet.add("patch inside", outside, INSIDE, "m", on)
    sheet.add("patch uncovered", *_covered(plan, scene))


def _outside(plate: Plate, points: np.ndarray) -> float:
    """How far the farthest of `points` (n, 3) lies outside the plate's outline [m], negative inside."""
    edges = np.roll(plate.vertices, -1, axis=0) - plate.vertices
    outward = np.cross(edges, plate.normal)
    outward /= np.maximum(np.linalg.norm(outward, axis=1, keepdims=True), 1e-300)
    long = np.linalg.norm(edges, axis=1) > 1e-9
    return float((outward[long] @ points.T - (outward[long] * plate.vertices[long]).sum(1)[:, None]).max())


def _outside_floor(scene: Scene, own: Plate, X_WC: np.ndarray, half: np.ndarray) -> float:
    """How far a patch reaches beyond the plates that are one floor with its own, or how wide a gap under it is [m].

    Those are plates of equal friction for the same end effectors, turned by at most `SAME_PLANE`; of them counts what lies
    within `FLUSH` of the patch's plane. Joints up to twice `JOINT` are closed: each of their points is that near to a plate.

    Args:
        scene: the plan's scene.
        own: the contact's plate.
        X_WC: (4, 4) pose of the contact [m].
        half: (2,) half extents of its patch [m].
    """
    room = half + 10 * JOINT
    window = np.array([*room, FLUSH])
    reach = np.linalg.norm(window)
    parts = []
    for plate in scene.plates:
        if plate.normal @ own.normal < np.cos(SAME_PLANE):
            continue
        if plate.friction != own.friction or plate.allowed != own.allowed:
            continue
        if np.any(plate.low > X_WC[:3, 3] + reach) or np.any(plate.high < X_WC[:3, 3] - reach):
            continue
        part = clip((plate.vertices - X_WC[:3, 3]) @ X_WC[:3, :3], -window, window)
        if len(part) >= 3:
            parts.append(shapely.Polygon(part[:, :2]))
    floor = shapely.union_all(parts)
    if floor.is_empty:
        return np.inf
    floor = floor.buffer(JOINT, join_style="mitre").buffer(-JOINT, join_style="mitre")
    missing = shapely.box(*-half, *half).difference(floor)
    if missing.is_empty:
        return 0.0
    beyond = shapely.distance(shapely.points(shapely.get_coordinates(missing)), floor).max()
    widest = max(2 * shapely.maximum_inscribed_circle(p).length for p in shapely.get_parts(missing) if p.area > 0)
    return float(max(beyond, widest))


def _covered(plan: PlanFile, scene: Scene) -> tuple[np.ndarray, float, str, Place]:
    """How high another surface or obstacle stands in the column over each patch, and what it is.

    The column is the patch less `BESIDE` all around, up to the head room: neighbours that touch at edges are outside.
    """
    X_WC, effector, surface = plan["contacts/X_WC"], plan["contacts/effector"], plan["contacts/surface"]
    polygons = [plate.vertices for plate in scene.plates] + list(plan["scene/triangles"])
    low = np.array([p.min(axis=0) for p in polygons])
    high = np.array([p.max(axis=0) for p in polygons])
    heights, by = np.zeros(len(X_WC)), np.full(len(X_WC), -1)
    for c, X in enumerate(X_WC):
        half = np.maximum(plan["effectors_half_extent"][effector[c]] - BESIDE, 1e-4)
        room = HEAD_ROOM["foot" if effector[c] < 2 else "palm"]
        reach = np.hypot(np.linalg.norm(half), room)
        near = np.all((low <= X[:3, 3] + reach) & (high >= X[:3, 3] - reach), axis=1)
        near[surface[c]] = False
        for k in np.flatnonzero(near):
            inside = clip((polygons[k] - X[:3, 3]) @ X[:3, :3], [*-half, 0.0], [*half, room])
            if len(inside) and inside[:, 2].max() > heights[c]:
                heights[c], by[c] = inside[:, 2].max(), k
        for k, (X_WO, size) in enumerate(scene.boxes):
            middle = X_WO[:3, :3].T @ (X[:3, 3] + 0.5 * room * X[:3, 2] - X_WO[:3, 3])
            if np.all(np.abs(middle) < size / 2):
                heights[c], by[c] = room, len(polygons) + k

    def where(index: tuple[int, ...]) -> str:
        k, names = by[index[0]], [plate.name for plate in scene.plates]
        kind = "nothing" if k < 0 else names[k] if k < len(names) else f"obstacle triangle {k - len(names)}"
        if k >= len(polygons):
            kind = f"box {k - len(polygons)}"
        return f"{plan.held(index[0])} under {kind}"

    return heights, COVERED, "m", where
