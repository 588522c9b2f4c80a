"""Plans how `bracer` walks along a wall with its palms: the contact planner, with the wall for ground (Lin 2020 sec. 5.10).

search over palm contacts -> Drake's inverse kinematics and a linear program for every step -> the next search, where one fails
"""

from __future__ import annotations

import itertools
import time
from dataclasses import dataclass
from typing import Literal

import numpy as np
from scipy.optimize import linprog

from drakeplan.bracing.bracer import Bracer
from drakeplan.bracing.bracing_check import BracingCheck
from drakeplan.bracing.wall_frame import robot_on_wall, to_wall, to_world, transition_model_of_palms, wall_as_ground
from drakeplan.bracing.wall_traversability import wall_distances
from drakeplan.contact_planning.contact_domain import ContactDomain, PlannerWeights, State
from drakeplan.contact_planning.contact_plan import PlannerOptions
from drakeplan.contact_planning.contact_pool import ContactPool
from drakeplan.contact_planning.torso_grid import TorsoGrid
from drakeplan.search.ana_star import AnaStar, Limits
from optimization.balance.static_equilibrium import ContactArrays
from scenes.footholds.projection import no_placements, patch_shape, project_feet
from scenes.library.braced_ramp import BracedRamp
from scenes.robots.robot import Robot
from scenes.scene import Goal
from scenes.terrain.packed_terrain import PackedTerrain, pack_terrain

APART = 0.3  # [m] between the palms at the start
MOST_ROUNDS = 50  # searches after steps that Drake refused
Heuristic = Literal["grid", "traversability"]


@dataclass(frozen=True, eq=False)
class BracedPlan:
    """Palm contacts along a wall, with the base and a posture for each step.

    Attributes:
        palms: (S, 2, 3) contact points of left and right palm in W [m]; rows differ in one palm.
        base: (S - 1, 4, 4) pose of the base while a step is made.
        postures: (S - 1, 2, 16) configurations with the moving palm at its old and at its new contact.
        expansions: of all searches.
        refused: steps that Drake or the linear program refused.
        seconds: set-up and search, up to the last check.
        checked_s: seconds of these that Drake's checks took.
    """

    palms: np.ndarray
    base: np.ndarray
    postures: np.ndarray
    expansions: int
    refused: int
    seconds: float
    checked_s: float

    @property
    def steps(self) -> int:
        """How many palms were moved."""
        return len(self.base)


def plan_braced(
    ramp: BracedRamp, bracer: Bracer, heuristic: Heuristic = "grid", seed: int = 0, deadline: float = 30.0
) -> BracedPlan | None:
    """The first sequence whose every step Drake and a linear program accept; None where none is found in time.

    Args:
        ramp: the scene.
        bracer: the robot.
        heuristic: distance on the wall, or the same with learned costs of steps.
        seed: of the search.
        deadline: [s].

    Raises:
        ValueError: no wall takes a palm at the start.
        WeightsError: no traversability weights of the bracer.
    """
    began, checked = time.perf_counter(), 0.0
    packed, robot = pack_terrain(wall_as_ground(ramp.wall)), robot_on_wall(bracer.mass)
    pool = ContactPool(packed)
    check = BracingCheck(pool, ramp, bracer)
    goal_xyz = to_wall(ramp.goal)
    goal = Goal((float(goal_xyz[0]), float(goal_xyz[1]), 0.0), ramp.radius, 0.0)
    grid = TorsoGrid(packed, robot, goal)
    options = PlannerOptions(model=transition_model_of_palms(), footholds="fixed", use_palms=False, seed=seed)
    start = _start(ramp, packed, robot, pool)
    distances = (
        grid if heuristic == "grid" else wall_distances(packed, robot, goal, pool.p[list(start[:2])].mean(axis=0))
    )
    domain = ContactDomain(packed, robot, goal, check, options, PlannerWeights(), distances)
    domain.full_soles = True
    expansions = refused = 0
    for _ in range(MOST_ROUNDS):
        left = deadline - (time.perf_counter() - began)
        search = AnaStar(domain, start, 0.1, seed, Limits(deadline=max(left, 0.0), improve=0.0))
        found = next(iter(search.run()), None)
        expansions += search.expansions
        if found is None:
            return None
        asked = time.perf_counter()
        accepted = _accepted(found.path, check, bracer, pool)
        checked += time.perf_counter() - asked
        if isinstance(accepted, int):
            domain.forbid(found.path[accepted], found.path[accepted + 1])
            refused += 1
            continue
        base, postures = accepted
        palms = np.array([to_world(pool.p[list(state[:2])]) for state in found.path])
        return BracedPlan(palms, base, postures, expansions, refused, time.perf_counter() - began, checked)
    return None


def _start(ramp: BracedRamp, packed: PackedTerrain, robot: Robot, pool: ContactPool) -> State:
    """Both palms on the wall about the start, the right one ahead."""
    middle, numbers = to_wall(ramp.start), []
    for palm, sign in ((0, -1.0), (1, 1.0)):
        placed, place = no_placements(1), np.array([[middle[0] + sign * APART / 2, middle[1], 0.0]])
        project_feet(packed, palm, place, (-1.0, 1.0), patch_shape(robot.effectors[palm]), placed)
        if placed.surface[0] < 0:
            raise ValueError("no wall takes a palm at the start")
        numbers.append(int(pool.add(palm, placed.p, placed.R, np.zeros(1), placed.surface)[0]))
    return (*numbers, -1, -1, -1)


def _accepted(
    path: tuple[State, ...] | list[State], check: BracingCheck, bracer: Bracer, pool: ContactPool
) -> tuple[np.ndarray, np.ndarray] | int:
    """Base poses and postures of all steps; or the number of the first step that is refused."""
    bases, postures = [], []
    for k, (before, after) in enumerate(itertools.pairwise(path)):
        standing = before[1] if before[0] != after[0] else before[0]
        X_WB = check.base(standing)
        into, both = X_WB[:3, :3].T @ np.array([0.0, 1.0, 0.0]), []
        for state in (before, after):
            points = (to_world(pool.p[list(state[:2])]) - X_WB[:3, 3]) @ X_WB[:3, :3]
            q = bracer.posture(points, into)
            if q is None or not _rests(check.supports(standing), X_WB[:3, :3] @ bracer.com_of(q) + X_WB[:3, 3]):
                return k
            both.append(q)
        bases.append(X_WB)
        postures.append(both)
    return np.array(bases), np.array(postures)


def _rests(arrays: ContactArrays, com: np.ndarray) -> bool:
    """Whether contact forces balance the weight at this CoM, by a linear program that shares nothing with the search's test."""
    columns, rows = [], []
    for p, R, corners, generators in zip(arrays.p_WC, arrays.R_WC, arrays.corners, arrays.generators, strict=True):
        first = len(columns)
        for corner in corners:
            at = p + R[:, :2] @ corner
            columns += [np.concatenate([R @ ray, np.cross(at, R @ ray)]) for ray in generators]
        rows.append((first, len(columns)))
    A_eq = np.array(columns).T
    up = np.array([0.0, 0.0, 1.0])
    b_eq = np.concatenate([up, np.cross(com, up)])
    A_ub = np.zeros((len(rows), len(columns)))
    for contact, (first, end) in enumerate(rows):
        A_ub[contact, first:end] = 1.0  # rays have a normal force of one
    answer = linprog(np.zeros(len(columns)), A_ub, arrays.force_limit, A_eq, b_eq, method="highs")
    return bool(answer.status == 0 and np.abs(A_eq @ answer.x - b_eq).max() < 1e-6)
