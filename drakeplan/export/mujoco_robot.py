"""A robot as MJCF elements: bodies, joints, inertias, shapes, position servos."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
from lxml import etree  # type: ignore[attr-defined]
from scipy.spatial.transform import Rotation

from drakeplan.export.robot_bodies import Body, BodyShape
from scenes.robots.meshes import obj_text

STIFFNESS = 20.0  # [1/rad] of a servo, in units of its greatest torque: that torque at an error of 0.05 rad
UNLIMITED = 100.0  # [N m] stands for the greatest torque of a motor without a limit
LEAST_INERTIA = 1e-9  # [kg m^2] MuJoCo refuses bodies without
LOOKS, SOLID = 2, 3  # groups of MuJoCo's viewers: shapes for display, shapes for collision
MICROMETRE = 6  # decimals of the corners in mesh files [m]
GEOM_TYPES = {"box": "box", "sphere": "sphere", "cylinder": "cylinder", "capsule": "capsule", "ellipsoid": "ellipsoid"}


def numbers(values: Iterable[float] | np.ndarray) -> str:
    """Numbers as MJCF has them; nine digits, and no minus before a zero."""
    return " ".join(f"{v + 0.0:.9g}" for v in np.asarray(values, float).ravel())


def placed(element: etree._Element, X: np.ndarray) -> etree._Element:
    """The element with the position and quaternion of a pose (4, 4).

    Args:
        element: which is changed.
        X: (4, 4) pose in the element's parent.
    """
    element.set("pos", numbers(X[:3, 3]))
    xyzw = Rotation.from_matrix(X[:3, :3]).as_quat(canonical=True)
    if abs(xyzw[3]) < 1.0 - 1e-15:
        element.set("quat", numbers(xyzw[[3, 0, 1, 2]]))
    return element


def _positive(inertia: np.ndarray) -> np.ndarray:
    """The inertia (3, 3), with as much added to all moments as MuJoCo asks of a point or a rod."""
    least = float(np.linalg.eigvalsh(inertia)[0])
    return inertia + max(LEAST_INERTIA - least, 0.0) * np.eye(3)


class MujocoRobot:
    """The elements of one robot.

    Attributes:
        files: mesh files by name, for the folder of assets.
    """

    def __init__(self, bodies: tuple[Body, ...]) -> None:
        """Takes the robot.

        Args:
            bodies: parents before children, the floating base first.
        """
        self._bodies = bodies
        self.files: dict[str, bytes] = {}

    def add(self, root: etree._Element, worldbody: etree._Element, start: np.ndarray) -> None:
        """Adds meshes, bodies and servos.

        Args:
            root: of the MJCF, with elements asset and actuator.
            worldbody: which takes the base.
            start: (3,) where the base stands before a keyframe is chosen [m].
        """
        elements = {}
        for body in self._bodies:
            parent = worldbody if body.parent is None else elements[body.parent]
            element = elements[body.name] = etree.SubElement(parent, "body", name=body.name)
            if body.parent is None:
                element.set("pos", numbers(start))
                etree.SubElement(element, "freejoint", name="floating_base")
                etree.SubElement(
                    element, "camera", name="beside", mode="trackcom", pos="0 -3.5 0.8", xyaxes="1 0 0 0 0.2 1"
                )
            else:
                placed(element, body.X_PB)
            self._joint(root, element, body)
            if body.mass > 0.0:
                inertia = _positive(body.inertia)[[0, 1, 2, 0, 0, 1], [0, 1, 2, 1, 2, 2]]
                inertial = etree.SubElement(element, "inertial", pos=numbers(body.com), mass=f"{body.mass:.12g}")
                inertial.set("fullinertia", " ".join(f"{v:.12g}" for v in inertia))
            for k, shape in enumerate(body.looks):
                self._shape(root, element, shape, f"{body.name}_{k}", LOOKS)
            for k, shape in enumerate(body.collision):
                self._shape(root, element, shape, f"{body.name}_solid_{k}", SOLID)

    def _joint(self, root: etree._Element, element: etree._Element, body: Body) -> None:
        joint = body.joint
        if joint is None:
            return
        kind = "slide" if joint.sliding else "hinge"
        made = etree.SubElement(element, "joint", name=joint.name, type=kind, axis=numbers(joint.axis))
        if np.any(joint.anchor):
            made.set("pos", numbers(joint.anchor))
        if np.isfinite(joint.limits).all():
            made.set("range", numbers(joint.limits))
        if joint.damping:
            made.set("damping", numbers([joint.damping]))
        if joint.effort is not None:
            most = joint.effort if 0.0 < joint.effort < np.inf else UNLIMITED
            servo = etree.SubElement(root.find("actuator"), "position", name=joint.name, joint=joint.name)
            servo.set("kp", numbers([STIFFNESS * most]))
            servo.set("dampratio", "1")
            servo.set("forcerange", numbers([-most, most]))

    def _shape(self, root: etree._Element, element: etree._Element, shape: BodyShape, name: str, group: int) -> None:
        geom = placed(etree.SubElement(element, "geom"), shape.X_BG)
        geom.set("group", str(group))
        if group == LOOKS:
            geom.set("contype", "0")
            geom.set("conaffinity", "0")
            geom.set("rgba", numbers(shape.colour))
        if shape.kind not in GEOM_TYPES:
            geom.set("type", "mesh")
            geom.set("mesh", name)
            self._mesh(root.find("asset"), shape, name)
            return
        geom.set("type", shape.kind)
        size = np.array(shape.size)
        if shape.kind == "box":
            size = size / 2
        elif shape.kind in ("cylinder", "capsule"):
            size = size * [1.0, 0.5]
        geom.set("size", numbers(size))

    def _mesh(self, asset: etree._Element, shape: BodyShape, name: str) -> None:
        mesh = etree.SubElement(asset, "mesh", name=name)
        if shape.kind == "hull":
            mesh.set("vertex", numbers(shape.points))
            return
        corners = np.round(shape.points.reshape(-1, 3), MICROMETRE)
        vertices, faces = np.unique(corners, axis=0, return_inverse=True)
        mesh.set("file", f"{name}.obj")
        mesh.set("inertia", "shell")  # display meshes need not be closed
        self.files[f"{name}.obj"] = obj_text(vertices, faces.reshape(-1, 3)).encode()
