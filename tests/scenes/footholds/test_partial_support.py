"""Soles on planks, bars, edges and small stones: the support is the hull of what touches, by shapely as by the kernels."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from scenes.contact import Contact
from scenes.files.scene_source import load_scene
from scenes.footholds.partial_support import INNER_RADIUS, no_supports, rest_down, rest_feet
from scenes.footholds.projection import no_placements, patch_shape
from scenes.footholds.start_stance import start_stance
from scenes.input_error import InputError
from scenes.robots.robot import load_robot
from scenes.scene import Goal, Scene, Start
from scenes.terrain.packed_terrain import pack_terrain
from scenes.terrain.surface import Surface
from scenes.terrain.terrain import Terrain

FOOT = load_robot("escher").effectors[0]
HALF = np.array(FOOT.half_extent)
ANY = (-np.inf, np.inf)
FLUSH, ROUNDING = 3e-3, 1e-4


def plate(x, y, z=0.0, friction=0.5, R=None):
    """A rectangle over x and y at a height, turned as a whole by R."""
    corners = np.array([[x[0], y[0], z], [x[1], y[0], z], [x[1], y[1], z], [x[0], y[1], z]])
    return Surface("plate", corners if R is None else corners @ R.T, friction)


def ground(*plates):
    return pack_terrain(Terrain(tuple(dataclasses.replace(p, name=f"plate {k}") for k, p in enumerate(plates))))


def rest(*plates, at=(0.0, 0.0, 0.0)):
    return rest_down(ground(*plates), FOOT, at, ANY)


WIDE = (-0.5, 0.5)


def test_on_whole_ground_the_whole_sole_rests():
    contact = rest(plate(WIDE, WIDE), at=(0.1, 0.05, 0.7))
    assert contact.support is None
    assert contact.p_WC == pytest.approx([0.1, 0.05, 0.0])


def test_over_an_edge_the_part_before_it_rests():
    contact = rest(plate((-0.5, 0.03), WIDE), plate((0.03, 0.5), WIDE, -0.2))
    expected = [[0.03, HALF[1]], [-HALF[0], HALF[1]], [-HALF[0], -HALF[1]], [0.03, -HALF[1]]]
    assert contact.support == pytest.approx(np.array(expected))
    assert contact.surface == 0


def test_two_bars_carry_what_lies_between_them():
    contact = rest(plate((-0.08, -0.05), WIDE), plate((0.06, 0.09), WIDE), at=(0.0, 0.0, 0.0))
    x = contact.support[:, 0]
    assert (x.min(), x.max()) == pytest.approx((-0.08, 0.09))
    assert shapely.Polygon(contact.support).area == pytest.approx(0.17 * 2 * HALF[1])


def test_planks_with_gaps_carry_the_whole_sole_when_toes_and_heel_are_on_planks():
    """Planks of 10 cm, gaps of 2 cm; a plank starts at -0.02."""
    planks = [plate((0.12 * k - 0.62, 0.12 * k - 0.52), WIDE) for k in range(11)]
    assert rest(*planks, at=(-0.02 + 0.05 + HALF[0], 0, 0)).support is None
    toes_out = rest(*planks, at=(-0.02 + 0.01 + HALF[0], 0, 0))
    assert toes_out.support[:, 0].max() == pytest.approx(HALF[0] - 0.01)


@pytest.mark.parametrize(("toes", "holds"), [(0.06, True), (0.0, False)])
def test_a_given_stance_may_bridge_gaps_but_not_end_over_one(toes, holds):
    """Planks of 10 cm, gaps of 2 cm; soles from -0.09 + toes to 0.13 + toes; gaps begin at -0.10, 0.02, 0.14, ..."""
    planks = [dataclasses.replace(plate((0.12 * k - 0.68, 0.12 * k - 0.58), WIDE), name=f"{k}") for k in range(11)]
    feet = []
    for effector, y in (("left_foot", 0.1), ("right_foot", -0.1)):
        X = np.eye(4)
        X[:3, 3] = [0.02 + toes, y, 0.0]
        feet.append(Contact(effector, 5, X, 0.5))
    scene = Scene("planks", Terrain(tuple(planks)), Start((0.0, 0.0, 0.0), stance=tuple(feet)), Goal((0.3, 0, 0)))
    if holds:
        assert start_stance(scene, pack_terrain(scene.terrain), load_robot("escher")).contacts[:2] == tuple(feet)
    else:
        with pytest.raises(InputError, match="reaches"):
            start_stance(scene, pack_terrain(scene.terrain), load_robot("escher"))


def test_a_stone_smaller_than_the_sole_is_all_of_the_support():
    contact = rest(plate((-0.04, 0.04), (-0.03, 0.03)), at=(0.0, 0.0, 0.4))
    assert shapely.Polygon(contact.support).area == pytest.approx(0.08 * 0.06)


def test_the_middle_of_the_sole_may_hang_in_the_air():
    contact = rest(plate((0.02, 0.5), WIDE), at=(0.0, 0.0, 0.0))
    assert contact.support[:, 0].min() == pytest.approx(0.02)


@pytest.mark.parametrize(("rise", "rests"), [(0.002, True), (0.005, False), (0.05, False), (-0.05, True)])
def test_what_rises_into_the_sole_refuses_it(rise, rests):
    """The sole lies on the outer planks; the one in the middle is higher or lower, and too narrow to carry alone."""
    planks = [plate((-0.5, -0.03), WIDE), plate((-0.009, 0.009), WIDE, rise), plate((0.03, 0.5), WIDE)]
    assert (rest(*planks) is not None) == rests


@pytest.mark.parametrize(("width", "rests"), [(0.019, False), (0.021, True)])
def test_a_support_holds_a_disc_of_1_cm(width, rests):
    assert pytest.approx(0.02) == 2 * INNER_RADIUS
    assert (rest(plate((-0.5 * width, 0.5 * width), WIDE)) is not None) == rests


def test_friction_is_the_least_of_what_touches():
    ground_ = [
        plate((-0.5, 0.0), WIDE, friction=0.6),
        plate((0.0, 0.5), WIDE, friction=0.3),
        plate((0.3, 1), WIDE, -1, 0.1),
    ]
    assert rest(*ground_).friction == 0.3


def test_ground_turned_by_two_degrees_does_not_carry():
    turned = Rotation.from_euler("y", 2.0, degrees=True).as_matrix()
    contact = rest(plate((-0.5, 0.0), WIDE), plate((0.0, 0.5), WIDE, R=turned))
    assert contact.support[:, 0].max() == pytest.approx(0.0)


@settings(deadline=None)
@given(st.integers(0, 100_000))
def test_the_support_is_the_hull_of_what_lies_under_the_sole(seed):
    """Random planks on one tilted plane, some a little higher or lower; shapely intersects them with the sole."""
    rng = np.random.default_rng(seed)
    R = Rotation.from_euler("zxy", [rng.uniform(-3, 3), *rng.uniform(-0.3, 0.3, 2)]).as_matrix()
    edges = np.sort(rng.uniform(-0.25, 0.25, 2 * rng.integers(1, 5))).reshape(-1, 2)
    z = rng.choice([0.0, 0.0, 0.001, -0.002, -0.05], len(edges))
    planks = [plate(x, (-0.3, 0.3), h, R=R) for x, h in zip(edges, z, strict=True) if x[1] - x[0] > 0.004]
    if not planks:
        return
    packed, yaw = ground(*planks), rng.uniform(-3, 3)
    contact = rest_down(packed, FOOT, (*rng.uniform(-0.05, 0.05, 2), yaw), ANY)
    if contact is None or contact.R_WC[:, 2] @ R[:, 2] < 1 - 1e-9:  # it leans on edges of planks of different height
        return
    seen = [(s.vertices - contact.p_WC) @ contact.R_WC for s in planks]
    flush = [shapely.Polygon(v[:, :2]) for v in seen if np.abs(v[:, 2]).max() < FLUSH - ROUNDING]
    sole = shapely.box(*-HALF, *HALF)
    touching = shapely.union_all(flush).intersection(sole)
    support = sole if contact.support is None else shapely.Polygon(contact.support)
    assert touching.convex_hull.symmetric_difference(support).area < 1e-8
    assert all(v[:, 2].max() < 3.1e-3 or shapely.Polygon(v[:, :2]).intersection(sole).area < 1e-9 for v in seen)


def test_a_sole_moves_to_where_more_of_it_is_supported():
    packed = ground(plate((0.0, 0.12), (-0.06, 0.06)))
    placed, supports = no_placements(1), no_supports(1)
    at = np.array([[0.1, 0.03, 0.0]])
    rest_feet(packed, 0, at, np.ones(1, bool), ANY, patch_shape(FOOT), 0.08, placed, supports)
    assert supports.corners[0, : supports.count[0], 0].max() == pytest.approx(0.06, abs=1e-3)
    assert at[0] == pytest.approx([0.06, 0.0, 0.0], abs=2e-2)
    assert placed.p[0, :2] == pytest.approx(at[0, :2])


@pytest.mark.parametrize("rise", [0.01, 0.02, -0.03])
@pytest.mark.parametrize("yaw", [0.0, 0.3])
def test_on_two_bars_of_different_height_a_sole_leans_on_their_edges(rise, yaw):
    """The plane goes through the edges that are farthest apart and touch first, and nothing of either bar is above it."""
    bars = [plate((-0.06, -0.055), WIDE), plate((0.055, 0.06), WIDE, rise)]
    contact = rest(*bars, at=(0.0, 0.0, yaw))
    low, high = (-0.06, 0.055) if rise > 0 else (-0.055, 0.06)
    slope = np.arctan2(rise, high - low)
    assert contact.R_WC[:, 2] == pytest.approx([-np.sin(slope), 0.0, np.cos(slope)], abs=1e-6)
    corners = contact.p_WC + contact.support @ contact.R_WC[:, :2].T
    edge = np.where(corners[:, 0] < 0, low, high)
    assert corners[:, 0] == pytest.approx(edge, abs=1e-3)
    assert corners[:, 2] == pytest.approx(np.where(corners[:, 0] < 0, 0.0, rise), abs=1e-5)
    assert all(((s.vertices - contact.p_WC) @ contact.R_WC[:, 2]).max() < 1e-5 for s in bars)
    assert contact.surface in (0, 1)


def test_a_sole_does_not_lean_where_it_would_tip_or_slide():
    assert rest(plate((0.05, 0.055), WIDE), plate((0.08, 0.085), WIDE, 0.02)) is None  # all of it before the middle
    assert rest(plate((-0.06, -0.055), WIDE), plate((0.055, 0.06), WIDE, 0.08)) is None  # 34 deg


@pytest.mark.parametrize("seed", [3, 8])
def test_a_sole_that_leans_touches_edges_of_plates_not_their_faces_with_its_own_rim(seed: int) -> None:
    """A rim on a face pushes along the face's normal; the sole's own normal, which its contact has, says otherwise."""
    terrain = load_scene("random_surfaces", seed=seed).terrain
    packed, rng, leaning = pack_terrain(terrain), np.random.default_rng(seed), 0
    for _ in range(4000):
        place = rng.uniform([0.4, -0.5, -0.5], [3.5, 0.5, 0.5])
        contact = rest_down(packed, FOOT, place, ANY)
        if contact is None or contact.R_WC[:, 2] @ terrain.surfaces[contact.surface].normal > 1 - 1e-6:
            continue
        leaning += 1
        for corner in contact.support:
            p_W = contact.p_WC + contact.R_WC[:, :2] @ corner
            assert min(off_edges(s.vertices, p_W) for s in terrain.surfaces) < 3e-3
    assert leaning > 0


def off_edges(polygon: np.ndarray, p_W: np.ndarray) -> float:
    """Distance of a point from the edges of a polygon (K, 3) [m]."""
    a, b = p_W - polygon, np.roll(polygon, -1, axis=0) - polygon
    share = np.clip((a * b).sum(axis=1) / (b * b).sum(axis=1), 0.0, 1.0)
    return float(np.linalg.norm(a - share[:, None] * b, axis=1).min())
