"""An MCAP log with Foxglove's Protobuf schemas: frames of all links, joints, CoM, robot, terrain, contact forces.

Times begin at 0, so that the same plan gives the same bytes.
"""

# The generated Protobuf classes take any message where their stubs name one.
# pyright: reportMissingImports=false, reportArgumentType=false, reportAttributeAccessIssue=false

from __future__ import annotations

import io
import json
from pathlib import Path
from typing import Any

import numpy as np
from foxglove_schemas_protobuf.FrameTransform_pb2 import FrameTransform
from foxglove_schemas_protobuf.FrameTransforms_pb2 import FrameTransforms
from foxglove_schemas_protobuf.JointState_pb2 import JointState
from foxglove_schemas_protobuf.JointStates_pb2 import JointStates
from foxglove_schemas_protobuf.PoseInFrame_pb2 import PoseInFrame
from foxglove_schemas_protobuf.SceneUpdate_pb2 import SceneUpdate
from google.protobuf.timestamp_pb2 import Timestamp
from mcap_protobuf.writer import Writer
from scipy.spatial.transform import Rotation

from drakeplan.export.formats import ExportOptions, Product
from drakeplan.export.foxglove_scene import (
    COM_FRAME,
    WORLD,
    as_pose,
    contact_entity,
    robot_entities,
    terrain_entities,
)
from drakeplan.export.robot_bodies import robot_bodies
from drakeplan.export.samples import MotionSamples
from drakeplan.export.source import Source
from drakeplan.plan.arrays import last_before
from drakeplan.plan.body_poses import body_poses

NANO = 10**9
NO_TURN = [0.0, 0.0, 0.0, 1.0]
MAP = "map"  # the frame of a georeferenced scene's own coordinates
TF, JOINTS, COM, ROBOT, TERRAIN, CONTACTS = "/tf", "/joint_states", "/com", "/robot", "/terrain", "/contacts"


def export(source: Source, file: Path, options: ExportOptions) -> Product:
    """The log of a plan.

    Args:
        source: the plan with its robot.
        file: not used, the log is one file.
        options: not used.
    """
    assert source.robot is not None
    samples = source.samples
    bodies = robot_bodies(source.robot)
    names = [body.name for body in bodies]
    poses = body_poses(source.robot, source.parts[2].q, names)
    X_WB = np.stack([poses[name] for name in names], axis=1)
    rotation = Rotation.from_matrix(X_WB[..., :3, :3].reshape(-1, 3, 3)).as_quat(canonical=True)
    rotation = rotation.reshape(*X_WB.shape[:2], 4)
    knot = last_before(source.parts[1].t, samples.t)
    image = io.BytesIO()
    counts: dict[str, int] = {}
    with Writer(image) as writer:

        def write(topic: str, message: Any, time: int) -> None:
            number = counts[topic] = counts.get(topic, 0) + 1
            writer.write_message(topic, message, log_time=time, publish_time=time, sequence=number)

        writer.add_metadata("drakeplan", {"plan": json.dumps({"version": 1, **source.header()})})
        write(TERRAIN, SceneUpdate(entities=terrain_entities(source.scene.terrain)), 0)
        write(ROBOT, SceneUpdate(entities=robot_entities(bodies)), 0)
        for k, t in enumerate((samples.t - samples.t[0]).tolist()):
            time = round(t * NANO)
            stamp = Timestamp(seconds=time // NANO, nanos=time % NANO)
            frames = [
                _transform(stamp, WORLD, name, p, q)
                for name, p, q in zip(names, X_WB[k, :, :3, 3].tolist(), rotation[k].tolist(), strict=True)
            ]
            frames.append(_transform(stamp, WORLD, COM_FRAME, samples.com[k].tolist(), NO_TURN))
            if source.offset.any():
                frames.append(_transform(stamp, MAP, WORLD, source.offset.tolist(), NO_TURN))
            write(TF, FrameTransforms(transforms=frames), time)
            write(JOINTS, _joints(samples, k, stamp), time)
            write(COM, PoseInFrame(timestamp=stamp, frame_id=WORLD, pose=as_pose(samples.com[k])), time)
            if k == 0 or knot[k] != knot[k - 1]:
                entity = contact_entity(stamp, samples.cop[k], samples.force[k])
                write(CONTACTS, SceneUpdate(entities=[entity]), time)
    return Product(image.getvalue(), facts={"messages": counts, "links": len(bodies)})


def _transform(stamp: Timestamp, parent: str, child: str, p: list[float], q: list[float]) -> FrameTransform:
    return FrameTransform(
        timestamp=stamp,
        parent_frame_id=parent,
        child_frame_id=child,
        translation=dict(zip("xyz", p, strict=True)),
        rotation=dict(zip("xyzw", q, strict=True)),
    )


def _joints(samples: MotionSamples, k: int, stamp: Timestamp) -> JointStates:
    torque = samples.joint_torque
    return JointStates(
        timestamp=stamp,
        joints=[
            JointState(
                name=name,
                position=float(samples.joint_position[k, j]),
                velocity=float(samples.joint_velocity[k, j]),
                effort=None if torque is None else float(torque[k, j]),
            )
            for j, name in enumerate(samples.joint_names)
        ],
    )
