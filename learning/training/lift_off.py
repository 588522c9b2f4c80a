"""Trains the network of the state at lift on a dynamics campaign's labels (see `learning.lift_off`)."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

import numpy as np

from learning.labelled_transitions import TEST, TRAIN, VALIDATION, LabelledTransitions, learning_set
from learning.lift_off import OUTPUTS, LiftOff, weights_name
from learning.network_tensors import mlp_tensors
from learning.relative_features import RELATIVE_FRAME, relative_feature_names
from learning.surrogate import dynamics_fingerprint
from learning.training.lesson import Lesson
from learning.training.options import TrainingOptions
from learning.training.teacher import teach
from learning.transition_features import canonicalise
from learning.weights import write_weights
from scenes.robots.robot import Robot

OPTIONS = TrainingOptions(kind="shared", width=128, depth=3, epochs=40, jitter=0.02)


def train_lift_off(
    labels: LabelledTransitions,
    robot: Robot,
    out: Path,
    times: tuple[float, float],
    seed: int,
    tell: Callable[[str, int, float, float], None],
) -> LiftOff:
    """Trains, measures on the scenes that were held out, and writes weights and card to `out`.

    Args:
        labels: with states at lift.
        robot: whose they are.
        out: folder.
        times: of shift and swing in the labels [s].
        seed: of the split, the initial weights and the order of the rows.
        tell: called after each epoch.
    """
    options = replace(OPTIONS, seed=seed)
    known = np.isfinite(labels.lift_com).all(axis=1) & np.isfinite(labels.lift_velocity).all(axis=1) & labels.feasible
    labels = labels.take(known & (canonicalise(labels.batch).category >= 0))
    data = learning_set(labels, seed, RELATIVE_FRAME)
    c = data.representatives
    y = np.concatenate(
        [c.points_from_world(labels.lift_com) - c.feet_after, c.vectors_from_world(labels.lift_velocity)], axis=1
    ).astype(np.float32)
    train, check, test = (data.rows(part) for part in (TRAIN, VALIDATION, TEST))
    lesson = Lesson(
        "lift", data.relative[train], data.feasible[train], y[train], data.relative[check], data.feasible[check], y[check],
        classifies=False, skip=True,
    )  # fmt: skip
    network = teach(lesson, options, out / "checkpoints", tell).mlp
    off = network(data.relative[test])[:, :OUTPUTS] - y[test]
    card: dict[str, Any] = {
        "about": "CoM and velocity at lift of a transition, beside its learned dynamics",
        "robot": robot.name,
        "robot_dynamics": dynamics_fingerprint(robot),
        "times": list(times),
        "features": list(relative_feature_names()),
        "training": asdict(options),
        "data": labels.source,
        "measured": {
            "test": len(test),
            "com_distance": float(np.linalg.norm(off[:, :3], axis=1).mean()) if len(test) else None,
            "velocity_distance": float(np.linalg.norm(off[:, 3:], axis=1).mean()) if len(test) else None,
        },
    }
    write_weights(out, weights_name(times), mlp_tensors("lift", network), card)
    return LiftOff(network, card)
