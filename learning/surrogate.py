"""The learned stand-in for the centroidal program of one contact transition (Lin et al. 2019 sec. VII).

    surrogate = load_surrogate("escher")
    says = surrogate.predict(batch)             # a TransitionBatch: every child of an expansion at once
    says.probability, says.feasible             # (n,) of being dynamically feasible; at or above the category's threshold
    says.cost, says.com, says.velocity          # (n,) objective, (n, 3) final CoM in W [m], (n, 3) its velocity [m/s]
    says.far                                    # (n,) outside the training data: ask the exact program instead

A batch is arrays: which end effectors hold contacts before, `p` (n, E, 3) and `R` (n, E, 3, 3) of those, the mover, its
new contact where it makes one, CoM and velocity (`transition_batch.py`). `TransitionBatch.of_children` makes it
from contact numbers, `TransitionBatch.from_stances` from stances.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Hashable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numba import njit

from learning.calibration import TrainingRange
from learning.network import NetworkAnswer, TransitionNetwork
from learning.network_tensors import network_from_tensors, network_tensors
from learning.relative_features import relative_feature_names, relative_features
from learning.transition_batch import TransitionBatch
from learning.transition_features import (
    NUM_CATEGORIES,
    CanonicalTransitions,
    canonicalise,
)
from learning.weights import PRETRAINED, NoWeightsError, OtherRobotError, WeightsError, read_weights
from scenes.robots.robot import Robot, load_robot

FRICTION_TOLERANCE = 1e-6
DOCUMENTED_TIMES = (1.0, 1.0)  # [s] of shift and swing (Lin 2020 sec. 6.7)


class TransitionPrediction(NamedTuple):
    """What a surrogate says of n transitions.

    Attributes:
        probability: (n,) of being dynamically feasible, calibrated; 0 where nothing can be said.
        feasible: (n,) bool, whether it reaches the threshold of its category.
        cost: (n,) objective of the centroidal program [-]; inf where nothing can be said.
        com: (n, 3) final CoM in W [m].
        velocity: (n, 3) final CoM velocity in W [m/s].
        far: (n,) bool, outside the training data in its features, more slippery than they were, of a category without
            training data or unknown, or not finite.
        category: (n,) 0..9 or UNKNOWN.
    """

    probability: np.ndarray
    feasible: np.ndarray
    cost: np.ndarray
    com: np.ndarray
    velocity: np.ndarray
    far: np.ndarray
    category: np.ndarray


class _Thresholds(NamedTuple):
    """Calibration of each category, see `DynamicsSurrogate`."""

    scale: np.ndarray
    offset: np.ndarray
    threshold: np.ndarray


@dataclass(frozen=True, eq=False)
class DynamicsSurrogate:
    """Networks, their calibration, and where they may be asked.

    Attributes:
        network: logit, cost and final CoM state of representatives.
        scale: (10,) a and
        offset: (10,) b of the calibrated probability expit(a logit + b), a category each.
        threshold: (10,) probability from which a transition counts as feasible.
        range: where the training data were.
        friction: least and greatest friction coefficient in them [-].
        card: what was written beside the weights.
    """

    network: TransitionNetwork
    scale: np.ndarray
    offset: np.ndarray
    threshold: np.ndarray
    range: TrainingRange
    friction: tuple[float, float]
    card: dict[str, Any]

    def predict(self, batch: TransitionBatch) -> TransitionPrediction:
        """Answers for every row, in W; nothing is refused, rows that cannot be trusted are `far`."""
        c = canonicalise(batch, self.network.frame)
        prediction = self.predict_canonical(c, relative_features(c))
        if batch.friction is not None:
            # More friction than was learned from allows all that was learned, and more: the answers are on the safe side.
            slippery = batch.friction < self.friction[0] - FRICTION_TOLERANCE
            np.logical_or(prediction.far, slippery, out=prediction.far)
        return prediction

    def predict_canonical(self, c: CanonicalTransitions, relative: np.ndarray) -> TransitionPrediction:
        """The same for representatives and their relative features; friction is not looked at.

        Args:
            c: n representatives, in the network's frame.
            relative: (n, d) their features of `relative_features.py`.
        """
        n = len(c.category)
        says, distance = self.network.answer(c, relative), self.range.distance(relative, c.category)
        prediction = TransitionPrediction(
            probability=np.zeros(n),
            feasible=np.zeros(n, np.bool_),
            cost=np.full(n, np.inf),
            com=np.zeros((n, 3)),
            velocity=np.zeros((n, 3)),
            far=np.ones(n, np.bool_),
            category=c.category,
        )
        _finish(c, says, distance, _Thresholds(self.scale, self.offset, self.threshold), prediction)
        return prediction

    def tensors(self) -> dict[str, np.ndarray]:
        """Every array of it by name, to be written."""
        arrays = network_tensors(self.network)
        arrays |= {"calibration.scale": self.scale, "calibration.offset": self.offset}
        arrays |= {"calibration.threshold": self.threshold, "calibration.friction": np.array(self.friction)}
        arrays |= {"range.mean": self.range.mean, "range.whitening": self.range.whitening}
        return arrays | {"range.limit": self.range.limit}


_LOADED: dict[Hashable, DynamicsSurrogate] = {}  # read once, as long as the files stay what they are


def dynamics_fingerprint(robot: Robot) -> str:
    """SHA-256 over what the dynamics of a transition depend on: mass, patches, reaches, heights and force limits."""
    facts = [robot.mass, robot.half_extents, robot.com_height, robot.com_reach, robot.force_limit]
    return hashlib.sha256(json.dumps([np.asarray(f, float).round(9).tolist() for f in facts]).encode()).hexdigest()


def weights_name(times: tuple[float, float] = DOCUMENTED_TIMES) -> str:
    """Name of the weight files for transitions with these times of shift and swing [s]."""
    return "dynamics" if times == DOCUMENTED_TIMES else "dynamics_{:g}_{:g}".format(*times)


def weights_folder(robot: Robot) -> Path:
    """Where a robot's weights are looked for: beside the user's own robot file, else among those that come with drakeplan."""
    own = own_weights_folder(robot)
    return own if own is not None and own.is_dir() else PRETRAINED / robot.name


def own_weights_folder(robot: Robot) -> Path | None:
    """Where `drakeplan train` puts weights of a user's robot; None for a robot that comes with drakeplan."""
    return robot.source.parent / f"{robot.name}_weights" if robot.given_by_path else None


def load_surrogate(
    robot: str | Robot, folder: Path | None = None, times: tuple[float, float] = DOCUMENTED_TIMES
) -> DynamicsSurrogate:
    """The surrogate of this robot's dynamics, by default that beside its own robot file, or one that comes with drakeplan.

    Args:
        robot: its name, or itself.
        folder: with the weights and their card.
        times: of shift and swing in every transition [s].

    Raises:
        NoWeightsError: there are none for this robot.
        WeightsError: they are damaged, of another version, or of another robot.
    """
    robot = load_robot(robot) if isinstance(robot, str) else robot
    place = folder or weights_folder(robot)
    name = weights_name(times)
    files = [place / f"{name}.{ending}" for ending in ("json", "safetensors")]
    changed = tuple(file.stat().st_mtime_ns if file.is_file() else 0 for file in files)
    key = (place, name, changed, robot.name, dynamics_fingerprint(robot))
    if key not in _LOADED:
        _LOADED[key] = surrogate_from(*_read(robot, place, name, packaged=folder is None), robot)
    return _LOADED[key]


def _read(robot: Robot, place: Path, name: str, *, packaged: bool) -> tuple[dict[str, np.ndarray], dict[str, Any]]:
    try:
        return read_weights(place, name)
    except NoWeightsError:
        if not packaged:
            raise
        _, *times = name.split("_")
        asked = " --shift {} --swing {}".format(*times) if times else ""
        raise NoWeightsError(
            f"robot {robot.name!r} has no learned dynamics{' for' if asked else ''}{asked}: use the exact program (--dynamics "
            f"exact), or make weights with `drakeplan collect dynamics{asked}` and `drakeplan train dynamics`"
        ) from None


def surrogate_from(tensors: dict[str, np.ndarray], card: dict[str, Any], robot: Robot) -> DynamicsSurrogate:
    """The surrogate that these arrays and this card describe.

    Args:
        tensors: float32 arrays by name, as `DynamicsSurrogate.tensors` gives them.
        card: what was written beside them.
        robot: which they have to be of.

    Raises:
        WeightsError: features, shapes or robot do not fit.
    """
    source = f"weights {card.get('name', 'dynamics')!r} of robot {card.get('robot')!r}"
    if card.get("features") != list(relative_feature_names()):
        raise WeightsError(f"{source}: their list of features is not this version's; train them again")
    if card.get("robot") != robot.name or card.get("robot_dynamics") != dynamics_fingerprint(robot):
        raise OtherRobotError(f"{source}: they were trained for another robot than {robot.name!r} as it is now")
    d = len(relative_feature_names())
    shapes = {"calibration.scale": (NUM_CATEGORIES,), "calibration.offset": (NUM_CATEGORIES,),
              "calibration.threshold": (NUM_CATEGORIES,), "calibration.friction": (2,), "range.limit": (NUM_CATEGORIES,),
              "range.mean": (NUM_CATEGORIES, d), "range.whitening": (NUM_CATEGORIES, d, d)}  # fmt: skip
    for key, shape in shapes.items():
        if key not in tensors or tensors[key].shape != shape:
            got = tensors[key].shape if key in tensors else "nothing"
            raise WeightsError(f"{source}: {key}: expected shape {shape}, got {got}")
    try:
        network = network_from_tensors(str(card.get("kind")), tensors)
    except ValueError as error:
        raise WeightsError(f"{source}: {error}") from None
    low, high = tensors["calibration.friction"]
    return DynamicsSurrogate(
        network, tensors["calibration.scale"], tensors["calibration.offset"], tensors["calibration.threshold"],
        TrainingRange(tensors["range.mean"], tensors["range.whitening"], tensors["range.limit"]),
        (float(low), float(high)), card,
    )  # fmt: skip


@njit(cache=True)
def _finish(
    c: CanonicalTransitions,
    says: NetworkAnswer,
    distance: np.ndarray,
    categories: _Thresholds,
    prediction: TransitionPrediction,
) -> None:
    """Fills the prediction; rows of unknown category or with numbers that are not finite keep what they hold.

    As `CanonicalTransitions.points_to_world` does, in one pass: NumPy would take longer for this than for the networks.
    """
    com_F, velocity_F, com, velocity = says.com, says.velocity, prediction.com, prediction.velocity
    scale, offset = categories.scale, categories.offset
    for i in range(len(c.category)):
        k = c.category[i]
        for a in range(3):
            com[i, a] = c.origin[i, a]
        cos, sin, y = c.heading[i, 0], c.heading[i, 1], -1.0 if c.mirrored[i] else 1.0
        total = says.cost[i] + distance[i] + scale[k] * says.logit[i]
        for a in range(3):
            total += com_F[i, a] + velocity_F[i, a]
        if k < 0 or np.isnan(total) or np.isinf(distance[i]):
            continue
        com[i, 0] += cos * com_F[i, 0] - sin * y * com_F[i, 1]
        com[i, 1] += sin * com_F[i, 0] + cos * y * com_F[i, 1]
        com[i, 2] += com_F[i, 2]
        velocity[i, 0] = cos * velocity_F[i, 0] - sin * y * velocity_F[i, 1]
        velocity[i, 1] = sin * velocity_F[i, 0] + cos * y * velocity_F[i, 1]
        velocity[i, 2] = velocity_F[i, 2]
        prediction.cost[i] = says.cost[i]
        prediction.probability[i] = 1.0 / (1.0 + np.exp(-(scale[k] * says.logit[i] + offset[k])))
        prediction.feasible[i] = prediction.probability[i] >= categories.threshold[k]
        prediction.far[i] = distance[i] > 1.0
