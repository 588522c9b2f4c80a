"""Robot files and models that are nearly right, in all formats, and the way a user's robot takes: loaded, adapted, stood up."""

from __future__ import annotations

import os
import shutil
from pathlib import Path
from random import Random

import numpy as np
import yaml
from lxml import etree  # type: ignore[attr-defined]
from mesh_mutants import box, bytes_of, changed_mesh, stl_bytes, with_changed_word
from mutation import NUMBERS, TEXTS, Twice, changed_name, mutate_bytes, mutate_tree, nudged, odd_value, to_document

from scenes.robots.nominal_stance import check_nominal_stance
from scenes.robots.plant import build_plant, nominal_posture
from scenes.robots.robot import load_robot, robot_path

SECONDS = 5.0
CACHE = "FUZZ_CACHE"  # folder of adapted models that is the fuzzer's own, and is emptied after each input
SIDES = (("left", 0.1), ("right", -0.1))
JOINTS = (("hip", "pelvis", "thigh", -0.15), ("knee", "thigh", "shank", -0.4), ("ankle", "shank", "foot_body", -0.4))
BODIES = (
    ("thigh", 3.0, (0.06, 0.06, 0.3), -0.2),
    ("shank", 2.0, (0.06, 0.06, 0.3), -0.2),
    ("foot_body", 1.0, (0.2, 0.1, 0.02), -0.04),
)
INERTIA = '<inertia ixx="0.1" iyy="0.1" izz="0.1" ixy="0" ixz="0" iyz="0"/>'
SDF_INERTIA = "<inertia><ixx>0.1</ixx><iyy>0.1</iyy><izz>0.1</izz></inertia>"


def robot_entry(model: str) -> dict[str, object]:
    """A robot file of a trunk on two legs, whose feet are given by frames."""
    effectors = {
        f"{side}_foot": {"frame": f"{side}_sole", "half_extent": [0.1, 0.05], "force_limit": 2.0, "com_reach": 1.0}
        for side, _ in SIDES
    }
    frames = {
        f"{side}_sole": {"body": f"{side}_foot_body", "xyz": [0.0, 0.0, -0.05], "rpy": [0.0, 0.0, 0.0]}
        for side, _ in SIDES
    }
    return {
        "format": "drakeplan-robot", "version": 1, "name": "walker", "model": model,
        "changes": {"frames": frames, "fixed": {}, "one_hull": [], "ignored_pairs": [["left_thigh", "right_thigh"]]},
        "base_body": "pelvis", "torso_body": "pelvis", "effectors": effectors,
        "nominal": {"left_hip": -0.2, "left_knee": 0.4, "left_ankle": -0.2, "right_hip": -0.2, "right_knee": 0.4, "right_ankle": -0.2},
        "hip": [0.0, 0.1, 0.85], "leg_reach": [0.3, 0.85], "com_height": [0.4, 0.8, 1.0],
        "torso_box": {"centre": [0.0, 0.0, 1.0], "size": [0.2, 0.3, 0.3]}, "max_foot_translation": 0.5, "max_step_height": 0.3,
        "foot_separation": [0.15, 0.2],
    }  # fmt: skip


def urdf(mesh: bool = False) -> str:
    parts = [_urdf_link("pelvis", 20.0, '<mesh filename="pelvis.stl"/>' if mesh else '<box size="0.2 0.3 0.2"/>', 0.0)]
    for side, y in SIDES:
        parts += [
            _urdf_link(f"{side}_{n}", m, f'<box size="{" ".join(map(str, size))}"/>', z) for n, m, size, z in BODIES
        ]
        for name, parent, child, z in JOINTS:
            above = parent if parent == "pelvis" else f"{side}_{parent}"
            parts.append(
                f'<joint name="{side}_{name}" type="revolute"><parent link="{above}"/><child link="{side}_{child}"/>'
                f'<origin xyz="0 {y if above == "pelvis" else 0} {z}" rpy="0 0 0"/><axis xyz="0 1 0"/>'
                '<limit lower="-1.5" upper="1.5" effort="100" velocity="8"/></joint>'
            )
    return f'<robot name="walker">{"".join(parts)}</robot>'


def _urdf_link(name: str, mass: float, shape: str, z: float) -> str:
    placed = f'<origin xyz="0 0 {z}" rpy="0 0 0"/><geometry>{shape}</geometry>'
    return (
        f'<link name="{name}"><inertial><origin xyz="0 0 {z}"/><mass value="{mass}"/>{INERTIA}</inertial>'
        f"<visual>{placed}</visual><collision>{placed}</collision></link>"
    )


def sdf() -> str:
    parts = [_sdf_link("pelvis", 20.0, "<mesh><uri>pelvis.stl</uri><scale>1 1 1</scale></mesh>", (0, 0, 0.95), 0.0)]
    for side, y in SIDES:
        z = 0.95
        for (name, parent, child, dz), (body, mass, size, low) in zip(JOINTS, BODIES, strict=True):
            z += dz
            shape = f"<box><size>{size[0]} {size[1]} {size[2]}</size></box>"
            parts.append(_sdf_link(f"{side}_{body}", mass, shape, (0, y, z), low))
            above = parent if parent == "pelvis" else f"{side}_{parent}"
            parts.append(
                f'<joint name="{side}_{name}" type="revolute"><parent>{above}</parent><child>{side}_{child}</child>'
                "<axis><xyz>0 1 0</xyz><limit><lower>-1.5</lower><upper>1.5</upper>"
                "<effort>100</effort><velocity>8</velocity></limit></axis></joint>"
            )
    return f'<?xml version="1.0"?><sdf version="1.7"><model name="walker">{"".join(parts)}</model></sdf>'


def _sdf_link(name: str, mass: float, shape: str, place: tuple[float, ...], z: float) -> str:
    return (
        f'<link name="{name}"><pose>{place[0]} {place[1]} {place[2]} 0 0 0</pose><inertial><mass>{mass}</mass>{SDF_INERTIA}</inertial>'
        f'<collision name="c"><pose>0 0 {z} 0 0 0</pose><geometry>{shape}</geometry></collision></link>'
    )


def mjcf() -> str:
    legs = ""
    for side, y in SIDES:
        opened = ""
        for (name, parent, child, z), (_, mass, size, low) in zip(JOINTS, BODIES, strict=True):
            half = " ".join(str(v / 2) for v in size)
            opened += (
                f'<body name="{side}_{child}" pos="0 {y if parent == "pelvis" else 0} {z}">'
                f'<joint name="{side}_{name}" type="hinge" axis="0 1 0" range="-1.5 1.5"/>'
                f'<geom type="box" size="{half}" pos="0 0 {low}" mass="{mass}"/>'
            )
        legs += opened + "</body>" * len(JOINTS)
    motors = "".join(f'<motor joint="{side}_{name}"/>' for side, _ in SIDES for name, *_ in JOINTS)
    return (
        '<mujoco model="walker"><compiler angle="radian"/><asset><mesh name="trunk" file="pelvis.stl"/></asset><worldbody>'
        '<body name="pelvis" pos="0 0 0.95"><freejoint/><geom type="mesh" mesh="trunk" mass="20"/>'
        f"{legs}</body></worldbody><actuator>{motors}</actuator></mujoco>"
    )


MODELS = {"walker.urdf": urdf(), "meshes.urdf": urdf(mesh=True), "walker.sdf": sdf(), "walker.xml": mjcf()}
GOOD = ("escher.urdf", *MODELS)


def good_robot(name: str) -> tuple[dict[str, object], str]:
    """The robot file and the model of one of `GOOD`."""
    if name != "escher.urdf":
        return robot_entry(name), MODELS[name]
    path = robot_path("escher")
    return yaml.safe_load(path.read_text(encoding="utf-8")), path.with_suffix(".urdf").read_text(encoding="utf-8")


def write_robot(name: str, folder: Path) -> Path:
    """Writes one of `GOOD` with its model and mesh; returns the robot file."""
    entry, model = good_robot(name)
    return _written(
        folder, name, to_document(entry).encode(), model.encode(), stl_bytes(box((-0.1, -0.15, -0.1), (0.1, 0.15, 0.1)))
    )


def _written(folder: Path, name: str, entry: bytes, model: bytes, mesh: bytes | None) -> Path:
    (folder / name).write_bytes(model)
    if mesh is not None:
        (folder / "pelvis.stl").write_bytes(mesh)
    path = folder / "robot.yaml"
    path.write_bytes(entry)
    return path


def make(rng: Random, folder: Path) -> Path:
    """Writes one robot that is nearly right and returns its robot file."""
    name = rng.choice(GOOD)
    tree, model_text = good_robot(name)
    entry, model = to_document(tree).encode(), model_text.encode()
    mesh: bytes | None = stl_bytes(box((-0.1, -0.15, -0.1), (0.1, 0.15, 0.1)))
    what = rng.randrange(10)
    if what <= 3:
        entry = to_document(mutate_tree(rng, tree, OWN)).encode("utf-8", "surrogatepass")
    elif what <= 7:
        model = changed_xml(rng, model)
    elif what == 8:
        entry, model = rng.choice(((mutate_bytes(rng, entry), model), (entry, mutate_bytes(rng, model))))
    else:
        shape = changed_mesh(rng, box((-0.1, -0.15, -0.1), (0.1, 0.15, 0.1)))
        right = shape[1].min(initial=0) >= 0 and shape[1].max(initial=0) < len(shape[0])
        data = stl_bytes(shape) if right else bytes_of(shape, "ascii.stl") if len(shape[0]) else b""
        mesh = rng.choice((None, data, data, with_changed_word(rng, data), mutate_bytes(rng, data)))
    return _written(folder, name, entry, model, mesh)


def changed_xml(rng: Random, data: bytes) -> bytes:
    """A model with one to three elements or attributes changed, or with an entity."""
    root = etree.fromstring(data)
    for _ in range(rng.choice((1, 1, 2, 3))):
        elements = list(root.iter("*"))
        element = rng.choice(elements)
        kind = rng.randrange(12)
        if kind <= 4 and element.attrib:
            key = rng.choice(sorted(element.attrib))
            _set(element, key, _odd_words(rng, element.get(key), elements))
        elif kind <= 4:
            element.text = _printable(_odd_words(rng, element.text or "", elements))
        elif kind == 5 and element.attrib:
            del element.attrib[rng.choice(sorted(element.attrib))]
        elif kind == 6 and element is not root:
            element.getparent().remove(element)
        elif kind == 7 and element is not root:
            element.addnext(etree.fromstring(etree.tostring(element)))
        elif kind == 8:
            rng.choice(elements).append(etree.fromstring(etree.tostring(element)))
        elif kind == 9:
            element.tag = rng.choice(
                (
                    "link",
                    "joint",
                    "mesh",
                    "sphere",
                    "plane",
                    "cylinder",
                    "xacro",
                    "include",
                    "frame",
                    "body",
                    "geom",
                    "mimic",
                )
            )
        elif kind == 10:
            _set(
                element,
                rng.choice(("type", "scale", "name", "filename", "mass", "friction", "pos", "euler")),
                _odd_words(rng, "1", elements),
            )
        elif kind == 11 and element.attrib:
            key = rng.choice(sorted(element.attrib))
            value = element.attrib.pop(key)
            _set(element, "x" + "".join(c for c in changed_name(rng, key) if c.isalnum())[:50], value)
    text = etree.tostring(root)
    if rng.random() < 0.05:
        bomb = b'<!DOCTYPE r [<!ENTITY a "1111111111"><!ENTITY b "&a;&a;&a;&a;&a;&a;&a;&a;&a;"><!ENTITY f SYSTEM "/etc/passwd">]>'
        return bomb + text.replace(b'="0', rng.choice((b'="&b;', b'="&a;', b'="')), 1).replace(
            b"><", rng.choice((b">&f;<", b">&b;<")), 1
        )
    return text


def _odd_words(rng: Random, words: str, elements: list) -> str:
    """Another value in place of one in a model: numbers one by one, names for names."""
    parts = words.split()
    try:
        numbers = [float(part) for part in parts]
    except ValueError:
        numbers = []
    if numbers and rng.random() < 0.8:
        k = rng.randrange(len(numbers))
        odd = nudged(rng, numbers[k]) if rng.random() < 0.5 and abs(numbers[k]) < 1e300 else rng.choice(NUMBERS)
        parts[k] = str(odd)
        return " ".join(parts)
    names = [e.get("name") for e in elements if e.get("name")] + [
        "world",
        "revolute",
        "continuous",
        "prismatic",
        "floating",
        "planar",
        "fixed",
        "ball",
    ]
    return rng.choice(
        (rng.choice(names), rng.choice(names), rng.choice(TEXTS), changed_name(rng, words), words + " 1", "")
    )


def _set(element: etree._Element, key: str, value: str) -> None:
    element.set(key, _printable(value))


def _printable(text: str) -> str:
    return "".join(c for c in text if c.isprintable() or c in "\n\t")


def _exchanged(rng: Random, tree: dict) -> None:
    effectors = tree["effectors"]
    effectors["left_foot"], effectors["right_foot"] = effectors["right_foot"], effectors["left_foot"]


def _turned_frame(rng: Random, tree: dict) -> None:
    rng.choice(list(tree["changes"]["frames"].values()))["rpy"][rng.randrange(3)] = rng.choice(
        (3.14159, 1.5708, 0.4, 1e-9, 1e5, 1e300)
    )


def _moved_frame(rng: Random, tree: dict) -> None:
    rng.choice(list(tree["changes"]["frames"].values()))["xyz"][rng.randrange(3)] += rng.choice(
        (-1, 1)
    ) * 10 ** rng.uniform(-4, 6)


def _other_body(rng: Random, tree: dict) -> None:
    body = rng.choice(("pelvis", "left_thigh", "left_foot_body", "right_sole", "world", "nobody", ""))
    key = rng.choice(("base_body", "torso_body"))
    tree[key] = body


def _fixed_joint(rng: Random, tree: dict) -> None:
    tree["changes"]["fixed"][rng.choice(("left_knee", "right_hip", "nobody"))] = rng.choice((0.0, 0.4, 1e9, -3.0))


def _one_hull(rng: Random, tree: dict) -> None:
    tree["changes"]["one_hull"].append(
        rng.choice((["pelvis", "left_thigh"], ["pelvis"], [], ["nobody"], ["left_foot_body", "left_foot_body"]))
    )


def _name(rng: Random, tree: dict) -> None:
    tree["name"] = rng.choice((*TEXTS, "../walker", "a/b", "a\\b", ".", "-rf", "con", "w" * 250, "ü"))


def _model(rng: Random, tree: dict) -> None:
    tree["model"] = rng.choice(
        (
            *TEXTS,
            "robot.yaml",
            "pelvis.stl",
            "../walker.urdf",
            "./walker.urdf",
            "walker.URDF",
            "/dev/null",
            "/dev/zero",
            ".",
        )
    )


def _package(rng: Random, tree: dict) -> None:
    tree.pop("changes", None)
    tree.pop("model", None)
    distribution = rng.choice(("numpy", "nobody", "", "../x", "hpp-environments", "a b"))
    folder = rng.choice(("numpy", "..", "", "/", "nobody"))
    tree["package"] = {
        "distribution": distribution,
        "folders": {"n": folder},
        "urdf": rng.choice(("package://n/x.urdf", "package://m/x", "x.urdf", "")),
    }


def _nominal(rng: Random, tree: dict) -> None:
    tree["nominal"][rng.choice(("left_knee", "left_hip", "nobody", "pelvis"))] = rng.choice(
        (0.0, 1.4, 1.6, -3.0, 1e9, odd_value(rng))
    )


def _repeated(rng: Random, tree: dict) -> None:
    key = rng.choice(sorted(tree))
    tree[key] = Twice(tree[key])


OWN = (
    _exchanged,
    _turned_frame,
    _moved_frame,
    _other_body,
    _fixed_joint,
    _one_hull,
    _name,
    _model,
    _package,
    _nominal,
    _repeated,
)


def read(path: Path) -> None:
    """Loads a robot as `plan --robot FILE` does.

    Raises:
        InputError: the robot is not right.
        AssertionError: what was read is not sound, or something half-written is left in the cache.
    """
    cache = Path(os.environ[CACHE]) / "drakeplan" / "robots" if CACHE in os.environ else None
    try:
        robot = load_robot(path)
        build_plant(robot)
        assert np.isfinite(nominal_posture(robot)).all()
        check_nominal_stance(robot)
    finally:
        if cache is not None and cache.is_dir():
            broken = [entry.name for entry in cache.iterdir() if not (entry / "model.urdf").is_file()]
            shutil.rmtree(cache)
            assert not broken, f"left in the cache: {broken}"
