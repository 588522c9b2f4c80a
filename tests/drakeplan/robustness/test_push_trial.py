"""Pushes tried on a robot by the exact question: what stands, what one contact catches, what falls, and what is tried first."""

from __future__ import annotations

import numpy as np
import pytest

from drakeplan.plan.plan import Plan
from drakeplan.robustness import push_trial
from drakeplan.robustness.moments import Moment, moments_of
from drakeplan.robustness.push_trial import APART, CATCHES, FALLS, STANDS, PushTrials
from learning.weights import NoWeightsError, WeightsError
from optimization.balance.friction import FrictionCone
from optimization.capture.inverted_pendulum import capture_point
from scenes.contact import Contact
from scenes.files.scene_file import scene_from_yaml
from scenes.robots.robot import load_robot
from scenes.terrain.packed_terrain import PackedTerrain, pack_terrain

ROBOT = load_robot("escher")
LEFT_PUSH, RIGHT_PUSH = np.array([0.0, 30.0, 0.0]), np.array([0.0, -30.0, 0.0])
LAST_SWING = 7.5  # [s] the right foot of the stepping plan is in the air, its left palm off the wall


@pytest.fixture(scope="module")
def packed(stepping_plan: Plan) -> PackedTerrain:
    scene = scene_from_yaml(stepping_plan.scene_yaml, "the plan", mesh_triangles=stepping_plan.triangles)
    return pack_terrain(scene.terrain)


@pytest.fixture(scope="module")
def trials(packed: PackedTerrain) -> PushTrials:
    return PushTrials(packed, ROBOT, FrictionCone.INNER)


@pytest.fixture(scope="module")
def moments(stepping_plan: Plan) -> list[Moment]:
    return moments_of(stepping_plan)


@pytest.fixture(scope="module")
def resting(moments: list[Moment]) -> Moment:
    """At rest on two feet."""
    assert not moments[0].swing and not moments[0].linear_momentum.any()
    return moments[0]


@pytest.fixture(scope="module")
def swinging(moments: list[Moment]) -> Moment:
    moment = moments[round(LAST_SWING / 0.1)]
    assert [c is not None for c in moment.stance.contacts] == [True, False, False, False]
    return moment


def apart(a: Contact, b: Contact) -> float:
    return float(np.linalg.norm(a.p_WC - b.p_WC))


# ---- what comes of a push


def test_a_robot_at_rest_on_two_feet_stands_a_touch(trials: PushTrials, resting: Moment) -> None:
    for touch in ([0.0, 0.0, 0.0], [0.5, 0.0, 0.0], [0.0, -1.0, 0.0]):
        trial = trials.ask(resting, np.array(touch))
        assert (trial.captured, trial.contact, trial.asked, trial.reason) == (STANDS, None, 1, "")


def test_a_push_that_makes_it_leave_at_running_speed_fells_it(packed: PackedTerrain, resting: Moment) -> None:
    trials = PushTrials(packed, ROBOT, FrictionCone.INNER, samples=2)
    trial = trials.ask(resting, ROBOT.mass * np.array([0.0, 3.0, 0.0]))
    assert (trial.captured, trial.contact) == (FALLS, None)
    assert trial.asked == 1 + 2
    assert trial.reason


def test_a_push_aside_in_a_swing_is_caught_by_one_step(trials: PushTrials, swinging: Moment) -> None:
    """The left foot stands, the push is to the right, where the other foot may go."""
    trial = trials.ask(swinging, RIGHT_PUSH)
    assert trial.captured == CATCHES and trial.contact is not None
    assert trial.contact.effector == "right_foot"
    assert trial.contact.p_WC[1] < swinging.stance.held[0].p_WC[1]
    assert trial.contact in trials.candidates(swinging, RIGHT_PUSH)
    assert 2 <= trial.asked <= 1 + trials.samples and trial.reason == ""


def test_without_more_contacts_to_try_what_one_step_catches_falls(packed: PackedTerrain, swinging: Moment) -> None:
    trial = PushTrials(packed, ROBOT, FrictionCone.INNER, samples=0).ask(swinging, RIGHT_PUSH)
    assert (trial.captured, trial.asked) == (FALLS, 1)


def test_trials_do_not_depend_on_what_was_tried_before(
    packed: PackedTerrain, trials: PushTrials, resting: Moment, swinging: Moment
) -> None:
    first = trials.ask(swinging, RIGHT_PUSH)
    trials.ask(resting, LEFT_PUSH)
    again = trials.ask(swinging, RIGHT_PUSH)
    fresh = PushTrials(packed, ROBOT, FrictionCone.INNER).ask(swinging, RIGHT_PUSH)
    for other in (again, fresh):
        assert (other.captured, other.asked, other.contact) == (first.captured, first.asked, first.contact)


# ---- what is tried


@pytest.mark.parametrize("samples", [0, 1, 10, 1000])
def test_candidates_lie_apart_from_each_other_and_from_what_is_held(
    packed: PackedTerrain, moments: list[Moment], samples: int
) -> None:
    trials = PushTrials(packed, ROBOT, FrictionCone.INNER, samples=samples)
    for moment in moments[::12]:
        chosen = trials.candidates(moment, LEFT_PUSH)
        assert len(chosen) <= samples
        assert samples > 10 or len(chosen) == samples, "there are more than that"
        for k, contact in enumerate(chosen):
            for other in (*chosen[:k], *moment.stance.held):
                assert other.effector != contact.effector or apart(contact, other) >= APART


def test_fewer_samples_are_the_first_of_more(packed: PackedTerrain, swinging: Moment) -> None:
    few, many = (
        PushTrials(packed, ROBOT, FrictionCone.INNER, samples=n).candidates(swinging, RIGHT_PUSH) for n in (3, 8)
    )
    assert many[:3] == few and len(many) == 8


def test_only_feet_are_tried_where_palms_may_not_catch_the_robot(packed: PackedTerrain, swinging: Moment) -> None:
    tried = {}
    for palms in (True, False):
        trials = PushTrials(packed, ROBOT, FrictionCone.INNER, samples=1000, palms=palms)
        tried[palms] = {c.effector for c in trials.candidates(swinging, LEFT_PUSH)}
    assert tried == {True: {"right_foot", "left_palm"}, False: {"right_foot"}}


def test_on_two_feet_either_may_be_lifted(packed: PackedTerrain, resting: Moment) -> None:
    trials = PushTrials(packed, ROBOT, FrictionCone.INNER, samples=1000, palms=False)
    assert {c.effector for c in trials.candidates(resting, LEFT_PUSH)} == {"left_foot", "right_foot"}


# ---- without networks


def no_weights(*_: object) -> None:
    raise NoWeightsError("no such file")


def test_without_networks_the_note_says_so_and_poses_near_the_capture_point_come_first(
    packed: PackedTerrain, swinging: Moment, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(push_trial, "load_capture", no_weights)
    trials = PushTrials(packed, ROBOT, FrictionCone.INNER, samples=12, palms=False)
    assert "no learned capture" in trials.note and "'escher'" in trials.note
    point = capture_point(swinging.com, (swinging.linear_momentum + RIGHT_PUSH) / ROBOT.mass)
    distance = [np.linalg.norm(c.p_WC[:2] - point) for c in trials.candidates(swinging, RIGHT_PUSH)]
    assert len(distance) == 12
    assert distance == sorted(distance) and distance[0] < 0.1 < distance[-1]


def test_without_networks_a_step_still_catches_the_robot(
    packed: PackedTerrain, swinging: Moment, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(push_trial, "load_capture", no_weights)
    trials = PushTrials(packed, ROBOT, FrictionCone.INNER, palms=False)
    assert trials.ask(swinging, RIGHT_PUSH).captured == CATCHES


def test_damaged_networks_are_not_passed_over(packed: PackedTerrain, monkeypatch: pytest.MonkeyPatch) -> None:
    def damaged(*_: object) -> None:
        raise WeightsError("incomplete weights of capture")

    monkeypatch.setattr(push_trial, "load_capture", damaged)
    with pytest.raises(WeightsError, match="incomplete"):
        PushTrials(packed, ROBOT, FrictionCone.INNER)


def test_with_networks_there_is_no_note(trials: PushTrials) -> None:
    assert trials.note == ""
