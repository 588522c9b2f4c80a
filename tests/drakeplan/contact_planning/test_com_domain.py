"""Search states that carry the CoM: the documented costs, merged CoM states, and dynamics that agree with the exact program."""

from __future__ import annotations

from collections import Counter

import numpy as np
import pytest

from drakeplan.contact_planning.com_costs import DynamicWeights
from drakeplan.contact_planning.com_domain import ComDomain
from drakeplan.contact_planning.contact_domain import ContactDomain, PlannerWeights
from drakeplan.contact_planning.contact_plan import PlannerOptions
from drakeplan.contact_planning.contact_pool import ContactPool
from drakeplan.contact_planning.dynamic_domain import COM_CELL
from drakeplan.contact_planning.dynamics_evaluator import ExactDynamics, TransitionEstimates, stance_of
from drakeplan.contact_planning.search_planner import SearchPlanner, SearchSettings
from drakeplan.contact_planning.sequence_dynamics import sequence_dynamics, sequence_problem
from drakeplan.contact_planning.transition_check import TransitionCheck
from drakeplan.context import QueryContext
from drakeplan.query.options import PlanOptions
from drakeplan.query.planning import plan_scene
from drakeplan.search.ana_star import Limits
from optimization.balance.friction import FrictionCone
from optimization.centroidal.transition_dynamics import TransitionDynamics
from optimization.inverse_kinematics.whole_body_ik import WholeBodyIK
from scenes.footholds.start_stance import standing_com, start_stance
from scenes.robots.robot import load_robot
from scenes.scene import Goal, Scene, Start
from scenes.terrain.packed_terrain import pack_terrain
from scenes.terrain.surface import Surface
from scenes.terrain.terrain import Terrain
from scenes.transition_model import transition_model

ROBOT = load_robot("escher")
FLOOR = Surface("floor", np.array([[-1, -1.0, 0], [4, -1.0, 0], [4, 1.0, 0], [-1, 1.0, 0]]))
SCENE = Scene("floor", Terrain((FLOOR,)), Start((0.0, 0.0, 0.0)), Goal((1.0, 0.0, 0.0), 0.2))


@pytest.fixture(scope="module")
def ik() -> WholeBodyIK:
    return WholeBodyIK(ROBOT)


class Cheap:
    """Moves of the left foot are infeasible, all others cost 7 and leave the CoM half a metre further on."""

    def __init__(self) -> None:
        self.asked = Counter()

    def evaluate(self, before, after, com, velocity):
        n = len(after)
        feasible = np.array([a[0] == before[0] for a in after])
        return TransitionEstimates(
            feasible, np.full(n, 7.0), np.tile(com + np.array([0.5, 0, 0]), (n, 1)), np.tile([0.2, 0.0, 0.0], (n, 1))
        )


def domain(ik: WholeBodyIK, evaluator=None, weights: DynamicWeights | None = None):
    packed = pack_terrain(SCENE.terrain)
    pool = ContactPool(packed)
    check = TransitionCheck(pool, ROBOT, ik, packed, FrictionCone.INNER)
    model = transition_model("training")
    options = PlannerOptions(dynamics="exact", model=model)
    contacts = ContactDomain(packed, ROBOT, SCENE.goal, check, options, PlannerWeights())
    dynamic = ComDomain(contacts, evaluator or ExactDynamics(pool, ROBOT), weights)
    stance = start_stance(SCENE, packed, ROBOT)
    held = tuple(-1 if c is None else pool.add_contact(c) for c in stance.contacts)
    return dynamic, dynamic.start(held, standing_com(ROBOT, stance))


def test_the_edge_cost_is_that_of_the_documents(ik) -> None:
    weights = DynamicWeights(distance=2.0, step=5.0, dynamics=0.3)
    dynamic, start = domain(ik, Cheap(), weights)
    states, costs = dynamic.successors(start)
    assert len(states) > 10
    p = dynamic.contacts.pool.p
    for state, cost in zip(states, costs, strict=True):
        way = 0.5 * np.linalg.norm((p[state[0]] + p[state[1]] - p[start[0]] - p[start[1]])[:2])
        assert cost == pytest.approx(2.0 * way + 5.0 + 0.3 * 7.0)


def test_children_that_the_dynamics_forbid_are_not_children(ik) -> None:
    dynamic, start = domain(ik, Cheap())
    states, _ = dynamic.successors(start)
    assert states
    assert all(state[0] == start[0] and state[4] == 1 for state in states)
    assert dynamic.rejections["dynamics"] > 0


def test_com_states_merge_within_a_cell_and_only_there(ik) -> None:
    dynamic, start = domain(ik, Cheap())
    held, centre = start[:4], COM_CELL * np.array([4.0, 8.0, 18.0])
    one = dynamic._com_state(held, centre, np.zeros(3))
    assert dynamic._com_state(held, centre + 0.4 * COM_CELL, np.zeros(3)) == one
    assert dynamic._com_state(held, centre + 0.6 * COM_CELL, np.zeros(3)) != one
    assert dynamic._com_state(held, centre, np.array([0.2, 0, 0])) != one
    assert dynamic._com_state((held[0], held[1], 9, -1), centre, np.zeros(3)) != one


def test_the_heuristic_is_zero_at_the_goal_and_grows_with_distance(ik) -> None:
    dynamic, start = domain(ik, Cheap())
    pool = dynamic.contacts.pool
    x = np.array([0.3, 0.6, 1.0])
    R = np.tile(np.eye(3), (3, 1, 1))
    left = pool.add(0, np.column_stack([x, np.full(3, 0.1), np.zeros(3)]), R, np.zeros(3), np.zeros(3, int))
    right = pool.add(1, np.column_stack([x, np.full(3, -0.1), np.zeros(3)]), R, np.zeros(3), np.zeros(3, int))
    far, near, there = dynamic.heuristic(
        [(int(a), int(b), -1, -1, 0, start[5]) for a, b in zip(left, right, strict=True)]
    )
    assert far > near > there == 0.0


def test_children_go_on_from_where_the_exact_program_leaves_the_com(ik) -> None:
    dynamic, start = domain(ik)
    states, costs = dynamic.successors(start)
    state, cost = states[len(states) // 2], costs[len(states) // 2]
    pool, exact = dynamic.contacts.pool, TransitionDynamics(ROBOT)
    com, velocity = dynamic.com_state(start)
    estimate = exact.estimate(stance_of(pool, start[:4]), stance_of(pool, state[:4]), com, ROBOT.mass * velocity)
    final_com, final_velocity = exact.final_state(estimate)
    got_com, got_velocity = dynamic.com_state(state)
    np.testing.assert_allclose(got_com, final_com, atol=COM_CELL)
    np.testing.assert_allclose(got_velocity, final_velocity, atol=0.1)
    assert cost > 0.1 * estimate.cost


def test_a_com_that_no_body_reaches_is_turned_down(ik) -> None:
    dynamic, start = domain(ik, Cheap())
    com, _ = dynamic.com_state(start)
    assert dynamic.contacts.check.at_com(start[:4], com) == ""
    assert dynamic.contacts.check.at_com(start[:4], com + np.array([1.5, 0.0, 0.0])) != ""


def test_what_the_search_returns_has_dynamics_from_rest_to_rest(ik) -> None:
    options = PlannerOptions(dynamics="exact", model=transition_model("training"))
    planner = SearchPlanner(QueryContext(SCENE, ROBOT, ik), options, SearchSettings(epsilon=0.0))
    plan = next(planner.plans(Limits(expansions=30)))
    estimate = sequence_dynamics(ROBOT, plan.stances, "inner")
    assert estimate.feasible
    trajectory, problem = estimate.trajectory, sequence_problem(ROBOT, plan.stances)
    dt = np.diff(trajectory.t)[:, None]
    weight = np.array([0.0, 0.0, -ROBOT.mass * 9.81])
    force = trajectory.force_W[:-1].sum(axis=1)
    np.testing.assert_allclose(np.diff(trajectory.linear_momentum, axis=0), dt * (force + weight), atol=1e-6)
    np.testing.assert_allclose(trajectory.linear_momentum[-1], 0.0, atol=1e-3)
    assert len(trajectory.t) == problem.schedule.num_knots
    assert planner.dynamic is not None
    assert planner.dynamic.evaluator.asked["exact"] > 0


@pytest.mark.slow
def test_a_plan_over_exact_dynamics_is_verified() -> None:
    result = plan_scene(SCENE, ROBOT, PlanOptions(dynamics="exact", transition_model="training", improve=0.0))
    assert result.status == "complete", result.reason
    assert result.report["transitions_judged"]["exact"] > 0
    assert result.report["time_to_first_feasible_s"] >= result.report["time_to_first_s"]
