"""What is kept back is kept back once, the better of two attempts is returned, and the time said is that of the query."""

from __future__ import annotations

import itertools
import time
from collections.abc import Callable
from types import SimpleNamespace

import numpy as np
import pytest

from drakeplan.contact_planning.reachability import UNREACHABLE
from drakeplan.context import QueryContext
from drakeplan.deadline import Deadline
from drakeplan.query import one_planner
from drakeplan.query.one_planner import MOST_RESERVE, PALMS_SHARE, RESERVE, _palms_or_feet, _time_to_search
from drakeplan.query.options import PlanOptions
from drakeplan.query.record import QueryRecord
from drakeplan.query.result import PlanResult, Status
from scenes.files.scene_source import load_scene
from scenes.robots.robot import load_robot

STATUSES: tuple[Status, ...] = ("none", "contacts", "complete")


def until(deadline: Deadline) -> QueryContext:
    """As much of a context as is asked for here."""
    made = SimpleNamespace(deadline=deadline)
    made.until = until
    return made  # type: ignore[return-value]


def result(status: Status, reason: str = "") -> PlanResult:
    return PlanResult(status, reason, None, {"total_s": 0.0})


# Time that is kept back ---------------------------------------------------------------------------------------------


@pytest.mark.parametrize("seconds", [1.0, 10.0, 30.0, 100.0])
@pytest.mark.parametrize("share", [0.01, 0.3, 0.5, 0.89, 0.9, 0.95, 1.0])
def test_a_part_of_the_deadline_is_searched_to_its_end_as_far_as_the_whole_keeps_its_reserve(
    seconds: float, share: float
) -> None:
    options, kept = PlanOptions(deadline=seconds), min(RESERVE * seconds, MOST_RESERVE)
    whole = Deadline(seconds)
    assert _time_to_search(until(whole), options) == pytest.approx(seconds - kept)
    part = _time_to_search(until(whole.part(share)), options)
    assert part == pytest.approx(min(share * seconds, seconds - kept))


def test_a_part_of_a_part_keeps_back_no_more_than_a_part() -> None:
    options = PlanOptions(deadline=30.0)
    for first, second in itertools.product((0.2, 0.6, 0.95, 1.0), repeat=2):
        part = Deadline(30.0).part(first).part(second)
        assert _time_to_search(until(part), options) == pytest.approx(min(30.0 * first * second, 27.0))


def test_where_less_is_left_than_is_kept_back_nothing_is_searched() -> None:
    options = PlanOptions(deadline=30.0)
    for used in (27.0, 29.0, 40.0):
        spent = Deadline(30.0, used=used)
        assert _time_to_search(until(spent), options) == 0.0
        assert _time_to_search(until(spent.part(0.5)), options) == 0.0
    assert _time_to_search(until(Deadline(30.0, used=26.0)), options) == pytest.approx(1.0)


def test_planners_that_ask_for_no_obstacle_keep_nothing_back() -> None:
    options = PlanOptions(deadline=30.0, planner="adapt")
    assert one_planner.reserve(options) == 0.0
    assert _time_to_search(until(Deadline(30.0)), options) == pytest.approx(30.0)


def test_without_a_limit_the_search_has_none() -> None:
    assert _time_to_search(until(Deadline()), PlanOptions()) == np.inf


# Palms, or feet alone -----------------------------------------------------------------------------------------------


class Attempts:
    """Two attempts whose results are given; they keep what time they were given.

    Attributes:
        asked: "palms" or "feet" with the seconds that were left, in turn.
    """

    def __init__(
        self, palms: PlanResult, feet: PlanResult | None, meanwhile: Callable[[], None] = lambda: None
    ) -> None:
        self._palms, self._feet, self._meanwhile = palms, feet, meanwhile
        self.asked: list[tuple[str, float]] = []

    def use(self, monkeypatch: pytest.MonkeyPatch, spared: bool = True, known: bool = False) -> None:
        """Puts them in place of the real ones.

        Args:
            monkeypatch: of the test.
            spared: whether the feet alone may do.
            known: whether they know a way.
        """
        monkeypatch.setattr(one_planner, "_may_spare_palms", lambda *_: spared)
        monkeypatch.setattr(one_planner, "_feet_know_a_way", lambda *_: known)
        monkeypatch.setattr(one_planner, "_at_rest_or_moving", self._with_palms)
        monkeypatch.setattr(one_planner, "_feet_alone", self._alone)

    def _with_palms(self, context: QueryContext, *_: object) -> PlanResult:
        self.asked.append(("palms", context.deadline.left()))
        return self._palms

    def _alone(self, context: QueryContext, *_: object) -> PlanResult | None:
        self.asked.append(("feet", context.deadline.left()))
        self._meanwhile()
        return self._feet


def both(deadline: Deadline | None = None, **options) -> PlanResult:
    context = until(deadline or Deadline(30.0))
    return _palms_or_feet(context, PlanOptions(**options), "quasi-static", QueryRecord(), lambda event: None)


@pytest.mark.parametrize(("with_palms", "alone"), list(itertools.product(STATUSES[:2], STATUSES)))
def test_the_attempt_of_higher_rank_is_returned_and_that_with_palms_of_two_alike(
    with_palms: Status, alone: Status, monkeypatch: pytest.MonkeyPatch
) -> None:
    palms, feet = result(with_palms), result(alone)
    Attempts(palms, feet).use(monkeypatch)
    better = feet if STATUSES.index(alone) > STATUSES.index(with_palms) else palms
    assert both() is better


def test_where_the_feet_cannot_stand_at_the_start_the_attempt_with_palms_is_the_result(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    palms = result("none", "no way")
    Attempts(palms, None).use(monkeypatch)
    assert both() is palms


def test_feet_are_tried_alone_only_where_palms_brought_no_plan_and_others_may(monkeypatch: pytest.MonkeyPatch) -> None:
    cases = (
        (result("complete"), True, Deadline(30.0), ["palms"]),
        (result("none", f"{UNREACHABLE}: a gap"), True, Deadline(30.0), ["palms"]),
        (result("contacts"), False, Deadline(30.0), ["palms"]),
        (result("contacts"), True, Deadline(30.0, used=30.0), ["palms"]),
        (result("contacts"), True, Deadline(30.0, stop=lambda: True), ["palms"]),
        (result("contacts"), True, Deadline(30.0), ["palms", "feet"]),
    )
    for palms, spared, deadline, expected in cases:
        attempts = Attempts(palms, result("complete"))
        attempts.use(monkeypatch, spared)
        both(deadline)
        assert [name for name, _ in attempts.asked] == expected


def test_palms_are_hurried_where_feet_know_a_way_and_these_then_have_what_is_left_of_the_whole(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    for known, options, share in (
        (True, {}, PALMS_SHARE),
        (False, {}, 1.0),
        (True, {"expansions": 100}, 1.0),  # times would make runs differ
    ):
        attempts = Attempts(result("contacts"), result("contacts"))
        attempts.use(monkeypatch, known=known)
        both(**options)
        (first, palms_s), (second, feet_s) = attempts.asked
        assert (first, second) == ("palms", "feet")
        assert palms_s == pytest.approx(30.0 * share) and feet_s == pytest.approx(30.0)


def test_a_query_that_is_stopped_while_the_feet_are_tried_keeps_the_contacts_with_palms(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    stopped: list[bool] = []
    palms, feet = result("contacts"), result("none", "cancelled")
    Attempts(palms, feet, lambda: stopped.append(True)).use(monkeypatch)
    assert both(Deadline(30.0, stop=lambda: bool(stopped))) is palms


# The time that is reported ------------------------------------------------------------------------------------------


@pytest.mark.parametrize("status", ["complete", "contacts"])
def test_the_report_has_the_seconds_of_the_whole_query_whichever_attempt_is_returned(
    status: Status, monkeypatch: pytest.MonkeyPatch
) -> None:
    spent = 0.2  # [s] after the attempt that is returned

    def attempts(*_: object) -> PlanResult:
        first = PlanResult(status, "", None, {"total_s": 0.0, "stances": 7})
        time.sleep(spent)  # an attempt that brought nothing
        return first

    monkeypatch.setattr(one_planner, "load_kernels", lambda *_: None)
    monkeypatch.setattr(one_planner, "proved_obstacle", lambda *_: None)
    monkeypatch.setattr(one_planner, "_within_the_reserve_or_not", attempts)
    began = time.perf_counter()
    said = one_planner.plan_with_one(load_scene("flat"), load_robot("escher"), PlanOptions(goal=(0.6, 0.0)))
    assert spent <= said.report["total_s"] <= time.perf_counter() - began
    assert said.report["stances"] == 7 and said.status == status
