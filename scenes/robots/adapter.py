"""Makes the URDF of an installed package into one that Drake's Parser loads alone.

Drake takes no STL or DAE collision meshes, no package:// without a map, actuators only from transmissions, and
filters no pairs that touch by design. The adapted model lies in the user's cache, next to its meshes, in a folder
named after the content that it was made from; it appears there whole or not at all.
"""

from __future__ import annotations

import hashlib
import importlib.metadata
import math
import os
import shutil
import tempfile
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import platformdirs
from lxml import etree  # type: ignore[attr-defined]

from scenes.input_error import InputError
from scenes.robots.schema import FrameEntry, PackageEntry

ADAPTER_VERSION = 1  # part of the cache's key: raise it when the same input shall give another model
MAX_URDF_BYTES = 20_000_000
TOUCHING = 0.005  # [m] bodies nearer than this in the nominal posture are taken to touch by design
DRAKE = "http://drake.mit.edu"
KEPT = ("link", "joint", "material")  # what a URDF needs for planning; sensors, plugins and comments go
MOVING = ("revolute", "continuous", "prismatic")


def adapted_model(
    name: str, package: PackageEntry, base_body: str, nominal: Mapping[str, float], *, source: str
) -> Path:
    """The path of the adapted URDF, made now if this content was never adapted before.

    Args:
        name: of the robot.
        package: where its model is and what to change.
        base_body: the floating body.
        nominal: joint angles in which touching bodies are looked for [rad].
        source: the robot file, for errors.

    Raises:
        InputError: the package is not installed, or its model is not what the robot file says.
    """
    model = _Model(name, package, base_body, dict(nominal), source, _folders(package, source))
    root = Path(platformdirs.user_cache_dir("drakeplan")) / "robots"
    final = root / f"{name}-{model.content_hash()}"
    if not (final / "model.urdf").is_file():
        root.mkdir(parents=True, exist_ok=True)
        scratch = Path(tempfile.mkdtemp(prefix=f".{name}-", dir=root))
        try:
            model.write(scratch)
            os.replace(scratch, final)
        except OSError:
            if not (final / "model.urdf").is_file():  # else another process was first, with the same content
                raise
        finally:
            shutil.rmtree(scratch, ignore_errors=True)
    return final / "model.urdf"


def _folders(package: PackageEntry, source: str) -> dict[str, Path]:
    try:
        distribution = importlib.metadata.distribution(package.distribution)
    except importlib.metadata.PackageNotFoundError:
        raise InputError(
            f"{source}: the package {package.distribution} is not installed: pip install 'drakeplan[robots]'"
        ) from None
    site = Path(str(distribution.locate_file(""))).resolve()
    folders = {name: (site / folder).resolve() for name, folder in package.folders.items()}
    for name, folder in folders.items():
        if not folder.is_relative_to(site) or folder == site or not folder.is_dir():
            raise InputError(f"{source}: package.folders.{name}: there is no folder {folder} inside {site}")
    return folders


@dataclass
class _Model:
    """One adaptation: the URDF's tree, changed step by step, and the mesh files that go beside it."""

    name: str
    package: PackageEntry
    base_body: str
    nominal: dict[str, float]
    source: str
    folders: dict[str, Path]
    files: dict[str, str] = field(default_factory=dict)

    def __post_init__(self) -> None:
        urdf = self.resolve(self.package.urdf, Path("/"))
        if urdf.stat().st_size > MAX_URDF_BYTES:
            raise InputError(f"{urdf}: larger than {MAX_URDF_BYTES} bytes, which no robot model is")
        parser = etree.XMLParser(resolve_entities=False, no_network=True, remove_comments=True)
        try:
            tree = etree.parse(str(urdf), parser)
        except etree.XMLSyntaxError as error:
            raise InputError(f"{urdf}: not XML ({error})") from None
        if tree.docinfo.internalDTD is not None:
            raise InputError(f"{urdf}: declares a document type, expected a plain URDF")
        self.urdf = urdf
        self.root = etree.Element("robot", nsmap={"drake": DRAKE}, name=self.name)
        self.root.extend([e for e in tree.getroot() if e.tag in KEPT])
        self.links = {e.get("name"): e for e in self.root.findall("link")}
        self.joints = {e.get("name"): e for e in self.root.findall("joint")}
        self._check_numbers()
        self._check_names()

    def content_hash(self) -> str:
        """Sixteen hexadecimal digits over everything that the result depends on."""
        digest = hashlib.sha256(
            f"{ADAPTER_VERSION} {self.name} {self.base_body} {sorted(self.nominal.items())}".encode()
        )
        digest.update(self.package.model_dump_json().encode())
        for path in [self.urdf, *sorted({self.mesh_path(m) for m in self.root.iter("mesh")})]:
            digest.update(path.name.encode() + path.read_bytes())
        return digest.hexdigest()[:16]

    def write(self, folder: Path) -> None:
        """Everything into a folder: model.urdf and its meshes."""
        self._weld_fixed_joints()
        self._convert_collisions()
        self._convert_visuals()
        self._add_frames()
        self._add_actuators()
        for name, text in self.files.items():
            (folder / name).write_text(text, encoding="utf-8")
        self._write_urdf(folder)
        self._filter_pairs(folder / "model.urdf")
        self._write_urdf(folder)

    def resolve(self, address: str, base: Path) -> Path:
        """The file that a mesh address names, inside the package's folders only."""
        if address.startswith("package://"):
            package, _, rest = address.removeprefix("package://").lstrip("/").partition("/")
            if package not in self.folders:
                raise InputError(f"{self.source}: {address}: package.folders does not name {package!r}")
            path = (self.folders[package] / rest).resolve()
        else:
            path = (base / address.removeprefix("file://")).resolve()
        if not any(path.is_relative_to(folder) for folder in self.folders.values()):
            raise InputError(f"{self.source}: {address}: leads out of the package's folders")
        if not path.is_file():
            raise InputError(f"{self.source}: {address}: there is no file {path}")
        return path

    def mesh_path(self, mesh: etree._Element) -> Path:
        """The file of a mesh element."""
        return self.resolve(mesh.get("filename", ""), self.urdf.parent)

    def _check_numbers(self) -> None:
        for element in self.root.iter(
            "mass", "inertia", "origin", "axis", "limit", "box", "sphere", "cylinder", "mesh"
        ):
            for key, value in element.attrib.items():
                if key == "filename":
                    continue
                try:
                    numbers = [float(v) for v in value.split()]
                except ValueError:
                    numbers = [math.nan]
                low = 0.0 if element.tag == "mass" else -math.inf
                if not all(math.isfinite(v) and v >= low for v in numbers):
                    raise InputError(f"{self.urdf}: {element.tag}.{key}: expected finite numbers, got {value!r}")

    def _check_names(self) -> None:
        package = self.package
        bodies = {
            "base_body": [self.base_body],
            "package.frames": [f.body for f in package.frames.values()],
            "package.one_hull": [b for group in package.one_hull for b in group],
            "package.ignored_pairs": [b for pair in package.ignored_pairs for b in pair],
        }
        for key, names in bodies.items():
            for name in names:
                if name not in self.links:
                    raise InputError(f"{self.source}: {key}: the model has no link {name!r}")
        for key, names in {"package.fixed": package.fixed, "nominal": self.nominal}.items():
            for name in names:
                if name not in self.joints:
                    raise InputError(f"{self.source}: {key}: the model has no joint {name!r}")

    def _weld_fixed_joints(self) -> None:
        for name, joint in self.joints.items():
            mimic = joint.find("mimic")
            if mimic is None and name not in self.package.fixed:
                continue
            X = _origin(joint) @ _turn(joint, self.package.fixed.get(name, 0.0))
            for tag in ("mimic", "axis", "limit", "dynamics", "safety_controller", "calibration", "origin"):
                for child in joint.findall(tag):
                    joint.remove(child)
            joint.set("type", "fixed")
            joint.insert(0, _origin_element(X))

    def _convert_collisions(self) -> None:
        from scenes.robots.meshes import hull_obj, points_of

        hulls: dict[str, list[np.ndarray]] = {}
        for name, link in self.links.items():
            owner, X_OL = self._hull_owner(name)
            for collision in link.findall("collision"):
                mesh = collision.find("geometry/mesh")
                if mesh is None:
                    continue
                link.remove(collision)
                points = points_of(self.mesh_path(mesh), _scale(mesh))
                X = X_OL @ _origin(collision)
                points = points @ X[:3, :3].T + X[:3, 3]
                if owner == name and not self._owns_group(name):
                    self._add_hull(name, hull_obj(points))
                else:
                    hulls.setdefault(owner, []).append(points)
        for owner, parts in hulls.items():
            self._add_hull(owner, hull_obj(np.concatenate(parts)))

    def _owns_group(self, name: str) -> bool:
        return any(group[0] == name for group in self.package.one_hull)

    def _hull_owner(self, name: str) -> tuple[str, np.ndarray]:
        """The link that carries this link's collision shape, and the pose (4, 4) of this link in it."""
        group = next((g for g in self.package.one_hull if name in g), [name])
        X = np.eye(4)
        while name != group[0]:
            joint = next((j for j in self.joints.values() if j.find("child").get("link") == name), None)
            if joint is None or joint.get("type") != "fixed":
                raise InputError(f"{self.source}: package.one_hull: {name} is not welded to {group[0]}")
            X = _origin(joint) @ X
            name = joint.find("parent").get("link")
        return group[0], X

    def _add_hull(self, link: str, text: str) -> None:
        count = sum(1 for f in self.files if f.startswith(f"{link}_hull"))
        name = f"{link}_hull{count}"
        self.files[f"{name}.obj"] = text
        collision = etree.SubElement(self.links[link], "collision", name=name)
        geometry = etree.SubElement(collision, "geometry")
        # Drake takes a mesh that declares itself convex as what it is, without making its hull again.
        etree.SubElement(etree.SubElement(geometry, "mesh", filename=f"{name}.obj"), f"{{{DRAKE}}}declare_convex")

    def _convert_visuals(self) -> None:
        from scenes.robots.meshes import visual_obj

        done: dict[tuple[Path, tuple[float, ...]], tuple[str, tuple[float, ...]]] = {}
        for visual in self.root.iter("visual"):
            mesh = visual.find("geometry/mesh")
            if mesh is None:
                continue
            path, scale = self.mesh_path(mesh), _scale(mesh)
            key = (path, tuple(scale))
            if key not in done:
                text, colour = visual_obj(path, scale)
                name = f"{path.stem}_{len(done)}.obj"
                self.files[name] = text
                done[key] = (name, colour)
            name, colour = done[key]
            mesh.attrib.clear()
            mesh.set("filename", name)
            if visual.find("material") is None:
                material = etree.SubElement(visual, "material", name=name.removesuffix(".obj"))
                etree.SubElement(material, "color", rgba=" ".join(f"{v:.3f}" for v in colour))

    def _add_frames(self) -> None:
        for name, frame in self.package.frames.items():
            if name in self.links:
                raise InputError(f"{self.source}: package.frames.{name}: the model has a link of that name")
            self.links[name] = etree.SubElement(self.root, "link", name=name)
            joint = etree.SubElement(self.root, "joint", name=f"{name}_mount", type="fixed")
            joint.append(_origin_element(_frame_pose(frame)))
            etree.SubElement(joint, "parent", link=frame.body)
            etree.SubElement(joint, "child", link=name)
            self.joints[f"{name}_mount"] = joint

    def _add_actuators(self) -> None:
        for name, joint in self.joints.items():
            if joint.get("type") not in MOVING:
                continue
            transmission = etree.SubElement(self.root, "transmission", name=f"{name}_transmission")
            etree.SubElement(transmission, "type").text = "transmission_interface/SimpleTransmission"
            etree.SubElement(transmission, "joint", name=name)
            actuator = etree.SubElement(transmission, "actuator", name=name)
            etree.SubElement(actuator, "mechanicalReduction").text = "1"

    def _filter_pairs(self, urdf: Path) -> None:
        pairs = {tuple(sorted(p)) for p in self.package.ignored_pairs} | touching_pairs(urdf, self.nominal, TOUCHING)
        for a, b in sorted(pairs):
            group = etree.SubElement(self.root, f"{{{DRAKE}}}collision_filter_group", name=f"{a}_{b}")
            etree.SubElement(group, f"{{{DRAKE}}}member", link=a)
            etree.SubElement(group, f"{{{DRAKE}}}member", link=b)
            etree.SubElement(group, f"{{{DRAKE}}}ignored_collision_filter_group", name=f"{a}_{b}")

    def _write_urdf(self, folder: Path) -> None:
        etree.indent(self.root)
        etree.ElementTree(self.root).write(folder / "model.urdf", xml_declaration=True, encoding="utf-8")


def touching_pairs(urdf: Path, nominal: Mapping[str, float], distance: float) -> set[tuple[str, str]]:
    """Names of bodies nearer to each other than `distance` [m] with the joints at `nominal` [rad] and else 0.

    Args:
        urdf: the model file.
        nominal: joint angles by name [rad]; other joints stand at 0.
        distance: bodies nearer than this are named [m].
    """
    from pydrake.multibody.parsing import Parser
    from pydrake.multibody.plant import AddMultibodyPlantSceneGraph
    from pydrake.systems.framework import DiagramBuilder

    builder = DiagramBuilder()
    plant, scene_graph = AddMultibodyPlantSceneGraph(builder, time_step=0.0)
    Parser(plant).AddModels(urdf)
    plant.Finalize()
    diagram = builder.Build()
    context = diagram.CreateDefaultContext()
    plant_context = plant.GetMyContextFromRoot(context)
    for joint, angle in nominal.items():
        plant.GetJointByName(joint).set_angle(plant_context, angle)
    inspector = scene_graph.model_inspector()
    query = plant.get_geometry_query_input_port().Eval(plant_context)
    pairs = set()
    for pair in query.ComputeSignedDistancePairwiseClosestPoints(distance):
        frames = (inspector.GetFrameId(g) for g in (pair.id_A, pair.id_B))
        pairs.add(tuple(sorted(plant.GetBodyFromFrameId(f).name() for f in frames)))
    return pairs


def _numbers(text: str | None, default: str) -> np.ndarray:
    return np.array([float(v) for v in (text or default).split()])


def _scale(mesh: etree._Element) -> np.ndarray:
    return _numbers(mesh.get("scale"), "1 1 1") * np.ones(3)


def _pose(xyz: np.ndarray, rpy: np.ndarray) -> np.ndarray:
    (sr, sp, sy), (cr, cp, cy) = np.sin(rpy), np.cos(rpy)
    X = np.eye(4)
    X[:3, :3] = [
        [cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr],
        [sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr],
        [-sp, cp * sr, cp * cr],
    ]
    X[:3, 3] = xyz
    return X


def _frame_pose(frame: FrameEntry) -> np.ndarray:
    return _pose(np.array(frame.xyz), np.array(frame.rpy))


def _origin(element: etree._Element) -> np.ndarray:
    origin = element.find("origin")
    if origin is None:
        return np.eye(4)
    return _pose(_numbers(origin.get("xyz"), "0 0 0"), _numbers(origin.get("rpy"), "0 0 0"))


def _origin_element(X: np.ndarray) -> etree._Element:
    R = X[:3, :3]
    rpy = (np.arctan2(R[2, 1], R[2, 2]), np.arctan2(-R[2, 0], np.hypot(R[0, 0], R[1, 0])), np.arctan2(R[1, 0], R[0, 0]))
    text = {k: " ".join(f"{v:.9f}" for v in values) for k, values in {"xyz": X[:3, 3], "rpy": rpy}.items()}
    return etree.Element("origin", **text)


def _turn(joint: etree._Element, angle: float) -> np.ndarray:
    """(4, 4) displacement of a joint at this angle [rad] (or length [m])."""
    axis = _numbers(joint.find("axis").get("xyz") if joint.find("axis") is not None else None, "1 0 0")
    axis = axis / np.linalg.norm(axis)
    X = np.eye(4)
    if joint.get("type") == "prismatic":
        X[:3, 3] = axis * angle
        return X
    K = np.array([[0, -axis[2], axis[1]], [axis[2], 0, -axis[0]], [-axis[1], axis[0], 0]])
    X[:3, :3] = np.eye(3) + np.sin(angle) * K + (1 - np.cos(angle)) * K @ K
    return X
