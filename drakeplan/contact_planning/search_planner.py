"""Searches for the contact sequence: where feet and palms go, one after the other (Lin 2020 ch. III and sec. 6.4)."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, cast

import numpy as np

from drakeplan.contact_planning.com_costs import DynamicWeights
from drakeplan.contact_planning.com_domain import ComDomain
from drakeplan.contact_planning.contact_domain import (
    ON_A_GRID,
    ContactDomain,
    PlannerWeights,
    State,
    cost_per_metre,
)
from drakeplan.contact_planning.contact_plan import ContactPlan, PlannerCounts, PlannerOptions
from drakeplan.contact_planning.contact_pool import ContactPool
from drakeplan.contact_planning.domain_parts import DistanceToGo
from drakeplan.contact_planning.dynamic_domain import DynamicDomain
from drakeplan.contact_planning.dynamics_evaluator import DynamicsEvaluator, ExactDynamics, LearnedDynamics
from drakeplan.contact_planning.planner import ContactPlanner
from drakeplan.contact_planning.reachability import UNREACHABLE, unreachable, walled_off
from drakeplan.contact_planning.transition_check import TransitionCheck
from drakeplan.contact_planning.window_domain import HEURISTIC_WEIGHT, WINDOW, WindowDomain
from drakeplan.context import QueryContext
from drakeplan.search.ana_star import AnaStar, Domain, Limits
from learning.surrogate import DynamicsSurrogate, load_surrogate
from optimization.centroidal.options import CentroidalOptions
from optimization.centroidal.window_dynamics import WindowDynamics
from scenes.footholds.goal_footholds import nobody_fits
from scenes.footholds.start_stance import standing_com
from scenes.input_error import InputError
from scenes.stance import Stance

if TYPE_CHECKING:
    from drakeplan.robustness.robust_domain import RobustDomain

PATIENCE = 1.0  # what each state that is expanded adds to the heuristic of those like it: about that of 10 cm
LIMIT_REACHED = {"deadline": "deadline", "cancelled": "cancelled", "expansions": "expansion budget spent"}


@dataclass(frozen=True)
class SearchSettings:
    """What can be chosen about the search itself.

    Attributes:
        weights: of the edge cost (Lin 2020 eq. 3.2).
        epsilon: probability of a random expansion (Lin 2020 sec. 6.4).
        window: transitions at the end of a path that the exact program is asked about together, once one is popped; 0:
            each transition on its own from where the one before it ended, all children at once (Lin 2020 sec. 6.4).
        surrogate: for "learned" dynamics; None: the one that comes with drakeplan.
        ask_when_far: whether the exact program answers for transitions that are far from what was learned.
        dynamic_weights: of the edge cost (Lin 2020 eq. 6.6), where transitions are judged by their dynamics.
    """

    weights: PlannerWeights = field(default_factory=PlannerWeights)
    epsilon: float = 0.1
    window: int = WINDOW
    surrogate: DynamicsSurrogate | None = None
    ask_when_far: bool = True
    dynamic_weights: DynamicWeights = field(default_factory=DynamicWeights)


class SearchPlanner:
    """ANA* over contact stances; see `drakeplan.contact_planning.planner.ContactPlanner`.

    Attributes:
        context: of the query.
        check: what decides whether the body can do a step.
        domain: the contacts as a search problem.
        dynamic: the same with the CoM, None for quasi-static dynamics.
        setup_s: seconds it took to pack the terrain and to set the robot down.
        search: the search that `plans` runs, None before.
    """

    def __init__(
        self, context: QueryContext, options: PlannerOptions | None = None, settings: SearchSettings | None = None
    ) -> None:
        """Prepares the search.

        Args:
            context: of the query.
            options: what is asked of any planner.
            settings: of this one.

        Raises:
            InputError: start or goal missing or off the terrain; no usable weights for learned dynamics.
        """
        began = time.perf_counter()
        self.context, self.options = context, options or PlannerOptions()
        self.settings = settings or SearchSettings()
        start, options = context.start, self.options
        self._pool = ContactPool(context.packed)
        self.check = TransitionCheck(
            self._pool, context.robot, context.ik, context.packed, context.cone, context.reserve
        )
        self.domain = ContactDomain(
            context.packed,
            context.robot,
            context.goal,
            self.check,
            options,
            self.settings.weights,
            self._distances(),
            start.contacts[0].heading if start.contacts[0] else 0.0,
        )
        self.domain.full_soles = context.full_soles
        self.domain.least_support = context.reserve.support * min(
            min(foot.half_extent) for foot in context.robot.effectors[:2]
        )
        held = tuple(-1 if c is None else self._pool.add_contact(c) for c in start.contacts)
        self._start_state: State = (*held, -1)
        self._heuristic_weight = np.inf
        self.dynamic = self._dynamic_domain()
        if self.dynamic is not None:
            self._start_state = self.dynamic.start(held, standing_com(context.robot, start))
        self.search: AnaStar[State] | None = None
        self._unreachable: str | None = None
        self.setup_s = time.perf_counter() - began

    def _distances(self) -> DistanceToGo:
        """What the heuristic measures the way to the goal by; one with traversability serves all attempts of a query."""
        context, options, weights = self.context, self.options, self.settings.weights
        if options.heuristic != "traversability":
            return context.torso_grid
        from drakeplan.guide.traversability_grid import traversability_grid

        key = f"traversability_grid {options.chosen_estimator} {options.use_palms}"
        if key not in context.made:
            per_metre = cost_per_metre(weights, options.longest_travel(context.robot))
            context.made[key] = traversability_grid(
                context, options.use_palms, per_metre, weights.step, options.chosen_estimator
            )
        return cast("DistanceToGo", context.made[key])

    def _dynamic_domain(self) -> DynamicDomain | None:
        """The domain whose states carry the CoM, where dynamics are asked for."""
        settings, dynamics = self.settings, self.options.dynamics
        if dynamics == "quasi-static":
            return None
        if self.options.capture != "none":
            return self._robust_domain()
        if dynamics == "exact" and settings.window:
            self._heuristic_weight = HEURISTIC_WEIGHT
            program = WindowDynamics(self.context.robot, self._centroidal_options())
            return WindowDomain(self.domain, program, settings.dynamic_weights, settings.window)
        return ComDomain(self.domain, self._evaluator(), settings.dynamic_weights)

    def _robust_domain(self) -> DynamicDomain:
        """The domain whose edges cost what pushes may do."""
        from drakeplan.robustness.capture_odds import CaptureOdds
        from drakeplan.robustness.capture_poses import CapturePoses
        from drakeplan.robustness.robust_domain import CAPTURE_WEIGHT, RobustDomain
        from learning.capture_networks import load_capture
        from learning.lift_off import load_lift_off

        context, options = self.context, self.options
        networks = load_capture(context.robot, "documented" if options.odds == "poses" else "ensemble")
        poses = CapturePoses(context.packed, context.robot, self._pool, palms=options.catch_palms)
        odds = CaptureOdds(networks, poses, "poses" if options.odds == "poses" else "motions")
        odds.require_friction(np.array([surface.friction for surface in context.scene.terrain.surfaces]))
        if not context.scene.disturbances:
            raise InputError(
                f"scene {context.scene.name}: --capture {options.capture} plans against pushes, and it has none: add "
                "`disturbances` to the scene file"
            )
        return RobustDomain(
            self.domain,
            self._evaluator(),
            odds,
            context.scene.disturbances,
            context.robot,
            options.timing,
            options.capture,
            load_lift_off(context.robot, options.timing.times),
            0.0 if options.odds == "off" else CAPTURE_WEIGHT,
        )

    def _evaluator(self) -> DynamicsEvaluator:
        robot, settings = self.context.robot, self.settings
        exact = ExactDynamics(self._pool, robot, self._centroidal_options())
        if self.options.dynamics == "exact":
            return exact
        surrogate = settings.surrogate or load_surrogate(robot, times=self.options.timing.times)
        return LearnedDynamics(self._pool, surrogate, exact if settings.ask_when_far else None)

    def _centroidal_options(self) -> CentroidalOptions:
        return self.options.timing.options(self.context.robot, self.context.cone, reserve=self.context.reserve)

    def start_problem(self) -> str:
        """Why the robot cannot stand at the start, "" if it can."""
        reason = self.check.stance(self._start_state[:4])
        return reason and f"start infeasible: {reason}"

    def plans(self, limits: Limits, clock: Callable[[], float] = time.perf_counter) -> Iterator[ContactPlan]:
        """Yields ever cheaper plans until a limit fires; `why_not` explains the lack of one.

        Args:
            limits: deadline [s], expansions and the like.
            clock: seconds; what the deadline is measured by.
        """
        if self.goal_unreachable():
            return
        if not np.isfinite(self._start_distance()):
            self.domain.beyond_grid = True
        began, found = clock(), False
        run = self._run if self.options.capture == "none" or self.dynamic is None else self._run_twice
        for plan in run(limits, clock, 0):
            found = True
            yield plan
        search = self.search
        if found or search is None or search.ended_by != "exhausted" or self.domain.beyond_grid:
            return
        # All that the grid allows was tried. It is a guess: the rest of the time goes to what it leaves out.
        self.domain.beyond_grid = self.options.heuristic in ON_A_GRID
        if self.domain.beyond_grid:
            left = None if limits.deadline is None else max(limits.deadline - (clock() - began), 0.0)
            yield from self._run(replace(limits, deadline=left), clock, search.expansions)

    def goal_unreachable(self) -> str:
        """Why nobody can stand at the goal, no steps lead there or solids are in between; "" where none is proved."""
        if self._unreachable is None:
            context, reach = self.context, self.options.step_reach(self.context.robot)
            terrain, robot, goal = context.scene.terrain, context.robot, context.goal
            full = context.full_soles
            nobody = nobody_fits(terrain, context.packed, robot, goal, reach, full)
            self._unreachable = f"{UNREACHABLE}: {nobody}" if nobody else ""
            self._unreachable = self._unreachable or unreachable(
                terrain, robot, reach, context.start, goal, full, context.packed
            )
            if not self._unreachable and not np.isfinite(self._start_distance()):
                self._unreachable = walled_off(terrain, context.packed, robot, reach, context.start, goal, full)
        return self._unreachable

    def _run_twice(self, limits: Limits, clock: Callable[[], float], expansions: int) -> Iterator[ContactPlan]:
        """A hurried search that expects risk all the way, and with the other half of time and expansions one that is neither.

        The first asks at fewer moments of a swing, which makes it three times as fast; its plans count at what they cost by the
        chosen moments. The second one gives only what is better.
        """
        dynamic = cast("RobustDomain", self.dynamic)
        half = replace(
            limits,
            improve=None if limits.improve is None else limits.improve / 2.0,
            expansions=None if limits.expansions is None else (limits.expansions + 1) // 2,
        )
        best, began = np.inf, clock()
        dynamic.expects_risk = dynamic.hurried = True
        try:
            for plan in self._run(half, clock, expansions):
                dynamic.hurried = False
                cost = dynamic.cost_of(plan.states)
                if cost < best:
                    best = cost
                    yield replace(plan, cost=cost, predicted_success=dynamic.success_of(plan.states))
                dynamic.hurried = True
        finally:
            dynamic.expects_risk = dynamic.hurried = False
        if self.search is None or self.search.ended_by in ("deadline", "cancelled"):
            return
        left = [] if limits.deadline is None else [max(limits.deadline - (clock() - began), 0.0)]
        if limits.improve is not None and np.isfinite(best):
            left.append(limits.improve / 2.0)
        rest = replace(limits, deadline=min(left, default=None))
        yield from self._run(rest, clock, self.search.expansions, best)
        if self.search.ended_by == "deadline" and np.isfinite(best):
            self.search.ended_by = "improve"

    def _run(
        self, limits: Limits, clock: Callable[[], float], expansions: int, best: float = np.inf
    ) -> Iterator[ContactPlan]:
        """One search for plans that cost less than `best`, which counts its expansions from this number on."""
        domain: Domain[State] = self.domain if self.dynamic is None else self.dynamic
        self.search = AnaStar(
            domain, self._start_state, self.settings.epsilon, self.options.seed, limits, expansions, best_cost=best,
            clock=clock,
        )  # fmt: skip
        self.search.heuristic_weight = self._heuristic_weight
        if self.options.footholds == "snapped":  # many footholds differ by little
            self.search.alike, self.search.patience = self.domain.alike, PATIENCE
        for found in self.search.run():
            stances = tuple(self._stance(s) for s in found.path)
            bound = found.bound if self.options.heuristic == "admissible" else None
            elapsed = self.setup_s + found.elapsed
            plan = ContactPlan(stances, found.path, found.cost, bound, found.expansions, elapsed)
            yield plan if self.dynamic is None else self._with_dynamics(self.dynamic, plan)

    def _with_dynamics(self, dynamic: DynamicDomain, plan: ContactPlan) -> ContactPlan:
        """The plan with what the search knows of its dynamics."""
        com = np.array([dynamic.com_state(s)[0] for s in plan.states])
        if self.options.capture != "none":
            return replace(
                plan, predicted_com=com, predicted_success=cast("RobustDomain", dynamic).success_of(plan.states)
            )
        return replace(plan, predicted_com=com, predicted_effort=dynamic.costs.effort(plan.states, plan.cost))

    def forbid(self, plan: ContactPlan, transition: int) -> None:
        """Forbids a transition that failed a later, stricter check, so that the next search avoids it.

        Args:
            plan: one that this planner gave.
            transition: k, from stance k to stance k + 1.
        """
        self.domain.forbid(plan.states[transition], plan.states[transition + 1])

    def ask_for_swings(self, swing_is_clear: Callable[[Stance, Stance], bool]) -> None:
        """From now on refuses every transition whose foot or palm finds no way past the terrain.

        Args:
            swing_is_clear: whether what moves from one stance to the next finds one.
        """
        self.check.swing_is_clear = swing_is_clear

    def require_static_balance(self, required: bool) -> bool:
        """Sets whether transitions with dynamics must also pass static balance at their critical configurations.

        Args:
            required: whether they must.

        Returns:
            Whether that is a change; never for quasi-static dynamics, which ask it always.
        """
        if self.dynamic is None or self.dynamic.static_balance == required:
            return False
        self.dynamic.static_balance = required
        return True

    def counts(self) -> PlannerCounts:
        """What the last run of `plans` did."""
        judged = {} if self.dynamic is None else dict(self.dynamic.evaluator.asked)
        if self.search is None:
            return PlannerCounts(transitions_judged=judged)
        return PlannerCounts(self.search.expansions, self.search.ended_by, judged)

    def why_not(self) -> str:
        """Why there is no plan, in one line."""
        if self._unreachable:
            return self._unreachable
        search = self.search
        if search is None:
            return "not searched yet"
        counts = ", ".join(f"{name} {count}" for name, count in self.domain.rejections.most_common() if count)
        why = f"candidates rejected by: {counts or 'nothing'}"
        if not np.isfinite(self._start_distance()):
            why = f"the grid knows no way for the torso box from start to goal (which is no proof); {why}"
        if search.ended_by in LIMIT_REACHED:
            return f"{LIMIT_REACHED[search.ended_by]} after {search.expansions} expansions; {why}"
        return f"search exhausted after {search.expansions} expansions; {why}"

    def nearest(self) -> tuple[tuple[float, float, float], float] | None:
        """Where the mean of the feet came nearest to the goal in the last search, and how near [m]; None before one."""
        states = [] if self.search is None else self.search.reached()
        if not states:
            return None
        means = np.array([self._stance(s).feet_mean() for s in states])
        away = np.hypot(*(means[:, :2] - self.context.goal.xyz[:2]).T)
        x, y, z = means[np.argmin(away)].tolist()
        return (x, y, z), float(away.min())

    def _start_distance(self) -> float:
        """Distance from the start to the goal, as the heuristic measures it without going beyond the grid [m]."""
        beyond, self.domain.beyond_grid = self.domain.beyond_grid, False
        distance = float(self.domain.distance_to_go([self._start_state[:5]])[0])
        self.domain.beyond_grid = beyond
        return distance

    def _stance(self, state: State) -> Stance:
        return Stance(tuple(None if n < 0 else self._pool.contact(n) for n in state[:4]))


def build(context: QueryContext, options: PlannerOptions) -> ContactPlanner:
    """The planner "search" of `drakeplan.contact_planning.planner.PLANNERS`.

    Args:
        context: of the query.
        options: what is asked of it.
    """
    return SearchPlanner(context, options)
