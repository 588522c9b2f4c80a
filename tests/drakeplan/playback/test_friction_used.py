"""The colour of a force says how much of its friction it uses: green along the normal, red on the edge of the cone."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from drakeplan.plan.plan import Plan
from drakeplan.playback.friction_used import friction_used
from drakeplan.playback.share_colours import palette, share_colour
from optimization.balance.friction import FrictionCone, cone_generators
from scenes.pose import pose_matrix

GREEN, RED = "#1bbb1b", "#bb1b1b"


def with_force(
    plan: Plan, f_C: np.ndarray, *, mu: float = 0.5, rpy: tuple[float, float, float] = (0.0, 0.0, 0.0)
) -> Plan:
    """The plan with this force, in the contact frame, at the left foot's first contact, which is turned by rpy."""
    assert plan.centroidal is not None
    contact = int(plan.centroidal.contact[0, 0])
    X_WC, friction = plan.contacts.X_WC.copy(), plan.contacts.friction.copy()
    X_WC[contact], friction[contact] = pose_matrix(X_WC[contact, :3, 3], rpy), mu
    force = plan.centroidal.force_W.copy()
    force[0, 0] = X_WC[contact, :3, :3] @ f_C
    return dataclasses.replace(
        plan,
        contacts=dataclasses.replace(plan.contacts, X_WC=X_WC, friction=friction),
        centroidal=dataclasses.replace(plan.centroidal, force_W=force),
    )


angle = st.floats(-3.0, 3.0)


@given(st.floats(0.0, 1.5), angle, st.floats(1.0, 2000.0), st.floats(0.05, 1.5), st.tuples(angle, angle, angle))
def test_the_share_is_that_of_the_cones_edge_however_the_contact_is_turned(
    strolling_plan: Plan, share: float, heading: float, normal: float, mu: float, rpy: tuple[float, float, float]
) -> None:
    f_C = normal * np.array([share * mu * np.cos(heading), share * mu * np.sin(heading), 1.0])
    assert friction_used(with_force(strolling_plan, f_C, mu=mu, rpy=rpy))[0, 0] == pytest.approx(share, abs=1e-9)


def test_along_the_normal_is_green_and_on_the_edge_is_red(strolling_plan: Plan) -> None:
    for f_C, colour in (([0.0, 0.0, 300.0], GREEN), ([90.0, 120.0, 300.0], RED), ([-300.0, 0.0, 300.0], RED)):
        share = friction_used(with_force(strolling_plan, np.array(f_C), mu=0.5))[0, 0]
        assert share_colour(share) == colour
    middle = friction_used(with_force(strolling_plan, np.array([0.0, 75.0, 300.0]), mu=0.5))[0, 0]
    assert share_colour(middle) == "#bbbb1b"  # yellow


@pytest.mark.parametrize(
    ("f_C", "share"), [([1.0, 0.0, 0.0], np.inf), ([1.0, 0.0, -5.0], np.inf), ([0.0, 0.0, 0.0], 0.0)]
)
def test_a_force_without_a_push_has_no_friction_to_use(strolling_plan: Plan, f_C: list[float], share: float) -> None:
    assert friction_used(with_force(strolling_plan, np.array(f_C)))[0, 0] == share


def test_ice_carries_along_the_normal_alone(strolling_plan: Plan) -> None:
    assert friction_used(with_force(strolling_plan, np.array([0.0, 0.0, 9.0]), mu=0.0))[0, 0] == 0.0
    assert friction_used(with_force(strolling_plan, np.array([1e-3, 0.0, 9.0]), mu=0.0))[0, 0] == np.inf


def test_the_octagons_corners_use_all_and_the_middles_of_its_sides_nearly_all(strolling_plan: Plan) -> None:
    rays = cone_generators(FrictionCone.INNER, 0.5)
    corner = friction_used(with_force(strolling_plan, 100 * rays[0]))[0, 0]
    side = friction_used(with_force(strolling_plan, 50 * (rays[0] + rays[1])))[0, 0]
    assert corner == pytest.approx(1.0)
    assert side == pytest.approx(np.cos(np.pi / 8))


def test_an_end_effector_in_the_air_uses_none(strolling_plan: Plan) -> None:
    assert strolling_plan.centroidal is not None
    free = strolling_plan.centroidal.contact < 0
    assert free.any()
    assert not friction_used(strolling_plan)[free].any()


def test_colours_go_from_green_over_yellow_to_red_in_a_hundred_steps() -> None:
    colours = palette()
    assert (len(colours), colours[0], colours[100]) == (101, GREEN, RED)
    assert share_colour(7.0) == RED
    red, green = (np.array([int(c[k : k + 2], 16) for c in colours]) for k in (1, 3))
    assert (np.diff(red) >= 0).all()
    assert (np.diff(green) <= 0).all()
