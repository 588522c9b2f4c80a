"""Bad data is refused by name before any program is built; odd but valid data is solved."""

from dataclasses import replace

import numpy as np
import pytest

from optimization.centroidal import CentroidalProgram
from optimization.centroidal_options import CentroidalOptions, CentroidalWeights
from optimization.centroidal_problem import CentroidalProblem
from optimization.contact_schedule import ContactSchedule
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
    for change in (
        {"dt": 0.0},
        {"com_height": (1.0, 0.9, 1.1)},
        {"max_iterations": 0},
        {"force_limit": (0, 1, 1, 1)},
        {"com_reach": (1, 1)},
        {"angular_momentum_limit": (np.nan, 1, 1)},
        {"final_half_width": (-1, 1, 1)},
    ):
        with pytest.raises(InputError):
            CentroidalOptions(**change)
    with pytest.raises(InputError):
        CentroidalWeights(force=-1.0)
