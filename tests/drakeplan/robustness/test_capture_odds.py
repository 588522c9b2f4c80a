"""P_reject of a pushed state against plain loops over capture poses, with networks that are made up."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from drakeplan.contact_planning.contact_pool import ContactPool
from drakeplan.robustness import capture_odds
from drakeplan.robustness.capture_odds import CaptureModel, CaptureOdds
from drakeplan.robustness.capture_poses import CapturePoses
from learning.capture_features import NUM_FEATURES, documented_features, features
from learning.capture_networks import CapturePrediction
from learning.capture_view import NUM_MOTIONS, CaptureViews, motion_of, view_of
from learning.weights import WeightsError
from optimization.capture.question import CaptureQuestion
from scenes.contact import Contact, contact_pose
from scenes.effector import LEFT_FOOT
from scenes.library.plates import level_plate, wall_plate
from scenes.robots.robot import load_robot
from scenes.stance import Stance
from scenes.terrain.packed_terrain import pack_terrain
from scenes.terrain.terrain import Terrain

ROBOT = load_robot("escher")
PACKED = pack_terrain(
    Terrain((level_plate("floor", (-2.0, 2.0), (-0.6, 0.9)), wall_plate("wall", (-2.0, 2.0), 0.7, (0.3, 2.1))))
)
WEIGHTS = np.random.default_rng(3).normal(scale=0.4, size=(NUM_MOTIONS, NUM_FEATURES))
FAR = 0.15  # [m] com.x in F
UP = np.array([0.0, 0.0, 1.0])
FEET = [
    Contact(name, 0, contact_pose(name, np.array(place), UP, yaw), 0.5, yaw)
    for name, place, yaw in (("left_foot", (0.1, 0.2, 0.0), 0.3), ("right_foot", (0.0, 0.1, 0.0), -0.2))
]


@dataclass
class MadeUp:
    """Answers as `CaptureNetworks` does, by one sum of the features for each motion."""

    kind: str = "ensemble"
    friction: float = 0.5
    far: float = FAR
    rows: list[int] = field(default_factory=list)
    inputs: list[np.ndarray] = field(default_factory=list)

    def answer(self, motion: int, x: np.ndarray, inputs: np.ndarray | None = None) -> CapturePrediction:
        self.rows.append(len(x))
        if inputs is not None:
            self.inputs.append(inputs)
        score = x.astype(float) @ WEIGHTS[motion]
        return CapturePrediction(1.0 / (1.0 + np.exp(-score)), 0.2 * np.sin(3.0 * score) ** 2, x[:, 0] > self.far)

    def predict(self, views: CaptureViews) -> CapturePrediction:
        each = [self.answer(int(m), features(views.take(np.array([k])))) for k, m in enumerate(views.motion)]
        return CapturePrediction(*(np.concatenate(parts) for parts in zip(*each, strict=True)))


def made(networks: MadeUp, contact: Contact, model: CaptureModel = "motions") -> tuple[CaptureOdds, int]:
    """The odds, and the number of the standing foot."""
    pool = ContactPool(PACKED)
    odds = CaptureOdds(networks, CapturePoses(PACKED, ROBOT, pool), model)  # type: ignore[arg-type]
    return odds, pool.add_contact(contact)


def states(n: int, seed: int = 0) -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(seed)
    return rng.uniform([-0.2, 0.0, 0.8], [0.4, 0.4, 1.0], (n, 3)), rng.uniform(-0.8, 0.8, (n, 3))


def questions(odds: CaptureOdds, foot: int, com: np.ndarray, velocity: np.ndarray) -> Iterator[CaptureQuestion]:
    """Every question about one state: to stay, and each capture pose."""
    contact = odds.poses.pool.contact(foot)
    held = [None] * 4
    held[int(odds.poses.pool.effector[foot])] = contact  # type: ignore[call-overload]
    for number in (None, *odds.poses.about(foot).numbers.tolist()):
        new = None if number is None else odds.poses.pool.contact(number)
        yield CaptureQuestion(Stance(tuple(held)), com, ROBOT.mass * velocity, new_contact=new)


def by_loops(odds: CaptureOdds, foot: int, com: np.ndarray, velocity: np.ndarray) -> tuple[float, float]:
    """P_reject of one state by the formula of `capture_odds`, and by that of Lin 2020 sec. 7.7.1."""
    best, captures = {}, 0
    for question in questions(odds, foot, com, velocity):
        motion, view = motion_of(question), view_of(question, ROBOT.mass)
        (p,), (spread,), (far,) = MadeUp().answer(motion, features(view))
        if far:
            continue
        best[motion] = max(best.get(motion, 0.0), p - spread)
        captures += p >= 0.5
    fails = 1.0
    for p in best.values():
        fails *= 1.0 - p
    return 1.0 - fails, 1.0 - np.exp(-0.1 * captures)


@pytest.mark.parametrize("contact", FEET, ids=["left", "right"])
@pytest.mark.parametrize("model", ["motions", "poses"])
def test_rejection_is_what_plain_loops_over_all_poses_say(contact: Contact, model: CaptureModel) -> None:
    odds, foot = made(MadeUp(), contact, model)
    com, velocity = states(12)
    found = odds.rejection(foot, com, velocity)
    twin = np.array([by_loops(odds, foot, r, v) for r, v in zip(com, velocity, strict=True)])
    np.testing.assert_allclose(found, twin[:, 0 if model == "motions" else 1], atol=1e-5)
    assert len(np.unique(found)) > 3 and (found < 0.99).any()


def test_all_four_motions_are_offered_beside_a_wall() -> None:
    odds, foot = made(MadeUp(), FEET[0])
    asked = {motion_of(question) for question in questions(odds, foot, np.array([0.0, 0.1, 0.9]), np.zeros(3))}
    assert asked >= {0, 1, 2}
    odds, foot = made(MadeUp(), FEET[1])
    assert {motion_of(question) for question in questions(odds, foot, np.array([0.0, 0.1, 0.9]), np.zeros(3))} >= {0, 3}


@pytest.mark.parametrize("model", ["motions", "poses"])
def test_what_lies_outside_the_training_data_does_not_count_as_captured(model: CaptureModel) -> None:
    odds, foot = made(MadeUp(far=-10.0), FEET[0], model)
    com, velocity = states(5)
    np.testing.assert_array_equal(odds.rejection(foot, com, velocity), 0.0)
    assert odds.asked["far"] == odds.asked["all"] == 5 * (1 + len(odds.poses.about(foot).numbers))


@pytest.mark.parametrize("model", ["motions", "poses"])
def test_a_batch_too_large_for_one_question_says_what_its_states_say_alone(
    model: CaptureModel, monkeypatch: pytest.MonkeyPatch
) -> None:
    networks = MadeUp()
    odds, foot = made(networks, FEET[1], model)
    com, velocity = states(40)
    poses = len(odds.poses.about(foot).numbers)
    assert 40 * poses > capture_odds.MOST_ROWS
    found = odds.rejection(foot, com, velocity)
    assert max(networks.rows) <= capture_odds.MOST_ROWS
    alone = [odds.rejection(foot, com[k : k + 1], velocity[k : k + 1])[0] for k in range(40)]
    np.testing.assert_allclose(found, alone, rtol=1e-12)
    monkeypatch.setattr(capture_odds, "MOST_ROWS", 1)  # fewer than there are poses: state by state
    np.testing.assert_allclose(odds.rejection(foot, com, velocity), found, rtol=1e-12)


def test_no_states_have_no_answers() -> None:
    odds, foot = made(MadeUp(), FEET[0])
    assert odds.rejection(foot, np.zeros((0, 3)), np.zeros((0, 3))).shape == (0,)


@given(
    st.floats(-0.2, 0.3), st.floats(0.0, 0.4), st.floats(-1, 1), st.floats(-1, 1), st.sampled_from(["motions", "poses"])
)
def test_rejection_is_a_probability(x: float, y: float, vx: float, vy: float, model: CaptureModel) -> None:
    odds, foot = made(MadeUp(), FEET[0], model)
    (p,) = odds.rejection(foot, np.array([[x, y, 0.9]]), np.array([[vx, vy, 0.0]]))
    assert 0.0 <= p <= 1.0


def test_documented_networks_get_the_documented_inputs() -> None:
    networks = MadeUp(kind="documented")
    odds, foot = made(networks, FEET[0])
    com, velocity = states(2)
    odds.rejection(foot, com, velocity)
    for motion, inputs in enumerate(networks.inputs):
        wanted = [
            documented_features(view_of(question, ROBOT.mass))
            for r, v in zip(com, velocity, strict=True)
            for question in questions(odds, foot, r, v)
            if motion_of(question) == motion
        ]
        np.testing.assert_allclose(inputs, np.concatenate(wanted), atol=1e-6)
    assert {inputs.shape[1] for inputs in networks.inputs} == {12, 18}


@pytest.mark.parametrize("contact", FEET, ids=["left", "right"])
def test_the_likeliest_contacts_come_first_each_with_its_own_probability(contact: Contact) -> None:
    odds, foot = made(MadeUp(), contact)
    (com,), (velocity,) = states(1)
    numbers, likely = odds.likeliest(foot, com, velocity)
    assert (np.diff(likely) <= 0).all()
    assert sorted(numbers.tolist()) == sorted([-1, *odds.poses.about(foot).numbers.tolist()])
    own = dict(zip(numbers.tolist(), likely.tolist(), strict=True))
    asked = questions(odds, foot, com, velocity)
    for number, question in zip((-1, *odds.poses.about(foot).numbers.tolist()), asked, strict=True):
        (p,), _, _ = MadeUp().answer(motion_of(question), features(view_of(question, ROBOT.mass)))
        assert own[number] == pytest.approx(p, abs=1e-6)


def test_a_mirrored_question_has_the_same_answer() -> None:
    """On a floor that is its own mirror image the right foot is asked about as the left one is."""
    packed = pack_terrain(Terrain((level_plate("floor", (-2.0, 2.0), (-2.0, 2.0)),)))
    com, velocity = states(6)
    said = []
    for name, sign in (("left_foot", 1.0), ("right_foot", -1.0)):
        pool = ContactPool(packed)
        odds = CaptureOdds(MadeUp(), CapturePoses(packed, ROBOT, pool))  # type: ignore[arg-type]
        foot = pool.add_contact(Contact(name, 0, contact_pose(name, np.array([0.0, sign * 0.1, 0.0]), UP, 0.0), 0.5))
        assert (pool.effector[foot] == LEFT_FOOT) == (sign > 0)
        said.append(odds.rejection(foot, com * [1.0, sign, 1.0], velocity * [1.0, sign, 1.0]))
    np.testing.assert_allclose(*said, atol=1e-6)


def test_ground_more_slippery_than_the_training_data_is_refused() -> None:
    odds, _ = made(MadeUp(friction=0.5), FEET[0])
    for fine in (np.array([0.5, 0.9]), np.array([0.5 - 1e-9]), np.zeros(0)):
        odds.require_friction(fine)
    with pytest.raises(WeightsError, match=r"0\.5 and above, a surface has 0\.4"):
        odds.require_friction(np.array([0.9, 0.4, 0.6]))
