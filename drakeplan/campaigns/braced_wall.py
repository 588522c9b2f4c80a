"""The campaign that counts useful palm steps of `bracer` on random walls (Lin 2020 sec. 5.10): rows as of feet on the ground."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np
import pyarrow as pa

from drakeplan.bracing.bracer import Bracer
from drakeplan.bracing.bracing_check import BracingCheck
from drakeplan.bracing.wall_frame import MODEL, robot_on_wall, transition_model_of_palms, wall_as_ground
from drakeplan.bracing.wall_traversability import palm_steps
from drakeplan.campaigns.campaign import Row
from drakeplan.campaigns.pose_rows import PlaceOfPoses, pose_rows
from drakeplan.contact_planning.contact_pool import ContactPool
from drakeplan.guide.ground_view import GroundView
from drakeplan.guide.useful_footsteps import UsefulFootsteps
from learning.traversability_labels import CAMPAIGN, SCHEMA, VERSION
from scenes.library.braced_ramp import FRICTION_OF_PALMS, WALL_Y, braced_ramp
from scenes.library.plates import rectangle, tilted_plate
from scenes.terrain.packed_terrain import pack_terrain
from scenes.terrain.surface import Surface
from scenes.terrain.terrain import Terrain

LENGTH, HEIGHT = 2.4, (0.3, 1.7)  # [m] of a wall
PANEL = (0.3, 0.8)  # [m] edges of its panels
TILT = np.deg2rad(12.0)
PRESENT = 0.7  # share of panels
POSES = 12  # of the mean of the palms, on each wall


@dataclass(frozen=True)
class BracedWallCampaign:
    """Labels of the bracer's palms on walls.

    Attributes:
        poses: of the mean of the palms on each wall.
    """

    poses: int = POSES

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
        """The robot with its model, its steps, and how many poses a wall has."""
        return {
            "robot": "bracer",
            "robot_model_sha256": robot_on_wall(1.0).model_sha256,
            "transition_model": MODEL,
            "translations": palm_steps(robot_on_wall(1.0)).translations.tolist(),
            "footholds": "fixed",
            "poses": self.poses,
        }

    def rows(self, seed: np.random.SeedSequence, task: int) -> Sequence[Row]:
        """The labels of one wall.

        Args:
            seed: of the task's random numbers.
            task: its number in the campaign.
        """
        rng, bracer = np.random.default_rng(seed), _bracer()
        robot, model = robot_on_wall(bracer.mass), transition_model_of_palms()
        packed, steps = pack_terrain(wall_as_ground(draw_wall(rng))), palm_steps(robot)
        pool = ContactPool(packed)
        check = BracingCheck(pool, braced_ramp(0), bracer)
        counter = UsefulFootsteps(packed, robot, check, model, steps, "fixed")
        torso = np.zeros((self.poses, 4))
        torso[:, 0] = rng.uniform(0.3, LENGTH - 0.3, self.poses)
        torso[:, 1] = rng.uniform(HEIGHT[0] + 0.2, HEIGHT[1] - 0.2, self.poses)
        view = GroundView(packed, robot, steps, model.rays, torso[:, :2].min(axis=0), torso[:, :2].max(axis=0))
        return pose_rows(PlaceOfPoses(task, "wall", "none"), torso, view, counter, ("feet",), rng)


def draw_wall(rng: np.random.Generator) -> Terrain:
    """A wall of tilted panels, some of which are missing.

    Args:
        rng: source of all random choices.
    """
    panels: list[Surface] = []
    x = 0.0
    while x < LENGTH or not panels:
        width, z = float(rng.uniform(*PANEL)), HEIGHT[0]
        while z < HEIGHT[1]:
            height = float(rng.uniform(*PANEL))
            roll, pitch = rng.uniform(-TILT, TILT, 2)
            middle = (x + width / 2, WALL_Y, z + height / 2)
            if rng.uniform() < PRESENT:
                plate = tilted_plate(f"panel_{len(panels)}", middle, rectangle(width, height), np.pi / 2 + roll, pitch)
                panels.append(Surface(plate.name, plate.vertices, FRICTION_OF_PALMS))
            z += height + 0.02
        x += width + 0.02
    return Terrain(tuple(panels))


@lru_cache(maxsize=1)
def _bracer() -> Bracer:
    return Bracer()
