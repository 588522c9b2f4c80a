"""An MJCF of the plan's robot on its terrain, with keyframes along the plan, and a script that plays the motion."""

from __future__ import annotations

import json
import shlex
from pathlib import Path

import numpy as np
from lxml import etree  # type: ignore[attr-defined]

from drakeplan.export.formats import ExportOptions, Product
from drakeplan.export.mujoco_robot import STIFFNESS, MujocoRobot, numbers
from drakeplan.export.mujoco_terrain import MujocoTerrain
from drakeplan.export.numpy_archive import archive_bytes
from drakeplan.export.robot_bodies import Body, filtered_pairs, robot_bodies
from drakeplan.export.samples import MotionSamples
from drakeplan.export.source import Source
from scenes.input_error import InputError

SCRIPT = Path(__file__).with_name("mujoco_play.py")
STEP = 0.002  # [s] of MuJoCo's simulation


def export(source: Source, file: Path, options: ExportOptions) -> Product:
    """The MJCF, its assets and the player.

    Args:
        source: the plan with its robot.
        file: of the MJCF; the folder of assets and the player are called after it.
        options: not used.

    Raises:
        InputError: a name that an MJCF cannot hold, or the robot's model was changed after planning.
    """
    assert source.robot is not None
    if not file.name.isprintable():
        raise InputError(f"{file.name!r}: an MJCF names its folder of assets: expected a printable name")
    plan, samples = source.plan, source.samples
    bodies = robot_bodies(source.robot)
    motors = _motors(bodies, samples)
    folder = f"{file.stem}_assets"
    root = _empty_model(plan.robot, folder)
    worldbody = root.find("worldbody")
    terrain = MujocoTerrain(source.scene.terrain, plan.contacts.X_WC[:, :3, 3])
    terrain.add(root, worldbody)
    robot = MujocoRobot(bodies)
    robot.add(root, worldbody, samples.base_position[0])
    _add_patches(root, source)
    for a, b in filtered_pairs(source.robot):
        etree.SubElement(root.find("contact"), "exclude", body1=a, body2=b)
    keys = _add_keyframes(root, source, motors)
    etree.indent(root)
    assets = {f"{folder}/{name}": data for name, data in {**robot.files, **terrain.files}.items()}
    assets[f"{folder}/motion.npz"] = archive_bytes(_motion(source, file, bodies, motors))
    beside = {**assets, f"{file.stem}_play.py": SCRIPT.read_bytes()}
    facts = {
        "bodies": len(bodies),
        "joints": len(samples.joint_names),
        "mass": sum(body.mass for body in bodies),
        "terrain_solids": len(terrain.solids),
        "keyframes": keys,
        "run": shlex.join(["python", f"{file.stem}_play.py"]),
    }
    return Product(etree.tostring(root, xml_declaration=True, encoding="utf-8"), beside, facts)


def _empty_model(name: str, folder: str) -> etree._Element:
    """An MJCF with options, light and sky, whose meshes lie in a folder."""
    root = etree.Element("mujoco", model=name)
    etree.SubElement(root, "compiler", angle="radian", autolimits="true", inertiafromgeom="false", meshdir=folder)
    etree.SubElement(root, "option", timestep=numbers([STEP]), integrator="implicitfast", cone="elliptic")
    visual = etree.SubElement(root, "visual")
    etree.SubElement(visual, "headlight", ambient="0.4 0.4 0.4", diffuse="0.5 0.5 0.5")
    etree.SubElement(visual, "global", offwidth="1280", offheight="960")
    for tag in ("asset", "worldbody", "contact", "actuator", "keyframe"):
        etree.SubElement(root, tag)
    sky = etree.SubElement(root.find("asset"), "texture", type="skybox", builtin="gradient")
    for key, value in {"rgb1": "0.93 0.95 0.98", "rgb2": "0.6 0.7 0.82", "width": "256", "height": "256"}.items():
        sky.set(key, value)
    etree.SubElement(root.find("worldbody"), "light", pos="0 0 6", dir="0.2 0.3 -1", directional="true")
    return root


def _motors(bodies: tuple[Body, ...], samples: MotionSamples) -> list[int]:
    """The joints that have motors, in the order of the bodies, as indices into the plan's joints."""
    joints = [body.joint for body in bodies if body.joint is not None]
    if tuple(joint.name for joint in joints) != samples.joint_names:
        raise InputError("the robot's model has other joints than the plan: was it changed after planning?")
    return [k for k, joint in enumerate(joints) if joint.effort is not None]


def _positions(samples: MotionSamples) -> np.ndarray:
    """(T, nq) MuJoCo's positions: base position, base quaternion w x y z, joints."""
    return np.hstack([samples.base_position, samples.base_quaternion, samples.joint_position])


def _add_patches(root: etree._Element, source: Source) -> None:
    """A site on every sole and palm: its frame is the contact frame."""
    bodies = {body.get("name"): body for body in root.iter("body")}
    for name, (x, y) in zip(source.plan.effectors, source.plan.half_extent.tolist(), strict=True):
        if min(x, y) > 0.0:
            size = numbers([x, y, 0.0005])
            etree.SubElement(bodies[name], "site", name=name, type="box", size=size, rgba="1 0.5 0 0.4", group="4")


def _add_keyframes(root: etree._Element, source: Source, motors: list[int]) -> int:
    """The posture at the start of every phase, at which every stance is held, and at the end."""
    phases, samples = source.parts[0], source.samples
    q = _positions(samples)
    instants = [*phases.start.tolist(), float(samples.t[-1])]
    frames = [int(np.argmin(np.abs(samples.t - t))) for t in instants]
    for name, frame in zip([*(f"phase_{k}" for k in range(len(phases))), "end"], frames, strict=True):
        key = etree.SubElement(root.find("keyframe"), "key", name=name, time=numbers([samples.t[frame]]))
        key.set("qpos", numbers(q[frame]))
        if motors:
            key.set("ctrl", numbers(samples.joint_position[frame, motors]))
    return len(frames)


def _motion(source: Source, file: Path, bodies: tuple[Body, ...], motors: list[int]) -> dict[str, np.ndarray]:
    """The arrays that the player reads."""
    plan, samples = source.plan, source.samples
    w, xyz = samples.base_quaternion[:, :1], samples.base_quaternion[:, 1:]
    u = samples.base_angular_velocity  # MuJoCo wants it in the base's frame: rotate by the conjugate quaternion
    local = u + 2 * np.cross(-xyz, np.cross(-xyz, u) + w * u)
    torque = np.zeros_like(samples.joint_velocity) if samples.joint_torque is None else samples.joint_torque
    return {
        "model": np.array(file.name),
        "t": samples.t,
        "qpos": _positions(samples),
        "qvel": np.hstack([samples.base_linear_velocity, local, samples.joint_velocity]),
        "torque": torque[:, motors],
        "com": samples.com,
        "effectors": np.array(plan.effectors, dtype=str),
        "contact": samples.contact,
        "contact_X_WC": plan.contacts.X_WC,
        "header": np.array(
            json.dumps({"format": "drakeplan-mujoco", "version": 1, "servo_stiffness": STIFFNESS, **source.header()})
        ),
    }
