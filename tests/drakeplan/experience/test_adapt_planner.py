"""Stored plans laid on terrain, fitted and checked: what comes out is a way for this robot, from where it stands to the goal."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import numpy as np
import pytest

from drakeplan.contact_planning.contact_plan import ContactPlan, FitName, PlannerOptions
from drakeplan.contact_planning.planner import make_planner
from drakeplan.context import QueryContext
from drakeplan.experience.adapt_planner import AdaptPlanner
from drakeplan.experience.library import Library
from drakeplan.experience.stored_plan import store_plan
from drakeplan.plan.plan import Plan
from drakeplan.plan.plan_file import write_plan
from drakeplan.query.options import PlanOptions
from drakeplan.query.planning import plan_scene
from drakeplan.search.ana_star import Limits
from drakeplan.verifier import verify
from optimization.inverse_kinematics.whole_body_ik import WholeBodyIK
from scenes.files.scene_source import load_scene
from scenes.input_error import InputError
from scenes.library.plates import level_plate, tilted_plate
from scenes.robots.robot import load_robot
from scenes.scene import Goal, Scene, Start
from scenes.stance import changed_effector
from scenes.terrain.terrain import terrain_from

ESCHER = load_robot("escher")
IK = WholeBodyIK(ESCHER)
FAR = (0.9, 0.0)  # where the stored plan leads [m]


def floor(goal: tuple[float, float], *, z: float = 0.0, yaw: float = 0.0, goal_yaw: float | None = None) -> Scene:
    """A level floor at a height, and somewhere on it a start and a goal."""
    ground = level_plate("floor", (-2.0, 4.0), (-2.0, 2.0), z)
    start = Start((0.0, 0.0, z), yaw)
    return Scene("floor", terrain_from([ground]), start, Goal((*goal, z), 0.12, goal_yaw))


@pytest.fixture(scope="module")
def walk() -> Plan:
    """Some steps straight ahead on a level floor."""
    options = PlanOptions(dynamics="quasi-static", expansions=60, deadline=120.0, use_palms=False)
    result = plan_scene(floor(FAR), ESCHER, options)
    assert result.status == "complete", result.reason
    assert result.plan is not None
    return result.plan


@pytest.fixture(scope="module")
def library(walk: Plan, tmp_path_factory: pytest.TempPathFactory) -> str:
    folder = tmp_path_factory.mktemp("experience") / "library"
    with Library.create(folder, ESCHER) as made:
        assert made.add(store_plan(walk)).added
    return str(folder)


def planner(scene: Scene, library: str, fit: FitName = "quick") -> AdaptPlanner:
    return AdaptPlanner(QueryContext(scene, ESCHER, IK), PlannerOptions(library=library, fit=fit))


def first(found: AdaptPlanner) -> ContactPlan:
    plan = next(found.plans(Limits(deadline=60.0)), None)
    assert plan is not None, found.why_not()
    return plan


def test_the_sequence_begins_where_the_robot_stands_and_ends_in_the_goal(library: str) -> None:
    scene = floor(FAR, z=0.3)
    found = planner(scene, library)
    plan = first(found)
    assert plan.stances[0] == found.context.start
    mean = plan.stances[-1].feet_mean()
    assert np.hypot(*(mean[:2] - FAR)) <= scene.goal.radius
    assert mean[2] == pytest.approx(0.3, abs=1e-6)
    for before, after in zip(plan.stances, plan.stances[1:], strict=False):
        changed_effector(before, after)  # raises where they differ in more than one
    assert plan.origin == (found.retrieved[0].name,)


@pytest.mark.parametrize("angle", [np.pi / 2, -2.0, np.pi])
def test_a_plan_is_turned_towards_the_goal(library: str, angle: float) -> None:
    goal = (0.9 * float(np.cos(angle)), 0.9 * float(np.sin(angle)))
    plan = first(planner(floor(goal, yaw=angle), library))
    assert np.hypot(*(plan.stances[-1].feet_mean()[:2] - goal)) <= 0.12


@pytest.mark.parametrize("fit", ["quick", "strip", "strip_ends"])
def test_contacts_go_to_the_stones_that_are_there(library: str, fit: FitName) -> None:
    rng = np.random.default_rng(1)
    stones = [
        tilted_plate(f"stone_{i}_{j}", (0.3 * i, 0.3 * j - 0.15, float(rng.uniform(-0.04, 0.04))),
                     np.array([[-0.14, -0.14], [0.14, -0.14], [0.14, 0.14], [-0.14, 0.14]]),
                     *(float(a) for a in rng.uniform(-0.15, 0.15, 2)))
        for i in range(-1, 5) for j in range(2)
    ]  # fmt: skip
    ground = level_plate("start", (-0.2, 0.16), (-0.35, 0.35))
    scene = Scene("stones", terrain_from([ground, *stones]), Start((0.0, 0.0, 0.0)), Goal((*FAR, 0.0), 0.2))
    found = planner(scene, library, fit)
    plan = first(found)
    packed = found.context.packed
    for stance in plan.stances[1:]:
        for contact in stance.held:
            height = contact.p_WC @ packed.normal[contact.surface] - packed.offset[contact.surface]
            assert abs(height) < 1e-6
            assert contact.R_WC[:, 2] @ packed.normal[contact.surface] > 1.0 - 1e-6
    assert {contact.surface for contact in plan.stances[-1].held} - {0}


def test_a_sequence_that_is_refused_comes_back_with_other_contacts_or_not_at_all(library: str) -> None:
    plates = [level_plate(f"plate_{k}", (0.3 * k - 0.3, 0.3 * k), (-1.0, 1.0)) for k in range(6)]
    scene = Scene("plates", terrain_from(plates), Start((-0.15, 0.0, 0.0)), Goal((0.75, 0.0, 0.0), 0.2))
    found = planner(scene, library)
    seen = []
    for _ in range(6):
        plan = next(found.plans(Limits(deadline=60.0)), None)
        if plan is None:
            break
        seen.append(tuple(stance for stance in plan.stances))
        found.forbid(plan, len(plan.stances) // 2)
    assert seen
    assert len(set(seen)) == len(seen)


def test_a_goal_beyond_every_plan_is_reached_by_several_in_a_row(library: str) -> None:
    found = planner(floor((2.6, 0.3)), library)
    plan = first(found)
    assert len(plan.origin) == 3
    assert np.hypot(*(plan.stances[-1].feet_mean()[:2] - (2.6, 0.3))) <= 0.12
    assert all(before != after for before, after in zip(plan.stances, plan.stances[1:], strict=False))


def test_a_plan_is_cut_for_a_near_goal(library: str, walk: Plan) -> None:
    plan = first(planner(floor((0.5, 0.0)), library))
    assert len(plan.stances) < len(walk.stances)


def test_a_heading_at_the_goal_counts(library: str) -> None:
    assert first(planner(floor(FAR, goal_yaw=0.0), library)).stances
    turned = planner(floor(FAR, goal_yaw=1.5), library)
    assert next(turned.plans(Limits(deadline=60.0)), None) is None
    assert "goal" in turned.why_not()


def test_where_there_is_no_ground_no_plan_fits_and_that_is_said(library: str) -> None:
    pads = [level_plate("start", (-0.4, 0.2), (-0.5, 0.5)), level_plate("goal", (0.75, 1.2), (-0.5, 0.5), z=0.6)]
    scene = Scene("cliff", terrain_from(pads), Start((-0.1, 0.0, 0.0)), Goal((0.95, 0.0, 0.6), 0.2))
    found = planner(scene, library)
    assert next(found.plans(Limits(deadline=60.0)), None) is None
    assert found.why_not().startswith("no stored plan fits: ")
    assert found.counts().ended_by == "exhausted"


def test_time_that_is_over_ends_it_and_a_later_call_goes_on(library: str) -> None:
    found = planner(floor(FAR), library)
    assert next(found.plans(Limits(deadline=0.0)), None) is None
    assert found.counts().ended_by == "deadline"
    assert next(found.plans(Limits(stop=lambda: True)), None) is None
    assert found.counts().ended_by == "cancelled"
    assert first(found).stances


def test_the_same_query_gives_the_same_sequence(library: str) -> None:
    one, two = (first(planner(floor((0.8, 0.2)), library)) for _ in range(2))
    assert one.stances == two.stances


def test_an_empty_library_is_said_to_be_empty(tmp_path: Path) -> None:
    Library.create(tmp_path / "empty", ESCHER)
    found = planner(floor(FAR), str(tmp_path / "empty"))
    assert next(found.plans(Limits(deadline=5.0)), None) is None
    assert "holds no plan" in found.why_not()


def test_no_library_and_that_of_another_robot_are_bad_input(library: str, tmp_path: Path) -> None:
    with pytest.raises(InputError, match="no library there"):
        planner(floor(FAR), str(tmp_path))
    other = dataclasses.replace(ESCHER, name="other", model_sha256="0" * 64)
    with pytest.raises(InputError, match="a library of robot 'escher' with another model"):
        AdaptPlanner(QueryContext(floor(FAR), other, IK), PlannerOptions(library=library))
    with pytest.raises(InputError, match="no library comes with robot 'other'"):
        AdaptPlanner(QueryContext(floor(FAR), other, IK), PlannerOptions())


# ---- whole queries


def test_an_adapted_plan_is_verified_and_names_where_it_comes_from(library: str, tmp_path: Path) -> None:
    scene = load_scene("stairs")  # longer than the stored walk
    result = plan_scene(scene, ESCHER, PlanOptions(planner="adapt", library=library, search_too=False, deadline=60.0))
    assert result.status == "complete", result.reason
    assert result.report["adapted_from"]
    assert result.plan is not None
    assert result.plan.provenance["adapted_from"] == result.report["adapted_from"]
    write_plan(result.plan, tmp_path / "stairs.h5")
    assert verify(tmp_path / "stairs.h5").holds


def test_where_no_plan_fits_the_search_is_asked_and_that_is_said(tmp_path: Path) -> None:
    Library.create(tmp_path / "empty", ESCHER)
    options = PlanOptions(planner="adapt", library=str(tmp_path / "empty"), dynamics=None, deadline=60.0, improve=0.0)
    result = plan_scene(floor(FAR), ESCHER, options)
    assert result.status == "complete", result.reason
    assert result.report["planner"] == "search"
    assert any("no stored plan became a verified one" in note for note in result.notes)


def test_both_at_once_give_the_first_verified_plan(library: str) -> None:
    result = plan_scene(floor(FAR), ESCHER, PlanOptions(planner="parallel", library=library, deadline=60.0))
    assert result.status == "complete", result.reason
    assert any("which was the first" in note for note in result.notes)
    assert result.report["planner"] in ("search", "adapt")


def test_without_a_library_the_search_is_alone_and_that_is_said(tmp_path: Path) -> None:
    options = PlanOptions(planner="parallel", library=str(tmp_path / "none"), deadline=60.0, improve=0.0)
    result = plan_scene(floor(FAR), ESCHER, options)
    assert result.status == "complete", result.reason
    assert result.report["planner"] == "search"
    assert any("adapt: " in note and "no library there" in note for note in result.notes)


def test_a_start_off_the_terrain_is_bad_input_for_both_at_once(library: str) -> None:
    scene = dataclasses.replace(floor(FAR), start=Start((50.0, 0.0, 0.0)))
    with pytest.raises(InputError):
        plan_scene(scene, ESCHER, PlanOptions(planner="parallel", library=library, deadline=10.0))


def test_both_at_once_stop_when_they_are_asked_to(library: str) -> None:
    options = PlanOptions(planner="parallel", library=library, deadline=60.0, stop=lambda: True)
    result = plan_scene(floor(FAR), ESCHER, options)
    assert result.status != "complete"


def test_the_registry_knows_the_planner(library: str) -> None:
    context = QueryContext(floor(FAR), ESCHER, IK)
    assert isinstance(make_planner("adapt", context, PlannerOptions(library=library)), AdaptPlanner)
