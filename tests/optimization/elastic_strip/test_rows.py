"""What a strip is told of its configurations: distances against brute force, derivatives against differences."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from optimization.balance.balance_regions import BalancePolygons, balance_region, edge_rows
from optimization.elastic_strip.check import frame_error, rotation_about
from optimization.elastic_strip.clearance import WITHIN, axis_to_polygon
from optimization.elastic_strip.rows import StripRows, linearise, make_strip_rows
from optimization.inverse_kinematics.whole_body_ik import WholeBodyIK
from scenes.contact import Contact, contact_heading, contact_pose
from scenes.library.plates import rectangle, tilted_plate
from scenes.pose import rpy_rotation
from scenes.robots.plant import nominal_posture
from scenes.robots.robot import load_robot
from scenes.terrain.packed_terrain import pack_terrain
from scenes.terrain.terrain import terrain_from

ROBOT = load_robot("escher")
STONES = terrain_from([
    tilted_plate("ground", (0.0, 0.0, -0.01), rectangle(2.0, 2.0), 0.0, 0.0),
    tilted_plate("block", (0.22, 0.1, 0.3), rectangle(0.3, 0.3), 0.4, -0.9),
])  # fmt: skip


def nearest_by_sampling(surface_vertices: np.ndarray, normal: np.ndarray, a: np.ndarray, b: np.ndarray) -> float:
    """Distance of a segment from a convex polygon by looking at many of its points."""
    s = np.linspace(0.0, 1.0, 4001)[:, None]
    points = a + s * (b - a)
    edges = np.roll(surface_vertices, -1, axis=0) - surface_vertices
    inward = np.cross(normal, edges)
    over = (((points[:, None] - surface_vertices) * inward).sum(axis=2) >= 0.0).all(axis=1)
    best = np.where(over, np.abs((points - surface_vertices[0]) @ normal), np.inf).min()
    for v, e in zip(surface_vertices, edges, strict=True):
        t = np.clip(((points - v) @ e) / (e @ e), 0.0, 1.0)
        best = min(best, np.linalg.norm(points - v - t[:, None] * e, axis=1).min())
    return float(best)


def is_over(vertices: np.ndarray, normal: np.ndarray, x: np.ndarray) -> bool:
    """Whether a point lies straight above or below a convex polygon, along its normal."""
    inward = np.cross(normal, np.roll(vertices, -1, axis=0) - vertices)
    return bool((((x - vertices) * inward).sum(axis=1) >= 0.0).all())


def is_inside_the_plate(vertices: np.ndarray, normal: np.ndarray, a: np.ndarray, b: np.ndarray) -> bool:
    """Whether a segment passes through a convex polygon, or its deeper end lies behind the face, at most `WITHIN` deep."""
    height_a, height_b = (np.array([a, b]) - vertices[0]) @ normal
    low, high = min(height_a, height_b), max(height_a, height_b)
    deep = a if height_a < height_b else b
    if low < 0.0 < high and is_over(vertices, normal, a + height_a / (height_a - height_b) * (b - a)):
        return True
    return -WITHIN < low < 0.0 and is_over(vertices, normal, deep)


@settings(max_examples=200, deadline=None)
@given(st.integers(0, 100_000))
def test_the_distance_of_an_axis_from_a_polygon_is_the_least_over_its_points_and_negative_inside_the_plate(
    seed: int,
) -> None:
    rng = np.random.default_rng(seed)
    packed = pack_terrain(terrain_from([tilted_plate("stone", (0, 0, 0), rectangle(0.4, 0.3), *rng.uniform(-1, 1, 3))]))
    a, b = rng.uniform(-0.4, 0.4, (2, 3))
    if seed % 2:  # near the plane and almost along it, where an end may lie just behind the face
        a, b = (x - 0.8 * (x @ packed.normal[0]) * packed.normal[0] for x in (a, b))
    point, normal = np.empty(3), np.empty(3)
    distance = axis_to_polygon(packed, 0, a, b, point, normal)
    sampled = nearest_by_sampling(packed.vertices[0, :4], packed.normal[0], a, b)
    assert np.linalg.norm(normal) == pytest.approx(1.0)
    heights = (np.array([a, b]) @ packed.normal[0]) - packed.offset[0]
    assert (distance < 0.0) == is_inside_the_plate(packed.vertices[0, :4], packed.normal[0], a, b)
    if distance >= 0.0:
        # A sample lies at most half a spacing from the nearest point, where the distance grows by less than that.
        assert distance - 1e-12 <= sampled <= distance + 0.5 * np.linalg.norm(b - a) / 4000
    else:  # the way out along the normal is that of its deepest point
        np.testing.assert_array_equal(normal, packed.normal[0])
        assert distance == pytest.approx(heights.min())
        assert min(np.linalg.norm(point - x) for x in (a, b)) == 0.0


@pytest.mark.parametrize(("height", "expected", "up"), [(0.05, 0.05, 1), (-0.01, -0.01, 1), (-0.1, 0.1, -1)])
def test_what_is_just_behind_a_face_is_pushed_out_of_it_and_what_is_far_behind_away(
    height: float, expected: float, up: int
) -> None:
    packed = pack_terrain(terrain_from([tilted_plate("plate", (0, 0, 0), rectangle(1.0, 1.0), 0, 0)]))
    point, normal = np.empty(3), np.empty(3)
    a, b = np.array([0.0, 0.0, height]), np.array([0.1, 0.0, height])
    assert axis_to_polygon(packed, 0, a, b, point, normal) == pytest.approx(expected)
    assert normal[2] == pytest.approx(up)


def rows_at(ik: WholeBodyIK, q: np.ndarray, air: np.ndarray) -> StripRows:
    rows = make_strip_rows(len(q), 4, q.shape[1] - 1)
    links = {int(link): e for e, link in enumerate(ik.model.tree.frame_link[:4])}
    effector_of = np.array([links.get(int(link), -1) for link in ik.model.capsules.link], np.int64)
    linearise(ik.model.tree, ik.model.capsules, pack_terrain(STONES), effector_of, q, air, 0.01, 0.02, rows)
    return rows


@pytest.mark.parametrize("seed", range(4))
def test_every_derivative_is_that_of_central_differences(seed: int) -> None:
    ik, rng = WholeBodyIK(ROBOT), np.random.default_rng(seed)
    q = np.array(nominal_posture(ROBOT))
    q[7:] += rng.uniform(-0.25, 0.25, len(q) - 7)
    air, h, nv = np.ones((1, 4), bool), 1e-6, len(q) - 1
    here = rows_at(ik, q[None], air)
    assert here.count[0] > 2
    compared = 0
    for i in range(nv):
        v = np.zeros(nv)
        v[i] = h
        ahead, behind = (rows_at(ik, ik.kinematics.integrate(q, v, sign)[None], air) for sign in (1.0, -1.0))
        np.testing.assert_allclose((ahead.com - behind.com)[0, :2] / (2 * h), here.J_com[0, :, i], atol=1e-6)
        np.testing.assert_allclose((ahead.p_WE - behind.p_WE)[0] / (2 * h), here.J_E[0, :, 3:, i], atol=1e-6)
        if ahead.count[0] == behind.count[0] == here.count[0]:
            m = int(here.count[0])
            slope = (ahead.gap - behind.gap)[0, :m] / (2 * h)
            # Where the nearest point jumps from one corner to another there is no derivative.
            smooth = np.abs(ahead.gap + behind.gap - 2 * here.gap)[0, :m] < 1e-9
            assert smooth.sum() > 0.6 * m
            compared += 1
            np.testing.assert_allclose(slope[smooth], here.J_gap[0, :m, i][smooth], atol=1e-4)
    assert compared > 0.8 * nv


def test_a_foot_on_the_ground_is_looked_at_only_when_it_should_be_in_the_air() -> None:
    ik = WholeBodyIK(ROBOT)
    q = np.array(nominal_posture(ROBOT))[None]
    held, lifted = (rows_at(ik, q, np.full((1, 4), air)) for air in (False, True))
    assert lifted.count[0] > held.count[0]


@given(st.tuples(*[st.floats(-0.6, 0.6)] * 2), st.floats(-3.0, 3.0))
def test_the_heading_of_a_contact_can_be_read_off_its_frame(tilt: tuple[float, float], heading: float) -> None:
    normal = rpy_rotation([*tilt, 0.0])[:, 2]
    found = contact_heading(contact_pose("left_foot", np.zeros(3), normal, heading))
    assert np.cos(found - heading) == pytest.approx(1.0, abs=1e-9)


@given(st.tuples(*[st.floats(-1.5, 1.5)] * 3))
def test_the_error_between_frames_is_the_rotation_that_takes_one_to_the_other(w: tuple[float, float, float]) -> None:
    R, X_WB = rpy_rotation([0.3, -0.2, 0.9]), np.eye(4)
    X_WB[:3, :3], X_WB[:3, 3] = rotation_about(np.array(w)) @ R, [1.0, 2.0, 3.0]
    error = frame_error(R, np.array([0.5, 2.0, 3.0]), X_WB)
    np.testing.assert_allclose(error, [*w, 0.5, 0.0, 0.0], atol=1e-7)


def test_edges_are_drawn_in_by_the_margin_or_less_where_the_polygon_is_narrow() -> None:
    square = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]])
    normal, bound = edge_rows(square, 0.1)
    np.testing.assert_allclose(normal @ [0.5, 0.5] - bound, -0.4)
    normal, bound = edge_rows(square * [1.0, 0.02], 0.1)
    np.testing.assert_allclose((normal @ [0.5, 0.01] - bound).max(), -0.01 * 0.6)
    assert len(edge_rows(square[:2], 0.1)[1]) == 0


def test_polygons_follow_the_contacts_that_they_belong_to() -> None:
    contacts = [
        Contact(
            f"{side}_foot",
            0,
            contact_pose(f"{side}_foot", np.array([0.0, y, 0.0]), np.array([0.0, 0.0, 1.0]), 0.0),
            0.5,
        )
        for side, y in (("left", 0.1), ("right", -0.1))
    ]
    polygons = BalancePolygons(ROBOT, contacts, "inner")
    before = polygons(np.array([0, 1, -1, -1]))
    expected = balance_region(contacts, ROBOT, "inner")
    np.testing.assert_allclose(before.min(axis=0), expected.min(axis=0), atol=1e-4)
    shift = np.array([c.X_WC for c in contacts])
    shift[:, 0, 3] += 0.3
    polygons.move(shift)
    after = polygons(np.array([0, 1, -1, -1])).mean(axis=0)
    np.testing.assert_allclose(after, before.mean(axis=0) + np.array([0.3, 0.0]), atol=1e-6)
    assert len(polygons(np.full(4, -1))) == 0
