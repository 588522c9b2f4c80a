"""Moments of a plan: every 0.1 s of it but the end, with the contacts of its phases and the momenta of its knots."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from drakeplan.plan.plan import Plan
from drakeplan.robustness.moments import moments_of
from scenes.disturbance import PERIOD
from scenes.effector import LEFT_FOOT, RIGHT_FOOT
from scenes.input_error import InputError


@pytest.fixture(scope="module")
def moving(stepping_plan: Plan) -> Plan:
    """The stepping plan with momenta that differ from knot to knot."""
    assert stepping_plan.centroidal is not None
    rng = np.random.default_rng(0)
    n = len(stepping_plan.centroidal.t)
    momenta = {"linear_momentum": rng.normal(size=(n, 3)), "angular_momentum": rng.normal(size=(n, 3))}
    return dataclasses.replace(stepping_plan, centroidal=dataclasses.replace(stepping_plan.centroidal, **momenta))


def test_moments_are_a_tenth_of_a_second_apart_and_the_end_is_left_out(moving: Plan) -> None:
    t = [m.t for m in moments_of(moving)]
    assert moving.phases is not None
    end = moving.phases.end[-1]
    np.testing.assert_allclose(t, PERIOD * np.arange(round(end / PERIOD)), atol=1e-12)
    assert t[-1] < end - 0.5 * PERIOD


@pytest.mark.parametrize("step", [0.05, 0.07, 0.3, 100.0])
def test_other_steps_cover_the_plan_too(moving: Plan, step: float) -> None:
    t = np.array([m.t for m in moments_of(moving, step)])
    assert moving.phases is not None
    end = moving.phases.end[-1]
    np.testing.assert_allclose(np.diff(t), step)
    assert t[0] == 0.0 and t[-1] < end <= t[-1] + step + 1e-9


def test_what_is_held_is_what_the_phase_holds_which_begins_then_or_before(moving: Plan) -> None:
    phases = moving.phases
    assert phases is not None
    for moment in moments_of(moving):
        (p,) = [k for k in range(len(phases)) if phases.start[k] - 1e-9 <= moment.t < phases.end[k] - 1e-9]
        held = tuple(moving.contact(c) if c >= 0 else None for c in phases.contact[p].tolist())
        assert moment.stance.contacts == held
        feet = [held[foot] for foot in (LEFT_FOOT, RIGHT_FOOT)]
        assert moment.swing == (None in feet)
    assert {m.swing for m in moments_of(moving)} == {True, False}


def test_states_at_knots_are_those_of_the_knots(moving: Plan) -> None:
    knots = moving.centroidal
    assert knots is not None
    for k, moment in enumerate(moments_of(moving)):
        assert moment.t == pytest.approx(knots.t[k])
        np.testing.assert_allclose(moment.com, knots.com[k], atol=1e-9)
        np.testing.assert_allclose(moment.linear_momentum, knots.linear_momentum[k], atol=1e-9)
        np.testing.assert_allclose(moment.angular_momentum, knots.angular_momentum[k], atol=1e-9)


def test_between_knots_momenta_are_in_proportion(moving: Plan) -> None:
    knots, moment = moving.centroidal, moments_of(moving, 0.025)[1]
    assert knots is not None
    np.testing.assert_allclose(
        moment.linear_momentum, 0.75 * knots.linear_momentum[0] + 0.25 * knots.linear_momentum[1]
    )


def test_a_plan_of_contacts_only_has_no_states_to_push(moving: Plan) -> None:
    with pytest.raises(InputError, match="contacts only"):
        moments_of(dataclasses.replace(moving, phases=None, centroidal=None, motion=None))
