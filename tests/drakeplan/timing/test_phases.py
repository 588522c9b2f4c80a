"""The timing of a contact sequence: what holds for every sequence, whatever moves."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from drakeplan.plan.plan import tabulate_stances
from drakeplan.timing.phases import BREAK, MAKE, MOVE, make_schedule
from scenes.contact import Contact, contact_pose
from scenes.effector import EFFECTORS, LEFT_FOOT, LEFT_PALM, RIGHT_FOOT
from scenes.stance import Stance, changed_effector

STEP = 0.1  # [s] of the dynamics
RATE = 50  # [Hz] of the motion


def contact(effector: int, x: float) -> Contact:
    name = EFFECTORS[effector]
    normal = [0.0, 0.0, 1.0] if effector < 2 else [0.0, -1.0 if effector == LEFT_PALM else 1.0, 0.0]
    side = 0.1 if effector % 2 == 0 else -0.1
    return Contact(name, 0, contact_pose(name, [x, side, 0.0], np.array(normal), 0.0), 0.5)


def standing() -> Stance:
    return Stance((contact(0, 0.0), contact(1, 0.0), None, None))


@st.composite
def sequences(draw) -> list[Stance]:
    stances = [standing()]
    for k in range(draw(st.integers(0, 8))):
        mover = draw(st.integers(0, 3))
        held = stances[-1].contacts[mover] is not None
        breaks = mover >= 2 and held and draw(st.booleans())
        stances.append(stances[-1].replace(mover, None if breaks else contact(mover, 0.1 * (k + 1))))
    return stances


durations = st.integers(1, 12).map(lambda n: n / 10)


@given(sequences(), durations, durations, durations)
def test_phases_are_contiguous_and_pass_through_the_stances_in_order(stances, shift, swing, rest):
    schedule = make_schedule(stances, shift=shift, swing=swing, rest=rest)
    assert len(schedule.phases) == 2 * len(stances) - 1
    assert schedule.phases[0].start == 0.0
    for before, after in zip(schedule.phases, schedule.phases[1:], strict=False):
        assert before.end == after.start > before.start
    for k, stance in enumerate(stances):
        phase = schedule.phases[2 * k]
        assert (phase.mover, phase.stance) == (-1, k)
        for e, c in enumerate(stance.contacts):
            assert (phase.contacts[e] < 0) == (c is None)
            assert c is None or schedule.contacts[phase.contacts[e]] == c


@given(sequences())
def test_the_table_of_contacts_is_the_one_of_the_plan_file(stances):
    schedule = make_schedule(stances)
    table, indices = tabulate_stances(stances)
    assert np.array_equal(schedule.stance_contact, indices)
    assert np.array_equal([c.X_WC for c in schedule.contacts], table.X_WC)


@given(sequences())
def test_a_swing_phase_carries_load_on_what_both_stances_share_and_nothing_else(stances):
    schedule = make_schedule(stances)
    for k in range(len(stances) - 1):
        phase = schedule.phases[2 * k + 1]
        before, after = schedule.stance_contact[k], schedule.stance_contact[k + 1]
        shared = np.where(before == after, before, -1)
        assert phase.contacts == tuple(shared)
        assert phase.mover == changed_effector(stances[k], stances[k + 1])


@given(sequences(), durations, durations)
def test_samples_of_dynamics_and_motion_meet_every_boundary_and_agree_on_the_contacts(stances, shift, swing):
    schedule = make_schedule(stances, shift=shift, swing=swing)
    coarse, fine = schedule.times(STEP), schedule.times(1 / RATE)
    assert coarse[-1] == pytest.approx(schedule.duration)
    assert fine[-1] == pytest.approx(schedule.duration)
    assert np.array_equal(schedule.contact_at(coarse), schedule.contact_at(fine)[:: round(STEP * RATE)])
    for boundary in schedule.boundaries:
        assert np.abs(coarse - boundary).min() < 1e-9


def test_a_boundary_sample_belongs_to_the_phase_that_starts_there():
    step = [standing(), standing().replace(RIGHT_FOOT, contact(RIGHT_FOOT, 0.3))]
    schedule = make_schedule(step)
    assert schedule.contact_at(np.array([0.98, 1.0, 1.98, 2.0, 3.0]))[:, RIGHT_FOOT].tolist() == [1, -1, -1, 2, 2]


def test_a_palm_makes_moves_and_breaks():
    walk = [standing()]
    walk.append(walk[-1].replace(LEFT_PALM, contact(LEFT_PALM, 0.3)))
    walk.append(walk[-1].replace(LEFT_FOOT, contact(LEFT_FOOT, 0.3)))
    walk.append(walk[-1].replace(LEFT_PALM, contact(LEFT_PALM, 0.6)))
    walk.append(walk[-1].replace(LEFT_PALM, None))
    schedule = make_schedule(walk)
    assert [schedule.kind(k) for k in range(4)] == [MAKE, MOVE, MOVE, BREAK]
    assert len(schedule.contacts) == 5


def test_transitions_may_have_their_own_durations():
    walk = [standing(), standing().replace(0, contact(0, 0.2))]
    walk.append(walk[-1].replace(1, contact(1, 0.2)))
    schedule = make_schedule(walk, shift=np.array([1.0, 1.4]), swing=np.array([0.8, 1.0]), rest=0.6)
    assert schedule.boundaries.tolist() == pytest.approx([0, 1.0, 1.8, 3.2, 4.2, 4.8])


def test_bad_sequences_and_timings_are_refused():
    with pytest.raises(ValueError, match="at least one"):
        make_schedule([])
    with pytest.raises(ValueError, match="differ in 0"):
        make_schedule([standing(), standing()])
    with pytest.raises(ValueError, match="foot in the air"):
        make_schedule([standing(), standing().replace(0, None)])
    with pytest.raises(ValueError, match="positive"):
        make_schedule([standing()], rest=0.0)
    with pytest.raises(ValueError, match="multiples"):
        make_schedule([standing()], rest=0.33).times(STEP)
