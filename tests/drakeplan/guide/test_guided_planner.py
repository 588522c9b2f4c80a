"""Contacts along a guiding path: a way for this robot from start to goal, segment by segment, within what it may cost."""

from __future__ import annotations

import dataclasses
import itertools
import json

import numpy as np
import pytest
from made_up_ground import ESCHER, STEPS, box, floor, scene_on

import drakeplan.guide.guided_planner as guided
import drakeplan.guide.traversability_map as maps
from drakeplan.cli import main
from drakeplan.contact_planning.contact_plan import ContactPlan, PlannerOptions
from drakeplan.contact_planning.planner import make_planner
from drakeplan.contact_planning.sequence_check import SequenceCheck
from drakeplan.context import QueryContext
from drakeplan.guide.guided_planner import ANY, GuidedPlanner
from drakeplan.guide.segments import Segment
from drakeplan.query.options import PlanOptions, check_options
from drakeplan.query.planning import plan_scene
from drakeplan.search.ana_star import Limits
from learning.footstep_counts import PoseFeatures
from learning.traversability import Traversability
from scenes.input_error import InputError
from scenes.library import two_corridors
from scenes.scene import Scene
from scenes.stance import changed_effector

BUDGET = Limits(expansions=3000)  # the same on every machine
SEARCHED = PlannerOptions()
METRES = 2.0  # [m] from start to goal


class AsScored:
    """A regressor for which there are as many useful footsteps as the scores say, so that no weights are needed."""

    def counts(self, mode: int, seen: PoseFeatures) -> np.ndarray:
        return 0.02 * seen.feet * (1.0 + (mode > 0) * seen.palms.sum(axis=1, keepdims=True))


@pytest.fixture(autouse=True)
def known_hardness(monkeypatch) -> None:
    card = {"translations": STEPS.translations.tolist(), "footholds": "snapped"}
    made = Traversability("network", AsScored(), card)
    monkeypatch.setattr(maps, "load_traversability", lambda robot, model, kind: made)


def straight() -> Scene:
    return scene_on(floor((-0.5, METRES + 0.5), (-0.8, 0.8)), (METRES, 0.0))


def thirds(monkeypatch: pytest.MonkeyPatch, count: int = 3) -> None:
    """Every guiding path is cut into so many segments of feet alone, all to be searched."""

    def cut(path, decision="max", *, adapt=True) -> list[Segment]:
        joints = np.linspace(0, len(path), count + 1).round().astype(int).tolist()
        return [Segment(a, b, 0, "search") for a, b in itertools.pairwise(joints)]

    monkeypatch.setattr(guided, "segments", cut)


def planner(scene: Scene, ik, adapt: bool = False, **options) -> GuidedPlanner:
    return GuidedPlanner(QueryContext(scene, ESCHER, ik), dataclasses.replace(SEARCHED, **options), adapt=adapt)


def first(found: GuidedPlanner, limits: Limits = BUDGET) -> ContactPlan:
    plan = next(found.plans(limits), None)
    assert plan is not None, found.why_not()
    return plan


def holds(plan: ContactPlan, context: QueryContext) -> None:
    """It begins at the start, ends in the goal, moves one end effector at a time, and every transition passes."""
    assert plan.stances[0] == context.start
    away = plan.stances[-1].feet_mean() - context.goal.xyz
    assert np.hypot(*away[:2]) <= context.goal.radius + 1e-9
    for before, after in itertools.pairwise(plan.stances):
        changed_effector(before, after)  # raises where they differ in more than one
        assert before != after
    check = SequenceCheck(context)
    assert check.why_it_fails(plan.stances) == []
    assert plan.cost == pytest.approx(check.cost(plan.stances))


def told(plan: ContactPlan) -> list[dict]:
    """What is kept of the segments, as it comes back from a file."""
    guide = json.loads(json.dumps([dict(entry) for entry in plan.guide]))
    assert sum(entry["stances"] for entry in guide) == len(plan.stances) - 1
    return guide


@pytest.mark.parametrize("adapt", [False, True])
def test_through_rooms_and_corridors_every_step_of_the_sequence_is_one_that_the_robot_can_make(ik, adapt: bool) -> None:
    found = planner(two_corridors.named(0), ik, adapt=adapt)
    plan = first(found)
    holds(plan, found.context)
    guide = told(plan)
    assert {entry["method"] for entry in guide} <= {"search", "adapt"}
    if not adapt:
        assert {entry["method"] for entry in guide} == {"search"} and plan.origin == ()
    way = np.concatenate([entry["way"] for entry in guide])
    np.testing.assert_allclose(way[[0, -1]], found.path.poses[[0, -1], :3], atol=1e-3)
    assert found.counts().expansions == plan.expansions > 0


def test_each_segment_ends_where_the_next_begins(ik, monkeypatch) -> None:
    thirds(monkeypatch)
    found = planner(straight(), ik)
    plan = first(found)
    holds(plan, found.context)
    guide = told(plan)
    assert [entry["mode"] for entry in guide] == ["feet"] * 3
    for one, other in itertools.pairwise(guide):
        assert one["way"][-1] == other["way"][0]
    number = 0
    for entry in guide:
        number += entry["stances"]
        end = np.array(entry["way"][-1]) if entry is not guide[-1] else np.array(found.context.goal.xyz)
        assert np.hypot(*(plan.stances[number].feet_mean() - end)[:2]) <= guided.RADIUS


def test_a_second_call_has_nothing_more_to_give(ik, monkeypatch) -> None:
    thirds(monkeypatch)
    found = planner(straight(), ik)
    first(found)
    assert list(found.plans(BUDGET)) == [] and found.counts().ended_by == "exhausted"


@pytest.mark.parametrize("where", [0, 4, -2])
def test_a_transition_that_was_forbidden_does_not_come_back(ik, monkeypatch, where: int) -> None:
    thirds(monkeypatch)
    found = planner(straight(), ik)
    plan, forbidden = first(found), set()
    for _ in range(3):
        k = where % (len(plan.stances) - 1)
        forbidden.add((plan.stances[k], plan.stances[k + 1]))
        found.forbid(plan, k)
        plan = first(found)
        holds(plan, found.context)
        told(plan)
        assert not forbidden & set(itertools.pairwise(plan.stances))


def test_several_transitions_of_one_segment_may_be_forbidden_at_once(ik, monkeypatch) -> None:
    thirds(monkeypatch)
    found = planner(straight(), ik)
    plan = first(found)
    steps = list(itertools.pairwise(plan.stances))
    for k in (0, 1):
        found.forbid(plan, k)
    again = first(found)
    holds(again, found.context)
    assert not {steps[0], steps[1]} & set(itertools.pairwise(again.stances))


def test_what_comes_before_a_forbidden_transition_is_kept(ik, monkeypatch) -> None:
    thirds(monkeypatch)
    found = planner(straight(), ik)
    plan = first(found)
    kept = told(plan)[0]["stances"]
    found.forbid(plan, len(plan.stances) - 2)
    assert first(found).stances[: kept + 1] == plan.stances[: kept + 1]


def test_a_segment_that_fails_in_its_way_is_searched_in_any_mode(ik, monkeypatch) -> None:
    thirds(monkeypatch)
    usual, tried = GuidedPlanner._try, []

    def only_any(self, first, end, mode, method, share):
        tried.append((first, end, mode))
        return usual(self, first, end, mode, method, share) if first != 1 or mode == ANY else None

    monkeypatch.setattr(GuidedPlanner, "_try", only_any)
    found = planner(straight(), ik)
    plan = first(found)
    holds(plan, found.context)
    assert [entry["mode"] for entry in told(plan)] == ["feet", "any", "feet"]
    assert [try_ for try_ in tried if try_[0] == 1] == [(1, 2, 0), (1, 2, ANY)]


def test_a_segment_that_fails_in_every_way_is_joined_with_the_next(ik, monkeypatch) -> None:
    thirds(monkeypatch)
    usual = GuidedPlanner._try

    def never_alone(self, first, end, mode, method, share):
        return None if (first, end) == (1, 2) else usual(self, first, end, mode, method, share)

    monkeypatch.setattr(GuidedPlanner, "_try", never_alone)
    found = planner(straight(), ik)
    plan = first(found)
    holds(plan, found.context)
    one, joined = told(plan)
    assert (one["mode"], joined["mode"], joined["method"]) == ("feet", "any", "search")
    steps = found.segments[1].first, found.segments[2].end
    np.testing.assert_allclose(joined["way"], found.path.poses[steps[0] : steps[1] + 1, :3], atol=1e-4)


def test_where_nothing_leads_on_the_segment_before_is_planned_again_together_with_the_next(ik, monkeypatch) -> None:
    thirds(monkeypatch)
    usual = GuidedPlanner._try

    def stuck(self, first, end, mode, method, share):
        return None if first == 1 else usual(self, first, end, mode, method, share)

    monkeypatch.setattr(GuidedPlanner, "_try", stuck)
    found = planner(straight(), ik)
    plan = first(found)
    holds(plan, found.context)
    assert [entry["mode"] for entry in told(plan)] == ["any", "feet"]


def test_where_every_try_fails_it_ends_and_says_so(ik, monkeypatch) -> None:
    thirds(monkeypatch)
    monkeypatch.setattr(GuidedPlanner, "_try", lambda self, *asked: None)
    found = planner(straight(), ik)
    assert list(found.plans(BUDGET)) == []
    assert found.counts().ended_by == "exhausted"
    assert found.why_not() == "no contacts along the guiding path of 3 segments"


def test_without_a_path_the_search_alone_is_asked_for_a_way(ik) -> None:
    shut = box("wall", (1.0, -1.0, 0.0), (1.1, 1.0, 2.0))
    found = planner(scene_on(floor((-0.5, 2.5), (-0.8, 0.8), shut), (2.0, 0.0)), ik)
    assert found.path is None and found.segments == [Segment(0, 0, ANY, "search")]
    assert next(found.plans(Limits(expansions=40)), None) is None
    assert "guiding path of 1 segments" in found.why_not()


@pytest.mark.parametrize("adapt", [False, True])
def test_who_stands_in_the_goal_already_is_there(ik, adapt: bool) -> None:
    found = planner(scene_on(floor((-0.5, 1.0), (-0.6, 0.6)), (0.05, 0.0)), ik, adapt=adapt)
    holds(first(found), found.context)


# ---- limits


def test_with_a_budget_of_expansions_a_plan_is_the_same_at_every_time(ik, monkeypatch) -> None:
    thirds(monkeypatch)
    one, two = (first(planner(straight(), ik)) for _ in range(2))
    assert one.stances == two.stances and one.expansions == two.expansions


@pytest.mark.parametrize("expansions", [1, 4])
def test_a_budget_that_is_spent_is_given_for_the_reason(ik, expansions: int) -> None:
    found = planner(straight(), ik)
    assert next(found.plans(Limits(expansions=expansions)), None) is None
    assert found.counts().expansions <= expansions
    assert found.counts().ended_by == "expansions"


def test_time_that_is_over_ends_it_at_once_and_a_later_call_goes_on(ik) -> None:
    found = planner(straight(), ik)
    now = itertools.count(0.0, 1.0)
    assert next(found.plans(Limits(deadline=0.5), lambda: next(now)), None) is None
    assert found.counts().ended_by == "deadline" and found.why_not().startswith("deadline: ")
    assert next(now) < 20, "hardly anything was done"
    assert next(found.plans(Limits(deadline=0.0)), None) is None
    assert found.counts().ended_by == "deadline"
    assert next(found.plans(Limits(stop=lambda: True)), None) is None
    assert found.counts().ended_by == "cancelled"
    holds(first(found), found.context)


def test_it_stops_in_the_middle_of_a_segment_when_it_is_asked_to(ik, monkeypatch) -> None:
    thirds(monkeypatch)
    found = planner(straight(), ik)
    asked = itertools.count()
    assert next(found.plans(Limits(expansions=3000, stop=lambda: next(asked) > 6)), None) is None
    assert found.counts().ended_by == "cancelled"


# ---- what later checks ask for


def test_swings_that_find_no_way_are_refused(ik, monkeypatch) -> None:
    thirds(monkeypatch)
    found = planner(straight(), ik)
    plan = first(found)
    lost = set(itertools.pairwise(plan.stances[:3]))
    found.ask_for_swings(lambda before, after: (before, after) not in lost)
    found.forbid(plan, 0)
    plan = first(found)
    holds(plan, found.context)
    assert not lost & set(itertools.pairwise(plan.stances))


def test_it_asks_for_balance_at_rest_already(ik) -> None:
    found = planner(straight(), ik)
    assert not found.require_static_balance(True) and found.start_problem() == ""


@pytest.mark.parametrize("guide", ["max", "mean", "segments"])
def test_the_registry_makes_one_for_every_guide(ik, guide: str) -> None:
    options = dataclasses.replace(SEARCHED, guide=guide)
    made = make_planner("guided", QueryContext(straight(), ESCHER, ik), options)
    assert isinstance(made, GuidedPlanner)
    if guide == "segments":
        assert {segment.method for segment in made.segments} == {"search"}


def test_a_whole_query_with_the_weights_that_come_with_the_robot_keeps_the_segments_with_its_plan(monkeypatch) -> None:
    monkeypatch.undo()
    options = PlanOptions(planner="guided", guide="segments", deadline=60.0, improve=0.0)
    result = plan_scene(scene_on(floor((-0.5, 1.5), (-0.6, 0.6)), (0.9, 0.0)), ESCHER, options)
    assert result.status == "complete", result.reason
    assert result.plan is not None
    guide = result.plan.provenance["guide"]
    assert guide == result.report["guide"] and len(guide) >= 1
    assert sum(entry["stances"] for entry in guide) == len(result.plan.stances) - 1


# ---- what cannot be asked for


@pytest.mark.parametrize(
    ("given", "complaint"),
    [
        ({"guide": "maxx"}, "unknown guide 'maxx': did you mean max"),
        ({"guide": "straight"}, "unknown guide 'straight'"),
        ({"estimator": "network-fix"}, "did you mean network-fixed"),
        ({"heuristic": "traversabilty"}, "did you mean traversability"),
        ({"planner": "giuded"}, "did you mean guided"),
        ({"planner": "guided", "dynamics": "exact"}, "--dynamics exact needs --planner search"),
    ],
)
def test_an_unknown_name_gets_one_line_with_the_nearest_known_one(given: dict, complaint: str) -> None:
    with pytest.raises(InputError) as caught:
        check_options(PlanOptions(**given))
    assert complaint in str(caught.value) and len(str(caught.value).splitlines()) == 1


@pytest.mark.parametrize(
    ("words", "named"),
    [
        ("--planner guided --guide straight", "max"),
        ("--heuristic traversable", "traversability"),
        ("--planner guide", "guided"),
    ],
)
def test_the_command_line_names_what_it_knows(words: str, named: str, capsys) -> None:
    try:
        status = main(["plan", "flat", *words.split()])
    except SystemExit as end:
        status = end.code
    said = capsys.readouterr()
    assert status == 2 and said.out == ""
    assert named in said.err and words.split()[-1] in said.err and "Traceback" not in said.err


def test_the_network_that_fits_the_footholds_is_taken_where_none_is_named() -> None:
    assert PlannerOptions().chosen_estimator == "network"
    assert PlannerOptions(footholds="fixed").chosen_estimator == "network-fixed"
    assert PlannerOptions(footholds="fixed", estimator="acc-svr").chosen_estimator == "acc-svr"
