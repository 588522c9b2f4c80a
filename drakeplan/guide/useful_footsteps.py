"""Labels of traversability: from how many pairs of feet about a torso pose does a search step on as asked (Lin 2020 alg. 4).

    Gamma      pairs of feet of the transition model that both fit about the pose (Lin 2020 eq. 5.5)
    Gamma+     those from which the torso moves by v, to the cell, with the palms of a motion mode held throughout

Where feet may move to the nearest foothold, pairs are set down so, each counts once, and v counts from their own mean.

A pair is useful when some transition of the search, judged by its own check of balance and reach, makes the translation. Where
a mode has palms, they are placed first: of all palm contacts that the rays find, `PALMS_TRIED` are tried (n_p,lim of alg. 4).
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from drakeplan.contact_planning.contact_domain import ContactDomain, PlannerWeights, State
from drakeplan.contact_planning.contact_plan import FootholdsName, PlannerOptions
from drakeplan.contact_planning.domain_parts import StepCheck
from drakeplan.experience.stored_plan import MODE_PALMS
from drakeplan.guide.torso_steps import CELL, TorsoSteps
from scenes.footholds.projection import patch_shape
from scenes.footholds.snap import Footholds, Snap
from scenes.robots.robot import Robot
from scenes.scene import Goal
from scenes.terrain.packed_terrain import PackedTerrain
from scenes.transition_model import TransitionModel

PALMS_TRIED = 6  # Lin & Berenson 2017 sec. V


@dataclass(frozen=True)
class TorsoPose:
    """Where the torso is.

    Attributes:
        x: of the mean of the feet in W [m].
        y: of the mean of the feet in W [m].
        z: height of the ground there in W [m].
        yaw: heading in W [rad].
    """

    x: float
    y: float
    z: float
    yaw: float


class UsefulFootsteps:
    """Counts useful pairs of feet on one terrain, with quasi-static balance."""

    def __init__(
        self,
        packed: PackedTerrain,
        robot: Robot,
        check: StepCheck,
        model: TransitionModel,
        steps: TorsoSteps,
        footholds: FootholdsName,
    ) -> None:
        """Prepares the search's own moves and checks.

        Args:
            packed: the terrain.
            robot: that steps.
            check: of its steps, on this terrain.
            model: of its steps.
            steps: the same as the torso sees them.
            footholds: whether feet and palms move to the nearest foothold.
        """
        self._packed, self._robot, self._steps = packed, robot, steps
        self._pool, self._check = check.pool, check
        asked = PlannerOptions(heuristic="euclidean", dynamics="quasi-static", model=model, footholds=footholds)
        self._domain = ContactDomain(packed, robot, Goal((0.0, 0.0, np.nan)), check, asked, PlannerWeights())
        self._domain.full_soles = True
        self._soles = [patch_shape(robot.effectors[foot]) for foot in (0, 1)]
        self._snapped = footholds == "snapped"
        self._footholds = Footholds(packed, 0.0, Snap() if self._snapped else None)
        self._limits = asked.step_limits(robot, model)

    def pairs(self, pose: TorsoPose) -> list[tuple[int, int]]:
        """Contact numbers of the pairs of feet that fit about a pose, Gamma."""
        c, s = np.cos(pose.yaw), np.sin(pose.yaw)
        places = self._steps.pairs.copy()
        places[..., :2] = places[..., :2] @ np.array([[c, s], [-s, c]]) + (pose.x, pose.y)
        places[..., 2] += pose.yaw
        if not self._snapped:
            left, right = (self._set_down(foot, places[:, foot], places[0, 1 - foot], pose.z) for foot in (0, 1))
            return [(a, b) for a, b in zip(left, right, strict=True) if a >= 0 and b >= 0]
        pairs: dict[tuple[int, int], None] = {}
        for pair in places:
            (a,) = self._set_down(0, pair[:1], pair[1], pose.z)
            if a >= 0:
                (b,) = self._set_down(1, pair[1:], np.append(self._pool.p[a, :2], self._pool.yaw[a]), pose.z)
                if b >= 0:
                    pairs[a, b] = None
        return list(pairs)

    def _set_down(self, foot: int, places: np.ndarray, stand: np.ndarray, z: float) -> list[int]:
        """Numbers of the contacts of a foot at places (n, 3) beside the other foot (3,), -1 where it does not fit."""
        rise, places = self._robot.max_step_height, places.copy()
        window = (z - rise, z + rise)
        placed = self._footholds.place_feet(foot, places, window, self._soles[foot], stand, self._limits)
        found = placed.surface >= 0
        numbers = np.full(len(places), -1)
        contacts = placed.p[found], placed.R[found], places[found, 2], placed.surface[found]
        numbers[found] = self._pool.add(foot, *contacts)
        return numbers.tolist()

    def count(
        self, pose: TorsoPose, mode: str, translations: Sequence[int], rng: np.random.Generator
    ) -> tuple[np.ndarray, int]:
        """(n,) useful pairs |Gamma+| for each translation, and the number of pairs |Gamma|.

        Args:
            pose: of the torso.
            mode: motion mode.
            translations: numbers of the translations that are asked for.
            rng: draws the order of palm contacts.
        """
        useful, pairs = np.zeros(len(translations), np.int64), self.pairs(pose)
        cells = self._steps.translations[list(translations)]
        for left, right in pairs:
            mean = 0.5 * (self._pool.p[left, :2] + self._pool.p[right, :2])
            here = (*mean.tolist(), pose.yaw) if self._snapped else (pose.x, pose.y, pose.yaw)
            useful += self._reached((left, right), here, mode, cells, rng)
        return useful, len(pairs)

    def _reached(
        self,
        feet: tuple[int, int],
        here: tuple[float, float, float],
        mode: str,
        cells: np.ndarray,
        rng: np.random.Generator,
    ) -> np.ndarray:
        """(n,) which cells the torso comes to from a pair of feet, counted from x, y, yaw."""
        reached = np.zeros(len(cells), bool)
        for palms in self._palms(feet, mode, rng):
            state = (*feet, *palms, -1)
            if self._check.stance(state[:4]):
                continue
            for child, cell in self._steps_of(state, here, cells, reached):
                if not reached[cell] and self._domain.confirm(state, child):
                    reached[cell] = True
            if reached.all():
                break
        return reached

    def _palms(self, feet: tuple[int, int], mode: str, rng: np.random.Generator) -> list[tuple[int, int]]:
        """Palm contacts to be tried with a pair of feet, those of the mode and no others."""
        if mode == "feet":
            return [(-1, -1)]
        moves, _ = self._domain.successors((*feet, -1, -1, -1))
        found = [[-1], [-1]]
        for palm in MODE_PALMS[mode]:
            found[palm - 2] = [move[palm] for move in moves if move[4] == palm]
        choices = list(itertools.product(*found))
        return [choices[k] for k in rng.permutation(len(choices))[:PALMS_TRIED].tolist()]

    def _steps_of(
        self, state: State, here: tuple[float, float, float], cells: np.ndarray, reached: np.ndarray
    ) -> list[tuple[State, int]]:
        """The foot moves that bring the torso to a cell that it has not come to yet, with the cell's number."""
        moves = [move for move in self._domain.successors(state)[0] if move[4] < 2]
        if not moves:
            return []
        feet = np.array([move[:2] for move in moves])
        mean = 0.5 * (self._pool.p[feet[:, 0], :2] + self._pool.p[feet[:, 1], :2]) - here[:2]
        c, s = np.cos(here[2]), np.sin(here[2])
        cell = np.round(mean @ np.array([[c, -s], [s, c]]) / CELL).astype(np.int64)
        hit = (cell[:, None] == cells[None]).all(axis=2) & ~reached
        return [(moves[k], number) for k, number in np.argwhere(hit).tolist()]
