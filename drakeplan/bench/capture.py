"""Capture: acceptance and time of random questions, and what the linear inverted pendulum says of those on level ground."""

from __future__ import annotations

import time
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from drakeplan.bench.capture_rose import PICTURE, draw_rose
from drakeplan.bench.table import BenchOptions, BenchTable, spread
from optimization.capture.checker import CaptureAnswer, CaptureChecker
from optimization.capture.inverted_pendulum import (
    angular_allowance,
    capture_point,
    depth_inside,
    frequency,
    one_step_region,
    support_polygon,
)
from optimization.capture.question import CaptureQuestion
from optimization.capture.sampling import CAPTURE_MOTIONS, random_question
from scenes.robots.robot import load_robot

WELL_INSIDE = 0.02  # [m] of the capture point from the edge of the ground that captures
DEPTHS = (-np.inf, -0.10, -0.05, -0.02, 0.0, 0.02, 0.05, np.inf)  # [m] bins of the table
PUBLISHED = "100 to 1000"  # Lin 2020 sec. 7.5, in C++ [ms]


@dataclass(frozen=True, eq=False)
class Asked:
    """One question with its answer and what it took [ms]."""

    question: CaptureQuestion
    answer: CaptureAnswer
    cpu: float
    wall: float


def run(options: BenchOptions) -> tuple[BenchTable, BenchTable]:
    """`options.seeds` questions of each capture motion, and as many on level ground; one thread."""
    robot = load_robot(options.robot)
    checker = CaptureChecker(robot)
    checker.check(random_question(np.random.default_rng(1_000_000), robot, "foot"))  # kernels are loaded
    tables = _acceptance(checker, options), _agreement(checker, options)
    draw_rose(checker, options.tell)
    return tables


def ask(checker: CaptureChecker, question: CaptureQuestion) -> Asked:
    """The answer to one question, with processor and wall time.

    Args:
        checker: answers it.
        question: contacts, state and new contact.
    """
    cpu, wall = time.process_time(), time.perf_counter()
    answer = checker.check(question)
    return Asked(question, answer, 1e3 * (time.process_time() - cpu), 1e3 * (time.perf_counter() - wall))


def _acceptance(checker: CaptureChecker, options: BenchOptions) -> BenchTable:
    rows, everything, blocks = [], [], []
    for number, motion in enumerate(CAPTURE_MOTIONS):
        rngs = (np.random.default_rng((seed, number)) for seed in range(options.seeds))
        asked = [ask(checker, random_question(rng, checker.robot, motion)) for rng in rngs]
        options.tell(f"{motion}: {sum(a.answer.captured for a in asked)} of {len(asked)} captured")
        rows.append(_row(motion, asked))
        everything += asked
        blocks.append(f"{motion}, what failed first: {_reasons(asked)}")
    rows.append(_row("all", everything))
    columns = ("motion", "questions", "captured", "CPU ms, median", "p95", "captured, median", "not captured, median",
               "wall ms, median", "p95", "Lin 2020")  # fmt: skip
    notes = (
        "One foot stands on ground tilted up to 25 deg, the CoM moves at up to 1 m/s (Lin 2020 sec. 7.6). Programs are "
        "built within the time of the first question of their structure.",
        *blocks,
        f"Standing on level ground, pushed in 16 directions: {PICTURE}",
    )
    return BenchTable("capture", "Zero- and one-step capture", columns, tuple(rows), notes, most_seeds=None)


def _row(name: str, asked: list[Asked]) -> tuple[object, ...]:
    cpu, wall = spread([a.cpu for a in asked]), spread([a.wall for a in asked])
    parts = [spread([a.cpu for a in asked if a.answer.captured == captured])["median"] for captured in (True, False)]
    captured = sum(a.answer.captured for a in asked)
    return (name, len(asked), captured, cpu["median"], cpu["p95"], *parts, wall["median"], wall["p95"], PUBLISHED)


def _reasons(asked: list[Asked]) -> str:
    """How often each block was what failed, the most frequent first."""
    counts: dict[str, int] = {}
    for a in asked:
        if not a.answer.captured:
            block = block_of(a.answer.reason)
            counts[block] = counts.get(block, 0) + 1
    return ", ".join(f"{block} {count}" for block, count in sorted(counts.items(), key=lambda item: -item[1])[:6])


def block_of(reason: str) -> str:
    """The constraint block that a reason names, joints and end effectors put together."""
    words = reason.split(": ")[1].split() if ": " in reason else [reason]
    stops = ("exceeded", "comes", "cannot", "of", "off", "at", "turned", "have", "left", "by", "is")
    end = next((i for i, word in enumerate(words) if word in stops), len(words))
    return " ".join(words[:end])


def _agreement(checker: CaptureChecker, options: BenchOptions) -> BenchTable:
    """Acceptance over the depth of the capture point inside the ground that captures it."""
    limits = checker.options.kinodynamic.centroidal
    rows, notes = [], []
    for motion in ("stay", "foot"):
        depths, captured, allowance = [], [], np.inf
        for seed in range(2 * options.seeds):
            question = level_question(seed, checker, motion)
            depths.append(pendulum_depth(question, checker))
            captured.append(checker.check(question).captured)
            allowance = min(allowance, angular_allowance(limits, checker.robot.mass, frequency(question.com[2])))
        depth, taken = np.array(depths), np.array(captured)
        options.tell(f"level ground, {motion}: {taken.sum()} of {len(taken)} captured")
        bins = [(depth > low) & (depth <= high) for low, high in pairwise(DEPTHS)]
        worst = -float(depth[taken].min()) if taken.any() else np.nan
        inside = depth > WELL_INSIDE
        recall = f"{int(taken[inside].sum())} of {int(inside.sum())}"
        rows.append(
            (motion, len(taken), *(f"{int(taken[b].sum())} of {int(b.sum())}" for b in bins), worst, allowance, recall)
        )
        wrong = int((taken & (depth < -allowance)).sum())
        notes.append(f"{motion}: {wrong} accepted beyond the allowance")
    edges = [f"{1e2 * edge:g}" for edge in DEPTHS[1:-1]]
    names = [f"under {edges[0]} cm", *(f"to {edge}" for edge in edges[1:]), f"over {edges[-1]}"]
    columns = ("motion", "questions", *names, "farthest accepted outside m",
               "allowance m", f"accepted over {1e2 * WELL_INSIDE:g} cm inside")  # fmt: skip
    notes.insert(
        0,
        "Columns of depths: accepted of those whose capture point lies so deep inside the ground from which the linear "
        "inverted pendulum is captured (the support, or Koolen et al. 2012's one-step region); the allowance is "
        "|kdot|max / (M g) + omega |k|max / (M g).",
    )
    title = "Capture on level ground against the linear inverted pendulum"
    return BenchTable("capture_pendulum", title, columns, tuple(rows), tuple(notes), "capture", most_seeds=None)


def level_question(seed: int, checker: CaptureChecker, motion: str) -> CaptureQuestion:
    """A question on level ground; every other one with a level and smaller momentum, as the pendulum has.

    Args:
        seed: of the random question.
        checker: whose robot the question is for.
        motion: one of `CAPTURE_MOTIONS`.
    """
    rng = np.random.default_rng((seed, CAPTURE_MOTIONS.index(motion)))
    question = random_question(rng, checker.robot, motion, level=True)
    if seed % 2:
        return question
    return replace(question, linear_momentum=0.5 * question.linear_momentum * [1.0, 1.0, 0.0])


def pendulum_depth(question: CaptureQuestion, checker: CaptureChecker) -> float:
    """How deep the capture point lies inside the ground that captures, over all swing times; negative outside [m].

    Args:
        question: on level ground.
        checker: its robot and swing times.
    """
    omega = frequency(question.com[2])
    point = capture_point(question.com, question.linear_momentum / checker.robot.mass)
    before = support_polygon(question.swing_stance, checker.robot)
    if question.new_contact is None:
        return depth_inside(before, point)
    after = support_polygon(question.final_stance, checker.robot)
    times = checker.options.swing_times
    return max(depth_inside(one_step_region(before, after, swing, omega), point) for swing in times)
