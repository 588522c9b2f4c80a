"""Terrain as MJCF elements: convex solids to touch, and every mesh as it is to look at.

MuJoCo collides convex bodies only.
"""

from __future__ import annotations

from collections import Counter

import numpy as np
from lxml import etree  # type: ignore[attr-defined]

from drakeplan.export.mujoco_robot import LOOKS, SOLID, numbers, placed
from drakeplan.playback.terrain_mesh import ROCK, STONES, WALL, is_wall
from scenes.files.scene_solids import Solid, solids_of
from scenes.robots.meshes import obj_text
from scenes.terrain.terrain import Box, Terrain, TriangleMesh

NEAR = 2.0  # [m] of a contact: of large meshes, only faces as near as this can be touched
LARGE = 3000  # triangles
SEE_THROUGH = 0.35  # alpha of walls
FIRST = "1"  # priority over the robot's shapes: friction is the terrain's
OTHER_FRICTION = "0.005 0.0001"  # MuJoCo's own, of turning on the spot and rolling [m]


class MujocoTerrain:
    """The elements of one terrain.

    Attributes:
        files: mesh files by name, for the folder of assets.
        solids: that can be touched.
    """

    def __init__(self, terrain: Terrain, contacts: np.ndarray) -> None:
        """Takes the terrain.

        Args:
            terrain: what stands around the robot.
            contacts: (C, 3) points of the plan's contacts in W [m].

        Raises:
            InputError: it is made of too many solids.
        """
        self._terrain = terrain
        self._surfaces = {surface.name: surface for surface in terrain.surfaces}
        self._meshes = [o for o in terrain.obstacles if isinstance(o, TriangleMesh)]
        nearby = [TriangleMesh(mesh.name, _near(mesh.faces, contacts)) for mesh in self._meshes]
        boxes = [o for o in terrain.obstacles if isinstance(o, Box)]
        self.solids = solids_of(Terrain(terrain.surfaces, (*boxes, *nearby), terrain.surfaces_of_meshes))
        self.files: dict[str, bytes] = {}

    def add(self, root: etree._Element, worldbody: etree._Element) -> None:
        """Adds geoms and their meshes.

        Args:
            root: of the MJCF, with an element asset.
            worldbody: which takes the geoms.
        """
        asset = root.find("asset")
        usual = Counter(s.friction for s in self._terrain.surfaces).most_common(1)[0][0]
        of_mesh = tuple(f"{mesh.name}/" for mesh in self._meshes)
        for k, solid in enumerate(self.solids):
            hidden = bool(of_mesh) and solid.name not in self._surfaces and solid.name.startswith(of_mesh)
            geom = self._solid(asset, worldbody, solid, f"terrain {k} {solid.name}")
            geom.set("friction", f"{usual if hidden else solid.friction:.9g} {OTHER_FRICTION}")
            geom.set("group", str(SOLID if hidden else LOOKS))
            if not hidden:
                geom.set("rgba", numbers(self._colour(solid, k)))
        for k, mesh in enumerate(self._meshes):
            self._show(asset, worldbody, mesh.faces, f"terrain_{k}")

    def _solid(self, asset: etree._Element, worldbody: etree._Element, solid: Solid, name: str) -> etree._Element:
        geom = etree.SubElement(worldbody, "geom", name=name, priority=FIRST)
        if solid.box is not None:
            size, X_WO = solid.box
            geom.set("type", "box")
            geom.set("size", numbers(size / 2))
            return placed(geom, X_WO)
        middle = solid.corners.mean(axis=0)
        etree.SubElement(asset, "mesh", name=name, vertex=numbers(solid.corners - middle))
        geom.set("type", "mesh")
        geom.set("mesh", name)
        geom.set("pos", numbers(middle))
        return geom

    def _show(self, asset: etree._Element, worldbody: etree._Element, triangles: np.ndarray, name: str) -> None:
        vertices, faces = np.unique(triangles.reshape(-1, 3), axis=0, return_inverse=True)
        self.files[f"{name}.obj"] = obj_text(vertices, faces.reshape(-1, 3)).encode()
        etree.SubElement(asset, "mesh", name=name, file=f"{name}.obj", inertia="shell")
        geom = etree.SubElement(worldbody, "geom", name=name, type="mesh", mesh=name, contype="0", conaffinity="0")
        geom.set("rgba", numbers([*ROCK, 1.0]))
        geom.set("group", str(LOOKS))

    def _colour(self, solid: Solid, k: int) -> list[float]:
        surface = self._surfaces.get(solid.name)
        if surface is None:
            return [*ROCK, 1.0]
        return [*WALL, SEE_THROUGH] if is_wall(surface) else [*STONES[k % len(STONES)], 1.0]


def _near(triangles: np.ndarray, contacts: np.ndarray) -> np.ndarray:
    """The triangles (K, 3, 3); of many, those whose bounding box comes near a contact."""
    if len(triangles) <= LARGE:
        return triangles
    near = np.zeros(len(triangles), bool)
    low, high = triangles.min(axis=1), triangles.max(axis=1)
    for point in contacts:
        gap = np.maximum(np.maximum(low - point, point - high), 0.0)
        near |= np.linalg.norm(gap, axis=1) <= NEAR
    return triangles[near]
