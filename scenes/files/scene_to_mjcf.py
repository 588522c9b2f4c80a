"""A scene's terrain as an MJCF file: geoms of the world, convex each."""

from __future__ import annotations

import xml.etree.ElementTree as ET

import numpy as np

from scenes.files.scene_solids import solids_of
from scenes.scene import Scene


def scene_to_mjcf(scene: Scene) -> str:
    """The text of an MJCF file, complete in itself: boxes, and convex meshes with their vertices.

    Args:
        scene: whose terrain is written; start, goal and disturbances are not.

    Raises:
        InputError: it is made of too many solids.
    """
    root = ET.Element("mujoco", model=scene.name)
    if scene.origin_offset is not None:
        root.append(ET.Comment(f" origin_offset {' '.join(f'{x:.12g}' for x in scene.origin_offset)} was subtracted "))
    asset, world = ET.SubElement(root, "asset"), ET.SubElement(root, "worldbody")
    for number, solid in enumerate(solids_of(scene.terrain)):
        common = {"name": f"{number} {solid.name}", "friction": f"{solid.friction:g} 0.005 0.0001"}
        if solid.box is not None:
            size, X_WO = solid.box
            shape = {
                "type": "box",
                "size": _text(size / 2),
                "pos": _text(X_WO[:3, 3]),
                "quat": _text(_quaternion(X_WO)),
            }
        else:
            middle = solid.corners.mean(axis=0)
            ET.SubElement(asset, "mesh", name=f"solid{number}", vertex=_text((solid.corners - middle).ravel()))
            shape = {"type": "mesh", "mesh": f"solid{number}", "pos": _text(middle)}
        ET.SubElement(world, "geom", common | shape)
    if not len(asset):
        root.remove(asset)
    ET.indent(root)
    return ET.tostring(root, encoding="unicode") + "\n"


def _quaternion(X: np.ndarray) -> np.ndarray:
    """(4,) w, x, y, z of a pose's rotation."""
    from scipy.spatial.transform import Rotation

    return np.roll(Rotation.from_matrix(X[:3, :3]).as_quat(), 1)


def _text(numbers: np.ndarray) -> str:
    return " ".join(f"{x:.9g}" for x in np.asarray(numbers, float))
