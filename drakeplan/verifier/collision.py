"""Whether bodies of the robot penetrate each other or the surroundings.

Drake judges. It is shown only what can matter: in each short block of frames, the parts of those faces behind which the
box around one of the robot's shapes reaches. The costs are those of the terrain along the way, whatever surrounds it,
and no solid is much larger than a body. Drake needs that: registering n solids takes time that grows with n^2, and its
signed distance does not return where a sole touches a plate of 30 m.
"""

# pydrake's stubs read "float64[m, 1]" as a shape and refuse every array.
# pyright: reportArgumentType=false, reportCallIssue=false, reportReturnType=false

from __future__ import annotations

import contextlib
from collections.abc import Sequence

import numpy as np
from pydrake.geometry import Convex, GeometryId, GeometryInstance, ProximityProperties, Role
from pydrake.math import RigidTransform
from pydrake.systems.framework import Context

from .faces import Faces
from .limits import (
    PENETRATION,
    SOLE_PENETRATION,
    TOUCH,
)
from .plan_file import PlanFile
from .report import Sheet
from .robot import BodyBoxes, RobotModel
from .scene import Scene

BLOCK = 25  # frames that are judged together: half a second
MARGIN = 0.3  # [m] around the robot's shapes up to which a face is kept; more than anything may be deep
THICKEST = 0.02  # [m] what lies this far behind a face is no longer in the solid behind it


def check_collisions(
    sheet: Sheet, plan: PlanFile, robot: RobotModel, scene: Scene, boxes: BodyBoxes, X_WB: np.ndarray
) -> None:
    """Depths to which bodies penetrate each other, surfaces and obstacles.

    Args:
        sheet: takes the checks.
        plan: the plan file.
        robot: the robot's model.
        scene: the plan's scene.
        boxes: around the robot's collision shapes.
        X_WB: (T, B, 4, 4) poses of the bodies with collision shapes in W [m].
    """
    limits: dict[str, float] = dict.fromkeys(("self collision", "terrain collision"), PENETRATION)
    limits["sole and palm collision"] = SOLE_PENETRATION
    nothing = (0.0, "nowhere") if len(boxes.body) else (np.nan, "the model has no collision shapes")
    worst: dict[str, tuple[float, str]] = dict.fromkeys(limits, nothing)
    faces, owners, context = (
        _along_the_way(plan, scene, boxes, X_WB),
        _owners(robot),
        robot.diagram.CreateDefaultContext(),
    )
    for start in range(0, len(X_WB) if len(boxes.body) else 0, BLOCK):
        frames = slice(start, min(start + BLOCK, len(X_WB)))
        _penetrate(plan, robot, context, owners, _solids(faces, boxes, X_WB[frames]), frames, worst)
    for name, (depth, where) in worst.items():
        sheet.add(name, depth, limits[name], "m", where)


def _along_the_way(plan: PlanFile, scene: Scene, boxes: BodyBoxes, X_WB: np.ndarray) -> Faces:
    """The faces that any of the shapes may come near in any frame."""
    low, high = np.full(3, np.inf), np.full(3, -np.inf)
    for body, X_BO, half in zip(boxes.body, boxes.X_BO, boxes.half, strict=True):
        X_WO = X_WB[:, body] @ X_BO
        reach, centre = np.abs(X_WO[:, :3, :3]) @ half, X_WO[:, :3, 3]
        low = np.minimum(low, (centre - reach).min(axis=0, initial=np.inf))
        high = np.maximum(high, (centre + reach).max(axis=0, initial=-np.inf))
    return Faces(plan, scene, low - TOUCH, high + TOUCH)


def _solids(faces: Faces, boxes: BodyBoxes, X_WB: np.ndarray) -> list[tuple[str, np.ndarray]]:
    """Names and corners (n, 3) of the solids that any of the shapes may penetrate in these frames.

    Args:
        faces: of the scene.
        boxes: around the robot's collision shapes.
        X_WB: (T, B, 4, 4) poses of the bodies in W [m].
    """
    wanted: dict[int, tuple[np.ndarray, np.ndarray]] = {}  # face -> bounds of the shapes that need it
    for body, X_BO, half in zip(boxes.body, boxes.X_BO, boxes.half, strict=True):
        X_WO = X_WB[:, body] @ X_BO
        R, centre = X_WO[:, :3, :3], X_WO[:, :3, 3]
        reach = np.abs(R) @ half
        low, high = (centre - reach).min(axis=0), (centre + reach).max(axis=0)
        near = faces.near(low - TOUCH, high + TOUCH)
        if not len(near):
            continue
        for k in near[_reached(faces, near, R, centre, half)].tolist():
            known = wanted.get(k, (low, high))
            wanted[k] = np.minimum(low, known[0]), np.maximum(high, known[1])
    cut = {k: faces[k].solid(low - MARGIN, high + MARGIN) for k, (low, high) in sorted(wanted.items())}
    return [(faces[k].name, solid) for k, solid in cut.items() if solid is not None]


def _reached(faces: Faces, near: np.ndarray, R: np.ndarray, centre: np.ndarray, half: np.ndarray) -> np.ndarray:
    """(n,) whether a box reaches behind each face, over its outline, in one of T frames.

    By the face's normal and the box's three: a face that one of them separates from the box is not reached.

    Args:
        faces: of the scene.
        near: (n,) indices of the faces.
        R: (T, 3, 3) axes of the box in W.
        centre: (T, 3) of the box in W [m].
        half: (3,) half edges of the box [m].
    """
    normal, corners = faces.normal[near], faces.corners[near]
    height = centre @ normal.T - (normal * corners[:, 0]).sum(axis=1)  # (T, n)
    spread = np.abs(np.einsum("tij,ni->tnj", R, normal)) @ half
    hit = (height - spread < -TOUCH) & (height + spread > -THICKEST)
    frame, face = np.nonzero(hit)
    along = np.einsum("mvi,mij->mvj", corners[face] - centre[frame, None], R[frame])
    # Behind the face lies up to THICKEST of solid, which may reach the box where the face does not.
    over = (along.min(axis=1) <= half + THICKEST) & (along.max(axis=1) >= -half - THICKEST)
    reached = np.zeros(len(near), dtype=bool)
    reached[face[over.all(axis=1)]] = True
    return reached


Owner = tuple[bool, bool, str]  # of a shape: whether it stands still, whether it carries a sole or palm, its name


def _owners(robot: RobotModel) -> dict[GeometryId, Owner]:
    """Whose each of the robot's collision shapes is."""
    inspector, plant, carriers = robot.scene_graph.model_inspector(), robot.plant, robot.carriers
    shapes = inspector.GetAllGeometryIds(Role.kProximity)
    bodies = [plant.GetBodyFromFrameId(inspector.GetFrameId(shape)) for shape in shapes]
    return {
        shape: (False, int(body.index()) in carriers, body.name()) for shape, body in zip(shapes, bodies, strict=True)
    }


def _penetrate(
    plan: PlanFile,
    robot: RobotModel,
    context: Context,
    owners: dict[GeometryId, Owner],
    solids: Sequence[tuple[str, np.ndarray]],
    frames: slice,
    worst: dict[str, tuple[float, str]],
) -> None:
    """Deepens `worst` by what overlaps in these frames.

    Point-pair penetration finds all overlaps at once, but bounds their depth from above only: a sole 3 mm deep in a
    small triangle may come out as 17 mm. Depths that would matter are asked again as signed distances.
    """
    plant, scene_graph = robot.plant, robot.scene_graph
    plant_context = plant.GetMyMutableContextFromRoot(context)
    scene_context = scene_graph.GetMyMutableContextFromRoot(context)
    source, world = plant.get_source_id(), scene_graph.world_frame_id()
    added: dict[GeometryId, Owner] = {}
    for k, (name, points) in enumerate(solids):
        instance = GeometryInstance(RigidTransform(), Convex(points.T, "solid"), f"solid {k}")
        instance.set_proximity_properties(ProximityProperties())
        with contextlib.suppress(RuntimeError):  # no hull: corners in one plane, to Drake's eyes
            added[scene_graph.RegisterGeometry(scene_context, source, world, instance)] = (True, False, name)
    owner = owners | added
    port, t = scene_graph.get_query_output_port(), plan["motion/t"]
    for k, q in enumerate(plan["motion/q"][frames], start=frames.start):
        plant.SetPositions(plant_context, q)
        query = port.Eval(scene_context)
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
    for solid in added:  # the context serves the next frames; making one takes longer than they do
        scene_graph.RemoveGeometry(scene_context, source, solid)
