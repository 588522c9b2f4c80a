"""What plans leave unused: supports drawn in about their middle, friction lowered, in balance and in the programs."""

from __future__ import annotations

import numpy as np
import pytest
import shapely
from hypothesis import given
from hypothesis import strategies as st

from optimization.balance.balance_regions import balance_polygon, contact_arrays
from optimization.balance.friction import FrictionCone
from optimization.balance.reserve import ALL, USUAL, Reserve
from optimization.centroidal.contact_schedule import ContactSchedule
from optimization.centroidal.options import CentroidalOptions
from optimization.centroidal.problem import CentroidalProblem
from optimization.centroidal.program import CentroidalProgram
from scenes.contact import Contact, contact_pose, patch_corners, support_corners
from scenes.input_error import InputError
from scenes.robots.robot import load_robot

ROBOT = load_robot("escher")
HALF = np.array(ROBOT.effectors[0].half_extent)
TRIANGLE = np.array([[0.1, 0.04], [-0.05, 0.04], [0.1, -0.03]])


def sole(effector: str, y: float, tilt: float = 0.0, support: np.ndarray | None = None) -> Contact:
    normal = np.array([np.sin(tilt), 0.0, np.cos(tilt)])
    return Contact(effector, 0, contact_pose(effector, np.array([0.0, y, 0.0]), normal, 0.0), 0.5, 0.0, support)


def polygon(contacts: list[Contact], reserve: Reserve) -> shapely.Polygon:
    return shapely.Polygon(balance_polygon(contact_arrays(contacts, ROBOT, FrictionCone.INNER, reserve)))


@given(st.floats(0.05, 1.0))
def test_a_level_sole_balances_over_its_drawn_in_support(share: float) -> None:
    found = polygon([sole("left_foot", 0.1)], Reserve(pressure=share))
    wanted = shapely.Polygon(share * patch_corners(HALF) + [0.0, 0.1])
    assert found.symmetric_difference(wanted).area < 1e-9


def test_corners_that_are_repeated_do_not_move_the_middle() -> None:
    """Supports of fewer corners than others repeat their last one."""
    padded = support_corners([sole("left_foot", 0.0, 0.0, TRIANGLE), sole("right_foot", 0.0)], ROBOT.half_extents)
    drawn_in = USUAL.supports(padded)
    middle = TRIANGLE.mean(axis=0)
    assert np.allclose(drawn_in[0, :3], middle + USUAL.pressure * (TRIANGLE - middle))
    assert np.allclose(drawn_in[0, 3], drawn_in[0, 2])
    assert np.allclose(drawn_in[1], USUAL.pressure * patch_corners(HALF))
    assert ALL.supports(padded) is padded


@given(st.floats(-0.3, 0.3), st.floats(-0.3, 0.3))
def test_what_balances_with_a_reserve_balances_without(left: float, right: float) -> None:
    contacts = [sole("left_foot", 0.15, left), sole("right_foot", -0.15, right)]
    assert polygon(contacts, USUAL).difference(polygon(contacts, ALL)).area < 1e-9


def test_a_slope_between_both_cones_holds_a_foot_only_without_the_reserve() -> None:
    steep = [sole("left_foot", 0.1, np.arctan(0.95 * 0.5))]
    assert not polygon(steep, ALL).is_empty
    assert polygon(steep, Reserve(friction=0.9)).is_empty


def test_a_program_keeps_the_reserve() -> None:
    """Sideways over one foot and back: without the reserve the pressure goes to the rim."""
    feet = (sole("left_foot", 0.1), sole("right_foot", -0.1))
    rows = [(*feet, None, None)] * 5 + [(feet[0], None, None, None)] * 5 + [(*feet, None, None)] * 5
    problem = CentroidalProblem(
        ContactSchedule.from_rows(rows, 0.2), ROBOT.mass, ROBOT.half_extents, np.array([0.0, 0.0, 0.9])
    )
    used = {}
    for reserve in (ALL, USUAL):
        answer = CentroidalProgram(problem, CentroidalOptions(reserve=reserve)).solve()
        assert answer.feasible, answer.reason
        t = answer.trajectory
        held = t.contact >= 0
        force = t.force_W[held]
        assert (np.hypot(force[:, 0], force[:, 1]) <= reserve.friction * 0.5 * force[:, 2] + 1e-6).all()
        loaded = held & (t.force_W[..., 2] > 1.0)
        used[reserve] = np.abs(t.cop_C[loaded] / HALF).max()
        assert used[reserve] <= reserve.pressure + 1e-4
    assert used[ALL] > USUAL.pressure  # else the case says nothing


@pytest.mark.parametrize("bad", [{"friction": 0.0}, {"friction": 1.1}, {"pressure": -0.1}, {"support": 2.0}])
def test_a_share_that_cannot_be_is_refused(bad: dict[str, float]) -> None:
    with pytest.raises(InputError, match=f"reserve: {next(iter(bad))}"):
        Reserve(**bad)
