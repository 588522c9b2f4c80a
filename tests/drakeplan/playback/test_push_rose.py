"""A plan on which pushes were tried shows them: a bar from green to red, arrows, a legend and how likely it arrives."""

from __future__ import annotations

import dataclasses
import re
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from drakeplan import playback
from drakeplan.plan.plan import Plan, PlanRobustness
from drakeplan.playback.push_rose import risk_bar

FELL, STOOD, CAUGHT, UNTRIED = 0, 1, 2, -1
GREEN, RED = "hsl(120 ", "hsl(0 "


def tried(plan: Plan, captured: np.ndarray) -> Plan:
    """The plan with these outcomes (R, D) at moments 0.1 s apart."""
    R, D = captured.shape
    impulse = np.array([[0.0, 30.0 * (d + 1), 0.0] for d in range(D)])
    probability = np.where(captured >= 0, 0.01, 0.0)
    point = np.where((captured == CAUGHT)[..., None], [0.5, 0.4, 1.0], 0.0)
    effector = np.where(captured == CAUGHT, 2, -1)
    found = PlanRobustness(0.1 * np.arange(R), impulse, probability, captured, point, effector, 0.875, "{}")
    return dataclasses.replace(plan, robustness=found)


def moments_in(plan: Plan) -> int:
    return round(plan.duration / 0.1)


def stops(plan: Plan) -> list[tuple[float, float, float]]:
    """(hue, from %, to %) of every stop of the bar."""
    found = re.findall(r"hsl\((\d+) 75% 42%\) ([\d.]+)% ([\d.]+)%", risk_bar(plan))
    return [(float(hue), float(start), float(end)) for hue, start, end in found]


def test_without_tried_pushes_there_is_no_bar(strolling_plan: Plan) -> None:
    assert risk_bar(strolling_plan) == ""
    nothing = tried(strolling_plan, np.zeros((0, 1), int))
    assert risk_bar(nothing) == ""


@pytest.mark.parametrize(("outcome", "hue"), [(STOOD, 120.0), (CAUGHT, 120.0), (UNTRIED, 120.0), (FELL, 0.0)])
def test_the_bar_is_green_where_all_survive_and_red_where_all_fall(
    strolling_plan: Plan, outcome: int, hue: float
) -> None:
    plan = tried(strolling_plan, np.full((moments_in(strolling_plan), 2), outcome))
    assert {s[0] for s in stops(plan)} == {hue}


@given(st.lists(st.sampled_from([FELL, STOOD, CAUGHT, UNTRIED]), min_size=3, max_size=3))
def test_the_hue_follows_the_share_of_the_pushes_that_were_tried(strolling_plan: Plan, outcomes: list[int]) -> None:
    plan = tried(strolling_plan, np.tile(outcomes, (moments_in(strolling_plan), 1)))
    asked = [o for o in outcomes if o != UNTRIED]
    share = asked.count(FELL) / max(len(asked), 1)
    assert {s[0] for s in stops(plan)} == {round(120 * (1 - share))}


def test_the_stops_cover_the_whole_bar_in_order(strolling_plan: Plan) -> None:
    n = moments_in(strolling_plan)
    captured = np.random.default_rng(0).integers(0, 3, (n, 2))
    found = stops(tried(strolling_plan, captured))
    assert len(found) == n
    assert (found[0][1], found[-1][2]) == (0.0, 100.0)
    for before, after in pairwise(found):
        assert before[2] == pytest.approx(after[1], abs=0.011)
        assert before[1] < before[2]
    for (hue, _, _), row in zip(found, captured, strict=True):
        assert hue == pytest.approx(120 * (1 - (row == FELL).mean()), abs=0.51)


def test_the_probability_of_a_push_weighs_it(strolling_plan: Plan) -> None:
    plan = tried(strolling_plan, np.tile([FELL, STOOD], (moments_in(strolling_plan), 1)))
    assert plan.robustness is not None
    probability = np.tile([0.03, 0.01], (len(plan.robustness.t), 1))
    plan = dataclasses.replace(plan, robustness=dataclasses.replace(plan.robustness, probability=probability))
    assert {s[0] for s in stops(plan)} == {30.0}


def test_the_page_of_a_tried_plan_has_the_bar_the_legend_and_the_percentage(strolling_plan: Plan) -> None:
    captured = np.tile([FELL, STOOD, CAUGHT], (moments_in(strolling_plan), 1))
    plan = tried(strolling_plan, captured)
    page = playback.page_html(plan)
    assert risk_bar(plan) in page
    for words in ("push: falls", "push: stands", "push: caught"):
        assert words in page
    assert "87.5 % likely to arrive under pushes" in page
    assert page.count('<input type="range"') == 1
    assert page.count("<span") == page.count("</span>")


def test_the_page_of_an_untried_plan_has_none_of_them(strolling_plan: Plan) -> None:
    page = playback.page_html(strolling_plan)
    for words in ('class="track"', "push: falls", "likely to arrive", "linear-gradient(to right, hsl("):
        assert words not in page
