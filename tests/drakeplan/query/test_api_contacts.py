"""Contacts that a user makes lie on the terrain, and the motion over them is verified like any other."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from drakeplan.contact_planning.contact_domain import PlannerWeights
from drakeplan.plan.plan import Plan
from drakeplan.plan.verified import verify
from drakeplan.query.contact_on_terrain import WINDOW, make_contact
from drakeplan.query.given_contacts import plan_motion
from drakeplan.query.given_stances import given_stances
from drakeplan.query.options import PlanOptions
from scenes.contact import Contact, contact_heading, contact_rotation
from scenes.effector import EFFECTORS
from scenes.files.scene_source import load_scene
from scenes.footholds.what_stands import patch_off_surface
from scenes.input_error import InputError
from scenes.robots.robot import load_robot
from scenes.scene import Scene
from scenes.stance import Stance
from scenes.terrain.surface import Surface
from scenes.terrain.terrain import Terrain

ESCHER = load_robot("escher")
CORRIDOR = load_scene("rubble_corridor", seed=0)
ROUNDING = 1e-9  # [m, rad] of closed forms
ON_SURFACE = 1e-3  # [m] how far a patch may reach beyond its surface, as the verifier has it


def rect(name: str, z: float, x: tuple[float, float] = (-1.0, 3.0)) -> Surface:
    return Surface(name, np.array([[x[0], -1, z], [x[1], -1, z], [x[1], 1, z], [x[0], 1, z]]))


def two_floors() -> Scene:
    return Scene("two_floors", Terrain((rect("low", 0.0), rect("high", 2.5))))


def foot(side: str, x: float) -> Contact:
    return make_contact("flat", f"{side}_foot", (x, 0.1 if side == "left" else -0.1, 0.0))


def two_steps() -> list[dict[str, Contact]]:
    l0, r0, l1, r1 = foot("left", 0.0), foot("right", 0.0), foot("left", 0.25), foot("right", 0.25)
    return [
        {"left_foot": l0, "right_foot": r0},
        {"left_foot": l1, "right_foot": r0},
        {"left_foot": l1, "right_foot": r1},
    ]


# ---- make_contact


@given(x=st.floats(-0.3, 2.0), y=st.floats(-0.8, 0.8), z=st.floats(-0.09, 0.09), yaw=st.floats(-3.0, 3.0))
def test_on_level_ground_a_sole_is_where_it_is_asked_for(x: float, y: float, z: float, yaw: float) -> None:
    contact = make_contact("flat", "right_foot", (x, y, z), yaw)
    np.testing.assert_allclose(contact.p_WC, [x, y, 0.0], atol=ROUNDING)
    np.testing.assert_allclose(contact.R_WC, contact_rotation("right_foot", np.array([0.0, 0, 1]), yaw), atol=ROUNDING)
    assert contact.friction == 0.5 and contact.support is None


@settings(max_examples=60)
@given(
    x=st.floats(0.0, 3.0), y=st.floats(-0.9, 0.9), z=st.floats(-0.3, 1.8), yaw=st.floats(-3.0, 3.0),
    effector=st.sampled_from(EFFECTORS),
)  # fmt: skip
def test_among_stones_and_panels_a_contact_lies_on_its_surface_or_there_is_none(
    x: float, y: float, z: float, yaw: float, effector: str
) -> None:
    try:
        contact = make_contact(CORRIDOR, effector, (x, y, z), yaw)
    except InputError:
        return
    surface = CORRIDOR.terrain.surfaces[contact.surface]
    half = ESCHER.effectors[EFFECTORS.index(effector)].half_extent
    assert surface.allows(effector) and contact.friction == surface.friction
    assert np.linalg.norm(contact.p_WC - [x, y, z]) <= WINDOW + ROUNDING
    if contact.support is None:
        assert patch_off_surface(CORRIDOR.terrain, contact, half) < ON_SURFACE
        assert abs((contact.p_WC - surface.centroid) @ surface.normal) < 1e-6
    if "foot" in effector:
        np.testing.assert_array_equal(contact.p_WC[:2], [x, y])
        assert abs(np.angle(np.exp(1j * (contact_heading(contact.X_WC) - yaw)))) < 1e-6


def test_a_palm_lies_on_the_panel_beside_it_with_its_fingers_up() -> None:
    number, panel = next((k, s) for k, s in enumerate(CORRIDOR.terrain.surfaces) if s.name == "left_panel_1")
    contact = make_contact(CORRIDOR, "left_palm", panel.centroid + 0.05 * panel.normal)
    np.testing.assert_allclose(contact.p_WC, panel.centroid, atol=1e-6)
    np.testing.assert_allclose(contact.R_WC[:, 2], panel.normal, atol=ROUNDING)
    assert contact.surface == number and contact.R_WC[2, 0] > 0.7


def test_the_height_says_which_floor_is_meant() -> None:
    scene = two_floors()
    for z in (0.0, 2.5):
        assert make_contact(scene, "left_foot", (0.0, 0.0, z + 0.04)).p_WC[2] == z
    with pytest.raises(InputError, match=r"within 0.1 m of z 1; a sole fits at z 0.00 and 2.50 m there"):
        make_contact(scene, "left_foot", (0.0, 0.0, 1.0))
    assert make_contact("flat", "left_foot", (0.0, 0.0)).p_WC[2] == 0.0


@pytest.mark.parametrize(
    ("effector", "xyz", "said"),
    [
        ("left_hand", (0, 0, 0), "unknown end effector 'left_hand': did you mean left_palm"),
        ("left_foot", (99, 0, 0), "no ground takes left_foot at x 99, y 0 within 0.1 m of z 0; no sole fits"),
        ("left_palm", (0, 0, 0), "no surface takes left_palm within 0.1 m"),
        ("left_palm", (0, 0), r"expected x, y, z"),
        ("left_foot", (0, np.nan, 0), "expected finite x, y, z"),
        ("left_foot", "here", "expected finite x, y, z"),
        ("left_foot", (0, 0, 0, 0), "expected finite x, y, z"),
    ],
)
def test_what_is_no_contact_is_refused(effector: str, xyz, said: str) -> None:
    with pytest.raises(InputError, match=said):
        make_contact("flat", effector, xyz)


# ---- plan_motion


@pytest.mark.slow
def test_two_steps_become_a_verified_plan_over_these_contacts() -> None:
    stances = two_steps()
    result = plan_motion("flat", "escher", stances)
    plan = result.plan
    assert result.status == "complete" and plan is not None, result.reason
    assert result.verification is not None and result.verification.holds and verify(plan).holds
    for held, given_one in zip(plan.contact_sequence(), stances, strict=True):
        assert {c.effector: c for c in held.held} == given_one
    assert plan.provenance["planner"] == "given"
    assert "the contacts end at x 0.25, y 0.00, not at the scene's goal" in result.notes[0]
    # Lifted from rest, set down at rest: the weight is all that the ground carries in the mean.
    mean = plan.forces[:-1].sum(axis=1).mean(axis=0)
    np.testing.assert_allclose(mean, [0.0, 0.0, plan.mass * 9.81], atol=0.02 * plan.mass * 9.81)
    assert result.report["planner"] == "given" and result.report["cost"] == pytest.approx(
        2 * (PlannerWeights().step + 0.25)
    )


@pytest.mark.slow
def test_the_contacts_of_a_plan_with_a_palm_get_a_motion_again_when_one_was_moved(stepping_plan: Plan) -> None:
    """Moved by hand, the plan is refuted; planned again over the same stances, it holds."""
    X_WC = stepping_plan.contacts.X_WC[3].copy()
    X_WC[0, 3] += 0.02
    moved = stepping_plan.with_contact(3, X_WC)
    assert not verify(moved).holds
    result = plan_motion(moved.scene(), None, moved.contact_sequence(), PlanOptions(deadline=100.0))
    assert result.status == "complete" and result.plan is not None, result.reason
    np.testing.assert_array_equal(result.plan.contacts.X_WC, moved.contacts.X_WC)


@pytest.mark.slow
def test_a_step_that_is_too_long_has_no_motion_and_says_so() -> None:
    first, second, _ = two_steps()
    second = {**second, "left_foot": foot("left", 1.4)}
    result = plan_motion("flat", "escher", [first, second])
    assert result.status == "contacts" and result.plan is not None and result.plan.motion is None
    assert result.reason.startswith("no posture found for transition 0") and result.report["reason"] == result.reason


def refused(stances, said: str, **options) -> None:
    with pytest.raises(InputError, match=said) as error:
        plan_motion("flat", "escher", stances, PlanOptions(**options))
    assert "\n" not in str(error.value)


def test_two_changes_at_once_are_refused_in_one_line() -> None:
    first, _, last = two_steps()
    refused([first, last], "stances 0 and 1 differ in left_foot and right_foot: expected one end effector")
    refused([first, first], "stances 0 and 1 are the same")


def test_a_contact_off_the_terrain_is_refused_by_its_stance() -> None:
    first, second, _ = two_steps()
    step = second["left_foot"]
    for dz, dx in ((0.05, 0.0), (-0.05, 0.0), (0.0, 30.0)):
        X_WC = step.X_WC.copy()
        X_WC[:3, 3] += [dx, 0.0, dz]
        off = {**second, "left_foot": dataclasses.replace(step, X_WC=X_WC)}
        refused([first, off], r"stance 1: contact 2 \(left_foot\) on ground: .*expected at most")
    nowhere = {**second, "left_foot": dataclasses.replace(step, surface=7)}
    refused([first, nowhere], r"stance 1: contact 2 \(left_foot\): contact surface exists")


def test_a_contact_on_an_avoided_surface_is_refused() -> None:
    refused(two_steps(), "stance 0: .* on ground: contact allowed", avoid=("ground",))


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (lambda s: s[:1], "expected two or more, got 1"),
        (lambda s: [], "expected two or more, got 0"),
        (lambda s: [s[0], 3], r"stances\[1\]: expected a Stance or a dict, got int"),
        (lambda s: [s[0], {"left_foot": np.eye(4)}], r"stances\[1\]\['left_foot'\]: expected a Contact"),
        (lambda s: [s[0], {"left_hand": s[0]["left_foot"]}], "unknown end effector 'left_hand'"),
        (lambda s: [s[0], {"right_foot": s[0]["left_foot"]}], "holds a contact of left_foot"),
        (lambda s: [{"left_foot": s[0]["left_foot"]}, {}], "no foot is held in the last one"),
    ],
)
def test_what_is_no_sequence_is_refused(change, said: str) -> None:
    refused(change(two_steps()), said)


def test_stances_and_dicts_mean_the_same() -> None:
    dicts = two_steps()
    stances = [Stance((d["left_foot"], d["right_foot"], None, None)) for d in dicts]
    assert given_stances(dicts, None) == given_stances(stances, None) == tuple(stances)
    smooth = given_stances([{**d, "left_palm": None} for d in dicts], 0.2)  # type: ignore[dict-item]
    assert {c.friction for stance in smooth for c in stance.held} == {0.2}
