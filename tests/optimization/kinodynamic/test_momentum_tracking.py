"""Whole motions: Drake's momenta, a slow twin of the cost, limits, fixed frames, and frames that nothing joins."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from optimization.inverse_kinematics.frame_task import DistanceRows, TrackingTargets, window_targets
from optimization.inverse_kinematics.posture_tracking import track_postures
from optimization.kinodynamic.measured_motion import motion_momentum, motion_poses
from optimization.kinodynamic.momentum_tracking import (
    ACCELERATION_WEIGHT,
    SPEED_WEIGHT,
    MomentumTargets,
    track_momentum,
)
from optimization.multibody.kinematics import Kinematics
from scenes.robots.plant import build_plant, nominal_posture
from scenes.robots.robot import load_robot

ROBOT = load_robot("escher")
PLANT = build_plant(ROBOT).plant
KINEMATICS = Kinematics.from_plant(PLANT, [e.frame for e in ROBOT.effectors])
TREE = KINEMATICS.tree
NV = 6 + len(TREE.lower)
Q = np.array(nominal_posture(ROBOT))
Q[7:] = np.clip(Q[7:], TREE.lower + 0.1, TREE.upper - 0.1)
STEP = 0.05
FRAMES = 12


def swaying(frames: int = FRAMES) -> TrackingTargets:
    """Both feet held, the CoM swaying from side to side."""
    t = STEP * np.arange(frames)
    com = KINEMATICS.com(Q) + np.stack([0.01 * np.sin(4 * t), 0.02 * (1 - np.cos(5 * t)), -0.02 * t], axis=1)
    hold = np.tile([300.0, 300.0, 0.0, 0.0], (frames, 1))
    return TrackingTargets(
        X_WE=np.tile(KINEMATICS.effector_poses(Q), (frames, 1, 1, 1)),
        place_weight=hold,
        turn_weight=0.3 * hold,
        com=com,
        com_weight=np.full((frames, 3), 10.0),
        q_ref=np.tile(Q, (frames, 1)),
        posture_weight=np.concatenate([np.full(3, 0.5), np.zeros(3), np.full(NV - 6, 0.1)]),
        lower=TREE.lower,
        upper=TREE.upper,
    )


def joined(frames: int = FRAMES, weight: float = 0.3, smooth: float = 1e-2) -> MomentumTargets:
    momentum = np.zeros((frames - 1, 6))
    momentum[:, 1] = 1.5 * np.sin(6 * STEP * np.arange(frames - 1))
    return MomentumTargets(
        dt=np.full(frames - 1, STEP),
        momentum=momentum,
        weight=np.tile([weight, weight, weight, 0.0, 0.0, 0.0], (frames - 1, 1)),
        smooth=np.full((frames, NV), smooth),
        speed=TREE.speed,
        v_start=np.zeros(NV),
        v_end=np.zeros(NV),
    )


def wandering(frames: int, seed: int, size: float = 0.02) -> np.ndarray:
    rng = np.random.default_rng(seed)
    q = [Q]
    for _ in range(frames - 1):
        q.append(KINEMATICS.integrate(q[-1], rng.uniform(-size, size, NV), 1.0))
    return np.array(q)


def cost(targets: TrackingTargets, links: MomentumTargets, q: np.ndarray) -> float:
    """The objective of the module's docstring, written down once more, slowly."""
    total, v = 0.0, []
    for t in range(len(q)):
        X = KINEMATICS.effector_poses(q[t])
        for e in range(4):
            R = targets.X_WE[t, e, :3, :3] @ X[e, :3, :3].T
            angle = np.arccos(np.clip((np.trace(R) - 1) / 2, -1, 1))
            away = X[e, :3, 3] - targets.X_WE[t, e, :3, 3]
            total += targets.place_weight[t, e] ** 2 * away @ away + targets.turn_weight[t, e] ** 2 * angle**2
        total += float(((targets.com_weight[t] * (KINEMATICS.com(q[t]) - targets.com[t])) ** 2).sum())
        total += float(((targets.posture_weight * KINEMATICS.difference(q[t], targets.q_ref[t])) ** 2).sum())
    for t in range(len(q) - 1):
        v.append(KINEMATICS.difference(q[t], q[t + 1]) / links.dt[t])
        A = 0.5 * (KINEMATICS.momentum_matrix(q[t]) + KINEMATICS.momentum_matrix(q[t + 1]))
        linear = TREE.total_mass * (KINEMATICS.com(q[t + 1]) - KINEMATICS.com(q[t])) / links.dt[t]
        h = np.concatenate([A[:3] @ v[-1], linear])
        total += float(((links.weight[t] * (h - links.momentum[t])) ** 2).sum())
        total += float(((SPEED_WEIGHT * np.maximum(np.abs(v[-1][6:]) - links.speed, 0.0)) ** 2).sum())
    for smooth, before, after in zip(links.smooth, [links.v_start, *v], [*v, links.v_end], strict=True):
        a = (after - before) / STEP
        total += float(((smooth * a) ** 2).sum())
        total += float(((ACCELERATION_WEIGHT * np.maximum(np.abs(a[6:]) - links.acceleration, 0.0)) ** 2).sum())
    return total


def test_momenta_are_drakes():
    q = wandering(6, seed=0, size=0.004)
    com, momentum = motion_momentum(TREE, q, np.full(5, 0.02))
    context = PLANT.CreateDefaultContext()
    for t in range(5):
        v = KINEMATICS.difference(q[t], q[t + 1]) / 0.02
        PLANT.SetPositions(context, KINEMATICS.integrate(q[t], v, 0.01))
        PLANT.SetVelocities(context, v)
        middle = PLANT.CalcCenterOfMassPositionInWorld(context)
        spatial = PLANT.CalcSpatialMomentumInWorldAboutPoint(context, middle)
        assert np.allclose(momentum[t, :3], spatial.rotational(), atol=5e-3)  # second order in the step
        assert np.allclose(momentum[t, 3:], spatial.translational(), atol=5e-3)
        assert np.allclose(com[t], KINEMATICS.com(q[t]), atol=1e-12)


def test_the_momentum_matrix_is_the_first_six_rows_of_drakes_mass_matrix():
    """Moved from the base's origin to the centre of mass."""
    context = PLANT.CreateDefaultContext()
    for q in wandering(5, seed=3, size=0.3):
        PLANT.SetPositions(context, q)
        M = PLANT.CalcMassMatrix(context)[:6]
        r = KINEMATICS.com(q) - q[4:7]
        shift = np.array([[0, -r[2], r[1]], [r[2], 0, -r[0]], [-r[1], r[0], 0]])
        A = KINEMATICS.momentum_matrix(q)
        assert np.allclose(A[3:], M[3:], atol=1e-9)
        assert np.allclose(A[:3], M[:3] - shift @ M[3:], atol=1e-9)


def test_poses_of_a_motion_are_those_of_its_frames():
    q = wandering(4, seed=1)
    X_WE, com = motion_poses(TREE, q)
    assert np.allclose(X_WE, [KINEMATICS.effector_poses(x) for x in q])
    assert np.allclose(com, [KINEMATICS.com(x) for x in q])


def test_the_reported_cost_is_the_objectives():
    targets, links, q = swaying(), joined(), wandering(FRAMES, seed=2)
    slow = replace(links, speed=np.full(NV - 6, 0.1))
    calm = replace(links, acceleration=3.0)
    for each in (links, slow, calm):
        reported = track_momentum(TREE, targets, each, q, max_iterations=0).cost
        assert reported == pytest.approx(cost(targets, each, np.clip(q, -9, 9)), rel=1e-6)


@pytest.mark.parametrize("acceleration", [np.inf, 1.0])
def test_no_small_change_lowers_the_cost(acceleration: float):
    targets, links = swaying(), replace(joined(), acceleration=acceleration)
    q = track_momentum(TREE, targets, links, targets.q_ref, max_iterations=60, tolerance=1e-9).q
    best, rng = cost(targets, links, q), np.random.default_rng(4)
    for _ in range(40):
        moved = q.copy()
        for t in range(1, FRAMES):
            change = 1e-3 * rng.normal(size=NV) * (rng.random(NV) < 0.2)
            moved[t] = KINEMATICS.integrate(q[t], change, 1.0)
            moved[t, 7:] = np.clip(moved[t, 7:], TREE.lower, TREE.upper)
        assert cost(targets, links, moved) > best * (1 - 1e-4)


def test_frames_that_nothing_joins_are_solved_as_if_each_were_alone():
    targets = swaying()
    alone = track_postures(TREE, targets, targets.q_ref, chained=False, max_iterations=60)
    links = replace(joined(weight=0.0, smooth=0.0), v_start=None, v_end=None)
    together = track_momentum(TREE, targets, links, targets.q_ref, max_iterations=60, tolerance=1e-9)
    assert np.allclose(together.q, alone.q, atol=2e-3)


def test_the_wanted_momentum_is_brought_about():
    targets, links = swaying(), joined(weight=3.0, smooth=1e-4)
    motion = track_momentum(TREE, targets, links, targets.q_ref, max_iterations=40)
    assert np.abs(motion.momentum[:, :3] - links.momentum[:, :3]).max() < 0.1
    assert motion.effector_error[:, :2].max() < 1e-3


def test_accelerations_grow_smaller_with_their_weight():
    targets = swaying()
    targets = replace(targets, com=targets.com + 0.01 * np.random.default_rng(0).normal(size=(FRAMES, 3)))
    jerky, calm = (
        track_momentum(TREE, targets, joined(weight=0.0, smooth=s), targets.q_ref, max_iterations=30).q
        for s in (1e-4, 1e-1)
    )
    assert np.abs(np.diff(calm[:, 7:], 2, axis=0)).max() < 0.3 * np.abs(np.diff(jerky[:, 7:], 2, axis=0)).max()


def test_fixed_frames_do_not_move():
    targets, fixed = swaying(), np.zeros(FRAMES, bool)
    fixed[[0, 5]] = True
    start = wandering(FRAMES, seed=5)
    motion = track_momentum(TREE, targets, replace(joined(), fixed=fixed), start)
    assert np.array_equal(motion.q[fixed], start[fixed])
    assert not np.allclose(motion.q[~fixed], start[~fixed])


def test_joint_and_speed_limits_are_kept():
    targets = swaying()
    targets = replace(targets, com=targets.com + np.linspace(0, 0.25, FRAMES)[:, None] * [0, 0, 1.0])
    links = replace(joined(), speed=np.full(NV - 6, 0.25))
    motion = track_momentum(TREE, targets, links, targets.q_ref, max_iterations=40)
    assert (motion.q[:, 7:] >= TREE.lower - 1e-12).all()
    assert (motion.q[:, 7:] <= TREE.upper + 1e-12).all()
    assert np.abs(np.diff(motion.q[:, 7:], axis=0)).max() / STEP < 0.25 * 1.1
    free = track_momentum(TREE, targets, joined(), targets.q_ref, max_iterations=40)
    assert np.abs(np.diff(free.q[:, 7:], axis=0)).max() / STEP > 0.5  # it would be faster


def test_accelerations_stay_near_their_limit_without_slowing_what_is_below_it():
    targets = swaying()
    targets = replace(targets, com=targets.com + np.where(np.arange(FRAMES) > 5, 0.02, 0.0)[:, None] * [0, 1.0, 0])

    def solved(acceleration: float, start: np.ndarray) -> tuple[np.ndarray, float]:
        links = replace(joined(weight=0.0, smooth=1e-3), acceleration=acceleration)
        q = track_momentum(TREE, targets, links, start, max_iterations=60, tolerance=1e-9).q
        v = np.vstack([np.zeros(NV - 6), np.diff(q[:, 7:], axis=0) / STEP, np.zeros(NV - 6)])
        return q, float(np.abs(np.diff(v, axis=0)).max() / STEP)

    free, hardest = solved(np.inf, targets.q_ref)
    assert solved(0.3 * hardest, free)[1] < 0.33 * hardest
    assert np.allclose(solved(2.0 * hardest, free)[0], free, atol=1e-5)


def test_a_window_lowers_the_cost_of_the_whole_and_finds_nothing_where_the_whole_is_solved():
    targets, links = swaying(), replace(joined(), acceleration=2.0)
    solved = track_momentum(TREE, targets, links, targets.q_ref, max_iterations=60, tolerance=1e-10).q
    best, guess = cost(targets, links, solved), wandering(FRAMES, seed=6)
    for first, last in ((0, 6), (3, 9), (5, FRAMES)):
        fixed = np.zeros(last - first, bool)
        fixed[:2], fixed[len(fixed) - 2 :] = first > 0, last < FRAMES
        for q in (solved, guess):
            part, joints = window_targets(targets, first, last), links.window(first, last, fixed)
            whole = q.copy()
            whole[first:last] = track_momentum(TREE, part, joints, q[first:last]).q
            after, before = cost(targets, links, whole), cost(targets, links, q)
            assert np.array_equal(whole[first:last][fixed], q[first:last][fixed])
            assert after <= before * (1 + 1e-9)
            assert after > best * (1 - 1e-3) if q is solved else after < 0.9 * before


def test_a_distance_is_kept_in_its_frames_alone():
    targets = swaying()
    link, point = int(TREE.frame_link[2]), TREE.p_LE[2]
    height = KINEMATICS.effector_poses(Q)[2, 2, 3] + 0.08
    start = np.where(np.arange(FRAMES + 1) > 6, 1, 0)  # one row, in frame 6
    rows = DistanceRows(
        start, np.array([[link, -1]]), np.array([[point, np.zeros(3)]]), np.array([[0.0, 0.0, 1.0]]),
        np.array([height]), np.array([100.0]),
    )  # fmt: skip
    motion = track_momentum(TREE, replace(targets, rows=rows), joined(weight=0.0, smooth=1e-4), targets.q_ref)
    palm = motion_poses(TREE, motion.q)[0][:, 2, 2, 3]
    assert palm[6] > height - 2e-3
    assert palm[0] < height - 0.04


def test_one_frame_is_a_motion_too():
    targets = swaying(1)
    motion = track_momentum(TREE, targets, joined(1), targets.q_ref, max_iterations=30)
    assert motion.momentum.shape == (0, 6)
    assert motion.effector_error.max() < 1e-3
