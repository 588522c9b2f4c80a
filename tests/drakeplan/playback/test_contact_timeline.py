"""A page steps through the moments at which contacts change, and says which stance holds in between."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from drakeplan.plan.plan import Plan
from drakeplan.playback.contact_timeline import STANCE_TIME, contact_timeline, stance_of_phase
from drakeplan.timing.phases import MOVE, make_schedule
from scenes.contact import Contact, contact_pose
from scenes.effector import EFFECTORS
from scenes.stance import Stance

UP = np.array([0.0, 0.0, 1.0])


def test_changes_are_the_starts_of_all_phases_but_the_first(stepping_plan: Plan) -> None:
    """Each phase of this plan holds other contacts than the one before, except that a palm reaches out first."""
    assert stepping_plan.phases is not None
    timeline = contact_timeline(stepping_plan)
    table, start = stepping_plan.phases.contact, stepping_plan.phases.start
    expected = [start[p] for p in range(1, len(start)) if not np.array_equal(table[p], table[p - 1])]
    np.testing.assert_array_equal(timeline.changes, expected)
    np.testing.assert_allclose(timeline.changes, [1.4, 2.8, 3.8, 5.0, 7.0, 8.0])
    assert (timeline.stance + 1).tolist() == [1, 1, 2, 2, 3, 4, 4, 4, 5]
    assert timeline.duration == stepping_plan.duration


def test_times_count_from_the_start_of_the_motion(stepping_plan: Plan) -> None:
    later = shifted(stepping_plan, 7.5)
    np.testing.assert_allclose(contact_timeline(later).changes, contact_timeline(stepping_plan).changes)


def test_a_plan_without_motion_gives_each_stance_the_same_time(stepping_plan: Plan) -> None:
    plan = dataclasses.replace(stepping_plan, phases=None, centroidal=None, motion=None)
    timeline = contact_timeline(plan)
    assert not timeline.timed
    np.testing.assert_allclose(timeline.changes, STANCE_TIME * np.arange(1, len(plan.stances)))
    np.testing.assert_array_equal(timeline.contact, plan.stances)
    assert timeline.duration == STANCE_TIME * len(plan.stances)
    nothing = contact_timeline(dataclasses.replace(plan, stances=np.zeros((0, 4), dtype=int)))
    assert (nothing.duration, len(nothing.changes)) == (0.0, 0)


@given(st.lists(st.tuples(st.integers(0, 3), st.booleans()), max_size=25))
def test_stances_are_numbered_as_the_schedule_has_them(moves: list[tuple[int, bool]]) -> None:
    """Any sequence of steps, palms made and palms broken; a broken palm's stance begins as soon as it lets go."""
    schedule = make_schedule(sequence(moves))
    found = stance_of_phase(schedule.stance_contact, np.array([phase.contacts for phase in schedule.phases]))
    for p, phase in enumerate(schedule.phases):
        breaks = phase.mover >= 0 and schedule.stance_contact[phase.stance + 1, phase.mover] < 0
        assert found[p] == phase.stance + breaks, p
    assert found[-1] == len(schedule.stances) - 1


def sequence(moves: list[tuple[int, bool]]) -> list[Stance]:
    """Stances that differ in one end effector: a foot steps ahead, a palm is made, moved, or broken."""
    feet = [_contact(e, 0.0) for e in (0, 1)]
    stances, x = [Stance((feet[0], feet[1], None, None))], 0.0
    for effector, breaks in moves:
        x += 0.1
        gone = breaks and effector >= 2 and stances[-1].contacts[effector] is not None
        stances.append(stances[-1].replace(effector, None if gone else _contact(effector, x)))
    return stances


def _contact(effector: int, x: float) -> Contact:
    name = EFFECTORS[effector]
    return Contact(name, 0, contact_pose(name, [x, 0.3 * effector, 0.0], UP, 0.0), 0.5)


def shifted(plan: Plan, delay: float) -> Plan:
    assert plan.phases is not None
    assert plan.centroidal is not None
    assert plan.motion is not None
    return dataclasses.replace(
        plan,
        phases=dataclasses.replace(plan.phases, start=plan.phases.start + delay, end=plan.phases.end + delay),
        centroidal=dataclasses.replace(plan.centroidal, t=plan.centroidal.t + delay),
        motion=dataclasses.replace(plan.motion, t=plan.motion.t + delay),
    )


def test_schedules_of_the_test_above_hold_every_kind_of_change() -> None:
    schedule = make_schedule(sequence([(0, False), (2, False), (2, False), (2, True), (1, False)]))
    kinds = [schedule.kind(k) for k in range(5)]
    assert kinds == [MOVE, "make", MOVE, "break", MOVE]


@pytest.mark.parametrize("row", [[-1, -1, -1, -1]])
def test_a_flight_belongs_to_the_stance_it_leaves(stepping_plan: Plan, row: list[int]) -> None:
    assert stepping_plan.phases is not None
    table = stepping_plan.phases.contact.copy()
    table[3] = row
    flying = dataclasses.replace(stepping_plan, phases=dataclasses.replace(stepping_plan.phases, contact=table))
    assert contact_timeline(flying).stance[3] == contact_timeline(stepping_plan).stance[3]
