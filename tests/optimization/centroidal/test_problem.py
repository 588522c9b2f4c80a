"""Bad data is refused by name before any program is built; odd but valid data is solved."""

from dataclasses import replace

import numpy as np
import pytest

from optimization.centroidal.contact_schedule import ContactSchedule
from optimization.centroidal.options import CentroidalOptions, CentroidalWeights
from optimization.centroidal.problem import CentroidalProblem
from optimization.centroidal.program import CentroidalProgram
from scenes.contact import Contact
from scenes.input_error import InputError

HALF = np.array([[0.11, 0.05], [0.11, 0.05], [0.05, 0.05], [0.05, 0.05]])


def standing(mu=0.5, intervals=10):
    row = [Contact("left_foot", 0, np.eye(4), mu), None, None, None]
    return CentroidalProblem(ContactSchedule.from_rows([row] * intervals, 0.1), 76.0, HALF, np.array([0.0, 0.0, 0.9]))


@pytest.mark.parametrize("solver", ["piqp", "clarabel"])
@pytest.mark.parametrize(
    "data",
    [
        standing(intervals=1),
        standing(mu=0.0),
        standing(mu=5.0),
        replace(standing(), half_extent=np.zeros((4, 2))),
        replace(standing(), half_extent=HALF * [1.0, 0.0]),
    ],
    ids=["one interval", "no friction", "much friction", "point feet", "line feet"],
)
def test_a_robot_stands_still_on_any_patch_and_any_friction(data, solver):
    estimate = CentroidalProgram(data, CentroidalOptions(solver=solver)).solve()
    assert estimate.feasible, estimate.reason
    assert np.allclose(estimate.trajectory.force_W[:, 0], [0, 0, 76.0 * 9.81], atol=1e-3)


@pytest.mark.parametrize(
    ("change", "word"),
    [
        ({"mass": -1.0}, "mass"),
        ({"mass": np.nan}, "mass"),
        ({"initial_com": np.array([0.0, np.nan, 0.9])}, "initial_com"),
        ({"initial_linear_momentum": np.array([np.inf, 0, 0])}, "initial_linear_momentum"),
        ({"half_extent": -HALF}, "half_extent"),
        ({"half_extent": HALF[:2]}, "half_extent"),
        ({"com_reference": np.full((11, 3), np.nan)}, "com_reference"),
        ({"com_reference": np.zeros((4, 3))}, "com_reference"),
        ({"com_box": np.ones((11, 3))}, "com_box"),
    ],
)
def test_bad_numbers_are_refused_by_name(change, word):
    with pytest.raises(InputError, match=word):
        replace(standing(), **change)


def test_unknown_cones_and_bad_options_are_refused():
    with pytest.raises(InputError, match="cone"):
        CentroidalProgram(standing(), CentroidalOptions(cone="round"))
    with pytest.raises(InputError, match="solver"):
        CentroidalProgram(standing(), CentroidalOptions(solver="mosek")).solve()
    for mu in (-0.5, np.nan):
        with pytest.raises(InputError, match="friction"):
            standing(mu)
    wrong = {
        "dt": 0.0,
        "com_height": (1.0, 0.9, 1.1),
        "max_iterations": 0,
        "force_limit": (0, 1, 1, 1),
        "com_reach": (1, 1),
        "angular_momentum_limit": (np.nan, 1, 1),
        "final_half_width": (-1, 1, 1),
    }
    for name, value in wrong.items():
        with pytest.raises(InputError, match=name):
            CentroidalOptions(**{name: value})
    with pytest.raises(InputError, match="force"):
        CentroidalWeights(force=-1.0)


def test_bad_friction_is_named_with_contact_and_phase():
    left, right = Contact("left_foot", 0, np.eye(4), 0.5), Contact("right_foot", 0, np.eye(4), -0.2)
    schedule = ContactSchedule.from_rows([(left, None, None, None)] * 3 + [(left, right, None, None)] * 3, 0.1)
    with pytest.raises(InputError, match=r"contact 1 \(right_foot, held from phase 1 \(0.30 to 0.60 s\)\)"):
        CentroidalProblem(schedule, 76.0, HALF, np.array([0.0, 0.0, 0.9]))


@pytest.mark.parametrize("mass", [0.0, -76.0, np.nan, np.inf])
def test_a_mass_that_is_no_mass_is_refused(mass):
    with pytest.raises(InputError, match="mass"):
        replace(standing(), mass=mass)


def moving():
    """A push that takes several convex programs."""
    return replace(standing(intervals=15), initial_linear_momentum=76.0 * np.array([0.35, 0.05, 0.0]))


def test_a_limit_on_programs_gives_the_best_so_far_and_says_so():
    whole = CentroidalProgram(moving()).solve()
    assert whole.feasible, whole.reason
    assert whole.stopped == ""
    assert len(whole.records) > 1
    cut = CentroidalProgram(moving(), CentroidalOptions(max_iterations=1)).solve()
    assert cut.stopped == "iterations"
    assert cut.trajectory is not None
    assert len(cut.records) == 1
    if not cut.feasible:
        assert cut.reason.endswith("(stopped by the limit on iterations)")


@pytest.mark.parametrize("solver", ["piqp", "clarabel"])
def test_a_time_limit_before_the_first_answer_is_not_called_infeasible(solver):
    none = CentroidalProgram(moving(), CentroidalOptions(time_limit=1e-9, solver=solver)).solve()
    assert (none.feasible, none.trajectory, none.stopped) == (False, None, "time")
    assert none.reason == "stopped by the limit on time before the first answer"


def test_a_time_limit_that_fires_on_the_way_gives_the_incumbent_marked(monkeypatch):
    from optimization.convex import sequential_convex as gauss_newton

    clock = iter([0.0, 0.0, 0.0, 100.0, 100.0])  # the second convex program is never begun
    monkeypatch.setattr(gauss_newton.time, "perf_counter", lambda: next(clock, 100.0))
    cut = CentroidalProgram(moving(), CentroidalOptions(time_limit=30.0)).solve()
    assert cut.stopped == "time"
    assert cut.trajectory is not None
    assert np.isfinite(cut.trajectory.com).all()
    assert np.isfinite(cut.cost)
