"""Where a scene comes from: a name, a scene file, a mesh of hpp-environments or a mesh file."""

from __future__ import annotations

import inspect
import os
from pathlib import Path

from scenes.input_error import InputError, unknown_name
from scenes.library import NAMED_SCENES
from scenes.meshes.mesh_file import MESH_SUFFIXES
from scenes.meshes.mesh_path import hpp_meshes, hpp_reference, mesh_path
from scenes.scene import Scene

HPP = "hpp/"
SCENE_SUFFIXES = (".yaml", ".yml")


def load_scene(source: str | os.PathLike[str], *, seed: int = 0) -> Scene:
    """The scene that `source` names.

    Args:
        source: a name of `list_scenes()`, a scene file (.yaml, .yml), `hpp/<mesh>` (the meshes of the installed package
            hpp-environments), or a mesh file (.stl, .obj, .ply, .dae). A scene of a mesh has neither start nor goal.
        seed: of the named scenes that draw something.

    Raises:
        InputError: nothing goes by that name, or what does cannot be read.
    """
    source = os.fspath(source)
    if source in NAMED_SCENES:
        return NAMED_SCENES[source](seed)
    if source.startswith(HPP):
        reference = hpp_reference(source.removeprefix(HPP))
        return _scene_of_mesh(source, mesh_path(reference, None, source), reference)
    path = Path(source)
    if path.suffix.lower() in MESH_SUFFIXES:
        return _scene_of_mesh(path.stem, path, path.name)
    try:
        is_file, is_there = path.is_file(), path.exists()
    except (OSError, ValueError):  # a name that no file can have
        is_file = is_there = False
    if path.suffix.lower() in SCENE_SUFFIXES or is_file:
        from scenes.files.scene_file import read_scene  # pydantic: 0.2 s that named scenes do not need

        return read_scene(path)
    if is_there:
        raise InputError(f"{source}: not a regular file; expected a scene name, a scene file or a mesh file")
    raise unknown_name("scene", source, [*NAMED_SCENES, *(HPP + name for name in hpp_meshes())])


def list_scenes() -> dict[str, str]:
    """Name and one-line description of every named scene."""
    return {name: (inspect.getdoc(build) or name).splitlines()[0] for name, build in NAMED_SCENES.items()}


def _scene_of_mesh(name: str, path: Path, reference: str) -> Scene:
    """A terrain made of one mesh, the start and the goal left to the caller."""
    from scenes.meshes.mesh_import import check_up_axis, import_mesh
    from scenes.terrain.terrain import Terrain

    mesh = import_mesh(path, reference=reference)
    check_up_axis((mesh.obstacle,))
    if not any(surface.allows("left_foot") for surface in mesh.surfaces):
        raise InputError(f"{path}: no surface to stand on: no flat region faces up and is wide enough")
    terrain = Terrain(mesh.surfaces, (mesh.obstacle,), (True,) * len(mesh.surfaces))
    return Scene(name, terrain, origin_offset=mesh.origin_offset, notes=mesh.notes)
