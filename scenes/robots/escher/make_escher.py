"""Writes escher.urdf: a humanoid of primitive shapes with the figures of ESCHER (33 DOF as in Lin 2020 sec. 4.6).

Run `python scenes/robots/escher/make_escher.py` after changing a number here; a test checks that the file follows.
Every link is a list of uniform solids, so masses, centres and inertias follow from the shapes that are drawn.
x is forward, y left, z up; in the zero posture the robot stands straight, arms hanging, palms facing down.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import cos, pi, sin
from pathlib import Path

import numpy as np

Vector = tuple[float, float, float]

# Lengths [m]
HIP_Y, HIP_Z = 0.10, -0.02  # hip centre in the pelvis frame (left)
THIGH, SHIN, ANKLE_HEIGHT = 0.40, 0.40, 0.09
ANKLE_BACK = 0.035  # the ankle stands this far behind the centre of the sole
SOLE = (0.11, 0.05)  # half length, half width of the patch that may carry load
WAIST_Z = 0.12  # waist joint in the pelvis frame
SHOULDER_Y, SHOULDER_Z = 0.225, 0.36  # in the torso frame (left)
UPPER_ARM, FOREARM, HAND = 0.30, 0.27, 0.11  # shoulder - elbow - wrist - palm patch
PALM = (0.045, 0.045)
HAIR = 0.001  # [m] collision boxes of sole and palm stay this far inside the patch

SHELL, FRAME, ACCENT, RUBBER, VISOR = "shell", "frame", "accent", "rubber", "visor"
COLOURS = {
    SHELL: (0.90, 0.91, 0.93, 1.0),
    FRAME: (0.23, 0.25, 0.29, 1.0),
    ACCENT: (0.95, 0.53, 0.12, 1.0),
    RUBBER: (0.10, 0.10, 0.12, 1.0),
    VISOR: (0.08, 0.30, 0.42, 1.0),
}


@dataclass(frozen=True)
class Solid:
    """A uniform solid of a link: drawn, and in collision when `collides`.

    Attributes:
        shape: box (x, y, z full edges), capsule or cylinder (radius, length along z), sphere (radius),
            ellipsoid (semi-axes).
        size: numbers of the shape [m].
        at: centre in the link frame [m].
        colour: a name in `COLOURS`; None is not drawn.
        mass: [kg], 0 for decoration.
        collides: whether it is a collision geometry.
        rpy: orientation in the link frame [rad].
    """

    shape: str
    size: tuple[float, ...]
    at: Vector
    colour: str | None
    mass: float = 0.0
    collides: bool = False
    rpy: Vector = (0.0, 0.0, 0.0)

    def inertia(self) -> np.ndarray:
        """(3, 3) about its own centre, in the link's axes [kg m^2]."""
        m, s = self.mass, self.size
        if self.shape == "box":
            diagonal = [
                m / 12 * (s[1] ** 2 + s[2] ** 2),
                m / 12 * (s[0] ** 2 + s[2] ** 2),
                m / 12 * (s[0] ** 2 + s[1] ** 2),
            ]
        elif self.shape == "sphere":
            diagonal = [0.4 * m * s[0] ** 2] * 3
        elif self.shape == "ellipsoid":
            diagonal = [
                m / 5 * (s[1] ** 2 + s[2] ** 2),
                m / 5 * (s[0] ** 2 + s[2] ** 2),
                m / 5 * (s[0] ** 2 + s[1] ** 2),
            ]
        else:  # a capsule weighs like a cylinder of its full length
            length = s[1] + (2 * s[0] if self.shape == "capsule" else 0.0)
            across = m / 12 * (3 * s[0] ** 2 + length**2)
            diagonal = [across, across, 0.5 * m * s[0] ** 2]
        R = _rotation(self.rpy)
        return R @ np.diag(diagonal) @ R.T

    def geometry(self) -> str:
        """The URDF element of the shape."""
        numbers = " ".join(_number(v) for v in self.size)
        if self.shape == "box":
            return f'<box size="{numbers}"/>'
        if self.shape == "sphere":
            return f'<sphere radius="{numbers}"/>'
        if self.shape == "ellipsoid":
            a, b, c = (_number(v) for v in self.size)
            return f'<drake:ellipsoid a="{a}" b="{b}" c="{c}"/>'
        tag = "drake:capsule" if self.shape == "capsule" else "cylinder"
        return f'<{tag} radius="{_number(self.size[0])}" length="{_number(self.size[1])}"/>'


@dataclass(frozen=True)
class Joint:
    """A joint to a child link, with its limits [rad, Nm, rad/s]; `axis` None is fixed."""

    name: str
    parent: str
    child: str
    at: Vector
    axis: Vector | None = None
    lower: float = 0.0
    upper: float = 0.0
    effort: float = 0.0
    speed: float = 0.0


def mirrored_solid(solid: Solid) -> Solid:
    """The same solid on the other side of the robot's xz plane."""
    (x, y, z), (roll, pitch, yaw) = solid.at, solid.rpy
    return replace(solid, at=(x, -y, z), rpy=(-roll, pitch, -yaw))


def mirrored_joint(joint: Joint) -> Joint:
    """The same joint on the other side: roll and yaw keep their axis and exchange their limits."""
    x, y, z = joint.at
    names = {f: getattr(joint, f).replace("left_", "right_") for f in ("name", "parent", "child")}
    limits = {} if joint.axis is None or joint.axis[1] else {"lower": -joint.upper, "upper": -joint.lower}
    return replace(joint, at=(x, -y, z), **names, **limits)


X, Y, Z = (1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)
ALONG_X, ALONG_Y = (0.0, pi / 2, 0.0), (pi / 2, 0.0, 0.0)


def trunk() -> dict[str, list[Solid]]:
    """Pelvis, torso and head."""
    return {
        "pelvis": [
            Solid("box", (0.17, 0.20, 0.12), (0, 0, 0.035), None, 6.0, True),
            Solid("capsule", (0.058, 0.12), (0, 0, -0.012), FRAME, 0.0, False, ALONG_Y),
            Solid("box", (0.15, 0.19, 0.075), (0, 0, 0.055), SHELL),
            Solid("box", (0.012, 0.07, 0.03), (0.073, 0, 0.06), ACCENT),
            Solid("cylinder", (0.065, 0.05), (0, 0, 0.11), FRAME, 2.0),
        ],
        "torso": [
            Solid("box", (0.20, 0.28, 0.34), (0, 0, 0.235), None, 19.5, True),
            Solid("cylinder", (0.075, 0.08), (0, 0, 0.045), FRAME, 2.0),
            Solid("box", (0.14, 0.18, 0.13), (0, 0, 0.13), SHELL),
            Solid("cylinder", (0.085, 0.02), (0, 0, 0.20), FRAME),
            Solid("box", (0.17, 0.26, 0.13), (0.01, 0, 0.275), SHELL),
            Solid("capsule", (0.072, 0.11), (0.01, 0, 0.335), SHELL, 0.0, False, ALONG_Y),
            Solid("box", (0.012, 0.09, 0.03), (0.093, 0, 0.285), ACCENT),
            Solid("box", (0.07, 0.20, 0.24), (-0.10, 0, 0.25), FRAME, 2.5),
            Solid("cylinder", (0.05, 0.44), (0, 0, SHOULDER_Z), FRAME, 0.0, False, ALONG_Y),
            Solid("cylinder", (0.04, 0.06), (0, 0, 0.44), FRAME),
        ],
        "head": [
            Solid("capsule", (0.085, 0.05), (0, 0, 0.09), None, 3.4, True),
            Solid("ellipsoid", (0.095, 0.08, 0.105), (0, 0, 0.09), SHELL),
            Solid("ellipsoid", (0.06, 0.068, 0.042), (0.042, 0, 0.10), VISOR),
            Solid("cylinder", (0.028, 0.17), (0, 0, 0.095), ACCENT, 0.0, False, ALONG_Y),
        ],
    }


def left_leg() -> dict[str, list[Solid]]:
    """Hip to foot; the frame of left_foot is the centre of the sole."""
    length, width = 2 * (SOLE[0] - HAIR), 2 * (SOLE[1] - HAIR)
    x, thickness = -ANKLE_BACK, 0.03
    return {
        "left_hip_yaw_link": [Solid("cylinder", (0.05, 0.07), (0, 0, 0.03), FRAME, 1.4)],
        "left_hip_roll_link": [Solid("cylinder", (0.048, 0.12), (-0.01, 0, 0), FRAME, 1.6, False, ALONG_X)],
        "left_thigh": [
            Solid("cylinder", (0.055, 0.12), (0, 0, 0), FRAME, 1.2, False, ALONG_Y),
            Solid("capsule", (0.064, 0.22), (0, 0, -0.195), SHELL, 4.6, True),
            Solid("box", (0.012, 0.05, 0.12), (0.062, 0, -0.18), ACCENT),
        ],
        "left_shin": [
            Solid("cylinder", (0.05, 0.11), (0, 0, 0), FRAME, 0.9, False, ALONG_Y),
            Solid("capsule", (0.050, 0.22), (0, 0, -0.20), SHELL, 2.6, True),
            Solid("box", (0.012, 0.04, 0.10), (0.047, 0, -0.14), FRAME),
        ],
        "left_ankle_link": [Solid("cylinder", (0.035, 0.085), (0, 0, 0), FRAME, 0.5, False, ALONG_Y)],
        "left_ankle_roll_link": [Solid("cylinder", (0.032, 0.09), (0, 0, 0), FRAME, 0.3, False, ALONG_X)],
        "left_foot": [
            Solid("box", (length, width, thickness), (0, 0, thickness / 2), None, 1.2, True),
            Solid("box", (length, width, 0.014), (0, 0, 0.007), RUBBER),
            Solid("box", (length - 0.01, width - 0.006, 0.016), (0, 0, 0.022), SHELL),
            Solid("ellipsoid", (0.075, 0.042, 0.04), (0.015, 0, 0.028), SHELL),
            Solid("box", (0.06, 0.05, 0.05), (x, 0, 0.05), FRAME),
        ],
    }


def left_arm() -> dict[str, list[Solid]]:
    """Shoulder to palm; left_palm's frame is the centre of the palm, z towards the forearm, x along the fingers."""
    side, thickness = 2 * (PALM[0] - HAIR), 0.02
    fingers = [
        Solid("capsule", (0.009, 0.032), (0.022, y, 0.012), FRAME, 0, False, ALONG_X)
        for y in (-0.03, -0.01, 0.01, 0.03)
    ]
    return {
        "left_shoulder_pitch_link": [Solid("cylinder", (0.055, 0.07), (0, -0.01, 0), FRAME, 1.1, False, ALONG_Y)],
        "left_shoulder_roll_link": [Solid("sphere", (0.062,), (0, 0, 0), SHELL, 0.8)],
        "left_upper_arm": [
            Solid("capsule", (0.045, 0.16), (0, 0, -0.16), SHELL, 1.7, True),
            Solid("cylinder", (0.047, 0.02), (0, 0, -0.11), ACCENT),
        ],
        "left_forearm": [
            Solid("cylinder", (0.042, 0.095), (0, 0, 0), FRAME, 0.4, False, ALONG_Y),
            Solid("capsule", (0.038, 0.15), (0, 0, -0.145), SHELL, 1.1, True),
        ],
        "left_wrist_yaw_link": [Solid("cylinder", (0.034, 0.03), (0, 0, 0.015), FRAME, 0.15)],
        "left_wrist_roll_link": [Solid("cylinder", (0.026, 0.06), (0, 0, 0), FRAME, 0.15, False, ALONG_X)],
        "left_hand": [
            Solid("cylinder", (0.026, 0.06), (0, 0, 0), FRAME, 0.1, False, ALONG_Y),
            Solid("box", (0.05, 0.06, 0.065), (0, 0, -0.055), SHELL, 0.35, True),
        ],
        "left_palm": [
            Solid("box", (side, side, thickness), (0, 0, thickness / 2), None, 0.15, True),
            Solid("box", (side, side, 0.008), (0, 0, 0.004), RUBBER),
            Solid("box", (0.05, side, 0.012), (-0.018, 0, 0.014), SHELL),
            *fingers,
        ],
    }


def left_joints() -> list[Joint]:
    """Joints of the left leg and arm, from the trunk outwards."""
    s = "left_"
    return [
        Joint(s + "hip_yaw", "pelvis", s + "hip_yaw_link", (0, HIP_Y, HIP_Z), Z, -0.9, 1.0, 110, 10),
        Joint(s + "hip_roll", s + "hip_yaw_link", s + "hip_roll_link", (0, 0, 0), X, -0.5, 0.9, 210, 10),
        Joint(s + "hip_pitch", s + "hip_roll_link", s + "thigh", (0, 0, 0), Y, -2.1, 0.8, 260, 12),
        Joint(s + "knee", s + "thigh", s + "shin", (0, 0, -THIGH), Y, 0.03, 2.4, 280, 12),
        Joint(s + "ankle_pitch", s + "shin", s + "ankle_link", (0, 0, -SHIN), Y, -1.0, 0.8, 200, 10),
        Joint(s + "ankle_roll", s + "ankle_link", s + "ankle_roll_link", (0, 0, 0), X, -0.6, 0.6, 130, 10),
        Joint(s + "sole", s + "ankle_roll_link", s + "foot", (ANKLE_BACK, 0, -ANKLE_HEIGHT)),
        Joint(
            s + "shoulder_pitch", "torso", s + "shoulder_pitch_link", (0, SHOULDER_Y, SHOULDER_Z), Y, -3.0, 1.4, 120, 9
        ),
        Joint(
            s + "shoulder_roll", s + "shoulder_pitch_link", s + "shoulder_roll_link", (0, 0, 0), X, -0.25, 2.6, 120, 9
        ),
        Joint(s + "shoulder_yaw", s + "shoulder_roll_link", s + "upper_arm", (0, 0, 0), Z, -1.9, 1.9, 70, 9),
        Joint(s + "elbow", s + "upper_arm", s + "forearm", (0, 0, -UPPER_ARM), Y, -2.4, -0.03, 90, 9),
        Joint(s + "wrist_yaw", s + "forearm", s + "wrist_yaw_link", (0, 0, -FOREARM), Z, -2.0, 2.0, 40, 11),
        Joint(s + "wrist_roll", s + "wrist_yaw_link", s + "wrist_roll_link", (0, 0, 0), X, -1.2, 1.2, 40, 11),
        Joint(s + "wrist_pitch", s + "wrist_roll_link", s + "hand", (0, 0, 0), Y, -1.5, 1.5, 40, 11),
        Joint(s + "palm_mount", s + "hand", s + "palm", (0, 0, -HAND)),
    ]


# Links two joints apart whose shapes meet at the joint between them; neighbours by one joint Drake leaves out itself.
NEIGHBOURS = (
    ("pelvis", "{}thigh"),
    ("{}shin", "{}foot"),
    ("{}forearm", "{}hand"),
)


def links() -> dict[str, list[Solid]]:
    """Every link with its solids."""
    left = left_leg() | left_arm()
    right = {n.replace("left_", "right_"): [mirrored_solid(s) for s in solids] for n, solids in left.items()}
    return trunk() | left | right


def joints() -> list[Joint]:
    """Every joint; the waist and the neck stand in the trunk."""
    left = left_joints()
    return [
        Joint("waist_yaw", "pelvis", "torso", (0, 0, WAIST_Z), Z, -1.2, 1.2, 170, 9),
        Joint("neck", "torso", "head", (0, 0, 0.47)),
        *left,
        *(mirrored_joint(j) for j in left),
    ]


def urdf() -> str:
    """The whole model as URDF text."""
    lines = ['<?xml version="1.0"?>', "<!-- Written by make_escher.py: change that, not this. -->"]
    lines.append('<robot xmlns:drake="http://drake.mit.edu" name="escher">')
    for name, (r, g, b, a) in COLOURS.items():
        lines.append(f'  <material name="{name}"><color rgba="{r} {g} {b} {a}"/></material>')
    for name, solids in links().items():
        lines += _link(name, solids)
    for joint in joints():
        lines += _joint(joint)
    for side in ("left_", "right_"):
        for pair in NEIGHBOURS:
            a, b = (name.format(side) for name in pair)
            group = f"{side}{a}_{b}".replace(side + side, side)
            lines.append(f'  <drake:collision_filter_group name="{group}">')
            lines += [f'    <drake:member link="{name}"/>' for name in (a, b)]
            lines += [
                f'    <drake:ignored_collision_filter_group name="{group}"/>',
                "  </drake:collision_filter_group>",
            ]
    return "\n".join([*lines, "</robot>", ""])


def _rotation(rpy: Vector) -> np.ndarray:
    (sr, sp, sy), (cr, cp, cy) = (tuple(f(v) for v in rpy) for f in (sin, cos))
    Rx = np.array([[1, 0, 0], [0, cr, -sr], [0, sr, cr]])
    Ry = np.array([[cp, 0, sp], [0, 1, 0], [-sp, 0, cp]])
    Rz = np.array([[cy, -sy, 0], [sy, cy, 0], [0, 0, 1]])
    return Rz @ Ry @ Rx


def _number(value: float) -> str:
    text = f"{value:.9f}".rstrip("0").rstrip(".")
    return "0" if text in ("-0", "") else text


def _vector(values: Sequence[float] | np.ndarray) -> str:
    return " ".join(_number(float(v)) for v in values)


def _inertial(solids: Sequence[Solid]) -> tuple[float, np.ndarray, np.ndarray]:
    mass = sum(s.mass for s in solids)
    com = np.sum([s.mass * np.array(s.at) for s in solids], axis=0) / mass
    inertia = np.zeros((3, 3))
    for s in solids:
        d = np.array(s.at) - com
        inertia += s.inertia() + s.mass * (d @ d * np.eye(3) - np.outer(d, d))
    return mass, com, inertia


def _link(name: str, solids: Sequence[Solid]) -> list[str]:
    mass, com, I = _inertial(solids)
    moments = {"ixx": I[0, 0], "iyy": I[1, 1], "izz": I[2, 2], "ixy": I[0, 1], "ixz": I[0, 2], "iyz": I[1, 2]}
    lines = [f'  <link name="{name}">', f'    <inertial><origin xyz="{_vector(com)}"/><mass value="{_number(mass)}"/>']
    lines.append("      <inertia " + " ".join(f'{k}="{_number(v)}"' for k, v in moments.items()) + "/></inertial>")
    for i, s in enumerate(solids):
        origin = f'<origin xyz="{_vector(s.at)}" rpy="{_vector(s.rpy)}"/><geometry>{s.geometry()}</geometry>'
        if s.colour is not None:
            lines.append(f'    <visual name="{name}_visual_{i}">{origin}<material name="{s.colour}"/></visual>')
        if s.collides:
            lines.append(f'    <collision name="{name}_collision_{i}">{origin}</collision>')
    return [*lines, "  </link>"]


def _joint(j: Joint) -> list[str]:
    ends = f'<parent link="{j.parent}"/><child link="{j.child}"/><origin xyz="{_vector(j.at)}"/>'
    if j.axis is None:
        return [f'  <joint name="{j.name}" type="fixed">{ends}</joint>']
    limits = {"lower": j.lower, "upper": j.upper, "effort": j.effort, "velocity": j.speed}
    text = " ".join(f'{k}="{_number(v)}"' for k, v in limits.items())
    return [
        f'  <joint name="{j.name}" type="revolute">{ends}',
        f'    <axis xyz="{_vector(j.axis)}"/><limit {text}/><dynamics damping="0.1"/></joint>',
        f'  <transmission name="{j.name}_transmission"><type>transmission_interface/SimpleTransmission</type>',
        f'    <joint name="{j.name}"/>',
        f'    <actuator name="{j.name}"><mechanicalReduction>1</mechanicalReduction></actuator>',
        "  </transmission>",
    ]


if __name__ == "__main__":
    Path(__file__).with_name("escher.urdf").write_text(urdf(), encoding="utf-8")
