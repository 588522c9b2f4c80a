"""One way in for terrain of any format: read, placed, cut into surfaces and bodies, reported, written."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import shapely

from scenes.files.scene_writer import scene_to_yaml
from scenes.files.whole_file import require_writable, write_whole
from scenes.imports.build_boxes import build_boxes
from scenes.imports.build_heights import build_heights
from scenes.imports.build_mesh import build_mesh
from scenes.imports.build_outlines import build_outlines
from scenes.imports.build_points import build_points
from scenes.imports.built import Built, ImportOptions
from scenes.imports.file_kind import KINDS, kind_of
from scenes.imports.import_report import ImportReport
from scenes.imports.placement import UNITS, UPWARD
from scenes.input_error import InputError, unknown_name
from scenes.scene import Scene
from scenes.terrain.surface import Surface
from scenes.terrain.terrain import Terrain

BUILDERS: dict[str, Callable[[Path, ImportOptions, Path], Built]] = {
    "heights": build_heights,
    "points": build_points,
    "mesh": build_mesh,
    "regions": build_outlines,
    "polygons": build_outlines,
    "boxes": build_boxes,
}
MOST_SAMPLES = 20_000
FARTHEST = 0.03  # [m] from a surface to what was measured of it
EXACT = 1e-5  # [m] less is no noise but rounding
SIDEWAYS = 3.0  # times as much area facing +-y as +-z, and y may be up


@dataclass(frozen=True, eq=False)
class ImportedTerrain:
    """A scene out of a file, with what became of the file.

    Attributes:
        scene: without start and goal.
        report: for the user.
        files: to be written beside the scene file, by name.
    """

    scene: Scene
    report: ImportReport
    files: dict[str, bytes]


def import_terrain(path: str | Path, out: str | Path, options: ImportOptions | None = None) -> ImportedTerrain:
    """Reads terrain of any known format; nothing is written yet.

    Args:
        path: of the file or folder.
        out: where the scene file will be: maps and meshes lie beside it.
        options: how to understand the file.

    Raises:
        InputError: the file cannot be used, or has no ground to stand on.
    """
    path, out, options = Path(path), Path(out), options or ImportOptions()
    _check(options)
    kind = options.kind or kind_of(path)
    built = BUILDERS[kind](path, dataclasses.replace(options, kind=kind), out)
    surfaces = built.surfaces
    hints = built.hints + _lying_on_its_side(surfaces, options.up)
    if not any(surface.allows("left_foot") for surface in surfaces):
        raise InputError(f"{path}: no surface to stand on: nothing flat faces up and is wide enough{_asked(hints)}")
    noise, share = _measured(built.samples, surfaces)
    terrain = Terrain(surfaces, built.obstacles, (built.on_mesh,) * len(surfaces))
    scene = Scene(options.name or out.stem, terrain, robot=options.robot, origin_offset=built.offset)
    report = ImportReport(
        str(path), kind, built.read, built.changes, built.notes, tuple(dict.fromkeys(hints)), noise, share
    )
    return ImportedTerrain(scene, report, built.files)


def write_terrain(imported: ImportedTerrain, out: str | Path) -> list[Path]:
    """Writes the scene file, after what has to lie beside it; what was written.

    Args:
        imported: what `import_terrain` gave for the same place.
        out: of the scene file.

    Raises:
        InputError: it cannot be written there.
    """
    out = Path(out)
    text = scene_to_yaml(imported.scene, folder=out.parent)
    require_writable(out)
    beside = {out.parent / name: content for name, content in imported.files.items()}
    for file, content in beside.items():
        write_whole(file, content)
    write_whole(out, text.encode())
    return [out, *beside]


def _check(options: ImportOptions) -> None:
    if options.kind is not None and options.kind not in KINDS:
        raise unknown_name("kind of file", options.kind, KINDS)
    if options.unit is not None and options.unit not in UNITS:
        raise unknown_name("unit", options.unit, UNITS)
    if options.up not in UPWARD:
        raise unknown_name("axis", options.up, UPWARD)
    if not 0 <= options.friction <= 10:
        raise InputError(f"--friction: expected a number from 0 to 10, got {options.friction}")
    if not 0 <= options.close <= 1:
        raise InputError(f"--close: expected a width from 0 to 1 m, got {options.close}")
    if options.resolution is not None and not 1e-3 <= options.resolution <= 10:
        raise InputError(f"--resolution: expected a length from 0.001 to 10 m, got {options.resolution}")


def _asked(hints: tuple[str, ...]) -> str:
    return f" ({'; '.join(hints)})" if hints else ""


def _lying_on_its_side(surfaces: tuple[Surface, ...], up: str) -> tuple[str, ...]:
    if up != "z" or not surfaces:
        return ()
    areas = np.array([_area(surface) * np.abs(surface.normal) for surface in surfaces]).sum(axis=0)
    if areas[1] > SIDEWAYS * areas[2]:
        return ("much more of it faces along y than along z: if its y axis points up, give --up y",)
    return ()


def _area(surface: Surface) -> float:
    spokes = surface.vertices[1:] - surface.vertices[0]
    return float(np.linalg.norm(np.cross(spokes[:-1], spokes[1:]).sum(axis=0)) / 2)


def _measured(samples: np.ndarray | None, surfaces: tuple[Surface, ...]) -> tuple[float | None, float | None]:
    """Root mean square of the distances of samples from the surfaces they lie on [m], and the share that lies on one.

    Both None where there is no noise.
    """
    if samples is None or not len(samples):
        return None, None
    samples = samples[np.linspace(0, len(samples) - 1, min(len(samples), MOST_SAMPLES)).astype(int)]
    off = np.full(len(samples), np.inf)
    for surface in surfaces:
        low, high = surface.vertices.min(axis=0) - FARTHEST, surface.vertices.max(axis=0) + FARTHEST
        near = np.flatnonzero(((samples >= low) & (samples <= high)).all(axis=1))
        if not len(near):
            continue
        along = surface.vertices[1] - surface.vertices[0]
        along = along / np.linalg.norm(along)
        axes = np.stack([along, np.cross(surface.normal, along)], axis=1)
        away = samples[near] - surface.vertices[0]
        flat = away @ axes
        inside = shapely.contains_xy(shapely.Polygon((surface.vertices - surface.vertices[0]) @ axes), flat)
        off[near[inside]] = np.minimum(off[near[inside]], np.abs(away[inside] @ surface.normal))
    on = off <= FARTHEST
    noise = float(np.sqrt(np.mean(off[on] ** 2))) if on.any() else 0.0
    return (noise, float(on.mean())) if noise > EXACT else (None, None)
