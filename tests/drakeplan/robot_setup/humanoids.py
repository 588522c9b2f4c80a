"""Humanoids of boxes and capsules as URDF text: the same robot in the many ways in which models are written.

In its own axes F (x ahead, y to its left, z up) every such robot is the same. What differs is how links are called, which
axes the frames of its links have, what stands above its base, where its joints are at 0, and how it ends: toes, fingers.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, fields, replace
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

AXES = {  # R_FM: axes of every link's frame M in F
    "ahead": np.eye(3),
    "backwards": np.diag([-1.0, -1.0, 1.0]),
    "left": np.array([[0.0, -1, 0], [1, 0, 0], [0, 0, 1]]),
    "y up": np.array([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]]),
    "y up, z ahead": np.array([[0.0, 0, 1], [1, 0, 0], [0, 1, 0]]),
    "x up": np.array([[0.0, 0, -1], [0, 1, 0], [1, 0, 0]]),
}
NAMINGS: dict[str, Callable[[str, str], str]] = {  # (side "left" or "right", snake_case part) -> name
    "left_hip": lambda side, part: f"{side}_{part}",
    "l_hip": lambda side, part: f"{side[0]}_{part}",
    "hip_L": lambda side, part: f"{part}_{side[0].upper()}",
    "hip_left": lambda side, part: f"{part}_{side}",
    "LHip": lambda side, part: side[0].upper() + "".join(w.capitalize() for w in part.split("_")),
    "LeftHip": lambda side, part: side.capitalize() + "".join(w.capitalize() for w in part.split("_")),
    "LEFT_HIP": lambda side, part: f"{side}_{part}".upper(),
    "leg_left_hip": lambda side, part: f"limb_{side}_{part}",
}
ROOTS = ("none", "massless", "world fixed", "world floating")
FEET = ("box", "four spheres", "cut corners")
ARM = ("shoulder_pitch", "shoulder_roll", "shoulder_yaw", "elbow", "wrist_yaw", "wrist_pitch", "wrist_roll")
AXIS = {"pitch": (0, 1, 0), "roll": (1, 0, 0), "yaw": (0, 0, 1), "knee": (0, 1, 0), "elbow": (0, 1, 0)}
FOOT_HALF = (0.11, 0.05)  # [m] half length and half width of the sole
SOLE_CENTRE = np.array([0.03, 0.0, -0.08])  # [m] in the foot's link, in F
HIP, THIGH, SHIN = np.array([0.0, 0.1, -0.06]), 0.38, 0.38  # [m]
SHOULDER, UPPER_ARM, FOREARM = np.array([0.0, 0.23, 0.36]), 0.27, 0.24  # [m] in the torso's link
HAND = (0.09, 0.09, 0.1)  # [m] box below the wrist
CUT = 0.03  # [m] off each corner of a sole with cut corners
SPHERE = 0.01  # [m] radius of the four spheres
BENT = (-0.3, 0.6, -0.3)  # [rad] hip, knee and ankle at the zero of a model with offsets


@dataclass(frozen=True)
class Humanoid:
    """How one robot is written; see the module for what stays the same.

    Attributes:
        naming: key of `NAMINGS`.
        axes: key of `AXES`.
        root: what stands above the base.
        arm_joints: 0 for no arms, else 4 to 7 in each.
        waist: whether the torso turns on the pelvis, else it is welded.
        head: whether there is one, on a joint.
        fingers: of each hand, with two joints each.
        toes: whether a part of the foot turns.
        foot: one of `FEET`, or "sphere", "lying cylinder", "point": what cannot stand.
        feet_by_name: whether the links of the feet are called left_foot and right_foot.
        offsets: whether joints are at 0 with knees bent and arms lifted.
        continuous: whether hips and shoulders yaw without limits.
        mimic: whether the second joint of each finger mimics the first.
        drawn_only: whether there are no collision shapes.
        scale: of all lengths.
        knee: lower and upper limit of the knees [rad].
        torso_ahead: how far the torso's CoM is in front [m], before scaling.
    """

    naming: str = "left_hip"
    axes: str = "ahead"
    root: str = "none"
    arm_joints: int = 6
    waist: bool = True
    head: bool = True
    fingers: int = 0
    toes: bool = False
    foot: str = "box"
    feet_by_name: bool = False
    offsets: bool = False
    continuous: bool = False
    mimic: bool = False
    drawn_only: bool = False
    scale: float = 1.0
    knee: tuple[float, float] = (0.0, 2.3)
    torso_ahead: float = 0.0

    def __str__(self) -> str:
        changed = [f"{f.name} {v}" for f in fields(self) if (v := getattr(self, f.name)) != f.default]
        return ", ".join(changed) or "usual"

    def sided(self, side: str, part: str) -> str:
        """The name of a part on a side."""
        return f"{side}_foot" if self.feet_by_name and part == "foot" else NAMINGS[self.naming](side, part)

    def write(self, folder: Path, name: str = "toy.urdf") -> Path:
        """Writes the model, and the mesh that it may need, into a folder."""
        if self.foot == "cut corners":
            (folder / "sole.obj").write_text(_cut_sole(self.scale, AXES[self.axes]))
        path = folder / name
        path.write_text(self.urdf(), encoding="utf-8")
        return path

    def urdf(self) -> str:
        """The text of the model."""
        return _Writer(self).text()


@dataclass
class _Writer:
    h: Humanoid
    parts: list[str] = field(default_factory=list)

    def text(self) -> str:
        h = self.h
        if h.root != "none":
            above = "base_footprint" if h.root == "massless" else "world"
            self.parts.append(f'<link name="{above}"/>')
            self.joint(
                "root_joint", "floating" if h.root == "world floating" else "fixed", above, "pelvis", (0, 0, 0.9)
            )
        self.link("pelvis", 10.0, [("box", (0.16, 0.16, 0.1), (0, 0, 0.02))])
        ahead = (h.torso_ahead, 0.0, 0.24)
        self.link("torso", 22.0, [("box", (0.18, 0.3, 0.34), (0, 0, 0.24))], com=ahead)
        self.joint(
            "waist_yaw", "revolute" if h.waist else "fixed", "pelvis", "torso", (0, 0, 0.08), (0, 0, 1), (-0.6, 0.6)
        )
        if h.head:
            self.link("head", 3.0, [("sphere", (0.09,), (0, 0, 0.12))])
            self.joint("neck_yaw", "revolute", "torso", "head", (0, 0, 0.42), (0, 0, 1), (-1, 1))
        for side, y in (("left", 1.0), ("right", -1.0)):
            self.leg(side, np.array([1.0, y, 1.0]))
            if h.arm_joints:
                self.arm(side, np.array([1.0, y, 1.0]))
        return f'<?xml version="1.0"?>\n<robot name="toy" xmlns:drake="http://drake.mit.edu">{"".join(self.parts)}</robot>\n'

    def leg(self, side: str, mirror: np.ndarray) -> None:
        h = self.h
        names = [h.sided(side, p) for p in ("hip_yaw", "hip_roll", "thigh", "shin", "ankle", "foot")]
        self.link(names[0], 1.0, [])
        self.link(names[1], 1.0, [])
        self.link(names[2], 5.0, [("capsule", (0.055, 0.24), (0, 0, -0.5 * THIGH))])
        self.link(names[3], 3.0, [("capsule", (0.045, 0.22), (0, 0, -0.5 * SHIN))])
        self.link(names[4], 0.5, [])
        self.foot(side, names[5])
        hip, knee, ankle = BENT if h.offsets else (0.0, 0.0, 0.0)
        yaw = "continuous" if h.continuous else "revolute"
        places = [HIP * mirror, (0, 0, 0), (0, 0, 0), (0, 0, -THIGH), (0, 0, -SHIN), (0, 0, 0)]
        joints = [
            ("hip_yaw_joint", yaw, (0, 0, 1), (-0.9, 0.9), 0.0),
            ("hip_roll_joint", "revolute", (1, 0, 0), (-0.7, 0.7), 0.0),
            ("hip_pitch_joint", "revolute", (0, 1, 0), (-2.1, 0.9), hip),
            ("knee_joint", "revolute", (0, 1, 0), h.knee, knee),
            ("ankle_pitch_joint", "revolute", (0, 1, 0), (-1.3, 1.0), ankle),
            ("ankle_roll_joint", "revolute", (1, 0, 0), (-0.6, 0.6), 0.0),
        ]
        for parent, child, place, (name, kind, axis, limits, zero) in zip(
            ["pelvis", *names[:-1]], names, places, joints, strict=True
        ):
            self.joint(h.sided(side, name), kind, parent, child, place, axis, limits, zero, effort=150.0)

    def foot(self, side: str, name: str) -> None:
        h, (cx, _, cz), (hx, hy) = self.h, SOLE_CENTRE, FOOT_HALF
        if h.foot == "box":
            front = 0.06 if h.toes else hx
            shapes = [("box", (hx + front, 2 * hy, 0.03), (cx + 0.5 * (front - hx), 0, cz + 0.015))]
        elif h.foot == "four spheres":
            shapes = [
                ("sphere", (SPHERE,), (cx + sx * (hx - SPHERE), sy * (hy - SPHERE), cz + SPHERE))
                for sx in (1, -1)
                for sy in (1, -1)
            ]
        elif h.foot == "cut corners":
            shapes = [("mesh", (), (0, 0, 0))]
        elif h.foot == "lying cylinder":
            shapes = [("cylinder", (0.04, 0.2), (cx, 0, cz + 0.04), Rotation.from_euler("y", 0.5 * np.pi).as_matrix())]
        else:
            radius = {"sphere": 0.06, "point": 0.001}[h.foot]
            shapes = [("sphere", (radius,), (0, 0, cz + radius))]
        self.link(name, 1.2, shapes, com=(0.02, 0, -0.05))
        if h.toes:
            toe = h.sided(side, "toe")
            self.link(toe, 0.2, [("box", (hx - 0.06, 2 * hy, 0.03), (0.5 * (hx - 0.06), 0, cz + 0.015))])
            self.joint(f"{toe}_joint", "revolute", name, toe, (cx + 0.06, 0, 0), (0, 1, 0), (-0.5, 0.5))

    def arm(self, side: str, mirror: np.ndarray) -> None:
        h = self.h
        links = [h.sided(side, p) for p in ("clavicle", "shoulder", "upper_arm", "forearm", "wrist", "carpus", "hand")]
        places = [SHOULDER * mirror, (0, 0, 0), (0, 0, 0), (0, 0, -UPPER_ARM), (0, 0, -FOREARM), (0, 0, 0), (0, 0, 0)]
        shapes = {"upper_arm": ("capsule", (0.04, 0.14), (0, 0, -0.5 * UPPER_ARM)),
                  "forearm": ("capsule", (0.035, 0.13), (0, 0, -0.45 * FOREARM)),
                  "hand": ("box", HAND, (0, 0, -0.5 * HAND[2] - 0.01))}  # fmt: skip
        masses = (0.8, 0.8, 1.6, 1.2, 0.2, 0.2, 0.4)
        limits = [(-2.6, 2.6), (-0.5, 2.2), (-2, 2), (-2.3, 0.0), (-2, 2), (-1.3, 1.3), (-1, 1)]
        used = [*range(h.arm_joints), *([6] if h.arm_joints < 7 else [])]  # the hand is always there, welded if need be
        parent, skipped = "torso", np.zeros(3)
        for k in range(7):
            if k not in used:
                skipped = skipped + places[k]
                continue
            part = ("clavicle", "shoulder", "upper_arm", "forearm", "wrist", "carpus", "hand")[k]
            self.link(links[k], masses[k], [shapes[part]] if part in shapes else [])
            low, high = limits[k]
            if ARM[k].endswith("roll") and side == "right":
                low, high = -high, -low
            zero = 0.0
            if h.offsets and k == 1:
                zero = 1.2 if side == "left" else -1.2
            kind = "fixed" if k >= h.arm_joints else "continuous" if h.continuous and k == 2 else "revolute"
            axis = AXIS[ARM[k].rpartition("_")[2]]
            self.joint(
                h.sided(side, f"{ARM[k]}_joint"), kind, parent, links[k], skipped + places[k], axis, (low, high), zero
            )
            parent, skipped = links[k], np.zeros(3)
        for f in range(h.fingers):
            y = 0.03 * (f - 0.5 * (h.fingers - 1))
            first, second = h.sided(side, f"finger_{f}_a"), h.sided(side, f"finger_{f}_b")
            for name in (first, second):
                self.link(name, 0.03, [("box", (0.02, 0.02, 0.04), (0, 0, -0.02))])
            a, b = f"{first}_joint", f"{second}_joint"
            self.joint(a, "revolute", parent, first, (0.03, y, -HAND[2] - 0.01), (0, -1, 0), (-0.1, 1.5))
            self.joint(b, "revolute", first, second, (0, 0, -0.04), (0, -1, 0), (-0.1, 1.5), mimic=a if h.mimic else "")

    def link(self, name: str, mass: float, shapes: list[tuple], com: tuple[float, ...] | None = None) -> None:
        h, s = self.h, self.h.scale
        centre = com if com is not None else shapes[0][2] if shapes else (0.0, 0.0, 0.0)
        mass *= s**3
        inertia = 0.005 * mass * s**2
        text = "".join(self.shape(*shape) for shape in shapes)
        if h.drawn_only:
            text = text.replace("collision>", "visual>")
        self.parts.append(
            f'<link name="{name}"><inertial>{self.origin(centre)}<mass value="{mass:.9g}"/><inertia ixx="{inertia:.9g}" '
            f'iyy="{inertia:.9g}" izz="{inertia:.9g}" ixy="0" ixz="0" iyz="0"/></inertial>{text}</link>'
        )

    def shape(self, kind: str, size: tuple, place: tuple, R_FG: np.ndarray | None = None) -> str:
        s = self.h.scale
        v = [f"{s * x:.9g}" for x in size]
        body = {
            "box": lambda: f'<box size="{" ".join(v)}"/>',
            "sphere": lambda: f'<sphere radius="{v[0]}"/>',
            "cylinder": lambda: f'<cylinder radius="{v[0]}" length="{v[1]}"/>',
            "capsule": lambda: f'<drake:capsule radius="{v[0]}" length="{v[1]}"/>',
            "mesh": lambda: '<mesh filename="sole.obj"/>',
        }[kind]()
        R_FM = AXES[self.h.axes]
        R_MG = np.eye(3) if kind == "mesh" else R_FM.T @ (np.eye(3) if R_FG is None else R_FG)
        return f"<collision>{self.origin(place, R_MG)}<geometry>{body}</geometry></collision>"

    def origin(self, place: tuple | np.ndarray, R: np.ndarray | None = None) -> str:
        """An origin whose place is given in F."""
        p = AXES[self.h.axes].T @ (self.h.scale * np.array(place, float))
        rpy = np.zeros(3) if R is None else _rpy(R)
        return f'<origin xyz="{_numbers(p)}" rpy="{_numbers(rpy)}"/>'

    def joint(
        self, name: str, kind: str, parent: str, child: str, place: tuple | np.ndarray, axis: tuple = (1, 0, 0),
        limits: tuple[float, float] = (0.0, 0.0), zero: float = 0.0, *, effort: float = 60.0, mimic: str = "",
    ) -> None:  # fmt: skip
        R_FM = AXES[self.h.axes]
        R = R_FM.T @ Rotation.from_rotvec(zero * np.array(axis, float)).as_matrix() @ R_FM
        low, high = (v - zero for v in limits)
        words = f'<axis xyz="{_numbers(R_FM.T @ np.array(axis, float))}"/>' if kind not in ("fixed", "floating") else ""
        if kind == "revolute":
            words += f'<limit lower="{low:.9g}" upper="{high:.9g}" effort="{effort}" velocity="8"/>'
        if mimic:
            words += f'<mimic joint="{mimic}"/>'
        self.parts.append(
            f'<joint name="{name}" type="{kind}">{self.origin(place, R)}<parent link="{parent}"/><child link="{child}"/>'
            f"{words}</joint>"
        )


def _cut_sole(scale: float, R_FM: np.ndarray) -> str:
    """A sole with cut corners, 3 cm thick, as OBJ in the foot's own axes."""
    outline = np.concatenate([_corner(sx, sy) for sx, sy in ((1, 1), (-1, 1), (-1, -1), (1, -1))])
    points = [np.array([x, y, z]) + SOLE_CENTRE for z in (0.0, 0.03) for x, y in outline]
    lines = [f"v {_numbers(scale * R_FM.T @ p)}" for p in points]
    lines += [f"f 1 {k + 1} {k + 2}" for k in range(1, 7)] + [f"f 9 {k + 9} {k + 10}" for k in range(1, 7)]
    lines += [f"f {k + 1} {(k + 1) % 8 + 1} {k + 9}" for k in range(8)]
    return "\n".join(lines) + "\n"


def _corner(sx: int, sy: int) -> np.ndarray:
    hx, hy = FOOT_HALF
    pair = np.array([[sx * hx, sy * (hy - CUT)], [sx * (hx - CUT), sy * hy]])
    return pair if sx * sy > 0 else pair[::-1]


def cut_outline() -> np.ndarray:
    """(8, 2) corners of the sole with cut corners about its centre, counter-clockwise [m]."""
    return np.concatenate([_corner(sx, sy) for sx, sy in ((1, 1), (-1, 1), (-1, -1), (1, -1))])


def _rpy(R: np.ndarray) -> np.ndarray:
    if abs(R[2, 0]) > 1.0 - 1e-9:
        return np.array([np.arctan2(-R[1, 2], R[1, 1]), -np.sign(R[2, 0]) * 0.5 * np.pi, 0.0])
    return Rotation.from_matrix(R).as_euler("xyz")


def _numbers(values: np.ndarray) -> str:
    return " ".join(f"{v + 0.0:.9g}" for v in values)


def variant(**changes: object) -> Humanoid:
    """The usual humanoid with some changes."""
    return replace(Humanoid(), **changes)  # type: ignore[arg-type]
