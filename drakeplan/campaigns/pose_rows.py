"""Rows of the traversability campaigns: each torso pose, motion mode and translation with its features and its count."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from drakeplan.campaigns.campaign import Row
from drakeplan.guide.ground_view import GroundView
from drakeplan.guide.useful_footsteps import TorsoPose, UsefulFootsteps
from learning.traversability_labels import MODES


@dataclass(frozen=True)
class PlaceOfPoses:
    """Where torso poses were drawn, as rows say it.

    Attributes:
        scene: number of the environment's task.
        ground: kind of ground.
        walls: none, left, right or both.
    """

    scene: int
    ground: str
    walls: str


def pose_rows(
    place: PlaceOfPoses,
    torso: np.ndarray,
    view: GroundView,
    counter: UsefulFootsteps,
    modes: Sequence[str],
    rng: np.random.Generator,
) -> list[Row]:
    """The rows of some torso poses, counted by the search.

    Args:
        place: where the poses are.
        torso: (n, 4) x, y, z of the ground [m], yaw [rad] in W.
        view: features of this terrain.
        counter: counts useful pairs of feet on it.
        modes: motion modes that are asked for.
        rng: draws the order of palm contacts.
    """
    (feet, pairs), palms, (feet_fit, palms_fit) = view.scores(torso), view.palm_scores(torso), view.exact(torso)
    rows: list[Row] = []
    every = range(len(view.steps.translations))
    for k, pose in enumerate(torso.tolist()):
        for mode in modes:
            useful, count = counter.count(TorsoPose(*pose), mode, every, rng)
            rows += [
                {
                    "scene": place.scene,
                    "pose": k,
                    "ground": place.ground,
                    "walls": place.walls,
                    "mode": MODES.index(mode),
                    "translation": v,
                    "torso": pose,
                    "foot_scores": feet[k, v],
                    "pair_scores": pairs[k],
                    "palm_scores": palms[k],
                    "feet_fit": feet_fit[k, v],
                    "palms_fit": palms_fit[k],
                    "pairs": count,
                    "useful": useful[v],
                }
                for v in every
            ]
    return rows
