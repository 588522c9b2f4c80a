"""Planning with learned dynamics: where networks answer, where they do not, and that what comes of it holds."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from drakeplan.contact_planning.contact_plan import PlannerOptions
from drakeplan.contact_planning.dynamics_evaluator import ExactDynamics, LearnedDynamics
from drakeplan.contact_planning.search_planner import SearchPlanner
from drakeplan.contact_planning.sequence_dynamics import sequence_dynamics
from drakeplan.context import QueryContext
from drakeplan.query.options import PlanOptions
from drakeplan.query.planning import plan_scene
from drakeplan.query.query import Query
from drakeplan.query.result import PlanResult
from drakeplan.search.ana_star import Limits
from drakeplan.timing.step_timing import Timing
from learning.surrogate import load_surrogate
from learning.weights import NoWeightsError
from optimization.inverse_kinematics.whole_body_ik import WholeBodyIK
from scenes.files.scene_source import load_scene
from scenes.robots.robot import load_robot
from scenes.scene import Goal, Scene, Start
from scenes.terrain.surface import Surface
from scenes.terrain.terrain import Terrain

ROBOT = load_robot("escher")
FLOOR = Surface("floor", np.array([[-1, -1.0, 0], [4, -1.0, 0], [4, 1.0, 0], [-1, 1.0, 0]]))
SHORT = Scene("floor", Terrain((FLOOR,)), Start((0.0, 0.0, 0.0)), Goal((0.6, 0.0, 0.0), 0.3))


@pytest.fixture(scope="module")
def ik() -> WholeBodyIK:
    return WholeBodyIK(ROBOT)


def planner(scene: Scene, ik: WholeBodyIK, seed: int = 0) -> SearchPlanner:
    return SearchPlanner(QueryContext(scene, ROBOT, ik), PlannerOptions(dynamics="learned", seed=seed))


@pytest.mark.parametrize("seed", [0, 1, 2])
def test_what_networks_let_through_holds_together_as_a_whole(ik: WholeBodyIK, seed: int) -> None:
    search = planner(load_scene("rubble_field", seed=seed), ik, seed)
    plan = next(search.plans(Limits(expansions=500)))
    assert sequence_dynamics(ROBOT, plan.stances, "inner").feasible
    assert search.dynamic is not None
    assert search.dynamic.evaluator.asked["learned"] > 100


def test_networks_and_the_exact_program_agree_on_most_first_steps(ik: WholeBodyIK) -> None:
    search = planner(load_scene("rubble_corridor", seed=0), ik)
    assert search.dynamic is not None
    start = search._start_state
    com, velocity = search.dynamic.com_state(start)
    children = [s[:4] for s in search.domain.successors(start[:5])[0]][::4]
    says = search.dynamic.evaluator.evaluate(start[:4], children, com, velocity)
    truth = ExactDynamics(search.domain.pool, ROBOT).evaluate(start[:4], children, com, velocity)
    assert (says.feasible == truth.feasible).mean() > 0.8
    both = says.feasible & truth.feasible
    assert np.abs(says.com[both] - truth.com[both]).mean() < 0.04


def test_ground_as_slippery_as_no_network_has_seen_is_left_to_the_exact_program(ik: WholeBodyIK) -> None:
    ice = dataclasses.replace(SHORT, terrain=Terrain((dataclasses.replace(FLOOR, friction=0.2),)))
    search = planner(ice, ik)
    assert search.dynamic is not None
    search.dynamic.successors(search._start_state)
    asked = search.dynamic.evaluator.asked
    assert asked["exact"] > 0
    assert asked["learned"] == 0


@pytest.mark.parametrize(("friction", "dynamics"), [(0.5, "learned"), (0.8, "quasi-static"), (1.0, "quasi-static")])
def test_networks_are_not_asked_of_slopes_that_only_more_friction_than_they_know_holds(
    friction: float, dynamics: str
) -> None:
    rise = 0.4 * np.tan(np.deg2rad(35.0))
    steep = Surface("ramp", np.array([[4, -1, 0], [4.4, -1, rise], [4.4, 1, rise], [4, 1, 0.0]]), friction)
    rough = dataclasses.replace(FLOOR, friction=friction)
    result = plan_scene(
        dataclasses.replace(SHORT, terrain=Terrain((rough, steep))), ROBOT, PlanOptions(expansions=1, improve=0.0)
    )
    told = any("learned dynamics exist only for friction 0.5, and 'ramp' of 35 deg" in n for n in result.notes)
    assert told == (dynamics == "quasi-static")
    level = plan_scene(
        dataclasses.replace(SHORT, terrain=Terrain((rough,))), ROBOT, PlanOptions(expansions=1, improve=0.0)
    )
    assert not any("learned dynamics exist only" in note for note in level.notes)


def test_without_the_exact_program_a_guess_stands(ik: WholeBodyIK) -> None:
    search = planner(SHORT, ik)
    learned = LearnedDynamics(search.domain.pool, load_surrogate(ROBOT), None)
    assert search.dynamic is not None
    search.dynamic.evaluator = learned
    children, _ = search.dynamic.successors(search._start_state)
    assert children
    assert learned.asked["learned"] >= len(children)
    assert learned.asked["exact"] == 0


@pytest.mark.parametrize(
    ("options", "why"),
    [
        (PlanOptions(timing=Timing(0.6, 0.8)), "--shift 0.6 --swing 0.8"),
        (PlanOptions(cone="square"), "--cone inner"),
        (PlanOptions(friction=0.45), "friction 0.5 and above"),
    ],
)
def test_what_was_not_learned_is_asked_of_the_exact_program_and_that_is_said(options: PlanOptions, why: str) -> None:
    asked = dataclasses.replace(options, dynamics="learned", transition_model="training", expansions=3, improve=0.0)
    result = plan_scene(SHORT, ROBOT, asked)
    assert any(why in note and "exact dynamics are used instead" in note for note in result.notes)
    assert result.report["transitions_judged"]["exact"] > 0
    assert result.report["dynamics"] == "exact"
    usual = plan_scene(SHORT, ROBOT, dataclasses.replace(asked, dynamics=None))
    assert any(why in note and "quasi-static dynamics are used instead" in note for note in usual.notes)
    assert usual.report["dynamics"] == "quasi-static"


def test_more_grip_than_was_learned_from_is_judged_as_if_it_were_less(ik: WholeBodyIK) -> None:
    search = planner(dataclasses.replace(SHORT, terrain=Terrain((dataclasses.replace(FLOOR, friction=0.9),))), ik)
    assert search.dynamic is not None
    children, _ = search.dynamic.successors(search._start_state)
    assert children
    assert search.dynamic.evaluator.asked["learned"] >= len(children)
    assert search.dynamic.evaluator.asked["exact"] == 0


def test_a_robot_without_weights_has_a_clear_message() -> None:
    robot = dataclasses.replace(ROBOT, name="nobody")
    with pytest.raises(NoWeightsError, match="has no learned dynamics"):
        load_surrogate(robot)


@pytest.mark.slow
def test_where_learned_dynamics_lead_nowhere_quasi_static_ones_are_tried(monkeypatch: pytest.MonkeyPatch) -> None:
    run = Query.run

    def fails_if_learned(query: Query, deadline: float, max_repairs: int) -> PlanResult:
        result = run(query, deadline, max_repairs)
        if query.record.dynamics == "learned":
            return dataclasses.replace(result, status="contacts", reason="made to fail")
        return result

    monkeypatch.setattr(Query, "run", fails_if_learned)
    result = plan_scene(SHORT, ROBOT, PlanOptions(improve=0.0))
    assert result.status == "complete", result.reason
    assert result.report["dynamics"] == "quasi-static"
    assert any("made to fail" in note and "planned again" in note for note in result.notes)
    asked = plan_scene(SHORT, ROBOT, PlanOptions(improve=0.0, dynamics="learned"))
    assert asked.status == "contacts"
    assert asked.report["dynamics"] == "learned"
    assert not any("quasi-static" in note for note in asked.notes)


@pytest.mark.slow
def test_a_plan_over_learned_dynamics_is_verified_and_says_what_it_expected() -> None:
    result = plan_scene(load_scene("rubble_field", seed=0), ROBOT, PlanOptions(improve=0.2))
    assert result.report["dynamics"] == "learned"
    assert result.status == "complete", result.reason
    assert result.plan is not None
    assert len(result.plan.provenance["predicted_com"]) == len(result.plan.stances)
