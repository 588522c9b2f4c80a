"""The figures of the crossings against closed forms, and what Drake's inverse kinematics says of strides."""

from __future__ import annotations

import numpy as np
import pytest

from drakeplan.bench.crossings import DEADLINE, Crossing, can_span, cross, crossings, longest_time
from drakeplan.timing.step_timing import Timing
from optimization.inverse_kinematics.whole_body_ik import WholeBodyIK
from scenes.library import flat, wide_gap, wider_gap
from scenes.robots.robot import load_robot

ROBOT = load_robot("escher")
SOLE = 0.22  # [m]


def test_the_published_gap_is_possible_standing_still_over_either_foot() -> None:
    assert all(can_span(ROBOT, wide_gap.GAP + SOLE, over) for over in (0, 1))


def test_the_wider_gap_is_not_but_legs_reach_that_far() -> None:
    stride = wider_gap.GAP + SOLE
    assert not can_span(ROBOT, stride, 0)
    assert not can_span(ROBOT, stride, 1)
    assert can_span(ROBOT, stride, None)


def test_nobody_is_hurried_where_friction_holds_and_a_free_fall_takes_its_time() -> None:
    assert longest_time(np.arctan(0.5) - 1e-9, 3.0) == np.inf
    assert longest_time(np.pi / 2, 3.0) == pytest.approx(np.sqrt(2 * 3.0 / 9.81))
    assert longest_time(np.deg2rad(30), 3.0) == pytest.approx(np.sqrt(6.0 / (9.81 * (0.5 - 0.5 * np.sqrt(0.75)))))


def test_both_published_scenes_are_asked_of_every_kind_of_planner() -> None:
    asked = {(c.name, c.dynamics) for c in crossings()}
    assert {("wide_gap", d) for d in ("quasi-static", "learned", "exact")} < asked
    assert {("steep_slope", d) for d in ("quasi-static", "exact")} < asked
    assert ("steep_slope", "exact", "diamond") in {(c.name, c.dynamics, c.cone) for c in crossings()}


def test_a_row_says_what_was_verified_and_why_not() -> None:
    ik = WholeBodyIK(ROBOT)
    walk = Crossing(flat.named(), "flat", "quasi-static", "inner", Timing())
    row = cross(walk, ROBOT, ik)
    assert row[:4] == ("flat", "quasi-static", "inner", "1 + 1")
    assert 0 < row[4] < DEADLINE
    assert row[6] > 4
    assert row[8] == "yes"
    gap = Crossing(wider_gap.named(gap=1.5), "gap", "quasi-static", "inner", Timing())
    assert str(cross(gap, ROBOT, ik, deadline=0.2)[8]).startswith("no: ")
