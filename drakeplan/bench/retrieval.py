"""Time to rank stored plans by their distance from a terrain, for libraries of several sizes."""

from __future__ import annotations

import dataclasses
import itertools
import time
from collections.abc import Sequence

import numpy as np

from drakeplan.bench.table import BenchTable
from drakeplan.context import QueryContext
from drakeplan.experience.library import Entry
from drakeplan.experience.plan_distance import PlanBatch, distances
from drakeplan.experience.retrieval import candidates
from drakeplan.experience.terrain_regions import TURN, TerrainRegions
from optimization.inverse_kinematics.whole_body_ik import WholeBodyIK
from scenes.files.scene_source import load_scene
from scenes.robots.robot import Robot

SIZES = (200, 1000, 10_000)
TARGETS = {200: 50.0, 10_000: 1000.0}  # [ms] for all plans
REPEATS = 5
NOISE = 0.05  # [m] by which contacts of the copies differ


def ranking_times(robot: Robot, entries: Sequence[Entry]) -> BenchTable:
    """Median times of retrieval with copies of the library's plans whose contacts differ by some centimetres.

    Args:
        robot: whose library it is.
        entries: of the library.
    """
    context = QueryContext(load_scene("random_surfaces", seed=0), robot, WholeBodyIK(robot))
    feet = np.array([c.p_WC for c in context.start.contacts[:2] if c is not None])
    goal, radius = np.array(context.goal.xyz), context.goal.radius
    began = time.perf_counter()
    regions = TerrainRegions(context, feet, goal, TURN).table(True)
    cover = time.perf_counter() - began
    rows = []
    for size in SIZES:
        plans = _copies(entries, size)
        first, every, apart = [], [], []
        batch = PlanBatch.of([entry.outline for entry in plans])
        for _ in range(REPEATS):
            began = time.perf_counter()
            ranked = candidates(plans, regions, feet, goal, radius)
            next(ranked, None)
            first.append(time.perf_counter() - began)
            for _ in ranked:
                pass
            every.append(time.perf_counter() - began)
            began = time.perf_counter()
            distances(plans[0].outline, batch)
            apart.append(time.perf_counter() - began)
        times = [1e3 * float(np.median(values)) for values in (first, every, apart)]
        rows.append((size, times[0], times[1], TARGETS.get(size, ""), times[2]))
    columns = ("plans", "first plan ms", "all ranked ms", "target ms", "distances of one from all ms")
    notes = (
        f"random_surfaces, seed 0; its contact regions took {1e3 * cover:.0f} ms; medians of {REPEATS} runs.",
        "Copies of the library's plans, their contacts moved by 5 cm at random, as many clusters for the number of plans.",
    )
    title = "Time to rank stored plans"
    return BenchTable("experience_ranking", title, columns, tuple(rows), notes, bench="experience", most_seeds=0)


def _copies(entries: Sequence[Entry], size: int) -> list[Entry]:
    """So many entries; the copies of a round are clusters of their own."""
    rng = np.random.default_rng(0)
    most = 1 + max(entry.cluster for entry in entries)
    made = []
    for number, entry in zip(range(size), itertools.cycle(entries), strict=False):
        position = entry.outline.position + rng.normal(0.0, NOISE, entry.outline.position.shape)
        cluster = entry.cluster + most * (number // len(entries))
        outline = dataclasses.replace(entry.outline, position=position)
        made.append(dataclasses.replace(entry, number=number, name=str(number), cluster=cluster, outline=outline))
    return made
