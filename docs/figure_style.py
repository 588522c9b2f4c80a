"""How the figures of the concept pages look: one size, the colours of the playback, ground seen from above."""

from __future__ import annotations

import re
from pathlib import Path

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Polygon

from scenes.contact import Contact, patch_corners
from scenes.robots.robot import Robot
from scenes.terrain.terrain import Terrain

FIGURES = Path(__file__).with_name("figures")
MOST_BYTES = 60_000
WIDE = 7.6  # [inch]
COLOURS = {"left_foot": "#de1a1a", "right_foot": "#1aa829", "left_palm": "#00a5bb", "right_palm": "#d61abd"}
STONES = ["#e3ddd3", "#d9d9d6", "#d3d7db", "#dfd6ce", "#d8d7d0"]
WALL, EDGE, INK, BLUE, AMBER = "#c8ced8", "#8a8a90", "#22262e", "#1f4e9c", "#f0a818"
GOOD, STEP, BAD = "#2a9d4a", "#f0a818", "#b9bcc4"  # stands, one step, falls

mpl.use("Agg")
mpl.rcParams.update(
    {
        "font.family": "DejaVu Sans",
        "font.size": 9,
        "axes.edgecolor": EDGE,
        "axes.linewidth": 0.8,
        "axes.titlesize": 9.5,
        "axes.titleweight": "bold",
        "svg.hashsalt": "drakeplan",  # the same bytes each time
        "svg.fonttype": "path",
        "figure.facecolor": "white",
    }
)


def save(figure: Figure, name: str) -> None:
    """Writes figures/NAME.svg and holds it to its size."""
    import matplotlib.pyplot as plt

    path = FIGURES / f"{name}.svg"
    figure.savefig(path, metadata={"Date": None, "Creator": None}, bbox_inches="tight", pad_inches=0.06)
    plt.close(figure)
    text = re.sub(r'(?<= d=")[^"]+', lambda m: _rounded(m.group()), path.read_text(encoding="utf-8"))
    text = re.sub(r"<!--.*?-->|<metadata>.*?</metadata>", "", text, flags=re.DOTALL)
    path.write_text(re.sub(r">\s+<", ">\n<", text), encoding="utf-8")
    size = path.stat().st_size
    if size > MOST_BYTES:
        raise SystemExit(f"{path}: {size} bytes, expected at most {MOST_BYTES}")
    print(f"{path.name}: {size / 1000:.0f} kB")


def _rounded(outline: str) -> str:
    """An outline's numbers to a hundredth of a point."""
    return re.sub(r"-?\d+\.\d{3,}", lambda m: f"{float(m.group()):.2f}".rstrip("0").rstrip("."), outline)


def from_above(axes: Axes) -> None:
    """Equal scales, no frame."""
    axes.set_aspect("equal")
    axes.set_axis_off()


def draw_ground(axes: Axes, terrain: Terrain, walls: bool = True) -> None:
    """Surfaces from above, the higher ones over the lower ones; walls as lines.

    Args:
        axes: to draw in.
        terrain: whose surfaces.
        walls: whether those that are steep are drawn.
    """
    order = sorted(range(len(terrain.surfaces)), key=lambda k: float(terrain.surfaces[k].vertices[:, 2].mean()))
    for k in order:
        surface = terrain.surfaces[k]
        steep = abs(surface.normal[2]) < 0.5
        if steep and walls:
            ends = surface.vertices[:, :2]
            axes.add_patch(Polygon(ends, closed=True, facecolor=WALL, edgecolor=EDGE, linewidth=0.7, zorder=1))
        elif not steep:
            colour = STONES[k % len(STONES)]
            axes.add_patch(
                Polygon(
                    surface.vertices[:, :2], closed=True, facecolor=colour, edgecolor=EDGE, linewidth=0.5, zorder=0.5
                )
            )


def patch_of(contact: Contact, robot: Robot) -> np.ndarray:
    """(4, 3) corners of the contact's whole patch in W [m]."""
    half = next(e.half_extent for e in robot.effectors if e.name == contact.effector)
    return np.array(in_world(contact, patch_corners(half)))


def in_world(contact: Contact, corners: np.ndarray) -> np.ndarray:
    """(n, 3) points of the contact's plane [m], from (n, 2) in its frame.

    Args:
        contact: whose frame.
        corners: (n, 2) [m].
    """
    return np.asarray(contact.p_WC + corners @ contact.R_WC[:, :2].T)


def draw_patch(axes: Axes, contact: Contact, robot: Robot, *, held: bool = True, zorder: float = 3.0) -> None:
    """A sole or palm from above: filled where it is held, a broken line where it is not.

    Args:
        axes: to draw in.
        contact: what.
        robot: gives the size of the patch.
        held: whether it is held now.
        zorder: above what it lies.
    """
    colour = COLOURS[contact.effector]
    look = {"facecolor": colour, "alpha": 0.85} if held else {"facecolor": "none", "linestyle": (0, (3, 2))}
    edge = "white" if held else colour
    corners = patch_of(contact, robot)[:, :2]
    axes.add_patch(Polygon(corners, closed=True, edgecolor=edge, linewidth=1.0, zorder=zorder, **look))


def project(points: np.ndarray, azimuth: float, elevation: float) -> np.ndarray:
    """(n, 2) picture of points (n, 3) seen from far away.

    Args:
        points: in W [m].
        azimuth: of the eye about z, from x [deg].
        elevation: of the eye over the horizon [deg].
    """
    a, e = np.deg2rad(azimuth), np.deg2rad(elevation)
    right = [-np.sin(a), np.cos(a), 0.0]
    up = [-np.sin(e) * np.cos(a), -np.sin(e) * np.sin(a), np.cos(e)]
    return np.asarray(np.atleast_2d(points) @ np.array([right, up]).T)


def arrow(axes: Axes, start: np.ndarray, end: np.ndarray, colour: str, width: float = 1.6) -> None:
    """A slim arrow.

    Args:
        axes: to draw in.
        start: (2,) where it begins.
        end: (2,) where its head is.
        colour: of it.
        width: of its line [pt].
    """
    style = {"arrowstyle": "-|>", "color": colour, "lw": width, "shrinkA": 0, "shrinkB": 0, "mutation_scale": 11}
    axes.annotate("", xy=tuple(end), xytext=tuple(start), arrowprops=style, zorder=6)
