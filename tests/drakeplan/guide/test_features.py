"""Features of torso poses against plain twins, the same wherever the terrain is and for its mirror image."""

from __future__ import annotations

import numpy as np
import pytest
from made_up_ground import ESCHER, MODEL, STEPS, box, floor, mirrored, moved, stones

from drakeplan.contact_planning.contact_domain import ARM_SLACK
from drakeplan.guide.contact_scores import PITCH, FootScores, foot_scores, score_of
from drakeplan.guide.features import WINDOW, step_tables
from drakeplan.guide.ground_view import AROUND, GroundView
from drakeplan.guide.torso_steps import DIRECTIONS
from learning.footstep_counts import MIRRORED_PALMS
from learning.training.footstep_counts import mirror_of
from scenes.contact import contact_rotation
from scenes.effector import EFFECTORS
from scenes.footholds.projection import (
    no_placements,
    patch_shape,
    project_feet,
    project_palms,
    set_down,
)
from scenes.pose import rpy_rotation
from scenes.terrain.packed_terrain import PackedTerrain, pack_terrain
from scenes.terrain.terrain import Terrain

MIRROR = mirror_of(STEPS.translations)

RISE = ESCHER.max_step_height
SOLE = patch_shape(ESCHER.effectors[0])
RIM = 1.101e-3  # [m] the patch that stands for a point, and its margin
POSES = np.array([[0.113, 0.0571, 0.03, 0.211], [-0.327, -0.1183, -0.02, -2.513], [0.4017, 0.1339, 0.0, 1.307]])
SEEDS = (3, 6)


def view_of(terrain: Terrain, poses: np.ndarray = POSES) -> tuple[PackedTerrain, GroundView]:
    packed = pack_terrain(terrain)
    return packed, GroundView(packed, ESCHER, STEPS, MODEL.rays, poses[:, :2].min(axis=0), poses[:, :2].max(axis=0))


@pytest.fixture(scope="module", params=SEEDS)
def ground(request) -> tuple[Terrain, PackedTerrain, GroundView]:
    terrain = stones(request.param)
    return (terrain, *view_of(terrain))


def in_world(pose: np.ndarray, places: np.ndarray) -> np.ndarray:
    """(n, 3) x, y, yaw in W of places in T."""
    x, y, _, yaw = pose
    c, s = np.cos(yaw), np.sin(yaw)
    u, v, turn = places.T
    return np.column_stack([x + c * u - s * v, y + s * u + c * v, yaw + turn])


def plain_foot_features(scores: FootScores, pose: np.ndarray) -> tuple[list[float], float]:
    """S_f and S_pairs, point by point."""

    def score(x: float, y: float) -> float:
        i, j = (int(np.floor((a - b) / PITCH + 0.5)) for a, b in zip((x, y), scores.origin.tolist(), strict=True))
        if not (0 <= i < scores.z.shape[1] and 0 <= j < scores.z.shape[2]):
            return 0.0
        near = np.abs(scores.z[:, i, j] - pose[2]) <= RISE
        return float(scores.score[near, i, j].max(initial=0.0))

    feet, total = [0.0] * len(STEPS.translations), 0.0
    for k, pair in enumerate(STEPS.pairs):
        (lx, ly, _), (rx, ry, _) = in_world(pose, pair).tolist()
        both = score(lx, ly) * score(rx, ry)
        total += both
        if both:
            for a in np.flatnonzero(STEPS.pair == k):
                ((x, y, _),) = in_world(pose, STEPS.place[a : a + 1]).tolist()
                feet[STEPS.translation[a]] += both * score(x, y)
    return feet, total


def test_foot_scores_are_sums_over_steps_of_products_of_three_scores(ground) -> None:
    _, packed, view = ground
    low, high = POSES[:, :2].min(axis=0) - AROUND, POSES[:, :2].max(axis=0) + AROUND
    scores = foot_scores(packed, ESCHER, low, high)
    feet, pairs = view.scores(POSES)
    for k, pose in enumerate(POSES[:2]):
        plain, total = plain_foot_features(scores, pose)
        np.testing.assert_allclose(feet[k], plain, rtol=1e-9, atol=1e-12)
        assert pairs[k] == pytest.approx(total)
    assert pairs.max() > 1.0 and (feet > 0).any()


def plain_exact(packed: PackedTerrain, pose: np.ndarray) -> tuple[np.ndarray, int]:
    """N_f by direction and the pairs that fit: feet set down one by one."""
    window = (pose[2] - RISE, pose[2] + RISE)

    def fits(foot: int, places: np.ndarray) -> np.ndarray:
        placed = no_placements(len(places))
        project_feet(packed, foot, in_world(pose, places), window, SOLE, placed)
        return placed.surface >= 0

    both = fits(0, STEPS.pairs[:, 0]) & fits(1, STEPS.pairs[:, 1])
    step = np.where(STEPS.mover == 0, fits(0, STEPS.place), fits(1, STEPS.place))
    ways = np.zeros(DIRECTIONS, int)
    for k in np.flatnonzero(both):
        for way in range(DIRECTIONS):
            ways[way] += step[(STEPS.pair == k) & (STEPS.direction == way)].any()
    return ways, int(both.sum())


def test_exact_features_count_pairs_from_which_some_step_that_way_fits(ground) -> None:
    _, packed, view = ground
    feet, _ = view.exact(POSES)
    way = STEPS.direction_of_translation
    for k, pose in enumerate(POSES):
        ways, both = plain_exact(packed, pose)
        np.testing.assert_array_equal(feet[k], np.where(way < 0, both, ways[way]))
    assert feet.max() > 0 and feet.min() < len(STEPS.pairs)


def test_a_pair_that_fits_is_one_whose_feet_can_be_set_down(ground) -> None:
    _, packed, view = ground
    pose = POSES[0]
    window = (pose[2] - RISE, pose[2] + RISE)
    count = 0
    for pair in STEPS.pairs:
        feet = zip(EFFECTORS[:2], in_world(pose, pair).tolist(), strict=True)
        half, over = ESCHER.effectors[0].half_extent, ESCHER.effectors[0].overhang
        count += all(set_down(packed, e, x, y, yaw, half, window, over) for e, (x, y, yaw) in feet)
    (stay,) = np.flatnonzero(STEPS.direction_of_translation < 0)
    assert view.exact(POSES[:1])[0][0, stay] == count


def shoulders(pose: np.ndarray) -> list[tuple[int, np.ndarray, np.ndarray, np.ndarray]]:
    """(palm, shoulder in W, rays in W, the same in T) of either side."""
    R, found = rpy_rotation([0.0, 0.0, pose[3]]), []
    for palm, mirror in ((2, 1.0), (3, -1.0)):
        rays = MODEL.rays * [1.0, mirror, 1.0]
        found.append((palm, pose[:3] + R @ (ESCHER.shoulder * [1.0, mirror, 1.0]), rays @ R.T, rays))
    return found


def plain_palms(terrain: Terrain, pose: np.ndarray) -> np.ndarray:
    """S_p: rays met with polygons one by one, and the distance from the nearest edge of the wall that they meet."""
    half, out = np.array(ESCHER.effectors[2].half_extent), np.zeros(4)
    for palm, origin, rays, rays_T in shoulders(pose):
        for ray, ray_T in zip(rays, rays_T, strict=True):
            nearest, met = ARM_SLACK * ESCHER.arm_reach[1], None
            for surface in terrain.surfaces:
                along = surface.normal @ ray
                if abs(along) < 1e-9:
                    continue
                t = surface.normal @ (surface.vertices[0] - origin) / along
                if 0.0 < t < nearest and edge_distance(surface.vertices, surface.normal, origin + t * ray) >= 0.0:
                    nearest, met = t, surface
            usable = met is not None and met.allows(EFFECTORS[palm]) and met.normal @ ray < -0.2
            if usable and nearest >= ESCHER.arm_reach[0]:
                room = edge_distance(met.vertices, met.normal, origin + nearest * ray) - RIM
                front = ESCHER.shoulder[0] + nearest * ray_T[0] >= 0.0
                out[2 * (palm - 2) + (0 if front else 1)] += score_of(room, float(half.min()), float(np.hypot(*half)))
    return out


def edge_distance(vertices: np.ndarray, normal: np.ndarray, p: np.ndarray) -> float:
    """Distance of a point in a convex polygon's plane from its nearest edge's line [m], negative outside."""
    edges = np.roll(vertices, -1, axis=0) - vertices
    inwards = np.cross(normal, edges / np.linalg.norm(edges, axis=1, keepdims=True))
    return float(((p - vertices) * inwards).sum(axis=1).min())


def test_palm_scores_are_sums_over_rays_of_the_room_where_they_end(ground) -> None:
    terrain, _, view = ground
    found = view.palm_scores(POSES)
    for k, pose in enumerate(POSES):
        np.testing.assert_allclose(found[k], plain_palms(terrain, pose), atol=1e-6)
    assert found.sum() > 1.0


def test_exact_palm_features_count_rays_that_end_where_a_palm_fits(ground) -> None:
    _, packed, view = ground
    _, found = view.exact(POSES)
    shape, reach = patch_shape(ESCHER.effectors[2]), (ESCHER.arm_reach[0], ARM_SLACK * ESCHER.arm_reach[1])
    for k, pose in enumerate(POSES):
        count = np.zeros(4)
        for palm, origin, rays, _ in shoulders(pose):
            placed = no_placements(len(rays))
            project_palms(packed, palm, origin, rays, pose[3], reach, shape, placed)
            p_T = (placed.p - pose[:3]) @ rpy_rotation([0.0, 0.0, pose[3]])
            for m in np.flatnonzero(placed.surface >= 0):
                assert placed.R[m] == pytest.approx(
                    contact_rotation(EFFECTORS[palm], packed.normal[placed.surface[m]], pose[3])
                )
                count[2 * (palm - 2) + (0 if p_T[m, 0] >= 0.0 else 1)] += 1
        np.testing.assert_array_equal(found[k], count)
    assert found.sum() > 0


@pytest.mark.parametrize("quarter", [0, 1, 2])
def test_features_go_with_the_terrain_wherever_it_is_moved_on_the_grid(ground, quarter: int) -> None:
    terrain, _, view = ground
    R, p = np.round(rpy_rotation([0.0, 0.0, 0.5 * np.pi * quarter])), np.array([37, -53, 0]) * PITCH + [0, 0, 0.4]
    there = np.column_stack([POSES[:, :3] @ R.T + p, POSES[:, 3] + 0.5 * np.pi * quarter])
    _, other = view_of(moved(terrain, R, p), there)
    rough = quarter % 2 == 1  # the patch of 2 mm that stands for a point lies along the axes of W
    for mine, its in zip(all_of(view, POSES), all_of(other, there), strict=True):
        np.testing.assert_allclose(its, mine, rtol=1e-9, atol=0.02 * mine.max() if rough else 1e-9)


def test_where_contacts_are_checked_exactly_any_motion_leaves_the_counts(ground) -> None:
    terrain, _, view = ground
    turn, p = 0.7319, np.array([1.2345, -0.789, 0.31])
    R = rpy_rotation([0.0, 0.0, turn])
    there = np.column_stack([POSES[:, :3] @ R.T + p, POSES[:, 3] + turn])
    _, other = view_of(moved(terrain, R, p), there)
    for mine, its in zip(view.exact(POSES), other.exact(there), strict=True):
        np.testing.assert_array_equal(its, mine)


def all_of(view: GroundView, poses: np.ndarray) -> tuple[np.ndarray, ...]:
    (feet, pairs), (ways, palms) = view.scores(poses), view.exact(poses)
    return feet, pairs, view.palm_scores(poses), ways, palms


def test_the_mirror_image_of_the_ground_has_the_mirror_image_of_its_features(ground) -> None:
    terrain, _, view = ground
    there = POSES * [1.0, -1.0, 1.0, -1.0]
    _, other = view_of(mirrored(terrain), there)
    feet, pairs, palms, ways, palms_fit = all_of(view, POSES)
    feet_, pairs_, palms_, ways_, palms_fit_ = all_of(other, there)
    np.testing.assert_allclose(feet_, feet[:, MIRROR], rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(pairs_, pairs, rtol=1e-9)
    np.testing.assert_allclose(palms_, palms[:, MIRRORED_PALMS], atol=1e-9)
    np.testing.assert_array_equal(palms_fit_, palms_fit[:, MIRRORED_PALMS])
    (stay,) = np.flatnonzero(STEPS.direction_of_translation < 0)
    np.testing.assert_array_equal(ways_[:, stay], ways[:, stay])


def test_the_mirror_image_of_the_ground_has_the_mirror_image_of_its_exact_counts() -> None:
    terrain = stones(6)
    there = POSES * [1.0, -1.0, 1.0, -1.0]
    ways, ways_ = view_of(terrain)[1].exact(POSES)[0], view_of(mirrored(terrain), there)[1].exact(there)[0]
    np.testing.assert_array_equal(ways_, ways[:, MIRROR])


def test_on_a_large_floor_every_score_is_the_number_of_steps_and_off_it_there_is_none() -> None:
    _, view = view_of(floor((-3.0, 3.0), (-3.0, 3.0)))
    feet, pairs = view.scores(POSES * [1, 1, 0, 1])
    np.testing.assert_array_equal(feet, np.tile(np.bincount(STEPS.translation), (len(POSES), 1)))
    np.testing.assert_array_equal(pairs, len(STEPS.pairs))
    assert not view.palm_scores(POSES).any() and not view.exact(POSES)[1].any()
    away = np.array([[0.0, 0.0, 1.0, 0.0]])  # 1 m over the floor
    assert not any(a.any() for a in all_of(view, away))


def test_a_box_between_hand_and_wall_hides_it() -> None:
    surfaces = stones(6).surfaces
    pose = np.array([[0.05, 0.1, 0.0, 0.0]])
    _, free = view_of(Terrain(surfaces), pose)
    _, hidden = view_of(Terrain(surfaces, (box("screen", (-2.0, 0.45, 0.5), (2.0, 0.5, 2.5)),)), pose)
    assert free.palm_scores(pose)[0, :2].sum() > 0 and free.exact(pose)[1][0, :2].sum() > 0
    assert not hidden.palm_scores(pose)[0, :2].any() and not hidden.exact(pose)[1][0, :2].any()
    np.testing.assert_array_equal(hidden.palm_scores(pose)[0, 2:], free.palm_scores(pose)[0, 2:])


def test_the_tables_of_compiled_code_list_the_steps_of_each_pair() -> None:
    tables = step_tables(STEPS)
    for k in range(0, len(STEPS.pairs), 13):
        np.testing.assert_array_equal(np.arange(*tables.first[k : k + 2]), np.flatnonzero(STEPS.pair == k))
    assert np.hypot(*STEPS.place[:, :2].T).max() < (WINDOW // 2) * PITCH
