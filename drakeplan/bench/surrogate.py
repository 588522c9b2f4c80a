"""The learned dynamics: how well they predict scenes that they were not trained on, and what a prediction costs.

The errors are those that `drakeplan train dynamics` measured on its test scenes and wrote to the card of the weights
(Lin 2020 fig. 6.10 beside them). The times are measured here: whole expansions, from contact numbers to answers in W.
"""

from __future__ import annotations

import time

import numpy as np

from drakeplan.bench.table import BenchOptions, BenchTable
from learning.fit_report import DOCUMENTED
from learning.surrogate import DynamicsSurrogate, load_surrogate
from learning.transition_batch import TransitionBatch
from learning.transition_features import CATEGORIES
from learning.weights import PRETRAINED
from scenes.contact import contact_rotation
from scenes.effector import EFFECTORS

SIZES = (20, 40, 80)  # children of one expansion
REPEATS = 200
NOMINAL = ((0.0, 0.1, 0.0), (0.0, -0.1, 0.0), (0.2, 0.6, 1.2), (0.2, -0.6, 1.2))  # [m] contact points
NORMALS = ((0.0, 0.0, 1.0), (0.0, 0.0, 1.0), (0.0, -1.0, 0.0), (0.0, 1.0, 0.0))


def run(options: BenchOptions) -> BenchTable:
    """Fig. 6.10 for the weights that come with this robot, and microseconds a transition."""
    surrogate = load_surrogate(options.robot)
    rows = []
    for fit in surrogate.card["measured"]["categories"]:
        k = fit["category"]
        theirs = DOCUMENTED[k] if k >= 0 else (None,) * 5
        row = (
            ("all" if k < 0 else f"{k} {CATEGORIES[k]}", fit["train"], fit["test"], _percent(fit["feasible"]),
             _percent(fit["majority"]), _percent(fit["accuracy"]), _percent(theirs[0]), _percent(fit["balanced"]),
             fit["calibration"], fit["objective"], fit["objective_error"], _percent(_ratio(fit["objective_error"], fit["objective"])),
             _percent(_ratio(theirs[2], theirs[1])), _milli(fit["com_error"]), _milli(theirs[3]), _milli(fit["velocity_error"]),
             _milli(theirs[4]))
        )  # fmt: skip
        rows.append(tuple("-" if cell is None else cell for cell in row))
    columns = ("category", "train", "test", "feasible", "majority", "accuracy", "doc.", "balanced", "ECE", "objective", "error",
               "relative", "doc.", "CoM mm", "doc.", "velocity mm/s", "doc.")  # fmt: skip
    size = sum(f.stat().st_size for f in (PRETRAINED / options.robot).iterdir())
    notes = [
        "Scenes held out whole; errors are mean absolute errors a coordinate of feasible transitions; majority: accuracy of"
        " always saying the more frequent answer. doc.: Lin 2020 fig. 6.10, with 100 000 labels a category.",
        f"Weights and card: {size / 1e6:.1f} MB, {surrogate.card['kind']}.",
        *(_timed(surrogate, n, categories) for categories in (1, 3) for n in SIZES),
    ]
    return BenchTable("surrogate", "Learned centroidal dynamics", columns, tuple(rows), tuple(notes))


def expansion(n: int, num_categories: int, seed: int = 0) -> tuple[TransitionBatch, tuple]:
    """n children of a stance with both feet and the left palm, that moves a foot (and another foot, and the palm)."""
    rng = np.random.default_rng(seed)
    movers = np.arange(n) % num_categories
    effectors = np.concatenate([np.arange(4), movers])
    p = np.array(NOMINAL)[effectors] + rng.uniform(-0.15, 0.15, (n + 4, 3))
    normals = np.array(NORMALS)[effectors] + rng.uniform(-0.2, 0.2, (n + 4, 3))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    R = np.array([contact_rotation(EFFECTORS[e], v, 0.1) for e, v in zip(effectors, normals, strict=True)])
    before = np.array([0, 1, 2, -1])
    after = np.tile(before, (n, 1))
    after[np.arange(n), movers] = 4 + np.arange(n)
    arguments = (p, R, before, after, np.array([0.0, 0.0, 0.9]), np.array([0.1, 0.0, 0.0]), np.full(n + 4, 0.5))
    return TransitionBatch.of_children(*arguments), arguments


def _timed(surrogate: DynamicsSurrogate, n: int, num_categories: int) -> str:
    _, arguments = expansion(n, num_categories)
    surrogate.predict(TransitionBatch.of_children(*arguments))
    spent = []
    for _ in range(REPEATS):
        began = time.perf_counter()
        surrogate.predict(TransitionBatch.of_children(*arguments))
        spent.append(1e6 * (time.perf_counter() - began) / n)
    return (
        f"{n} children of {num_categories} categor{'y' if num_categories == 1 else 'ies'}: {np.median(spent):.1f} us a"
        f" transition (median of {REPEATS}; least {np.min(spent):.1f}), from contact numbers to answers in W, one thread."
    )


def _ratio(a: float | None, b: float | None) -> float | None:
    return None if a is None or not b else a / b


def _percent(value: float | None) -> str:
    return "-" if value is None else f"{100 * value:.1f} %"


def _milli(value: float | None) -> str:
    return "-" if value is None else f"{1e3 * value:.1f}"
