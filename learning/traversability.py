"""Weights of the regressors of useful footsteps, and the traversability cost that they give (Lin 2020 sec. 5.5).

Delta g_tr = exp(-|Gamma+|)        0 where there are many useful footsteps, 1 where there are none
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from learning.footstep_counts import FootstepCounts, NetworkRegressor, PoseFeatures, RowRegressor
from learning.weights import PRETRAINED, NoWeightsError, OtherRobotError, WeightsError, read_weights
from scenes.robots.robot import Robot

# ours, for feet that move to the nearest foothold and for fixed steps; those of Lin & Berenson 2017, for fixed steps:
# approximate and exact contact checking with support vector regression and nearest neighbours
KINDS = ("network", "network-fixed", "acc-svr", "acc-nearest", "ecc-svr", "ecc-nearest")

PREDICTS = ("|Gamma+|", "exp(-|Gamma+|)")  # what row regressors and networks give, as their cards say it


def weights_name(kind: str) -> str:
    """Name of the files with the weights of a kind of regressor."""
    return "traversability_" + kind.replace("-", "_")


class Traversability:
    """Traversability costs of torso poses for one robot.

    Attributes:
        kind: of regressor.
        translations: (V, 2) of the torso, in cells, that costs are given for.
        footholds: whether the steps that it was trained on move to the nearest foothold ("snapped") or not ("fixed").
        card: what is known of the weights.
    """

    def __init__(self, kind: str, regressor: FootstepCounts, card: dict[str, Any]) -> None:
        """Keeps the regressor.

        Args:
            kind: of `KINDS`.
            regressor: of that kind.
            card: what is known of the weights.
        """
        self.kind, self.card, self._regressor = kind, card, regressor
        self.translations = np.array(card["translations"])
        self.footholds = card["footholds"]

    @property
    def exact(self) -> bool:
        """Whether the features are those of exact contact checking."""
        return self.kind.startswith("ecc")

    def costs(self, mode: int, seen: PoseFeatures) -> np.ndarray:
        """(n, V) Delta g_tr in [0, 1] by translation.

        Args:
            mode: number of the motion mode in `learning.traversability_labels.MODES`.
            seen: features of n poses.
        """
        return np.exp(-self._regressor.counts(mode, seen))


def load_traversability(
    robot: Robot, transition_model: str, kind: str = "network", folder: Path | None = None
) -> Traversability:
    """The traversability costs of this robot with this transition model, by default those that come with drakeplan.

    Args:
        robot: whose feet and palms.
        transition_model: name of the model of its steps.
        kind: of regressor.
        folder: with the weights.

    Raises:
        NoWeightsError: there are none for this robot.
        WeightsError: they are damaged, of another version, of another robot or of another transition model.
    """
    place, name = folder or PRETRAINED / robot.name, weights_name(kind)
    try:
        tensors, card = read_weights(place, name)
    except NoWeightsError:
        raise NoWeightsError(
            f"{place / name}.safetensors: robot {robot.name!r} has no such traversability weights: make some with "
            f"`drakeplan collect traversability --robot {robot.name}` and `drakeplan train traversability`"
        ) from None
    path = place / f"{name}.json"
    if card.get("robot_model_sha256") != robot.model_sha256:
        raise OtherRobotError(f"{path}: made for another robot than {robot.name!r} as it is now")
    if card.get("transition_model") != transition_model:
        raise WeightsError(
            f"{path}: made for the transition model {card.get('transition_model')!r}, expected {transition_model!r}"
        )
    if card.get("predicts") != PREDICTS[kind.startswith("network")]:
        raise WeightsError(
            f"{path}: predicts {card.get('predicts')!r}, expected {PREDICTS[kind.startswith('network')]!r}"
        )
    try:
        network = kind.startswith("network")
        regressor = NetworkRegressor.of(tensors) if network else RowRegressor.of(kind.split("-")[1], tensors)
        return Traversability(kind, regressor, card)
    except (KeyError, TypeError) as error:
        raise WeightsError(f"{path}: incomplete weights, {error} is missing") from None
