"""Static equilibrium: closed forms, invariants, and two slow twins (HiGHS here, Drake's Clp in the program)."""

import itertools
from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from scipy.optimize import linprog
from scipy.spatial.transform import Rotation

from optimization.balance.balance_regions import balance_region, contact_arrays
from optimization.balance.friction import CONES, cone_generators, cone_rows, corner_points
from optimization.balance.reference_program import StaticEquilibriumProgram
from optimization.balance.static_equilibrium import ContactArrays, com_polygon, is_balanced, polygon_margin
from scenes.contact import Contact, contact_pose, patch_corners
from scenes.effector import EFFECTORS
from scenes.input_error import InputError

FOOT, PALM = (0.11, 0.05), (0.045, 0.045)
UP = np.array([0.0, 0.0, 1.0])
EXACT = 1e-9  # the simplex works to 1e-9 M g
LP_TOL = 1e-7  # HiGHS and Clp hold their rows to this; nearer to the boundary their verdict says nothing
ROBOT = SimpleNamespace(
    effectors=tuple(SimpleNamespace(name=e, half_extent=FOOT if e.endswith("foot") else PALM) for e in EFFECTORS),
    force_limit=np.array([2.0, 2.0, 0.6, 0.6]),
)


def polygon(arrays, room=256):
    out = np.empty((room, 2))
    return out[: com_polygon(*arrays, out)]


def arrays_of(p_WC, R_WC, half, mu, limit, cone="inner"):
    n = len(p_WC)
    mu, limit = np.broadcast_to(mu, n), np.broadcast_to(np.asarray(limit, float), n).copy()
    corners = patch_corners(np.broadcast_to(np.asarray(half, float), (n, 2)))
    generators = np.array([cone_generators(cone, m) for m in mu])
    return ContactArrays(np.array(p_WC, float), np.array(R_WC, float).reshape(n, 3, 3), corners, generators, limit)


def random_contacts(rng, n, tilt=0.35):
    """Two feet on tilted stones, then palms on walls to the side: the stances that the planner asks about."""
    feet = [[0.0, 0.1, 0.0], [rng.uniform(-0.35, 0.35), rng.uniform(-0.35, -0.1), rng.uniform(-0.2, 0.2)]]
    contacts = []
    for effector, point in zip(EFFECTORS[:2], feet, strict=True):
        normal = Rotation.from_euler("xy", rng.uniform(-tilt, tilt, 2)).as_matrix()[:, 2]
        contacts.append((effector, point, normal, rng.uniform(-0.4, 0.4)))
    for effector in EFFECTORS[2:n]:
        side = 1.0 if effector == "left_palm" else -1.0
        point = [rng.uniform(0.0, 0.5), side * rng.uniform(0.35, 0.7), rng.uniform(0.9, 1.4)]
        normal = np.array([rng.uniform(-0.5, 0.1), -side, rng.uniform(-0.2, 0.4)])
        contacts.append((effector, point, normal / np.linalg.norm(normal), 0.0))
    friction = rng.uniform(0.3, 0.8)
    return [Contact(e, 0, contact_pose(e, p, normal, yaw), friction) for e, p, normal, yaw in contacts]


class Highs:
    """The same question as a linear program over columns that are stored, for HiGHS."""

    def __init__(self, arrays):
        self.origin = arrays.p_WC.mean(axis=0)
        columns = []
        for p, R, corners, cone in zip(*arrays[:4], strict=True):
            for corner in corners:
                for ray in cone:
                    f, arm = R @ ray, p - self.origin + R[:, :2] @ corner
                    columns.append([*f, *np.cross(arm, f)])
        self.A = np.array(columns).T
        per_contact = self.A.shape[1] // len(arrays.p_WC)
        self.per_limit = np.kron(np.eye(len(arrays.p_WC)), np.ones(per_contact))
        self.limit = arrays.force_limit

    def _solve(self, cost, rows, right):
        return linprog(cost, A_eq=rows, b_eq=right, A_ub=self.per_limit, b_ub=self.limit, method="highs")

    def is_balanced(self, xy):
        x, y = np.asarray(xy) - self.origin[:2]
        return self._solve(np.zeros(self.A.shape[1]), self.A, [0, 0, 1, y, -x, 0]).status == 0

    def reach(self, direction):
        """How far the centre of mass can lean in a direction; None if the contacts hold nowhere."""
        cost = -(direction[0] * -self.A[4] + direction[1] * self.A[3])
        answer = self._solve(cost, self.A[[0, 1, 2, 5]], [0, 0, 1, 0])
        return None if answer.status else -answer.fun + direction @ self.origin[:2]


def unit(angle):
    return np.array([np.cos(angle), np.sin(angle)])


def same_polygon(a, b, atol):
    """Whether two convex polygons reach equally far in 64 directions."""
    u = np.array([unit(t) for t in np.linspace(0, 2 * np.pi, 64, endpoint=False)])
    return np.allclose((a @ u.T).max(axis=0), (b @ u.T).max(axis=0), atol=atol)


# Closed forms -------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("cone", CONES)
def test_one_flat_foot_supports_exactly_its_own_rectangle(cone):
    R = Rotation.from_euler("z", 0.7).as_matrix()
    region = polygon(arrays_of([[3.0, -2.0, 0.4]], R, FOOT, 0.5, 2.0, cone))
    corners = (corner_points(FOOT) @ R.T)[:, :2] + [3.0, -2.0]
    assert len(region) == 4
    assert max(np.linalg.norm(region - c, axis=1).min() for c in corners) < EXACT


def test_two_flat_feet_at_one_height_support_the_hull_of_their_rectangles():
    p = np.array([[0.0, 0.1, 0.0], [0.05, -0.1, 0.0]])
    region = polygon(arrays_of(p, [np.eye(3)] * 2, FOOT, 0.5, 2.0))
    points = np.concatenate([corner_points(FOOT) + c for c in p])[:, :2]
    assert same_polygon(region, points, EXACT)
    assert len(region) == 6


def test_flat_feet_at_different_heights_support_at_least_the_hull_that_they_support_on_one_floor():
    p = np.array([[0.0, 0.1, 0.0], [0.3, -0.1, 0.2]])
    low = polygon(arrays_of(p * [1, 1, 0], [np.eye(3)] * 2, FOOT, 0.5, 2.0))
    high = polygon(arrays_of(p, [np.eye(3)] * 2, FOOT, 0.5, 2.0))
    assert len(low)
    assert all(polygon_margin(high, len(high), *v) > -EXACT for v in low)


@pytest.mark.parametrize(("height", "reach"), [(0.0, 0.1), (0.2, 0.1), (0.6, 0.15)])
def test_two_points_hold_beyond_themselves_where_friction_times_height_exceeds_their_distance(height, reach):
    """x = n1 x1 + n2 x2 + h f with |f| <= mu min(n1, n2) and n1 + n2 = 1: |x| <= max(d, mu h / 2), 2 d apart."""
    region = polygon(arrays_of([[-0.1, 0, 0], [0.1, 0, height]], [np.eye(3)] * 2, (0.0, 0.0), 0.5, 2.0))
    assert np.allclose([region[:, 0].min(), region[:, 0].max()], [-reach, reach], atol=EXACT)
    assert np.allclose(region[:, 1], 0.0, atol=EXACT)


@settings(deadline=None)
@given(cone=st.sampled_from(CONES), mu=st.floats(0.1, 1.0), tilt=st.floats(0.0, 0.9), yaw=st.floats(-3.1, 3.1))
def test_a_foot_on_a_slope_holds_exactly_while_the_vertical_is_in_its_cone(cone, mu, tilt, yaw):
    R = Rotation.from_euler("yz", [tilt, yaw]).as_matrix()
    R = R @ Rotation.from_euler("z", -yaw / 2).as_matrix()
    outside = (cone_rows(cone, mu) @ R.T @ UP).max()
    if abs(outside) > 1e-6:
        assert (len(polygon(arrays_of([[0, 0, 0]], R, FOOT, mu, 2.0, cone))) > 0) == (outside < 0)


def test_a_foot_carries_nothing_beyond_its_force_limit():
    level = [[0.0, 0.0, 0.0]], np.eye(3), FOOT, 0.5
    assert len(polygon(arrays_of(*level, 1.0 + 1e-6))) == 4
    assert len(polygon(arrays_of(*level, 1.0 - 1e-6))) == 0


def test_two_feet_that_may_carry_60_percent_each_keep_the_load_between_them():
    """With point contacts at x = 0 and 1 the load share of the second is x itself: 0.4 <= x <= 0.6."""
    region = polygon(arrays_of([[0, 0, 0], [1, 0, 0]], [np.eye(3)] * 2, (0.0, 0.0), 0.5, 0.6))
    assert np.allclose(np.sort(region[:, 0]), [0.4, 0.6], atol=EXACT)
    assert len(region) == 2


def test_a_single_point_contact_supports_a_point_and_a_line_contact_a_segment():
    assert np.allclose(polygon(arrays_of([[1, 2, 3]], np.eye(3), (0, 0), 0.5, 2.0)), [[1, 2]], atol=EXACT)
    segment = polygon(arrays_of([[1, 2, 3]], np.eye(3), (0.1, 0), 0.5, 2.0))
    assert np.allclose(segment[np.argsort(segment[:, 0])], [[0.9, 2], [1.1, 2]], atol=EXACT)


def chimney(limit, half=PALM, mu=1.0):
    """Two palms pressing outwards on walls that face each other, one metre apart."""
    walls = [
        contact_pose("left_palm", [0, 0.5, 1], np.array([0, -1.0, 0]), 0.0),
        contact_pose("right_palm", [0, -0.5, 1], np.array([0, 1.0, 0]), 0.0),
    ]
    return arrays_of([X[:3, 3] for X in walls], [X[:3, :3] for X in walls], half, mu, limit)


def test_walls_facing_each_other_hold_a_robot_only_by_squeezing_hard_enough():
    """Each wall rubs mu N, so 2 mu N >= 1."""
    assert len(polygon(chimney(0.5 - 1e-6))) == 0
    assert len(polygon(chimney(0.5 + 1e-6))) > 0
    wide = polygon(chimney(5.0))
    assert np.isfinite(wide).all()
    assert np.ptp(wide[:, 1]) > 1.0  # beyond the walls themselves: bounded by the force limit alone


def test_a_ceiling_and_a_frictionless_slope_hold_nothing():
    upside_down = np.diag([1.0, -1.0, -1.0])
    assert len(polygon(arrays_of([[0, 0, 2]], upside_down, FOOT, 0.5, 2.0))) == 0
    slope = Rotation.from_euler("y", 0.2).as_matrix()
    assert len(polygon(arrays_of([[0, 0, 0]], slope, FOOT, 0.0, 2.0))) == 0
    assert len(polygon(arrays_of([[0, 0, 0]], np.eye(3), FOOT, 0.0, 2.0))) == 4


def test_two_frictionless_slopes_leaning_on_each_other_hold_along_a_line():
    """A V-groove of point contacts: the normals' lines meet above the middle, and weight must pass there."""
    groove = [Rotation.from_euler("x", a).as_matrix() for a in (0.4, -0.4)]
    points, load = [[0, -0.3, 0], [0, 0.3, 0]], 0.5 / np.cos(0.4)  # [M g] on each normal: 2 load cos 0.4 = M g
    assert np.allclose(polygon(arrays_of(points, groove, (0.0, 0.0), 0.0, load + 1e-6)), [[0.0, 0.0]], atol=EXACT)
    assert len(polygon(arrays_of(points, groove, (0.0, 0.0), 0.0, load - 1e-6))) == 0


# Invariants ---------------------------------------------------------------------------------------------------------

SEEDS = st.integers(0, 10**6)


@settings(deadline=None)
@given(seed=SEEDS, n=st.integers(1, 4), yaw=st.floats(-3, 3), shift=st.tuples(*[st.floats(-5, 5)] * 3))
def test_turning_and_shifting_the_world_turns_and_shifts_the_region(seed, n, yaw, shift):
    here = contact_arrays(random_contacts(np.random.default_rng(seed), n), ROBOT, "inner")
    Rz = Rotation.from_euler("z", yaw).as_matrix()
    there = here._replace(p_WC=here.p_WC @ Rz.T + shift, R_WC=Rz @ here.R_WC)
    a, b = polygon(here), polygon(there)
    assert (len(a) == 0) == (len(b) == 0)
    assume(len(a) > 0)
    assert same_polygon(a @ Rz[:2, :2].T + shift[:2], b, 1e-7)


@settings(deadline=None)
@given(seed=SEEDS, n=st.integers(1, 4), scale=st.floats(0.2, 5.0))
def test_scaling_every_length_scales_the_region(seed, n, scale):
    here = contact_arrays(random_contacts(np.random.default_rng(seed), n), ROBOT, "square")
    a, b = polygon(here), polygon(here._replace(p_WC=here.p_WC * scale, corners=here.corners * scale))
    assert (len(a) == 0) == (len(b) == 0)
    assume(len(a) > 0)
    assert same_polygon(a * scale, b, 1e-7)


@settings(deadline=None)
@given(seed=SEEDS, n=st.integers(2, 4), cone=st.sampled_from(CONES))
def test_another_contact_never_shrinks_the_region(seed, n, cone):
    contacts = random_contacts(np.random.default_rng(seed), n, tilt=0.4)
    few, more = balance_region(contacts[:-1], ROBOT, cone), balance_region(contacts, ROBOT, cone)
    assume(len(few) > 0)
    assert all(polygon_margin(more, len(more), *v) > -1e-8 for v in few)


@settings(deadline=None)
@given(seed=SEEDS, n=st.integers(1, 4))
def test_a_larger_cone_gives_a_larger_region(seed, n):
    contacts = random_contacts(np.random.default_rng(seed), n)
    regions = [balance_region(contacts, ROBOT, cone) for cone in ("inner", "second_order", "diamond")]
    assume(len(regions[0]) > 0)
    for small, large in itertools.pairwise(regions):
        assert all(polygon_margin(large, len(large), *v) > -1e-8 for v in small)


@settings(deadline=None)
@given(seed=SEEDS, n=st.integers(1, 4), cone=st.sampled_from(CONES))
def test_regions_are_strictly_convex_counter_clockwise_and_bounded_by_queries(seed, n, cone):
    rng = np.random.default_rng(seed)
    arrays = contact_arrays(random_contacts(rng, n), ROBOT, cone)
    region = polygon(arrays)
    assume(len(region) > 2)
    edge = np.roll(region, -1, axis=0) - region
    assert (edge[:, 0] * np.roll(edge[:, 1], -1) - edge[:, 1] * np.roll(edge[:, 0], -1) > 0).all()
    middle = region.mean(axis=0)
    for vertex in region:
        outwards = (vertex - middle) / np.linalg.norm(vertex - middle)
        assert is_balanced(*arrays, vertex - 1e-7 * outwards)
        assert not is_balanced(*arrays, vertex + 1e-6 * outwards)
    inside = rng.dirichlet(np.ones(len(region))) @ region
    assert is_balanced(*arrays, inside)


@settings(deadline=None)
@given(seed=SEEDS, room=st.integers(1, 12))
def test_a_polygon_cut_to_fewer_vertices_lies_inside_the_whole_one(seed, room):
    arrays = contact_arrays(random_contacts(np.random.default_rng(seed), 4), ROBOT, "inner")
    whole, cut = polygon(arrays), polygon(arrays, room)
    assert 1 <= len(cut) <= room < len(whole)
    assert all(polygon_margin(whole, len(whole), *v) > -EXACT for v in cut)
    nearly = polygon(arrays, 32)
    assert max(-polygon_margin(nearly, len(nearly), *v) for v in whole) < 0.01


@pytest.mark.parametrize("field", range(5))
def test_a_number_that_is_not_finite_is_never_balanced(field):
    for bad in (np.nan, np.inf):
        arrays = ContactArrays(*(a.copy() for a in arrays_of([[0, 0, 0]], np.eye(3), FOOT, 0.5, 2.0)))
        assert is_balanced(*arrays, np.zeros(2))
        arrays[field].flat[0] = bad
        assert not is_balanced(*arrays, np.zeros(2))
        assert len(polygon(arrays)) == 0
    level = arrays_of([[0, 0, 0]], np.eye(3), FOOT, 0.5, 2.0)
    assert not is_balanced(*level, np.array([np.nan, 0.0]))


def test_nothing_is_balanced_without_contacts():
    nothing = contact_arrays([], ROBOT)
    assert len(polygon(nothing)) == 0
    assert not is_balanced(*nothing, np.zeros(2))
    with pytest.raises(ValueError, match="without contacts"):
        StaticEquilibriumProgram([], ROBOT)


def test_margin_of_polygons_points_and_segments():
    square = np.array([[0.0, 0], [1, 0], [1, 1], [0, 1]])
    assert polygon_margin(square, 4, 0.5, 0.4) == pytest.approx(0.4)
    assert polygon_margin(square, 4, 2.0, 2.0) == pytest.approx(-np.sqrt(2))
    assert polygon_margin(square, 2, 0.5, 0.4) == pytest.approx(-0.4)
    assert polygon_margin(square, 1, 0.0, 0.4) == pytest.approx(-0.4)
    assert polygon_margin(square, 0, 0.0, 0.0) == -np.inf


# Slow twins ---------------------------------------------------------------------------------------------------------


def check_against_highs(n, count, cone="square"):
    """(disagreements away from the boundary, near it, balanced stances) of queries and of regions."""
    wrong, near, balanced = [], 0, 0
    for seed in range(count):
        rng = np.random.default_rng([n, seed])
        arrays = contact_arrays(random_contacts(rng, n, tilt=0.45), ROBOT, cone)
        region, highs = polygon(arrays), Highs(arrays)
        xy = arrays.p_WC[:2, :2].mean(axis=0) + rng.uniform(-0.25, 0.25, 2)
        ours, theirs = is_balanced(*arrays, xy), highs.is_balanced(xy)
        margin = polygon_margin(region, len(region), *xy)
        if abs(margin) < LP_TOL:
            near += 1
        elif not ours == theirs == (margin > 0):
            wrong.append((seed, ours, theirs, margin))
        balanced += ours
        direction = unit(rng.uniform(0, 2 * np.pi))
        reach = highs.reach(direction)
        if (reach is None) != (len(region) == 0):
            wrong.append((seed, "region", reach))
        elif reach is not None and abs((region @ direction).max() - reach) > LP_TOL:
            wrong.append((seed, "reach", (region @ direction).max() - reach))
    return wrong, near, balanced


@pytest.mark.parametrize("cone", CONES)
@pytest.mark.parametrize("n", [2, 3, 4])
def test_queries_and_regions_agree_with_highs(n, cone):
    wrong, near, balanced = check_against_highs(n, 40, cone)
    assert wrong == []
    assert near <= 1
    assert balanced > 0


@pytest.mark.slow
@pytest.mark.parametrize("n", [2, 3, 4])
def test_a_thousand_queries_and_regions_agree_with_highs(n):
    wrong, near, balanced = check_against_highs(n, 1000, "inner")
    assert wrong == []
    assert near <= 1
    assert 100 < balanced < 990


@pytest.mark.parametrize("cone", CONES)
def test_drake_program_states_the_same_problem(cone):
    for n in (1, 2, 3, 4):
        rng = np.random.default_rng(n)
        contacts = random_contacts(rng, n, tilt=0.2)
        program, region = StaticEquilibriumProgram(contacts, ROBOT, cone), balance_region(contacts, ROBOT, cone)
        assert len(region) > 0
        for _ in range(4):
            direction = unit(rng.uniform(0, 2 * np.pi))
            assert program.farthest(direction) @ direction == pytest.approx((region @ direction).max(), abs=LP_TOL)
            xy = region.mean(axis=0) + rng.uniform(-0.2, 0.2, 2)
            margin = polygon_margin(region, len(region), *xy)
            assert abs(margin) < LP_TOL or program.is_balanced(xy) == (margin > 0)


def test_drake_program_finds_nothing_where_nothing_holds():
    steep = Contact("left_foot", 0, contact_pose("left_foot", [0, 0, 0], np.array([0.6, 0, 0.8]), 0.0), 0.5)
    program = StaticEquilibriumProgram([steep], ROBOT)
    assert program.farthest(unit(0.3)) is None
    assert not program.is_balanced(np.zeros(2))
    assert len(balance_region([steep], ROBOT)) == 0
    with pytest.raises(ValueError, match="finite"):
        program.is_balanced(np.array([np.nan, 0.0]))


def test_an_unknown_cone_is_refused_by_name():
    with pytest.raises(InputError, match="octagon"):
        balance_region([], ROBOT, "octagon")
