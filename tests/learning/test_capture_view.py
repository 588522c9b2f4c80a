"""Questions seen from the standing foot: the same wherever it stands, however it is turned, and on whichever side."""

from __future__ import annotations

from dataclasses import fields, replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from learning.capture_view import CaptureViews, FootFrame, motion_of, view_of
from optimization.capture.question import CaptureQuestion
from optimization.capture.sampling import CAPTURE_MOTIONS, random_question
from scenes.contact import Contact, contact_pose
from scenes.effector import EFFECTORS, LEFT_FOOT, RIGHT_FOOT
from scenes.input_error import InputError
from scenes.pose import rpy_rotation
from scenes.robots.robot import load_robot
from scenes.stance import Stance

ROBOT = load_robot("escher")
UP = np.array([0.0, 0.0, 1.0])
SEEDS, MOTIONS = st.integers(0, 10_000), st.sampled_from(CAPTURE_MOTIONS)
ANGLES = st.floats(-4.0, 4.0)
PLACES = st.tuples(*[st.floats(-5.0, 5.0)] * 3)


def moved(question: CaptureQuestion, yaw: float, shift: tuple[float, ...]) -> CaptureQuestion:
    """The whole question turned about z, then shifted."""
    turn = rpy_rotation([0.0, 0.0, yaw])

    def carried(contact: Contact | None) -> Contact | None:
        if contact is None:
            return None
        X_WC = np.eye(4)
        X_WC[:3, :3], X_WC[:3, 3] = turn @ contact.R_WC, turn @ contact.p_WC + shift
        return replace(contact, X_WC=X_WC, heading=contact.heading + yaw)

    stance = Stance(tuple(carried(c) for c in question.stance.contacts))
    com, linear, angular = (
        turn @ question.com + shift,
        turn @ question.linear_momentum,
        turn @ question.angular_momentum,
    )
    return CaptureQuestion(stance, com, linear, angular, carried(question.new_contact))


def spinning(seed: int, motion: str) -> CaptureQuestion:
    rng = np.random.default_rng(seed)
    question = random_question(rng, ROBOT, motion)
    return replace(question, angular_momentum=rng.normal(0.0, 3.0, 3))


def assert_same(one: CaptureViews, other: CaptureViews) -> None:
    for field in fields(CaptureViews):
        np.testing.assert_allclose(getattr(one, field.name), getattr(other, field.name), atol=1e-9, err_msg=field.name)


def standing(effector: str, x: float = 0.0, y: float = 0.0, yaw: float = 0.0) -> Contact:
    return Contact(effector, 0, contact_pose(effector, np.array([x, y, 0.0]), UP, yaw), 0.5, yaw)


def on(*contacts: Contact) -> Stance:
    return Stance(tuple(next((c for c in contacts if c.effector == e), None) for e in EFFECTORS))


@given(SEEDS, MOTIONS, ANGLES, PLACES)
def test_a_question_and_its_mirror_image_look_alike(seed: int, motion: str, yaw: float, shift) -> None:
    question = moved(spinning(seed, motion), yaw, shift)
    assert_same(view_of(question, ROBOT.mass), view_of(question.mirrored(), ROBOT.mass))


@given(SEEDS, MOTIONS, ANGLES, PLACES)
def test_a_view_does_not_know_where_the_foot_stands_nor_where_it_points(seed: int, motion: str, yaw, shift) -> None:
    question = spinning(seed, motion)
    assert_same(view_of(question, ROBOT.mass), view_of(moved(question, yaw, shift), ROBOT.mass))


@given(SEEDS, MOTIONS, ANGLES, PLACES)
def test_frames_stay_rotations_and_the_foot_points_ahead(seed: int, motion: str, yaw: float, shift) -> None:
    view = view_of(moved(spinning(seed, motion), yaw, shift), ROBOT.mass)
    for R in (view.foot_R[0], view.R_new[0]):
        np.testing.assert_allclose(R @ R.T, np.eye(3), atol=1e-12)
        assert np.linalg.det(R) == pytest.approx(1.0)
    assert view.foot_R[0, 1, 0] == pytest.approx(0.0, abs=1e-12) and view.foot_R[0, 0, 0] > 0


@given(SEEDS, st.sampled_from(CAPTURE_MOTIONS[1:]), ANGLES, PLACES)
def test_heights_lengths_and_what_lies_along_normals_are_those_of_the_world(seed, motion, yaw, shift) -> None:
    question = moved(spinning(seed, motion), yaw, shift)
    (foot,), new, view = question.stance.held, question.new_contact, view_of(question, ROBOT.mass)
    assert new is not None
    velocity, p, com = question.linear_momentum / ROBOT.mass, view.p_new[0], view.com[0]
    assert np.linalg.norm(p - com) == pytest.approx(np.linalg.norm(new.p_WC - question.com))
    assert np.linalg.norm(com) == pytest.approx(np.linalg.norm(question.com - foot.p_WC))
    assert (com[2], p[2]) == pytest.approx((question.com[2] - foot.p_WC[2], new.p_WC[2] - foot.p_WC[2]))
    assert view.velocity[0] @ view.R_new[0, :, 2] == pytest.approx(velocity @ new.R_WC[:, 2])
    assert view.velocity[0] @ (p - com) == pytest.approx(velocity @ (new.p_WC - question.com), abs=1e-9)


@pytest.mark.parametrize("foot", ["left_foot", "right_foot"])
def test_the_spin_of_a_cloud_of_masses_is_that_of_the_cloud_as_it_is_seen(foot: str) -> None:
    """Sum m r x v over the mass, with r and v in W or in F: axial vectors do not mirror as others do."""
    rng = np.random.default_rng(3)
    m, p, v = rng.uniform(0.5, 2.0, (20, 1)), rng.normal([4.0, 1.0, 0.9], 1.0, (20, 3)), rng.normal(size=(20, 3))
    mass = m.sum()
    com = (m * p).sum(axis=0) / mass
    contact = standing(foot, 4.0, 1.0, 2.2)
    question = CaptureQuestion(on(contact), com, (m * v).sum(axis=0), np.cross(p - com, m * v).sum(axis=0))
    view, frame = view_of(question, mass), FootFrame.of(contact.p_WC, contact.R_WC, EFFECTORS.index(foot))
    r, w = frame.points(p) - view.com[0], frame.vectors(v)
    np.testing.assert_allclose(view.spin[0], np.cross(r, m * w).sum(axis=0) / mass, atol=1e-12)
    np.testing.assert_allclose(view.velocity[0], (m * w).sum(axis=0) / mass, atol=1e-12)


@pytest.mark.parametrize(("foot", "side"), [(LEFT_FOOT, 1.0), (RIGHT_FOOT, -1.0)])
def test_x_is_ahead_of_the_foot_and_y_away_from_the_other_foot(foot: int, side: float) -> None:
    contact = standing(EFFECTORS[foot], 1.0, 2.0, np.pi / 2)  # heads for +y of W, so that its left is -x
    frame = FootFrame.of(contact.p_WC, contact.R_WC, foot)
    np.testing.assert_allclose(frame.points(np.array([1.0, 2.3, 0.9])), [0.3, 0.0, 0.9], atol=1e-12)
    np.testing.assert_allclose(frame.points(np.array([0.9, 2.0, 0.0])), [0.0, side * 0.1, 0.0], atol=1e-12)
    np.testing.assert_allclose(frame.axial(np.array([0.0, 0.0, 1.0])), [0.0, 0.0, side], atol=1e-12)


@given(SEEDS, MOTIONS)
def test_motions_are_known_by_the_names_they_are_drawn_by(seed: int, motion: str) -> None:
    question = random_question(np.random.default_rng(seed), ROBOT, motion)
    assert CAPTURE_MOTIONS[motion_of(question)] == motion
    assert view_of(question, ROBOT.mass).motion.tolist() == [CAPTURE_MOTIONS.index(motion)]


def test_rows_are_taken_by_index_and_by_mask() -> None:
    views = view_of(spinning(0, "foot"), ROBOT.mass)
    assert len(views.take(np.array([0, 0, 0]))) == 3 and len(views.take(np.array([False]))) == 0
    assert_same(views.take(np.array([True])), views)


LEFT, RIGHT = standing("left_foot", 0.0, 0.1), standing("right_foot", 0.0, -0.1)
PALM = Contact(
    "left_palm", 1, contact_pose("left_palm", np.array([0.2, 0.6, 1.2]), np.array([0.0, -1.0, 0.0]), 0.0), 0.5
)


@pytest.mark.parametrize(
    ("held", "new"),
    [
        ((LEFT, RIGHT), None),
        ((LEFT, RIGHT), PALM),
        ((LEFT, PALM), None),
        ((LEFT, PALM), RIGHT),
        ((PALM,), None),
        ((PALM,), LEFT),
        ((LEFT, RIGHT), standing("right_foot", 0.2, -0.2)),
    ],
)
def test_stances_of_other_than_one_foot_are_refused(held: tuple[Contact, ...], new: Contact | None) -> None:
    question = CaptureQuestion(on(*held), np.array([0.0, 0.0, 0.9]), np.zeros(3), new_contact=new)
    for ask in (motion_of, lambda q: view_of(q, ROBOT.mass)):
        with pytest.raises(InputError, match="stances of one foot"):
            ask(question)
