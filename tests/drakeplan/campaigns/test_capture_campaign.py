"""Labels of capture say what the checker says again, the same each time; labels of walking know their lift."""

from __future__ import annotations

import pickle
from collections import Counter
from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import pytest

from drakeplan.campaigns import capture, dynamics
from drakeplan.campaigns.campaign import rows_table
from drakeplan.campaigns.capture import FAST_PUSH, SPIN, CaptureCampaign, counts_text
from drakeplan.campaigns.card import Card
from drakeplan.campaigns.dynamics import DynamicsCampaign
from drakeplan.timing.step_timing import WALKING
from learning.capture_labels import SCHEMA
from learning.capture_view import FOOT, NUM_MOTIONS, SAME_PALM, STAY
from learning.transition_labels import SCHEMA as TRANSITIONS
from optimization.balance.friction import DEFAULT_CONE
from optimization.capture.checker import CaptureChecker, capture_options
from optimization.capture.question import CaptureQuestion
from optimization.capture.sampling import (
    CAPTURE_MOTIONS,
    COM_BACK,
    COM_IN,
    COM_OUT,
    MAX_CLIMB,
    MAX_SPEED,
    MAX_TILT,
)
from optimization.centroidal.transition_dynamics import TransitionDynamics
from scenes.contact import Contact, contact_heading
from scenes.effector import EFFECTORS, LEFT_FOOT, LEFT_PALM, RIGHT_FOOT, RIGHT_PALM
from scenes.robots.robot import load_robot
from scenes.stance import Stance

ESCHER = load_robot("escher")
CAMPAIGN = CaptureCampaign()
PER_MOTION, TASKS = 4, 3
STEPS = DynamicsCampaign(timing=WALKING, feet_only=True)


def seed(k: int) -> np.random.SeedSequence:
    return np.random.SeedSequence(5, spawn_key=(0, k))


@pytest.fixture(scope="module", autouse=True)
def small() -> Iterator[None]:
    """Fewer questions and steps in a task."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(capture, "PER_MOTION", PER_MOTION)
        patch.setattr(dynamics, "FEET_ONLY", 10)
        yield


@pytest.fixture(scope="module")
def rows(small) -> list[dict[str, object]]:
    return [dict(row) for k in range(TASKS) for row in CAMPAIGN.rows(seed(k), k)]


@pytest.fixture(scope="module")
def columns(rows) -> dict[str, np.ndarray]:
    return {name: np.array([row[name] for row in rows]) for name in SCHEMA.names}


def contact(e: int, p: object, R: object, friction: object) -> Contact:
    X_WC = np.eye(4)
    X_WC[:3, :3], X_WC[:3, 3] = np.reshape(R, (3, 3)), p
    return Contact(EFFECTORS[e], 0, X_WC, float(friction), contact_heading(X_WC))


def question(row: dict[str, object]) -> CaptureQuestion:
    """A row alone, with the left foot at the origin."""
    motion, momentum = row["motion"], ESCHER.mass * np.asarray(row["velocity"])
    mover = {FOOT: RIGHT_FOOT, SAME_PALM: LEFT_PALM}.get(motion, RIGHT_PALM)
    new = None if motion == STAY else contact(mover, row["p_new"], row["R_new"], row["friction"])
    stance = Stance((contact(LEFT_FOOT, np.zeros(3), row["foot_R"], row["friction"]), None, None, None))
    return CaptureQuestion(stance, row["com"], momentum, ESCHER.mass * np.asarray(row["spin"]), new)


def test_rows_fit_the_schema_and_ask_as_much_of_each_motion(rows, columns) -> None:
    assert rows_table(SCHEMA, rows).num_rows == len(rows)  # raises where a column is missing, null or not finite
    counts = Counter((row["scene"], row["source"], row["motion"]) for row in rows)
    for scene in range(TASKS):
        for motion in range(NUM_MOTIONS):
            assert counts[scene, "random", motion] == PER_MOTION // 2
            assert counts[scene, "walk", motion] <= PER_MOTION // 2
    for name in ("captured", "mirrored"):
        assert {*columns[name]} == {True, False}
    assert (columns["source"] == "walk").sum() > len(rows) // 3
    assert (columns["friction"] == CAMPAIGN.friction).all()


def test_the_checker_says_again_what_a_row_says(rows) -> None:
    checker = CaptureChecker(ESCHER, capture_options(ESCHER, CAMPAIGN.cone))
    for row in rows[::7]:
        answer = checker.check(question(row))
        assert answer.captured == row["captured"]
        assert (-1.0 if answer.duration is None else answer.duration) == row["swing_time"]


def test_the_rows_of_a_task_do_not_depend_on_what_ran_before(rows) -> None:
    again = rows_table(SCHEMA, CAMPAIGN.rows(seed(1), 1)).to_pydict()
    ours = rows_table(SCHEMA, [row for row in rows if row["scene"] == 1]).to_pydict()
    assert pickle.dumps(again) == pickle.dumps(ours)
    other = CAMPAIGN.rows(np.random.SeedSequence(6, spawn_key=(0, 1)), 1)
    assert not {tuple(row["com"]) for row in other} & {tuple(row["com"]) for row in rows}


def test_answers_fit_their_motions(rows) -> None:
    times = capture_options(ESCHER).swing_times
    for row in rows:
        assert (row["reason"] == "") == row["captured"]
        allowed = (-1.0,) if not row["captured"] else (0.0,) if row["motion"] == STAY else times
        assert row["swing_time"] in allowed


def test_random_questions_keep_to_the_documents_intervals(columns) -> None:
    drawn = columns["source"] == "random"
    com, velocity, spin = (columns[name][drawn] for name in ("com", "velocity", "spin"))
    speed = np.linalg.norm(velocity, axis=1)
    assert (speed <= MAX_SPEED).all() and (np.abs(velocity[:, 2]) <= np.sin(MAX_CLIMB) * speed + 1e-12).all()
    assert (np.abs(spin) <= SPIN / ESCHER.mass).all()
    assert 0 < (spin == 0).all(axis=1).sum() < drawn.sum(), "some of them spin"
    assert (com[:, 0] >= COM_BACK).all() and (com[:, 0] <= -COM_BACK).all()
    assert (com[:, 1] >= -COM_IN).all() and (com[:, 1] <= -COM_OUT).all(), "from the left foot inwards is -y"
    assert (columns["foot_R"][:, 8] >= np.cos(MAX_TILT) - 1e-9).all()


def test_pushed_walks_move_no_faster_than_a_walk_and_a_push(columns) -> None:
    walked = columns["source"] == "walk"
    assert (np.linalg.norm(columns["velocity"][walked], axis=1) < FAST_PUSH + 0.6).all()
    level = np.hypot(*columns["com"][walked, :2].T)
    assert (level < 0.4).all() and (np.abs(columns["com"][walked, 2] - ESCHER.com_height[1]) < 0.25).all()


def test_new_contacts_lie_on_the_side_of_their_effector(columns) -> None:
    motion, p = columns["motion"], columns["p_new"]
    stays = motion == STAY
    assert not p[stays].any() and (columns["R_new"][stays] == np.eye(3).ravel()).all()
    assert (p[motion == FOOT, 1] < 0).all(), "the other foot is on the right"
    reaches_out = {CAPTURE_MOTIONS[k]: p[motion == k, 1] for k in range(2, 4)}
    assert (reaches_out["same_palm"] > 0.1).all() and (reaches_out["opposite_palm"] < -0.2).all()
    towards = columns["R_new"].reshape(-1, 3, 3)[:, 1, 2]  # of the walls' normals along y
    assert (towards[motion == 2] < 0).all() and (towards[motion == 3] > 0).all()


def test_every_contact_has_the_friction_of_the_campaign() -> None:
    campaign = replace(CAMPAIGN, friction=0.8)
    asked = list(campaign._random_questions(np.random.default_rng(0), ESCHER))
    assert {c.friction for _, question in asked for c in question.final_stance.held} == {0.8}


def test_walked_questions_have_the_friction_of_the_campaign() -> None:
    campaign = replace(CAMPAIGN, friction=0.8)
    asked = [question for _, question in campaign._walked_questions(np.random.default_rng(0), ESCHER)]
    assert asked and {c.friction for question in asked for c in question.final_stance.held} == {0.8}


def test_parameters_name_all_that_labels_depend_on() -> None:
    base = CAMPAIGN.parameters
    for other in (
        replace(CAMPAIGN, friction=0.6),
        replace(CAMPAIGN, cone="square"),
        replace(CAMPAIGN, walk=replace(CAMPAIGN.walk, quota=3)),
    ):
        assert other.parameters != base
    assert base["robot_model_sha256"] == ESCHER.model_sha256 and base["per_motion"] == PER_MOTION
    assert base["timing"] == [0.6, 0.4]


def test_the_table_of_counts_adds_up() -> None:
    counts = (
        {"motion": 0, "source": "random", "captured": True, "rows": 30},
        {"motion": 0, "source": "walk", "captured": False, "rows": 10},
        {"motion": 2, "source": "walk", "captured": True, "rows": 5},
    )
    lines = counts_text(Card("capture", 1, 0, {}, "", 1, 45, counts, (), (), "", ())).splitlines()
    assert lines[0].split() == ["motion", "labels", "captured", "random", "walk"]
    said = {line.split()[0]: line.split()[1:] for line in lines[1:]}
    assert tuple(said) == CAPTURE_MOTIONS
    assert said["stay"] == ["40", "75.0", "%", "30", "10"] and said["same_palm"] == ["5", "100.0", "%", "0", "5"]
    assert said["foot"] == ["0", "0.0", "%", "0", "0"]


# ---- steps for walking


@pytest.fixture(scope="module")
def steps(small) -> list[dict[str, object]]:
    return [dict(row) for k in range(2) for row in STEPS.rows(seed(k), k)]


def estimate_of(row: dict[str, object], program: TransitionDynamics):
    p, R = np.reshape(row["p"], (4, 3)), np.reshape(row["R"], (4, 9))
    held = [contact(e, p[e], R[e], row["friction"][e]) if row["held"][e] else None for e in range(4)]
    before = Stance(tuple(held))
    after = before.replace(row["mover"], contact(row["mover"], row["p_new"], row["R_new"], row["friction_new"]))
    return program.estimate(before, after, row["com"], ESCHER.mass * np.asarray(row["velocity"]))


def test_steps_without_palms_are_steps_of_feet_alone(steps) -> None:
    rows_table(TRANSITIONS, steps)
    assert Counter(row["scene"] for row in steps) == {0: 10, 1: 10}
    for row in steps:
        assert row["category"] == 0 and row["makes"] and row["mover"] in (LEFT_FOOT, RIGHT_FOOT)
        assert list(row["held"]) == [True, True, False, False]
    assert {row["feasible"] for row in steps} == {True, False} and {row["mover"] for row in steps} == {0, 1}


def test_states_at_lift_lie_on_the_trajectory_at_the_end_of_the_shift(steps) -> None:
    program = TransitionDynamics(ESCHER, replace(WALKING.options(ESCHER, DEFAULT_CONE), time_limit=1e6))
    seen = 0
    for row in steps[::2]:
        found = estimate_of(row, program)
        assert found.feasible == row["feasible"]
        assert (row["lift_com"] is None) == (row["lift_velocity"] is None) == (found.trajectory is None)
        if not found.feasible:
            continue
        t, trajectory, seen = found.trajectory.t, found.trajectory, seen + 1
        (n,) = np.flatnonzero(np.isclose(t, WALKING.shift))
        mover_holds = (trajectory.contact[:, row["mover"]] >= 0)[: n + 1]
        assert mover_holds[:n].all() and not mover_holds[n], "there it lifts"
        np.testing.assert_allclose(row["lift_com"], trajectory.com[n], atol=1e-6)
        np.testing.assert_allclose(row["lift_velocity"], trajectory.linear_momentum[n] / ESCHER.mass, atol=1e-6)
        com, velocity = program.lift_state(found)
        np.testing.assert_allclose(com, row["lift_com"], atol=1e-6)
        np.testing.assert_allclose(velocity, row["lift_velocity"], atol=1e-6)
        assert not np.allclose(row["lift_com"], row["final_com"], atol=1e-4)
    assert seen >= 4


def hermite(s: float, T: float, r0: np.ndarray, v0: np.ndarray, r1: np.ndarray, v1: np.ndarray) -> np.ndarray:
    """The cubic through two states, at the share s of the time T between them."""
    return (
        r0 * (1 + 2 * s) * (1 - s) ** 2 + v0 * T * s * (1 - s) ** 2 + r1 * s**2 * (3 - 2 * s) - v1 * T * s**2 * (1 - s)
    )


def test_the_state_at_lift_brings_a_cubic_nearer_to_the_com_in_the_swing_than_both_ends_alone(steps) -> None:
    program, off = TransitionDynamics(ESCHER, replace(WALKING.options(ESCHER, DEFAULT_CONE), time_limit=1e6)), []
    for row in [row for row in steps if row["feasible"]]:
        trajectory = estimate_of(row, program).trajectory
        whole, t = (
            trajectory.t[-1],
            0.8,
        )  # [s] in the middle of the swing; at the end the foot has carried load for a knot
        assert whole == pytest.approx(WALKING.shift + WALKING.swing + WALKING.step)
        (com,) = trajectory.com[np.isclose(trajectory.t, t)]
        start, lift, end = (
            [np.asarray(row[f"{w}com"]), np.asarray(row[f"{w}velocity"])] for w in ("", "lift_", "final_")
        )
        swing = whole - WALKING.shift
        near = hermite((t - WALKING.shift) / swing, swing, *lift, *end)
        off.append([np.linalg.norm(near - com), np.linalg.norm(hermite(t / whole, whole, *start, *end) - com)])
    with_lift, without = np.mean(off, axis=0)
    assert with_lift < 0.03 and with_lift < 0.5 * without


def test_times_and_palms_are_among_the_parameters_and_change_nothing_where_they_are_the_documents() -> None:
    base = DynamicsCampaign().parameters
    assert "feet_only" not in base and base["program"]["shift_time"] == base["program"]["swing_time"] == 1.0
    timed, feet = DynamicsCampaign(timing=WALKING).parameters, DynamicsCampaign(feet_only=True).parameters
    assert (timed["program"]["shift_time"], timed["program"]["swing_time"]) == (0.6, 0.4)
    assert "feet_only" not in timed and feet["feet_only"] is True
    assert len({pickle.dumps(p) for p in (base, timed, feet, STEPS.parameters)}) == 4
    assert feet["program"] == base["program"] and feet["walk"] != base["walk"]
