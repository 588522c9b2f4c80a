"""Planning against pushes: cubics between states, eq. 7.3 to 7.5 of Lin 2020 by plain loops, plans of feet alone."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from drakeplan.contact_planning.com_domain import ComDomain
from drakeplan.contact_planning.contact_plan import CaptureName, ContactPlan, PlannerOptions
from drakeplan.contact_planning.search_planner import SearchPlanner
from drakeplan.context import QueryContext
from drakeplan.robustness.robust_domain import RobustDomain, _cubic, _Ways
from drakeplan.search.ana_star import Limits
from drakeplan.timing.step_timing import WALKING
from learning.lift_off import LiftOff, load_lift_off
from learning.transition_batch import TransitionBatch
from optimization.capture.inverted_pendulum import capture_point, depth_inside, support_polygon
from optimization.inverse_kinematics.whole_body_ik import WholeBodyIK
from scenes.disturbance import Disturbance
from scenes.footholds.start_stance import standing_com
from scenes.library import narrow_flat
from scenes.robots.robot import load_robot
from scenes.stance import Stance

ROBOT = load_robot("escher")
SCENE = narrow_flat.named(0)
SHIFT, SWING, LAST = 0.6, 0.4, 0.2  # [s] Lin 2020 sec. 7.7, and the programs' interval after the landing
EVERYWHERE = SCENE.disturbances
NEAR_THE_START = Disturbance(np.array([[30.0, 0.0, 0.0]]), 0.05, (0.3, 4.0, 4.0))

number = st.floats(-2.0, 2.0)
point = st.lists(number, min_size=3, max_size=3).map(np.array)


# ---- the way of the CoM


@given(point, point, point, point, st.floats(0.2, 3.0))
def test_a_cubic_meets_both_its_ends_with_their_velocities(r0, v0, r1, v1, duration: float) -> None:
    ends = (r0[None], v0[None]), (r1[None], v1[None])
    r, v = _cubic(*ends, duration, np.array([0.0, duration]), np.array([0]))
    np.testing.assert_allclose(r, [r0, r1], atol=1e-12)
    np.testing.assert_allclose(v, [v0, v1], atol=1e-12)


@given(point, point, point, point, st.floats(0.2, 3.0), st.floats(0.01, 0.99))
def test_its_velocity_is_its_derivative(r0, v0, r1, v1, duration: float, share: float) -> None:
    ends = (r0[None], v0[None]), (r1[None], v1[None])
    h = 1e-4 * duration
    t = share * duration
    r, v = _cubic(*ends, duration, np.array([t - h, t, t + h]), np.array([0]))
    np.testing.assert_allclose(v[1], (r[2] - r[0]) / (2 * h), atol=1e-5)


@given(point, point, st.floats(0.2, 3.0), st.floats(0.0, 1.0))
def test_between_states_of_one_uniform_motion_it_is_that_motion(r0, v0, duration: float, share: float) -> None:
    ends = (r0[None], v0[None]), ((r0 + duration * v0)[None], v0[None])
    r, v = _cubic(*ends, duration, np.array([share * duration]), np.array([0]))
    np.testing.assert_allclose(r[0], r0 + share * duration * v0, atol=1e-9)
    np.testing.assert_allclose(v[0], v0, atol=1e-9)


def ways(lift: bool, n: int = 5) -> tuple[_Ways, list[tuple[np.ndarray, np.ndarray]]]:
    """Ways of n transitions, and the states that they join."""
    rng = np.random.default_rng(2)
    states = [(rng.normal(size=(n, 3)), rng.normal(size=(n, 3))) for _ in range(3)]
    return _Ways(states[0], states[2], states[1] if lift else None, SHIFT, SHIFT + SWING + LAST), states


@pytest.mark.parametrize("lift", [True, False])
def test_a_way_leads_from_its_start_over_the_lift_to_its_end(lift: bool) -> None:
    way, (start, middle, end) = ways(lift)
    rows = np.arange(5)
    expected = [(0.0, start), (SHIFT + SWING + LAST, end)] + ([(SHIFT, middle)] if lift else [])
    for t, (r, v) in expected:
        found = way.at(np.array([t]), rows)
        np.testing.assert_allclose(found[0], r, atol=1e-12)
        np.testing.assert_allclose(found[1], v, atol=1e-12)
    if lift:
        before, after = way.at(np.array([SHIFT - 1e-9]), rows), way.at(np.array([SHIFT + 1e-9]), rows)
        np.testing.assert_allclose(before[0], after[0], atol=1e-7)
        np.testing.assert_allclose(before[1], after[1], atol=1e-7)


@pytest.mark.parametrize("lift", [True, False])
def test_states_of_one_transition_come_after_each_other(lift: bool) -> None:
    way, _ = ways(lift)
    for t in (np.array([0.1, 0.4]), SHIFT + np.array([0.0, 0.1, 0.3])):
        together = way.at(t, np.array([3, 1]))
        alone = [way.at(np.array([instant]), np.array([row])) for row in (3, 1) for instant in t]
        for k in range(2):
            np.testing.assert_allclose(together[k], np.concatenate([one[k] for one in alone]), atol=1e-12)


# ---- eq. 7.4 and 7.5


@dataclass
class MadeUpOdds:
    """P_reject is a smooth function of foot and state, or the same for all."""

    model: str = "motions"
    always: float | None = None

    def rejection(self, foot: int, com: np.ndarray, velocity: np.ndarray) -> np.ndarray:
        if self.always is not None:
            return np.full(len(com), self.always)
        return 1.0 / (
            1.0 + np.exp(com[:, 0] - 3.0 * com[:, 1] + 2.0 * velocity[:, 1] - 0.7 * velocity[:, 0] - foot % 2)
        )


@pytest.fixture(scope="module")
def planner() -> SearchPlanner:
    context = QueryContext(SCENE, ROBOT, WholeBodyIK(ROBOT), full_soles=True)
    return SearchPlanner(context, PlannerOptions(dynamics="learned", capture="swing", use_palms=False, timing=WALKING))


Made = tuple[RobustDomain, tuple[int, ...], Sequence[tuple[int, ...]]]


def made(
    planner: SearchPlanner,
    capture: CaptureName = "swing",
    disturbances: tuple[Disturbance, ...] = EVERYWHERE,
    odds: MadeUpOdds | None = None,
    lift: LiftOff | None = None,
    weight: float = 1000.0,
) -> Made:
    """A domain with odds that are made up; the start and its successors, and those of one of them."""
    known = planner.dynamic
    assert isinstance(known, RobustDomain)
    domain = RobustDomain(
        planner.domain, known.evaluator, odds or MadeUpOdds(), disturbances, ROBOT, WALKING, capture, lift, weight
    )  # type: ignore[arg-type]
    stance = planner.context.start
    held = tuple(-1 if c is None else planner.domain.pool.add_contact(c) for c in stance.contacts)
    start = domain.start(held, standing_com(ROBOT, stance))  # type: ignore[arg-type]
    first, _ = ComDomain.successors(domain, start)
    state = first[len(first) // 2]
    states, _ = ComDomain.successors(domain, state)
    assert len(states) > 10
    return domain, state, states


def hermite(ends: Sequence[tuple[np.ndarray, np.ndarray]], duration: float, t: float) -> tuple[np.ndarray, np.ndarray]:
    """The cubic a + b t + c t^2 + d t^3 with these ends, from its four equations."""
    T = duration
    A = np.array([[1, 0, 0, 0], [0, 1, 0, 0], [1, T, T**2, T**3], [0, 1, 2 * T, 3 * T**2]])
    k = np.linalg.solve(A, np.array([ends[0][0], ends[0][1], ends[1][0], ends[1][1]]))
    return np.array([1, t, t**2, t**3]) @ k, np.array([0, 1, 2 * t, 3 * t**2]) @ k


def com_at(domain: RobustDomain, state, child, lift: LiftOff | None, t: float) -> tuple[np.ndarray, np.ndarray]:
    start, end, whole = domain.com_state(state), domain.com_state(child), SHIFT + SWING + LAST
    if lift is None:
        return hermite([start, end], whole, t)
    pool = domain.contacts.pool
    batch = TransitionBatch.of_children(
        pool.p, pool.R, np.array(state[:4]), np.array([child[:4]]), *start, pool.frictions
    )
    (r,), (v,) = lift.predict(batch)
    if t < SHIFT:
        return hermite([start, (r, v)], SHIFT, t)
    return hermite([(r, v), end], whole - SHIFT, t - SHIFT)


def by_loops(made: Made, capture: CaptureName, disturbances, odds: MadeUpOdds, lift: LiftOff | None) -> np.ndarray:
    """P_success of every transition, one push at one moment after the other."""
    domain, state, states = made
    moments = {"swing": 4, "worst-case": 1}[capture]
    asked = [(SHIFT + SWING * k / moments, SWING / moments, False) for k in range(moments)]
    if odds.model == "motions":
        shares = {"swing": (0.15, 0.65), "worst-case": (0.65,)}[capture]
        asked += [(SHIFT * share, SHIFT / len(shares), True) for share in shares]
    found = []
    for child in states:
        stays = [k for k in (0, 1) if child[k] == state[k]]
        assert len(stays) == 1
        success = 1.0
        for t, duration, double in asked:
            com, velocity = com_at(domain, state, child, lift, t)
            falls, acting = 0.0, [d for d in disturbances if d.acts_at(com)[0]]
            total = sum(d.probability for d in acting)
            for disturbance in acting:
                some = 1 - (1 - total) ** (duration / 0.1)  # push in this time, of which each has its share
                share = some * disturbance.probability / total / len(disturbance.impulses)
                for impulse in disturbance.impulses:
                    pushed = velocity + impulse / ROBOT.mass
                    fails = 1.0
                    if double:
                        fails = 1.0 - held_by_both(domain, state, com, pushed)
                    if fails > 0.01:
                        for foot in state[:2] if double else [child[stays[0]]]:
                            fails *= 1.0 - odds.rejection(foot, com[None], pushed[None])[0]
                    falls += share * fails
            success *= max(1.0 - falls, 1e-6)
        found.append(success)
    return np.array(found)


def held_by_both(domain: RobustDomain, state, com: np.ndarray, velocity: np.ndarray) -> float:
    """Half where the capture point lies 2 cm outside the feet's support, e-fold within 1 cm."""
    pool = domain.contacts.pool
    feet = [pool.contact(n) for n in state[:2]]
    ground = float(np.mean([foot.p_WC[2] for foot in feet]))
    depth = depth_inside(support_polygon(Stance((*feet, None, None)), ROBOT), capture_point(com, velocity, ground))
    return 1.0 / (1.0 + np.exp(np.clip(-(depth + 0.02) / 0.01, -50, 50)))


@pytest.mark.parametrize("model", ["motions", "poses"])
@pytest.mark.parametrize("capture", ["swing", "worst-case"])
@pytest.mark.parametrize("learned", [True, False])
def test_success_is_what_plain_loops_over_moments_and_pushes_say(
    planner: SearchPlanner, model: str, capture: CaptureName, learned: bool
) -> None:
    lift = load_lift_off(ROBOT, WALKING.times) if learned else None
    assert (lift is not None) == learned
    odds, disturbances = MadeUpOdds(model), (*EVERYWHERE, NEAR_THE_START)
    there = made(planner, capture, disturbances, odds, lift)
    domain, state, states = there
    found = domain.success(state, states)
    twin = by_loops(there, capture, disturbances, odds, lift)
    np.testing.assert_allclose(found, twin, rtol=1e-6 if learned else 1e-9)
    assert len(np.unique(np.round(found, 6))) > 5


def test_without_pushes_or_without_falls_every_transition_succeeds(planner: SearchPlanner) -> None:
    elsewhere = Disturbance(np.array([[300.0, 0.0, 0.0]]), 1.0, (0.1, 0.1, 0.1), np.eye(4) + 50 * np.eye(4, k=3))
    for disturbances, always in (((), 0.0), ((elsewhere,), 0.0), (EVERYWHERE, 1.0)):
        domain, state, states = made(planner, "swing", disturbances, MadeUpOdds(always=always))
        np.testing.assert_array_equal(domain.success(state, states), 1.0)


@pytest.mark.parametrize("capture", ["swing", "worst-case"])
@pytest.mark.parametrize("model", ["motions", "poses"])
def test_more_likely_pushes_make_success_less_likely_but_never_impossible(
    planner: SearchPlanner, model: str, capture: CaptureName
) -> None:
    before = np.inf
    for p in (0.001, 0.01, 0.1, 0.5, 1.0):
        pushes = (Disturbance(np.array([[0.0, 60.0, 0.0], [0.0, -60.0, 0.0]]), p),)
        domain, state, states = made(planner, capture, pushes, MadeUpOdds(model, always=0.0))
        now = domain.success(state, states)
        assert ((now > 0.0) & (now <= 1.0) & (now < before)).all()
        before = now


def test_where_every_push_fells_the_robot_a_swing_stays_calm_or_fails(planner: SearchPlanner) -> None:
    """(1 - p)^4 for four moments of 0.1 s each, and for one of 0.4 s."""
    for capture in ("swing", "worst-case"):
        domain, state, states = made(planner, capture, EVERYWHERE, MadeUpOdds("poses", always=0.0))
        np.testing.assert_allclose(domain.success(state, states), 0.99**4)


@pytest.mark.parametrize("weight", [0.0, 10.0, 1000.0])
def test_the_edge_cost_is_that_of_eq_7_3(planner: SearchPlanner, weight: float) -> None:
    domain, state, states = made(planner, weight=weight)
    again, costs = domain.successors(state)
    assert list(again) == list(states)
    p = domain.contacts.pool.p
    feet = np.array([p[list(s[:2]), :2].mean(axis=0) for s in (state, *states)])
    way = np.linalg.norm(feet[1:] - feet[0], axis=1)
    np.testing.assert_allclose(costs, way + 3.0 - weight * np.log(domain.success(state, states)))


# ---- the search


@pytest.fixture(scope="module")
def plans(planner: SearchPlanner) -> list[ContactPlan]:
    return list(planner.plans(Limits(expansions=20)))


def test_plans_get_cheaper_and_walk_on_the_feet_alone(plans: list[ContactPlan]) -> None:
    assert len(plans) > 3
    for before, after in pairwise(plans):
        assert after.cost < before.cost
    for plan in plans:
        assert all(stance.contacts[2] is None and stance.contacts[3] is None for stance in plan.stances)
        assert all(None not in stance.contacts[:2] for stance in plan.stances)


def test_the_cost_of_a_plan_is_its_way_its_steps_and_its_risk(plans: list[ContactPlan]) -> None:
    for plan in plans:
        assert plan.predicted_success is not None and 0.0 < plan.predicted_success <= 1.0
        way = sum(np.linalg.norm((b.feet_mean() - a.feet_mean())[:2]) for a, b in pairwise(plan.stances))
        steps = len(plan.stances) - 1
        assert plan.cost == pytest.approx(way + 3.0 * steps - 1000.0 * np.log(plan.predicted_success), rel=1e-6)


def test_the_success_of_a_plan_is_the_product_over_its_steps(planner: SearchPlanner, plans: list[ContactPlan]) -> None:
    domain = planner.dynamic
    assert isinstance(domain, RobustDomain)
    states = plans[-1].states
    steps = [domain.success(before, [after])[0] for before, after in pairwise(states)]
    assert plans[-1].predicted_success == pytest.approx(np.prod(steps))
    assert domain.success_of(states[:1]) == 1.0


# ---- the two searches


def test_the_second_search_gives_only_what_is_better_and_both_share_the_expansions(planner: SearchPlanner) -> None:
    for budget in (6, 11):
        costs = [plan.cost for plan in planner.plans(Limits(expansions=budget))]
        assert costs == sorted(costs, reverse=True)
        assert planner.counts().expansions <= budget
    assert not planner.dynamic.expects_risk


def test_the_same_budget_gives_the_same_plans(planner: SearchPlanner, plans: list[ContactPlan]) -> None:
    again = list(planner.plans(Limits(expansions=20)))
    assert [plan.cost for plan in again] == [plan.cost for plan in plans]


def test_expected_risk_grows_with_the_way_that_is_left_and_is_none_where_places_are_sheltered(
    planner: SearchPlanner,
) -> None:
    for box, expected in ((None, True), ((9.0, 9.0, 9.0), False)):
        domain, state, _ = made(planner, disturbances=(Disturbance(EVERYWHERE[0].impulses, 0.05, box),))
        children, _ = domain.successors(state)
        plain = domain.heuristic(children)
        domain.expects_risk = True
        more = domain.heuristic(children) - plain
        assert (more > 0).all() == expected
        if expected:  # the same risk for every metre
            np.testing.assert_allclose(more / more[0], plain / plain[0], rtol=1e-9)
