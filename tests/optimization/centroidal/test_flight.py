"""Flights: what closed form calls impossible the program never flies, and says why."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from optimization.centroidal.contact_schedule import ContactSchedule
from optimization.centroidal.flight import Ground, impossible_flight, longest_flight
from optimization.centroidal.options import CentroidalOptions
from optimization.centroidal.problem import CentroidalProblem
from optimization.centroidal.program import CentroidalProgram
from scenes.contact import Contact

HALF = np.array([[0.11, 0.05], [0.11, 0.05], [0.05, 0.05], [0.05, 0.05]])
G = 9.81


def foot(side, x=0.0, z=0.0):
    X_WC = np.eye(4)
    X_WC[:3, 3] = x, 0.1 if side == "left" else -0.1, z
    return Contact(f"{side}_foot", 0, X_WC, 0.5)


def jump(flight, dt=0.1, up=0.0, **options):
    """Stand for a second, fly, stand for a second on ground that is higher by `up`."""
    feet, landed = (
        (foot("left"), foot("right"), None, None),
        (foot("left", 0.1, up), foot("right", 0.1, up), None, None),
    )
    rows = [feet] * 10 + [(None,) * 4] * round(flight / dt) + [landed] * 10
    data = CentroidalProblem(ContactSchedule.from_rows(rows, dt), 76.0, HALF, np.array([0, 0, 0.9]))
    return data, CentroidalOptions(**options)


@given(
    stroke=st.floats(0.05, 0.5),
    rise=st.floats(-0.5, 0.3),
    lift=st.floats(1.1, 4.0),
    strength=st.floats(1.1, 4.0),
)
def test_the_longest_flight_is_the_longest_parabola_that_can_be_pushed_and_caught(stroke, rise, lift, strength):
    before, after = Ground(1.0 - stroke, 1.0, lift), Ground(1.0 - stroke + rise, 1.0 + rise, strength)
    v, t = np.meshgrid(np.linspace(0.0, before.speed, 400), np.linspace(0.0, 3.0, 601))
    high_enough = before.high + v * t - G * t * t / 2 >= after.low - 1e-9
    best = t[high_enough & (G * t - v <= after.speed + 1e-9)].max(initial=0.0)
    assert longest_flight(before, after) == pytest.approx(best, abs=0.02)


def test_a_flight_too_long_to_survive_is_named_with_the_height_of_the_fall():
    data, options = jump(2.0)
    estimate = CentroidalProgram(data, options).solve()
    assert not estimate.feasible
    assert estimate.trajectory is None
    assert estimate.reason.startswith("phase 1 (1.00 to 3.00 s): without contact for 2.00 s")
    assert "19.62 m" in estimate.reason  # g T^2 / 2


@pytest.mark.parametrize("height", [(0.6, 0.9, 1.1), (0.85, 0.9, 0.95)])
def test_where_closed_form_says_impossible_the_program_finds_nothing(height):
    said = []
    for flight in (0.1, 0.3, 0.5, 0.7, 0.9, 1.1, 1.5, 2.5):
        data, options = jump(flight, com_height=height, angular_momentum_limit=(1e3,) * 3,
                             angular_momentum_rate_limit=(1e4,) * 3)  # fmt: skip
        said.append(bool(impossible_flight(data, options)))
        if said[-1]:
            assert not CentroidalProgram(data, options).solve().feasible, flight
    assert said == sorted(said)  # a longer flight is never easier
    assert not said[0]
    assert said[-1]


def test_short_hops_are_flown():
    data, options = jump(0.2)
    assert not impossible_flight(data, options)
    assert CentroidalProgram(data, options).solve().feasible


def test_a_flight_at_the_end_has_nothing_to_come_to_rest_on():
    feet = (foot("left"), foot("right"), None, None)
    schedule = ContactSchedule.from_rows([feet] * 5 + [(None,) * 4] * 5, 0.1)
    data = CentroidalProblem(schedule, 76.0, HALF, np.array([0, 0, 0.9]))
    estimate = CentroidalProgram(data).solve()
    assert not estimate.feasible
    assert estimate.reason == "phase 1 (0.50 to 1.00 s): no contact is left to come to rest on"
    free = CentroidalProgram(data, CentroidalOptions(rest_at_end=False, final_half_width=None)).solve()
    assert free.feasible, free.reason


def test_a_flight_from_the_start_falls_as_far_as_its_first_speed_lets_it():
    feet = (foot("left"), foot("right"), None, None)

    def thrown(speed):
        schedule = ContactSchedule.from_rows([(None,) * 4] * 8 + [feet] * 12, 0.1)
        momentum = np.array([0.0, 0.0, 76.0 * speed])
        return CentroidalProblem(schedule, 76.0, HALF, np.array([0, 0, 0.9]), momentum)

    dropped = CentroidalProgram(thrown(0.0)).solve()
    assert not dropped.feasible
    assert "phase 0 (0.00 to 0.80 s)" in dropped.reason
    assert "3.14 m" in dropped.reason
    assert CentroidalProgram(thrown(G * 0.45)).solve().feasible


@pytest.mark.parametrize("solver", ["piqp", "clarabel"])
def test_without_any_contact_the_com_falls_by_the_difference_equations(solver):
    schedule = ContactSchedule.from_rows([(None,) * 4] * 3, 0.1)
    data = CentroidalProblem(schedule, 76.0, HALF, np.array([0, 0, 1.0]), np.array([7.6, 0, 0]), np.array([1.0, 0, 0]))
    estimate = CentroidalProgram(data, CentroidalOptions(rest_at_end=False, solver=solver)).solve()
    assert estimate.feasible, estimate.reason
    assert np.allclose(estimate.trajectory.com[-1], [0.03, 0, 1.0 - G * 0.1**2 * (1 + 2 + 3)])
    assert np.allclose(estimate.trajectory.angular_momentum, [1.0, 0, 0])
