"""Planar regions and polygons as terrain: convex surfaces that the scene file lists itself."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import numpy as np

from scenes.imports.built import Built, ImportOptions
from scenes.imports.ihmc_regions import regions_of
from scenes.imports.outline_surfaces import surfaces_of_outlines
from scenes.imports.placement import placement_of
from scenes.imports.polygon_file import polygons_of
from scenes.imports.text_file import read_bytes
from scenes.input_error import InputError


def build_outlines(path: Path, options: ImportOptions, out: Path) -> Built:
    """Reads planar regions or polygons and cuts them into convex surfaces.

    Args:
        path: of the file or folder.
        options: how to understand it.
        out: of the scene file.

    Raises:
        InputError: the file cannot be used, or none of its regions is one.
    """
    outlines = regions_of(path) if options.kind == "regions" else polygons_of(read_bytes(path), path)
    corners = np.concatenate([ring for o in outlines for ring in (*o.rings, *o.holes)])
    if not np.isfinite(corners).all():
        bad = next(o for o in outlines if not all(np.isfinite(r).all() for r in (*o.rings, *o.holes)))
        raise InputError(f"{path}: {bad.name or 'a polygon'}: a corner is not finite, expected numbers")
    place = placement_of(corners, path, options.unit, options.up)
    placed = [
        dataclasses.replace(
            o,
            rings=tuple(map(place.points, o.rings)),
            holes=tuple(map(place.points, o.holes)),
            normal=None if o.normal is None else place.directions(o.normal),
        )
        for o in outlines
    ]
    surfaces, changes = surfaces_of_outlines(placed, options.friction)
    if not surfaces:
        why = "; ".join(change.text() for change in changes) or "it holds none"
        raise InputError(f"{path}: no region is left ({why})")
    return Built(
        surfaces,
        (),
        False,
        {"regions": len(outlines)},
        place.offset,
        tuple(changes),
        (*place.notes, "regions have no thickness in the file: each is a plate of 2 cm"),
        place.hints,
    )
