"""Walks through a terrain as the planner does, and labels its branches with the exact program.

The planner expands a state, evaluates every branch, and continues from a feasible one, mostly the nearest to the goal, sometimes
any (Lin 2020 sec. 6.4, 6.6). A walk does the same, but labels only a few branches of each category at each state, and
prefers the categories with few labels: an ordinary search makes a hundred foot moves for each palm contact it breaks.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from drakeplan.campaigns.tilted_environment import TiltedEnvironment
from drakeplan.contact_planning.contact_domain import ContactDomain, PlannerWeights
from drakeplan.contact_planning.contact_plan import PlannerOptions
from drakeplan.contact_planning.contact_pool import ContactPool, Held
from drakeplan.contact_planning.dynamics_evaluator import stance_of
from drakeplan.contact_planning.transition_check import TransitionCheck
from learning.transition_batch import TransitionBatch
from learning.transition_features import NUM_CATEGORIES, canonicalise
from optimization.centroidal.estimate import CentroidalEstimate
from optimization.centroidal.transition_dynamics import TransitionDynamics
from optimization.inverse_kinematics.whole_body_ik import WholeBodyIK
from scenes.footholds.start_stance import standing_com, start_stance
from scenes.input_error import InputError
from scenes.robots.robot import Robot
from scenes.terrain.packed_terrain import PackedTerrain, pack_terrain
from scenes.transition_model import transition_model


@dataclass(frozen=True)
class Shift:
    """How a state may be moved off its place before its branches are judged.

    Attributes:
        name: as rows say it.
        probability: of being chosen.
        com: standard deviation of the CoM's shift per axis [m].
        velocity: of its velocity's per axis, where no palm, one and both are held [m/s].
    """

    name: str
    probability: float
    com: float
    velocity: tuple[float, float, float]


# A planner that trusts predictions comes to states that are a little off, and where what is feasible ends is seen only from
# states that are far off: left to itself, a walk with exact dynamics meets an infeasible branch once in a hundred. With
# palms on both sides it takes the speeds given last to meet as many as without.
SHIFTS = (
    Shift("none", 0.3, 0.0, (0.0, 0.0, 0.0)),
    Shift("small", 0.25, 0.02, (0.06, 0.06, 0.06)),
    Shift("large", 0.1, 0.06, (0.3, 0.3, 0.5)),
    Shift("wild", 0.35, 0.1, (0.8, 1.6, 3.0)),
)


@dataclass(frozen=True)
class WalkOptions:
    """How a walk is made.

    Attributes:
        quota: labels of each category in one environment.
        per_state: labels of each category at one state.
        max_states: most states expanded in one environment.
        greedy: probability that a branch is picked for being near the goal rather than at random.
        jump: probability of going on from an older branch instead of a new one.
        worth: greatest objective of a branch that a walk goes on from. At the planner's weight of 0.1 this one is worth 30
            steps (Lin 2020 eq. 6.6): a planner goes anywhere else, and what lies behind it are states that it never meets.
        shifts: of CoM and velocity; probabilities add up to 1.
    """

    quota: int = 20
    per_state: int = 2
    max_states: int = 120
    greedy: float = 0.5
    jump: float = 0.15
    worth: float = 1000.0
    shifts: tuple[Shift, ...] = SHIFTS


@dataclass(frozen=True, eq=False)
class WalkState:
    """Where a walk may go on.

    Attributes:
        contacts: state of the contact domain: contact numbers and last mover.
        com: (3,) [m].
        velocity: (3,) of the CoM [m/s].
    """

    contacts: tuple[int, int, int, int, int]
    com: np.ndarray
    velocity: np.ndarray

    @property
    def held(self) -> Held:
        """Contact numbers by end effector."""
        return self.contacts[:4]

    @property
    def palms(self) -> int:
        """How many palms are held."""
        return sum(n >= 0 for n in self.contacts[2:4])


@dataclass(frozen=True, eq=False)
class Label:
    """One branch with the result of the exact program.

    Attributes:
        state: where it starts.
        child: contact state after it.
        category: 0..9.
        mirrored: whether its representative is mirrored.
        expansion: how many states were expanded before.
        shift: how the state was shifted, by the name of the shift.
        estimate: the program's answer.
    """

    state: WalkState
    child: tuple[int, int, int, int, int]
    category: int
    mirrored: bool
    expansion: int
    shift: str
    estimate: CentroidalEstimate


class LabelWalk:
    """One walk through one environment.

    Attributes:
        pool: the contacts, by the numbers that labels use.

    Raises:
        InputError: there is no place to start.
    """

    def __init__(
        self,
        environment: TiltedEnvironment,
        robot: Robot,
        ik: WholeBodyIK,
        dynamics: TransitionDynamics,
        options: WalkOptions,
        rng: np.random.Generator,
        *,
        palms: bool = True,
    ) -> None:
        """Places the robot in the environment.

        Args:
            environment: terrain, starts and goal.
            robot: that walks.
            ik: its inverse kinematics.
            dynamics: the exact program for one transition.
            options: how the walk is made.
            rng: source of all random choices.
            palms: whether it may use them.
        """
        self.robot, self.dynamics, self.options, self.rng = robot, dynamics, options, rng
        packed = pack_terrain(environment.terrain)
        self.pool = ContactPool(packed)
        self.check = TransitionCheck(self.pool, robot, ik, packed, dynamics.options.cone)
        asked = PlannerOptions(
            use_palms=palms,
            heuristic="euclidean",
            dynamics="exact",
            model=transition_model(environment.steps),
            footholds="fixed",
        )
        self.domain = ContactDomain(packed, robot, environment.goal, self.check, asked, PlannerWeights())
        self.domain.full_soles = True  # a row has no room for a support
        self.missing = np.full(NUM_CATEGORIES, options.quota)
        self._open: list[WalkState] = [self._first_state(environment, packed)]

    def labels(self) -> Iterator[Label]:
        """Labels until every category has its quota, the walk has nowhere to go, or the states are used up."""
        options, rng = self.options, self.rng
        state: WalkState | None = None
        for expansion in range(options.max_states):
            if not self.missing.any():
                return
            if state is not None and rng.uniform() < options.jump:
                self._open.append(state)
                state = None
            state = state or self._reachable()
            if state is None:
                return
            here = state
            state, shift = self._shifted(here)
            following = []
            for child, category, mirrored in self._branches(state):
                estimate = self._judge(state, child)
                self.missing[category] -= 1
                yield Label(state, child, category, mirrored, expansion, shift, estimate)
                if estimate.feasible and estimate.cost <= options.worth:
                    following.append(WalkState(child, *self.dynamics.final_state(estimate)))
            if not following and shift != "none":
                self._open.append(here)  # a state that was shifted too far may be judged again from elsewhere
            state = self._go_on(following)

    def _first_state(self, environment: TiltedEnvironment, packed: PackedTerrain) -> WalkState:
        for start in environment.starts:
            try:
                stance = start_stance(environment.scene(start), packed, self.robot, full_soles=True)
            except InputError:
                continue
            left, right = (self.pool.add_contact(c) for c in stance.contacts[:2] if c is not None)
            com = standing_com(self.robot, stance)
            if not self.check.at_com((left, right, -1, -1), com):
                return WalkState((left, right, -1, -1, -1), com, np.zeros(3))
        raise InputError(f"environment {environment.ground}: no place to start")

    def _shifted(self, state: WalkState) -> tuple[WalkState, str]:
        """The state with CoM and velocity shifted at random, and by which shift."""
        rng, shifts = self.rng, self.options.shifts
        shift = shifts[rng.choice(len(shifts), p=[s.probability for s in shifts])]
        com, velocity = rng.normal(0.0, 1.0, (2, 3)) * [[shift.com], [shift.velocity[state.palms]]]
        return WalkState(state.contacts, state.com + com, state.velocity + velocity), shift.name

    def _branches(self, state: WalkState) -> list[tuple[tuple[int, int, int, int, int], int, bool]]:
        """The branches to judge: child, category, mirrored; a few of each category that is still missing."""
        children, _ = self.domain.successors(state.contacts)
        if not children:
            return []
        numbers = np.array(children)
        batch = TransitionBatch.of_children(
            self.pool.p, self.pool.R, state.held, numbers[:, :4], state.com, state.velocity
        )
        canonical = canonicalise(batch)
        near = self.domain.distance_to_go(children)
        picked = []
        for category in range(NUM_CATEGORIES):
            rows = np.flatnonzero(canonical.category == category)
            for _ in range(min(self.options.per_state, self.missing[category], len(rows))):
                # the nearer half of what is left, or all of it
                pool = rows[np.argsort(near[rows], kind="stable")]
                if self.rng.uniform() < self.options.greedy:
                    pool = pool[: (len(pool) + 1) // 2]
                k = int(self.rng.choice(pool))
                rows = rows[rows != k]
                picked.append((children[k], category, bool(canonical.mirrored[k])))
        return picked

    def _judge(self, state: WalkState, child: tuple[int, int, int, int, int]) -> CentroidalEstimate:
        before, after = stance_of(self.pool, state.held), stance_of(self.pool, child[:4])
        return self.dynamics.estimate(before, after, state.com, self.robot.mass * state.velocity)

    def _go_on(self, following: list[WalkState]) -> WalkState | None:
        """One of these states, rather one from which missing categories can be reached; the rest is kept for later."""
        while following:
            weights = np.array([self._wanted(s.palms) for s in following])
            total = weights.sum()
            k = int(self.rng.choice(len(following), p=weights / total if total > 0 else None))
            state = following.pop(k)
            if not self.check.at_com(state.held, state.com):
                self._open += following
                return state
        return None

    def _reachable(self) -> WalkState | None:
        """A state that was left for later and that the body can take."""
        while self._open:
            state = self._open.pop(int(self.rng.integers(len(self._open))))
            if not self.check.at_com(state.held, state.com):
                return state
        return None

    def _wanted(self, palms: int) -> float:
        """How much is missing among the categories that begin with so many palms."""
        return float(self.missing[((0, 1), (2, 3, 4, 5, 6), (7, 8, 9))[palms],].max()) + 1e-3
