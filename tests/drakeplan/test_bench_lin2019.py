"""What the tables of Lin et al. 2019 are made of, on trajectories whose means are known."""

from __future__ import annotations

import numpy as np
import pytest

from drakeplan.bench.robustness import COLUMNS, robustness
from drakeplan.sequence_dynamics import sequence_dynamics, sequence_problem
from scenes.contact import Contact
from scenes.robot import load_robot
from scenes.stance import Stance

ROBOT = load_robot("escher")


def level(effector: str, x: float, y: float) -> Contact:
    X_WC = np.eye(4)
    X_WC[:2, 3] = x, y
    return Contact(effector, 0, X_WC, 0.5)


def test_standing_still_is_half_the_weight_on_each_foot_and_nothing_else() -> None:
    stance = Stance((level("left_foot", 0, 0.1), level("right_foot", 0, -0.1), None, None))
    problem = sequence_problem(ROBOT, [stance])
    trajectory = sequence_dynamics(ROBOT, [stance], "inner").trajectory
    numbers = dict(
        zip(COLUMNS, robustness([(problem.schedule, trajectory)], ROBOT.mass, ROBOT.half_extents), strict=True)
    )
    hx, hy = ROBOT.half_extents[0]
    assert numbers["(9) RMS |f| Mg"] == pytest.approx(0.5, abs=1e-3)
    assert numbers["(12) CoP to edge m"] == pytest.approx(min(hx, hy), abs=2e-3)
    for name in COLUMNS[:4] + COLUMNS[5:7]:
        assert numbers[name] == pytest.approx(0.0, abs=0.05), name


def test_no_trajectory_has_no_robustness() -> None:
    assert np.isnan(robustness([], ROBOT.mass, ROBOT.half_extents)).all()
