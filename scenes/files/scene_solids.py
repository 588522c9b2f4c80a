"""A terrain as convex solids, for programs that know no surfaces without thickness and no hollow meshes."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from scenes.files.box_sides import SIDES
from scenes.input_error import InputError
from scenes.meshes.convex_faces import join_coplanar
from scenes.meshes.mesh_import import MESH_PREFIX
from scenes.meshes.mesh_orientation import Bodies
from scenes.terrain.packed_terrain import THICKNESS
from scenes.terrain.polygon import area_vectors, polygon_normal
from scenes.terrain.surface import Surface
from scenes.terrain.terrain import Box, Terrain, TriangleMesh

PLAIN_FRICTION = 0.5  # [-] of what nothing is planned to touch
MAX_SOLIDS = 20_000
SQUARE = 1e-6  # [m] how far the corners of a rectangle may be off
DENT = 1e-5  # [m] how far a corner of a convex body may lie outside one of its faces
ROUNDEST = 200  # faces of a convex body that stays one solid
NEEDLE = 1e-4  # [m] faces narrower than this have no solid behind them; their neighbours cover them


@dataclass(frozen=True, eq=False)
class Solid:
    """A convex solid of a terrain.

    Attributes:
        name: unique.
        corners: (N, 3) in W; the solid is their convex hull [m].
        friction: Coulomb coefficient [-].
        box: size (3,) [m] and pose (4, 4), where the solid is a box.
    """

    name: str
    corners: np.ndarray
    friction: float
    box: tuple[np.ndarray, np.ndarray] | None = None


def solids_of(terrain: Terrain) -> list[Solid]:
    """The terrain as convex solids.

    A surface that stands alone is a slab that reaches `THICKNESS` behind it. A box is a box with the friction of its sides.
    Of a mesh each convex closed body is one solid; of other bodies each flat convex part of a face is a slab like those of
    surfaces, which stays inside the body where this is thicker than the slab and no sharper than 90 deg.

    Args:
        terrain: to be made of solids.

    Raises:
        InputError: more than `MAX_SOLIDS` of them.
    """
    solids: list[Solid] = []
    boxes = {o.name: o for o in terrain.obstacles if isinstance(o, Box)}
    friction: dict[str, float] = {}
    for surface, on_mesh in zip(terrain.surfaces, terrain.surfaces_of_meshes, strict=True):
        owner, _, side = surface.name.rpartition("/")
        owner = owner.removeprefix(MESH_PREFIX) if on_mesh else owner
        if on_mesh or (owner in boxes and side in SIDES and _is_side(surface, boxes[owner])):
            friction[owner] = min(friction.get(owner, np.inf), surface.friction)
        else:
            solids.append(_slab(surface))
    for obstacle in terrain.obstacles:
        mu = friction.get(obstacle.name, PLAIN_FRICTION)
        solids += [_solid_box(obstacle, mu)] if isinstance(obstacle, Box) else _of_mesh(obstacle, mu)
        if len(solids) > MAX_SOLIDS:
            raise InputError(
                f"{obstacle.name!r}: more than {MAX_SOLIDS} convex solids; crop the map, or export it as .obj"
            )
    return solids


def hull_faces(corners: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(V, 3) the corners of the convex hull of points, and (F, 3) its triangles, counter-clockwise from outside.

    Args:
        corners: (N, 3) [m].
    """
    from scipy.spatial import ConvexHull

    hull = ConvexHull(corners - corners.mean(axis=0))
    used, faces = np.unique(hull.simplices, return_inverse=True)
    faces = faces.reshape(hull.simplices.shape)
    points = corners[used]
    doubled = area_vectors(points[faces])
    inward = (doubled * hull.equations[:, :3]).sum(axis=1) < 0
    return points, np.where(inward[:, None], faces[:, ::-1], faces)


def _is_side(surface: Surface, box: Box) -> bool:
    """Whether a surface lies on a face of a box."""
    local = (surface.vertices - box.X_WO[:3, 3]) @ box.X_WO[:3, :3]
    on = np.abs(np.abs(local) - np.asarray(box.size) / 2) < SQUARE
    return bool(on.all(axis=0).any())


def _slab(surface: Surface) -> Solid:
    behind = surface.vertices - THICKNESS * surface.normal
    box = None
    edges = np.roll(surface.vertices, -1, axis=0) - surface.vertices
    if len(edges) == 4 and np.abs(edges[0] + edges[2]).max() < SQUARE:
        length = np.linalg.norm(edges[:2], axis=1)
        if abs(edges[0] @ edges[1]) < SQUARE * length.min():
            X = np.eye(4)
            X[:3, :3] = np.stack([edges[0] / length[0], edges[1] / length[1], surface.normal], axis=1)
            X[:3, 3] = surface.vertices.mean(axis=0) - THICKNESS / 2 * surface.normal
            box = (np.array([*length, THICKNESS]), X)
    return Solid(surface.name, np.concatenate([surface.vertices, behind]), surface.friction, box)


def _solid_box(box: Box, friction: float) -> Solid:
    corners = np.unique(np.round(box.triangles().reshape(-1, 3), 12), axis=0)
    return Solid(box.name, corners, friction, (np.asarray(box.size, float), box.X_WO))


def _of_mesh(mesh: TriangleMesh, friction: float) -> Iterator[Solid]:
    if not len(mesh.faces):
        return
    bodies = Bodies(mesh.faces)
    closed = bodies.closed()
    rest: list[np.ndarray] = []
    number = 0
    order = np.argsort(bodies.body, kind="stable")
    for body, members in enumerate(np.split(order, np.cumsum(np.bincount(bodies.body))[:-1])):
        faces = mesh.faces[members]
        if closed[body] and len(faces) <= ROUNDEST and _is_convex(faces):
            yield Solid(f"{mesh.name}/{number}", np.unique(faces.reshape(-1, 3), axis=0), friction)
            number += 1
        else:
            rest.append(faces)
    if rest:
        for face in join_coplanar(np.concatenate(rest)):
            corners = _prism(face)
            if corners is not None:
                yield Solid(f"{mesh.name}/{number}", corners, friction)
                number += 1


def _is_convex(faces: np.ndarray) -> bool:
    doubled = area_vectors(faces)
    normal = doubled / np.maximum(np.linalg.norm(doubled, axis=1, keepdims=True), 1e-300)
    height = (faces.reshape(-1, 3) @ normal.T) - (faces[:, 0] * normal).sum(axis=1)
    return bool(height.max() <= DENT) and height.min() < -DENT


def _prism(face: np.ndarray) -> np.ndarray | None:
    """(2K, 3) corners of the prism behind a convex face (K, 3); None behind a needle."""
    normal, middle = polygon_normal(face), face.mean(axis=0)
    edges = np.roll(face, -1, axis=0) - face
    inward = np.cross(normal, edges) / np.maximum(np.linalg.norm(edges, axis=1, keepdims=True), 1e-300)
    wide = float((inward * (middle - face)).sum(axis=1).min()) > NEEDLE
    return np.concatenate([face, face - THICKNESS * normal]) if wide else None
