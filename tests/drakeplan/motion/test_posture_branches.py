"""Key postures on one branch: the course through candidates is the shortest, and arms that hold a wall do not flip."""

from __future__ import annotations

from itertools import product

import numpy as np
import pytest

from drakeplan.motion.posture_branches import COMFORT, MISSED, best_of, holding_joints, on_one_branch
from drakeplan.motion.posture_branches import _shortest as shortest
from optimization.inverse_kinematics.frame_task import TrackingTargets
from optimization.inverse_kinematics.posture_tracking import TrackedPostures, track_postures
from optimization.multibody.kinematics import Kinematics, limb_links
from scenes.robots.plant import build_plant, nominal_posture
from scenes.robots.robot import load_robot

ROBOT = load_robot("escher")
KINEMATICS = Kinematics.from_plant(build_plant(ROBOT).plant, [e.frame for e in ROBOT.effectors])
TREE = KINEMATICS.tree
NOMINAL = np.array(nominal_posture(ROBOT))
JOINTS = len(TREE.lower)
LEFT_ARM = np.array(limb_links(TREE, 2)) - 1
GOOD = (1e-3, 5e-3)


def targets(num: int, palm: np.ndarray | None = None) -> TrackingTargets:
    """Feet where the nominal posture has them, the left palm held at a pose where one is given, the CoM moving forwards."""
    hold = np.tile([300.0, 300.0, 300.0 if palm is not None else 0.0, 0.0], (num, 1))
    X_WE = np.tile(KINEMATICS.effector_poses(NOMINAL), (num, 1, 1, 1))
    if palm is not None:
        X_WE[:, 2] = palm
    com = np.tile(KINEMATICS.com(NOMINAL), (num, 1))
    com[:, 0] += np.linspace(-0.02, 0.03, num)
    weight = np.concatenate([np.full(3, 0.6), np.zeros(3), np.full(JOINTS, 0.1)])
    return TrackingTargets(
        X_WE,
        hold,
        0.3 * hold,
        com,
        np.tile([10.0, 10.0, 0.0], (num, 1)),
        np.tile(NOMINAL, (num, 1)),
        weight,
        TREE.lower,
        TREE.upper,
    )


@pytest.mark.parametrize("seed", range(8))
def test_the_course_is_the_cheapest_of_all(seed: int) -> None:
    rng = np.random.default_rng(seed)
    num, wanted = 5, targets(5)
    candidates = []
    for _ in range(3):
        q = np.tile(NOMINAL, (num, 1))
        q[:, 7:] += rng.normal(0.0, 0.5, (num, JOINTS))
        missed = np.where(rng.random((num, 4)) < 0.05, 0.1, 0.0)
        candidates.append(TrackedPostures(q, missed, np.zeros((num, 3)), np.zeros(num, np.int64)))
    same = rng.random((num - 1, 4)) < 0.5
    weight = holding_joints(TREE, same)

    def price(course: tuple[int, ...]) -> float:
        q = np.stack([candidates[c].q[b, 7:] for b, c in enumerate(course)])
        missed = sum(candidates[c].effector_error[b].max() > GOOD[0] for b, c in enumerate(course))
        turned = float((weight * np.diff(q, axis=0) ** 2).sum())
        return turned + COMFORT * float(((q - NOMINAL[7:]) ** 2).sum()) + MISSED * missed

    chosen = tuple(shortest(TREE, wanted, candidates, same, GOOD).tolist())
    assert price(chosen) == pytest.approx(min(price(course) for course in product(range(3), repeat=num)))


def test_an_arm_that_holds_a_wall_does_not_flip() -> None:
    rng = np.random.default_rng(3)
    placed = np.tile([0, 1, 2, -1], (6, 1))
    flips = mended = 0
    for _ in range(8):
        q = NOMINAL.copy()
        low, high = TREE.lower[LEFT_ARM], TREE.upper[LEFT_ARM]
        q[7 + LEFT_ARM] = low + rng.uniform(0.2, 0.8, len(LEFT_ARM)) * (high - low)
        wanted = targets(6, KINEMATICS.effector_poses(q)[2])
        starts = np.tile(NOMINAL, (6, 1))
        starts[::2, 7 + LEFT_ARM] = rng.uniform(low, high)  # what they are solved from leads to different branches
        alone = track_postures(TREE, wanted, starts, chained=False, max_iterations=60)
        held = on_one_branch(TREE, wanted, alone, placed, GOOD)
        limb = holding_joints(TREE, np.array([[True, True, True, False]]))
        price, turned = [], []
        for each in (alone, held):
            missed = (each.effector_error.max(axis=1) > GOOD[0]) | (
                np.linalg.norm(each.com_error[:, :2], axis=1) > GOOD[1]
            )
            way = float((limb * np.diff(each.q[:, 7:], axis=0) ** 2).sum())
            price.append(
                way + COMFORT * float(((each.q[:, 7:] - NOMINAL[7:]) ** 2).sum()) + MISSED * float(missed.sum())
            )
            turned.append(float(np.abs(np.diff(each.q[:, 7 + LEFT_ARM], axis=0)).max()))
        assert price[1] <= price[0] + 1e-9
        flips += turned[0] > 0.8
        mended += turned[0] > 0.8 > turned[1]
    assert flips  # else nothing was tested
    assert mended >= 0.7 * flips


def test_feet_alone_stay_as_they_are_and_each_posture_is_the_chosen_one() -> None:
    wanted = targets(4)
    alone = track_postures(TREE, wanted, wanted.q_ref, chained=False)
    assert on_one_branch(TREE, wanted, alone, np.tile([0, 1, -1, -1], (4, 1)), GOOD) is alone
    other = TrackedPostures(alone.q + 1.0, alone.effector_error, alone.com_error, alone.iterations)
    mixed = best_of([alone, other], np.array([0, 1, 1, 0]))
    assert np.allclose(mixed.q - alone.q, np.repeat([[0.0], [1.0], [1.0], [0.0]], alone.q.shape[1], axis=1))
