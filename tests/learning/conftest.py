"""Toy transitions: random contacts of all ten categories, with outcomes in closed form, so that training can be tested."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pyarrow as pa
import pytest

from learning.labelled_transitions import LabelledTransitions
from learning.shard_file import ShardHeader, encode_shard, shard_name
from learning.transition_batch import TransitionBatch
from learning.transition_features import canonicalise
from learning.transition_labels import CAMPAIGN, SCHEMA, VERSION
from scenes.pose import rpy_rotation

# palms held before (left, right), mover, whether it makes a contact: the ten categories, palm on the left
KINDS = (
    ((0, 0), 0, 1), ((0, 0), 2, 1), ((1, 0), 0, 1), ((1, 0), 1, 1), ((1, 0), 2, 0),
    ((1, 0), 2, 1), ((1, 0), 3, 1), ((1, 1), 0, 1), ((1, 1), 2, 0), ((1, 1), 2, 1),
)  # fmt: skip
POSTURE = np.array([[0.0, 0.1, 0.0], [0.0, -0.1, 0.0], [0.2, 0.6, 1.2], [0.2, -0.6, 1.2]])  # [m]
PALM = np.array([[[0, 0, 1.0], [-1, 0, 0], [0, -1, 0]], [[0, 0, 1], [1, 0, 0], [0, 1, 0]]]).transpose(0, 2, 1)


def _toy_batch(n: int, rng: np.random.Generator, categories: tuple[int, ...]) -> TransitionBatch:
    held, makes, mover = np.ones((n, 4), bool), np.zeros(n, bool), np.zeros(n, int)
    for i, k in enumerate(rng.choice(categories, n)):
        palms, m, makes[i] = KINDS[k]
        flip = int(rng.integers(2))
        held[i, 2:] = palms[::-1] if flip else palms
        mover[i] = m ^ flip
    p = POSTURE + rng.uniform(-0.15, 0.15, (n, 4, 3))
    R = np.zeros((n, 4, 3, 3))
    for i in range(n):
        for e in range(4):
            tilt = rpy_rotation([*rng.uniform(-0.3, 0.3, 2), rng.uniform(-0.4, 0.4)])
            R[i, e] = tilt @ (np.eye(3) if e < 2 else PALM[e - 2])
    p_new, R_new = np.zeros((n, 3)), np.zeros((n, 3, 3))
    for i in range(n):
        p_new[i] = p[i, mover[i]] + rng.uniform(-0.2, 0.2, 3)
        R_new[i] = R[i, mover[i]] @ rpy_rotation(rng.uniform(-0.2, 0.2, 3))
    com, velocity = rng.uniform([-0.1, -0.1, 0.85], [0.1, 0.1, 1.0], (n, 3)), rng.uniform(-0.3, 0.3, (n, 3))
    for i in range(n):  # anywhere in the world, and turned any way
        turn, shift = rpy_rotation([0, 0, rng.uniform(-np.pi, np.pi)]), rng.uniform(-3, 3, 3)
        p[i], R[i], p_new[i], R_new[i] = p[i] @ turn.T + shift, turn @ R[i], turn @ p_new[i] + shift, turn @ R_new[i]
        com[i], velocity[i] = turn @ com[i] + shift, turn @ velocity[i]
    return TransitionBatch(held, p, R, mover, makes, p_new, R_new, com, velocity, np.full(n, 0.5))


@pytest.fixture(scope="session")
def toy_labels() -> Callable[..., LabelledTransitions]:
    """toy_labels(n, seed, categories): feasible where the CoM heads for the feet after; outcomes are smooth functions."""

    def make(n: int, seed: int = 0, categories: tuple[int, ...] = tuple(range(10))) -> LabelledTransitions:
        rng = np.random.default_rng(seed)
        batch = _toy_batch(n, rng, categories)
        c = canonicalise(batch)
        heads_for = c.com[:, :2] + 0.3 * c.velocity[:, :2] - c.feet_after[:, :2]
        feasible = np.linalg.norm(heads_for, axis=1) < 0.11
        cost = 20.0 + 400.0 * np.sum(heads_for**2, axis=1) + 10.0 * c.category
        com = c.points_to_world(c.feet_after + [0.0, 0.0, 0.95] + 0.3 * np.pad(heads_for, ((0, 0), (0, 1))))
        velocity = c.vectors_to_world(0.5 * c.velocity)
        scene = rng.integers(0, 200, n)
        source = {"fingerprint": "toy", "seed": seed}
        return LabelledTransitions(batch, feasible, cost, com, velocity, scene, np.ones(n, bool), source)

    return make


def _as_table(labels: LabelledTransitions) -> pa.Table:
    """Rows as the campaign writes them."""
    b, c = labels.batch, canonicalise(labels.batch)
    rows = []
    for i in range(len(labels)):
        outcome = dict.fromkeys(("cost", "lift_com", "lift_velocity", "final_com", "final_velocity"))
        if labels.feasible[i]:
            outcome = {"cost": labels.cost[i], "lift_com": labels.com[i], "lift_velocity": labels.velocity[i]}
            outcome |= {"final_com": labels.com[i], "final_velocity": labels.velocity[i]}
        rows.append(
            {
                "scene": labels.scene[i], "expansion": 0, "ground": "tilted", "walls": "none", "steps": "dense",
                "shift": "none" if labels.visited[i] else "small", "category": c.category[i], "mirrored": c.mirrored[i],
                "held": b.held[i], "p": b.p[i].ravel(), "R": b.R[i].ravel(),
                "friction": np.where(b.held[i], b.friction[i], 0.0), "mover": b.mover[i], "makes": b.makes[i],
                "p_new": b.p_new[i], "R_new": b.R_new[i].ravel(), "friction_new": b.friction[i] if b.makes[i] else 0.0,
                "com": b.com[i], "velocity": b.velocity[i], "feasible": labels.feasible[i], "reason": "",
                "iterations": 3,
            }
            | outcome
        )  # fmt: skip
    return pa.table({f.name: pa.array([r[f.name] for r in rows], f.type) for f in SCHEMA}, schema=SCHEMA)


def _write_folder(
    folder: Path, tables: list[pa.Table], robot: str = "escher", fingerprints: str = "a", version: int = VERSION
) -> None:
    """A folder of shards as a campaign leaves it."""
    folder.mkdir(exist_ok=True)
    facts = {"campaign": CAMPAIGN, "version": version, "seed": 3, "parameters": {"robot": robot}}
    (folder / "campaign.json").write_text(json.dumps(facts))
    for k, table in enumerate(tables):
        header = ShardHeader(fingerprints[k % len(fingerprints)], k, 1)
        (folder / shard_name(k)).write_bytes(encode_shard(table, header))


@pytest.fixture(scope="session")
def as_table() -> Callable[[LabelledTransitions], pa.Table]:
    """as_table(labels): rows as the campaign writes them."""
    return _as_table


@pytest.fixture(scope="session")
def write_folder() -> Callable[..., None]:
    """write_folder(folder, tables, robot, fingerprints, version): a folder of shards as a campaign leaves it."""
    return _write_folder
