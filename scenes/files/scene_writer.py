"""The text of a scene file: what `scenes.files.scene_file` reads back as the same scene."""

from __future__ import annotations

import dataclasses
import json
import os
from collections import Counter
from collections.abc import Iterable
from pathlib import Path

import numpy as np

from scenes.disturbance import Disturbance
from scenes.effector import EFFECTORS
from scenes.files.scene_schema import FORMAT, VERSION
from scenes.files.whole_file import write_whole
from scenes.input_error import InputError
from scenes.meshes.height_map import ImportedHeightMap
from scenes.meshes.mesh_import import MESH_PREFIX, ImportedMesh
from scenes.meshes.mesh_path import PACKAGE_SCHEME
from scenes.pose import rotation_rpy
from scenes.scene import Scene, Start
from scenes.terrain.surface import Surface
from scenes.terrain.terrain import Box, Terrain, TriangleMesh


def write_scene(scene: Scene, path: str | Path) -> None:
    """Writes a scene file that `read_scene` turns into the same scene; whole or not at all.

    Args:
        scene: what to write; its notes are not part of it.
        path: of the file; mesh files are named from its folder.

    Raises:
        InputError: the file cannot be written, or `scene_to_yaml` cannot say the scene.
    """
    path = Path(path)
    write_whole(path, scene_to_yaml(scene, folder=path.parent).encode())


def scene_to_yaml(scene: Scene, *, meshes_as_surfaces: bool = False, folder: Path | None = None) -> str:
    """The text of a scene file; numbers are written so that they come back bit by bit, poses to rounding.

    Args:
        scene: what to write; its notes are not part of it.
        meshes_as_surfaces: for plan files: write no meshes but all their surfaces, in the order that contacts refer
            to, called `mesh:...`. Without it meshes are written as the files they came from.
        folder: where the text will lie, for relative mesh files; None keeps them as they were named.

    Raises:
        InputError: a mesh did not come from a file, its surfaces differ in friction, or its file is not in `folder`.
    """
    if scene.origin_offset is not None and not meshes_as_surfaces:
        scene = _georeferenced(scene, np.array(scene.origin_offset))
    terrain = scene.terrain
    meshes = [o for o in terrain.obstacles if not isinstance(o, Box)]
    listed = [(surface, of_mesh) for surface, of_mesh in _flagged(terrain) if meshes_as_surfaces or not of_mesh]
    friction = _common_friction(scene, by_file=bool(meshes) and not meshes_as_surfaces)
    lines = [f"format: {FORMAT}", f"version: {VERSION}", f"name: {_text(scene.name)}"]
    if scene.robot is not None:
        lines.append(f"robot: {_text(scene.robot)}")
    lines.append(f"friction: {_number(friction)}")
    if scene.origin_offset is not None:
        lines.append(f"origin_offset: {_list(scene.origin_offset)}")
    if listed:
        lines += ["surfaces:", *(f"  - {_surface_text(s, of_mesh, friction)}" for s, of_mesh in listed)]
    if meshes and not meshes_as_surfaces:
        maps = [mesh for mesh in meshes if isinstance(mesh, ImportedHeightMap)]
        files = [mesh for mesh in meshes if not isinstance(mesh, ImportedHeightMap)]
        if files:
            lines += ["meshes:", *(f"  - {_mesh_text(mesh, folder)}" for mesh in files)]
        if maps:
            lines += ["heightmaps:", *(f"  - {_map_text(mesh, folder)}" for mesh in maps)]
    boxes = [o for o in terrain.obstacles if isinstance(o, Box)]
    if boxes:
        lines.append("obstacles:")
        lines += [f"  - {{name: {_text(b.name)}, box: {_list(b.size)}, pose: {_pose_text(b.X_WO)}}}" for b in boxes]
    if scene.disturbances:
        lines += ["disturbances:", *(f"  - {_disturbance_text(d)}" for d in scene.disturbances)]
    if scene.start is not None:
        lines += _start_lines(scene.start, [_surface_name(s, m) for s, m in _flagged(terrain)])
    if scene.goal is not None:
        yaw = "null" if scene.goal.yaw is None else _number(scene.goal.yaw)
        lines.append(f"goal: {{xyz: {_place(scene.goal.xyz)}, radius: {_number(scene.goal.radius)}, yaw: {yaw}}}")
    return "\n".join(lines) + "\n"


def _flagged(terrain: Terrain) -> Iterable[tuple[Surface, bool]]:
    return zip(terrain.surfaces, terrain.surfaces_of_meshes, strict=True)


def _common_friction(scene: Scene, *, by_file: bool) -> float:
    """The friction most surfaces have; where meshes are written as files, the one that all their surfaces have."""
    own = tuple(f"{MESH_PREFIX}{o.name}/" for o in scene.terrain.obstacles if isinstance(o, ImportedHeightMap))
    flagged = [s.friction for s, of_mesh in _flagged(scene.terrain) if of_mesh and not s.name.startswith(own)]
    if by_file and flagged:
        if len(set(flagged)) > 1:
            raise InputError(
                f"scene {scene.name!r}: surfaces of one mesh have different friction; a scene file holds one value for a mesh"
            )
        return flagged[0]
    return Counter(surface.friction for surface in scene.terrain.surfaces).most_common(1)[0][0]


def _surface_name(surface: Surface, of_mesh: bool) -> str:
    return MESH_PREFIX + surface.name if of_mesh and not surface.name.startswith(MESH_PREFIX) else surface.name


def _surface_text(surface: Surface, of_mesh: bool, friction: float) -> str:
    corners = ", ".join(_list(vertex) for vertex in surface.vertices)
    text = f"name: {_text(_surface_name(surface, of_mesh))}, vertices: [{corners}]"
    if surface.friction != friction:
        text += f", friction: {_number(surface.friction)}"
    if surface.effectors is not None:
        text += f", contact: [{', '.join(e for e in EFFECTORS if e in surface.effectors)}]"
    elif not any(surface.allows(effector) for effector in EFFECTORS):
        # Without it a ceiling would be taken for a floor drawn upside down.
        text += f", normal: {_list(surface.normal)}"
    return f"{{{text}}}"


def _mesh_text(mesh: TriangleMesh, folder: Path | None) -> str:
    if not isinstance(mesh, ImportedMesh):
        raise InputError(f"mesh {mesh.name!r} has no file, so a scene file cannot refer to it")
    file = _file_text(mesh, folder)
    return f"{{file: {file}, pose: {_pose_text(mesh.X_WM)}, scale: {_number(mesh.scale)}}}"


def _map_text(mesh: ImportedHeightMap, folder: Path | None) -> str:
    file, friction = _file_text(mesh, folder), _number(mesh.friction)
    return (
        f"{{file: {file}, resolution: {_number(mesh.resolution)}, origin: {_list(mesh.origin)}, friction: {friction}}}"
    )


def _file_text(mesh: ImportedMesh | ImportedHeightMap, folder: Path | None) -> str:
    file = mesh.reference
    if folder is not None and not file.startswith(PACKAGE_SCHEME):
        file = os.path.relpath(mesh.path, folder).replace(os.sep, "/")
        if file.startswith("../"):
            raise InputError(f"{mesh.path}: expected in the folder of the scene file or below, {folder.absolute()}")
    return _text(file)


def _georeferenced(scene: Scene, offset: np.ndarray) -> Scene:
    """The scene with its offset added again; meshes and height maps keep the poses and origins that their files need."""
    X = np.eye(4)
    X[:3, 3] = offset

    def there(xyz: Iterable[float]) -> tuple[float, float, float]:
        x, y, z = (np.array(tuple(xyz)) + offset).tolist()
        return x, y, z

    terrain = scene.terrain
    surfaces = tuple(dataclasses.replace(s, vertices=s.vertices + offset) for s in terrain.surfaces)
    obstacles = tuple(dataclasses.replace(o, X_WO=X @ o.X_WO) if isinstance(o, Box) else o for o in terrain.obstacles)
    disturbances = tuple(
        d if d.box_size is None else dataclasses.replace(d, X_WR=X @ (np.eye(4) if d.X_WR is None else d.X_WR))
        for d in scene.disturbances
    )
    start, goal = scene.start, scene.goal
    if start is not None:
        stance = tuple(dataclasses.replace(c, X_WC=X @ c.X_WC) for c in start.stance)
        start = dataclasses.replace(start, xyz=there(start.xyz), stance=stance)
    return dataclasses.replace(
        scene,
        terrain=Terrain(surfaces, obstacles, terrain.surfaces_of_meshes),
        disturbances=disturbances,
        start=start,
        goal=None if goal is None else dataclasses.replace(goal, xyz=there(goal.xyz)),
    )


def _disturbance_text(disturbance: Disturbance) -> str:
    region = "null"
    if disturbance.box_size is not None:
        X_WR = np.eye(4) if disturbance.X_WR is None else disturbance.X_WR
        region = f"{{box: {_list(disturbance.box_size)}, pose: {_pose_text(X_WR)}}}"
    impulses = ", ".join(_list(impulse) for impulse in disturbance.impulses)
    return f"{{region: {region}, impulses: [{impulses}], probability: {_number(disturbance.probability)}}}"


def _start_lines(start: Start, names: list[str]) -> list[str]:
    if not start.stance:
        return [f"start: {{xyz: {_place(start.xyz)}, yaw: {_number(start.yaw)}}}"]
    lines = ["start:", "  stance:"]
    for c in start.stance:
        rpy = _list(rotation_rpy(c.R_WC))
        lines.append(f"    {c.effector}: {{surface: {_text(names[c.surface])}, xyz: {_list(c.p_WC)}, rpy: {rpy}}}")
    return lines


def _pose_text(X: np.ndarray) -> str:
    return f"{{xyz: {_list(X[:3, 3])}, rpy: {_list(rotation_rpy(X[:3, :3]))}}}"


def _place(xyz: tuple[float, float, float]) -> str:
    """A place, with two numbers where its height is left open."""
    return _list(xyz if np.isfinite(xyz[2]) else xyz[:2])


def _list(numbers: Iterable[float]) -> str:
    return f"[{', '.join(_number(x) for x in numbers)}]"


def _number(x: float) -> str:
    """The shortest text that reads back as the same double, here and in YAML 1.1, where 1e-05 is a word."""
    text = repr(float(x))
    return text.replace("e", ".0e") if "e" in text and "." not in text else text


def _text(text: str) -> str:
    """Quoted, so that no name turns into a number, a list or a comment."""
    return json.dumps(text, ensure_ascii=False)
