"""Labelled contact transitions as arrays: what the centroidal program said of each, and the scene it was met in."""

from __future__ import annotations

import hashlib
import json
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pyarrow as pa

from learning.shard_file import not_finite, read_shard, schema_lines, shard_name, shard_paths
from learning.transition_batch import TransitionBatch
from learning.transition_features import NUM_CATEGORIES, CanonicalTransitions, canonicalise, relative_features
from learning.transition_labels import CAMPAIGN, SCHEMA, VERSION
from scenes.input_error import InputError

TRAIN, VALIDATION, TEST = range(3)


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
    """

    batch: TransitionBatch
    feasible: np.ndarray
    cost: np.ndarray
    com: np.ndarray
    velocity: np.ndarray
    scene: np.ndarray
    visited: np.ndarray
    source: dict[str, object]

    def __len__(self) -> int:
        return len(self.batch)

    def take(self, rows: np.ndarray) -> LabelledTransitions:
        """These rows of it, by index or mask."""
        return LabelledTransitions(
            self.batch.take(rows), self.feasible[rows], self.cost[rows], self.com[rows], self.velocity[rows],
            self.scene[rows], self.visited[rows], self.source,
        )  # fmt: skip

    @classmethod
    def from_table(cls, table: pa.Table, source: dict[str, object]) -> LabelledTransitions:
        """Rows of the dynamics campaign (`transition_labels.SCHEMA`); what has no outcome counts as infeasible."""
        n = len(table)
        held = _array(table, "held", 4).astype(bool)
        makes = _array(table, "makes").astype(bool)
        friction = np.where(held, _array(table, "friction", 4), np.inf).min(axis=1)
        friction = np.minimum(friction, np.where(makes, _array(table, "friction_new"), np.inf))
        batch = TransitionBatch(
            held, _array(table, "p", 12).reshape(n, 4, 3), _array(table, "R", 36).reshape(n, 4, 3, 3),
            _array(table, "mover").astype(np.int64), makes, _array(table, "p_new", 3),
            _array(table, "R_new", 9).reshape(n, 3, 3), _array(table, "com", 3), _array(table, "velocity", 3), friction,
        )  # fmt: skip
        cost, com, velocity = _array(table, "cost"), _array(table, "final_com", 3), _array(table, "final_velocity", 3)
        known = np.isfinite(cost) & np.isfinite(com).all(axis=1) & np.isfinite(velocity).all(axis=1)
        feasible = _array(table, "feasible").astype(bool) & known
        visited = _array(table, "shift") == "none"
        return cls(batch, feasible, cost, com, velocity, _array(table, "scene").astype(np.int64), visited, source)


@dataclass(frozen=True, eq=False)
class LearningSet:
    """Labels in frame F, as networks learn them.

    Attributes:
        representatives: of the transitions.
        relative: (n, 60) relative features.
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
        """Indices of the rows of one part, and of one category where one is given."""
        chosen = self.part == part
        return np.flatnonzero(chosen if category is None else chosen & (self.representatives.category == category))

    def counts(self, part: int) -> np.ndarray:
        """(10,) rows of each category in one part."""
        return np.bincount(self.representatives.category[self.part == part], minlength=NUM_CATEGORIES)


def split_by_scene(scene: np.ndarray, seed: int, validation: float = 0.1, test: float = 0.1) -> np.ndarray:
    """(n,) TRAIN, VALIDATION or TEST; all rows of one scene fall in one part.

    The part of a scene depends on its number and the seed alone: more data do not move old scenes between parts.
    """
    unique, index = np.unique(scene, return_inverse=True)
    draw = np.array([np.random.default_rng([seed, int(s)]).random() for s in unique])
    part = np.where(draw < test, TEST, np.where(draw < test + validation, VALIDATION, TRAIN))
    return part[index] if len(scene) else np.zeros(0, int)


def learning_set(labels: LabelledTransitions, seed: int = 0) -> LearningSet:
    """Labels brought to their representatives and split by scene; rows of unknown category are left out."""
    c = canonicalise(labels.batch)
    if (c.category < 0).any():
        labels = labels.take(c.category >= 0)
        c = canonicalise(labels.batch)
    yes = labels.feasible.astype(bool)
    com = np.where(yes[:, None], c.points_from_world(np.where(yes[:, None], labels.com, 0.0)), 0.0)
    velocity = np.where(yes[:, None], c.vectors_from_world(np.where(yes[:, None], labels.velocity, 0.0)), 0.0)
    part = split_by_scene(labels.scene, seed)
    return LearningSet(
        c, relative_features(c), yes, np.where(yes, labels.cost, 0.0), com, velocity, part, labels.visited
    )


def read_labels(folder: Path, robot: str) -> LabelledTransitions:
    """The rows of all shards that a dynamics campaign wrote, in order.

    Raises:
        InputError: no shards, damaged ones, shards of several campaigns, columns of another version, numbers that are
            not finite, or labels of another robot.
    """
    if not Path(folder).is_dir():
        raise InputError(f"{folder}: expected a folder of labels")
    paths = shard_paths(folder)
    if not paths:
        raise InputError(f"{folder}: no shards of labels; make some with `drakeplan collect dynamics`")
    tables, fingerprints = [], []
    for path in paths.values():
        header, table = read_shard(path)
        if wrong := sorted(set(_columns(table.schema)) ^ set(_columns(SCHEMA))):
            raise InputError(f"{path}: expected the columns of {CAMPAIGN} version {VERSION}; differs in {wrong[0]!r}")
        if bad := not_finite(table):
            raise InputError(f"{path}: column {bad} holds a number that is not finite")
        fingerprints.append(header.fingerprint)
        if header.fingerprint != fingerprints[0]:
            raise InputError(f"{path}: comes from another campaign than {shard_name(next(iter(paths)))}")
        tables.append(table)
    source = _source(folder, robot) | {"fingerprint": fingerprints[0], "shards": len(tables)}
    sha = hashlib.sha256()
    for path in paths.values():
        sha.update(hashlib.sha256(path.read_bytes()).digest())
    table = pa.concat_tables([t.replace_schema_metadata(None) for t in tables])
    return LabelledTransitions.from_table(table, source | {"rows": len(table), "sha256": sha.hexdigest()})


def _columns(schema: pa.Schema) -> tuple[str, ...]:
    """One line a column; Parquet calls the items of a list elements."""
    return tuple(line.replace("<element:", "<item:") for line in schema_lines(schema))


def _source(folder: Path, robot: str) -> dict[str, object]:
    """What the campaign says of itself, for the card."""
    path = Path(folder) / "campaign.json"
    try:
        facts = json.loads(path.read_text(encoding="utf-8"))
        source = {name: facts[name] for name in ("campaign", "version", "seed", "parameters")}
        theirs = source["parameters"].get("robot")
    except (OSError, ValueError, KeyError, TypeError, AttributeError):
        raise InputError(f"{path}: expected the description of a campaign") from None
    if source["campaign"] != CAMPAIGN or source["version"] != VERSION:
        raise InputError(
            f"{path}: expected campaign {CAMPAIGN} version {VERSION}, got {facts['campaign']} {facts['version']}"
        )
    if theirs != robot:
        raise InputError(f"{path}: these are labels of robot {theirs!r}, expected {robot!r}")
    return source


def _array(table: pa.Table, name: str, width: int = 0) -> np.ndarray:
    """(n,) or (n, width) values of a column; NaN where null."""
    column = table[name].combine_chunks()
    if not width:
        return column.to_numpy(zero_copy_only=False)
    values = np.full((len(column), width), np.nan)
    some = column.is_valid().to_numpy(zero_copy_only=False)
    values[some] = column.drop_null().flatten().to_numpy(zero_copy_only=False).reshape(-1, width)
    return values
