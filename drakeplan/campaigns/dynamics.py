"""The campaign that labels contact transitions with the exact centroidal program (Lin 2020 sec. 6.6).

Lin 2020: Y.-C. Lin, "Learning for Humanoid Multi-Contact Navigation Planning" (dissertation), sec. 6.5, 6.6, fig. 6.4.
Lin et al. 2019: Y.-C. Lin et al., "Efficient humanoid contact planning using learned centroidal dynamics prediction", sec. VII.

A task is one random environment and one walk through it. A row is one transition: the stance before, the contact that is
made, moved or broken, CoM and velocity, all in the scene's W and exact, so that any encoding can be computed from them
and the program asked again; and the answer, feasible or not.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from typing import Any

import numpy as np
import pyarrow as pa

from drakeplan.campaigns.campaign import Row
from drakeplan.campaigns.campaign_robot import campaign_ik, campaign_robot
from drakeplan.campaigns.card import Card
from drakeplan.campaigns.label_walk import Label, LabelWalk, WalkOptions
from drakeplan.campaigns.tilted_environment import GROUNDS, TiltedEnvironment, draw_environment
from drakeplan.timing.step_timing import Timing
from learning.transition_features import CATEGORIES, NUM_CATEGORIES
from learning.transition_labels import CAMPAIGN, SCHEMA, VERSION
from optimization.balance.friction import DEFAULT_CONE, FrictionCone
from optimization.centroidal.options import CentroidalOptions
from optimization.centroidal.transition_dynamics import TransitionDynamics
from scenes.input_error import InputError
from scenes.robots.robot import Robot

FEET_ONLY = 120  # labels of steps in an environment that is crossed without palms
ENVIRONMENT_DRAWS = 20  # terrains on which nobody can stand are drawn again


@dataclass(frozen=True)
class DynamicsCampaign:
    """Labels of contact transitions for one robot.

    Attributes:
        robot: its name.
        friction: of every surface; 0.5 in Lin 2020 sec. 6.7.
        cone: friction cone of the program.
        walk: how each environment is walked through.
        timing: of every transition.
        feet_only: no palms; then an environment gives `FEET_ONLY` labels of steps.
        packages: names and folders of package:// addresses in the robot's model.
    """

    robot: str = "escher"
    friction: float = 0.5
    cone: FrictionCone = DEFAULT_CONE
    walk: WalkOptions = field(default_factory=WalkOptions)
    timing: Timing = field(default_factory=Timing)
    feet_only: bool = False
    packages: tuple[tuple[str, str], ...] = ()

    @property
    def name(self) -> str:
        return CAMPAIGN

    @property
    def version(self) -> int:
        return VERSION

    @property
    def schema(self) -> pa.Schema:
        return SCHEMA

    @property
    def count_by(self) -> Sequence[str]:
        return ("category", "feasible", "ground", "walls", "shift")

    @property
    def parameters(self) -> Mapping[str, Any]:
        """The robot with its model, the walk, and the whole problem that the program solves."""
        robot = campaign_robot(self.robot, self.packages)
        return {
            "robot": robot.name,
            "robot_model_sha256": robot.model_sha256,
            "friction": self.friction,
            "walk": asdict(self._walk),
            "program": _plain(asdict(self._options(robot))),
            **({"feet_only": True} if self.feet_only else {}),
        }

    def rows(self, seed: np.random.SeedSequence, task: int) -> Sequence[Row]:
        """The labels of one environment.

        Args:
            seed: of the task's random numbers.
            task: its number in the campaign.
        """
        rng = np.random.default_rng(seed)
        robot = campaign_robot(self.robot, self.packages)
        for _ in range(ENVIRONMENT_DRAWS):
            environment = draw_environment(rng, self.friction)
            # New for each walk: what a program answers may depend, in the last bits, on what it was asked before.
            dynamics = TransitionDynamics(robot, self._options(robot))
            try:
                ik = campaign_ik(self.robot, self.packages)
                walk = LabelWalk(environment, robot, ik, dynamics, self._walk, rng, palms=not self.feet_only)
            except InputError:
                continue
            return [label_row(label, walk, environment, task) for label in walk.labels()]
        return []

    def _options(self, robot: Robot) -> CentroidalOptions:
        """As the planner asks, but no clock may decide what a label says."""
        return replace(self.timing.options(robot, self.cone), time_limit=1e6)

    @property
    def _walk(self) -> WalkOptions:
        return replace(self.walk, quota=FEET_ONLY, per_state=6) if self.feet_only else self.walk


def label_row(label: Label, walk: LabelWalk, environment: TiltedEnvironment, task: int) -> Row:
    """One row of the data set.

    Args:
        label: one transition with the program's result.
        walk: that the label comes from; it has the contacts by number and the program.
        environment: in which the walk was made.
        task: number of the environment's task.
    """
    pool, state, estimate = walk.pool, label.state, label.estimate
    held = np.array(state.held) >= 0
    p, R, friction = np.zeros((4, 3)), np.tile(np.eye(3), (4, 1, 1)), np.zeros(4)
    for e in np.flatnonzero(held):
        number = state.held[e]
        p[e], R[e], friction[e] = pool.p[number], pool.R[number], pool.friction(number)
    mover = label.child[4]
    made = label.child[mover]
    ends = estimate.trajectory is not None
    com, velocity = walk.dynamics.final_state(estimate) if ends else (None, None)
    lift_com, lift_velocity = walk.dynamics.lift_state(estimate) if ends else (None, None)
    return {
        "scene": task,
        "expansion": label.expansion,
        "ground": environment.ground,
        "walls": environment.walls,
        "steps": environment.steps,
        "shift": label.shift,
        "category": label.category,
        "mirrored": label.mirrored,
        "held": held,
        "p": p.ravel(),
        "R": R.ravel(),
        "friction": friction,
        "mover": mover,
        "makes": made >= 0,
        "p_new": pool.p[made] if made >= 0 else np.zeros(3),
        "R_new": (pool.R[made] if made >= 0 else np.eye(3)).ravel(),
        "friction_new": pool.friction(made) if made >= 0 else 0.0,
        "com": state.com,
        "velocity": state.velocity,
        "feasible": estimate.feasible,
        "reason": estimate.reason,
        "iterations": len(estimate.records),
        "cost": estimate.cost if ends else None,
        "lift_com": lift_com,
        "lift_velocity": lift_velocity,
        "final_com": com,
        "final_velocity": velocity,
    }


def counts_text(card: Card) -> str:
    """A table: labels of each category, how many are feasible, and how many come from which ground."""
    grounds = tuple(GROUNDS)
    kinds = [Counter[str]() for _ in range(NUM_CATEGORIES)]
    for entry in card.counts:
        kind = kinds[entry["category"]]
        kind[entry["ground"]] += entry["rows"]
        kind["feasible"] += entry["rows"] * entry["feasible"]
        kind["all"] += entry["rows"]
    heads = ("category", "labels", "feasible", *grounds)
    rows = [
        (
            name,
            str(kind["all"]),
            f"{100 * kind['feasible'] / max(kind['all'], 1):.1f} %",
            *(str(kind[ground]) for ground in grounds),
        )
        for name, kind in zip(CATEGORIES, kinds, strict=True)
    ]
    width = [max(len(row[k]) for row in (heads, *rows)) for k in range(len(heads))]
    lines = [
        "  ".join([row[0].ljust(width[0]), *(c.rjust(w) for c, w in zip(row[1:], width[1:], strict=True))])
        for row in (heads, *rows)
    ]
    return "\n".join(lines)


def _plain(value: Any) -> Any:
    """The same as JSON would give it back: tuples become lists."""
    if isinstance(value, Mapping):
        return {key: _plain(item) for key, item in value.items()}
    return [_plain(item) for item in value] if isinstance(value, tuple | list) else value
