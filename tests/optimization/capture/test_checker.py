"""Capture: what is accepted holds in Drake's eyes, keeps to the pendulum's bound, and reads the same in a mirror."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from optimization.capture.checker import CaptureAnswer, CaptureChecker, CaptureOptions, capture_options
from optimization.capture.inverted_pendulum import (
    angular_allowance,
    capture_point,
    depth_inside,
    frequency,
    one_step_region,
    support_polygon,
)
from optimization.capture.question import CaptureQuestion
from optimization.capture.sampling import CAPTURE_MOTIONS, random_question
from scenes.contact import Contact, contact_pose
from scenes.effector import EFFECTORS
from scenes.input_error import InputError
from scenes.robots.plant import build_plant
from scenes.robots.robot import load_robot
from scenes.stance import Stance

ROBOT = load_robot("escher")
UP = np.array([0.0, 0.0, 1.0])
PLACE, TURN = 5e-3, 0.02  # [m, rad] that a held sole may be off, as the checks say
GAP = 0.0101  # [m] of the CoM, as the checks say


@pytest.fixture(scope="module")
def checker() -> CaptureChecker:
    return CaptureChecker(ROBOT)


def foot(effector: str, x: float, y: float, friction: float = 0.5) -> Contact:
    return Contact(effector, 0, contact_pose(effector, np.array([x, y, 0.0]), UP, 0.0), friction)


def on_left(momentum: list[float], new: Contact | None = None, friction: float = 0.5) -> CaptureQuestion:
    """On the left foot at y = 0.1, the CoM nearly over it; `momentum` over the mass [m/s]."""
    stance = Stance((foot("left_foot", 0.0, 0.1, friction), None, None, None))
    return CaptureQuestion(stance, np.array([0.0, 0.08, 0.9]), ROBOT.mass * np.array(momentum), new_contact=new)


def test_a_robot_at_rest_over_its_foot_is_captured_where_it_stands(checker: CaptureChecker) -> None:
    answer = checker.check(on_left([0.0, 0.0, 0.0]))
    assert answer.captured
    assert answer.duration == 0.0
    estimate = answer.attempts[-1].estimate
    assert estimate.centroidal is not None
    trajectory = estimate.centroidal.trajectory
    assert trajectory is not None
    np.testing.assert_allclose(trajectory.com, np.tile([0.0, 0.08, 0.9], (len(trajectory.t), 1)), atol=5e-3)
    np.testing.assert_allclose(trajectory.force_W[:, 0, 2], ROBOT.mass * 9.81, rtol=1e-3)


def test_a_gentle_push_is_captured_by_the_foot_and_a_strong_one_is_not(checker: CaptureChecker) -> None:
    question = on_left([0.0, 0.0, 0.0])
    assert checker.check(question.pushed(ROBOT.mass * np.array([0.15, 0.0, 0.0]))).captured
    answer = checker.check(question.pushed(ROBOT.mass * np.array([1.0, 0.0, 0.0])))
    assert not answer.captured
    assert answer.duration is None
    assert answer.reason.startswith("standing, ")
    assert "angular momentum" in answer.reason


def test_a_step_captures_what_standing_does_not(checker: CaptureChecker) -> None:
    push = [0.1, -0.5, 0.0]
    assert not checker.check(on_left(push)).captured
    answer = checker.check(on_left(push, foot("right_foot", 0.08, -0.22)))
    assert answer.captured, answer.reason
    assert answer.duration in checker.options.swing_times
    assert 1 <= len(answer.gaps) <= 3


def test_a_reason_names_phase_and_block(checker: CaptureChecker) -> None:
    answer = checker.check(on_left([0.0, -0.2, 0.0], foot("right_foot", 0.0, -1.6)))
    assert not answer.captured
    assert any(phase in answer.reason for phase in ("swing of right_foot, 0.", "after contact of right_foot, 0."))
    assert ": reach of right_foot exceeded" in answer.reason  # 1.7 m from the other foot


def test_ground_that_is_too_steep_to_rest_on_is_told_with_its_instant(checker: CaptureChecker) -> None:
    """35 deg at friction 0.5: the foot holds nothing at the end, when the robot must be at rest."""
    normal = np.array([np.sin(0.61), 0.0, np.cos(0.61)])
    steep = Contact("left_foot", 0, contact_pose("left_foot", np.array([0.0, 0.1, 0.0]), normal, 0.0), 0.5)
    answer = checker.check(CaptureQuestion(Stance((steep, None, None, None)), np.array([0.02, 0.1, 0.85]), np.zeros(3)))
    assert not answer.captured
    assert "friction cone of left_foot" in answer.reason
    assert answer.reason.startswith("standing, ")
    assert not answer.reason.startswith("standing, 0.00 s")


def test_a_state_that_no_posture_has_is_told_before_anything_is_solved(checker: CaptureChecker) -> None:
    stance = Stance((foot("left_foot", 0.0, 0.1), None, None, None))
    answer = checker.check(CaptureQuestion(stance, np.array([0.0, 0.1, 1.6]), np.zeros(3)))
    assert not answer.captured
    assert answer.reason.startswith("start: ")
    assert answer.attempts == ()


def test_without_friction_no_push_along_the_ground_is_captured(checker: CaptureChecker) -> None:
    assert not checker.check(on_left([0.15, 0.0, 0.0], friction=0.0)).captured
    assert checker.check(on_left([0.15, 0.0, 0.0])).captured


def test_a_robot_that_may_not_turn_its_body_is_captured_only_inside_its_foot(checker: CaptureChecker) -> None:
    """With |k| and |kdot| held near zero the pendulum's bound closes on the foot's edge."""
    limits = {"angular_momentum_limit": (0.3,) * 3, "angular_momentum_rate_limit": (1.0,) * 3}
    kinodynamic = checker.options.kinodynamic
    kinodynamic = replace(kinodynamic, centroidal=replace(kinodynamic.centroidal, **limits))
    strict = replace(checker.options, kinodynamic=kinodynamic)
    stiff = CaptureChecker(ROBOT, strict)
    omega = frequency(0.9)
    inside, outside = (omega * (0.11 + margin) for margin in (-0.03, 0.02))
    assert stiff.check(on_left([inside, 0.0, 0.0])).captured
    assert not stiff.check(on_left([outside, 0.0, 0.0])).captured
    assert checker.check(on_left([outside, 0.0, 0.0])).captured


@pytest.mark.parametrize("motion", CAPTURE_MOTIONS)
def test_the_mirror_image_of_a_question_has_the_same_answer(checker: CaptureChecker, motion: str) -> None:
    answers = set()
    for seed in range(3):
        question = random_question(np.random.default_rng((9, seed)), ROBOT, motion)
        slow = replace(question, linear_momentum=0.5 * question.linear_momentum)
        for asked in (question, slow):
            first, second = checker.check(asked), checker.check(asked.mirrored())
            assert (first.captured, first.duration) == (second.captured, second.duration), asked
            answers.add(first.captured)
    assert answers == {True, False}


def test_answers_do_not_depend_on_what_was_asked_before(checker: CaptureChecker) -> None:
    questions = [random_question(np.random.default_rng((4, seed)), ROBOT, "foot") for seed in range(4)]
    fresh = CaptureChecker(ROBOT)
    for question, answer in zip(questions, reversed([fresh.check(q) for q in reversed(questions)]), strict=True):
        again = checker.check(question)
        assert (again.captured, again.duration, again.reason) == (answer.captured, answer.duration, answer.reason)


def _level(seed: int, motion: str) -> CaptureQuestion:
    """On level ground, the capture point drawn around the middle of the supports, within and without them."""
    rng = np.random.default_rng((21, seed))
    question = random_question(rng, ROBOT, motion, level=True)
    reach = np.array([0.11, 0.05]) if seed % 2 else np.array([0.4, 0.35])
    share = rng.uniform(0.0, 1.0) if motion == "foot" else 0.0
    ends = [c.p_WC[:2] for c in (*question.stance.held, *question.final_stance.held)]
    point = (1.0 - share) * ends[0] + share * ends[-1] + reach * rng.uniform(-1.0, 1.0, 2)
    momentum = ROBOT.mass * frequency(question.com[2]) * (point - question.com[:2])
    return replace(question, linear_momentum=np.append(momentum, 0.0))


def _depth(question: CaptureQuestion, times: tuple[float, ...]) -> float:
    omega = frequency(question.com[2])
    point = capture_point(question.com, question.linear_momentum / ROBOT.mass)
    before = support_polygon(question.swing_stance, ROBOT)
    if question.new_contact is None:
        return depth_inside(before, point)
    after = support_polygon(question.final_stance, ROBOT)
    return max(depth_inside(one_step_region(before, after, time, omega), point) for time in times)


@pytest.mark.slow
@pytest.mark.parametrize("motion", ["stay", "foot"])
def test_none_is_accepted_beyond_the_pendulums_bound_and_most_well_inside_are(
    checker: CaptureChecker, motion: str
) -> None:
    well_inside, far_outside = [], 0
    for seed in range(40):
        question = _level(seed, motion)
        depth = _depth(question, checker.options.swing_times)
        captured = checker.check(question).captured
        omega = frequency(question.com[2])
        allowance = angular_allowance(checker.options.kinodynamic.centroidal, ROBOT.mass, omega)
        assert not (captured and depth < -allowance), f"seed {seed}: accepted {-depth:.3f} m outside"
        far_outside += depth < -allowance
        if depth > 0.015:
            well_inside.append(captured)
    assert far_outside >= 5
    assert len(well_inside) >= 10
    assert np.mean(well_inside) >= 0.9


def test_torque_limits_bind_the_forces_where_they_must() -> None:
    """Motors are weakened to a little less than the free answer asks for: another answer keeps to them, or none does."""
    checker = CaptureChecker(ROBOT)
    question = on_left([0.1, -0.5, 0.0], foot("right_foot", 0.08, -0.22))
    free = checker.check(question).attempts[-1].estimate
    for share in (0.95, 0.5, 0.1):
        weak = CaptureChecker(ROBOT)
        for program in (weak._program, weak._limited):
            program.effort = share * free.torque_share * program.effort
        answer = weak.check(question)
        if answer.captured:
            assert answer.attempts[-1].estimate.torque_share <= 1.0 + 1e-3
        else:
            assert answer.reason
        assert answer.captured or share < 0.95
        assert not (answer.captured and share == 0.1)


def _captured(checker: CaptureChecker, motion: str) -> tuple[CaptureQuestion, CaptureAnswer]:
    for seed in range(40):
        question = random_question(np.random.default_rng((3, seed)), ROBOT, motion)
        question = replace(question, linear_momentum=0.6 * question.linear_momentum)
        answer = checker.check(question)
        if answer.captured and len(answer.gaps) >= 1:
            return question, answer
    raise AssertionError("nothing was captured")


@pytest.mark.parametrize("motion", CAPTURE_MOTIONS)
def test_drake_agrees_with_what_is_called_captured(checker: CaptureChecker, motion: str) -> None:
    question, answer = _captured(checker, motion)
    attempt = answer.attempts[-1]
    assert attempt.estimate.centroidal is not None
    trajectory = attempt.estimate.centroidal.trajectory
    assert trajectory is not None
    q, t = attempt.estimate.q, trajectory.t
    plant, context = (built := build_plant(ROBOT)).plant, built.plant.CreateDefaultContext()
    lower, upper = plant.GetPositionLowerLimits()[7:], plant.GetPositionUpperLimits()[7:]
    assert (q[:, 7:] >= lower - 1e-6).all()
    assert (q[:, 7:] <= upper + 1e-6).all()
    speed = np.abs(np.diff(q[:, 7:], axis=0)) / np.diff(t)[:, None]
    assert (speed <= 1.001 * plant.GetVelocityUpperLimits()[6:]).all()
    coms = []
    for time, row in zip(t, q, strict=True):
        plant.SetPositions(context, row)
        coms.append(plant.CalcCenterOfMassPositionInWorld(context))
        held = question.final_stance if time >= attempt.swing_time - 1e-9 else question.swing_stance
        for contact in held.held:
            frame = plant.GetFrameByName(ROBOT.effectors[EFFECTORS.index(contact.effector)].frame)
            X_WE = frame.CalcPoseInWorld(context).GetAsMatrix4()
            assert np.linalg.norm(X_WE[:3, 3] - contact.p_WC) < PLACE
            assert np.linalg.norm(X_WE[:3, :3] - contact.R_WC) < 2 * TURN
    assert np.linalg.norm(np.array(coms) - trajectory.com, axis=1).max() < GAP
    assert t[-1] == pytest.approx(2.0)
    np.testing.assert_allclose(trajectory.linear_momentum[-2:], 0.0, atol=1e-2)
    np.testing.assert_allclose(trajectory.angular_momentum[-2:], 0.0, atol=1e-2)
    np.testing.assert_array_equal(trajectory.linear_momentum[0], question.linear_momentum)
    new = [] if question.new_contact is None else [EFFECTORS.index(question.new_contact.effector)]
    for n in np.flatnonzero(t < attempt.swing_time - 1e-9):
        assert not trajectory.force_W[n, new].any()


def test_steps_fill_the_horizon_and_meet_the_contact() -> None:
    options = CaptureOptions()
    for swing in (0.0, *options.swing_times):
        t = np.concatenate([[0.0], np.cumsum(options.steps(swing))])
        assert t[-1] == pytest.approx(2.0)
        assert np.abs(t - swing).min() < 1e-9
        assert set(np.round(np.diff(t), 9)) <= {0.1, 0.2}
        assert all(b >= a for a, b in pairwise(np.round(np.diff(t), 9)))


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"swing_times": ()}, "one or more, ascending"),
        ({"swing_times": (0.4, 0.2)}, "one or more, ascending"),
        ({"swing_times": (0.25,)}, "multiple of dt"),
        ({"swing_times": (2.0,)}, "before the horizon"),
        ({"horizon": float("nan")}, "horizon"),
        ({"dt": 0.0}, "dt"),
    ],
)
def test_options_that_make_no_sense_are_refused(changes: dict[str, object], message: str) -> None:
    with pytest.raises(InputError, match=message):
        CaptureOptions(**changes)  # type: ignore[arg-type]


def test_limits_are_those_of_the_robot() -> None:
    centroidal = capture_options(ROBOT, "square").kinodynamic.centroidal
    assert centroidal.cone == "square"
    assert centroidal.com_height == ROBOT.com_height
    assert centroidal.rest_at_end
    assert centroidal.final_half_width is None
