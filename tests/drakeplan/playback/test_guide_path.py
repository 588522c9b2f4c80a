"""The guiding path that a plan was made along is drawn segment by segment; what is not as it should be is left out."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from drakeplan import playback
from drakeplan.plan.plan import Plan
from drakeplan.playback.guide_path import MODE_COLOURS, RADIUS, GuideSegment, draw_guide, guide_of

WAY = [[0.0, 0.0, 0.0], [0.15, 0.0, 0.0], [0.3, 0.15, 0.1]]
GOOD = [
    {"mode": "feet", "method": "search", "stances": 4, "way": WAY},
    {"mode": "any", "method": "adapt", "stances": 2, "way": np.add(WAY, [0.3, 0.15, 0.1]).tolist()},
]
BAD = [
    "no mapping",
    None,
    {"mode": "feet", "method": "search"},
    {"mode": "hands", "method": "search", "way": WAY},
    {"mode": "feet", "method": "magic", "way": WAY},
    {"mode": "feet", "method": "search", "way": [[0.0, 0.0, 0.0]]},
    {"mode": "feet", "method": "search", "way": [[0.0, 0.0], [1.0, 0.0]]},
    {"mode": "feet", "method": "search", "way": [[0.0, 0.0, 0.0], [float("nan"), 0.0, 0.0]]},
    {"mode": "feet", "method": "search", "way": [[0.0, 0.0, 0.0], [1.0, 0.0]]},
    {"mode": "feet", "method": "search", "way": "from here to there"},
    {"mode": "feet", "method": "search", "way": []},
]


def guided(plan: Plan, guide: object) -> Plan:
    return dataclasses.replace(plan, provenance={**plan.provenance, "guide": guide})


def test_segments_come_back_as_they_were_told(strolling_plan) -> None:
    found = guide_of(guided(strolling_plan, GOOD))
    assert [(s.mode, s.method) for s in found] == [("feet", "search"), ("any", "adapt")]
    for segment, entry in zip(found, GOOD, strict=True):
        np.testing.assert_array_equal(segment.way, entry["way"])


@pytest.mark.parametrize("bad", BAD)
def test_an_entry_that_is_not_as_it_should_be_is_left_out_and_the_others_stay(strolling_plan, bad: object) -> None:
    found = guide_of(guided(strolling_plan, [GOOD[0], bad, GOOD[1]]))
    assert [s.mode for s in found] == ["feet", "any"]


@pytest.mark.parametrize("guide", [None, "a path", 3, {"mode": "feet"}, []])
def test_a_plan_that_tells_of_no_segments_has_none(strolling_plan, guide: object) -> None:
    assert guide_of(guided(strolling_plan, guide)) == []
    assert guide_of(strolling_plan) == []


def test_every_good_segment_stands_in_the_picture(strolling_plan) -> None:
    meshcat = playback.open_meshcat()
    draw_guide(meshcat, guided(strolling_plan, [GOOD[0], BAD[3], GOOD[1]]), "/test")
    assert meshcat.HasPath("/test/guide/0") and meshcat.HasPath("/test/guide/1")
    assert not meshcat.HasPath("/test/guide/2")


def test_a_segment_that_goes_nowhere_is_not_drawn(strolling_plan) -> None:
    meshcat = playback.open_meshcat()
    turn = {"mode": "feet", "method": "search", "way": [[0.5, 0.0, 0.0]] * 3}
    draw_guide(meshcat, guided(strolling_plan, [turn, GOOD[0]]), "/test")
    assert not meshcat.HasPath("/test/guide/0") and meshcat.HasPath("/test/guide/1")


def test_points_that_do_not_move_on_leave_the_line_as_it_is(strolling_plan, monkeypatch) -> None:
    seen = []
    usual = playback.terrain_mesh.tube

    def watched(path, radius):
        seen.append((path, radius))
        return usual(path, radius=radius)

    monkeypatch.setattr("drakeplan.playback.guide_path.terrain_mesh.tube", watched)
    twice = [{**entry, "way": np.repeat(entry["way"], 2, axis=0).tolist()} for entry in GOOD]
    for guide in (GOOD, twice):
        draw_guide(playback.open_meshcat(), guided(strolling_plan, guide), "/test")
    for (path, radius), (again, same) in zip(seen[:2], seen[2:], strict=True):
        np.testing.assert_allclose(again, path)
        assert radius == same
    assert [radius for _, radius in seen[:2]] == [RADIUS["search"], RADIUS["adapt"]] and RADIUS["adapt"] > RADIUS[
        "search"
    ]
    heights = seen[0][0][:, 2] - np.array(WAY)[:, 2]
    assert np.ptp(heights) < 1e-12 and heights[0] > 0.0, "it floats over the ground"


def test_the_page_has_a_line_for_each_mode_and_way_of_planning(strolling_plan) -> None:
    page = playback.page_html(guided(strolling_plan, GOOD))
    for entry in GOOD:
        assert GuideSegment(entry["mode"], entry["method"], np.array(WAY)).words in page
    assert "guiding path" not in playback.page_html(strolling_plan)


def test_modes_are_told_apart_by_their_colours() -> None:
    colours = [(c.r(), c.g(), c.b()) for c in MODE_COLOURS.values()]
    assert len(set(colours)) == len(colours)
