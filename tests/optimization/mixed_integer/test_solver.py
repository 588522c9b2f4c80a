"""Answers against enumeration, and everything that can go wrong in a solver's process."""

from __future__ import annotations

import itertools
import time
from pathlib import Path

import numpy as np
import pytest
import scipy.optimize
from pydrake.solvers import MathematicalProgram

from optimization.mixed_integer import scip_adapter
from optimization.mixed_integer.data import build_program, read_program
from optimization.mixed_integer.dive import dive
from optimization.mixed_integer.solver import BACKENDS, Backend, MixedIntegerSettings, solve_mixed_integer
from scenes.input_error import InputError

GAP = 1e-4
SOLVERS = ["scip", "drake"] if scip_adapter.available() else ["drake"]


def knapsack(seed: int = 0, num: int = 5) -> tuple[MathematicalProgram, np.ndarray, np.ndarray, np.ndarray]:
    """min |x - t|^2 + c'b  s.t.  |x| <= 1, x_i <= b_i, sum b <= 3."""
    rng = np.random.default_rng(seed)
    t, c = rng.uniform(0.2, 1.0, num), rng.uniform(0.0, 0.3, num)
    prog = MathematicalProgram()
    x, b = prog.NewContinuousVariables(num, "x"), prog.NewBinaryVariables(num, "b")
    prog.AddQuadraticCost(2 * np.eye(num), -2 * t, float(t @ t), x)
    prog.AddLinearCost(c, 0.0, b)
    prog.AddBoundingBoxConstraint(0, 1, x)
    for i in range(num):
        prog.AddLinearConstraint(np.array([[1.0, -1.0]]), [-np.inf], [0.0], np.array([x[i], b[i]]))
    prog.AddLinearConstraint(np.ones((1, num)), [0.0], [3.0], b).evaluator().set_description("at most three")
    cone = np.vstack([np.zeros((1, num)), np.eye(num)])
    prog.AddLorentzConeConstraint(cone, np.append(1.0, np.zeros(num)), x).evaluator().set_description("ball")
    return prog, np.append(x, b), t, c


def by_enumeration(t: np.ndarray, c: np.ndarray) -> float:
    """For every choice the nearest point of the ball is closed form: t on the chosen axes, scaled back onto the ball."""
    best = np.inf
    for choice in itertools.product((0.0, 1.0), repeat=len(t)):
        if sum(choice) <= 3:
            x = t * choice
            x = x / max(np.linalg.norm(x), 1.0)
            best = min(best, float(((x - t) ** 2).sum() + c @ choice))
    return best


def settings(*backends: Backend, **options) -> MixedIntegerSettings:
    return MixedIntegerSettings(**{"gap": GAP, "time_limit": 30.0, "backends": backends or BACKENDS, **options})


@pytest.fixture
def fake(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    """Makes a backend from the body of a solver `solve(data, time_limit, gap, first_only, tell)`."""
    monkeypatch.setenv("PYTHONPATH", str(tmp_path))

    def make(name: str, body: str, missing: str = "") -> Backend:
        text = "import os, signal, time\nimport numpy as np\ndef solve(data, time_limit, gap, first_only, tell):\n"
        (tmp_path / f"fake_{name}.py").write_text(text + "".join(f"    {line}\n" for line in body.splitlines()))
        return Backend(name, f"fake_{name}:solve", lambda: missing)

    return make


GOOD = Backend("good", "optimization.mixed_integer.drake_adapter:branch_and_bound", lambda: "")


@pytest.mark.parametrize("solver", SOLVERS)
def test_the_optimum_is_that_of_enumeration(solver: str) -> None:
    prog, _, t, c = knapsack(1)
    record = solve_mixed_integer(prog, settings(solver=solver))
    assert record.status == "solved"
    # Drake's branch and bound stops at 1 %, which cannot be changed from Python.
    assert record.cost == pytest.approx(by_enumeration(t, c), rel=0.01 if solver == "drake" else 2 * GAP)
    assert record.worst <= 1e-6
    assert record.peak_rss_mb > 10
    assert record.history and record.time_to_first <= record.time


def test_the_dive_is_feasible_and_no_better_than_the_optimum() -> None:
    for seed in range(5):
        prog, _, t, c = knapsack(seed)
        data = read_program(prog)
        x = dive(data, 10.0)
        assert x is not None
        assert data.worst(x)[0] <= 1e-6
        assert data.cost(x) >= by_enumeration(t, c) - 1e-6


def test_reading_and_building_keep_the_program() -> None:
    prog, variables, _, _ = knapsack(2)
    data = read_program(prog)
    again = read_program(build_program(data)[0])
    rng = np.random.default_rng(0)
    for _ in range(20):
        x = rng.uniform(-0.5, 1.5, data.size)
        by_drake = sum(prog.EvalBinding(b, x).item() for b in prog.GetAllCosts())
        assert data.cost(x) == pytest.approx(by_drake)
        assert again.cost(x) == pytest.approx(by_drake)
        assert again.worst(x)[0] == pytest.approx(data.worst(x)[0])
    whole = np.zeros(len(variables))
    assert data.worst(whole)[0] == 0.0
    whole[0] = 0.2  # x_0 > 0 where b_0 = 0
    assert data.worst(whole)[0] == pytest.approx(0.2)


def test_a_rotated_cone_lacks_what_its_definition_says() -> None:
    prog = MathematicalProgram()
    x = prog.NewContinuousVariables(3)
    prog.AddRotatedLorentzConeConstraint(np.eye(3), np.zeros(3), x)
    (cone,) = read_program(prog).cones
    assert cone.lack(np.array([2.0, 2.0, 2.0])) == pytest.approx(0.0)
    assert cone.lack(np.array([2.0, 2.0, 2.1])) > 0
    assert cone.lack(np.array([-2.0, -2.0, 1.0])) > 0
    assert cone.lack(np.array([2.0, 3.0, 2.0])) < 0


def test_a_linear_program_with_binaries_agrees_with_highs() -> None:
    rng = np.random.default_rng(5)
    A, b, c = rng.uniform(0, 1, (4, 6)), rng.uniform(1, 2, 4), rng.uniform(-1, 0, 6)
    prog = MathematicalProgram()
    x = np.append(prog.NewBinaryVariables(3), prog.NewContinuousVariables(3))
    prog.AddBoundingBoxConstraint(0, 2, x[3:])
    prog.AddLinearConstraint(A, np.full(4, -np.inf), b, x)
    prog.AddLinearCost(c, 0.0, x)
    theirs = scipy.optimize.milp(
        c, constraints=scipy.optimize.LinearConstraint(A, -np.inf, b), integrality=[1, 1, 1, 0, 0, 0],
        bounds=scipy.optimize.Bounds(0, [1, 1, 1, 2, 2, 2]),
    )  # fmt: skip
    ours = solve_mixed_integer(prog, settings())
    assert ours.cost == pytest.approx(theirs.fun, rel=0.011)


@pytest.mark.parametrize("solver", SOLVERS)
def test_a_program_without_an_answer_is_infeasible(solver: str) -> None:
    prog, variables, _, _ = knapsack()
    prog.AddLinearConstraint(np.ones((1, 5)), [4.0], [5.0], variables[5:])
    record = solve_mixed_integer(prog, settings(solver=solver))
    assert record.status == "infeasible"
    assert record.x is None and not np.isfinite(record.cost)


# ---- faults


def test_a_licence_that_expires_after_it_was_asked_for_gives_way_to_the_next_solver(fake) -> None:
    expired = fake("licensed", "raise RuntimeError('license expired 2 s ago')")
    prog, _, t, c = knapsack()
    record = solve_mixed_integer(prog, settings(expired, GOOD))
    assert record.solver == "good"
    assert record.cost == pytest.approx(by_enumeration(t, c), rel=0.01)
    assert "licensed: RuntimeError: license expired 2 s ago" in record.message


def test_a_licence_that_expires_is_named_where_no_other_solver_is_left(fake) -> None:
    expired = fake("licensed", "raise RuntimeError('license expired')")
    record = solve_mixed_integer(knapsack()[0], settings(expired, GOOD, solver="licensed"))
    assert record.status == "failed" and record.x is None
    assert "license expired" in record.message


@pytest.mark.parametrize("name", ["SIGSEGV", "SIGKILL"])
def test_a_solver_that_crashes_leaves_the_caller_alive_and_is_named(fake, name: str) -> None:
    crash = fake("crashing", f"os.kill(os.getpid(), signal.{name})\ntime.sleep(5)")
    alone = solve_mixed_integer(knapsack()[0], settings(crash))
    assert alone.status == "failed" and alone.x is None
    assert f"crashing: its process was killed by {name}" in alone.message
    helped = solve_mixed_integer(knapsack()[0], settings(crash, GOOD))
    assert helped.solver == "good" and name in helped.message


def test_what_a_solver_found_before_it_crashed_is_kept(fake) -> None:
    crash = fake("crashing", "tell(1.0, 0.0, np.zeros(data.size))\nos.kill(os.getpid(), signal.SIGKILL)")
    empty = fake("empty", "return 'gave up'")
    record = solve_mixed_integer(knapsack()[0], settings(crash, empty))
    assert record.status == "failed" and record.solver == "crashing"
    assert record.x is not None and record.worst <= 1e-6
    assert "SIGKILL" in record.message and "gave up" in record.message


def test_a_solver_that_exits_is_named_with_its_last_words(fake) -> None:
    quits = fake("quitting", "import sys\nprint('no more memory', file=sys.stderr)\nsys.stderr.flush()\nos._exit(3)")
    record = solve_mixed_integer(knapsack()[0], settings(quits))
    assert "exited with 3" in record.message and "no more memory" in record.message


def test_a_time_limit_gives_back_the_incumbent_marked_even_if_the_solver_ignores_it(fake) -> None:
    hangs = fake("hanging", "tell(data.cost(np.zeros(data.size)), -1.0, np.zeros(data.size))\ntime.sleep(60)")
    began = time.perf_counter()
    record = solve_mixed_integer(knapsack()[0], settings(hangs, time_limit=1.5))
    assert time.perf_counter() - began < 30  # half of what the solver sleeps
    assert record.status == "time limit" and "time limit" in record.message
    assert record.x is not None and record.worst <= 1e-6
    assert record.bound == -1.0 and record.gap > 0


def test_a_time_limit_before_any_answer_says_so(fake) -> None:
    record = solve_mixed_integer(knapsack()[0], settings(fake("slow", "time.sleep(60)"), time_limit=1.0))
    assert record.status == "time limit" and record.x is None
    assert "before any answer was found" in record.message


def test_the_caller_can_stop_a_solver(fake) -> None:
    slow = fake("slow", "tell(1.0, 0.0, np.zeros(data.size))\ntime.sleep(60)")
    heard = []
    record = solve_mixed_integer(
        knapsack()[0], settings(slow), on_progress=lambda p, x: heard.append(x), stop=lambda: bool(heard)
    )
    assert record.status == "time limit" and record.x is not None and "stopped" in record.message


def test_an_answer_that_violates_a_constraint_is_no_answer(fake) -> None:
    liar = fake("lying", "x = np.zeros(data.size)\nx[5:] = 1.0\ntell(0.0, 0.0, x)\nreturn 'optimal'")
    record = solve_mixed_integer(knapsack()[0], settings(liar))
    assert record.status == "failed" and record.x is None
    assert record.worst_constraint == "at most three"


def test_what_solvers_print_does_not_reach_the_frames(fake) -> None:
    noisy = fake("noisy", "print('banner')\nos.write(1, b'more')\nx = np.zeros(data.size)\n"
                          "tell(data.cost(x), 0.0, x)\nreturn 'optimal'")  # fmt: skip
    assert solve_mixed_integer(knapsack()[0], settings(noisy)).status == "solved"


def test_without_pyscipopt_the_next_solver_answers_and_the_extra_is_named() -> None:
    absent = Backend("scip", "optimization.mixed_integer.scip_adapter:solve", lambda: scip_adapter.MISSING)
    record = solve_mixed_integer(knapsack()[0], settings(absent, GOOD))
    assert record.solver == "good" and "extra 'mip'" in record.message
    with pytest.raises(InputError, match="extra 'mip'"):
        solve_mixed_integer(knapsack()[0], settings(absent, GOOD, solver="scip"))


def test_data_that_is_not_finite_never_reaches_a_solver() -> None:
    prog, variables, _, _ = knapsack()
    prog.AddLinearCost(np.array([np.nan]), 0.0, variables[:1])
    with pytest.raises(InputError, match="cost"):
        solve_mixed_integer(prog)


def test_a_nonlinear_program_is_refused() -> None:
    prog = MathematicalProgram()
    x = prog.NewContinuousVariables(1)
    prog.AddConstraint(x[0] ** 3 <= 1.0)
    with pytest.raises(ValueError, match="may not hold"):
        read_program(prog)


@pytest.mark.parametrize("options", [{"solver": "cplex"}, {"time_limit": np.nan}, {"gap": -1.0}])
def test_settings_that_make_no_sense_are_refused(options: dict) -> None:
    with pytest.raises(InputError, match=next(iter(options))):
        MixedIntegerSettings(**options)
