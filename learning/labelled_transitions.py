"""Labelled contact transitions as arrays: what the centroidal program said of each, and the scene it was met in."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from learning.dataset import TEST, TRAIN, VALIDATION, Dataset, read_dataset, split_by_scene
from learning.relative_features import RELATIVE_FRAME, relative_features
from learning.transition_batch import TransitionBatch
from learning.transition_features import NUM_CATEGORIES, CanonicalTransitions, Frame, canonicalise
from learning.transition_labels import CAMPAIGN, SCHEMA, VERSION
from scenes.input_error import InputError

__all__ = [
    "TEST",
    "TRAIN",
    "VALIDATION",
    "LabelledTransitions",
    "LearningSet",
    "learning_set",
    "read_labels",
    "split_by_scene",
]


@dataclass(frozen=True, eq=False)
class LabelledTransitions:
    """n transitions and their outcomes, in W.

    Attributes:
        batch: the transitions.
        feasible: (n,) bool.
        cost: (n,) objective; anything where not feasible, like the next two.
        com: (n, 3) final CoM [m].
        velocity: (n, 3) final CoM velocity [m/s].
        scene: (n,) int, equal for transitions of one scene.
        visited: (n,) bool, as the planner met it: CoM and velocity were not shifted at random.
        source: what the data are: fingerprint, seed and parameters of the campaign, as JSON values.
        lift_com: (n, 3) CoM where the end effector lifts [m]; no rows where that is not known.
        lift_velocity: (n, 3) its velocity there [m/s].
    """

    batch: TransitionBatch
    feasible: np.ndarray
    cost: np.ndarray
    com: np.ndarray
    velocity: np.ndarray
    scene: np.ndarray
    visited: np.ndarray
    source: dict[str, object]
    lift_com: np.ndarray = field(default_factory=lambda: np.zeros((0, 3)))
    lift_velocity: np.ndarray = field(default_factory=lambda: np.zeros((0, 3)))

    def __len__(self) -> int:
        return len(self.batch)

    def take(self, rows: np.ndarray) -> LabelledTransitions:
        """These rows of it, by index or mask."""
        return LabelledTransitions(
            self.batch.take(rows), self.feasible[rows], self.cost[rows], self.com[rows], self.velocity[rows],
            self.scene[rows], self.visited[rows], self.source,
            *(lift[rows] if len(lift) else lift for lift in (self.lift_com, self.lift_velocity)),
        )  # fmt: skip

    @classmethod
    def from_dataset(cls, data: Dataset) -> LabelledTransitions:
        """Rows of the dynamics campaign (`transition_labels.SCHEMA`); what has no outcome counts as infeasible."""
        n, array = len(data), data.array
        held, makes = array("held").astype(bool), array("makes").astype(bool)
        friction = np.where(held, array("friction"), np.inf).min(axis=1)
        friction = np.minimum(friction, np.where(makes, array("friction_new"), np.inf))
        batch = TransitionBatch(
            held, array("p").reshape(n, 4, 3), array("R").reshape(n, 4, 3, 3), array("mover").astype(np.int64), makes,
            array("p_new"), array("R_new").reshape(n, 3, 3), array("com"), array("velocity"), friction,
        )  # fmt: skip
        cost, com, velocity = array("cost"), array("final_com"), array("final_velocity")
        known = np.isfinite(cost) & np.isfinite(com).all(axis=1) & np.isfinite(velocity).all(axis=1)
        feasible = array("feasible").astype(bool) & known
        visited = array("shift") == "none"
        return cls(
            batch, feasible, cost, com, velocity, array("scene").astype(np.int64), visited, dict(data.source),
            array("lift_com"), array("lift_velocity"),
        )  # fmt: skip


@dataclass(frozen=True, eq=False)
class LearningSet:
    """Labels in frame F, as networks learn them.

    Attributes:
        representatives: of the transitions.
        relative: (n, d) features of `relative_features.py`.
        feasible: (n,) bool.
        cost: (n,) objective, 0 where not feasible, like the next two.
        com: (n, 3) final CoM in F [m].
        velocity: (n, 3) final velocity in F [m/s].
        part: (n,) TRAIN, VALIDATION or TEST.
        visited: (n,) bool, as the planner met it.
    """

    representatives: CanonicalTransitions
    relative: np.ndarray
    feasible: np.ndarray
    cost: np.ndarray
    com: np.ndarray
    velocity: np.ndarray
    part: np.ndarray
    visited: np.ndarray

    def rows(self, part: int, category: int | None = None) -> np.ndarray:
        """Indices of the rows of one part, and of one category where one is given.

        Args:
            part: TRAIN, VALIDATION or TEST.
            category: 0..9, None for all.
        """
        chosen = self.part == part
        return np.flatnonzero(chosen if category is None else chosen & (self.representatives.category == category))

    def counts(self, part: int) -> np.ndarray:
        """(10,) rows of each category in one part."""
        return np.bincount(self.representatives.category[self.part == part], minlength=NUM_CATEGORIES)


def learning_set(labels: LabelledTransitions, seed: int = 0, frame: Frame = RELATIVE_FRAME) -> LearningSet:
    """Labels brought to their representatives and split by scene; rows of unknown category are left out.

    Args:
        labels: transitions and what the program said of them.
        seed: of the split.
        frame: the frame F of the representatives.
    """
    c = canonicalise(labels.batch, frame)
    if (c.category < 0).any():
        labels = labels.take(c.category >= 0)
        c = canonicalise(labels.batch, frame)
    yes = labels.feasible.astype(bool)
    com = np.where(yes[:, None], c.points_from_world(np.where(yes[:, None], labels.com, 0.0)), 0.0)
    velocity = np.where(yes[:, None], c.vectors_from_world(np.where(yes[:, None], labels.velocity, 0.0)), 0.0)
    part = split_by_scene(labels.scene, seed)
    return LearningSet(
        c, relative_features(c), yes, np.where(yes, labels.cost, 0.0), com, velocity, part, labels.visited
    )


def read_labels(folder: Path, robot: str) -> LabelledTransitions:
    """The rows of all shards that a dynamics campaign wrote, in order.

    Args:
        folder: of the campaign.
        robot: name of the robot that the labels have to be of.

    Raises:
        InputError: as `read_dataset`, or labels of another robot.
    """
    data = read_dataset(folder, campaign=CAMPAIGN, version=VERSION, schema=SCHEMA)
    parameters = data.source["parameters"]
    theirs = parameters.get("robot") if isinstance(parameters, dict) else None
    if theirs != robot:
        raise InputError(f"{folder}: these are labels of robot {theirs!r}, expected {robot!r}")
    return LabelledTransitions.from_dataset(data)
