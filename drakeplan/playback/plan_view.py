"""A picture of a scene from above: what is walkable, what palms can use, what is ignored, start and goal."""

from __future__ import annotations

import io
from pathlib import Path

import numpy as np

from scenes.files.whole_file import write_whole
from scenes.meshes.height_map import ImportedHeightMap
from scenes.scene import Scene
from scenes.terrain.surface import Surface
from scenes.terrain.usable_area import by_use, usable_area

WALKABLE, PALMS, UNUSED, MESH, UNKNOWN = "#6aa84f", "#3d85c6", "#b45f5f", "#cccccc", "#f6d55c"
SIZE = 9.0  # [inch] of the longer side
WALL = 0.02  # [m] width at which an upright wall is drawn


def write_plan_view(scene: Scene, path: str | Path) -> None:
    """Draws the scene as it was understood into a PNG file.

    Args:
        scene: what to draw.
        path: of the picture.

    Raises:
        InputError: the picture cannot be written there.
    """
    from matplotlib.artist import Artist
    from matplotlib.backends.backend_agg import FigureCanvasAgg  # 0.5 s that no other command needs
    from matplotlib.collections import PolyCollection
    from matplotlib.figure import Figure
    from matplotlib.patches import Patch

    terrain, areas = scene.terrain, usable_area(scene.terrain)
    low, high = terrain.extent
    width, depth = np.maximum((high - low)[:2], 0.1)
    scale = SIZE / max(width, depth)
    figure = Figure(
        figsize=(max(width * scale, 4.0) + 1.0, max(depth * scale, 2.5) + 1.6), dpi=110, layout="constrained"
    )
    FigureCanvasAgg(figure)
    axes = figure.add_subplot()
    triangles = terrain.triangles
    if len(triangles):
        axes.add_collection(PolyCollection(list(triangles[:, :, :2]), facecolors=MESH, edgecolors="none"))
    feet, palms, unused = by_use(terrain.surfaces)
    for group, colour, layer in ((unused, UNUSED, 2), (palms, PALMS, 4), (feet, WALKABLE, 3)):
        shapes = [_outline(s) for s in sorted(group, key=lambda s: s.centroid[2])]
        axes.add_collection(
            PolyCollection(shapes, facecolors=colour, edgecolors="black", linewidths=0.3, alpha=0.85, zorder=layer)
        )
    ignored = areas.unused + areas.narrow + areas.steep + areas.downward
    legend: list[Artist] = [
        Patch(color=WALKABLE, label=f"walkable {areas.walkable:.2f} m²"),
        Patch(color=PALMS, label=f"for palms {areas.palms:.2f} m²"),
        Patch(
            color=MESH, label=f"ignored {ignored:.2f} m² (narrow or rough {areas.narrow:.2f}, steep {areas.steep:.2f})"
        ),
    ]
    maps = [o for o in terrain.obstacles if isinstance(o, ImportedHeightMap)]
    if maps:
        axes.set_facecolor(UNKNOWN)
        legend.append(Patch(color=UNKNOWN, label=f"unknown {areas.unknown:.2f} m²"))
    for end, mark, name in ((scene.start, "o", "start"), (scene.goal, "*", "goal")):
        if end is not None:
            (line,) = axes.plot(
                *end.xyz[:2], mark, color="black", markersize=10, zorder=6, linestyle="none", label=name
            )
            legend.append(line)
    if scene.goal is not None:
        angle = np.linspace(0.0, 2 * np.pi, 60)
        x, y = scene.goal.xyz[:2]
        axes.plot(x + scene.goal.radius * np.cos(angle), y + scene.goal.radius * np.sin(angle), "k--", lw=0.8, zorder=6)
    axes.set_xlim(low[0] - 0.05 * width, high[0] + 0.05 * width)
    axes.set_ylim(low[1] - 0.05 * depth, high[1] + 0.05 * depth)
    axes.set_aspect("equal")
    axes.set_xlabel("x [m]")
    axes.set_ylabel("y [m]")
    axes.set_title(scene.name)
    figure.legend(handles=legend, loc="outside lower center", ncols=2, fontsize=8)
    content = io.BytesIO()
    figure.savefig(content, format="png")
    write_whole(path, content.getvalue())


def _outline(surface: Surface) -> np.ndarray:
    """(K, 2) the surface from above; an upright wall as a strip."""
    corners = surface.vertices[:, :2]
    if abs(surface.normal[2]) > 0.05:
        return corners
    along = np.linalg.svd(corners - corners.mean(axis=0))[2][0]
    reach = (corners - corners.mean(axis=0)) @ along
    ends = corners.mean(axis=0) + np.outer([reach.min(), reach.max()], along)
    side = WALL * np.array([-along[1], along[0]])
    return np.array([*(ends - side / 2), *(ends + side / 2)[::-1]])
