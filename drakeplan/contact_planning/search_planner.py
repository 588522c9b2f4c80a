"""Finds the contact sequence: where feet and palms go, one after the other (Lin 2020 ch. III and sec. 6.4)."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from typing import Literal

import numpy as np

from drakeplan.contact_planning.com_costs import DynamicWeights
from drakeplan.contact_planning.com_domain import DynamicDomain
from drakeplan.contact_planning.contact_domain import ContactDomain, HeuristicName, PlannerWeights, State
from drakeplan.contact_planning.contact_pool import ContactPool
from drakeplan.contact_planning.dynamics_evaluator import DynamicsEvaluator, ExactDynamics, LearnedDynamics
from drakeplan.contact_planning.start_stance import check_goal, start_stance
from drakeplan.contact_planning.transition_check import TransitionCheck
from drakeplan.contact_planning.window_domain import GREED, WINDOW, HindsightDomain
from drakeplan.search.ana_star import AnaStar, Domain, Limits
from drakeplan.timing.step_timing import Timing
from learning.surrogate import DynamicsSurrogate, load_surrogate
from optimization.balance.friction import DEFAULT_CONE, FrictionCone
from optimization.centroidal.window_dynamics import TailDynamics
from optimization.inverse_kinematics.whole_body_ik import WholeBodyIK
from scenes.robots.robot import Robot
from scenes.scene import Scene
from scenes.stance import Stance
from scenes.terrain.packed_terrain import pack_terrain
from scenes.transition_model import TransitionModel, transition_model

DynamicsName = Literal["quasi-static", "exact", "learned"]


@dataclass(frozen=True)
class ContactPlannerOptions:
    """How to search.

    Attributes:
        cone: friction cone (DESIGN: inner, square, second_order, diamond).
        heuristic: "grid" (6.7), "euclidean" (3.3) or "admissible".
        weights: of the edge cost (3.2).
        epsilon: probability of a random expansion (Lin 2020 sec. 6.4).
        seed: of that choice.
        use_palms: whether palms may be used at all.
        dynamics: what a transition must be: balanced at its critical configurations ("quasi-static"), feasible for the
            centroidal program ("exact"), or for what has learned it ("learned").
        timing: of every transition, where its dynamics are asked for.
        window: transitions at the end of a path that the exact program is asked about together, once one is popped; 0:
            each transition on its own from where the one before it ended, all children at once, as documented.
        surrogate: for "learned"; None: the one that comes with drakeplan.
        ask_when_far: whether the exact program answers for transitions that are far from what was learned.
        dynamic_weights: of the edge cost (6.6), where transitions are judged by their dynamics.
    """

    cone: FrictionCone = DEFAULT_CONE
    heuristic: HeuristicName = "grid"
    weights: PlannerWeights = field(default_factory=PlannerWeights)
    epsilon: float = 0.1
    seed: int = 0
    use_palms: bool = True
    dynamics: DynamicsName = "quasi-static"
    timing: Timing = field(default_factory=Timing)
    window: int = WINDOW
    surrogate: DynamicsSurrogate | None = None
    ask_when_far: bool = True
    dynamic_weights: DynamicWeights = field(default_factory=DynamicWeights)

    def __post_init__(self) -> None:
        object.__setattr__(self, "cone", FrictionCone(self.cone))  # a name is taken too


@dataclass(frozen=True)
class ContactPlan:
    """A contact sequence that passed inverse kinematics and balance at both critical configurations of each step.

    Attributes:
        stances: from start to goal, consecutive ones differ in one end effector.
        states: the search's own names for them.
        cost: sum of the edge costs (3.2).
        bound: at most this many times the optimum; None where the heuristic gives no guarantee.
        expansions: nodes expanded until it was found.
        elapsed: seconds since planning began (terrain packed, grid, search; not loading).
        predicted_com: (n, 3) CoM at each stance as the search saw it [m]; None without dynamics.
        predicted_effort: sum of the transitions' dynamics objectives as the search saw them; None without dynamics.
    """

    stances: tuple[Stance, ...]
    states: tuple[State, ...]
    cost: float
    bound: float | None
    expansions: int
    elapsed: float
    predicted_com: np.ndarray | None = None
    predicted_effort: float | None = None

    @property
    def palms_used(self) -> int:
        """Transitions that make or move a palm contact."""
        return sum(1 for s in self.states[1:] if s[4] >= 2 and s[s[4]] >= 0)


class ContactPlanner:
    """One query: a scene, a robot and options; iterate over `plans`.

    Attributes:
        start: the first stance.
        goal: with its height.
        setup_s: seconds it took to pack the terrain and to set the robot down.
        search: the search that `plans` runs, None before.

    Raises:
        InputError: start or goal missing or off the terrain; no usable weights for learned dynamics.
    """

    def __init__(
        self,
        scene: Scene,
        robot: Robot,
        ik: WholeBodyIK,
        options: ContactPlannerOptions | None = None,
        model: TransitionModel | None = None,
    ) -> None:
        began = time.perf_counter()
        self.options = options or ContactPlannerOptions()
        self.packed = pack_terrain(scene.terrain)
        self.start = start_stance(scene, self.packed, robot)
        self.goal = check_goal(scene, self.packed, robot)
        self.pool = ContactPool(self.packed)
        self.check = TransitionCheck(self.pool, robot, ik, self.packed, self.options.cone)
        self.domain = ContactDomain(
            self.packed, robot, self.goal, model or transition_model(), self.check, self.options.weights,
            self.options.heuristic, self.options.use_palms, self.options.dynamics == "quasi-static",
        )  # fmt: skip
        held = tuple(-1 if c is None else self.pool.add_contact(c) for c in self.start.contacts)
        self._start_state: State = (*held, -1)
        self.dynamic: DynamicDomain | HindsightDomain | None = None
        self._greed = np.inf
        if self.options.dynamics == "exact" and self.options.window:
            tails = TailDynamics(robot, self.options.timing.options(robot, self.options.cone))
            weights, window = self.options.dynamic_weights, self.options.window
            self.dynamic, self._greed = HindsightDomain(self.domain, tails, weights, window), GREED
        elif self.options.dynamics != "quasi-static":
            self.dynamic = DynamicDomain(self.domain, self._evaluator(robot), self.options.dynamic_weights)
        if self.dynamic is not None:
            com = self.start.feet_mean() + np.array([0.0, 0.0, robot.com_height[1]])
            self._start_state = self.dynamic.start(held, com)
        self.search: AnaStar[State] | None = None
        self.setup_s = time.perf_counter() - began

    def start_problem(self) -> str:
        """Why the robot cannot stand at the start, "" if it can."""
        reason = self.check.stance(self._start_state[:4])
        return reason and f"start infeasible: {reason}"

    def plans(self, limits: Limits, clock: Callable[[], float] = time.perf_counter) -> Iterator[ContactPlan]:
        """Yields ever cheaper plans until a limit fires; `why_not` explains the lack of one."""
        domain: Domain[State] = self.domain if self.dynamic is None else self.dynamic
        options = self.options
        self.search = AnaStar(domain, self._start_state, options.epsilon, options.seed, limits, clock=clock)
        self.search.greed = self._greed
        for found in self.search.run():
            stances = tuple(self._stance(s) for s in found.path)
            bound = found.bound if self.options.heuristic == "admissible" else None
            elapsed = self.setup_s + found.elapsed
            com, effort = None, None
            if self.dynamic is not None:
                com = np.array([self.dynamic.com_state(s)[0] for s in found.path])
                effort = self.dynamic.costs.effort(found.path, found.cost)
            yield ContactPlan(stances, found.path, found.cost, bound, found.expansions, elapsed, com, effort)

    def forbid(self, before: State, after: State) -> None:
        """Bars a transition that failed a later, stricter check, so that the next search goes round it."""
        self.domain.forbid(before, after)

    def why_not(self) -> str:
        """Why there is no plan, in one line."""
        if not np.isfinite(self.domain.heuristic([self._start_state[:5]])[0]):
            return "goal unreachable on the grid: no way for the torso from start to goal over ground in reach"
        search = self.search
        if search is None:
            return "not searched yet"
        counts = ", ".join(f"{name} {count}" for name, count in self.domain.rejections.most_common() if count)
        why = f"candidates rejected by: {counts or 'nothing'}"
        if search.ended_by in ("deadline", "cancelled", "expansions"):
            limit = {"deadline": "deadline", "cancelled": "cancelled", "expansions": "expansion budget spent"}
            return f"{limit[search.ended_by]} after {search.expansions} expansions; {why}"
        return f"search exhausted after {search.expansions} expansions; {why}"

    def _evaluator(self, robot: Robot) -> DynamicsEvaluator:
        exact = ExactDynamics(self.pool, robot, self.options.timing.options(robot, self.options.cone))
        if self.options.dynamics == "exact":
            return exact
        surrogate = load_surrogate(robot) if self.options.surrogate is None else self.options.surrogate
        return LearnedDynamics(self.pool, surrogate, exact if self.options.ask_when_far else None)

    def _stance(self, state: State) -> Stance:
        return Stance(tuple(None if n < 0 else self.pool.contact(n) for n in state[:4]))
