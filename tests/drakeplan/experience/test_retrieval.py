"""In which order stored plans are tried on a terrain, where they are cut, and which of them may be used at all."""

from __future__ import annotations

from collections.abc import Sequence
from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from made_up_plans import contact_poses, floor, made_up_plan, random_regions

from drakeplan.experience.alignment import STILL, RegionTable, align
from drakeplan.experience.library import Entry
from drakeplan.experience.plan_distance import PlanBatch
from drakeplan.experience.retrieval import PALM_COST, Candidate, candidates, usable_modes
from drakeplan.experience.stored_plan import MODES, StoredPlan, plan_pose
from scenes.effector import LEFT_PALM, RIGHT_PALM

FEET = np.array([[0.0, 0.1, 0.0], [0.0, -0.1, 0.0]])
LEVEL = {0: floor(0.0), 1: floor(0.0)}
seeds = st.integers(0, 10**6)


def entry(plan: StoredPlan, number: int, cluster: int = 0, squares: float = 0.0) -> Entry:
    return Entry(number, f"plan {number}", plan.mode, plan.outline.length, cluster, squares, plan.outline)


def random_entries(seed: int, count: int = 12) -> list[Entry]:
    """Walks of 1 to 2 m with palms or without, in clusters drawn at random."""
    rng = np.random.default_rng(seed)
    palms = [(), (LEFT_PALM,), (RIGHT_PALM,), (LEFT_PALM, RIGHT_PALM)]
    plans = [
        made_up_plan(int(rng.integers(4, 9)), 0.25, noise=0.04, seed=seed + k, palms=palms[rng.integers(4)], turn=0.1)
        for k in range(count)
    ]
    return [entry(plan, k + 1, int(rng.integers(3)), float(rng.random())) for k, plan in enumerate(plans)]


def tried(
    entries: Sequence[Entry], far: float, radius: float = 0.2, regions: dict | None = None, yaw: float = 0.0
) -> list[Candidate]:
    """Candidates for a goal so far from the feet, in this direction."""
    goal = far * np.array([np.cos(yaw), np.sin(yaw), 0.0])
    table = RegionTable.of(LEVEL if regions is None else regions)
    return list(candidates(entries, table, FEET, goal, radius))


# ---- where plans are cut


@settings(max_examples=30)
@given(seeds, st.floats(0.5, 2.5), st.floats(0.05, 0.4))
def test_a_plan_is_cut_where_it_is_nearest_to_the_goal(seed: int, far: float, radius: float) -> None:
    entries, regions = random_entries(seed), random_regions(seed)
    found = tried(entries, far, radius, regions)
    for candidate in found:
        distance = candidate.entry.outline.distance
        ends = candidate.entry.outline.ends()
        assert candidate.end in ends
        if candidate.reaches:
            assert abs(distance[candidate.end] - far) == np.abs(distance[ends] - far).min() <= radius
        else:
            assert candidate.end == ends[-1]
            assert distance[candidate.end] < far - radius


@settings(max_examples=30)
@given(seeds, st.floats(0.5, 2.5), st.floats(0.05, 0.4))
def test_plans_that_reach_come_alone_and_all_of_them(seed: int, far: float, radius: float) -> None:
    entries = random_entries(seed)
    found = tried(entries, far, radius, random_regions(seed))
    gap = {e.name: np.abs(e.outline.distance[e.outline.ends()] - far).min() for e in entries}
    reaching = {name for name, off in gap.items() if off <= radius}
    shorter = {e.name for e in entries if e.outline.distance[e.outline.ends()[-1]] < far - radius}
    names = [candidate.entry.name for candidate in found]
    assert len(set(names)) == len(names)
    assert set(names) == (reaching or shorter)
    assert {candidate.reaches for candidate in found} <= {bool(reaching)}


def test_short_plans_wait_until_none_reaches() -> None:
    short, long = entry(made_up_plan(4), 1), entry(made_up_plan(9), 2, cluster=1)
    assert [(c.entry, c.reaches) for c in tried([short, long], 2.0)] == [(long, True)]
    both = tried([short, long], 5.0)
    assert {c.entry.name: (c.reaches, c.end) for c in both} == {"plan 1": (False, 4), "plan 2": (False, 9)}
    assert [(c.entry, c.end) for c in tried([short, long], 0.375, 0.01) if c.entry is long] == [(long, 2)]


def test_a_palm_that_lets_go_after_the_last_step_is_left_out() -> None:
    plan = made_up_plan(4, palms=(LEFT_PALM,))  # the palm comes after the first step: stance 2 is as far as stance 1
    far = float(plan.outline.distance[1])
    assert plan.outline.distance[2] == far
    regions = {**LEVEL, LEFT_PALM: floor(1.2)}
    assert [c.end for c in tried([entry(plan, 1)], far, 0.05, regions)] == [1]


def test_a_stride_over_the_goal_neither_reaches_nor_leads_towards_it() -> None:
    far = float(made_up_plan(4).outline.distance[2:4].mean())
    assert tried([entry(made_up_plan(4), 1)], far, 0.05) == []


def test_nobody_goes_nowhere() -> None:
    assert tried([], 2.0) == []
    assert tried([entry(made_up_plan(4), 1)], 0.0, 0.1) == []


# ---- where plans are laid


@settings(max_examples=30)
@given(st.integers(3, 9), st.floats(-np.pi, np.pi), st.floats(-0.15, 0.15))
def test_on_a_level_floor_a_plan_leads_from_the_feet_into_the_goal(steps: int, yaw: float, off: float) -> None:
    plan = made_up_plan(steps, noise=0.03, seed=steps)
    turn = plan_pose(np.zeros(3), yaw)
    feet, far = FEET @ turn[:3, :3].T, plan.outline.length + off
    goal = turn[:3, :3] @ [far, 0.0, 0.0]
    (found,) = candidates([entry(plan, 1)], RegionTable.of(LEVEL), feet, goal, 0.2)
    poses = contact_poses(plan.outline, found.X_WL)[:, :3, 3]
    np.testing.assert_allclose(poses[:2], feet, atol=10 * STILL)
    last = plan.stances[found.end, :2]
    assert np.hypot(*(poses[last].mean(axis=0) - goal)[:2]) < 0.2 + 10 * STILL
    assert found.distance == found.worst == pytest.approx(0.0, abs=1e-9)


@settings(max_examples=30)
@given(st.integers(3, 7), st.floats(-np.pi, np.pi))
def test_a_plan_too_short_lies_straight_towards_the_goal(steps: int, yaw: float) -> None:
    turn = plan_pose(np.array([0.3, -0.2, 0.0]), yaw)
    feet = FEET @ turn[:3, :3].T + turn[:3, 3]
    goal = turn[:3, :3] @ [6.0, 0.0, 0.0] + turn[:3, 3]
    (found,) = candidates([entry(made_up_plan(steps), 1)], RegionTable.of(LEVEL), feet, goal, 0.2)
    np.testing.assert_allclose(found.X_WL, turn, atol=1e-9)


# ---- in which order


def lay(entries: Sequence[Entry], ends: Sequence[int], regions: dict, far: float, radius: float) -> np.ndarray:
    """(M,) distances of plans from the terrain, each laid alone."""
    table, goal = RegionTable.of(regions), np.array([far, 0.0])
    alone = [
        align(PlanBatch.of([e.outline]), np.array([end]), table, FEET, goal, radius).mean[0]
        for e, end in zip(entries, ends, strict=True)
    ]
    return np.array(alone)


@settings(max_examples=40)
@given(seeds)
def test_clusters_come_by_their_representatives_and_plans_by_their_distance(seed: int) -> None:
    entries, regions, far, radius = random_entries(seed), random_regions(seed), 1.0, 0.5  # every plan reaches
    found = tried(entries, far, radius, regions)
    assert len(found) == len(entries)
    ends = {c.entry.name: c.end for c in found}
    distance = dict(
        zip((e.name for e in entries), lay(entries, [ends[e.name] for e in entries], regions, far, radius), strict=True)
    )
    groups: dict[tuple[str, int], list[Entry]] = {}
    for e in entries:
        groups.setdefault((e.mode, e.cluster), []).append(e)

    def of_representative(group: list[Entry]) -> float:
        representative = min(group, key=lambda e: e.squares)
        num_palms = len(set(representative.outline.effector) & {LEFT_PALM, RIGHT_PALM})
        return distance[representative.name] + PALM_COST * num_palms

    ordered = sorted(groups.values(), key=of_representative)
    expected = [e.name for group in ordered for e in sorted(group, key=lambda e: distance[e.name])]
    assert [c.entry.name for c in found] == expected
    np.testing.assert_array_equal([c.distance for c in found], [distance[name] for name in expected])
    assert all(c.worst >= c.distance >= 0.0 for c in found)


def test_where_the_representative_is_too_short_the_cluster_is_tried_all_the_same() -> None:
    short, long = entry(made_up_plan(4), 1, squares=0.0), entry(made_up_plan(8), 2, squares=1.0)
    assert [c.entry for c in tried([short, long], 2.0)] == [long]


def test_clusters_of_different_modes_are_different_though_their_numbers_agree() -> None:
    feet, palm = entry(made_up_plan(8), 1), entry(made_up_plan(8, palms=(LEFT_PALM,)), 2)
    found = tried([palm, feet], 1.5, regions={**LEVEL, LEFT_PALM: floor(50.0)})
    assert [c.entry for c in found] == [feet, palm]


def test_plans_whose_end_effector_finds_no_region_are_not_tried() -> None:
    feet, palm = entry(made_up_plan(8), 1), entry(made_up_plan(8, palms=(LEFT_PALM,)), 2)
    assert [c.entry for c in tried([palm, feet], 1.5)] == [feet]
    assert tried([palm, feet], 1.5, regions={}) == []


# ---- motion modes


@pytest.mark.parametrize(
    ("palms", "modes"),
    [
        ((), ("feet",)),
        ((LEFT_PALM,), ("feet", "left_palm")),
        ((RIGHT_PALM,), ("feet", "right_palm")),
        ((LEFT_PALM, RIGHT_PALM), MODES),
    ],
)
def test_modes_are_usable_whose_palms_all_find_a_surface(palms: tuple[int, ...], modes: tuple[str, ...]) -> None:
    context = SimpleNamespace(usable_palms=palms)
    assert usable_modes(context, use_palms=True) == modes
    assert usable_modes(context, use_palms=False) == ("feet",)
