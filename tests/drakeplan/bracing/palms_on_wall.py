"""Palms set down on the wall of a braced ramp by hand, for the tests."""

from __future__ import annotations

import numpy as np

from drakeplan.bracing.bracer import Bracer
from drakeplan.bracing.bracing_check import BracingCheck
from drakeplan.bracing.wall_frame import robot_on_wall, wall_as_ground
from drakeplan.contact_planning.contact_pool import ContactPool
from scenes.footholds.projection import no_placements, patch_shape, project_feet
from scenes.library.braced_ramp import BracedRamp
from scenes.terrain.packed_terrain import pack_terrain


class PalmsOnWall:
    """A check on a ramp, and palms by the x and z [m] where they are set down.

    Attributes:
        check: of steps.
    """

    def __init__(self, ramp: BracedRamp, bracer: Bracer) -> None:
        self._packed, self._robot = pack_terrain(wall_as_ground(ramp.wall)), robot_on_wall(bracer.mass)
        self.check = BracingCheck(ContactPool(self._packed), ramp, bracer)

    def at(self, palm: int, x: float, z: float) -> int:
        """The number of a palm's contact, -1 where no wall takes it."""
        placed, shape = no_placements(1), patch_shape(self._robot.effectors[palm])
        project_feet(self._packed, palm, np.array([[x, z, 0.0]]), (-1.0, 1.0), shape, placed)
        if placed.surface[0] < 0:
            return -1
        return int(self.check.pool.add(palm, placed.p, placed.R, np.zeros(1), placed.surface)[0])

    def draw(self, palm: int, count: int, rng: np.random.Generator) -> list[int]:
        """So many contacts of a palm anywhere on the wall."""
        found: list[int] = []
        while len(found) < count:
            number = self.at(palm, float(rng.uniform(-0.3, 3.3)), float(rng.uniform(0.5, 1.5)))
            found += [number] if number >= 0 else []
        return found
