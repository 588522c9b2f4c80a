"""Questions of capture: their mirror image, their draws, and what cannot be asked."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from optimization.capture.question import CaptureQuestion
from optimization.capture.sampling import CAPTURE_MOTIONS, MAX_CLIMB, MAX_SPEED, MAX_TILT, random_question
from scenes.contact import Contact, contact_pose
from scenes.effector import EFFECTORS
from scenes.input_error import InputError
from scenes.robots.robot import Robot, load_robot
from scenes.stance import Stance

UP = np.array([0.0, 0.0, 1.0])


@pytest.fixture(scope="module")
def robot() -> Robot:
    return load_robot("escher")


def _foot(effector: str, x: float, y: float) -> Contact:
    return Contact(effector, 0, contact_pose(effector, np.array([x, y, 0.0]), UP, 0.0), 0.5)


STANDING = Stance((_foot("left_foot", 0.0, 0.1), _foot("right_foot", 0.0, -0.1), None, None))
COM = np.array([0.0, 0.0, 0.9])


@given(st.integers(0, 10_000), st.sampled_from(CAPTURE_MOTIONS))
def test_a_mirror_image_in_the_mirror_is_the_question_itself(robot: Robot, seed: int, motion: str) -> None:
    question = random_question(np.random.default_rng(seed), robot, motion)
    again = question.mirrored().mirrored()
    np.testing.assert_array_equal(again.com, question.com)
    np.testing.assert_array_equal(again.linear_momentum, question.linear_momentum)
    assert again.stance == question.stance
    assert again.new_contact == question.new_contact


@given(st.integers(0, 10_000), st.sampled_from(CAPTURE_MOTIONS))
def test_the_mirror_turns_left_into_right_and_keeps_frames_right_handed(robot: Robot, seed: int, motion: str) -> None:
    question = random_question(np.random.default_rng(seed), robot, motion)
    mirrored = question.mirrored()
    for before, after in zip(question.final_stance.held, reversed(mirrored.final_stance.held), strict=True):
        if len(question.final_stance.held) == 1:
            assert before.effector.split("_")[0] != after.effector.split("_")[0]
    for contact in mirrored.final_stance.held:
        assert np.linalg.det(contact.R_WC) == pytest.approx(1.0)
    normals = sorted(tuple(np.round(c.R_WC[:, 2] * [1, -1, 1], 9)) for c in mirrored.final_stance.held)
    assert normals == sorted(tuple(np.round(c.R_WC[:, 2], 9)) for c in question.final_stance.held)


def test_angular_momentum_is_mirrored_as_that_of_mirrored_masses() -> None:
    """Sum m p x v of a cloud of points, and of its mirror image."""
    rng = np.random.default_rng(0)
    p, v = rng.normal(size=(2, 20, 3))
    mirror = np.array([1.0, -1.0, 1.0])
    question = CaptureQuestion(STANDING, COM, v.sum(axis=0), np.cross(p, v).sum(axis=0)).mirrored()
    np.testing.assert_allclose(question.angular_momentum, np.cross(mirror * p, mirror * v).sum(axis=0))
    np.testing.assert_allclose(question.linear_momentum, (mirror * v).sum(axis=0))


@given(st.integers(0, 10_000), st.sampled_from(CAPTURE_MOTIONS), st.booleans())
def test_draws_keep_to_the_documents_intervals(robot: Robot, seed: int, motion: str, level: bool) -> None:
    question = random_question(np.random.default_rng(seed), robot, motion, level=level)
    speed = np.linalg.norm(question.linear_momentum) / robot.mass
    assert speed <= MAX_SPEED
    assert abs(question.linear_momentum[2]) <= np.sin(MAX_CLIMB) * robot.mass * speed + 1e-9
    (foot,) = question.stance.held
    assert foot.effector.endswith("_foot")
    assert foot.R_WC[2, 2] >= np.cos(MAX_TILT) - 1e-9
    if level:
        assert foot.R_WC[2, 2] == 1.0
    wanted = {"stay": None, "foot": "foot", "same_palm": "palm", "opposite_palm": "palm"}[motion]
    assert (None if question.new_contact is None else question.new_contact.effector.split("_")[1]) == wanted
    if question.new_contact is not None:
        same_side = question.new_contact.effector.split("_")[0] == foot.effector.split("_")[0]
        assert same_side == (motion == "same_palm")
        if wanted == "palm":
            assert (question.com - question.new_contact.p_WC)[:2] @ question.new_contact.R_WC[:2, 2] > 0


def test_a_push_adds_to_the_linear_momentum_alone() -> None:
    question = CaptureQuestion(STANDING, COM, np.array([1.0, 2.0, 3.0]), np.array([4.0, 5.0, 6.0]))
    pushed = question.pushed(np.array([0.0, 38.0, 0.0]))
    np.testing.assert_array_equal(pushed.linear_momentum, [1.0, 40.0, 3.0])
    np.testing.assert_array_equal(pushed.angular_momentum, question.angular_momentum)
    np.testing.assert_array_equal(pushed.com, question.com)


def test_a_held_end_effector_that_moves_is_let_go_first() -> None:
    new = _foot("right_foot", 0.1, -0.4)
    question = CaptureQuestion(STANDING, COM, np.zeros(3), new_contact=new)
    assert EFFECTORS[question.moving] == "right_foot"
    assert question.swing_stance.contacts[1] is None
    assert question.final_stance.contacts[1] == new
    assert question.final_stance.contacts[0] == STANDING.contacts[0]


@pytest.mark.parametrize(
    ("stance", "com", "new", "message"),
    [
        (Stance((None,) * 4), COM, None, "at least one contact"),
        (STANDING, np.array([0.0, np.nan, 1.0]), None, "com must be three finite numbers"),
        (STANDING, np.zeros(2), None, "com must be three finite numbers"),
        (STANDING, COM, _foot("right_foot", 0.0, -0.1), "in the stance already"),
        (Stance((None, _foot("right_foot", 0.0, -0.1), None, None)), COM, _foot("right_foot", 1, 1), "nothing is held"),
    ],
)
def test_what_cannot_be_asked_is_refused(stance: Stance, com: np.ndarray, new: Contact | None, message: str) -> None:
    with pytest.raises(InputError, match=message):
        CaptureQuestion(stance, com, np.zeros(3), new_contact=new)


def test_the_mirror_image_of_a_support_is_counter_clockwise_and_carries_the_mirrored_forces() -> None:
    heel = np.array([[-0.02, 0.05], [-0.11, 0.03], [-0.11, -0.05]])
    contact = dataclasses.replace(_foot("left_foot", 0.0, 0.1), support=heel)
    question = CaptureQuestion(Stance((contact, *STANDING.contacts[1:])), COM, np.zeros(3))
    mirrored = question.mirrored().stance.contacts[1]
    assert mirrored is not None
    assert mirrored.support is not None
    seen = contact.p_WC[:2] + heel @ contact.R_WC[:2, :2].T
    image = mirrored.p_WC[:2] + mirrored.support @ mirrored.R_WC[:2, :2].T
    assert {tuple(p) for p in np.round(image, 9)} == {tuple(p) for p in np.round(seen * [1.0, -1.0], 9)}
