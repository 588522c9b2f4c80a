"""Where a robot that stands on one foot could set a foot or a palm to catch itself (Lin 2020 fig. 7.2 b).

Lin 2020: Y.-C. Lin, "Learning for Humanoid Multi-Contact Navigation Planning" (dissertation), sec. 7.6 and 7.7.1.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from drakeplan.contact_planning.contact_domain import ARM_SLACK
from drakeplan.contact_planning.contact_pool import ContactPool
from optimization.capture.sampling import CAPTURE_MOTIONS
from scenes.effector import LEFT_FOOT, LEFT_PALM, RIGHT_PALM
from scenes.footholds.projection import patch_shape
from scenes.footholds.snap import Footholds, StepLimits
from scenes.robots.robot import Robot
from scenes.terrain.packed_terrain import PackedTerrain
from scenes.transition_model import TransitionModel, transition_model

FOOT, SAME_PALM, OPPOSITE_PALM = (CAPTURE_MOTIONS.index(name) for name in ("foot", "same_palm", "opposite_palm"))
AZIMUTH, ELEVATION = (
    np.deg2rad(np.arange(70, 111, 5)),
    np.deg2rad(np.arange(-40, 41, 10)),
)  # of rays; the authors': every 5 deg
_a, _e = (grid.ravel() for grid in np.meshgrid(AZIMUTH, ELEVATION, indexing="ij"))
_RAYS = np.column_stack([np.cos(_e) * np.cos(_a), np.cos(_e) * np.sin(_a), np.sin(_e)])  # of the left palm
ANYWHERE = StepLimits((-np.inf, np.inf), -np.inf, np.inf, (-np.inf, np.inf))  # of steps that are not moved


@dataclass(frozen=True, eq=False)
class CaptureContacts:
    """Contacts that one more end effector could make.

    Attributes:
        numbers: (n,) of the contacts in the pool.
        motion: (n,) index into `CAPTURE_MOTIONS` of the motion that makes each.
    """

    numbers: np.ndarray
    motion: np.ndarray


class CapturePoses:
    """Projects the steps of the other foot and the rays of both palms onto one terrain, about any standing foot."""

    def __init__(
        self,
        packed: PackedTerrain,
        robot: Robot,
        pool: ContactPool,
        model: TransitionModel | None = None,
        *,
        palms: bool = True,
    ) -> None:
        """Prepares the projections.

        Args:
            packed: the terrain.
            robot: whose feet and palms.
            pool: numbers the contacts.
            model: of steps; None: the planning model.
            palms: whether palms may catch the robot.
        """
        self.robot, self.pool = robot, pool
        model = model or transition_model("planning")
        self._steps_of = model.mirrored(True)[0], model.mirrored(False)[0]
        self._footholds = Footholds(packed, 0.0, None)
        self._patches = [patch_shape(e) for e in robot.effectors]
        usable = np.flatnonzero(packed.allowed.any(axis=0)).tolist()
        self._palms = [palm for palm in robot.palms if palms and palm in usable]
        self._known: dict[int, CaptureContacts] = {}

    def about(self, foot: int) -> CaptureContacts:
        """The contacts about a standing foot; they depend on nothing else.

        Args:
            foot: number of its contact in the pool.
        """
        if foot not in self._known:
            self._known[foot] = self._project(foot)
        return self._known[foot]

    def _project(self, foot: int) -> CaptureContacts:
        standing = int(self.pool.effector[foot])
        parts = [(self._steps(foot, 1 - standing), FOOT)]
        for palm in self._palms:
            same = (palm == LEFT_PALM) == (standing == LEFT_FOOT)
            parts.append((self._rays(foot, palm), SAME_PALM if same else OPPOSITE_PALM))
        numbers = np.concatenate([part for part, _ in parts])
        motion = np.concatenate([np.full(len(part), motion) for part, motion in parts])
        return CaptureContacts(numbers, motion)

    def _steps(self, foot: int, mover: int) -> np.ndarray:
        """(n,) contacts of the other foot."""
        p0, yaw0 = self.pool.p[foot], float(self.pool.yaw[foot])
        steps = self._steps_of[mover]
        c, s = np.cos(yaw0), np.sin(yaw0)
        x, y = c * steps[:, 0] - s * steps[:, 1], s * steps[:, 0] + c * steps[:, 1]
        xy_yaw = np.column_stack([p0[0] + x, p0[1] + y, yaw0 + steps[:, 2]])
        rise = self.robot.max_step_height
        stand = np.array([p0[0], p0[1], yaw0])
        z_range = float(p0[2] - rise), float(p0[2] + rise)
        placed = self._footholds.place_feet(mover, xy_yaw, z_range, self._patches[mover], stand, ANYWHERE)
        fits = placed.surface >= 0
        return np.unique(self.pool.add(mover, placed.p[fits], placed.R[fits], xy_yaw[fits, 2], placed.surface[fits]))

    def _rays(self, foot: int, palm: int) -> np.ndarray:
        """(n,) contacts of a palm, seen from the shoulder of a robot whose other foot stands beside this one (Lin 2020 eq. 3.1)."""
        rays = _RAYS if palm != RIGHT_PALM else _RAYS * [1.0, -1.0, 1.0]
        yaw, standing = float(self.pool.yaw[foot]), int(self.pool.effector[foot])
        inward = -1.0 if standing == LEFT_FOOT else 1.0
        x, y, z = self.robot.shoulder
        out = inward * self.robot.foot_separation[1] / 2.0 + (y if palm != RIGHT_PALM else -y)
        c, s = np.cos(yaw), np.sin(yaw)
        shoulder = self.pool.p[foot] + np.array([c * x - s * out, s * x + c * out, z])
        rays_W = np.ascontiguousarray(rays @ np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]]))
        low, high = self.robot.arm_reach
        placed = self._footholds.place_palms(palm, shoulder, rays_W, yaw, (low, ARM_SLACK * high), self._patches[palm])
        fits = placed.surface >= 0
        yaws = np.zeros(int(fits.sum()))
        return np.unique(self.pool.add(palm, placed.p[fits], placed.R[fits], yaws, placed.surface[fits]))
