"""Plans laid on terrains: against brute force over all regions, closed forms, and the conditions of a least sum of squares."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from made_up_plans import circles, contact_poses, floor, made_up_plan, random_regions
from scipy.spatial.transform import Rotation

from drakeplan.experience.alignment import STILL, Alignment, RegionTable, align
from drakeplan.experience.plan_distance import PlanBatch
from drakeplan.experience.stored_plan import Outline, plan_pose
from scenes.effector import LEFT_FOOT, LEFT_PALM, RIGHT_FOOT, RIGHT_PALM
from scenes.footholds.contact_regions import TILT_WEIGHT, ContactRegions, cover_terrain
from scenes.library.plates import rectangle, tilted_plate
from scenes.robots.robot import load_robot
from scenes.terrain.packed_terrain import pack_terrain
from scenes.terrain.terrain import terrain_from

ATOL = 1e-9  # rounding, where the search has nothing to do
FAR = 100.0  # [m] radius of a goal that pulls at nothing
angles, shifts = st.floats(-np.pi, np.pi), st.floats(-3.0, 3.0)
seeds = st.integers(0, 10**6)


def first_feet(outline: Outline, X_WL: np.ndarray) -> np.ndarray:
    """(2, 3) where the feet of the first stance are."""
    poses = contact_poses(outline, X_WL)
    return np.array([poses[(outline.effector == e) & (outline.first == 0)][0, :3, 3] for e in (0, 1)])


def last_mean(outline: Outline, X_WL: np.ndarray) -> np.ndarray:
    """(2,) the mean of the last feet in plan view."""
    poses = contact_poses(outline, X_WL)
    return np.mean([poses[outline.effector == e][-1, :2, 3] for e in (0, 1)], axis=0)


def own_regions(outline: Outline, X_WL: np.ndarray, radius: float) -> dict[int, ContactRegions]:
    """A circle about every contact of a plan."""
    poses = contact_poses(outline, X_WL)
    return {e: circles(poses[outline.effector == e], radius) for e in set(outline.effector.tolist())}


def rubble_about(outline: Outline, seed: int) -> dict[int, ContactRegions]:
    """Two circles near every contact of a plan that begins at the world's origin, tilted and some 10 cm off."""
    rng, found = np.random.default_rng(seed), {}
    for e in sorted(set(outline.effector.tolist())):
        poses = np.repeat(contact_poses(outline, np.eye(4))[outline.effector == e], 2, axis=0)
        poses[:, :3, :3] = (
            Rotation.from_rotvec(0.2 * rng.standard_normal((len(poses), 3))).as_matrix() @ poses[:, :3, :3]
        )
        poses[:, :3, 3] += 0.1 * rng.standard_normal((len(poses), 3))
        found[e] = circles(poses, rng.uniform(0.01, 0.1, len(poses)))
    return found


def laid(
    outline: Outline, regions: dict[int, ContactRegions], feet: np.ndarray, goal: np.ndarray, radius: float = FAR
) -> Alignment:
    """The whole plan on the terrain."""
    end = np.array([len(outline.distance) - 1])
    return align(PlanBatch.of([outline]), end, RegionTable.of(regions), feet, goal, radius)


def found_pose(alignment: Alignment, k: int = 0) -> np.ndarray:
    return plan_pose(alignment.pose[k, :3], alignment.pose[k, 3])


def random_walk(seed: int) -> Outline:
    rng = np.random.default_rng(seed)
    palms = [(), (LEFT_PALM,), (RIGHT_PALM,), (RIGHT_PALM, LEFT_PALM)][int(rng.integers(4))]
    walk = made_up_plan(int(rng.integers(3, 9)), 0.25, noise=0.04, seed=seed, palms=palms, turn=0.2, rise=0.03)
    return walk.outline


# ---- the distance of a plan from a terrain


@settings(max_examples=60)
@given(seeds)
def test_distances_are_those_of_the_nearest_of_all_regions(seed: int) -> None:
    outline, regions = random_walk(seed), random_regions(seed)
    feet = np.array([[0.0, 0.1, 0.0], [0.0, -0.1, 0.0]])
    result = laid(outline, regions, feet, np.array([1.5, 0.3]), 0.2)
    poses = contact_poses(outline, found_pose(result))
    xi = np.array([regions[e].distance(X).min() for e, X in zip(outline.effector, poses, strict=True)])
    xi[(outline.first == 0) & (outline.effector < 2)] = 0.0  # these will be where the robot stands
    assert result.mean[0] == pytest.approx(xi.mean(), abs=ATOL)
    assert result.worst[0] == pytest.approx(xi.max(), abs=ATOL)


def test_distances_are_those_of_the_nearest_circle_of_covered_plates() -> None:
    rng, robot = np.random.default_rng(1), load_robot("escher")
    plates = [
        tilted_plate(f"stone_{k}_{y}", (0.3 * k, y, 0.05 * rng.normal()), rectangle(0.3, 0.3), *(0.2 * rng.normal(size=2)), 0.0)
        for k in range(6)
        for y in (0.16, -0.16)
    ]  # fmt: skip
    packed = pack_terrain(terrain_from(plates))
    regions = {e: cover_terrain(packed, robot.effectors[e], heading=0.0, turn=0.06, finest=0.03) for e in (0, 1)}
    assert min(len(r) for r in regions.values()) > 30
    outline = made_up_plan(5, 0.28, noise=0.03, seed=2).outline
    result = laid(outline, regions, first_feet(outline, np.eye(4)), np.array([1.4, 0.0]), 0.3)
    poses = contact_poses(outline, found_pose(result))
    xi = np.array([regions[e].nearest(X)[1] for e, X in zip(outline.effector, poses, strict=True)])
    assert result.mean[0] == pytest.approx(xi[2:].sum() / len(xi), abs=ATOL)
    assert result.worst[0] == pytest.approx(xi[2:].max(), abs=ATOL)


def test_a_terrain_without_regions_is_infinitely_far() -> None:
    outline = made_up_plan(4, palms=(LEFT_PALM,)).outline
    feet, goal = first_feet(outline, np.eye(4)), last_mean(outline, np.eye(4))
    for regions in ({}, {e: floor(0.0).where(np.zeros(0, int)) for e in range(4)}, {0: floor(0.0), 1: floor(0.0)}):
        result = laid(outline, regions, feet, goal)
        assert result.mean[0] == result.worst[0] == np.inf
        assert np.isfinite(result.pose).all()


# ---- where plans come to lie


@settings(max_examples=30)
@given(seeds, shifts, shifts, shifts, angles)
def test_a_plan_that_lies_on_the_terrain_stays_there(seed: int, x: float, y: float, z: float, yaw: float) -> None:
    outline, X_WL = random_walk(seed), plan_pose(np.array([x, y, z]), yaw)
    regions, goal = own_regions(outline, X_WL, 0.05), last_mean(outline, X_WL)
    result = laid(outline, regions, first_feet(outline, X_WL), goal, 0.1)
    np.testing.assert_allclose(found_pose(result), X_WL, atol=1e-6)
    assert result.mean[0] == pytest.approx(0.0, abs=1e-6)
    assert result.worst[0] == pytest.approx(0.0, abs=1e-6)


@given(st.floats(-5.0, 5.0), angles, st.integers(2, 9))
def test_on_a_level_floor_a_plan_has_its_height(z: float, yaw: float, steps: int) -> None:
    outline, X_WL = made_up_plan(steps, noise=0.03).outline, plan_pose(np.array([0.4, -0.3, z]), yaw)
    result = laid(outline, {0: floor(z), 1: floor(z)}, first_feet(outline, X_WL), last_mean(outline, X_WL))
    assert result.pose[0, 2] == pytest.approx(z, abs=ATOL)
    assert result.mean[0] == pytest.approx(0.0, abs=ATOL)


@given(st.floats(-0.5, 0.5), st.integers(2, 9))
def test_between_the_feet_and_a_lower_floor_a_plan_is_at_the_mean(drop: float, steps: int) -> None:
    outline = made_up_plan(steps, noise=0.03).outline
    feet, goal = first_feet(outline, np.eye(4)), last_mean(outline, np.eye(4))
    result = laid(outline, {0: floor(-drop), 1: floor(-drop)}, feet, goal)
    count = steps + 2
    assert result.pose[0, 2] == pytest.approx(-drop * steps / count, abs=ATOL)
    assert result.worst[0] == pytest.approx(abs(drop) * 2 / count, abs=ATOL)
    assert result.mean[0] == pytest.approx(steps * abs(drop) * 2 / count / count, abs=ATOL)


@settings(max_examples=40)
@given(seeds, st.floats(-0.08, 0.08), shifts, shifts, angles)
def test_a_plan_that_begins_askew_is_turned_back(seed: int, askew: float, x: float, y: float, yaw: float) -> None:
    outline = random_walk(seed)
    X_WL, X_WG = (plan_pose(np.array([x, y, 0.1]), psi) for psi in (yaw, yaw + askew))
    radius = 0.02
    goal = last_mean(outline, X_WG)  # the plan is turned there first
    result = laid(outline, own_regions(outline, X_WL, radius), first_feet(outline, X_WL), goal)
    away = np.linalg.norm(
        contact_poses(outline, found_pose(result))[:, :3, 3] - contact_poses(outline, X_WL)[:, :3, 3], axis=1
    )
    assert away.max() < radius + 10 * STILL
    assert result.mean[0] < 5 * STILL


def test_a_goal_out_of_reach_draws_a_plan_that_way_but_not_from_its_feet() -> None:
    outline = made_up_plan(6, 0.25).outline
    feet, goal = first_feet(outline, np.eye(4)), last_mean(outline, np.eye(4)) + np.array([0.3, 0.0])
    result = laid(outline, {0: floor(0.0), 1: floor(0.0)}, feet, goal, 0.1)
    assert result.pose[0, 0] == pytest.approx((2 * 0.0 + 2 * 0.2) / 4, abs=5 * STILL)  # two feet here, two there
    np.testing.assert_allclose(result.pose[0, 1:], 0.0, atol=ATOL)


@settings(max_examples=30)
@given(seeds, shifts, shifts, shifts, angles)
def test_moved_terrain_moves_the_plan_with_it(seed: int, x: float, y: float, z: float, yaw: float) -> None:
    outline, regions, X = random_walk(seed), random_regions(seed), plan_pose(np.array([x, y, z]), yaw)
    feet, goal = first_feet(outline, np.eye(4)), np.array([1.4, 0.2])
    here = laid(outline, regions, feet, goal, 0.2)
    moved = {e: ContactRegions(r.surface, X @ r.X_WR, r.radius) for e, r in regions.items()}
    there = laid(outline, moved, feet @ X[:3, :3].T + X[:3, 3], X[:2, :2] @ goal + X[:2, 3], 0.2)
    np.testing.assert_allclose(found_pose(there), X @ found_pose(here), atol=1e-6)
    assert there.mean[0] == pytest.approx(here.mean[0], abs=1e-6)


# ---- the least sum of squares


def sum_of_squares(
    x: np.ndarray,
    outline: Outline,
    near: list[tuple[np.ndarray, float]],
    feet: np.ndarray,
    goal: np.ndarray,
    radius: float,
) -> float:
    """Squared distances of first feet from the feet, of the others from given circles, of walls' headings and of the goal.

    Args:
        x: (4,) x, y, z and yaw of the plan.
        outline: the plan.
        near: pose and radius of the circle of each contact.
        feet, goal, radius: of the query.
    """
    X_WL = plan_pose(x[:3], x[3])
    total = 0.0
    for X, e, first, (X_WR, r) in zip(contact_poses(outline, X_WL), outline.effector, outline.first, near, strict=True):
        if first == 0 and e < 2:
            total += float(((X[:3, 3] - feet[e]) ** 2).sum())
            continue
        u, v, w = X_WR[:3, :3].T @ (X[:3, 3] - X_WR[:3, 3])
        total += max(np.hypot(u, v) - r, 0.0) ** 2 + w**2
        n, wanted = X[:3, 2], X_WR[:3, 2]
        if min(np.hypot(*n[:2]), np.hypot(*wanted[:2])) > 0.5:
            off = np.arctan2(wanted[1], wanted[0]) - np.arctan2(n[1], n[0])
            total += (TILT_WEIGHT * np.angle(np.exp(1j * off))) ** 2
    short = max(np.hypot(*(last_mean(outline, X_WL) - goal)) - radius, 0.0)
    return total + 2 * short**2  # one for each of the last feet


@settings(max_examples=60)
@given(seeds)
def test_small_moves_do_not_lessen_the_sum_of_squares(seed: int) -> None:
    outline = random_walk(seed)
    regions, feet = rubble_about(outline, seed), first_feet(outline, np.eye(4))
    goal, radius = last_mean(outline, np.eye(4)) + np.random.default_rng(seed).uniform(-0.3, 0.3, 2), 0.2
    result = laid(outline, regions, feet, goal, radius)
    near = []
    for e, X in zip(outline.effector, contact_poses(outline, found_pose(result)), strict=True):
        xi = regions[e].distance(X)
        k = int(np.argmin(xi))
        assume(np.delete(xi, k).min() > xi[k] + 2 * STILL)  # the last step did not change which is nearest
        near.append((regions[e].X_WR[k], float(regions[e].radius[k])))

    def slope(way: np.ndarray, h: float = 1e-6) -> float:
        there, back = (
            sum_of_squares(x, outline, near, feet, goal, radius) for x in result.pose[0] + h * np.array([way, -way])
        )
        return (there - back) / (2 * h)

    # The last step moved no contact by more than STILL. A step is half the slope over the number of contacts, the last two of
    # which count twice; a turn moves a contact by its arm.
    arm = np.linalg.norm(outline.position[:, :2], axis=1)
    count = len(arm) + 2
    for way, most in zip(np.eye(4), STILL * np.array([count, count, count, arm.sum() + 2 * arm.max()]), strict=True):
        assert abs(slope(way)) < 2 * most


# ---- several plans, and plans that are cut


@settings(max_examples=30)
@given(seeds)
def test_contacts_after_the_end_do_not_count(seed: int) -> None:
    outline, regions = random_walk(seed), random_regions(seed)
    feet, goal = first_feet(outline, np.eye(4)), np.array([1.0, 0.1])
    for end in range(1, len(outline.distance)):
        kept = outline.first <= end
        cut = Outline(
            outline.position[kept], outline.quaternion[kept], outline.effector[kept], outline.first[kept],
            outline.distance[: end + 1],
        )  # fmt: skip
        whole = align(PlanBatch.of([outline]), np.array([end]), RegionTable.of(regions), feet, goal, 0.1)
        shorter = laid(cut, regions, feet, goal, 0.1)
        np.testing.assert_array_equal(whole.pose, shorter.pose)
        np.testing.assert_array_equal(whole.mean, shorter.mean)
        np.testing.assert_array_equal(whole.worst, shorter.worst)


def test_a_palm_after_the_end_needs_no_region() -> None:
    outline = made_up_plan(6, palms=(LEFT_PALM,)).outline
    when = int(outline.first[outline.effector == LEFT_PALM][0])
    table, feet = RegionTable.of({0: floor(0.0), 1: floor(0.0)}), first_feet(outline, np.eye(4))
    ends = np.array([when - 1, when])
    result = align(PlanBatch.of([outline, outline]), ends, table, feet, np.array([1.0, 0.0]), FAR)
    np.testing.assert_allclose(result.mean, [0.0, np.inf], atol=ATOL)


def test_a_batch_is_each_plan_on_its_own() -> None:
    outlines, regions = [random_walk(seed) for seed in range(8)], random_regions(3)
    feet, goal = np.array([[0.0, 0.1, 0.0], [0.0, -0.1, 0.0]]), np.array([1.5, 0.0])
    ends = np.array([len(o.distance) - 1 for o in outlines])
    together = align(PlanBatch.of(outlines), ends, RegionTable.of(regions), feet, goal, 0.2)
    for k, outline in enumerate(outlines):
        alone = laid(outline, regions, feet, goal, 0.2)
        np.testing.assert_array_equal(together.pose[k], alone.pose[0])
        assert together.mean[k] == alone.mean[0]
    goals = np.random.default_rng(0).uniform([1.0, -0.3], [2.0, 0.3], (len(outlines), 2))
    apart = align(PlanBatch.of(outlines), ends, RegionTable.of(regions), feet, goals, 0.2)
    for k, outline in enumerate(outlines):
        np.testing.assert_array_equal(apart.pose[k], laid(outline, regions, feet, goals[k], 0.2).pose[0])
    assert len(align(PlanBatch.of([]), np.zeros(0, int), RegionTable.of(regions), feet, goal, 0.2).mean) == 0


def test_a_wall_turns_a_plan_until_its_palm_faces_it() -> None:
    outline = made_up_plan(6, palms=(LEFT_PALM,)).outline
    k = int(np.flatnonzero(outline.effector == LEFT_PALM)[0])
    psi = 0.15
    turned = plan_pose(np.zeros(3), psi)
    wall = circles((turned @ contact_poses(outline, np.eye(4))[k])[None], 1.0)
    regions = {LEFT_FOOT: floor(0.0), RIGHT_FOOT: floor(0.0), LEFT_PALM: wall}
    straight = laid(outline, regions, first_feet(outline, np.eye(4)), np.array([1.5, 0.0]))
    assert 0.0 < straight.pose[0, 3] < psi
    turned_feet = first_feet(outline, turned)
    assert laid(outline, regions, turned_feet, turned[:2, :2] @ [1.5, 0.0]).pose[0, 3] == pytest.approx(psi)


def test_the_table_holds_every_circle_once_sorted_along_x() -> None:
    regions = random_regions(5)
    table = RegionTable.of(regions)
    np.testing.assert_array_equal(np.diff(table.start), [len(regions[e]) for e in range(4)])
    for e in range(4):
        own = slice(table.start[e], table.start[e + 1])
        assert (np.diff(table.centre[own, 0]) >= 0).all()
        assert sorted(table.radius[own]) == sorted(regions[e].radius)
        assert table.widest[e] == regions[e].radius.max()
    assert RegionTable.of({}).start.tolist() == [0, 0, 0, 0, 0]
