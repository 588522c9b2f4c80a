"""A plan's arrays have one row a frame, and what it says between two rows keeps the laws that the rows keep."""

from __future__ import annotations

import dataclasses
import sys

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from drakeplan.plan.plan import Plan, PlanMotion
from scenes.contact import Contact
from scenes.effector import EFFECTORS
from scenes.input_error import InputError
from scenes.robots.plant import build_plant
from scenes.robots.robot import load_robot, robot_names

GRAVITY = np.array([0.0, 0.0, -9.81])
ROUNDING = 1e-9  # of interpolation, in the units of what is interpolated
HELD = 5e-3  # [m] the verifier's tolerance for held contacts
ARRAYS = ("t", "q", "v", "tau", "com", "forces", "joint_names", "actuator_names")


def turn_between(a: np.ndarray, b: np.ndarray) -> float:
    """The angle between two unit quaternions [rad]."""
    return 2.0 * float(np.arccos(np.clip(abs(a @ b), 0.0, 1.0)))


@pytest.fixture(scope="module")
def turning_plan(strolling_plan: Plan) -> Plan:
    """A plan with a base that turns by a third of a turn over its motion, the sign of the quaternion continuous."""
    plan = strolling_plan
    assert plan.motion is not None
    angle = np.linspace(0.0, 2.0 * np.pi / 3.0, len(plan.t))
    q = plan.q.copy()
    q[:, :4] = np.stack([np.cos(angle / 2), 0.6 * np.sin(angle / 2), 0 * angle, 0.8 * np.sin(angle / 2)], axis=1)
    return dataclasses.replace(plan, motion=dataclasses.replace(plan.motion, q=q))


def without_motion(plan: Plan) -> Plan:
    return dataclasses.replace(plan, phases=None, centroidal=None, motion=None)


# ---- arrays


def test_all_arrays_have_one_row_a_frame_and_cannot_be_written_to(strolling_plan: Plan) -> None:
    plan = strolling_plan
    for name in ("q", "v", "tau", "com", "forces"):
        array = getattr(plan, name)
        assert len(array) == len(plan.t), name
        with pytest.raises(ValueError, match="read-only"):
            array[0] = 0.0
    assert plan.forces.shape == (len(plan.t), len(plan.effectors), 3)
    assert plan.q.shape[1] == 7 + len(plan.joint_names) and plan.v.shape[1] == 6 + len(plan.joint_names)
    assert plan.tau.shape[1] == len(plan.actuator_names)


def test_at_the_knots_the_arrays_are_those_of_the_momentum_trajectory(stepping_plan: Plan) -> None:
    knots = stepping_plan.centroidal
    assert knots is not None
    frame = np.round(knots.t / 0.02).astype(int)
    np.testing.assert_allclose(stepping_plan.com[frame], knots.com, atol=ROUNDING)
    np.testing.assert_array_equal(stepping_plan.forces[frame], knots.force_W)


@pytest.mark.parametrize("name", robot_names())
def test_joint_names_are_those_of_the_model_in_the_order_of_positions_and_velocities(name: str) -> None:
    try:
        plant = build_plant(load_robot(name)).plant
    except InputError as error:
        pytest.skip(str(error))
    positions, velocities = tuple(plant.GetPositionNames()), tuple(plant.GetVelocityNames())
    empty = np.zeros((0, len(positions))), np.zeros((0, len(velocities)))
    motion = PlanMotion(np.zeros(0), *empty, positions, velocities)
    assert len(motion.joint_names) == len(positions) - 7
    for k, joint in enumerate(map(plant.GetJointByName, motion.joint_names)):
        assert (joint.position_start(), joint.velocity_start()) == (7 + k, 6 + k)


@pytest.mark.parametrize("name", ARRAYS)
def test_a_plan_of_contacts_alone_says_that_it_has_no_motion(strolling_plan: Plan, name: str) -> None:
    with pytest.raises(InputError, match=f"^{name}: this plan has contacts alone, no motion"):
        getattr(without_motion(strolling_plan), name)


def test_a_plan_of_contacts_alone_has_no_moments_and_no_frames(strolling_plan: Plan) -> None:
    plan = without_motion(strolling_plan)
    for ask in (lambda: plan.at(0.0), plan.frames):
        with pytest.raises(InputError, match="no motion"):
            ask()
    assert "contacts" in repr(plan) and len(repr(plan)) < 200


def test_a_plan_of_an_earlier_release_says_that_it_has_no_torques(stepping_plan: Plan) -> None:
    with pytest.raises(InputError, match="this plan has no torques: an earlier release"):
        _ = stepping_plan.tau


# ---- one moment


def test_at_a_frame_a_moment_is_that_frame(turning_plan: Plan) -> None:
    plan = turning_plan
    for k in range(0, len(plan.t), 37):
        state = plan.at(plan.t[k])
        np.testing.assert_allclose(state.q, plan.q[k], atol=ROUNDING)
        np.testing.assert_allclose(state.v, plan.v[k], atol=ROUNDING)
        np.testing.assert_allclose(state.com, plan.com[k], atol=ROUNDING)
        np.testing.assert_array_equal(state.forces, plan.forces[k])


@given(frame=st.integers(0, 200), share=st.floats(0.0, 1.0))
def test_between_frames_the_base_turns_at_constant_rate_and_joints_move_evenly(
    turning_plan: Plan, frame: int, share: float
) -> None:
    plan = turning_plan
    state = plan.at(plan.t[frame] + share * (plan.t[frame + 1] - plan.t[frame]))
    before, after = plan.q[frame], plan.q[frame + 1]
    assert abs(np.linalg.norm(state.q[:4]) - 1.0) < ROUNDING
    assert state.q[:4] @ before[:4] > 0.0  # on the same side as its neighbours
    whole = turn_between(before[:4], after[:4])
    assert turn_between(before[:4], state.q[:4]) == pytest.approx(share * whole, abs=1e-6)
    assert turn_between(state.q[:4], after[:4]) == pytest.approx((1.0 - share) * whole, abs=1e-6)
    np.testing.assert_allclose(state.q[4:], before[4:] + share * (after - before)[4:], atol=1e-7)


@given(share=st.floats(0.0, 0.999), length=st.floats(0.001, 0.05))
def test_momentum_changes_by_the_forces_and_the_weight(stepping_plan: Plan, share: float, length: float) -> None:
    """Newton within every interval of constant force: l(t2) - l(t1) = (t2 - t1) (sum f + M g)."""
    plan = stepping_plan
    knots = plan.centroidal
    assert knots is not None
    n = int(share * (len(knots) - 1))
    early, late = plan.at(knots.t[n] + 0.02), plan.at(knots.t[n] + 0.02 + length)
    force = early.forces.sum(axis=0) + plan.mass * GRAVITY
    np.testing.assert_allclose(late.linear_momentum - early.linear_momentum, length * force, atol=1e-6 * plan.mass)


@given(share=st.floats(0.0, 1.0))
def test_only_contacts_that_are_held_carry_force(stepping_plan: Plan, share: float) -> None:
    state = stepping_plan.at(share * stepping_plan.duration)
    for force, contact in zip(state.forces, state.contacts.contacts, strict=True):
        assert contact is not None or not force.any()


def test_contacts_change_where_a_phase_ends(stepping_plan: Plan) -> None:
    phases = stepping_plan.phases
    assert phases is not None
    for p in range(len(phases)):
        for t in (phases.start[p], 0.5 * (phases.start[p] + phases.end[p])):
            held = [c >= 0 for c in phases.contact[p]]
            assert [contact is not None for contact in stepping_plan.at(t).contacts.contacts] == held


@pytest.mark.parametrize("t", [-0.01, 1e9, float("nan"), float("inf"), -float("inf")])
def test_a_time_outside_the_motion_is_refused_with_its_bounds(stepping_plan: Plan, t: float) -> None:
    with pytest.raises(InputError, match=r"at: expected a time within \[0, 9.8\] s"):
        stepping_plan.at(t)


def test_the_ends_of_the_motion_are_within_it(stepping_plan: Plan) -> None:
    assert stepping_plan.at(0.0).t == 0.0
    assert stepping_plan.at(stepping_plan.duration).t == stepping_plan.duration


def test_held_contacts_are_where_the_model_has_its_soles_and_palms(stepping_plan: Plan) -> None:
    """Drake's forward kinematics against the table of contacts."""
    poses = stepping_plan.frames(*EFFECTORS)
    seen = 0
    for k in range(0, len(stepping_plan.t), 25):
        for contact in stepping_plan.at(stepping_plan.t[k]).contacts.held:
            assert np.linalg.norm(poses[contact.effector][k, :3, 3] - contact.p_WC) < HELD
            seen += 1
    assert seen > 20


def test_frames_are_all_bodies_or_those_that_are_named(strolling_plan: Plan) -> None:
    every = strolling_plan.frames()
    assert set(EFFECTORS) | {"pelvis"} <= set(every)
    np.testing.assert_array_equal(every["pelvis"][:, :3, 3], strolling_plan.q[:, 4:7])
    with pytest.raises(InputError, match="unknown body 'pelvs': did you mean pelvis"):
        strolling_plan.frames("pelvs")


# ---- contacts


def test_a_table_of_contacts_has_their_points_normals_and_names(stepping_plan: Plan) -> None:
    pytest.importorskip("pandas")
    table = stepping_plan.contacts.to_pandas()
    assert len(table) == len(stepping_plan.contacts)
    for k, row in table.iterrows():
        contact: Contact = stepping_plan.contact(int(k))
        assert (row.effector, row.surface, row.friction) == (contact.effector, contact.surface, contact.friction)
        np.testing.assert_array_equal(row[["x", "y", "z"]].to_numpy(float), contact.p_WC)
        np.testing.assert_array_equal(row[["nx", "ny", "nz"]].to_numpy(float), contact.R_WC[:, 2])


def test_without_pandas_the_error_names_the_extra(stepping_plan: Plan, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "pandas", None)
    with pytest.raises(ImportError, match=r"pip install 'drakeplan\[pandas\]'"):
        stepping_plan.contacts.to_pandas()
