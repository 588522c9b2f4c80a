"""Foot placements on two bars, each too thin alone, as the gap nears the length of a sole (Grey 2017 fig. 4.10)."""

from __future__ import annotations

import time
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from drakeplan.bench.table import BenchOptions, BenchTable
from scenes.files.scene_source import load_scene
from scenes.footholds.edge_candidates import bridge_edges
from scenes.footholds.projection import patch_shape
from scenes.footholds.raw_placement import Ball, Placement
from scenes.footholds.raw_sampler import SamplerOptions, sample_foothold
from scenes.robots.robot import load_robot
from scenes.terrain.packed_terrain import PackedTerrain, pack_terrain
from scenes.terrain.surface import Surface
from scenes.terrain.terrain import terrain_from

if TYPE_CHECKING:
    from matplotlib.figure import Figure

GAPS = (0.1, 0.3, 0.5, 0.6, 0.7, 0.8, 0.85, 0.9, 0.95, 1.0, 1.02, 1.04, 1.05, 1.06, 1.07, 1.08, 1.1)  # of a sole
QUERIES_PER_SEED = 20  # 50 seeds make the 1000 queries a gap of Grey 2017
BAR_WIDTH, BAR_LENGTH = 0.015, 1.0  # [m] one bar's support has an inner radius of less than `INNER_RADIUS`
RADIUS, HIGHEST = 0.4, 0.1  # [m] of the ball that is searched, and of the bars from its middle
MAX_TILT = np.deg2rad(25.0)
PICTURE = Path("out/bars.png")
GROUNDS = ("flat", "stairs", "rubble_field", "rubble_corridor", "random_surfaces", "hpp/darpa")
WAYS = ("sampled", "sampled, seeded", "between edges")


def two_bars(gap: float, yaw: float = 0.0, z: float = 0.0) -> PackedTerrain:
    """Two level bars on either side of the origin.

    Args:
        gap: between their inner edges [m].
        yaw: of their long edges [rad].
        z: their height [m].
    """
    c, s = np.cos(yaw), np.sin(yaw)
    R, half = np.array([[c, -s], [s, c]]), BAR_LENGTH / 2
    bars = []
    for name, y in (("left", gap / 2), ("right", -gap / 2 - BAR_WIDTH)):
        corners = np.array([[-half, y], [half, y], [half, y + BAR_WIDTH], [-half, y + BAR_WIDTH]]) @ R.T
        bars.append(Surface(name, np.column_stack([corners, np.full(4, z)])))
    return pack_terrain(terrain_from(bars))


def run(options: BenchOptions) -> tuple[BenchTable, BenchTable]:
    """Footholds on bars by the gap between them, and footholds a second on other ground."""
    return _gaps(options), _rates(options)


def _gaps(options: BenchOptions) -> BenchTable:
    """Every gap, bars turned and raised at random: algorithm 1 as published, seeded, and the poses between edges."""
    foot = load_robot(options.robot).effectors[0]
    patch, length = patch_shape(foot), 2 * foot.half_extent[0]
    ball = Ball(np.zeros(3), RADIUS)
    rng, queries = np.random.default_rng(0), QUERIES_PER_SEED * options.seeds
    samplers = (SamplerOptions(seeded=False, max_tilt=MAX_TILT), SamplerOptions(max_tilt=MAX_TILT))

    def ask(way: int, packed: PackedTerrain) -> Placement:
        if way == 2:
            return bridge_edges(packed, 0, patch, ball, 0.0, MAX_TILT)
        return sample_foothold(packed, 0, patch, ball, 0.0, samplers[way], rng)

    for way in range(len(WAYS)):
        ask(way, two_bars(0.5 * length))  # compiled before it is timed
    rows = []
    for gap in GAPS:
        found, seconds = np.zeros(len(WAYS)), np.zeros(len(WAYS))
        for _ in range(queries):
            packed = two_bars(gap * length, rng.uniform(0.0, 2 * np.pi), rng.uniform(-HIGHEST, HIGHEST))
            for way in range(len(WAYS)):
                began = time.perf_counter()
                found[way] += ask(way, packed).count > 0
                seconds[way] += time.perf_counter() - began
        rows.append((round(100 * gap), *(100 * found / queries).tolist(), *(1e3 * seconds / queries).tolist()))
        options.tell(
            f"gap {100 * gap:.0f} % of the sole: found {', '.join(f'{100 * n / queries:.0f}' for n in found)} %"
        )
    columns = ("gap, % of the sole", *(f"{way}, %" for way in WAYS), *(f"{way}, ms" for way in WAYS))
    notes = (
        f"{queries} queries a gap, bars of {1e3 * BAR_WIDTH:g} mm, turned and raised at random; ms of a query, found or not.",
        "Sampled: Grey 2017 algorithm 1, tries as in its fig. 4.10. Seeded: first the middle and the wanted heading.",
    )
    table = BenchTable("bars", "Foot placements on two parallel bars", columns, tuple(rows), notes, most_seeds=None)
    PICTURE.parent.mkdir(exist_ok=True)
    _draw(table).savefig(PICTURE, dpi=120)
    return table


def _rates(options: BenchOptions) -> BenchTable:
    """Balls about random points of the ground of several scenes, one thread; packing the terrain is not counted."""
    patch, rows, queries = patch_shape(load_robot(options.robot).effectors[0]), [], QUERIES_PER_SEED * options.seeds
    for name in GROUNDS:
        terrain, rng = load_scene(name).terrain, np.random.default_rng(0)
        packed, found, tries = pack_terrain(terrain), 0, 0
        grounds = [terrain.surfaces[k] for k in terrain.surfaces_for("left_foot")]
        sample_foothold(packed, 0, patch, Ball(grounds[0].centroid.copy(), RADIUS), 0.0, SamplerOptions(), rng)
        balls = []
        for k in rng.integers(len(grounds), size=queries).tolist():
            middle = rng.dirichlet(np.ones(len(grounds[k].vertices))) @ grounds[k].vertices
            balls.append(Ball(middle + rng.normal(0.0, 0.1, 3), RADIUS))
        began = time.perf_counter()
        for ball in balls:
            placed = sample_foothold(packed, 0, patch, ball, 0.0, SamplerOptions(), rng)
            found, tries = found + (placed.count > 0), tries + placed.tries
        seconds = time.perf_counter() - began
        rows.append((name, len(packed.count), f"{found} of {queries}", found / seconds, tries / queries))
        options.tell(f"{name}: {found} of {queries}, {found / seconds:.0f} a second")
    columns = ("scene", "polygons", "found", "found a second", "poses judged a query")
    notes = (f"Seeded algorithm 1 in balls of {RADIUS:g} m about random points of the ground, moved by 0.1 m.",)
    title = "Foot placements sampled on raw geometry"
    return BenchTable("raw_footholds", title, columns, tuple(rows), notes, bench="bars", most_seeds=None)


def _draw(table: BenchTable) -> Figure:
    """Success by gap, a line for each way."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(7, 4), layout="constrained")
    axes = figure.subplots()
    rows = np.array(table.rows, float)
    for way, name in enumerate(WAYS):
        axes.plot(rows[:, 0], rows[:, 1 + way], marker="osD"[way], label=name)
    axes.set(
        xlabel="gap between two bars [% of the sole's length]", ylabel="queries with a foothold [%]", ylim=(-3, 103)
    )
    axes.legend()
    axes.grid(alpha=0.3)
    return figure
