"""Where the CoM is and how fast when the moving end effector lifts, learned beside the dynamics of a transition.

A transition's dynamics tell the CoM at its end, a knot after the end effector has landed. What pushes may do is asked while it is in
the air: between lift and end the CoM is taken to follow the cubic through both.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from learning.network import Mlp
from learning.network_tensors import read_mlp
from learning.relative_features import NUM_RELATIVE, RELATIVE_FRAME, relative_feature_names, relative_features
from learning.surrogate import dynamics_fingerprint
from learning.transition_batch import TransitionBatch
from learning.transition_features import canonicalise
from learning.weights import PRETRAINED, NoWeightsError, OtherRobotError, WeightsError, read_weights
from scenes.robots.robot import Robot

OUTPUTS = 6  # CoM from the mean of the feet after the step (3) [m], velocity (3) [m/s], in F


def weights_name(times: tuple[float, float]) -> str:
    """Name of the weight files for transitions with these times of shift and swing [s]."""
    return "lift_off_{:g}_{:g}".format(*times)


@dataclass(frozen=True, eq=False)
class LiftOff:
    """The state at lift of transitions with one timing.

    Attributes:
        network: on the features of `relative_features.py`.
        card: what was written beside the weights.
    """

    network: Mlp
    card: dict[str, Any]

    def predict(self, batch: TransitionBatch) -> tuple[np.ndarray, np.ndarray]:
        """(n, 3) CoM in W [m] and (n, 3) its velocity [m/s] where the end effector of each transition lifts."""
        c = canonicalise(batch, RELATIVE_FRAME)
        y = self.network(relative_features(c)).astype(float)
        return c.points_to_world(c.feet_after + y[:, :3]), c.vectors_to_world(y[:, 3:])


def load_lift_off(robot: Robot, times: tuple[float, float], folder: Path | None = None) -> LiftOff | None:
    """The network for this robot and timing, None where there is none.

    Args:
        robot: whose transitions.
        times: of shift and swing [s].
        folder: with the weights; None: those that come with drakeplan.

    Raises:
        WeightsError: they are damaged, or of another robot or version.
    """
    place, name = folder or PRETRAINED / robot.name, weights_name(times)
    try:
        tensors, card = read_weights(place, name)
    except NoWeightsError:
        return None
    if card.get("robot_dynamics") != dynamics_fingerprint(robot):
        raise OtherRobotError(f"{place / name}.json: made for another robot than {robot.name!r} as it is now")
    if card.get("features") != list(relative_feature_names()):
        raise WeightsError(f"{place / name}.json: their list of features is not this version's; train them again")
    try:
        return LiftOff(read_mlp("lift", tensors, NUM_RELATIVE, OUTPUTS), card)
    except ValueError as error:
        raise WeightsError(f"{place / name}.json: {error}") from None
