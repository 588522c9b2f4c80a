"""Whether bodies of the robot penetrate each other or the surroundings."""

# pydrake's stubs read "float64[m, 1]" as a shape and refuse every array.
# pyright: reportArgumentType=false, reportCallIssue=false, reportReturnType=false

from __future__ import annotations

import contextlib
import itertools
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from pydrake.geometry import Role

from .geometry import clip
from .limits import (
    COVERED,
    PENETRATION,
    PLATE_THICKNESS,
    SOLE_PENETRATION,
    TOUCH,
    TRIANGLE_DEPTH,
)
from .plan_file import PlanFile
from .report import Sheet
from .robot import RobotModel
from .scene import Plate, Scene


@dataclass(frozen=True, eq=False)
class Face:
    """One outer face of something solid: a convex polygon (K, 3), its outward normal, and what to call it.

    A tapered one leans inwards behind the face, so that its solid does not poke out of the next face of a mesh where
    the ridge between them is 45 deg or blunter.
    """

    name: str
    polygon: np.ndarray
    normal: np.ndarray
    tapered: bool

    def solid(self, low: np.ndarray, high: np.ndarray) -> np.ndarray | None:
        """(n, 3) corners of the convex solid behind the part of the face between `low` and `high`; None for slivers."""
        polygon = clip(self.polygon, low, high)
        if len(polygon) < 3:
            return None
        edges = np.roll(polygon, -1, axis=0) - polygon
        long = np.linalg.norm(edges, axis=1) > 1e-6
        inward = np.cross(self.normal, edges[long])
        inward /= np.linalg.norm(inward, axis=1, keepdims=True)
        middle = polygon.mean(axis=0)
        radius = (inward * (middle - polygon[long])).sum(axis=1).min(initial=np.inf)
        if not 1e-4 < radius < np.inf:
            return None  # too thin to matter: the faces beside it are solid too
        if not self.tapered:
            return np.concatenate([polygon, polygon - PLATE_THICKNESS * self.normal])
        depth = min(TRIANGLE_DEPTH, 0.9 * radius)
        return np.concatenate([polygon, middle + (polygon - middle) * (1 - depth / radius) - depth * self.normal])


def check_collisions(
    sheet: Sheet, plan: PlanFile, robot: RobotModel, scene: Scene, origins: np.ndarray, radii: np.ndarray
) -> None:
    """Depths to which bodies penetrate each other, surfaces and obstacles.

    Args:
        sheet: takes the checks.
        plan: the plan file.
        robot: the robot's model.
        scene: the plan's scene.
        origins: (T, B, 3) of the bodies with collision shapes in W [m].
        radii: (B,) of balls about them that hold the shapes [m].
    """
    faces = [*_plates(plan, scene), *_triangles(plan["scene/triangles"]), *_boxes(scene)]
    limits: dict[str, float] = dict.fromkeys(("self collision", "terrain collision"), PENETRATION)
    limits["sole and palm collision"] = SOLE_PENETRATION
    nothing = (0.0, "nowhere") if len(radii) else (np.nan, "the model has no collision shapes")
    worst: dict[str, tuple[float, str]] = dict.fromkeys(limits, nothing)
    for frames, near in _groups(origins, radii, faces) if len(radii) else ():
        low = origins[frames].min(axis=(0, 1)) - radii.max() - MARGIN
        high = origins[frames].max(axis=(0, 1)) + radii.max() + MARGIN
        solids = {k: solid for k in near if (solid := faces[k].solid(low, high)) is not None}
        world = RobotModel(robot.model, list(solids.values()))
        _penetrate(plan, world, [faces[k].name for k in solids], frames, worst)
    for name, (depth, where) in worst.items():
        sheet.add(name, depth, limits[name], "m", where)


def _plates(plan: PlanFile, scene: Scene) -> Iterator[Face]:
    """Every surface, but for those that lie on the obstacles' own triangles: the mesh is their body."""
    triangles, normals = _upright(plan["scene/triangles"])
    for plate in scene.plates:
        if not _on_mesh(plate, triangles, normals):
            yield Face(plate.name, plate.vertices, plate.normal, tapered=False)


def _triangles(triangles: np.ndarray) -> Iterator[Face]:
    """One by one: Drake would take a whole mesh for its convex hull."""
    for triangle, normal in zip(*_upright(triangles), strict=True):
        yield Face("an obstacle's triangle", triangle, normal, tapered=True)


def _upright(triangles: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The (n, 3, 3) triangles that enclose an area, and (n, 3) their outward normals."""
    doubled = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
    length = np.linalg.norm(doubled, axis=1)
    keep = length > 1e-10
    return triangles[keep], doubled[keep] / length[keep, None]


def _on_mesh(plate: Plate, triangles: np.ndarray, normals: np.ndarray) -> bool:
    """Whether a surface's corners and middle all lie on triangles that face the same way."""
    facing = normals @ plate.normal > 0.999
    triangles, normals = triangles[facing], normals[facing]
    if not len(triangles):
        return False
    middle = plate.vertices.mean(axis=0)
    for point in [middle, *(middle + 0.98 * (plate.vertices - middle))]:
        from_corner = point - triangles
        outward = np.cross(np.roll(triangles, -1, axis=1) - triangles, normals[:, None])
        outward /= np.linalg.norm(outward, axis=2, keepdims=True)
        beside = (outward * from_corner).sum(axis=2).max(axis=1)
        height = np.abs((normals * from_corner[:, 0]).sum(axis=1))
        if not np.any((beside < COVERED) & (height < COVERED)):
            return False
    return True


def _boxes(scene: Scene) -> Iterator[Face]:
    for k, (X_WO, size) in enumerate(scene.boxes):
        for axis, sign in itertools.product(range(3), (1, -1)):
            R = sign * np.roll(X_WO[:3, :3], 2 - axis, axis=1)  # the outward axis comes last
            half = np.roll(size, 2 - axis) / 2
            corners = np.array([[1, 1, 1], [-1, 1, 1], [-1, -1, 1], [1, -1, 1]]) * half
            polygon = X_WO[:3, 3] + corners @ R.T
            yield Face(f"box {k}", polygon[::sign], R[:, 2], tapered=True)


# Registering n solids takes Drake time that grows with n^2, and its signed distance does not terminate where a sole
# touches a plate of 30 m: a long motion is checked in stretches, each against the faces near it.
MAX_FACES, BLOCK, STRETCH, MARGIN = 250, 100, 3.0, 0.5


def _groups(origins: np.ndarray, radii: np.ndarray, faces: Sequence[Face]) -> Iterator[tuple[slice, np.ndarray]]:
    """Stretches of frames and the faces that any body's bounds come near in them.

    Args:
        origins: (T, B, 3) of the bodies in W [m].
        radii: (B,) about the origins that hold the bodies [m].
        faces: of surfaces and obstacles.
    """
    low = np.array([f.polygon.min(axis=0) for f in faces]).reshape(-1, 3) - PLATE_THICKNESS
    high = np.array([f.polygon.max(axis=0) for f in faces]).reshape(-1, 3) + PLATE_THICKNESS
    first, gathered = 0, np.zeros(len(faces), dtype=bool)
    for start in range(0, len(origins), BLOCK):
        swept = origins[start : start + BLOCK]
        least, most = swept.min(axis=0) - radii[:, None], swept.max(axis=0) + radii[:, None]
        near = ((low <= most[:, None]) & (high >= least[:, None])).all(axis=2).any(axis=0)
        extent = np.ptp(origins[first : start + BLOCK, 0], axis=0).max()
        if start > first and (extent > STRETCH or (gathered | near).sum() > MAX_FACES):
            yield slice(first, start), np.flatnonzero(gathered)
            first, gathered = start, near
        else:
            gathered |= near
    yield slice(first, len(origins)), np.flatnonzero(gathered)


def _penetrate(
    plan: PlanFile, world: RobotModel, names: Sequence[str], frames: slice, worst: dict[str, tuple[float, str]]
) -> None:
    """Deepens `worst` by what overlaps in these frames; `names` are those of the solids.

    Point-pair penetration finds all overlaps at once, but bounds their depth from above only: a sole 3 mm deep in a
    small triangle may come out as 17 mm. Depths that would matter are asked again as signed distances.
    """
    inspector = world.scene_graph.model_inspector()
    owner: dict = {}
    for geometry in inspector.GetAllGeometryIds(Role.kProximity):
        body = world.plant.GetBodyFromFrameId(inspector.GetFrameId(geometry))
        still = body.index() == world.plant.world_body().index()
        label = names[int(inspector.GetName(geometry).rpartition(" ")[2])] if still else body.name()
        owner[geometry] = (still, int(body.index()) in world.carriers, label)
    port, t = world.scene_graph.get_query_output_port(), plan["motion/t"]
    for k, q in enumerate(plan["motion/q"][frames], start=frames.start):
        world.plant.SetPositions(world.plant_context, q)
        query = port.Eval(world.scene_context)
        for pair in query.ComputePointPairPenetration():
            (still_a, carrier_a, label_a), (still_b, carrier_b, label_b) = owner[pair.id_A], owner[pair.id_B]
            kind = "self collision"
            if still_a or still_b:
                kind = "sole and palm collision" if carrier_a or carrier_b else "terrain collision"
            depth = pair.depth
            if depth <= worst[kind][0]:
                continue
            if depth > TOUCH:
                with contextlib.suppress(RuntimeError):  # Drake found no signed distance: keep the upper bound
                    depth = min(depth, -query.ComputeSignedDistancePairClosestPoints(pair.id_A, pair.id_B).distance)
            if depth > worst[kind][0]:
                worst[kind] = (depth, f"frame {k}, t = {t[k]:.3f} s, {label_a} in {label_b}")
