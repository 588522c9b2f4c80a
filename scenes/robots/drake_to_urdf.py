"""An SDF or MJCF model as a URDF with the same bodies, joints, limits, motors and shapes.

Drake's parser understands all three formats; what it made of the file is written down again, so that the rest of the
robot's preparation knows one format only. STL and DAE meshes become OBJ files first, since Drake takes no others.
"""

# pydrake's stubs read "float64[m, 1]" as a shape and refuse every array.
# pyright: reportArgumentType=false, reportCallIssue=false, reportAttributeAccessIssue=false, reportReturnType=false, reportOperatorIssue=false

from __future__ import annotations

from pathlib import Path

import numpy as np
import trimesh
from lxml import etree  # type: ignore[attr-defined]
from pydrake.geometry import (
    Box,
    Capsule,
    Cylinder,
    Ellipsoid,
    GeometryId,
    HalfSpace,
    Role,
    SceneGraphInspector,
    Shape,
    Sphere,
)
from pydrake.math import RigidTransform, RollPitchYaw
from pydrake.multibody.plant import AddMultibodyPlantSceneGraph, MultibodyPlant
from pydrake.multibody.tree import Joint, ModelInstanceIndex, PrismaticJoint, RevoluteJoint, RigidBody, WeldJoint
from pydrake.systems.framework import DiagramBuilder

from scenes.input_error import InputError
from scenes.meshes.mesh_file import read_mesh
from scenes.robots.addresses import Addresses
from scenes.robots.drake_parser import add_model, reading
from scenes.robots.meshes import obj_text

DRAKE = "http://drake.mit.edu"
CONVERTED = (".stl", ".dae")
MESH_PLACES = {"uri": None, "mesh": "file"}  # SDF: text of <uri>; MJCF: attribute of <mesh>
FLOATING = "quaternion_floating"


def urdf_from_drake(model: Path, addresses: Addresses, folder: Path) -> Path:
    """Writes the model as a URDF.

    Args:
        model: an SDF or MJCF file.
        addresses: where its meshes lie.
        folder: takes the URDF and its meshes.

    Returns:
        The path of the URDF.

    Raises:
        InputError: Drake cannot read it, or it has joints that are neither revolute, prismatic nor fixed.
    """
    readable = _with_obj_meshes(model, addresses, folder)
    builder = DiagramBuilder()
    plant, scene_graph = AddMultibodyPlantSceneGraph(builder, time_step=1e-3)
    try:
        add_model(plant, readable)
        with reading(readable):
            plant.Finalize()
    except InputError as error:
        raise InputError(" ".join(str(error).replace(str(readable), str(model)).split())) from None
    root = etree.Element("robot", nsmap={"drake": DRAKE}, name="robot")
    writer = _Writer(plant, scene_graph.model_inspector(), model, folder)
    writer.write(root)
    path = folder / "model.urdf"
    etree.indent(root)
    etree.ElementTree(root).write(path, xml_declaration=True, encoding="utf-8")
    return path


def _with_obj_meshes(model: Path, addresses: Addresses, folder: Path) -> Path:
    """A copy of the model whose meshes are absolute paths of files that Drake takes."""
    try:
        tree = etree.parse(str(model), etree.XMLParser(resolve_entities=False, no_network=True, remove_comments=True))
    except (etree.XMLSyntaxError, OSError) as error:  # the latter for bytes that are not in the encoding
        raise InputError(f"{model}: not XML ({error})") from None
    compiler = tree.getroot().find("compiler")
    base = model.parent
    if tree.getroot().tag == "mujoco" and compiler is not None:
        base = (base / (compiler.get("meshdir") or compiler.get("assetdir") or ".")).resolve()
    for element in tree.getroot().iter(*MESH_PLACES):
        attribute = MESH_PLACES[element.tag]
        address = (element.text or "").strip() if attribute is None else element.get(attribute, "")
        if not address or (element.tag == "uri" and element.getparent().tag != "mesh"):
            continue
        path = addresses.resolve(address, base)
        if path.suffix.lower() in CONVERTED:
            path = _as_obj(path, folder)
        if attribute is None:
            element.text = str(path)
        else:
            if element.get("name") is None:
                element.set("name", Path(address).stem)
            element.set(attribute, str(path))
    copy = folder / f"readable{model.suffix}"
    tree.write(str(copy), xml_declaration=True, encoding="utf-8")
    return copy


def _as_obj(path: Path, folder: Path) -> Path:
    vertices, faces = np.unique(np.round(read_mesh(path).reshape(-1, 3), 6), axis=0, return_inverse=True)
    number = len(list(folder.glob("*.obj")))
    target = folder / f"{path.stem}_{number}.obj"
    target.write_text(obj_text(vertices, faces.reshape(-1, 3)), encoding="utf-8")
    return target


class _Writer:
    """Writes the bodies and joints of one plant."""

    def __init__(self, plant: MultibodyPlant, inspector: SceneGraphInspector, model: Path, folder: Path) -> None:
        """Reads the motors.

        Args:
            plant: finalized.
            inspector: of its scene graph.
            model: the file, for errors.
            folder: takes the meshes.
        """
        self.plant, self.inspector, self.model, self.folder = plant, inspector, model, folder
        self.effort = {
            plant.get_joint_actuator(a).joint().index(): plant.get_joint_actuator(a).effort_limit()
            for a in plant.GetJointActuatorIndices()
        }
        self.hulls = 0

    def write(self, root: etree._Element) -> None:
        self._check_names()
        world = self.plant.world_body().index()
        for index in self.plant.GetBodyIndices(self._instance()):
            if index != world:
                self._body(root, self.plant.get_body(index))
        for index in self.plant.GetJointIndices():
            joint = self.plant.get_joint(index)
            if joint.parent_body().index() == world and joint.type_name() in (FLOATING, WeldJoint.kTypeName):
                continue  # the base, whether it floats or is fixed: a robot that walks floats
            self._joint(root, joint)

    def _instance(self) -> ModelInstanceIndex:
        instances = [ModelInstanceIndex(k) for k in range(2, self.plant.num_model_instances())]  # after world, default
        robots = [i for i in instances if self.plant.GetBodyIndices(i)]
        if len(robots) != 1:
            raise InputError(f"{self.model}: expected one robot model, the file has {len(robots)}")
        return robots[0]

    def _check_names(self) -> None:
        for index in self.plant.GetJointIndices():
            joint = self.plant.get_joint(index)
            if joint.type_name() not in (
                RevoluteJoint.kTypeName,
                PrismaticJoint.kTypeName,
                WeldJoint.kTypeName,
                FLOATING,
            ):
                raise InputError(
                    f"{self.model}: joint {joint.name()!r} is {joint.type_name()}, expected revolute, prismatic or fixed: "
                    "model it as revolute joints in a row, or fix it"
                )

    def _body(self, root: etree._Element, body: RigidBody) -> None:
        link = etree.SubElement(root, "link", name=body.name())
        inertia = body.default_spatial_inertia()
        mass, com = inertia.get_mass(), np.array(inertia.get_com())
        if mass > 0.0:
            about_com = inertia.CalcRotationalInertia().CopyToFullMatrix3()
            with np.errstate(over="ignore", invalid="ignore"):  # the adapter refuses what is not finite
                about_com = about_com - mass * ((com @ com) * np.eye(3) - np.outer(com, com))
            inertial = etree.SubElement(link, "inertial")
            inertial.append(_origin(RigidTransform(com)))
            etree.SubElement(inertial, "mass", value=f"{mass:.12g}")
            entries = {
                f"i{a}{b}": about_com["xyz".index(a), "xyz".index(b)] for a, b in ("xx", "yy", "zz", "xy", "xz", "yz")
            }
            etree.SubElement(inertial, "inertia", **{k: f"{v:.12g}" for k, v in entries.items()})
        frame = self.plant.GetBodyFrameIdOrThrow(body.index())
        for tag, role in (("visual", Role.kIllustration), ("collision", Role.kProximity)):
            for geometry in self.inspector.GetGeometries(frame, role):
                element = self._shape(geometry)
                if element is not None:
                    holder = etree.SubElement(link, tag)
                    holder.append(_origin(self.inspector.GetPoseInFrame(geometry)))
                    etree.SubElement(holder, "geometry").append(element)

    def _shape(self, geometry: GeometryId) -> etree._Element | None:
        shape: Shape = self.inspector.GetShape(geometry)
        if isinstance(shape, HalfSpace):
            return None
        if isinstance(shape, Box):
            return etree.Element("box", size=_numbers(shape.size()))
        if isinstance(shape, Sphere):
            return etree.Element("sphere", radius=_numbers([shape.radius()]))
        if isinstance(shape, Cylinder | Capsule):
            tag = "cylinder" if isinstance(shape, Cylinder) else f"{{{DRAKE}}}capsule"
            return etree.Element(tag, radius=_numbers([shape.radius()]), length=_numbers([shape.length()]))
        if isinstance(shape, Ellipsoid):
            size = {k: _numbers([v]) for k, v in zip("abc", (shape.a(), shape.b(), shape.c()), strict=True)}
            return etree.Element(f"{{{DRAKE}}}ellipsoid", **size)
        hull = self.inspector.GetConvexHull(geometry)
        vertices = np.array([hull.vertex(i) for i in range(hull.num_vertices())])
        with np.errstate(
            invalid="ignore", divide="ignore"
        ):  # trimesh divides by the volume, which a flat shape has not
            convex = trimesh.convex.convex_hull(vertices)
        path = self.folder / f"hull_{self.hulls}.obj"
        self.hulls += 1
        path.write_text(obj_text(convex.vertices, convex.faces), encoding="utf-8")
        return etree.Element("mesh", filename=path.name)

    def _joint(self, root: etree._Element, joint: Joint) -> None:
        """A joint; where its frame on the child is not the child's own, a massless link stands between."""
        parent, child = joint.parent_body().name(), joint.child_body().name()
        X_PF = joint.frame_on_parent().GetFixedPoseInBodyFrame()
        X_BM = joint.frame_on_child().GetFixedPoseInBodyFrame()
        if isinstance(joint, WeldJoint):
            _add_joint(root, joint.name(), "fixed", parent, child, X_PF @ joint.X_FM() @ X_BM.inverse())
            return
        target = child
        if not X_BM.IsNearlyEqualTo(RigidTransform(), 1e-9):
            target = f"{child}_at_{joint.name()}"
            etree.SubElement(root, "link", name=target)
            _add_joint(root, f"{target}_fixed", "fixed", target, child, X_BM.inverse())
        prismatic = isinstance(joint, PrismaticJoint)
        element = _add_joint(root, joint.name(), "prismatic" if prismatic else "revolute", parent, target, X_PF)
        axis = joint.translation_axis() if prismatic else joint.revolute_axis()
        etree.SubElement(element, "axis", xyz=_numbers(axis))
        limits = {
            "lower": joint.position_lower_limits()[0],
            "upper": joint.position_upper_limits()[0],
            "velocity": joint.velocity_upper_limits()[0],
            "effort": self.effort.get(joint.index(), np.inf),
        }
        etree.SubElement(element, "limit", **{k: f"{v:.12g}" for k, v in limits.items() if np.isfinite(v)})


def _add_joint(
    root: etree._Element, name: str, kind: str, parent: str, child: str, X_PC: RigidTransform
) -> etree._Element:
    element = etree.SubElement(root, "joint", name=name, type=kind)
    element.append(_origin(X_PC))
    etree.SubElement(element, "parent", link=parent)
    etree.SubElement(element, "child", link=child)
    return element


def _origin(X: RigidTransform) -> etree._Element:
    rpy = RollPitchYaw(X.rotation()).vector()
    return etree.Element("origin", xyz=_numbers(X.translation()), rpy=_numbers(rpy))


def _numbers(values) -> str:  # noqa: ANN001  (any sequence of numbers)
    return " ".join(f"{v:.12g}" for v in values)
