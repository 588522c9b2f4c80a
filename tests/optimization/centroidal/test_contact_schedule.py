"""Schedules of contacts: the documents' timing, and what is refused."""

from dataclasses import replace

import numpy as np
import pytest

from optimization.centroidal.contact_schedule import ContactSchedule, ContactSpan
from scenes.contact import Contact
from scenes.input_error import InputError
from scenes.stance import Stance


def foot(side, x):
    X_WC = np.eye(4)
    X_WC[0, 3] = x
    return Contact(f"{side}_foot", 0, X_WC, 0.5)


def stances():
    first = Stance((foot("left", 0.0), foot("right", 0.0), None, None))
    return [
        first,
        first.replace(0, foot("left", 0.3)),
        first.replace(0, foot("left", 0.3)).replace(1, foot("right", 0.4)),
    ]


def test_each_transition_shifts_for_a_second_and_swings_for_a_second():
    schedule = ContactSchedule.from_stances(stances(), dt=0.2, shift_time=1.0, swing_time=1.0)
    left, right = schedule.active[:, 0], schedule.active[:, 1]
    assert schedule.num_knots == 26
    assert np.allclose(schedule.times, 0.2 * np.arange(26))
    assert (left[5:10] == -1).all()
    assert (right[15:20] == -1).all()
    assert (schedule.active >= 0)[:, :2].sum(axis=1).tolist() == [2] * 5 + [1] * 5 + [2] * 5 + [1] * 5 + [2] * 5
    assert [schedule.contacts[i].p_WC[0] for i in (left[0], left[12], right[0], right[-1])] == [0.0, 0.3, 0.0, 0.4]
    assert len(schedule.contacts) == 4


def test_a_single_transition_needs_one_interval_for_its_new_contact():
    schedule = ContactSchedule.from_stances(stances()[:2], settle_time=0.2)
    assert len(schedule.dt) == 11
    assert schedule.contacts[schedule.active[-1, 0]].p_WC[0] == 0.3
    assert schedule.feet_mean()[-1, 0] == pytest.approx(0.15)


def test_the_mean_of_the_feet_is_that_of_the_feet_in_contact():
    schedule = ContactSchedule.from_stances(stances(), dt=0.2, shift_time=1.0, swing_time=1.0)
    mean = schedule.feet_mean()
    assert mean[0, 0] == 0.0
    assert mean[10, 0] == pytest.approx(0.15)
    assert mean[15, 0] == pytest.approx(0.3)
    flight = ContactSchedule.from_rows([(None,) * 4], 0.1)
    assert np.isnan(flight.feet_mean()).all()


def test_intervals_may_differ_in_length():
    row = (foot("left", 0.0), None, None, None)
    schedule = ContactSchedule.from_rows([row] * 3, np.array([0.1, 0.2, 0.3]))
    assert np.allclose(schedule.times, [0, 0.1, 0.3, 0.6])


def test_bad_schedules_are_refused():
    row = (foot("left", 0.0), None, None, None)
    with pytest.raises(InputError, match="empty"):
        ContactSchedule.from_stances([], dt=0.2, shift_time=1.0, swing_time=1.0)
    with pytest.raises(InputError, match="at least one interval"):
        ContactSchedule.from_rows([], 0.1)
    with pytest.raises(InputError, match="expected 4"):
        ContactSchedule.from_rows([row[:2]], 0.1)
    with pytest.raises(InputError, match="left_palm"):
        ContactSchedule.from_rows([(None, None, foot("left", 0.0), None)], 0.1)
    for dt in (0.0, -0.1, np.nan):
        with pytest.raises(InputError, match="dt"):
            ContactSchedule.from_rows([row], dt)
    with pytest.raises(InputError, match="does not exist"):
        replace(ContactSchedule.from_rows([row], 0.1), active=np.array([[5, -1, -1, -1]]))


def test_spans_become_intervals_and_gaps_become_flight():
    left, right = foot("left", 0.0), foot("right", 0.0)
    spans = [ContactSpan(left, 0.0, 0.4), ContactSpan(right, 0.0, 0.3), ContactSpan(foot("left", 0.3), 0.6, 1.0)]
    schedule = ContactSchedule.from_spans(spans, dt=0.1, duration=1.2)
    held = (schedule.active >= 0)[:, :2]
    assert held[:, 0].tolist() == [True] * 4 + [False] * 2 + [True] * 4 + [False] * 2
    assert held[:, 1].tolist() == [True] * 3 + [False] * 9
    assert schedule.contacts[schedule.active[7, 0]].p_WC[0] == 0.3
    assert schedule.phases.tolist() == [0, 0, 0, 1, 2, 2, 3, 3, 3, 3, 4, 4]
    assert schedule.phase_name(5) == "phase 2 (0.40 to 0.60 s)"


def test_a_contact_may_follow_another_at_once_but_not_overlap_it():
    first, second = foot("left", 0.0), foot("left", 0.3)
    follow = ContactSchedule.from_spans([ContactSpan(first, 0, 0.5), ContactSpan(second, 0.5, 1.0)], dt=0.1)
    assert follow.phases.tolist() == [0] * 5 + [1] * 5
    with pytest.raises(InputError, match=r"left_foot holds two contacts at 0.40 s: span 1 \(0.40 to 1.00 s\)"):
        ContactSchedule.from_spans([ContactSpan(first, 0, 0.5), ContactSpan(second, 0.4, 1.0)], dt=0.1)


@pytest.mark.parametrize(
    ("start", "end"), [(0.5, 0.5), (0.5, 0.2), (-0.1, 0.5), (np.nan, 1.0), (0.0, np.inf), (0.0, np.nan)]
)
def test_spans_without_a_length_are_refused_by_number(start, end):
    spans = [ContactSpan(foot("right", 0.0), 0.0, 1.0), ContactSpan(foot("left", 0.0), start, end)]
    with pytest.raises(InputError, match=r"span 1 \(left_foot\)"):
        ContactSchedule.from_spans(spans, dt=0.1)


def test_spans_need_a_time_step_and_at_least_one_interval():
    span = ContactSpan(foot("left", 0.0), 0.0, 1.0)
    for dt in (0.0, -0.1, np.nan, np.inf):
        with pytest.raises(InputError, match="dt"):
            ContactSchedule.from_spans([span], dt=dt)
    with pytest.raises(InputError, match="empty"):
        ContactSchedule.from_spans([], dt=0.1)
    for duration in (0.0, 0.01, np.nan):
        with pytest.raises(InputError, match="no interval"):
            ContactSchedule.from_spans([span], dt=0.1, duration=duration)


def test_a_bad_length_of_an_interval_is_named_with_its_phase():
    left, right = foot("left", 0.0), foot("right", 0.0)
    rows = [(left, right, None, None)] * 2 + [(left, None, None, None)] * 3
    for bad in (0.0, -0.1, np.nan):
        with pytest.raises(InputError, match="interval 3 of phase 1"):
            ContactSchedule.from_rows(rows, np.array([0.1, 0.1, 0.1, bad, 0.1]))
