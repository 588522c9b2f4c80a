"""The comparison of optimisers: its own sums, its distrust, its memory, its picture."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from drakeplan.bench import optimizers
from drakeplan.bench.optimizer_plots import draw, save
from drakeplan.bench.peers import interior_point
from drakeplan.bench.table import BenchOptions, BenchTable
from drakeplan.bench.trial import (
    Method,
    corner_forces,
    exact_hessian,
    free_timing,
    newton_euler,
    ours,
    peak_memory,
    run_trial,
    trajectory_of_corners,
)
from optimization.centroidal.contact_schedule import ContactSchedule
from optimization.centroidal.options import CentroidalOptions
from optimization.centroidal.problem import CentroidalProblem
from optimization.centroidal.program import CentroidalProgram
from scenes.contact import Contact, contact_pose

MASS, G = 76.0, 9.81
HALF = np.array([[0.11, 0.05], [0.11, 0.05], [0.05, 0.05], [0.05, 0.05]])
OPTIONS = CentroidalOptions(dt=0.1)
PLACE = {name: k for k, name in enumerate(optimizers.COLUMNS)}


def foot(name: str, x: float, y: float) -> Contact:
    return Contact(name, 0, contact_pose(name, np.array([x, y, 0.0]), np.array([0.0, 0.0, 1.0]), 0.0), 0.6)


@pytest.fixture(scope="module")
def problem() -> CentroidalProblem:
    left, right, ahead = foot("left_foot", 0, 0.1), foot("right_foot", 0, -0.1), foot("left_foot", 0.2, 0.1)
    rows = [(left, right, None, None)] * 4 + [(None, right, None, None)] * 3 + [(ahead, right, None, None)] * 4
    return CentroidalProblem(ContactSchedule.from_rows(rows, 0.15), MASS, HALF, np.array([0, 0, 0.9]))


def test_what_the_program_solves_is_confirmed_and_timed(problem: CentroidalProblem) -> None:
    trial = run_trial(Method("centroidal", "clarabel", "inner", ours("clarabel")), problem, OPTIONS, turns=2)
    assert trial.claimed
    assert trial.holds
    assert trial.violated == 0
    assert trial.residual < 1e-9
    assert trial.build > 0
    assert trial.solve > 0


def test_a_force_out_of_nowhere_is_the_residual(problem: CentroidalProblem) -> None:
    t = CentroidalProgram(problem, OPTIONS).solve().trajectory
    assert t is not None
    spoiled = t.force_W.copy()
    spoiled[2, 0] += [0.0, 0.0, 0.01 * MASS * G]
    assert newton_euler(problem, replace(t, force_W=spoiled)) == pytest.approx(0.01, rel=1e-6)
    moved = t.com.copy()
    moved[5] += [0.003, 0.0, 0.0]
    assert newton_euler(problem, replace(t, com=moved)) >= 0.003 / 0.15 * 0.99


def test_an_optimiser_that_lies_is_counted_as_one(problem: CentroidalProblem) -> None:
    honest = ours("clarabel")

    def liar(asked: CentroidalProblem, options: CentroidalOptions):
        _, solved, t, cost, build, solve = honest(asked, options)
        return True, solved, replace(t, com=t.com + np.array([0.0, 0.0, 0.5])), cost / 2, build, solve

    methods = [Method("centroidal", "liar", "inner", liar), Method("centroidal", "clarabel", "inner", honest)]
    trials = optimizers.centroidal_trials({"step": [(problem, OPTIONS)]}, methods, BenchOptions())
    lying, true = optimizers.centroidal_rows(trials)
    assert (lying[PLACE["succeed"]], lying[PLACE["false claims"]]) == (0, 1)
    assert lying[PLACE["violation"]] > 1
    assert (true[PLACE["succeed"]], true[PLACE["false claims"]]) == (1, 0)
    assert true[PLACE["cost / best"]] == 1.0  # the lie did not count as the best


def test_four_equal_corner_forces_under_each_foot_hold_the_body_still() -> None:
    left, right = foot("left_foot", 0, 0.1), foot("right_foot", 0, -0.1)
    schedule = ContactSchedule.from_rows([(left, right, None, None)] * 5, 0.1)
    still = CentroidalProblem(schedule, MASS, HALF, np.array([0, 0, 0.9]))
    forces = np.zeros((10, 4, 3))
    forces[..., 2] = 1 / 8
    t = trajectory_of_corners(still, OPTIONS, forces)
    assert t is not None
    assert np.allclose(t.com, [0, 0, 0.9], atol=1e-12)
    assert np.allclose(t.angular_momentum, 0, atol=1e-9)
    assert np.allclose(t.cop_C, 0, atol=1e-12)
    assert trajectory_of_corners(still, OPTIONS, forces * np.nan) is None


@pytest.mark.skipif(not interior_point.available(), reason=interior_point.INSTALL)
def test_the_interior_point_is_judged_on_the_same_numbers(problem: CentroidalProblem) -> None:
    t = CentroidalProgram(problem, OPTIONS).solve().trajectory
    assert t is not None
    peer = interior_point.InteriorPoint(problem, OPTIONS)
    again = trajectory_of_corners(problem, OPTIONS, corner_forces(problem, peer.from_trajectory(problem, t)))
    assert again is not None
    assert np.allclose(again.force_W, t.force_W, atol=1e-6)
    assert np.allclose(again.com, t.com, atol=1e-9)
    assert np.allclose(again.angular_momentum, t.angular_momentum, atol=1e-6)
    methods = [
        Method("centroidal", "clarabel", "inner", ours("clarabel")),
        Method("centroidal", "ipopt", "inner", exact_hessian(), 20),
    ]
    trials = optimizers.centroidal_trials({"step": [(problem, OPTIONS)]}, methods, BenchOptions())
    rows = optimizers.centroidal_rows(trials)
    assert [row[PLACE["succeed"]] for row in rows] == [1, 1]
    assert min(row[PLACE["cost / best"]] for row in rows) == 1.0
    assert max(row[PLACE["cost / best"]] for row in rows) < 1.01
    few = replace(methods[1], longest=3)
    assert not optimizers.centroidal_trials({"step": [(problem, OPTIONS)]}, [few], BenchOptions())


def test_free_timing_has_a_best_of_its_own(problem: CentroidalProblem) -> None:
    methods = [
        Method("centroidal", "clarabel", "inner", ours("clarabel")),
        Method("free", "clarabel", "inner", free_timing("clarabel")),
    ]
    fixed, free = optimizers.centroidal_rows(
        optimizers.centroidal_trials({"step": [(problem, OPTIONS)]}, methods, BenchOptions())
    )
    assert free[PLACE["cost"]] < fixed[PLACE["cost"]]
    assert fixed[PLACE["cost / best"]] == free[PLACE["cost / best"]] == 1.0


def test_memory_is_what_was_touched() -> None:
    with peak_memory() as memory:
        block = np.ones(8_000_000)  # 64 MB
        del block
    if np.isnan(memory.rise):
        pytest.skip("this system does not tell the peak of a process's memory")
    assert 55 < memory.rise < 120
    with peak_memory() as little:
        pass
    assert little.rise < 5


def test_the_picture_has_a_line_for_each_method(tmp_path: Path) -> None:
    filled = dict.fromkeys(optimizers.COLUMNS, 1.0)
    rows = [
        tuple((filled | {"formulation": "a", "solver": solver, "cone": "inner", "size": size}).values())
        for solver in ("x", "y")
        for size in ("small", "large")
    ]
    table = BenchTable("optimizers", "", optimizers.COLUMNS, tuple(rows), most_seeds=0)
    figure = draw(table)
    assert [line.get_label() for line in figure.axes[0].get_lines()] == ["a, x, inner", "a, y, inner"]
    assert [label.get_text() for label in figure.axes[0].get_xticklabels()] == ["small", "large"]
    save(table, tmp_path / "new" / "picture.png")
    assert (tmp_path / "new" / "picture.png").read_bytes().startswith(b"\x89PNG")
