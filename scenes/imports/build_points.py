"""A point cloud as terrain: surfaces and boxes that the scene file lists itself."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from scenes.imports.built import Built, ImportOptions
from scenes.imports.cloud_terrain import cloud_terrain
from scenes.imports.import_report import Change
from scenes.imports.placement import placement_of
from scenes.imports.point_file import cloud_of
from scenes.imports.text_file import read_bytes
from scenes.input_error import InputError

MOST_USED = 2_000_000  # points; more say nothing new
LINE = 1e-3  # width over length of a cloud that is a line


def build_points(path: Path, options: ImportOptions, out: Path) -> Built:
    """Reads a point cloud and cuts surfaces out of it.

    Args:
        path: of the file.
        options: how to understand it.
        out: of the scene file.

    Raises:
        InputError: the file cannot be used, or its points are too few or in one line.
    """
    cloud = cloud_of(read_bytes(path), path)
    place = placement_of(cloud.points, path, options.unit, options.up)
    points = place.points(cloud.points)
    _check_spread(points, path)
    normals = None if cloud.normals is None else place.directions(cloud.normals)
    viewpoint = None if cloud.viewpoint is None else place.points(cloud.viewpoint)
    viewpoint = viewpoint if options.viewpoint is None else np.array(options.viewpoint)
    changes = [Change("dropped", cloud.lost, "points", "not finite")]
    if len(points) > MOST_USED:
        some = np.sort(np.random.default_rng(0).choice(len(points), MOST_USED, replace=False))
        changes.append(Change("dropped", len(points) - MOST_USED, "points", "drawn at random, so many are not needed"))
        points, normals = points[some], None if normals is None else normals[some]
    found = cloud_terrain(
        points,
        friction=options.friction,
        close=options.close,
        cell=options.resolution,
        normals=normals,
        viewpoint=viewpoint,
    )
    planes = len({surface.name.partition("/")[0] for surface in found.surfaces})
    held = found.leftover - found.noise
    changes += [
        Change("merged", planes, "planes", f"their points within {1e3 * found.planes.tolerance:.2g} mm are surfaces"),
        Change("dropped", found.narrow, "planes", "too narrow for a sole or a palm; their points count as clutter"),
        Change(
            "boxed",
            held,
            "points",
            f"on no surface: {len(found.boxes)} boxes of {found.box_cell:.2g} m cells, to keep off",
        ),
        Change("dropped", found.noise, "points", "scattered thinly about no surface"),
    ]
    notes = list(place.notes)
    if found.filled > 0:
        notes.append(f"holes up to {options.close:g} m wide were filled, {found.filled:.2g} m^2")
    if normals is None and viewpoint is None:
        notes.append("nothing says where the sensor was: walls face the ground at their foot, level surfaces up")
    return Built(
        found.surfaces,
        found.boxes,
        False,
        {"points": len(cloud.points) + cloud.lost},
        place.offset,
        tuple(changes),
        tuple(notes),
        place.hints,
        points,
    )


def _check_spread(points: np.ndarray, path: Path) -> None:
    if len(points) < 3:
        raise InputError(f"{path}: holds {len(points)} finite point(s), expected a cloud")
    spread = np.linalg.svd(points[:: max(1, len(points) // 10_000)] - points.mean(axis=0), compute_uv=False)
    if spread[1] <= LINE * spread[0]:
        where = "in one place" if spread[0] < 1e-9 else "in one line"
        raise InputError(f"{path}: its {len(points)} points lie {where}, expected a cloud")
