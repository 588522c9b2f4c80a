"""Writes bracer.urdf: a wheeled base, a torso of two joints, two arms of seven joints with round palms; primitives alone.

Sizes follow the platform of Lin 2020 sec. 5.10 (a Clearpath Husky with two HDT Adroit arms) as far as figures show them; masses
are ours. `python scenes/robots/bracer/make_bracer.py` writes the file beside this one again.

Frames at zero: x forward, y to the left, z up; arms hang down. The palm frames press along their z.
"""

from __future__ import annotations

from pathlib import Path

BASE = (0.98, 0.56, 0.24)  # [m] of the chassis
BASE_HEIGHT, BASE_MASS = 0.27, 36.0  # [m] of its middle over the ground, [kg]
WHEEL_RADIUS, WHEEL_WIDTH, WHEEL_MASS = 0.165, 0.11, 2.5
WHEELBASE, TRACK = 0.512, 0.52  # [m]
TORSO_AT, TORSO_MASS = (0.10, 0.0, 0.39), 36.0  # [m] of its joints in the base frame, [kg]
SHOULDER = (0.0, 0.22, 0.58)  # [m] of the left one in the torso's frame
UPPER_ARM, FOREARM, HAND = 0.40, 0.38, 0.16  # [m]
ARM_MASS = (3.0, 2.2, 0.8)  # [kg] of upper arm, forearm, hand
PALM_RADIUS = 0.06  # [m]
TORSO_JOINTS = (("torso_yaw", "0 0 1", 2.3), ("torso_pitch", "0 1 0", 0.7))
ARM_JOINTS = (  # name, axis, range [rad]
    ("shoulder_pitch", "0 1 0", 2.6),
    ("shoulder_roll", "1 0 0", 2.2),
    ("upper_arm_yaw", "0 0 1", 2.6),
    ("elbow", "0 1 0", 2.4),
    ("forearm_yaw", "0 0 1", 2.6),
    ("wrist_pitch", "0 1 0", 1.7),
    ("wrist_roll", "1 0 0", 1.7),
)


def urdf() -> str:
    """The model."""
    parts = [_link("base", BASE_MASS, _box(BASE), (0.0, 0.0, BASE_HEIGHT))]
    for name, x, y in wheels():
        wheel = f'<cylinder radius="{WHEEL_RADIUS}" length="{WHEEL_WIDTH}"/>'
        parts.append(_link(name, WHEEL_MASS, wheel, (0.0, 0.0, 0.0), "1.5707963 0 0"))
        parts.append(_fixed(name, "base", name, (x, y, WHEEL_RADIUS)))
    parts += [_link("torso_turn", 1.0, _box((0.1, 0.1, 0.06)), (0.0, 0.0, 0.0))]
    parts += [_link("torso", TORSO_MASS, _box((0.18, 0.30, 0.55)), (0.0, 0.0, 0.33))]
    (yaw, pitch) = TORSO_JOINTS
    parts.append(_joint(yaw[0], "base", "torso_turn", TORSO_AT, yaw[1], yaw[2]))
    parts.append(_joint(pitch[0], "torso_turn", "torso", (0.0, 0.0, 0.0), pitch[1], pitch[2]))
    for side, sign in (("left", 1.0), ("right", -1.0)):
        parts += _arm(side, sign)
    return '<?xml version="1.0"?>\n<robot name="bracer">\n' + "\n".join(parts) + "\n</robot>\n"


def wheels() -> list[tuple[str, float, float]]:
    """Name, x and y [m] of each wheel in the base frame, whose origin is on the ground."""
    return [
        (f"{end}_{side}_wheel", u * WHEELBASE / 2, v * TRACK / 2)
        for end, u in (("front", 1.0), ("rear", -1.0))
        for side, v in (("left", 1.0), ("right", -1.0))
    ]


def _arm(side: str, sign: float) -> list[str]:
    shoulder = (SHOULDER[0], sign * SHOULDER[1], SHOULDER[2])
    links = {
        2: ("upper_arm", UPPER_ARM, ARM_MASS[0]),
        4: ("forearm", FOREARM, ARM_MASS[1]),
        6: ("hand", HAND, ARM_MASS[2]),
    }
    at = {0: shoulder, 3: (0.0, 0.0, -UPPER_ARM), 5: (0.0, 0.0, -FOREARM)}
    parts, parent = [], "torso"
    for k, (joint, axis, reach) in enumerate(ARM_JOINTS):
        child = f"{side}_{links[k][0]}" if k in links else f"{side}_{joint}_link"
        if k in links:
            _, length, mass = links[k]
            parts.append(_link(child, mass, _box((0.07, 0.07, length - 0.06)), (0.0, 0.0, -length / 2)))
        else:
            parts.append(_link(child, 0.1, _box((0.02, 0.02, 0.02)), (0.0, 0.0, 0.0)))
        parts.append(_joint(f"{side}_{joint}", parent, child, at.get(k, (0.0, 0.0, 0.0)), axis, reach))
        parent = child
    disc = f'<cylinder radius="{PALM_RADIUS}" length="0.02"/>'
    parts.append(_link(f"{side}_palm", 0.1, disc, (0.0, 0.0, -0.01)))
    parts.append(_fixed(f"{side}_palm", parent, f"{side}_palm", (0.0, 0.0, -HAND), "3.14159265 0 0"))
    return parts


def _box(size: tuple[float, float, float]) -> str:
    return f'<box size="{size[0]:g} {size[1]:g} {size[2]:g}"/>'


def _link(name: str, mass: float, shape: str, at: tuple[float, float, float], rpy: str = "0 0 0") -> str:
    origin = f'<origin xyz="{at[0]:g} {at[1]:g} {at[2]:g}" rpy="{rpy}"/>'
    inertia = 0.02 * mass
    return (
        f'  <link name="{name}">\n    <inertial>{origin}<mass value="{mass:g}"/>'
        f'<inertia ixx="{inertia:g}" iyy="{inertia:g}" izz="{inertia:g}" ixy="0" ixz="0" iyz="0"/></inertial>\n'
        f"    <visual>{origin}<geometry>{shape}</geometry></visual>\n"
        f"    <collision>{origin}<geometry>{shape}</geometry></collision>\n  </link>"
    )


def _joint(name: str, parent: str, child: str, at: tuple[float, float, float], axis: str, reach: float) -> str:
    return (
        f'  <joint name="{name}" type="revolute"><parent link="{parent}"/><child link="{child}"/>'
        f'<origin xyz="{at[0]:g} {at[1]:g} {at[2]:g}"/><axis xyz="{axis}"/>'
        f'<limit lower="-{reach:g}" upper="{reach:g}" effort="120" velocity="3"/></joint>'
    )


def _fixed(name: str, parent: str, child: str, at: tuple[float, float, float], rpy: str = "0 0 0") -> str:
    return (
        f'  <joint name="{name}_mount" type="fixed"><parent link="{parent}"/><child link="{child}"/>'
        f'<origin xyz="{at[0]:g} {at[1]:g} {at[2]:g}" rpy="{rpy}"/></joint>'
    )


if __name__ == "__main__":
    Path(__file__).with_name("bracer.urdf").write_text(urdf(), encoding="utf-8")
