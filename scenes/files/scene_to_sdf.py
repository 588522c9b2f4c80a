"""A scene's terrain as an SDF file: one static model, a collision and a visual for each convex solid."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from pathlib import Path

import numpy as np

from scenes.files.scene_solids import Solid, hull_faces, solids_of
from scenes.files.whole_file import require_writable, write_whole
from scenes.input_error import InputError
from scenes.pose import rotation_rpy
from scenes.scene import Scene

VERSION = "1.7"
DRAKE = "http://drake.mit.edu"
GREY = "0.6 0.6 0.58 1"


def scene_to_sdf(scene: Scene, path: str | Path) -> tuple[str, dict[str, str]]:
    """The text of an SDF file, and the OBJ files of the solids that are no boxes, by their path from it.

    Args:
        scene: whose terrain is written; start, goal and disturbances are not.
        path: of the SDF file; the OBJ files go to a folder of its name beside it.

    Raises:
        InputError: it is made of too many solids.
    """
    ET.register_namespace("drake", DRAKE)
    root = ET.Element("sdf", version=VERSION)
    if scene.origin_offset is not None:
        root.append(ET.Comment(f" origin_offset {' '.join(f'{x:.12g}' for x in scene.origin_offset)} was subtracted "))
    model = ET.SubElement(root, "model", name=_name(scene.name) or "terrain")
    ET.SubElement(model, "static").text = "true"
    link = ET.SubElement(model, "link", name="terrain")
    folder, files = f"{Path(path).stem}_meshes", {}
    for number, solid in enumerate(solids_of(scene.terrain)):
        name = f"{number} {_name(solid.name)}"
        pose, mesh = "0 0 0 0 0 0", ""
        if solid.box is not None:
            X_WO = solid.box[1]
            pose = _text(np.concatenate([X_WO[:3, 3], rotation_rpy(X_WO[:3, :3])]))
        else:
            mesh = f"{folder}/{number}.obj"
            files[mesh] = _obj(solid)
        for kind in ("collision", "visual"):
            element = ET.SubElement(link, kind, name=name)
            ET.SubElement(element, "pose").text = pose
            shape = ET.SubElement(element, "geometry")
            if solid.box is not None:
                ET.SubElement(ET.SubElement(shape, "box"), "size").text = _text(solid.box[0])
            else:
                body = ET.SubElement(shape, "mesh")
                ET.SubElement(body, "uri").text = mesh
                if kind == "collision":
                    ET.SubElement(body, f"{{{DRAKE}}}declare_convex")
            if kind == "collision":
                friction = ET.SubElement(ET.SubElement(ET.SubElement(element, "surface"), "friction"), "ode")
                for mu in ("mu", "mu2"):
                    ET.SubElement(friction, mu).text = f"{solid.friction:g}"
            else:
                ET.SubElement(ET.SubElement(element, "material"), "diffuse").text = GREY
    ET.indent(root)
    return '<?xml version="1.0"?>\n' + ET.tostring(root, encoding="unicode") + "\n", files


def write_sdf(scene: Scene, path: str | Path) -> list[Path]:
    """Writes the SDF file after the OBJ files that it names; what was written.

    Args:
        scene: whose terrain is written.
        path: of the SDF file.

    Raises:
        InputError: it cannot be written there, or is made of too many solids.
    """
    path = Path(path)
    text, files = scene_to_sdf(scene, path)
    require_writable(path)
    beside = {path.parent / name: content for name, content in files.items()}
    for file, content in beside.items():
        try:
            file.parent.mkdir(exist_ok=True)
        except OSError as error:
            raise InputError(f"{file.parent}: cannot be made ({error.strerror})") from None
        write_whole(file, content.encode())
    write_whole(path, text.encode())
    return [path, *beside]


def _name(name: str) -> str:
    """A name without what SDF keeps for itself."""
    return "_".join(name.replace("::", "_").replace("__", "_").split())


def _obj(solid: Solid) -> str:
    points, faces = hull_faces(solid.corners)
    lines = [f"v {_text(point)}" for point in points]
    return "\n".join([*lines, *(f"f {a + 1} {b + 1} {c + 1}" for a, b, c in faces.tolist())]) + "\n"


def _text(numbers: np.ndarray) -> str:
    return " ".join(f"{x:.9g}" for x in np.asarray(numbers, float))
