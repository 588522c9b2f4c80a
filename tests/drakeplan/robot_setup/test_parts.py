"""The parts of a description that are plain geometry and plain words."""

from __future__ import annotations

import numpy as np
import pytest
import shapely
from humanoids import NAMINGS
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from drakeplan.robot_setup.limbs import mirror_name
from drakeplan.robot_setup.robot_file import frame_words
from drakeplan.robot_setup.soles import CUTS, largest_rectangle
from scenes.robots.urdf_pose import pose

ROUNDED = 1e-4  # [m, rad] frames are written with four digits


# ---- the largest rectangle in a convex outline


@st.composite
def outlines(draw: st.DrawFn) -> np.ndarray:
    """(V, 2) corners of a convex polygon about as large as a foot, counter-clockwise."""
    points = draw(
        hnp.arrays(float, (draw(st.integers(4, 12)), 2), elements=st.integers(-150, 150).map(lambda mm: mm / 1000))
    )
    hull = shapely.MultiPoint(points).convex_hull
    if not isinstance(hull, shapely.Polygon) or hull.area < 1e-4:
        hull = shapely.box(-0.1, -0.05, 0.1, 0.05)
    return np.array(shapely.geometry.polygon.orient(hull).exterior.coords)[:-1]


def slow_twin(polygon: np.ndarray) -> float:
    """Area of the largest rectangle along the axes: every pair of columns, its free height read off by shapely."""
    shape = shapely.Polygon(polygon)
    low, bottom, high, top = shape.bounds
    xs = np.linspace(low, high, CUTS // 3 + 1)  # every third place of the fast one's
    spans = []
    for x in xs:
        cut = shape.intersection(shapely.LineString([(x, bottom - 1), (x, top + 1)]))
        ys = (
            np.array(cut.coords)[:, 1]
            if isinstance(cut, shapely.LineString | shapely.Point) and not cut.is_empty
            else [0.0]
        )
        spans.append((min(ys), max(ys)))
    areas = [
        (b - a) * max(min(s[1], t[1]) - max(s[0], t[0]), 0.0)
        for i, (a, s) in enumerate(zip(xs, spans, strict=True))
        for b, t in list(zip(xs, spans, strict=True))[i + 1 :]
    ]
    return max(areas)


@given(outlines())
def test_the_largest_rectangle_lies_inside_and_none_of_a_coarser_search_is_larger(polygon: np.ndarray) -> None:
    low, high = largest_rectangle(polygon)
    found = shapely.box(*low, *high)
    assert shapely.Polygon(polygon).buffer(1e-7).contains(found)
    assert found.area >= slow_twin(polygon) - 1e-9


@given(outlines(), st.floats(-0.5, 0.5), st.sampled_from([0.5, 2.0]))
def test_the_largest_rectangle_moves_and_grows_with_the_outline(
    polygon: np.ndarray, shift: float, scale: float
) -> None:
    area = np.prod(np.diff(largest_rectangle(polygon), axis=0))
    moved = np.prod(np.diff(largest_rectangle(scale * polygon + shift), axis=0))
    assert moved == pytest.approx(scale**2 * area, rel=1e-3, abs=1e-9)


@pytest.mark.parametrize("turns", [0, 1, 2, 3])
def test_the_largest_rectangle_of_a_rectangle_is_all_of_it(turns: int) -> None:
    corners = np.roll(np.array([[-0.1, -0.04], [0.12, -0.04], [0.12, 0.05], [-0.1, 0.05]]), turns, axis=0)
    for order in (1, -1):
        np.testing.assert_allclose(largest_rectangle(corners[::order]), [[-0.1, -0.04], [0.12, 0.05]], atol=1e-12)


def test_the_largest_rectangle_of_a_triangle_has_half_its_area() -> None:
    low, high = largest_rectangle(np.array([[0.0, 0.0], [0.2, 0.0], [0.0, 0.1]]))
    assert np.prod(high - low) == pytest.approx(0.5 * 0.01, rel=1e-2)


# ---- names


@pytest.mark.parametrize("naming", NAMINGS)
@pytest.mark.parametrize("part", ["hip_yaw_link", "foot", "lower_leg", "elbow_roll", "finger_1"])
def test_a_name_of_the_left_leads_to_its_twin_and_not_back(naming: str, part: str) -> None:
    left, right = (NAMINGS[naming](s, part) for s in ("left", "right"))
    names = {left, right, "pelvis", "torso", "l", "r"}
    assert mirror_name(left, names) == right
    assert mirror_name(right, names) is None


@pytest.mark.parametrize("name", ["pelvis", "left_foot", "skull", "collar", "LL_ARM", "", "L", "l", "_", "leftleft"])
def test_a_name_without_a_twin_has_none(name: str) -> None:
    assert mirror_name(name, {name, "pelvis", "torso"}) is None


@pytest.mark.parametrize(
    ("left", "right"),
    [
        ("l_leg_l", "r_leg_r"), ("LLEG_LINK5", "RLEG_LINK5"), ("lHand", "rHand"), ("left_leg_left_toe", "right_leg_right_toe"),
        ("l_hand_l1", "r_hand_r1"), ("arm.l", "arm.r"), ("foot-L", "foot-R"), ("LeftToeBase", "RightToeBase"),
    ],
)  # fmt: skip
def test_the_spellings_of_well_known_models_are_read(left: str, right: str) -> None:
    assert mirror_name(left, {left, right}) == right


@given(st.text(max_size=20), st.sets(st.text(max_size=20), max_size=5))
def test_any_name_is_looked_up_without_an_error(name: str, names: set[str]) -> None:
    found = mirror_name(name, names | {name})
    assert found is None or (found in names and found != name)


# ---- frames


@given(st.lists(st.floats(-3.2, 3.2), min_size=3, max_size=3), st.booleans())
def test_the_words_of_a_frame_mean_its_pose(rpy: list[float], upright: bool) -> None:
    turn = np.array(rpy)
    if upright:  # a palm at the end of a hand often looks along z: pitch of a right angle
        turn[1] = np.copysign(0.5 * np.pi, turn[1])
    X = pose(np.array([0.12345, -0.2, 1e-7]), turn)
    words = frame_words("hand", X)
    np.testing.assert_allclose(pose(np.array(words.xyz), np.array(words.rpy)), X, atol=3 * ROUNDED)
    assert all(round(v, 4) == v for v in (*words.xyz, *words.rpy))
