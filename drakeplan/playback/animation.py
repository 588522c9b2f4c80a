"""Animates what moves: the robot, the centre of mass, the contact forces; and shows what carries, while it does."""

# pydrake's stubs take the first parameter of ndarray for its type, and reject every array.
# pyright: reportArgumentType=false, reportCallIssue=false

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from pydrake.geometry import Cylinder, Meshcat, MeshcatAnimation, MeshcatCone, Rgba, Sphere
from pydrake.math import RigidTransform, RotationMatrix

from drakeplan.plan.plan import Plan, PlanCentroidal
from drakeplan.playback.contact_timeline import ContactTimeline
from drakeplan.playback.frame_times import FrameTimes
from drakeplan.playback.keyframes import thin_positions
from drakeplan.playback.push_rose import animate_pushes
from drakeplan.playback.robot_motion import POSITION_TOLERANCE, BodyPoses, animate_robot
from drakeplan.playback.still import COM, COM_COLOUR, ROOT
from drakeplan.playback.supports import animate_supports
from scenes.gravity import GRAVITY

FORCES = f"{ROOT}/forces"
FORCE_COLOUR = Rgba(1.0, 0.62, 0.05)  # of an arrow whose share of friction no page shows
OPACITY = 0.92  # below 1: what is transparent is drawn after all that is not, and so over the leg it stands in
FORCE_LENGTH = 0.9  # [m] of an arrow that carries the robot's whole weight
WEAKEST_FORCE = 0.004  # [M g] below this no arrow is shown


def animate(
    meshcat: Meshcat, plan: Plan, timeline: ContactTimeline, frames: FrameTimes, bodies: BodyPoses | None
) -> None:
    """Draws the moving objects at the motion's start and passes their animation to meshcat.

    Of a plan without motion the stances follow one another.

    Args:
        meshcat: to draw in.
        plan: whose motion is shown.
        timeline: of its contacts.
        frames: that keyframes may lie at.
        bodies: where the robot is; None without a motion.
    """
    if not len(timeline.start):
        return
    animation = MeshcatAnimation(frames.rate)
    animation.set_loop_mode(MeshcatAnimation.LoopMode.kLoopRepeat)
    animation.set_repetitions(10_000)
    animation.set_autoplay(timeline.timed)
    if bodies is not None:
        assert plan.centroidal is not None
        animate_robot(animation, bodies, frames)
        _animate_com(meshcat, animation, plan, frames)
        for effector, name in enumerate(plan.effectors):
            if (plan.centroidal.contact[:, effector] >= 0).any():
                _animate_force(meshcat, animation, plan, effector, f"{FORCES}/{name}", frames)
    animate_supports(meshcat, animation, plan, timeline, frames)
    animate_pushes(meshcat, animation, plan, frames.rate, frames.last)
    meshcat.SetAnimation(animation)


# ---- centre of mass and forces


def _animate_com(meshcat: Meshcat, animation: MeshcatAnimation, plan: Plan, frames: FrameTimes) -> None:
    assert plan.centroidal is not None
    meshcat.SetObject(COM, Sphere(0.035), COM_COLOUR)
    t = plan.centroidal.t - plan.centroidal.t[0]
    com = np.stack([np.interp(frames.t, t, column) for column in plan.centroidal.com.T], axis=1)
    meshcat.SetTransform(COM, RigidTransform(com[0]))
    for f in thin_positions(frames.t, com, POSITION_TOLERANCE).tolist():
        animation.SetTransform(f, COM, RigidTransform(com[f]))


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
    colour = Rgba(FORCE_COLOUR.r(), FORCE_COLOUR.g(), FORCE_COLOUR.b(), OPACITY)
    meshcat.SetObject(f"{path}/shaft/cylinder", Cylinder(0.014, 1.0), colour)
    meshcat.SetTransform(f"{path}/shaft/cylinder", RigidTransform([0, 0, 0.5]))
    meshcat.SetObject(f"{path}/head/cone", MeshcatCone(0.09, 0.038, 0.038), colour)
    for part in ("shaft/cylinder", "head/cone"):
        meshcat.SetProperty(f"{path}/{part}/<object>", "material.depthTest", False)
        meshcat.SetProperty(f"{path}/{part}/<object>", "castShadow", False)
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
    knot_frames = frames.at(centroidal.t - centroidal.t[0])
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
