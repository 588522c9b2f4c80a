"""What is reported of pushes that were tried: the product by hand, counts, weak stretches and Wilson's interval."""

from __future__ import annotations

import json
from collections.abc import Sequence

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from drakeplan.robustness.moments import Moment
from drakeplan.robustness.push_trial import CATCHES, FALLS, STANDS
from drakeplan.robustness.report import CONFIDENCE, UNTRIED, RobustnessReport, report_of, wilson
from scenes.contact import Contact, contact_pose
from scenes.effector import EFFECTORS
from scenes.stance import Stance

UP = np.array([0.0, 0.0, 1.0])
LEFT, RIGHT = (
    Contact(name, 0, contact_pose(name, np.array([0.0, y, 0.0]), UP, 0.0), 0.5)
    for name, y in (("left_foot", 0.1), ("right_foot", -0.1))
)
BOTH, ON_LEFT, ON_RIGHT = (Stance((*feet, None, None)) for feet in ((LEFT, RIGHT), (LEFT, None), (None, RIGHT)))
SIDE = np.array([[0.0, 30.0, 0.0], [0.0, -30.0, 0.0]])


def moments(stances: Sequence[Stance]) -> list[Moment]:
    zero = np.zeros(3)
    return [Moment(0.1 * n, stance, np.array([0.0, 0.0, 0.9]), zero, zero) for n, stance in enumerate(stances)]


def rows(trials: Sequence[tuple[int, int, float, int, int]]) -> dict[str, np.ndarray]:
    """Columns of (moment, impulse, probability, captured, effector)."""
    moment, impulse, probability, captured, effector = (np.array(c) for c in zip(*trials, strict=True))
    return {
        "moment": moment,
        "impulse": SIDE[impulse],
        "probability": probability,
        "captured": captured,
        "effector": effector,
        "p_new": np.where((captured == CATCHES)[:, None], [[0.1, 0.2, 0.3]], 0.0),
        "asked": np.where(captured == STANDS, 1, 3),
    }


STANCES = (BOTH, BOTH, ON_LEFT, ON_LEFT, BOTH, ON_RIGHT)
TRIALS = (
    (0, 0, 0.01, STANDS, -1), (0, 1, 0.02, STANDS, -1),
    (1, 0, 0.01, STANDS, -1), (1, 1, 0.02, FALLS, -1),
    (2, 0, 0.01, FALLS, -1), (2, 1, 0.02, CATCHES, 1),
    (3, 0, 0.03, FALLS, -1), (3, 1, 0.02, FALLS, -1),
    (4, 0, 0.01, CATCHES, 2), (4, 1, 0.02, STANDS, -1),
    (5, 0, 0.01, CATCHES, 0), (5, 1, 0.02, FALLS, -1),
)  # fmt: skip
NO_ROWS = {name: column[:0] for name, column in rows(TRIALS).items()}


@pytest.fixture(scope="module")
def report() -> RobustnessReport:
    return report_of(moments(STANCES), rows(TRIALS), {"samples": 3})


def test_success_is_that_no_moment_fells_the_robot(report: RobustnessReport) -> None:
    by_hand = (1 - 0.02) * (1 - 0.01) * (1 - 0.03 - 0.02) * (1 - 0.02)
    assert report.found.p_success == pytest.approx(by_hand, rel=1e-12)
    assert report.interval == (report.found.p_success,) * 2
    assert "every push tried" in report.text() and f"{100 * by_hand:.1f} %" in report.text()


def test_everything_that_was_tried_is_counted_once(report: RobustnessReport) -> None:
    facts = report.as_dict()
    assert (facts["pairs"], facts["stood"], facts["failed"]) == (12, 4, 5)
    assert (facts["caught_by_foot"], facts["caught_by_palm"]) == (2, 1)
    assert facts["swing"] == {"pairs": 6, "failed": 4}
    assert facts["double_support"] == {"pairs": 6, "failed": 1}
    assert facts["asked"] == 4 * 1 + 8 * 3


def test_what_was_found_is_in_its_place_by_moment_and_impulse(report: RobustnessReport) -> None:
    found = report.found
    for moment, impulse, probability, captured, effector in TRIALS:
        (d,) = np.flatnonzero((found.impulse == SIDE[impulse]).all(axis=1))
        assert found.probability[moment, d] == probability
        assert (found.captured[moment, d], found.effector[moment, d]) == (captured, effector)
        np.testing.assert_array_equal(found.capture_point[moment, d].any(), captured == CATCHES)
    np.testing.assert_allclose(found.t, 0.1 * np.arange(6))
    assert json.loads(found.method) == {"samples": 3}


def test_the_weakest_stretches_come_first_and_those_without_a_fall_do_not_come(report: RobustnessReport) -> None:
    weakest = report.weakest
    assert [s.risk for s in weakest] == sorted((s.risk for s in report.stretches if s.fell), reverse=True)
    first = weakest[0]
    assert (first.start, first.end) == pytest.approx((0.2, 0.4))
    assert first.words == "right foot in the air" and first.swing and (first.fell, first.tried) == (3, 4)
    assert first.risk == pytest.approx(1 - 0.99 * 0.95)
    assert "double support" in {s.words for s in weakest} and all(s.fell for s in weakest)


def test_stretches_cover_the_plan_and_their_risks_make_up_that_of_all(report: RobustnessReport) -> None:
    assert [s.start for s in report.stretches[1:]] == pytest.approx([s.end for s in report.stretches[:-1]])
    assert (report.stretches[0].start, report.stretches[-1].end) == pytest.approx((0.0, 0.6))
    assert len(report.stretches) == 4
    assert np.prod([1 - s.risk for s in report.stretches]) == pytest.approx(report.found.p_success)
    assert sum(s.tried for s in report.stretches) == report.pairs


def test_the_report_is_plain_data(report: RobustnessReport) -> None:
    facts = json.loads(json.dumps(report.as_dict()))
    assert {"p_success", "interval", "failed", "pairs", "weakest"} <= facts.keys()
    assert facts["p_success"] == report.found.p_success
    assert facts["weakest"][0]["what"] == "right foot in the air"


outcomes = st.lists(st.sampled_from([FALLS, STANDS, CATCHES]), min_size=12, max_size=12)


@given(outcomes)
def test_one_more_fall_never_makes_a_plan_more_likely_to_arrive(captured: list[int]) -> None:
    def success(captured: list[int]) -> float:
        trials = [(m, d, p, c, e) for (m, d, p, _, e), c in zip(TRIALS, captured, strict=True)]
        return report_of(moments(STANCES), rows(trials), {}).found.p_success

    before = success(captured)
    for k, outcome in enumerate(captured):
        if outcome != FALLS:
            assert success([*captured[:k], FALLS, *captured[k + 1 :]]) < before
    assert 0.0 < before <= 1.0 and (before == 1.0) == (FALLS not in captured)


# ---- a share of the pushes


@given(outcomes, st.floats(0.05, 0.95), st.integers(1, 12))
def test_from_a_share_of_the_pushes_the_estimate_lies_in_its_interval(
    captured: list[int], share: float, tried: int
) -> None:
    trials = [(m, d, p, c, e) for (m, d, p, _, e), c in zip(TRIALS, captured, strict=True)][:tried]
    report = report_of(moments(STANCES), rows(trials), {}, share)
    low, high = report.interval
    assert 0.0 <= low <= report.found.p_success <= high <= 1.0
    assert low < high
    assert report.pairs == tried
    assert (report.found.captured == UNTRIED).sum() == report.found.captured.size - tried
    assert "95 % interval" in report.text()


def test_a_share_that_falls_as_often_as_all_do_extrapolates_to_what_all_give() -> None:
    """n equal pushes, half of which fell: (1 - p)^(n / 2), from every second one of them exp(-p n / 2)."""
    p, n = 1e-3, 400
    stances = [BOTH] * n
    every = [(k, 0, p, FALLS if k % 4 < 2 else STANDS, -1) for k in range(n)]
    whole = report_of(moments(stances), rows(every), {}).found.p_success
    half = report_of(moments(stances), rows(every[::2]), {}, 0.5)
    assert whole == pytest.approx((1 - p) ** (n / 2))
    assert half.found.p_success == pytest.approx(np.exp(-p * n / 2))
    assert half.interval[0] < whole < half.interval[1]


def test_where_no_push_reaches_the_plan_it_arrives() -> None:
    report = report_of(moments(STANCES), NO_ROWS, {})
    assert report.found.p_success == 1.0 and report.pairs == 0
    assert json.loads(json.dumps(report.as_dict()))["failed"] == 0
    assert report.text()


def test_a_share_of_which_nothing_was_drawn_does_not_claim_that_every_push_was_tried() -> None:
    report = report_of(moments(STANCES), NO_ROWS, {}, 0.1)
    assert "every push tried" not in report.text()


def test_risks_of_stretches_are_extrapolated_as_the_success_is() -> None:
    every = [(k, 0, 1e-3, FALLS if k % 4 < 2 else STANDS, -1) for k in range(400)]
    report = report_of(moments([BOTH] * 400), rows(every[::2]), {}, 0.5)
    assert report.stretches[0].risk == pytest.approx(1 - report.found.p_success, rel=0.05)


def test_equal_impulses_of_regions_that_overlap_both_count() -> None:
    report = report_of(moments([BOTH]), rows([(0, 0, 0.01, FALLS, -1), (0, 0, 0.02, FALLS, -1)]), {})
    assert report.found.p_success == pytest.approx(1 - 0.03)


def test_a_plan_of_one_moment_has_a_report() -> None:
    report = report_of(moments([BOTH]), rows(TRIALS[:2]), {})
    assert (report.found.p_success, len(report.stretches)) == (1.0, 1)
    assert report.stretches[0].end == pytest.approx(0.1)


# ---- Wilson's interval

tries = st.integers(1, 500).flatmap(lambda n: st.tuples(st.integers(0, n), st.just(n)))


@given(tries)
def test_wilsons_ends_solve_the_textbook_equation(pair: tuple[int, int]) -> None:
    """(p_hat - p)^2 = z^2 p (1 - p) / n at both ends (Wilson 1927), one on either side of p_hat."""
    k, n = pair
    low, high = wilson(k, n, -1.0), wilson(k, n, 1.0)
    estimate = k / n
    for p in (low, high):
        assert (estimate - p) ** 2 == pytest.approx(CONFIDENCE**2 * p * (1 - p) / n, abs=1e-9)
    assert 0.0 <= low <= estimate + 1e-12 and estimate - 1e-12 <= high <= 1.0
    assert low < high


@given(tries)
def test_wilsons_interval_is_the_mirror_image_of_that_of_failures(pair: tuple[int, int]) -> None:
    k, n = pair
    assert wilson(k, n, -1.0) == pytest.approx(1.0 - wilson(n - k, n, 1.0), abs=1e-12)


@given(tries, st.integers(2, 10))
def test_more_tries_make_wilsons_interval_narrower(pair: tuple[int, int], times: int) -> None:
    k, n = pair
    width, narrower = (wilson(m * k, m * n, 1.0) - wilson(m * k, m * n, -1.0) for m in (1, times))
    assert narrower < width


def test_without_tries_anything_is_possible() -> None:
    assert (wilson(0, 0, -1.0), wilson(0, 0, 1.0)) == (0.0, 1.0)


def test_a_known_interval() -> None:
    """7 of 10 at 95 %: 0.3968 to 0.8922 (any table)."""
    assert (wilson(7, 10, -1.0), wilson(7, 10, 1.0)) == pytest.approx((0.3968, 0.8922), abs=1e-4)


def test_words_name_end_effectors_as_people_do(report: RobustnessReport) -> None:
    named = {name.replace("_", " ") for name in EFFECTORS}
    assert all(s.words == "double support" or s.words.removesuffix(" in the air") in named for s in report.stretches)
