"""A mesh as terrain: its flat regions become surfaces, the mesh itself an obstacle."""

from __future__ import annotations

import re
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from scenes.footholds.convex_cover import FEW, convex_cover, convex_pieces, min_width
from scenes.input_error import InputError
from scenes.meshes.mesh_file import drop_degenerate, read_mesh
from scenes.meshes.mesh_orientation import Bodies, single_faces, turn_outward
from scenes.meshes.planar_regions import planar_regions
from scenes.meshes.rough_ground import fit_rough_ground
from scenes.terrain.georeference import is_far, offset_for, offset_note, to_local
from scenes.terrain.polygon import area_vectors
from scenes.terrain.surface import PALM_TILT, Surface
from scenes.terrain.terrain import TriangleMesh

NARROWEST = 0.04  # [m] no sole or palm is narrower, so nothing narrower can be stood or leant on
MESH_PREFIX = "mesh:"  # surfaces cut out of a mesh are called mesh:<mesh>/<number>
LARGEST = 1000.0  # [m] a mesh larger than this is more likely in millimetres
MOST_COVERED = 200  # regions of rough ground that are covered by large surfaces, up to FEW corners each
PLAIN = 8  # corners up to which they are where there are more regions
COARSE = 1e-3  # [m] coordinates farther apart than this make steps of flat ground
Y_UP_RATIO = 6.0  # a terrain with this much more area facing +y than +z is more likely y-up


@dataclass(frozen=True, eq=False)
class ImportedMesh(TriangleMesh):
    """A mesh that was read from a file, already in W.

    Attributes:
        reference: the `file:` entry, relative to a scene file or `package://`.
        path: the file itself.
        X_WM: (4, 4) pose of the mesh's frame in W.
        scale: factor from the file's unit to metres.
    """

    reference: str
    path: Path
    X_WM: np.ndarray
    scale: float


@dataclass(frozen=True, eq=False)
class MeshImport:
    """What became of a mesh.

    Attributes:
        obstacle: the mesh, for collision.
        surfaces: the flat parts that a sole or a palm can use by their tilt and width.
        notes: what was changed on the way, one line each.
        origin_offset: what was subtracted from georeferenced coordinates [m], None where they were local.
    """

    obstacle: TriangleMesh
    surfaces: tuple[Surface, ...]
    notes: tuple[str, ...] = ()
    origin_offset: tuple[float, float, float] | None = None


def import_mesh(
    path: Path,
    *,
    reference: str | None = None,
    name: str | None = None,
    X_WM: np.ndarray | None = None,
    scale: float | None = None,
    friction: float = 0.5,
    origin_offset: tuple[float, float, float] | None = None,
) -> MeshImport:
    """Reads a mesh and cuts surfaces out of it.

    Flat regions (`planar_regions`) are covered by convex surfaces that overlap (`convex_cover`), so that a sole may
    stand wherever the region holds it. Regions that face down more than a palm can use, and those narrower than
    `NARROWEST`, stay obstacle only. Who may touch a surface follows from its tilt.

    Args:
        path: of the STL, OBJ, PLY or DAE file.
        reference: how a scene file names it; by default the file's name.
        name: of the obstacle, unique in its terrain; by default the file's stem.
        X_WM: (4, 4) pose of the mesh's frame in W.
        scale: factor from the file's unit to metres; None means 1 and that the size is checked.
        friction: of every surface [-].
        origin_offset: subtracted from georeferenced coordinates [m]; None: one is found where it is needed.

    Raises:
        InputError: the file cannot be used, or its size says that it is in millimetres.
    """
    X_WM = np.eye(4) if X_WM is None else X_WM
    triangles = read_mesh(path)
    with np.errstate(over="ignore", invalid="ignore"):
        triangles = triangles * (1.0 if scale is None else scale)
        triangles = triangles @ X_WM[:3, :3].T + X_WM[:3, 3]
    triangles, origin_offset, moved = _without_offset(triangles, path, origin_offset)
    _check_size(triangles, path, scale)
    triangles = drop_degenerate(triangles)
    if len(triangles) == 0:
        raise InputError(f"{path}: no face has an area, expected triangles of more than a point or a line")
    bodies, halved = single_faces(Bodies(triangles))
    bodies, turned = turn_outward(bodies)
    name = mesh_name(path) if name is None else name
    triangles, surfaces, fitted = surfaces_of_mesh(bodies, name, friction)
    obstacle = ImportedMesh(name, triangles, reference or path.name, path, X_WM, 1.0 if scale is None else scale)
    notes = tuple(f"{path.name}: {note}" for note in (*moved, *halved, *turned, *fitted))
    return MeshImport(obstacle, surfaces, notes, origin_offset)


def _without_offset(
    triangles: np.ndarray, path: Path, offset: tuple[float, float, float] | None
) -> tuple[np.ndarray, tuple[float, float, float] | None, tuple[str, ...]]:
    """The triangles without the offset where they are georeferenced, the offset (None where not), and what is said."""
    points = triangles.reshape(-1, 3)
    if not np.isfinite(points).all() or not is_far(points):
        return triangles, None, ()
    notes = ()
    if offset is None:
        offset = offset_for(points)
        notes = (offset_note(offset),)
    with np.errstate(over="ignore", invalid="ignore"):  # beyond the numbers of an STL file: refused later
        spacing = float(np.spacing(np.float32(np.abs(points).max())))
    if path.suffix.lower() == ".stl" and spacing > COARSE:
        notes += (f"its single precision resolves {spacing:.2g} m this far out; export it about a local origin",)
    return to_local(triangles, offset), offset, notes


def surfaces_of_mesh(
    bodies: Bodies, name: str, friction: float
) -> tuple[np.ndarray, tuple[Surface, ...], tuple[str, ...]]:
    """The mesh with its rough ground flattened, the surfaces cut out of it, and what was changed.

    Args:
        bodies: of the mesh, counter-clockwise from outside, no triangle degenerate.
        name: of the mesh; its surfaces are called after it.
        friction: of every surface [-].
    """
    notes: tuple[str, ...] = ()
    exact, triangles, pieces = bodies, bodies.triangles, []
    rough = fit_rough_ground(bodies, min_width=NARROWEST, max_tilt=PALM_TILT[1])
    if rough is not None:
        exact, triangles = (
            Bodies(rough.others) if len(rough.others) else None,
            np.concatenate([rough.others, rough.body]),
        )
        few = FEW if len(rough.regions) <= MOST_COVERED else PLAIN
        for region in rough.regions:
            pieces += [region.lift(corners) for corners in convex_pieces(region.outline, few)]
        notes = (
            f"its ground is rough; planes were fitted within {1e3 * rough.tolerance:.2g} mm, they hold {rough.fitted:.0%} of it; "
            f"its vertices were moved onto them, by {1e3 * rough.rms:.2g} mm RMS and {1e3 * rough.greatest:.2g} mm at most",
        )
    if exact is not None:
        for region in planar_regions(exact, min_width=NARROWEST, max_tilt=PALM_TILT[1]):
            pieces += [region.lift(c) for c in convex_cover(region.outline) if min_width(c) >= NARROWEST]
    triangles.setflags(write=False)
    surfaces = (Surface(f"{MESH_PREFIX}{name}/{k}", corners, friction) for k, corners in enumerate(pieces))
    return triangles, tuple(surfaces), notes


def mesh_name(path: Path) -> str:
    """A name for the obstacle that a mesh file becomes: the file's stem in plain characters."""
    return re.sub(r"[^A-Za-z0-9_.-]+", "_", path.stem) or "mesh"


def check_up_axis(obstacles: Iterable[TriangleMesh]) -> None:
    """Refuses meshes of files that lie on their side; to be asked only where they are all the ground there is.

    Raises:
        InputError: much more area faces +y than +z, as in files of programs whose up is y.
    """
    meshes = [obstacle for obstacle in obstacles if isinstance(obstacle, ImportedMesh)]
    normals = [area_vectors(m.faces) / 2 for m in meshes]
    for mesh, doubled in zip(meshes, normals, strict=True):
        area = np.linalg.norm(doubled, axis=1)
        facing = {axis: float(area[doubled[:, axis] > np.sqrt(0.5) * area].sum()) for axis in (1, 2)}
        if facing[1] > Y_UP_RATIO * facing[2]:
            raise InputError(
                f"{mesh.path}: {facing[1]:.3g} m^2 face +y and {facing[2]:.3g} m^2 face up (+z), as if y were up: "
                f"list it under meshes in a scene file with pose: {{rpy: [1.5708, 0, 0]}}"
            )


def _check_size(triangles: np.ndarray, path: Path, scale: float | None) -> None:
    points = triangles.reshape(-1, 3)
    extent = float((points.max(axis=0) - points.min(axis=0)).max())
    if not np.isfinite(extent) or np.abs(points).max() > 1e5:
        raise InputError(
            f"{path}: reaches {np.abs(points).max():.3g} m from the origin, expected at most 100 km; "
            "move it nearer with pose or origin_offset in a scene file"
        )
    if scale is None and extent > LARGEST:
        raise InputError(
            f"{path}: {extent:.0f} m across, as if it were in millimetres: list it under meshes in a scene file with "
            f"scale: 0.001, or scale: 1.0 if it is that large"
        )
