"""Makes any robot model into a URDF that Drake's Parser loads alone.

Drake takes no STL or DAE collision meshes, no package:// without a map, actuators only from transmissions, and
filters no pairs that touch by design. The adapted model lies in the user's cache, next to its meshes, in a folder
named after the content that it was made from; it appears there whole or not at all.
"""

from __future__ import annotations

import contextlib
import copy
import hashlib
import importlib.metadata
import math
import os
import re
import shutil
import tempfile
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
from lxml import etree  # type: ignore[attr-defined]

from scenes.files.cache_folder import cache_folder
from scenes.input_error import InputError
from scenes.robots.addresses import Addresses
from scenes.robots.base_link import stand_on
from scenes.robots.materials import settle_materials
from scenes.robots.schema import FrameEntry, ModelChanges, PackageEntry
from scenes.robots.touching_pairs import touching_pairs
from scenes.robots.urdf_file import read_urdf
from scenes.robots.urdf_pose import numbers, origin, origin_element, pose, turn

ADAPTER_VERSION = 3  # part of the cache's key: raise it when the same input shall give another model
TOUCHING = 0.005  # [m] bodies nearer than this in the nominal posture are taken to touch by design
DRAKE = "http://drake.mit.edu"
WIDEST = {"revolute": math.pi, "continuous": math.pi, "prismatic": 1.0}  # [rad, m] of joints that name no limits
FASTEST = {"revolute": 10.0, "continuous": 10.0, "prismatic": 2.0}  # [rad/s, m/s] of joints that name no speed
GROUP = f"{{{DRAKE}}}collision_filter_group"
KEPT = ("link", "joint", "material", GROUP)  # what a URDF needs for planning; sensors, plugins and comments go
MOVING = ("revolute", "continuous", "prismatic")
TRIPLES = ("xyz", "rpy", "size", "scale")  # attributes of three numbers


@dataclass(frozen=True)
class ModelSource:
    """A model file and what is to be made of it.

    Attributes:
        file: URDF, SDF or MJCF.
        addresses: where its meshes lie; `addresses.source` is the robot file, for errors.
        changes: frames, welds and collision pairs that the robot file adds.
        slots: further frames to add, by name: those of end effectors that the model has under another name, or lacks.
        key: the robot file's key that holds the changes, for errors.
        lacking: slots of palms that the robot does not have; their frames sit on its torso.
    """

    file: Path
    addresses: Addresses
    changes: ModelChanges
    slots: Mapping[str, FrameEntry] = field(default_factory=dict)
    key: str = "changes"
    lacking: frozenset[str] = frozenset()


def package_source(package: PackageEntry, *, source: str, packages: Mapping[str, Path] | None = None) -> ModelSource:
    """The model of an installed package.

    Args:
        package: where its model is and what to change.
        source: the robot file, for errors.
        packages: folders of package:// addresses that the user gave.

    Raises:
        InputError: the package is not installed, or has no such file.
    """
    folders = {**_folders(package, source), **(packages or {})}
    addresses = Addresses(source, folders, confined=True)
    return ModelSource(addresses.resolve(package.urdf, Path("/")), addresses, package, key="package")


def adapted_model(
    name: str, package: PackageEntry | ModelSource, base_body: str, nominal: Mapping[str, float], *, source: str
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
    origin = package_source(package, source=source) if isinstance(package, PackageEntry) else package
    if origin.file.suffix.lower() == ".urdf":
        return _adapted(name, origin, base_body, nominal)
    from scenes.robots.drake_to_urdf import urdf_from_drake

    with tempfile.TemporaryDirectory(prefix="drakeplan-model-") as scratch, _errors_as_of(origin.file, Path(scratch)):
        urdf = urdf_from_drake(origin.file, origin.addresses, Path(scratch))
        addresses = Addresses(origin.addresses.source)
        return _adapted(name, replace(origin, file=urdf, addresses=addresses), base_body, nominal)


@contextlib.contextmanager
def _errors_as_of(model: Path, folder: Path) -> Iterator[None]:
    """Inside, errors name the user's model where they named a file of a temporary folder, whose lines nobody can see."""
    try:
        yield
    except InputError as error:
        text = re.sub(rf"{re.escape(str(folder))}/[^\s:'()]+", str(model), str(error))
        raise InputError(re.sub(r"\(\d+: error: ", "(", text) if text != str(error) else text) from None


def _adapted(name: str, origin: ModelSource, base_body: str, nominal: Mapping[str, float]) -> Path:
    model = _Model(name, origin, base_body, dict(nominal))
    root = cache_folder("robots")
    final = root / f"{name}-{model.content_hash()}"
    if not (final / "model.urdf").is_file():
        scratch = Path(tempfile.mkdtemp(prefix=f".{name}-", dir=root))
        try:
            with _errors_as_of(origin.file, scratch):
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
    except (importlib.metadata.PackageNotFoundError, ValueError):  # the latter for no name at all
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
    origin: ModelSource
    base_body: str
    nominal: dict[str, float]
    files: dict[str, str] = field(default_factory=dict)

    def __post_init__(self) -> None:
        self.source, self.changes, self.urdf = self.origin.addresses.source, self.origin.changes, self.origin.file
        tree = read_urdf(self.urdf)
        self.root = etree.Element("robot", nsmap={"drake": DRAKE}, name=self.name)
        self.root.extend([e for e in tree if e.tag in KEPT])
        self.links = {e.get("name"): e for e in self.root.findall("link")}
        self.joints = {e.get("name"): e for e in self.root.findall("joint")}
        self._check_numbers()
        self._check_names()

    def content_hash(self) -> str:
        """Sixteen hexadecimal digits over everything that the result depends on."""
        digest = hashlib.sha256(
            f"{ADAPTER_VERSION} {self.name} {self.base_body} {sorted(self.nominal.items())}".encode()
        )
        digest.update(self.changes.model_dump_json().encode())
        digest.update(repr(sorted((k, f.model_dump_json()) for k, f in self.origin.slots.items())).encode())
        for path in [self.urdf, *sorted({self.mesh_path(m) for m in self.root.iter("mesh")})]:
            digest.update(path.name.encode() + path.read_bytes())
        return digest.hexdigest()[:16]

    def write(self, folder: Path) -> None:
        """Everything into a folder: model.urdf and its meshes."""
        settle_materials(self.root)
        self._weld_fixed_joints()
        if self.base_body in self.changes.frames:  # the robot faces along another axis than its model's root
            self._add_frame(self.base_body, self.changes.frames[self.base_body])
        stand_on(self.base_body, self.root, self.source)
        self.links = {e.get("name"): e for e in self.root.findall("link")}
        self.joints = {e.get("name"): e for e in self.root.findall("joint")}
        self._limit_joints()
        self._collide_as_drawn()
        self._convert_collisions()
        self._convert_visuals()
        self._free_names()
        self._add_frames()
        self._add_actuators()
        for name, text in self.files.items():
            (folder / name).write_text(text, encoding="utf-8")
        self._write_urdf(folder)
        self._filter_pairs(folder / "model.urdf")
        self._write_urdf(folder)

    def mesh_path(self, mesh: etree._Element) -> Path:
        """The file of a mesh element."""
        return self.origin.addresses.resolve(mesh.get("filename", ""), self.urdf.parent)

    def _check_numbers(self) -> None:
        for element in self.root.iter(
            "mass", "inertia", "origin", "axis", "limit", "box", "sphere", "cylinder", "mesh"
        ):
            if element.tag == "mass" and element.get("value") is None:
                raise InputError(f"{self.urdf}: mass.value: expected a number of kilograms")
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
                if key in TRIPLES and len(numbers) != 3 and not (key == "scale" and len(numbers) == 1):
                    raise InputError(f"{self.urdf}: {element.tag}.{key}: expected three numbers, got {value!r}")

    def _check_names(self) -> None:
        changes, key = self.changes, self.origin.key
        bodies = {
            "base_body": [self.base_body],
            f"{key}.frames": [f.body for f in changes.frames.values()],
            f"{key}.collide_as_drawn": changes.collide_as_drawn,
            f"{key}.one_hull": [b for group in changes.one_hull for b in group],
            f"{key}.ignored_pairs": [b for pair in changes.ignored_pairs for b in pair],
        }
        for slot, frame in self.origin.slots.items():
            bodies["torso_body" if slot in self.origin.lacking else f"effectors.{slot}.frame"] = [frame.body]
        for where, names in bodies.items():
            for name in names:
                if name not in self.links and not (where == "base_body" and name in changes.frames):
                    raise InputError(f"{self.source}: {where}: the model has no link {name!r}")
        for where, names in {f"{key}.fixed": changes.fixed, "nominal": self.nominal}.items():
            for name in names:
                if name not in self.joints:
                    raise InputError(f"{self.source}: {where}: the model has no joint {name!r}")
        for name in self.nominal:
            joint = self.joints[name]
            if joint.get("type") not in MOVING or joint.find("mimic") is not None or name in changes.fixed:
                raise InputError(f"{self.source}: nominal.{name}: the joint does not move in the model")

    def _weld_fixed_joints(self) -> None:
        for name, joint in self.joints.items():
            mimic = joint.find("mimic")
            if mimic is None and name not in self.changes.fixed:
                continue
            if joint.get("type") not in (*MOVING, "fixed"):
                raise InputError(f"{self.source}: {self.origin.key}.fixed: joint {name!r} is {joint.get('type')}")
            X = origin(joint) @ turn(joint, self.changes.fixed.get(name, 0.0))
            for tag in ("mimic", "axis", "limit", "dynamics", "safety_controller", "calibration", "origin"):
                for child in joint.findall(tag):
                    joint.remove(child)
            joint.set("type", "fixed")
            joint.insert(0, origin_element(X))

    def _limit_joints(self) -> None:
        """Joints without limits turn once around at most; postures are looked for between limits."""
        for name, joint in self.joints.items():
            kind = joint.get("type")
            if kind not in (*MOVING, "fixed"):
                raise InputError(
                    f"{self.urdf}: joint {name!r} is {kind}, expected revolute, continuous, prismatic or fixed"
                )
            if kind == "fixed":
                continue
            limit = joint.find("limit")
            if limit is None:
                limit = etree.SubElement(joint, "limit")
            if kind == "continuous":
                joint.set("type", "revolute")
                limit.set("lower", repr(-math.pi))
                limit.set("upper", repr(math.pi))
            for dynamics in joint.findall("dynamics"):
                dynamics.attrib.pop("friction", None)  # Drake has none in joints, and says so at every load
            for key, value in (("lower", -WIDEST[kind]), ("upper", WIDEST[kind]), ("velocity", FASTEST[kind])):
                if limit.get(key) is None:
                    limit.set(key, repr(value))

    def _collide_as_drawn(self) -> None:
        for name in self.changes.collide_as_drawn:
            for visual in self.links[name].findall("visual"):
                collision = etree.SubElement(self.links[name], "collision")
                collision.extend([copy.deepcopy(e) for e in visual if e.tag in ("origin", "geometry")])

    def _convert_collisions(self) -> None:
        from scenes.robots.meshes import points_of, points_of_solid

        hulls: dict[str, list[np.ndarray]] = {}
        for name, link in self.links.items():
            owner, X_OL = self._hull_owner(name)
            for collision in link.findall("collision"):
                mesh = collision.find("geometry/mesh")
                grouped = owner != name or self._owns_group(name)
                if mesh is None and not grouped:
                    continue
                link.remove(collision)
                if mesh is None:
                    points = points_of_solid(collision.find("geometry"))
                else:
                    points = points_of(self.mesh_path(mesh), _scale(mesh))
                X = X_OL @ origin(collision)
                points = points @ X[:3, :3].T + X[:3, 3]
                if not grouped:
                    self._add_hull(name, points)
                else:
                    hulls.setdefault(owner, []).append(points)
        for owner, parts in hulls.items():
            self._add_hull(owner, np.concatenate(parts))

    def _owns_group(self, name: str) -> bool:
        return any(group[0] == name for group in self.changes.one_hull)

    def _hull_owner(self, name: str) -> tuple[str, np.ndarray]:
        """The link that carries this link's collision shape, and the pose (4, 4) of this link in it."""
        group = next((g for g in self.changes.one_hull if name in g), [name])
        X = np.eye(4)
        while name != group[0]:
            joint = next((j for j in self.joints.values() if j.find("child").get("link") == name), None)
            if joint is None or joint.get("type") != "fixed":
                raise InputError(f"{self.source}: package.one_hull: {name} is not welded to {group[0]}")
            X = origin(joint) @ X
            name = joint.find("parent").get("link")
        return group[0], X

    def _add_hull(self, link: str, points: np.ndarray) -> None:
        from scipy.spatial import QhullError

        from scenes.robots.meshes import hull_obj

        try:
            text = hull_obj(points)
        except QhullError:
            raise InputError(
                f"{self.urdf}: link {link!r}: its collision mesh is a point or a line, expected a body"
            ) from None
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

    def _free_names(self) -> None:
        """A link that is called as an end effector, but is not its contact frame, gets another name."""
        renamed = {}
        for name in self.origin.slots:
            if name in self.links and name not in self.origin.lacking:
                renamed[name] = next(n for k in range(9) if (n := f"{name}_link{'_' * k}") not in self.links)
        if not renamed:
            return
        for old, new in renamed.items():
            self.links[old].set("name", new)
            self.links[new] = self.links.pop(old)
        for end in self.root.iter("parent", "child"):
            end.set("link", renamed.get(end.get("link", ""), end.get("link", "")))
        for member in self.root.iterfind(f"{GROUP}/{{{DRAKE}}}member"):
            member.set("link", renamed.get(member.get("link", ""), member.get("link", "")))
        frames = (self.changes.frames, self.origin.slots)
        moved = [{n: f.model_copy(update={"body": renamed.get(f.body, f.body)}) for n, f in g.items()} for g in frames]
        pairs = [(renamed.get(a, a), renamed.get(b, b)) for a, b in self.changes.ignored_pairs]
        self.changes = self.changes.model_copy(update={"frames": moved[0], "ignored_pairs": pairs})
        self.origin = replace(self.origin, slots=moved[1])

    def _add_frames(self) -> None:
        for name, frame in {**self.changes.frames, **self.origin.slots}.items():
            if name == self.base_body and name in self.changes.frames:
                continue  # it became the root
            if name in self.links:
                if name in self.origin.lacking:  # the model has a palm that the robot file does not use
                    continue
                where = f"effectors.{name}" if name in self.origin.slots else f"{self.origin.key}.frames.{name}"
                raise InputError(f"{self.source}: {where}: the model has a link of that name")
            self._add_frame(name, frame)

    def _add_frame(self, name: str, frame: FrameEntry) -> None:
        self.links[name] = etree.SubElement(self.root, "link", name=name)
        mount = next(n for k in range(9) if (n := f"{name}_mount{'_' * k}") not in self.joints)
        joint = etree.SubElement(self.root, "joint", name=mount, type="fixed")
        joint.append(origin_element(_frame_pose(frame)))
        etree.SubElement(joint, "parent", link=frame.body)
        etree.SubElement(joint, "child", link=name)
        self.joints[mount] = joint

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
        pairs = {tuple(sorted(p)) for p in self.changes.ignored_pairs} | touching_pairs(urdf, self.nominal, TOUCHING)
        for a, b in sorted(pairs):
            group = etree.SubElement(self.root, GROUP, name=f"{a}_{b}")
            etree.SubElement(group, f"{{{DRAKE}}}member", link=a)
            etree.SubElement(group, f"{{{DRAKE}}}member", link=b)
            etree.SubElement(group, f"{{{DRAKE}}}ignored_collision_filter_group", name=f"{a}_{b}")

    def _write_urdf(self, folder: Path) -> None:
        etree.indent(self.root)
        etree.ElementTree(self.root).write(folder / "model.urdf", xml_declaration=True, encoding="utf-8")


def _scale(mesh: etree._Element) -> np.ndarray:
    return numbers(mesh.get("scale"), "1 1 1") * np.ones(3)


def _frame_pose(frame: FrameEntry) -> np.ndarray:
    return pose(np.array(frame.xyz), np.array(frame.rpy))
