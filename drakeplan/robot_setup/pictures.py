"""The robot from four sides as it was understood: collision shapes, patches, torso box, centre of mass."""

# pydrake's stubs read "float64[3, 1]" as a shape and refuse every array.
# pyright: reportArgumentType=false, reportCallIssue=false, reportAttributeAccessIssue=false

from __future__ import annotations

import io
from pathlib import Path

import numpy as np
from pydrake.geometry import Role
from scipy.spatial import QhullError

from drakeplan.robot_setup.link_tree import shape_points
from scenes.effector import EFFECTORS
from scenes.files.scene_solids import hull_faces
from scenes.files.whole_file import write_whole
from scenes.robots.plant import RobotPlant, build_plant, nominal_posture
from scenes.robots.robot import Robot

COLOURS = ("#de1a1a", "#1aa829", "#00a8bd", "#d61abd")  # of the end effectors, as in the playback
BODY, TRUNK_BOX, LIGHT = np.array([0.66, 0.69, 0.74]), "#444444", np.array([0.35, 0.25, 0.9])
SIDES = {  # name -> direction of view, direction to the right of the picture
    "from the front": ((-1, 0, 0), (0, 1, 0)),
    "from its left": ((0, -1, 0), (-1, 0, 0)),
    "from behind": ((1, 0, 0), (0, -1, 0)),
    "from above": ((0, 0, -1), (0, -1, 0)),
}


def write_pictures(robot: Robot, file: str | Path) -> None:
    """Draws the robot in its nominal posture from four sides.

    Args:
        robot: to draw.
        file: a PNG file.

    Raises:
        InputError: the file cannot be written.
    """
    import matplotlib

    matplotlib.use("Agg", force=False)
    from matplotlib.figure import Figure

    robot_plant = build_plant(robot)
    triangles = _triangles(robot_plant)
    figure = Figure(figsize=(13, 6.2), dpi=110, layout="constrained")
    axes = figure.subplots(1, 4)
    for axis, (name, (view, right)) in zip(axes, SIDES.items(), strict=True):
        _draw(axis, robot_plant, triangles, np.array(view, float), np.array(right, float))
        axis.set_title(name, fontsize=11)
        axis.set_aspect("equal")
        axis.tick_params(labelsize=8)
        axis.set_xlabel("m", fontsize=8)
    figure.suptitle(
        f"{robot.name}: {robot.mass:.1f} kg, collision shapes; dashed: torso box; circle: CoM; cross: shoulders and hips"
    )
    buffer = io.BytesIO()
    figure.savefig(buffer, format="png")
    write_whole(file, buffer.getvalue())


def _triangles(robot_plant: RobotPlant) -> np.ndarray:
    """(K, 3, 3) faces of all collision shapes in W, of what is drawn where there are none; wound to look outwards."""
    plant, inspector = robot_plant.plant, robot_plant.scene_graph.model_inspector()
    context = plant.CreateDefaultContext()
    plant.SetPositions(context, nominal_posture(robot_plant.robot))
    parts = []
    for index in plant.GetBodyIndices(robot_plant.effector_bodies[0].model_instance()):
        body = plant.get_body(index)
        frame = plant.GetBodyFrameIdOrThrow(index)
        ids = inspector.GetGeometries(frame, Role.kProximity) or inspector.GetGeometries(frame, Role.kIllustration)
        for geometry in ids:
            X = plant.EvalBodyPoseInWorld(context, body) @ inspector.GetPoseInFrame(geometry)
            points = shape_points(inspector, geometry)
            try:
                corners, faces = hull_faces(points)
            except (QhullError, ValueError):
                continue
            parts.append(corners[faces] @ X.rotation().matrix().T + X.translation())
    return np.concatenate(parts) if parts else np.zeros((0, 3, 3))


def _draw(axis, robot_plant: RobotPlant, triangles: np.ndarray, view: np.ndarray, right: np.ndarray) -> None:  # noqa: ANN001
    from matplotlib.collections import PolyCollection

    robot = robot_plant.robot
    up = np.cross(right, view)
    flat = np.column_stack([right, up])
    normals = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
    normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-12)
    seen = normals @ view < 0
    shown, facing = triangles[seen], normals[seen]
    order = np.argsort(shown.mean(axis=1) @ view)[::-1]  # far first
    shade = 0.55 + 0.45 * np.clip(facing[order] @ (LIGHT / np.linalg.norm(LIGHT)) * 0.5 + 0.5, 0, 1)
    colours = np.clip(BODY * shade[:, None], 0, 1)
    axis.add_collection(
        PolyCollection(list(shown[order] @ flat), facecolors=colours, edgecolors=colours, linewidths=0.2)
    )
    plant = robot_plant.plant
    context = plant.CreateDefaultContext()
    plant.SetPositions(context, nominal_posture(robot))
    for e, (effector, body) in enumerate(zip(robot.effectors, robot_plant.effector_bodies, strict=True)):
        if not min(effector.half_extent) > 0.0:
            continue
        X = plant.EvalBodyPoseInWorld(context, body)
        corners = np.array([[1, 1], [-1, 1], [-1, -1], [1, -1], [1, 1]]) * effector.half_extent
        patch = X.translation() + corners @ X.rotation().matrix()[:, :2].T
        axis.fill(*(patch @ flat).T, color=COLOURS[e], alpha=0.35)
        axis.plot(*(patch @ flat).T, color=COLOURS[e], lw=1.6, label=EFFECTORS[e])
        tip = X.translation() + 0.1 * X.rotation().matrix()[:, 0]
        axis.plot(*(np.array([X.translation(), tip]) @ flat).T, color=COLOURS[e], lw=1.2)
    _box(axis, robot, flat)
    com = plant.CalcCenterOfMassPositionInWorld(context)
    axis.plot(*(com @ flat), "o", mfc="white", mec="black", ms=8, mew=1.6)
    marks = [robot.hip * s for s in ([1, 1, 1], [1, -1, 1])]
    if robot.palms:
        marks += [robot.shoulder * s for s in ([1, 1, 1], [1, -1, 1])]
    axis.plot(*(np.array(marks) @ flat).T, "k+", ms=9, mew=1.4)
    axis.autoscale_view()
    axis.margins(0.06)


def _box(axis, robot: Robot, flat: np.ndarray) -> None:  # noqa: ANN001
    signs = np.array(np.meshgrid((-0.5, 0.5), (-0.5, 0.5), (-0.5, 0.5))).reshape(3, -1).T
    corners = (robot.torso_box_centre + signs * robot.torso_box_size) @ flat
    low, high = corners.min(axis=0), corners.max(axis=0)
    axis.plot(
        [low[0], high[0], high[0], low[0], low[0]],
        [low[1], low[1], high[1], high[1], low[1]],
        "--",
        color=TRUNK_BOX,
        lw=1,
    )
