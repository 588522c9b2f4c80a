"""The learned answer to a question of capture, and how sure it is (Lin 2020 sec. 7.6).

    networks = load_capture(robot)                       # those that come with drakeplan
    says = networks.predict(views)                       # `capture_view.CaptureViews`, n questions at once
    says.probability                                     # (n,) that the kino-dynamic program captures, calibrated
    says.spread, says.far                                # (n,) disagreement of the members; outside the training data

Kinds: "documented", a network of its own for each capture motion on the inputs of Lin 2020 fig. 7.3; "ensemble", several
small ones for each motion on symmetric features, whose disagreement says how sure they are (the document's future
work); "spin", the same with the angular momentum as an input.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any, Literal, NamedTuple, get_args

import numpy as np
from numba import njit

from learning.capture_features import DOCUMENTED, NUM_FEATURES, SPIN, documented_features, features
from learning.capture_view import NUM_MOTIONS, STAY, CaptureViews
from learning.network import Mlp
from learning.network_tensors import mlp_tensors, read_mlp
from learning.packed_network import PackedNetwork
from learning.weights import PRETRAINED, NoWeightsError, OtherRobotError, WeightsError, read_weights
from scenes.robots.robot import Robot

CaptureKind = Literal["ensemble", "spin", "documented"]
KINDS = get_args(CaptureKind)
FRICTION_TOLERANCE = 1e-6
WIDEN = 0.05  # share of the training data's range that a question may lie beyond it


def weights_name(kind: str) -> str:
    """Name of the files with the weights of a kind of networks."""
    return f"capture_{kind}"


class CapturePrediction(NamedTuple):
    """What networks say of n questions.

    Attributes:
        probability: (n,) that the robot comes to rest.
        spread: (n,) standard deviation of the members' probabilities.
        far: (n,) bool, outside the training data.
    """

    probability: np.ndarray
    spread: np.ndarray
    far: np.ndarray


@dataclass(frozen=True, eq=False)
class CaptureNetworks:
    """Networks of one kind, their calibration, and where they may be asked.

    Attributes:
        kind: of `KINDS`.
        members: for each capture motion, its networks with one logit each.
        scale, offset: (4,) a and b of each motion: a member's probability is expit(a logit + b).
        low, high: (4, 45) least and greatest feature of the training data, by motion.
        friction: least coefficient in them [-].
        card: what was written beside the weights.
    """

    kind: str
    members: tuple[tuple[Mlp, ...], ...]
    scale: np.ndarray
    offset: np.ndarray
    low: np.ndarray
    high: np.ndarray
    friction: float
    card: dict[str, Any]

    def predict(self, views: CaptureViews) -> CapturePrediction:
        """Answers for n questions about any motions."""
        n = len(views)
        says = CapturePrediction(np.zeros(n), np.zeros(n), np.ones(n, bool))
        for motion in np.unique(views.motion).tolist():
            rows = np.flatnonzero(views.motion == motion)
            mine = views.take(rows)
            x = features(mine)
            inputs = documented_features(mine) if self.kind == "documented" else x
            for part, found in zip(says, self.answer(motion, x, inputs), strict=True):
                part[rows] = found
        return says

    def answer(self, motion: int, x: np.ndarray, inputs: np.ndarray | None = None) -> CapturePrediction:
        """Answers for n questions about one motion.

        Args:
            motion: index into `CAPTURE_MOTIONS`.
            x: (n, 45) features of `capture_features.py`, float32; changed where networks do not know the spin.
            inputs: (n, d) what the networks take; None: x.
        """
        if self.kind != "spin":
            x[:, SPIN] = 0.0
        inputs = x if inputs is None else inputs
        logits = np.empty((len(self.members[motion]), len(x)), np.float32)
        for k, packed in enumerate(self._packed[motion]):
            logits[k] = packed(inputs)[:, 0]
        says = CapturePrediction(np.empty(len(x)), np.empty(len(x)), np.empty(len(x), np.bool_))
        _judge(logits, x, self.scale[motion], self.offset[motion], self.low[motion], self.high[motion], says)
        return says

    @cached_property
    def _packed(self) -> list[list[PackedNetwork]]:
        return [
            [PackedNetwork.of([mlp.weights], [mlp.biases], [mlp.skip]) for mlp in members] for members in self.members
        ]

    def tensors(self) -> dict[str, np.ndarray]:
        """Every array of it by name, to be written."""
        arrays: dict[str, np.ndarray] = {}
        for motion, members in enumerate(self.members):
            for k, mlp in enumerate(members):
                arrays |= mlp_tensors(f"motion{motion}_member{k}", mlp)
        arrays |= {"calibration.scale": self.scale, "calibration.offset": self.offset}
        arrays |= {"range.low": self.low, "range.high": self.high}
        return {name: np.asarray(array, np.float32) for name, array in arrays.items()}


def fit_range(x: np.ndarray, motion: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(4, 45) least and greatest features of each motion, a little wider; without data no question lies between them.

    Args:
        x: (n, 45) features.
        motion: (n,) of each row.
    """
    low, high = np.full((NUM_MOTIONS, NUM_FEATURES), np.inf), np.full((NUM_MOTIONS, NUM_FEATURES), -np.inf)
    for k in range(NUM_MOTIONS):
        mine = x[motion == k]
        if len(mine):
            least, most = mine.min(axis=0), mine.max(axis=0)
            low[k], high[k] = least - WIDEN * (most - least) - 1e-4, most + WIDEN * (most - least) + 1e-4
    return np.minimum(low, 1e9), np.maximum(high, -1e9)


@njit(cache=True)
def _judge(
    logits: np.ndarray,
    x: np.ndarray,
    scale: float,
    offset: float,
    low: np.ndarray,
    high: np.ndarray,
    says: CapturePrediction,
) -> None:
    """Mean and standard deviation of the members' probabilities, and which questions are far."""
    members, n = logits.shape
    for i in range(n):
        total, squares = 0.0, 0.0
        for k in range(members):
            p = 1.0 / (1.0 + np.exp(-(scale * logits[k, i] + offset)))
            total += p
            squares += p * p
        mean = total / members
        says.probability[i] = mean
        says.spread[i] = np.sqrt(max(squares / members - mean * mean, 0.0))
        far = False
        for j in range(x.shape[1]):
            far |= not (low[j] <= x[i, j] <= high[j])
        says.far[i] = far


def load_capture(robot: Robot, kind: str = "ensemble", folder: Path | None = None) -> CaptureNetworks:
    """The networks of this robot, by default those that come with drakeplan.

    Args:
        robot: whose captures.
        kind: of `KINDS`.
        folder: with the weights.

    Raises:
        NoWeightsError: there are none for this robot.
        WeightsError: they are damaged, of another version, of another robot or incomplete.
    """
    place, name = folder or PRETRAINED / robot.name, weights_name(kind)
    try:
        tensors, card = read_weights(place, name)
    except NoWeightsError:
        raise NoWeightsError(
            f"{place / name}.safetensors: robot {robot.name!r} has no learned capture: make weights with "
            f"`drakeplan collect capture --robot {robot.name}` and `drakeplan train capture`"
        ) from None
    path = place / f"{name}.json"
    if card.get("robot_model_sha256") != robot.model_sha256:
        raise OtherRobotError(f"{path}: made for another robot than {robot.name!r} as it is now")
    if card.get("kind") != kind:
        raise WeightsError(f"{path}: networks of kind {card.get('kind')!r}, expected {kind!r}")
    return capture_from(tensors, card, path)


def capture_from(tensors: Mapping[str, np.ndarray], card: dict[str, Any], path: Path) -> CaptureNetworks:
    """The networks that these arrays and this card describe.

    Args:
        tensors: float32 arrays by name.
        card: that was written beside them.
        path: of the card, for messages.

    Raises:
        WeightsError: arrays are missing or have other shapes.
    """
    try:
        members = [_members(tensors, motion, card["kind"]) for motion in range(NUM_MOTIONS)]
        scale, offset = tensors["calibration.scale"], tensors["calibration.offset"]
        low, high = tensors["range.low"], tensors["range.high"]
        friction = float(card["friction"])
    except (KeyError, ValueError, TypeError) as error:
        raise WeightsError(f"{path}: incomplete weights of capture ({error})") from None
    if (
        scale.shape != (NUM_MOTIONS,)
        or offset.shape != scale.shape
        or {low.shape, high.shape} != {(NUM_MOTIONS, NUM_FEATURES)}
    ):
        raise WeightsError(f"{path}: calibration or range of another shape than expected")
    return CaptureNetworks(card["kind"], tuple(members), scale, offset, low, high, friction, card)


def _members(tensors: Mapping[str, np.ndarray], motion: int, kind: str) -> tuple[Mlp, ...]:
    count = len({name.split(".")[0] for name in tensors if name.startswith(f"motion{motion}_member")})
    if not count:
        raise ValueError(f"no network for motion {motion}")
    inputs = DOCUMENTED[motion != STAY] if kind == "documented" else NUM_FEATURES
    return tuple(read_mlp(f"motion{motion}_member{k}", tensors, inputs, 1) for k in range(count))
