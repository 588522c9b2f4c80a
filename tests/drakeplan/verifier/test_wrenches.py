"""Admissible wrenches, in closed form."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from drakeplan.verifier.geometry import patch
from drakeplan.verifier.wrenches import CONES, TRUE_CONE, Cone, corner_wrenches, distance_to_cones, wrench_distance

HALF = np.array([0.11, 0.05])  # [m] of a sole
MU = 0.5


def distance(f_C: list[float], cop: list[float], torque: float, cone: Cone = TRUE_CONE, mu: float = MU) -> float:
    one = [np.array([value], dtype=float) for value in (f_C, cop, torque, patch(HALF), mu)]
    return float(wrench_distance(cone, *one)[0])


@pytest.mark.parametrize("direction", np.deg2rad([0.0, 17.0, 45.0, 100.0]))
def test_a_block_slides_where_the_slope_exceeds_the_friction_angle(direction: float) -> None:
    for steeper, slides in ((-1e-4, False), (0.01, True)):
        slope = np.arctan(MU) + steeper
        along = np.sin(slope) * np.array([np.cos(direction), np.sin(direction)])
        found = distance([*along, np.cos(slope)], [0.0, 0.0], 0.0)
        assert (found > 1e-3) == slides
        assert slides or found < 1e-9


def test_the_cones_stop_where_their_names_say() -> None:
    # Along x the octagon has a vertex on the true cone, the square an edge, the diamond a vertex outside.
    steepest = {"inner": MU, "second_order": MU, "square": MU / np.sqrt(2), "diamond": np.sqrt(2) * MU}
    for name, slope in steepest.items():
        assert distance([slope - 1e-6, 0.0, 1.0], [0.0, 0.0], 0.0, CONES[name]) < 1e-8, name
        assert distance([slope + 1e-3, 0.0, 1.0], [0.0, 0.0], 0.0, CONES[name]) > 1e-5, name
    # Between the octagon's vertices its edge is nearer by cos 22.5 deg.
    edge = MU * np.cos(np.pi / 8) * np.array([np.cos(np.pi / 8), np.sin(np.pi / 8)])
    assert distance([*(0.999 * edge), 1.0], [0.0, 0.0], 0.0, CONES["inner"]) < 1e-9
    assert distance([*(1.01 * edge), 1.0], [0.0, 0.0], 0.0, CONES["inner"]) > 1e-4
    assert distance([*(1.01 * edge), 1.0], [0.0, 0.0], 0.0, TRUE_CONE) < 1e-9


def test_pressure_reaches_the_rim_and_no_farther() -> None:
    assert distance([0.0, 0.0, 1.0], [HALF[0], HALF[1]], 0.0) < 1e-9
    beyond = 0.004  # [m]; taking the load back by this much restores the moment, so it is the distance
    assert distance([0.0, 0.0, 1.0], [HALF[0] + beyond, 0.0], 0.0) == pytest.approx(beyond, rel=0.2)


def test_at_a_corner_nothing_is_left_to_turn_with() -> None:
    assert distance([0.3, 0.0, 1.0], [HALF[0], HALF[1]], 0.0) < 1e-9
    assert distance([0.3, 0.0, 1.0], [HALF[0], HALF[1]], 0.01) > 1e-4


def test_the_greatest_yaw_torque_is_friction_times_the_corners_distance() -> None:
    greatest = MU * np.hypot(*HALF)
    assert distance([0.0, 0.0, 1.0], [0.0, 0.0], 0.999 * greatest) < 1e-9
    assert distance([0.0, 0.0, 1.0], [0.0, 0.0], 1.01 * greatest) > 1e-4


def test_a_contact_cannot_pull_nor_push_sideways_without_load() -> None:
    assert distance([0.0, 0.0, -0.1], [0.0, 0.0], 0.0) == pytest.approx(0.1, abs=1e-6)
    assert distance([0.1, 0.0, 0.0], [0.0, 0.0], 0.0) > 0.05
    assert distance([0.0, 0.0, 0.0], [0.0, 0.0], 0.0) == 0.0


@given(seed=st.integers(0, 10_000), name=st.sampled_from(sorted(CONES)))
def test_whatever_four_corners_push_is_admissible(seed: int, name: str) -> None:
    rng = np.random.default_rng(seed)
    cone, corners = CONES[name], np.array([[1, 1], [-1, 1], [-1, -1], [1, -1]]) * HALF
    rays = Cone(32).rays(MU) if name == "second_order" else cone.rays(MU)
    forces = (rays @ (rng.random((rays.shape[1], 4)) * (rng.random((rays.shape[1], 4)) < 0.2))).T
    total = forces.sum(axis=0)
    if total[2] < 1e-6:
        return
    moment = np.cross(np.column_stack([corners, np.zeros(4)]), forces).sum(axis=0)
    cop = np.array([-moment[1], moment[0]]) / total[2]
    torque = moment[2] - (cop[0] * total[1] - cop[1] * total[0])
    assert distance(list(total), list(cop), torque, cone) < 1e-7
    if name in ("inner", "square"):  # inside the true cone
        assert distance(list(total), list(cop), torque, TRUE_CONE) < 1e-7


@given(seed=st.integers(0, 10_000))
def test_what_the_closed_form_admits_the_program_admits_too(seed: int) -> None:
    rng = np.random.default_rng(seed)
    f = np.array([*rng.uniform(-0.4, 0.4, 2), 1.0])
    cop, torque = rng.uniform(-1, 1, 2) * HALF, rng.uniform(-0.03, 0.03)
    found = distance(list(f), list(cop), torque, CONES["inner"])
    wrench = np.array([*f, cop[1], -cop[0], cop[0] * f[1] - cop[1] * f[0] + torque])
    block = corner_wrenches(np.eye(4), patch(HALF), CONES["inner"].rays(MU), np.zeros(3))
    program = distance_to_cones([block], wrench[None])[0]
    assert found == pytest.approx(program, abs=1e-7)
