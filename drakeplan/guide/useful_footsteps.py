"""Labels of traversability: from how many pairs of feet about a torso pose does a search step on as asked (Lin 2020 alg. 4).

    Gamma      pairs of feet of the transition model that both fit about the pose (Lin 2020 eq. 5.5)
    Gamma+     those from which the torso comes to the cell of p_t + v, with the palms of a motion mode held throughout

A pair is useful when some transition of the search, judged by its own check of balance and reach, makes the translation. Where
a mode has palms, they are placed first: of all palm contacts that the rays find, `PALMS_TRIED` are tried (n_p,lim in the documents).
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from drakeplan.contact_planning.contact_domain import ContactDomain, PlannerWeights, State
from drakeplan.contact_planning.contact_plan import PlannerOptions
from drakeplan.contact_planning.contact_pool import ContactPool
from drakeplan.contact_planning.transition_check import TransitionCheck
from drakeplan.experience.stored_plan import MODE_PALMS
from drakeplan.guide.torso_steps import CELL, TorsoSteps
from optimization.balance.friction import FrictionCone
from optimization.inverse_kinematics.whole_body_ik import WholeBodyIK
from scenes.footholds.projection import no_placements, patch_shape, project_feet
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
    """Counts useful pairs of feet on one terrain, with fixed steps and quasi-static balance."""

    def __init__(
        self,
        packed: PackedTerrain,
        robot: Robot,
        ik: WholeBodyIK,
        model: TransitionModel,
        steps: TorsoSteps,
        cone: FrictionCone,
    ) -> None:
        """Prepares the search's own moves and checks.

        Args:
            packed: the terrain.
            robot: that steps.
            ik: its inverse kinematics.
            model: of its steps.
            steps: the same as the torso sees them.
            cone: friction cone of every contact.
        """
        self._packed, self._robot, self._steps = packed, robot, steps
        self._pool = ContactPool(packed)
        check = TransitionCheck(self._pool, robot, ik, packed, cone)
        asked = PlannerOptions(heuristic="euclidean", dynamics="quasi-static", model=model, footholds="fixed")
        self._domain = ContactDomain(packed, robot, Goal((0.0, 0.0, np.nan)), check, asked, PlannerWeights())
        self._domain.full_soles = True
        self._soles = [patch_shape(robot.effectors[foot]) for foot in (0, 1)]

    def pairs(self, pose: TorsoPose) -> list[tuple[int, int]]:
        """Contact numbers of the pairs of feet that fit about a pose, Gamma."""
        c, s = np.cos(pose.yaw), np.sin(pose.yaw)
        turn = np.array([[c, -s], [s, c]])
        rise, numbers, fits = self._robot.max_step_height, [], []
        for foot in (0, 1):
            place = self._steps.pairs[:, foot].copy()
            place[:, :2] = place[:, :2] @ turn.T + (pose.x, pose.y)
            place[:, 2] += pose.yaw
            placed = no_placements(len(place))
            window = (pose.z - rise, pose.z + rise)
            project_feet(self._packed, foot, place, window, self._soles[foot], placed)
            fits.append(placed.surface >= 0)
            numbers.append(np.full(len(place), -1))
            found = fits[foot]
            contacts = placed.p[found], placed.R[found], place[found, 2], placed.surface[found]
            numbers[foot][found] = self._pool.add(foot, *contacts)
        both = fits[0] & fits[1]
        return list(zip(numbers[0][both].tolist(), numbers[1][both].tolist(), strict=True))

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
            useful += self._reached((left, right), pose, mode, cells, rng)
        return useful, len(pairs)

    def _reached(
        self, feet: tuple[int, int], pose: TorsoPose, mode: str, cells: np.ndarray, rng: np.random.Generator
    ) -> np.ndarray:
        """(n,) which cells the torso comes to from a pair of feet."""
        reached = np.zeros(len(cells), bool)
        for palms in self._palms(feet, mode, rng):
            state = (*feet, *palms, -1)
            if self._domain.check.stance(state[:4]):
                continue
            for child, cell in self._steps_of(state, pose, cells, reached):
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
        self, state: State, pose: TorsoPose, cells: np.ndarray, reached: np.ndarray
    ) -> list[tuple[State, int]]:
        """The foot moves that bring the torso to a cell that it has not come to yet, with the cell's number."""
        moves = [move for move in self._domain.successors(state)[0] if move[4] < 2]
        if not moves:
            return []
        feet = np.array([move[:2] for move in moves])
        mean = 0.5 * (self._pool.p[feet[:, 0], :2] + self._pool.p[feet[:, 1], :2]) - (pose.x, pose.y)
        c, s = np.cos(pose.yaw), np.sin(pose.yaw)
        cell = np.round(mean @ np.array([[c, -s], [s, c]]) / CELL).astype(np.int64)
        hit = (cell[:, None] == cells[None]).all(axis=2) & ~reached
        return [(moves[k], number) for k, number in np.argwhere(hit).tolist()]
