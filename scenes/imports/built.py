"""What each format's builder is asked with, and what it gives back to the one pipeline."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from scenes.imports.import_report import Change
from scenes.terrain.surface import Surface
from scenes.terrain.terrain import Box, TriangleMesh


@dataclass(frozen=True)
class ImportOptions:
    """How a file is to be understood.

    Attributes:
        kind: one of `scenes.imports.file_kind.KINDS`; None: by name and content.
        unit: of the file's lengths, one of `scenes.imports.placement.UNITS`; None: metres, and the size is checked.
        up: the file's axis that points up: x, y or z.
        friction: of all surfaces that do not give theirs [-].
        resolution: edge of a height map's cell, or of the cells that a cloud is averaged over [m].
        origin: (2,) x and y of a height map's first height [m].
        close: holes in the ground up to this width are filled [m].
        viewpoint: (3,) where the sensor was, in the scene's frame [m].
        name: of the scene; None: that of the file written.
        robot: named in the scene, None for none.
    """

    kind: str | None = None
    unit: str | None = None
    up: str = "z"
    friction: float = 0.5
    resolution: float | None = None
    origin: tuple[float, float] | None = None
    close: float = 0.05
    viewpoint: tuple[float, float, float] | None = None
    name: str | None = None
    robot: str | None = None


@dataclass(frozen=True, eq=False)
class Built:
    """A terrain out of a file, and what is to be said of it.

    Attributes:
        surfaces: in the order that contacts refer to.
        obstacles: boxes and meshes.
        on_mesh: whether the surfaces are faces of an obstacle mesh, which is their body.
        read: what the file holds: things and their number.
        offset: subtracted from georeferenced coordinates [m], None for nothing.
        changes: what was changed.
        notes: what else is said.
        hints: what is asked.
        samples: (M, 3) what was measured, in the scene [m]; None where nothing was.
        files: to be written beside the scene file, by name.
    """

    surfaces: tuple[Surface, ...]
    obstacles: tuple[Box | TriangleMesh, ...]
    on_mesh: bool
    read: dict[str, int]
    offset: tuple[float, float, float] | None = None
    changes: tuple[Change, ...] = ()
    notes: tuple[str, ...] = ()
    hints: tuple[str, ...] = ()
    samples: np.ndarray | None = None
    files: dict[str, bytes] = field(default_factory=dict)


def is_inside(path: Path, folder: Path) -> bool:
    """Whether a scene file in a folder can name the file at a path.

    Args:
        path: of the file.
        folder: of the scene file.
    """
    try:
        inside = path.resolve().is_relative_to(folder.resolve())
    except (OSError, ValueError):
        return False
    return inside and "\\" not in str(path)
