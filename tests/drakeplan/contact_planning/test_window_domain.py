"""States that carry the end of their path: asked late, charged late, and settled no earlier than the window says."""

from __future__ import annotations

import numpy as np
import pytest

from drakeplan.contact_planning.com_costs import DynamicWeights
from drakeplan.contact_planning.contact_plan import PlannerOptions
from drakeplan.contact_planning.search_planner import SearchPlanner, SearchSettings
from drakeplan.contact_planning.sequence_dynamics import sequence_dynamics, sequence_problem
from drakeplan.contact_planning.window_domain import WindowDomain
from drakeplan.context import QueryContext
from drakeplan.search.ana_star import Limits
from drakeplan.timing.step_timing import Timing
from optimization.balance.friction import FrictionCone, frame_stands_alone
from optimization.centroidal.window_dynamics import WindowDynamics
from optimization.inverse_kinematics.whole_body_ik import WholeBodyIK
from scenes.footholds.start_stance import standing_com
from scenes.library import slippery_slope
from scenes.robots.robot import load_robot
from scenes.scene import Goal, Scene, Start
from scenes.terrain.surface import Surface
from scenes.terrain.terrain import Terrain
from scenes.transition_model import transition_model

ROBOT = load_robot("escher")
FLOOR = Surface("floor", np.array([[-1, -1.0, 0], [4, -1.0, 0], [4, 1.0, 0], [-1, 1.0, 0]]))
SCENE = Scene("floor", Terrain((FLOOR,)), Start((0.0, 0.0, 0.0)), Goal((1.0, 0.0, 0.0), 0.2))
WEIGHTS = DynamicWeights(distance=2.0, step=5.0, dynamics=0.3)


@pytest.fixture(scope="module")
def ik() -> WholeBodyIK:
    return WholeBodyIK(ROBOT)


def planner(ik: WholeBodyIK, window: int = 2, scene: Scene = SCENE, timing: Timing | None = None) -> SearchPlanner:
    model = transition_model("training")
    options = PlannerOptions(dynamics="exact", use_palms=False, timing=timing or Timing(), model=model)
    settings = SearchSettings(window=window, dynamic_weights=WEIGHTS)
    return SearchPlanner(QueryContext(scene, ROBOT, ik), options, settings)


def ahead(found: SearchPlanner, states) -> tuple[int, ...]:
    """The state with the foot that moved farthest ahead."""
    p = found.domain.pool.p
    return max(states, key=lambda s: p[s[s[4]], 0] - abs(abs(p[s[s[4]], 1]) - 0.1))


def walk(found: SearchPlanner, steps: int):
    """States along a straight walk, each confirmed."""
    domain, states = found.dynamic, [found._start_state]
    for _ in range(steps):
        children, _ = domain.successors(states[-1])
        child = ahead(found, children)
        assert domain.confirm(states[-1], child)
        states.append(child)
    return states


def test_nothing_is_asked_until_a_state_is_confirmed(ik) -> None:
    found = planner(ik)
    children, costs = found.dynamic.successors(found._start_state)
    assert len(children) > 20
    assert found.dynamic.evaluator.asked["exact"] == 0
    p, start = found.domain.pool.p, found._start_state
    for child, cost in zip(children, costs, strict=True):
        way = 0.5 * np.linalg.norm((p[child[0]] + p[child[1]] - p[start[0]] - p[start[1]])[:2])
        assert cost == pytest.approx(2.0 * way + 5.0)
    assert found.dynamic.confirm(start, ahead(found, children))
    assert found.dynamic.evaluator.asked["exact"] == 1


def test_a_step_is_not_confirmed_when_the_body_starts_beside_the_feet(ik) -> None:
    """At rest with the CoM 0.4 m beside the feet the capture point is off the support, so the body falls."""
    found = planner(ik)
    held = found._start_state[:4]
    com, _ = found.dynamic.com_state(found._start_state)
    beside = found.dynamic.start(held, com + np.array([0.0, 0.4, 0.0]))
    children, _ = found.dynamic.successors(beside)
    assert not found.dynamic.confirm(beside, ahead(found, children))
    assert found.dynamic.rejections["dynamics"] == 1


def test_an_answer_is_kept(ik) -> None:
    found = planner(ik)
    states = walk(found, 1)
    assert found.dynamic.confirm(states[0], states[1])
    assert found.dynamic.evaluator.asked["exact"] == 1


def test_the_late_cost_is_the_mean_effort_of_the_tail(ik) -> None:
    found = planner(ik, window=3)
    states = walk(found, 2)
    stances = [found._stance(state) for state in states]
    tail = WindowDynamics(ROBOT, Timing().options(ROBOT, "inner"))
    start = found.dynamic._windows[states[0][5]].start
    truth = tail.solve(start, stances)
    assert found.dynamic.late_cost(states[2]) == pytest.approx(0.3 * truth.cost / 2, rel=1e-6)
    np.testing.assert_allclose(start.com, standing_com(ROBOT, stances[0]))


def test_a_full_tail_starts_where_its_parent_had_its_second_stance_begin(ik) -> None:
    found = planner(ik, window=2)
    states = walk(found, 3)
    tails = [found.dynamic._windows[state[5]] for state in states]
    assert [len(tail.held) - 1 for tail in tails] == [0, 1, 2, 2]
    assert tails[3].held[0] == states[1][:4]
    np.testing.assert_array_equal(tails[3].start.com, tails[2].second.com)
    assert np.linalg.norm(tails[3].start.linear_momentum) > 0


def test_the_com_of_a_state_is_unknown_until_it_is_confirmed(ik) -> None:
    found = planner(ik)
    children, _ = found.dynamic.successors(found._start_state)
    with pytest.raises(ValueError, match="not been confirmed"):
        found.dynamic.com_state(children[0])


def test_static_balance_is_asked_for_too_where_it_is_required(ik) -> None:
    found = planner(ik)
    children, _ = found.dynamic.successors(found._start_state)
    child = ahead(found, children)
    assert found.dynamic.confirm(found._start_state, child)
    found.dynamic.static_balance = True
    found.domain.check.transition = lambda before, after: "balance"
    assert not found.dynamic.confirm(found._start_state, child)
    assert found.dynamic.rejections["balance"] == 1


def test_a_window_has_at_least_one_transition(ik) -> None:
    found = planner(ik)
    with pytest.raises(ValueError, match="window"):
        WindowDomain(found.domain, found.dynamic.evaluator, window=0)


@pytest.mark.slow
def test_the_search_finds_a_way_down_a_slope_that_holds_nobody_and_no_foot_slips(ik) -> None:
    scene, timing = slippery_slope.named(length=0.8), Timing(0.3, 0.6)
    found = planner(ik, 5, scene, timing)
    plan = next(found.plans(Limits(expansions=60)))
    on_it = [c for stance in plan.stances for c in stance.held if c.surface == 1]
    assert on_it
    assert not any(frame_stands_alone(FrictionCone.SECOND_ORDER.code, 0.5, c.R_WC) for c in on_it)
    assert any(all(c.surface == 1 for c in stance.held) for stance in plan.stances)
    estimate = sequence_dynamics(ROBOT, plan.stances, "inner", timing)
    assert estimate.feasible, estimate.reason
    contacts = sequence_problem(ROBOT, plan.stances, timing).schedule.contacts
    held = estimate.trajectory.contact[:-1]
    for n, e in zip(*np.nonzero(held >= 0), strict=True):
        f = contacts[held[n, e]].R_WC.T @ estimate.trajectory.force_W[n, e]
        assert np.hypot(f[0], f[1]) <= 0.5 * f[2] + 1e-3  # [N]
