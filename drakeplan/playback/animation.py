"""Draws and animates what moves: the robot, the centre of mass, the contact forces; and what carries, while it does."""

# pydrake's stubs take the first parameter of ndarray for its type, and reject every array.
# pyright: reportArgumentType=false, reportCallIssue=false

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from pydrake.common.eigen_geometry import Quaternion
from pydrake.geometry import (
    Cylinder,
    Meshcat,
    MeshcatAnimation,
    MeshcatCone,
    MeshcatVisualizer,
    MeshcatVisualizerParams,
    Rgba,
    Role,
    Sphere,
)
from pydrake.math import RigidTransform, RotationMatrix
from pydrake.multibody.plant import AddMultibodyPlantSceneGraph
from pydrake.multibody.tree import BodyIndex
from pydrake.systems.framework import DiagramBuilder

from drakeplan.plan.plan import Plan, PlanCentroidal
from drakeplan.playback.keyframes import continuous_signs, thin_positions, thin_quaternions
from drakeplan.playback.push_rose import animate_pushes
from drakeplan.playback.still import COM_COLOUR, ROOT
from drakeplan.playback.supports import animate_supports
from scenes.gravity import GRAVITY
from scenes.robots.drake_parser import add_model
from scenes.robots.robot import Robot

FRAMES_PER_SECOND = 25.0
MAX_KEYFRAMES = 70_000  # of all bodies together, some 10 MB of page; tolerances grow until it is kept
MAX_FRAMES = 6000  # of longer motions fewer frames a second are kept
POSITION_TOLERANCE = 1.0e-3  # [m] a frame in between may be off by this
ANGLE_TOLERANCE = 4.0e-3  # [rad]
ROBOT = f"{ROOT}/robot"
FORCE_COLOUR = Rgba(1.0, 0.62, 0.05)
FORCE_LENGTH = 0.9  # [m] of an arrow that carries the robot's whole weight
WEAKEST_FORCE = 0.004  # [M g] below this no arrow is shown


@dataclass(frozen=True, eq=False)
class FrameTimes:
    """The instants that keyframes may lie at.

    Attributes:
        rate: frames a second.
        t: (F,) seconds since the motion began; the last one is its end, moved to the next whole frame.
    """

    rate: float
    t: np.ndarray

    @property
    def last(self) -> int:
        """Number of the last frame."""
        return len(self.t) - 1


def frame_times(duration: float) -> FrameTimes:
    """The frames of a motion of this many seconds."""
    rate = min(FRAMES_PER_SECOND, MAX_FRAMES / max(duration, 1e-9))
    return FrameTimes(rate, np.arange(int(np.ceil(duration * rate - 1e-9)) + 1) / rate)


def animate(meshcat: Meshcat, plan: Plan, robot: Robot) -> FrameTimes | None:
    """Draws the moving objects at the motion's start and passes their animation to meshcat.

    A plan without motion shows no robot, and None is returned.

    Args:
        meshcat: to draw in.
        plan: whose motion is shown.
        robot: the plan's.
    """
    if plan.motion is None or plan.centroidal is None:
        return None
    frames = frame_times(plan.duration)
    animation = MeshcatAnimation(frames.rate)
    animation.set_loop_mode(MeshcatAnimation.LoopMode.kLoopRepeat)
    animation.set_repetitions(10_000)
    _animate_robot(meshcat, animation, plan, robot, frames)
    _animate_com(meshcat, animation, plan, frames)
    for effector, name in enumerate(plan.effectors):
        _animate_force(meshcat, animation, plan, effector, f"{ROOT}/forces/{name}", frames)
    animate_supports(meshcat, animation, plan, frames.rate, frames.last)
    animate_pushes(meshcat, animation, plan, frames.rate, frames.last)
    meshcat.SetAnimation(animation)
    return frames


# ---- robot


def _animate_robot(meshcat: Meshcat, animation: MeshcatAnimation, plan: Plan, robot: Robot, frames: FrameTimes) -> None:
    paths, poses = _body_poses(meshcat, plan, robot, frames)
    looseness = 1.0
    while True:
        kept = [_needed(poses[:, b, 4:], poses[:, b, :4], frames, looseness) for b in range(len(paths))]
        if sum(map(len, kept)) <= MAX_KEYFRAMES:
            break
        looseness *= 1.6
    for b, path in enumerate(paths):
        for f in kept[b].tolist():
            animation.SetTransform(f, path, RigidTransform(Quaternion(poses[f, b, :4]), poses[f, b, 4:]))


def _body_poses(meshcat: Meshcat, plan: Plan, robot: Robot, frames: FrameTimes) -> tuple[list[str], np.ndarray]:
    """Draws the robot; paths of its bodies in meshcat, and (F, B, 7) quaternion w x y z and position in W."""
    assert plan.motion is not None
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
    q = _interpolate_q(plan, frames)
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
    return paths, poses


def _interpolate_q(plan: Plan, frames: FrameTimes) -> np.ndarray:
    """(F, nq) positions at the frames; the base's quaternion is interpolated along the chord and normalised."""
    assert plan.motion is not None
    motion = plan.motion
    t = motion.t - motion.t[0]
    q = np.stack([np.interp(frames.t, t, column) for column in motion.q.T], axis=1)
    if motion.position_names and motion.position_names[0].endswith("_qw"):
        q[:, :4] /= np.linalg.norm(q[:, :4], axis=1, keepdims=True)
    return q


# ---- centre of mass and forces


def _animate_com(meshcat: Meshcat, animation: MeshcatAnimation, plan: Plan, frames: FrameTimes) -> None:
    assert plan.centroidal is not None
    path = f"{ROOT}/com"
    meshcat.SetObject(path, Sphere(0.035), COM_COLOUR)
    t = plan.centroidal.t - plan.centroidal.t[0]
    com = np.stack([np.interp(frames.t, t, column) for column in plan.centroidal.com.T], axis=1)
    meshcat.SetTransform(path, RigidTransform(com[0]))
    for f in thin_positions(frames.t, com, POSITION_TOLERANCE).tolist():
        animation.SetTransform(f, path, RigidTransform(com[f]))


@dataclass(frozen=True, eq=False)
class _ArrowKeys:
    """Keyframes of one force arrow: frame number, tail (3,), direction (3,), length, whether it is shown."""

    frame: list[int]
    tail: list[np.ndarray]
    direction: list[np.ndarray]
    length: list[float]
    shown: list[bool]


def _animate_force(
    meshcat: Meshcat, animation: MeshcatAnimation, plan: Plan, effector: int, path: str, frames: FrameTimes
) -> None:
    """An arrow from the centre of pressure along the force on the robot, as long as the force is great."""
    keys = _arrow_keys(plan, effector, frames)
    meshcat.SetObject(f"{path}/shaft/cylinder", Cylinder(0.014, 1.0), FORCE_COLOUR)
    meshcat.SetTransform(f"{path}/shaft/cylinder", RigidTransform([0, 0, 0.5]))
    meshcat.SetObject(f"{path}/head/cone", MeshcatCone(0.09, 0.038, 0.038), FORCE_COLOUR)
    # The cone's apex is its origin and it opens along z: turned about x, and its base moved to the head's origin.
    meshcat.SetTransform(f"{path}/head/cone", RigidTransform(RotationMatrix.MakeXRotation(np.pi), [0, 0, 0.09]))
    meshcat.SetProperty(path, "visible", keys.shown[0])
    meshcat.SetTransform(path, _arrow_pose(keys, 0))
    meshcat.SetTransform(f"{path}/shaft", np.diag([1.0, 1.0, keys.length[0], 1.0]))
    meshcat.SetTransform(f"{path}/head", RigidTransform([0.0, 0.0, keys.length[0]]))
    for k, frame in enumerate(keys.frame):
        animation.SetTransform(frame, path, _arrow_pose(keys, k))
        animation.SetProperty(frame, path, "visible", keys.shown[k])
        animation.SetProperty(frame, f"{path}/shaft", "scale", [1.0, 1.0, keys.length[k]])
        animation.SetProperty(frame, f"{path}/head", "position", [0.0, 0.0, keys.length[k]])


def _arrow_pose(keys: _ArrowKeys, k: int) -> RigidTransform:
    return RigidTransform(RotationMatrix.MakeFromOneVector(keys.direction[k], 2), keys.tail[k])


def _arrow_keys(plan: Plan, effector: int, frames: FrameTimes) -> _ArrowKeys:
    """Keys at the knots; an end effector that changes its contact gets one more, so that its arrow does not glide."""
    assert plan.centroidal is not None
    centroidal = plan.centroidal
    knot_frames = np.round((centroidal.t - centroidal.t[0]) * frames.rate).astype(int).clip(0, frames.last)
    keys = _ArrowKeys([], [], [], [], [])
    before = None
    for n, frame in enumerate(knot_frames.tolist()):
        now = _arrow(plan, centroidal, n, effector)
        if keys.frame and frame <= keys.frame[-1]:
            continue
        changed = n > 0 and centroidal.contact[n, effector] != centroidal.contact[n - 1, effector]
        if before is not None and changed and frame - keys.frame[-1] > 1:
            _append(keys, frame - 1, before)
        _append(keys, frame, now)
        before = now
    if keys.frame[-1] < frames.last and before is not None:
        _append(keys, frames.last, before)
    return keys


Arrow = tuple[np.ndarray, np.ndarray, float, bool]


def _append(keys: _ArrowKeys, frame: int, arrow: Arrow) -> None:
    keys.frame.append(frame)
    keys.tail.append(arrow[0])
    keys.direction.append(arrow[1])
    keys.length.append(arrow[2])
    keys.shown.append(arrow[3])


def _arrow(plan: Plan, centroidal: PlanCentroidal, n: int, effector: int) -> Arrow:
    contact = int(centroidal.contact[n, effector])
    force = centroidal.force_W[n, effector] / (plan.mass * GRAVITY)
    size = float(np.linalg.norm(force))
    if contact < 0 or size < WEAKEST_FORCE:
        return np.zeros(3), np.array([0.0, 0.0, 1.0]), 0.001, False
    X_WC = plan.contacts.X_WC[contact]
    tail = X_WC[:3, :3] @ [*centroidal.cop_C[n, effector], 0.0] + X_WC[:3, 3]
    return tail, force / size, FORCE_LENGTH * size, True


def _needed(positions: np.ndarray, quaternions: np.ndarray, frames: FrameTimes, looseness: float) -> np.ndarray:
    """The frames that a moving body needs as keyframes; tolerances are multiplied by `looseness`."""
    return np.union1d(
        thin_positions(frames.t, positions, looseness * POSITION_TOLERANCE),
        thin_quaternions(frames.t, quaternions, looseness * ANGLE_TOLERANCE),
    )
