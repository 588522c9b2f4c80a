"""The campaign that plans crossings of random environments, for a library of plans (Lin 2020 sec. 4.6, 5.8.1).

A task is one environment of randomly tilted surfaces, level or rising like stairs, and one search in it from scratch with
quasi-static dynamics. The motion mode, which palms the feet should not move without, goes round with the task's number. The
row is the plan as a library stores it, of whatever mode came out; a task without a verified plan has none.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import pyarrow as pa

from drakeplan.campaigns.campaign import Row
from drakeplan.campaigns.campaign_robot import campaign_robot
from drakeplan.experience.stored_plan import MODE_PALMS, store_plan
from drakeplan.query.options import PlanOptions
from drakeplan.query.planning import plan_scene
from scenes.input_error import InputError
from scenes.library.random_surfaces import crossing
from scenes.scene import Scene

LENGTH = (0.8, 4.2)  # [m] of the rubble; queries cut plans where they need less
SLOPES = (-0.3, 0.3)  # rise per metre of those environments that are no level
LEVEL_SHARE = 0.6  # of environments
WALLS = {"feet": (), "left_palm": ("left",), "right_palm": ("right",), "all": ("right", "left")}
ROUND = (
    "feet",
    "left_palm",
    "right_palm",
    "all",
    "left_palm",
    "right_palm",
    "all",
    "all",
)  # palms are found less often
NO_CLOCK = 300.0  # [s] deadline of a query that a budget of expansions ends
SCHEMA = pa.schema(
    [
        pa.field("task", pa.int64(), nullable=False),
        pa.field("name", pa.string(), nullable=False),
        pa.field("mode", pa.string(), nullable=False),
        pa.field("length", pa.float64(), nullable=False),
        pa.field("plan", pa.binary(), nullable=False),
    ]
)


@dataclass(frozen=True)
class PlansCampaign:
    """Plans of one robot.

    Attributes:
        robot: its name.
        friction: of every surface; 0.5 in the documents.
        expansions: of each search.
        packages: names and folders of package:// addresses in the robot's model.
    """

    robot: str = "escher"
    friction: float = 0.5
    expansions: int = 400
    packages: tuple[tuple[str, str], ...] = ()

    @property
    def name(self) -> str:
        return "plans"

    @property
    def version(self) -> int:
        return 1

    @property
    def schema(self) -> pa.Schema:
        return SCHEMA

    @property
    def count_by(self) -> Sequence[str]:
        return ("mode",)

    @property
    def parameters(self) -> Mapping[str, Any]:
        """The robot with its model, and what is asked of the search."""
        robot = campaign_robot(self.robot, self.packages)
        return {
            "robot": robot.name,
            "robot_model_sha256": robot.model_sha256,
            "friction": self.friction,
            "expansions": self.expansions,
            "length": list(LENGTH),
            "slopes": list(SLOPES),
        }

    def rows(self, seed: np.random.SeedSequence, task: int) -> Sequence[Row]:
        """The plan of one environment, none where no plan was verified.

        Args:
            seed: of the task's random numbers.
            task: its number in the campaign.
        """
        mode = ROUND[task % len(ROUND)]
        robot = campaign_robot(self.robot, self.packages)
        options = PlanOptions(
            dynamics="quasi-static",
            friction=self.friction,
            use_palms=mode != "feet",
            lean_on=MODE_PALMS[mode],
            expansions=self.expansions,
            deadline=NO_CLOCK,
        )
        try:
            plan = plan_scene(draw_crossing(np.random.default_rng(seed), mode, task), robot, options).plan
            stored = None if plan is None or plan.motion is None else store_plan(plan)
        except InputError:  # no ground at the start, or a goal that is hardly away from it
            stored = None
        if stored is None:
            return []
        row = {"task": task, "name": stored.name, "mode": stored.mode, "length": stored.outline.length}
        return [{**row, "plan": stored.as_bytes()}]


def draw_crossing(rng: np.random.Generator, mode: str, task: int) -> Scene:
    """A random environment with the walls that a motion mode needs.

    Args:
        rng: source of the draws.
        mode: of `drakeplan.experience.stored_plan.MODES`.
        task: number for its name.
    """
    slope = 0.0 if rng.uniform() < LEVEL_SHARE else float(rng.uniform(*SLOPES))
    scene = crossing(rng, float(rng.uniform(*LENGTH)), slope=slope, walls=WALLS[mode])
    return dataclasses.replace(scene, name=f"crossing_{task}")
