"""The inputs that mutants are made of, as files: all of them must be read."""

from __future__ import annotations

from pathlib import Path


def good_inputs(kind: str, folder: Path) -> list[Path]:
    """Writes every good input of a kind.

    Args:
        kind: of `judge.KINDS`.
        folder: made where it is missing.
    """
    paths = []
    if kind == "scenes":
        from mutation import to_document
        from scene_mutants import good_scenes, write_companions

        for name, scene in good_scenes().items():
            path = _fresh(folder / name) / "scene.yaml"
            path.write_text(to_document(scene))
            write_companions(None, scene, path.parent)
            paths.append(path)
    elif kind == "meshes":
        from mesh_mutants import FORMATS, MESHES, bytes_of

        for name, mesh in MESHES.items():
            for form in FORMATS:
                path = _fresh(folder / f"{name}_{form}") / f"mesh.{form.rpartition('.')[2]}"
                path.write_bytes(bytes_of(mesh, form))
                paths.append(path)
    elif kind == "robots":
        from robot_mutants import GOOD, write_robot

        paths = [write_robot(name, _fresh(folder / name)) for name in GOOD]
    return paths


def _fresh(folder: Path) -> Path:
    folder.mkdir(parents=True, exist_ok=True)
    return folder
