"""Planners other than search: their sequences pass the search's own checks and go on to the motion and the verifier."""

from __future__ import annotations

import itertools

import numpy as np
import pytest

from drakeplan.contact_planning.program_planner import FORMULATIONS, ProgramPlanner
from drakeplan.contact_planning.search_planner import SearchPlanner
from drakeplan.context import QueryContext
from drakeplan.query.options import PlanOptions
from drakeplan.query.planning import plan_scene
from drakeplan.search.ana_star import Limits
from optimization.inverse_kinematics.whole_body_ik import WholeBodyIK
from scenes.files.scene_source import load_scene
from scenes.input_error import InputError
from scenes.robots.robot import load_robot
from scenes.scene import Goal, Scene, Start
from scenes.stance import changed_effector
from scenes.terrain.surface import Surface
from scenes.terrain.terrain import Terrain

ESCHER = load_robot("escher")
IK = WholeBodyIK(ESCHER)
LIMITS = Limits(deadline=90.0, improve=0.0)


def plate(name: str, x: tuple[float, float], y: tuple[float, float], z: float = 0.0) -> Surface:
    return Surface(name, np.array([[x[0], y[0], z], [x[1], y[0], z], [x[1], y[1], z], [x[0], y[1], z]]))


def floor_scene(goal: Goal) -> Scene:
    return Scene("floor", Terrain((plate("floor", (-1, 3), (-1, 2)),)), Start((0.0, 0.0, 0.0)), goal)


@pytest.mark.parametrize("formulation", FORMULATIONS)
def test_a_sequence_passes_what_the_search_asks_of_its_own(formulation: str) -> None:
    planner = ProgramPlanner(QueryContext(floor_scene(Goal((0.5, 0, 0), 0.2)), ESCHER, IK), formulation)
    assert not planner.start_problem()
    plan = next(planner.plans(LIMITS), None)
    assert plan is not None, planner.why_not()
    for k, (before, after) in enumerate(itertools.pairwise(plan.stances)):
        assert changed_effector(before, after) == plan.states[k + 1][4]
    assert planner.sequences.why_it_fails(plan.stances) == []
    judge = SearchPlanner(QueryContext(floor_scene(Goal((0.5, 0, 0), 0.2)), ESCHER, IK))
    numbers = {c: judge.domain.pool.add_contact(c) for s in plan.stances for c in s.held}
    states = [tuple(-1 if c is None else numbers[c] for c in s.contacts) for s in plan.stances]
    assert all(not judge.check.transition(a, b) for a, b in itertools.pairwise(states))
    assert judge.domain.is_goal((*states[-1], -1))


def test_the_cost_is_the_searchs_own_measure() -> None:
    planner = ProgramPlanner(QueryContext(floor_scene(Goal((0.5, 0, 0), 0.2)), ESCHER, IK), "gcs")
    plan = next(planner.plans(LIMITS))
    expected = 0.0
    for before, after in itertools.pairwise(plan.stances):
        e = changed_effector(before, after)
        expected += 3.0 + np.linalg.norm(after.contacts[e].p_WC - before.contacts[e].p_WC)
    assert plan.cost == pytest.approx(expected)


def test_what_failed_later_is_not_found_again() -> None:
    planner = ProgramPlanner(QueryContext(load_scene("stairs"), ESCHER, IK), "gcs")
    first = next(planner.plans(LIMITS))
    middle = len(first.states) // 2
    for _ in range(4):  # until nothing is left of the reach there
        planner.forbid(first, middle)
    pair = tuple(first.stances[middle].contacts[e].surface for e in (0, 1))
    assert planner.query.narrowed[pair] < 1.0
    second = next(planner.plans(LIMITS), None)
    assert second is not None, planner.why_not()
    assert second.stances != first.stances


def test_turning_on_the_way_is_planned_in_pieces() -> None:
    planner = ProgramPlanner(QueryContext(floor_scene(Goal((0.3, 0.3, 0), 0.25, np.pi / 3)), ESCHER, IK), "gcs")
    plan = next(planner.plans(LIMITS), None)
    assert plan is not None, planner.why_not()
    feet = plan.stances[-1].contacts[:2]
    assert 0.5 * (feet[0].heading + feet[1].heading) == pytest.approx(np.pi / 3, abs=np.deg2rad(15.1))


def test_a_deadline_an_order_and_a_gap_too_wide_are_told() -> None:
    planner = ProgramPlanner(QueryContext(floor_scene(Goal((1.5, 0, 0), 0.2)), ESCHER, IK), "footsteps")
    assert next(planner.plans(Limits(deadline=0.0)), None) is None
    assert "deadline" in planner.why_not() and planner.counts().ended_by == "deadline"
    assert next(planner.plans(Limits(stop=lambda: True)), None) is None
    assert "cancelled" in planner.why_not()
    island = Terrain((plate("here", (-0.5, 0.5), (-0.5, 0.5)), plate("there", (3, 4), (-0.5, 0.5))))
    gap = Scene("gap", island, Start((0.0, 0.0, 0.0)), Goal((3.5, 0, 0), 0.2))
    planner = ProgramPlanner(QueryContext(gap, ESCHER, IK), "footsteps")
    assert next(planner.plans(LIMITS), None) is None
    assert planner.counts().ended_by == "exhausted"
    assert planner.why_not()


def test_unknown_formulations_are_refused_by_name() -> None:
    with pytest.raises(InputError, match="did you mean"):
        ProgramPlanner(QueryContext(floor_scene(Goal((0.5, 0, 0))), ESCHER, IK), "footstep")


@pytest.mark.slow
@pytest.mark.parametrize("planner", ["footsteps"])
def test_a_verified_plan_comes_of_it(planner: str) -> None:
    result = plan_scene(load_scene("stairs"), ESCHER, PlanOptions(planner=planner, improve=0.0, deadline=90.0))
    assert result.status == "complete", result.reason
    assert result.verification is not None and result.verification.holds
    assert result.plan.provenance["planner"] == planner
