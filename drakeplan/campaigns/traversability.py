"""The campaign that counts useful footsteps about random torso poses (Lin & Berenson 2017 sec. IV.E, alg. 1 and 3; Lin 2020 alg. 4).

A task is one environment of tilted surfaces with walls beside them, and some torso poses in it at any heading. A row is one
pose, one motion mode and one translation of the torso: the features of the ground, and |Gamma+|, counted by the search's own
moves and checks. The environments are those of the dynamics campaign and of the library, half of each.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import pyarrow as pa

from drakeplan.campaigns.campaign import Row
from drakeplan.campaigns.campaign_robot import campaign_ik, campaign_robot
from drakeplan.campaigns.card import Card
from drakeplan.campaigns.pose_rows import PlaceOfPoses, pose_rows
from drakeplan.campaigns.stored_plans import WALLS as CROSSING_WALLS
from drakeplan.campaigns.tilted_environment import draw_environment
from drakeplan.contact_planning.contact_plan import FootholdsName
from drakeplan.contact_planning.contact_pool import ContactPool
from drakeplan.contact_planning.torso_grid import TURNS, TorsoGrid
from drakeplan.contact_planning.transition_check import TransitionCheck
from drakeplan.guide.ground_view import GroundView, documented_steps
from drakeplan.guide.useful_footsteps import UsefulFootsteps
from learning.traversability_labels import CAMPAIGN, MODES, SCHEMA, VERSION
from optimization.balance.friction import DEFAULT_CONE, FrictionCone
from scenes.library.random_surfaces import GROUND_DENSITY, crossing
from scenes.robots.robot import Robot
from scenes.scene import Goal
from scenes.terrain.packed_terrain import PackedTerrain, pack_terrain
from scenes.terrain.terrain import Terrain

CROSSINGS = 0.5  # share of environments that are quadrilaterals across each other
DENSITY = (1.5, GROUND_DENSITY)  # of those, per square metre of ground
LENGTH = 3.0  # [m] of those
DRAWN, HOPELESS = 6, 0.1  # poses drawn for each that is taken; weight of those about which hardly any feet fit
FARTHEST = 6.0  # [m] from the far end of the ground that poses are drawn in


@dataclass(frozen=True)
class TraversabilityCampaign:
    """Labels of torso poses for one robot.

    Attributes:
        robot: its name.
        friction: of every surface; 0.5 in Lin 2020 sec. 6.7.
        cone: friction cone of the checks.
        footholds: whether feet and palms move to the nearest foothold ("snapped"), or are lost ("fixed", as in Lin & Berenson 2017).
        poses: of the torso in each environment.
        packages: names and folders of package:// addresses in the robot's model.
    """

    robot: str = "escher"
    friction: float = 0.5
    cone: FrictionCone = DEFAULT_CONE
    footholds: FootholdsName = "snapped"
    poses: int = 6
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
        return ("mode", "ground")

    @property
    def parameters(self) -> Mapping[str, Any]:
        """The robot with its model, its steps, and what is asked of a step."""
        robot = campaign_robot(self.robot, self.packages)
        model, steps = documented_steps(robot)
        return {
            "robot": robot.name,
            "robot_model_sha256": robot.model_sha256,
            "transition_model": model.name,
            "translations": steps.translations.tolist(),
            "friction": self.friction,
            "cone": str(self.cone),
            "footholds": self.footholds,
            "poses": self.poses,
        }

    def rows(self, seed: np.random.SeedSequence, task: int) -> Sequence[Row]:
        """The labels of one environment.

        Args:
            seed: of the task's random numbers.
            task: its number in the campaign.
        """
        rng = np.random.default_rng(seed)
        robot = campaign_robot(self.robot, self.packages)
        terrain, far, ground, walls = _draw(rng, self.friction)
        packed = pack_terrain(terrain)
        torso = _draw_poses(rng, packed, robot, far, DRAWN * self.poses)
        if not len(torso):
            return []
        model, steps = documented_steps(robot)
        low, high = torso[:, :2].min(axis=0), torso[:, :2].max(axis=0)
        view = GroundView(packed, robot, steps, model.rays, low, high, self.footholds)
        torso = torso[_choose(rng, view.scores(torso)[1], self.poses)]
        ik = campaign_ik(self.robot, self.packages)
        check = TransitionCheck(ContactPool(packed), robot, ik, packed, self.cone)
        counter = UsefulFootsteps(packed, robot, check, model, steps, self.footholds)
        return pose_rows(PlaceOfPoses(task, ground, walls), torso, view, counter, MODES, rng)


def counts_text(card: Card) -> str:
    """A table: labels of each motion mode, and how many come from which ground."""
    grounds = sorted({str(entry["ground"]) for entry in card.counts})
    kinds = [Counter[str]() for _ in MODES]
    for entry in card.counts:
        kinds[entry["mode"]][entry["ground"]] += entry["rows"]
    lines = ["  ".join(["mode      ", "   labels", *(ground.rjust(10) for ground in grounds)])]
    for name, kind in zip(MODES, kinds, strict=True):
        total = sum(kind.values())
        lines.append("  ".join([name.ljust(10), f"{total:9d}", *(f"{kind[ground]:10d}" for ground in grounds)]))
    return "\n".join(lines)


def _draw(rng: np.random.Generator, friction: float) -> tuple[Terrain, np.ndarray, str, str]:
    """A random terrain, (3,) a place at its far end [m], its kind of ground and its walls."""
    if rng.uniform() >= CROSSINGS:
        environment = draw_environment(rng, friction)
        return environment.terrain, np.array(environment.goal.xyz), environment.ground, environment.walls
    walls = {"feet": "none", "left_palm": "left", "right_palm": "right", "all": "both"}
    mode = MODES[int(rng.integers(len(MODES)))]
    scene = crossing(rng, LENGTH, density=float(rng.uniform(*DENSITY)), walls=CROSSING_WALLS[mode])
    assert scene.goal is not None
    return scene.terrain, np.array(scene.goal.xyz), "crossing", walls[mode]


def _choose(rng: np.random.Generator, pairs: np.ndarray, count: int) -> np.ndarray:
    """(n,) poses at random, few of those about which no feet fit: of most random poses nothing is to be learned."""
    weight = np.where(pairs > 0.5, 1.0, HOPELESS)
    return rng.choice(len(pairs), size=min(count, len(pairs)), replace=False, p=weight / weight.sum())


def _draw_poses(
    rng: np.random.Generator, packed: PackedTerrain, robot: Robot, far: np.ndarray, count: int
) -> np.ndarray:
    """(n, 4) x, y, z of the ground [m] and yaw [rad] where the torso may be, at most so many."""
    grid = TorsoGrid(packed, robot, Goal((float(far[0]), float(far[1]), np.nan), radius=0.6))
    grid.grow(FARTHEST)
    cells, _, _ = grid.settled_nodes()
    places, _, _ = grid.settled_places()
    if not len(cells):
        return np.empty((0, 4))
    chosen = rng.integers(len(cells), size=count)
    return np.column_stack([places[chosen], 2 * np.pi * cells[chosen, 2] / TURNS])
