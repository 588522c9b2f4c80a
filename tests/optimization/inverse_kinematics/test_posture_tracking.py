"""Posture tracking: contacts and CoM are met, what is free stays at the reference, distances are inequalities."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from optimization.inverse_kinematics.frame_task import DistanceRows, TrackingTargets, frame_targets
from optimization.inverse_kinematics.posture_tracking import track_postures
from optimization.multibody.kinematic_tree import integrate
from optimization.multibody.kinematics import Kinematics
from scenes.robots.plant import build_plant, nominal_posture
from scenes.robots.robot import load_robot

ROBOT = load_robot("escher")
KINEMATICS = Kinematics.from_plant(build_plant(ROBOT).plant, [e.frame for e in ROBOT.effectors])
TREE = KINEMATICS.tree
NV = 6 + len(TREE.lower)
WORLD = -1
COM_PULL = 2e-3  # [m] what the posture's weight takes from the CoM's, here 8 cm from its reference


def targets(frames: int = 1, com_shift: tuple[float, float, float] = (0.0, 0.0, -0.05)) -> TrackingTargets:
    """Both feet held where the nominal posture has them, the CoM moved, everything else free."""
    q = np.array(nominal_posture(ROBOT))
    hold = np.tile([300.0, 300.0, 0.0, 0.0], (frames, 1))
    return TrackingTargets(
        X_WE=np.tile(KINEMATICS.effector_poses(q), (frames, 1, 1, 1)),
        place_weight=hold,
        turn_weight=0.3 * hold,
        com=np.tile(KINEMATICS.com(q) + com_shift, (frames, 1)),
        com_weight=np.full((frames, 3), 10.0),
        q_ref=np.tile(q, (frames, 1)),
        posture_weight=np.concatenate([np.full(3, 0.5), np.zeros(3), np.full(NV - 6, 0.1)]),
        lower=TREE.lower,
        upper=TREE.upper,
    )


def solve(wanted: TrackingTargets, q: np.ndarray | None = None) -> np.ndarray:
    start = wanted.q_ref if q is None else q[None]
    return track_postures(TREE, wanted, start, chained=False, max_iterations=60).q[0]


def cost(wanted: TrackingTargets, q: np.ndarray) -> float:
    """The objective of the module's docstring, written down once more from the kinematics that Drake agrees with."""
    total = 0.0
    X = KINEMATICS.effector_poses(q)
    for e in range(4):
        R = wanted.X_WE[0, e, :3, :3] @ X[e, :3, :3].T
        angle = np.arccos(np.clip((np.trace(R) - 1) / 2, -1, 1))
        away = X[e, :3, 3] - wanted.X_WE[0, e, :3, 3]
        total += wanted.place_weight[0, e] ** 2 * away @ away + wanted.turn_weight[0, e] ** 2 * angle**2
    total += float(((wanted.com_weight[0] * (KINEMATICS.com(q) - wanted.com[0])) ** 2).sum())
    d = np.zeros(NV)
    d[6:] = q[7:] - wanted.q_ref[0, 7:]
    w = np.abs(q[:4] @ wanted.q_ref[0, :4])
    return total + float(((wanted.posture_weight * d) ** 2).sum()) + 0.5**2 * (2 * np.arccos(min(w, 1.0))) ** 2


def test_feet_stay_and_the_com_goes_where_it_is_wanted():
    wanted = targets(com_shift=(0.02, 0.03, -0.08))
    answer = track_postures(TREE, wanted, wanted.q_ref, max_iterations=60)
    X = KINEMATICS.effector_poses(answer.q[0])
    assert np.allclose(X[:2], wanted.X_WE[0, :2], atol=1e-5)
    assert np.allclose(KINEMATICS.com(answer.q[0]), wanted.com[0], atol=COM_PULL)
    assert answer.effector_error.max() < 1e-5
    assert np.abs(answer.com_error).max() < COM_PULL


def test_nothing_moves_where_the_reference_already_does_what_is_wanted():
    wanted = targets(com_shift=(0.0, 0.0, 0.0))
    assert np.allclose(solve(wanted), nominal_posture(ROBOT), atol=1e-6)


def test_the_answer_is_a_minimum_of_the_cost():
    wanted = targets(com_shift=(0.01, 0.02, -0.06))
    q = solve(wanted)
    base, step = cost(wanted, q), 2e-3
    for i in range(NV):
        for sign in (1.0, -1.0):
            v, moved = np.zeros(NV), np.empty_like(q)
            v[i] = sign * step
            integrate(q, v, 1.0, moved)
            if i < 6 or TREE.lower[i - 6] <= moved[i + 1] <= TREE.upper[i - 6]:
                assert cost(wanted, moved) > base - 1e-7


def test_the_answer_does_not_depend_on_where_the_search_starts():
    wanted = targets(com_shift=(0.0, 0.03, -0.07))
    rng = np.random.default_rng(0)
    first = solve(wanted)
    for _ in range(5):
        start = np.array(nominal_posture(ROBOT))
        start[7:] = np.clip(start[7:] + rng.uniform(-0.15, 0.15, NV - 6), TREE.lower, TREE.upper)
        assert np.allclose(solve(wanted, start), first, atol=1e-3)


def test_joint_limits_hold_even_where_the_targets_ask_for_more():
    wanted = targets(com_shift=(0.0, 0.0, 0.3))
    q = solve(wanted)
    assert (q[7:] >= TREE.lower - 1e-12).all()
    assert (q[7:] <= TREE.upper + 1e-12).all()
    assert KINEMATICS.com(q)[2] < wanted.com[0, 2] - 0.1


def hand_over_plane(wanted: float) -> DistanceRows:
    """The left palm keeps this height [m] over the ground."""
    link, point = int(TREE.frame_link[2]), TREE.p_LE[2]
    return DistanceRows(
        np.array([0, 1]), np.array([[link, WORLD]]), np.array([[point, np.zeros(3)]]), np.array([[0.0, 0.0, 1.0]]),
        np.array([wanted]), np.array([30.0]),
    )  # fmt: skip


def test_a_distance_moves_a_body_only_when_it_is_too_near():
    free = targets(com_shift=(0.0, 0.0, 0.0))
    height = KINEMATICS.effector_poses(np.array(nominal_posture(ROBOT)))[2, 2, 3]
    enough = solve(replace(free, rows=hand_over_plane(height - 0.05)))
    assert np.allclose(enough, nominal_posture(ROBOT), atol=1e-6)
    raised = solve(replace(free, rows=hand_over_plane(height + 0.10)))
    assert KINEMATICS.effector_poses(raised)[2, 2, 3] == pytest.approx(height + 0.10, abs=2e-3)


def test_frames_are_solved_alone_and_those_left_out_keep_their_posture():
    wanted = targets(frames=3, com_shift=(0.0, 0.02, -0.05))
    only = track_postures(TREE, wanted, wanted.q_ref, solve=np.array([False, True, False]), max_iterations=60)
    assert np.array_equal(only.q[[0, 2]], wanted.q_ref[[0, 2]])
    assert only.iterations.tolist()[::2] == [0, 0]
    alone = track_postures(TREE, frame_targets(wanted, 1), wanted.q_ref[1:2], max_iterations=60)
    assert np.allclose(only.q[1], alone.q[0], atol=1e-9)


def test_no_start_ends_worse_than_it_began_and_a_stretched_arm_reaches_what_it_can():
    """Undamped steps go to and fro where a limb is nearly straight."""
    rng = np.random.default_rng(5)
    arm = [KINEMATICS.joint_names.index(name) for name in ("left_shoulder_pitch", "left_shoulder_roll", "left_elbow")]
    reached = []
    for _ in range(12):
        q = np.array(nominal_posture(ROBOT))
        q[7 + np.array(arm)] = rng.uniform(-1.2, 0.3), rng.uniform(0.2, 1.6), -0.05
        wanted = targets(com_shift=(*rng.uniform(-0.02, 0.02, 2), -0.01))
        wanted.X_WE[0, 2], wanted.place_weight[0, 2], wanted.turn_weight[0, 2] = (
            KINEMATICS.effector_poses(q)[2],
            300,
            90,
        )
        start = np.array(nominal_posture(ROBOT))
        start[7:] = np.clip(start[7:] + rng.uniform(-0.5, 0.5, NV - 6), TREE.lower, TREE.upper)
        answer = track_postures(TREE, wanted, start[None], chained=False, max_iterations=60)
        assert cost(wanted, answer.q[0]) <= cost(wanted, start) + 1e-9
        reached.append(answer.effector_error.max() < 5e-3)
    assert np.mean(reached) > 0.8
