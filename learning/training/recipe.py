"""From labels to weights: networks, calibration on validation scenes, measurement on test scenes, card."""

from __future__ import annotations

import csv
import io
import json
from collections.abc import Callable
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
from scipy.special import expit

from learning.calibration import fit_platt, fit_training_range, threshold_for_recall
from learning.fit_report import FitReport, fit_report
from learning.labelled_transitions import TEST, TRAIN, VALIDATION, LabelledTransitions, LearningSet, learning_set
from learning.network import DocumentedNetworks, Mlp, SharedNetwork, TransitionNetwork
from learning.palm_networks import NUM_PALMS, PALMS, PalmNetworks
from learning.relative_features import RELATIVE_FRAME, relative_feature_names
from learning.surrogate import DOCUMENTED_TIMES, DynamicsSurrogate, dynamics_fingerprint, weights_name
from learning.training.lesson import Lesson, lessons
from learning.training.lift_off import OPTIONS as LIFT_OPTIONS
from learning.training.lift_off import train_lift_off
from learning.training.options import TrainingOptions
from learning.training.teacher import Taught, teach
from learning.transition_features import NUM_CATEGORIES
from learning.weights import write_weights
from scenes.files.whole_file import write_whole
from scenes.input_error import InputError
from scenes.robots.robot import Robot

CHECKPOINTS, CURVES, REPORT = "checkpoints", "curves.csv", "report.json"


@dataclass(frozen=True, eq=False)
class Progress:
    """One epoch of one network is done.

    Attributes:
        network: its name.
        number: which network this is, from 1.
        networks: how many there are.
        epoch: from 1.
        epochs: how many there are.
        loss: of the training rows.
        validation: of the validation rows, NaN without any.
    """

    network: str
    number: int
    networks: int
    epoch: int
    epochs: int
    loss: float
    validation: float


@dataclass(frozen=True, eq=False)
class Trained:
    """What a training made.

    Attributes:
        path: of the weights.
        surrogate: as it was written.
        report: of the test scenes.
    """

    path: Path
    surrogate: DynamicsSurrogate
    report: FitReport


def train_dynamics(
    labels: LabelledTransitions, robot: Robot, out: Path, options: TrainingOptions, tell: Callable[[Progress], None]
) -> Trained:
    """Trains, calibrates, measures, and writes weights, card, curves and report to `out`.

    A run that was killed is taken up from its last epoch when it is started again with the same data and options, and
    writes the same bytes.

    Args:
        labels: transitions and what the program said of them.
        robot: whose they are.
        out: folder, made where it is missing.
        options: of networks and training.
        tell: called after each epoch.

    Raises:
        InputError: labels of another model of the robot, too few scenes to hold any out, or no feasible transition to learn from.
    """
    if _parameters(labels).get("robot_model_sha256", robot.model_sha256) != robot.model_sha256:
        raise InputError(f"training data: they are of another model of {robot.name!r} than the one here; collect again")
    data = learning_set(labels, options.seed, "heading" if options.kind == "documented" else RELATIVE_FRAME)
    _check(data, options)
    plan = lessons(data, options)
    taught: dict[str, Taught] = {}
    for number, lesson in enumerate(plan, start=1):

        def told(name: str, epoch: int, loss: float, check: float, number: int = number) -> None:
            tell(Progress(name, number, len(plan), epoch, options.epochs, loss, check))

        taught[lesson.name] = teach(lesson, options, out / CHECKPOINTS, told)
    network = _assemble(options, {name: t.mlp for name, t in taught.items()}, plan)
    friction = labels.batch.friction if labels.batch.friction is not None else np.array([0.5])
    card = _card(robot, options, data, labels)
    surrogate = calibrated(network, data, options.recall, (float(friction.min()), float(friction.max())), card)
    report = fit_report(surrogate, data)
    card |= {"measured": report.facts()}
    name = weights_name(_times(labels))
    write_weights(out, name, surrogate.tensors(), card)
    if len(labels.lift_com) and options.kind != "documented":

        def lifted(name: str, epoch: int, loss: float, check: float) -> None:
            tell(Progress(name, len(plan) + 1, len(plan) + 1, epoch, LIFT_OPTIONS.epochs, loss, check))

        train_lift_off(labels, robot, out, _times(labels), options.seed, lifted)
    _write_curves(out / CURVES, taught)
    write_whole(out / REPORT, (json.dumps(report.facts(), indent=1) + "\n").encode())
    return Trained(out / f"{name}.safetensors", surrogate, report)


def calibrated(
    network: TransitionNetwork, data: LearningSet, recall: float, friction: tuple[float, float],
    card: dict[str, Any],
) -> DynamicsSurrogate:  # fmt: skip
    """The surrogate of a network: probabilities, thresholds and limits from the validation scenes.

    Args:
        network: as trained.
        data: representatives and what the program said of them.
        recall: share of the feasible transitions that has to be found, in (0, 1].
        friction: least and greatest coefficient in the labels [-].
        card: what is written beside the weights.
    """
    rows = data.rows(VALIDATION)
    c, truth = data.representatives.take(rows), data.feasible[rows]
    logit = np.asarray(network.answer(c, data.relative[rows]).logit, float)
    scale, offset = np.ones(NUM_CATEGORIES), np.zeros(NUM_CATEGORIES)
    threshold = np.full(NUM_CATEGORIES, 0.5)
    for k in range(NUM_CATEGORIES):
        mine = (c.category == k) & np.isfinite(logit)
        scale[k], offset[k] = fit_platt(logit[mine], truth[mine])
        threshold[k] = threshold_for_recall(expit(scale[k] * logit[mine] + offset[k]), truth[mine], recall)
    seen = data.rows(TRAIN)
    extent = fit_training_range(
        data.relative[seen], data.representatives.category[seen], held_out=(data.relative[rows], c.category)
    )
    a, b, line = (array.astype(np.float32) for array in (scale, offset, np.minimum(threshold, 0.5)))
    return DynamicsSurrogate(network, a, b, line, extent, friction, card)


def _check(data: LearningSet, options: TrainingOptions) -> None:
    if not len(data.feasible):
        raise InputError("training data: no transition of a known category")
    for part, name in ((TRAIN, "train on"), (VALIDATION, "calibrate on"), (TEST, "test on")):
        if not len(data.rows(part)):
            raise InputError(f"training data: too few scenes, none is left to {name}; collect more, some 20 at least")
    if not data.feasible[data.rows(TRAIN)].any():
        raise InputError("training data: no feasible transition among them, so there is no outcome to learn")
    if options.kind == "palms":
        learnt = data.rows(TRAIN)
        palms = PALMS[data.representatives.category[learnt[data.feasible[learnt]]]]
        if len(np.unique(palms)) < NUM_PALMS:
            raise InputError(
                "training data: feasible transitions from stances with no, one and two palms are needed; collect more, or "
                "train with --kind shared"
            )


def _assemble(options: TrainingOptions, mlps: dict[str, Mlp], plan: list[Lesson]) -> TransitionNetwork:
    if options.kind == "documented":
        every = range(NUM_CATEGORIES)
        return DocumentedNetworks(
            tuple(mlps.get(f"classifier{k}") for k in every), tuple(mlps.get(f"regressor{k}") for k in every)
        )
    shared = []
    for first in range(0, len(plan), options.members):
        members = tuple(mlps[lesson.name] for lesson in plan[first : first + options.members])
        low, high = (bound.astype(np.float32) for bound in plan[first].bounds())
        shared.append(SharedNetwork(members, low, high))
    return shared[0] if options.kind == "shared" else PalmNetworks((shared[0], shared[1], shared[2]))


def _card(robot: Robot, options: TrainingOptions, data: LearningSet, labels: LabelledTransitions) -> dict[str, Any]:
    names = {TRAIN: "train", VALIDATION: "validation", TEST: "test"}
    return {
        "about": "learned centroidal dynamics of one contact transition (Lin et al. 2019 sec. VII)",
        "kind": options.kind,
        "robot": robot.name,
        "robot_dynamics": dynamics_fingerprint(robot),
        **_cone(labels),
        "features": list(relative_feature_names()),
        "outputs": "logit, log(objective + 10), final CoM from the feet's mean after in F [m], final velocity in F [m/s]",
        "training": asdict(options),
        "data": labels.source,
        "rows": {name: data.counts(part).tolist() for part, name in names.items()},
        "feasible": {name: _feasible(data, part) for part, name in names.items()},
    }


def _times(labels: LabelledTransitions) -> tuple[float, float]:
    """Times of shift and swing that the labels are for [s]."""
    program = _parameters(labels).get("program")
    if not isinstance(program, dict) or "shift_time" not in program:
        return DOCUMENTED_TIMES
    return float(program["shift_time"]), float(program["swing_time"])


def _cone(labels: LabelledTransitions) -> dict[str, Any]:
    """The friction cone that the labels are for, where the campaign says so."""
    program = _parameters(labels).get("program")
    return {"cone": program["cone"]} if isinstance(program, dict) and "cone" in program else {}


def _parameters(labels: LabelledTransitions) -> dict[str, Any]:
    parameters = labels.source.get("parameters")
    return parameters if isinstance(parameters, dict) else {}


def _feasible(data: LearningSet, part: int) -> list[int]:
    yes = (data.part == part) & data.feasible
    return np.bincount(data.representatives.category[yes], minlength=NUM_CATEGORIES).tolist()


def _write_curves(path: Path, taught: dict[str, Taught]) -> None:
    text = io.StringIO()
    writer = csv.writer(text)
    writer.writerow(["network", "epoch", "training_loss", "validation_loss"])
    for name, one in taught.items():
        writer.writerows([name, k, *map(repr, losses)] for k, losses in enumerate(one.curve, start=1))
    write_whole(path, text.getvalue().encode())
