"""Draws the robot and animates its bodies, with no more keyframes than it takes to play the motion truly."""

# pydrake's stubs take the first parameter of ndarray for its type, and reject every array.
# pyright: reportArgumentType=false, reportCallIssue=false

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from pydrake.common.eigen_geometry import Quaternion
from pydrake.geometry import Meshcat, MeshcatAnimation, MeshcatVisualizer, MeshcatVisualizerParams, Role
from pydrake.math import RigidTransform
from pydrake.multibody.plant import AddMultibodyPlantSceneGraph
from pydrake.multibody.tree import BodyIndex
from pydrake.systems.framework import DiagramBuilder

from drakeplan.plan.plan import PlanMotion
from drakeplan.playback.frame_times import FrameTimes
from drakeplan.playback.keyframes import continuous_signs, thin_positions, thin_quaternions
from drakeplan.playback.still import ROOT
from scenes.robots.drake_parser import add_model
from scenes.robots.robot import Robot

MAX_KEYFRAMES = 70_000  # of all bodies together, some 10 MB of page; tolerances grow until it is kept
POSITION_TOLERANCE = 1.0e-3  # [m] a frame in between may be off by this
ANGLE_TOLERANCE = 4.0e-3  # [rad]
ROBOT = f"{ROOT}/robot"


@dataclass(frozen=True, eq=False)
class BodyPoses:
    """Where the bodies of the robot are at every frame.

    Attributes:
        paths: of the B bodies in meshcat.
        poses: (F, B, 7) quaternion w x y z and position in W [m].
    """

    paths: list[str]
    poses: np.ndarray


def draw_robot(meshcat: Meshcat, motion: PlanMotion, robot: Robot, frames: FrameTimes) -> BodyPoses:
    """Draws the robot as it stands at the motion's start.

    Args:
        meshcat: to draw in.
        motion: to show.
        robot: the plan's.
        frames: at which the poses are asked for.
    """
    builder = DiagramBuilder()
    plant, scene_graph = AddMultibodyPlantSceneGraph(builder, time_step=1e-3)
    add_model(plant, robot.model)
    plant.Finalize()
    parameters = MeshcatVisualizerParams(role=Role.kIllustration, prefix=ROBOT, delete_on_initialization_event=False)
    MeshcatVisualizer.AddToBuilder(builder, scene_graph, meshcat, parameters)
    diagram = builder.Build()
    context = diagram.CreateDefaultContext()
    plant_context = plant.GetMyMutableContextFromRoot(context)
    inspector = scene_graph.model_inspector()
    shown, paths = [], []
    for index in range(1, plant.num_bodies()):  # 0 is the world
        body = plant.get_body(BodyIndex(index))
        frame = plant.GetBodyFrameIdIfExists(body.index())
        if frame is not None and inspector.NumGeometriesForFrameWithRole(frame, Role.kIllustration):
            shown.append(body)
            paths.append(f"{ROBOT}/{inspector.GetName(frame).replace('::', '/')}")
    q = _interpolate_q(motion, frames)
    poses = np.empty((len(q), len(shown), 7))
    for f, row in enumerate(q):
        plant.SetPositions(plant_context, row)
        if f == 0:
            diagram.ForcedPublish(context)
        for b, body in enumerate(shown):
            X_WB = body.EvalPoseInWorld(plant_context)
            poses[f, b, :4] = X_WB.rotation().ToQuaternion().wxyz()
            poses[f, b, 4:] = X_WB.translation()
    for b in range(len(shown)):
        poses[:, b, :4] = continuous_signs(poses[:, b, :4])
    return BodyPoses(paths, poses)


def animate_robot(animation: MeshcatAnimation, bodies: BodyPoses, frames: FrameTimes) -> None:
    """Moves the bodies.

    Args:
        animation: gets their keyframes.
        bodies: as `draw_robot` gives them.
        frames: that the poses belong to.
    """
    poses, looseness = bodies.poses, 1.0
    while True:
        kept = [_needed(poses[:, b, 4:], poses[:, b, :4], frames, looseness) for b in range(len(bodies.paths))]
        excess = sum(map(len, kept)) / MAX_KEYFRAMES
        if excess <= 1.0:
            break
        looseness *= max(1.6, excess**2)  # the error of chords grows with the square of their length
    for b, path in enumerate(bodies.paths):
        for f in kept[b].tolist():
            animation.SetTransform(f, path, RigidTransform(Quaternion(poses[f, b, :4]), poses[f, b, 4:]))


def _interpolate_q(motion: PlanMotion, frames: FrameTimes) -> np.ndarray:
    """(F, nq) positions at the frames; the base's quaternion is interpolated along the chord and normalised."""
    t = motion.t - motion.t[0]
    q = np.stack([np.interp(frames.t, t, column) for column in motion.q.T], axis=1)
    if motion.position_names and motion.position_names[0].endswith("_qw"):
        q[:, :4] /= np.linalg.norm(q[:, :4], axis=1, keepdims=True)
    return q


def _needed(positions: np.ndarray, quaternions: np.ndarray, frames: FrameTimes, looseness: float) -> np.ndarray:
    """The frames that a moving body needs as keyframes; tolerances are multiplied by `looseness`."""
    return np.union1d(
        thin_positions(frames.t, positions, looseness * POSITION_TOLERANCE),
        thin_quaternions(frames.t, quaternions, looseness * ANGLE_TOLERANCE),
    )
