"""The campaign that pushes one plan at every moment: the engine's workers, progress and resuming serve it (Lin 2020 sec. 7.8).

A task is a few moments in a row; a row is one moment and one impulse. The moments are all that a task depends on, so that a
stopped evaluation goes on with the moments that are missing.
"""

from __future__ import annotations

import hashlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa

from drakeplan.campaigns.campaign import Row, identity
from drakeplan.campaigns.campaign_robot import campaign_robot
from drakeplan.plan.plan import Plan
from drakeplan.plan.plan_file import read_plan
from drakeplan.robustness.moments import Moment, moments_of
from drakeplan.robustness.push_trial import PushTrials
from learning.dataset import read_dataset
from optimization.balance.friction import FrictionCone
from scenes.disturbance import Disturbance, pushes_along
from scenes.effector import EFFECTORS
from scenes.files.scene_file import scene_from_yaml
from scenes.terrain.packed_terrain import pack_terrain

NAME, VERSION = "push-trials", 1
BLOCK = 5  # moments of a task
_REAL = pa.float64()
SCHEMA = pa.schema(
    [
        pa.field("moment", pa.int32(), nullable=False),
        pa.field("impulse", pa.list_(_REAL, 3), nullable=False),  # [kg m/s]
        pa.field("probability", _REAL, nullable=False),  # within 0.1 s
        pa.field("captured", pa.int8(), nullable=False),  # of `drakeplan.robustness.push_trial`
        pa.field("effector", pa.int8(), nullable=False),  # that made the new contact, -1 for none
        pa.field("p_new", pa.list_(_REAL, 3), nullable=False),  # [m], 0 for none
        pa.field("asked", pa.int32(), nullable=False),  # exact questions
        pa.field("reason", pa.string(), nullable=False),
    ]
)


@dataclass(frozen=True)
class PushTrialsCampaign:
    """Pushes of one plan.

    Attributes:
        plan: path of the plan file.
        sha256: of that file.
        robot: name or file.
        disturbances: (n,) impulses, probability, box and pose of each region, as `region_of` writes them.
        samples: capture poses that are tried at most for each push.
        pairs: share of the moments and impulses that are tried, drawn at random; 1 for all.
        palms: whether palms may catch the robot.
        packages: names and folders of package:// addresses in the robot's model.
    """

    plan: str
    sha256: str
    robot: str
    disturbances: tuple[tuple[Any, ...], ...]
    samples: int
    pairs: float = 1.0
    palms: bool = True
    packages: tuple[tuple[str, str], ...] = ()

    @property
    def name(self) -> str:
        return NAME

    @property
    def version(self) -> int:
        return VERSION

    @property
    def schema(self) -> pa.Schema:
        return SCHEMA

    @property
    def count_by(self) -> Sequence[str]:
        return ("captured",)

    @property
    def parameters(self) -> Mapping[str, Any]:
        """The plan's bytes, the pushes and what is tried."""
        return {
            "plan_sha256": self.sha256,
            "disturbances": [list(d) for d in self.disturbances],
            "samples": self.samples,
            "pairs": self.pairs,
            "palms": self.palms,
        }

    def mark(self, seed: int) -> str:
        """Eight letters that name what is tried.

        Args:
            seed: of what is drawn.
        """
        return identity(self, seed, 1).fingerprint[:8]

    def num_tasks(self) -> int:
        """How many tasks it has."""
        return -(-len(_moments(self.plan, self.sha256)) // BLOCK)

    def rows(self, seed: np.random.SeedSequence, task: int) -> Sequence[Row]:
        """The pushes at a few moments.

        Args:
            seed: of what is drawn.
            task: its number in the campaign.
        """
        rng = np.random.default_rng(seed)
        plan, moments = _plan(self.plan, self.sha256), _moments(self.plan, self.sha256)
        robot = campaign_robot(self.robot, self.packages)
        packed = pack_terrain(scene_from_yaml(plan.scene_yaml, "the plan", mesh_triangles=plan.triangles).terrain)
        trials = PushTrials(packed, robot, FrictionCone(plan.friction_cone), self.samples, self.palms)
        disturbances = [_region(d) for d in self.disturbances]
        found: list[Row] = []
        for number in range(task * BLOCK, min((task + 1) * BLOCK, len(moments))):
            moment = moments[number]
            (here,) = pushes_along(disturbances, moment.com[None])
            impulses, which = np.unique(here.impulses.reshape(-1, 3), axis=0, return_inverse=True)
            likely = np.bincount(which.ravel(), weights=here.probability, minlength=len(impulses))
            chosen = rng.random(len(impulses)) < self.pairs
            for impulse, probability in zip(impulses[chosen], likely[chosen], strict=True):
                found.append(_row(trials, number, moment, impulse, float(probability)))
        return found


def _row(trials: PushTrials, number: int, moment: Moment, impulse: np.ndarray, probability: float) -> Row:
    trial = trials.ask(moment, impulse)
    return {
        "moment": number,
        "impulse": impulse,
        "probability": probability,
        "captured": trial.captured,
        "effector": -1 if trial.contact is None else EFFECTORS.index(trial.contact.effector),
        "p_new": np.zeros(3) if trial.contact is None else trial.contact.p_WC,
        "asked": trial.asked,
        "reason": trial.reason,
    }


def region_of(disturbance: Disturbance) -> tuple[Any, ...]:
    """A disturbance as plain values, that pickle and fit JSON.

    Args:
        disturbance: of a scene.
    """
    pose = None if disturbance.X_WR is None else tuple(map(tuple, disturbance.X_WR.tolist()))
    impulses = tuple(map(tuple, disturbance.impulses.tolist()))
    return impulses, disturbance.probability, disturbance.box_size, pose


def _region(values: tuple[Any, ...]) -> Disturbance:
    impulses, probability, box, pose = values
    return Disturbance(np.array(impulses), probability, box, None if pose is None else np.array(pose))


def file_sha256(path: str | Path) -> str:
    """SHA-256 of a file."""
    return hashlib.sha256(Path(path).read_bytes()).hexdigest()


@lru_cache(maxsize=2)
def _plan(path: str, sha256: str) -> Plan:
    return read_plan(path)


@lru_cache(maxsize=2)
def _moments(path: str, sha256: str) -> list[Moment]:
    return moments_of(_plan(path, sha256))


def read_trials(folder: Path) -> dict[str, np.ndarray]:
    """The columns of a finished campaign of this kind.

    Args:
        folder: that it was collected into.

    Raises:
        InputError: as `learning.dataset.read_dataset`.
    """
    data = read_dataset(folder, campaign=NAME, version=VERSION, schema=SCHEMA)
    return {field.name: data.array(field.name) for field in SCHEMA if field.name != "reason"}


def columns_of(rows: Sequence[Row]) -> dict[str, np.ndarray]:
    """Rows of trials as columns, as `read_trials` gives them.

    Args:
        rows: at least one.
    """
    return {field.name: np.array([row[field.name] for row in rows]) for field in SCHEMA if field.name != "reason"}
