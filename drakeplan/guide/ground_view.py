"""What the torso sees of the ground about many poses at once: all features of one terrain (Lin & Berenson 2017 sec. IV.E, IV.F)."""

from __future__ import annotations

import numpy as np
from numba import njit

from drakeplan.contact_planning.contact_domain import ARM_SLACK
from drakeplan.contact_planning.contact_plan import FootholdsName, PlannerOptions
from drakeplan.guide.contact_scores import (
    FootScores,
    PalmRays,
    PalmSpaces,
    foot_scores,
    palm_rays,
    palm_spaces_near,
    within_reach,
)
from drakeplan.guide.features import (
    QUADRANTS,
    StepTables,
    exact_features,
    exact_palm_features,
    foot_features,
    palm_features,
    step_tables,
)
from drakeplan.guide.torso_steps import DIRECTIONS, TorsoSteps, torso_steps
from scenes.footholds.projection import PatchShape, patch_shape
from scenes.footholds.snap import Snap
from scenes.robots.robot import Robot
from scenes.terrain.packed_terrain import PackedTerrain
from scenes.transition_model import TransitionModel, transition_model

MODEL = "planning"  # as many steps as in Lin & Berenson 2017 fig. 2
AROUND = 1.2  # [m] about the poses: what feet and palms reach


def documented_steps(robot: Robot) -> tuple[TransitionModel, TorsoSteps]:
    """The steps that traversability is learned for, for a robot."""
    model = transition_model(MODEL)
    return model, torso_steps(model, PlannerOptions(model=model, footholds="fixed").longest_travel(robot))


class GroundView:
    """Features of torso poses on one terrain.

    Attributes:
        steps: of both feet about the torso.
    """

    def __init__(
        self,
        packed: PackedTerrain,
        robot: Robot,
        steps: TorsoSteps,
        rays: np.ndarray,
        low: np.ndarray,
        high: np.ndarray,
        footholds: FootholdsName = "fixed",
    ) -> None:
        """Scores all contact points near the poses.

        Args:
            packed: the terrain.
            robot: whose feet and palms.
            steps: of both feet about the torso.
            rays: (K, 3) of the left palm, from the shoulder.
            low: (2,) least x and y of the poses [m].
            high: (2,) greatest x and y of the poses [m].
            footholds: "snapped": a foot's score is the best one that it can move to; "fixed": that of its own place.
        """
        self.steps, self._packed, self._tables = steps, packed, step_tables(steps)
        self._rise = float(robot.max_step_height)
        self._scores = foot_scores(packed, robot, low - AROUND, high + AROUND)
        if footholds == "snapped":
            self._scores = within_reach(self._scores, Snap().radius)
        self._rays = palm_rays(robot, np.ascontiguousarray(rays), ARM_SLACK)
        self._spaces = palm_spaces_near(packed, robot, low - AROUND, high + AROUND)
        self._sole, self._palm = patch_shape(robot.effectors[0]), patch_shape(robot.effectors[2])

    def scores(self, torso: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """(n, V) S_f by translation and (n,) S_pairs, by approximate contact checking.

        Args:
            torso: (n, 4) x, y, z of the ground [m], yaw [rad] in W.
        """
        feet, pairs = np.empty((len(torso), len(self.steps.translations))), np.empty(len(torso))
        _foot_scores(self._tables, self._scores, torso, self._rise, feet, pairs)
        return feet, pairs

    def palm_scores(self, torso: np.ndarray) -> np.ndarray:
        """(n, 4) S_p by quadrant.

        Args:
            torso: (n, 4) x, y, z of the ground [m], yaw [rad] in W.
        """
        out = np.empty((len(torso), QUADRANTS))
        _palm_scores(self._packed, self._rays, self._spaces, torso, out)
        return out

    def exact(self, torso: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """(n, V) N_f by translation, that of its direction, and (n, 4) N_p by quadrant, by exact contact checking.

        Args:
            torso: (n, 4) x, y, z of the ground [m], yaw [rad] in W.
        """
        ways, fits, palms = np.empty((len(torso), DIRECTIONS)), np.empty(len(torso)), np.empty((len(torso), QUADRANTS))
        _exact(self._packed, self._tables, self._sole, torso, self._rise, ways, fits)
        _exact_palms(self._packed, self._rays, self._palm, torso, palms)
        way = self.steps.direction_of_translation
        return np.where(way >= 0, ways[:, way], fits[:, None]), palms


@njit(cache=True)
def _foot_scores(
    steps: StepTables, scores: FootScores, torso: np.ndarray, rise: float, feet: np.ndarray, pairs: np.ndarray
) -> None:
    for k in range(len(torso)):
        x, y, z, yaw = torso[k]
        pairs[k] = foot_features(steps, scores, x, y, z, yaw, rise, feet[k])


@njit(cache=True)
def _palm_scores(packed: PackedTerrain, rays: PalmRays, spaces: PalmSpaces, torso: np.ndarray, out: np.ndarray) -> None:
    for k in range(len(torso)):
        x, y, z, yaw = torso[k]
        palm_features(packed, rays, spaces, x, y, z, yaw, out[k])


@njit(cache=True)
def _exact(
    packed: PackedTerrain,
    steps: StepTables,
    sole: PatchShape,
    torso: np.ndarray,
    rise: float,
    out: np.ndarray,
    fits: np.ndarray,
) -> None:
    for k in range(len(torso)):
        x, y, z, yaw = torso[k]
        fits[k] = exact_features(packed, steps, sole, x, y, z, yaw, rise, out[k])


@njit(cache=True)
def _exact_palms(packed: PackedTerrain, rays: PalmRays, palm: PatchShape, torso: np.ndarray, out: np.ndarray) -> None:
    for k in range(len(torso)):
        x, y, z, yaw = torso[k]
        exact_palm_features(packed, rays, palm, x, y, z, yaw, out[k])
