"""What the tables of Lin et al. 2019 are made of: columns on trajectories whose means are known, queries on invented plans."""

from __future__ import annotations

import json
from dataclasses import asdict, replace
from pathlib import Path

import numpy as np
import pytest

from drakeplan.bench import contact_query
from drakeplan.bench.contact_query import QueryOutcome, SequenceTrials
from drakeplan.bench.kept_cases import KeptCases
from drakeplan.bench.lin2019 import ablation, crossings, prediction, times
from drakeplan.bench.lin2019 import robustness as robustness_table
from drakeplan.bench.lin2019.mixed_integer_baseline import FirstSequence, WholePlan
from drakeplan.bench.lin2019.pictures import draw_prediction, draw_robustness, draw_times, save
from drakeplan.bench.lin2019.queries import (
    EXACT,
    LAZY,
    LEARNED,
    LONG,
    MAIN,
    PLANNERS,
    QUASI_STATIC,
    RAW,
    SCENES,
    SHORT,
    Query,
    model_and_weights,
    outcome,
    planner_options,
    uncalibrated,
    weights_digest,
)
from drakeplan.bench.momentum_columns import COLUMNS, pooled_means, robustness, robustness_sums
from drakeplan.contact_planning.contact_plan import ContactPlan
from drakeplan.contact_planning.program_planner import FORMULATIONS
from drakeplan.contact_planning.sequence_dynamics import sequence_dynamics, sequence_problem
from learning.surrogate import load_surrogate
from optimization.centroidal.estimate import CentroidalEstimate
from scenes.contact import Contact
from scenes.gravity import GRAVITY
from scenes.robots.robot import load_robot
from scenes.stance import Stance

ROBOT = load_robot("escher")
TILT = np.deg2rad(12.0)


def contact(effector: str, x: float, y: float, tilt: float = 0.0) -> Contact:
    X_WC = np.eye(4)
    X_WC[:2, 3] = x, y
    X_WC[1:3, 1:3] = [[np.cos(tilt), -np.sin(tilt)], [np.sin(tilt), np.cos(tilt)]]
    return Contact(effector, 0, X_WC, 0.5)


def a_step(length: float = 0.25) -> tuple[Stance, ...]:
    before = Stance((contact("left_foot", 0, 0.12, -TILT), contact("right_foot", 0, -0.12, TILT), None, None))
    return before, before.replace(0, contact("left_foot", length, 0.12, -TILT))


def test_standing_still_is_half_the_weight_on_each_foot_and_nothing_else() -> None:
    stance = Stance((contact("left_foot", 0, 0.1), contact("right_foot", 0, -0.1), None, None))
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


def test_every_column_is_what_the_wrenches_say_summed_one_by_one() -> None:
    """A slow twin: rates from the forces (Newton and Euler) rather than from the momenta, every contact by itself."""
    stances = a_step()
    schedule = sequence_problem(ROBOT, stances).schedule
    trajectory = sequence_dynamics(ROBOT, stances, "inner").trajectory
    assert trajectory is not None
    weight, samples = ROBOT.mass * GRAVITY, {name: [] for name in COLUMNS}
    for n in range(schedule.num_knots - 1):
        force, moment, squares = np.array([0.0, 0.0, -weight]), np.zeros(3), []
        for e, c in enumerate(schedule.active[n]):
            if c < 0:
                continue
            X_WC, f = schedule.contacts[c].X_WC, trajectory.force_W[n, e]
            p = X_WC[:3, 3] + X_WC[:3, :2] @ trajectory.cop_C[n, e]
            force = force + f
            moment = moment + np.cross(p - trajectory.com[n + 1], f) + trajectory.torque_n[n, e] * X_WC[:3, 2]
            squares.append(f @ f / weight**2)
            along = f @ X_WC[:3, 2]
            samples[COLUMNS[5]].append(abs(trajectory.torque_n[n, e]))
            samples[COLUMNS[6]].append(np.sqrt(max(f @ f - along**2, 0.0)) / weight)
            half = ROBOT.half_extents[e]
            samples[COLUMNS[7]].append(
                min(half[0] - abs(trajectory.cop_C[n, e, 0]), half[1] - abs(trajectory.cop_C[n, e, 1]))
            )
        samples[COLUMNS[0]].append(np.linalg.norm(trajectory.linear_momentum[n + 1]))
        samples[COLUMNS[1]].append(np.linalg.norm(force))
        samples[COLUMNS[2]].append(np.linalg.norm(trajectory.angular_momentum[n + 1]))
        samples[COLUMNS[3]].append(np.linalg.norm(moment))
        samples[COLUMNS[4]].append(np.sqrt(np.mean(squares)))
    expected = [np.mean(samples[name]) for name in COLUMNS]
    got = robustness([(schedule, trajectory)], ROBOT.mass, ROBOT.half_extents)
    assert got == pytest.approx(expected, rel=1e-6, abs=1e-9)
    assert min(expected) > 1e-6, "every column is put to the test"


def test_a_mean_over_trajectories_is_one_over_their_time_steps_not_over_their_means() -> None:
    sums = np.array([np.outer([6.0, 2.0], np.ones(8)), np.outer([2.0, 6.0], np.ones(8))])
    assert pooled_means(sums) == pytest.approx([1.0] * 8)  # not (3 + 1/3) / 2
    stances = a_step()
    schedule = sequence_problem(ROBOT, stances).schedule
    trajectory = sequence_dynamics(ROBOT, stances, "inner").trajectory
    one = robustness_sums(schedule, trajectory, ROBOT.mass, ROBOT.half_extents)
    assert pooled_means(np.array([one, one])) == pytest.approx(pooled_means(one[None]))


def test_no_trajectory_has_no_robustness() -> None:
    assert np.isnan(robustness([], ROBOT.mass, ROBOT.half_extents)).all()


# Queries ------------------------------------------------------------------------------------------------------


def trials(monkeypatch: pytest.MonkeyPatch, feasible: list[bool]) -> tuple[SequenceTrials, list[int]]:
    """Plan k is found after k + 1 seconds and costs 100 - k in its program, where that is feasible; and what was solved."""
    sequences = [a_step(0.2 + 0.01 * k) for k in range(len(feasible))]
    answer = sequence_dynamics(ROBOT, sequences[0], "inner")
    states = ((0, 1, -1, -1, -1), (2, 1, -1, -1, 0))
    plans = [
        ContactPlan(stances, states, 50.0 - k, None, k, k + 1.0, predicted_effort=90.0 - k)
        for k, stances in enumerate(sequences)
    ]
    solved: list[int] = []

    def dynamics(robot: object, stances: tuple[Stance, ...], cone: str) -> CentroidalEstimate:
        solved.append(sequences.index(stances))
        return replace(answer, feasible=feasible[solved[-1]], cost=100.0 - solved[-1])

    monkeypatch.setattr(contact_query, "sequence_dynamics", dynamics)
    return SequenceTrials(ROBOT, "inner", plans), solved


def test_programs_are_solved_from_the_last_sequence_to_the_first_until_one_is_feasible(monkeypatch) -> None:
    found, solved = trials(monkeypatch, [False, True, True, False, False])
    outcome = found.within(100.0)
    assert (outcome.found, outcome.tested, outcome.feasible) == (5, 3, True)
    assert (outcome.objective, outcome.predicted) == (98.0, 88.0), "the third sequence is the last that is feasible"
    assert (outcome.first_s, outcome.first_feasible_s) == (1.0, 2.0)
    assert (outcome.first_objective, outcome.first_predicted) == (99.0, 89.0)
    assert np.isnan(found.within(2.5).first_objective), "first and last are the same: one point of fig. 10"
    assert outcome.confirm_s > 0
    assert solved == [4, 3, 2, 0, 1], "and then from the first, for the time to the first that is feasible"


def test_no_program_is_solved_twice(monkeypatch) -> None:
    found, solved = trials(monkeypatch, [False, True, True, False, False])
    assert found.within(100.0).objective == found.within(100.0).objective == found.within(3.5).objective == 98.0
    assert sorted(solved) == [0, 1, 2, 3, 4]


def test_what_was_found_later_does_not_count_earlier(monkeypatch) -> None:
    found, _ = trials(monkeypatch, [False, False])
    assert not found.within(0.5).feasible and found.within(0.5).found == 0 and np.isnan(found.within(0.5).first_s)
    outcome = found.within(2.0)
    assert (outcome.found, outcome.tested, outcome.feasible) == (2, 2, False)
    assert outcome.first_s == 1.0 and np.isnan(outcome.first_feasible_s)


def test_an_outcome_comes_back_from_json_as_it_was(monkeypatch) -> None:
    found, _ = trials(monkeypatch, [False, True, True])
    for seconds in (0.5, 1.5, 3.0):
        before = found.within(seconds)
        after = outcome(json.loads(json.dumps(asdict(before))))
        assert repr(after) == repr(before)  # NaN is not equal to itself
    assert found.last_program_s > 0


def test_raw_logits_accept_at_one_half_and_kept_cases_are_those_of_the_same_weights() -> None:
    surrogate = load_surrogate(ROBOT)
    raw = uncalibrated(surrogate)
    assert np.all(raw.scale == 1.0) and np.all(raw.offset == 0.0) and np.all(raw.threshold == 0.5)
    assert raw.network is surrogate.network
    assert weights_digest(surrogate) == weights_digest(load_surrogate(ROBOT)) != weights_digest(raw)
    asked = {name: planner_options(name, 3, ROBOT) for name in PLANNERS}
    assert [asked[name][0].dynamics for name in PLANNERS] == ["quasi-static", "learned", "learned", "exact", "exact"]
    assert [asked[name][1].ask_when_far for name in PLANNERS] == [True, True, False, True, True]
    assert asked[EXACT][1].window == 0 < asked[LAZY][1].window, (
        "a program for every branch, as documented, and for what is popped"
    )
    assert {options.seed for options, _ in asked.values()} == {3}
    keys = [model_and_weights(ROBOT, name)["weights"] for name in PLANNERS]
    assert keys == ["", weights_digest(surrogate), weights_digest(surrogate), "", ""]


# Tables and pictures ------------------------------------------------------------------------------------------


def invented() -> list[Query]:
    """Three seeds each; the last one was searched for a short time only. Exact dynamics find nothing in that time."""
    queries, sums = [], ((6.0,) * 8, (2.0,) * 8)
    for scene in SCENES:
        for p, planner in enumerate(PLANNERS):
            for seed in range(3 if planner in MAIN else 2):
                good = QueryOutcome(
                    found=3, first_s=0.05, first_feasible_s=0.1 * (p + 1), confirm_s=0.2, tested=1,
                    objective=1000.0 * (p + 1) * (0.9 + 0.1 * seed),
                    predicted=900.0 + 100 * seed, first_objective=3000.0, first_predicted=2500.0 if seed else np.nan,
                    palms=planner == LEARNED, transitions=11, robustness=sums,
                )  # fmt: skip
                late = planner == EXACT
                within = {SHORT: QueryOutcome() if late else good} | ({LONG: good} if seed < 2 else {})
                queries.append(Query(scene, planner, seed, good, within, {"learned": 5, "exact": 7}, "", 0.9))
    return queries


def test_the_published_numbers_stand_below_ours_in_the_same_columns() -> None:
    table = robustness_table.table(invented())
    rows = {row[:2]: dict(zip(table.columns, row, strict=True)) for row in table.rows}
    ours, theirs = rows["rubble_corridor", LEARNED], rows["rubble_corridor", "learned, published"]
    assert (ours["(1) found"], ours["(2) feasible"], ours["with palms"]) == ("3/3", "3/3", "3/3")
    assert (ours["(4) objective"], ours[COLUMNS[0]]) == (pytest.approx(2000.0), 3.0)
    # Lin et al. 2019 fig. 8, last row.
    assert (theirs["(1) found"], theirs["(3) tested"], theirs["(4) objective"], theirs[COLUMNS[7]]) == (
        "50/50",
        1.59,
        2392.5,
        0.0173,
    )
    assert len(table.rows) == 8 and table.markdown(50).count("|\n") == 10


def test_planners_are_compared_at_equal_time_on_the_seeds_that_have_it() -> None:
    table = ablation.table(invented())
    rows = {row[:3]: dict(zip(table.columns, row, strict=True)) for row in table.rows}
    assert len(rows) == len(SCENES) * 2 * len(PLANNERS)
    assert rows["rubble_field", SHORT, EXACT]["found"] == "0/2"
    assert np.isnan(rows["rubble_field", SHORT, EXACT]["objective"])
    assert rows["rubble_field", LONG, EXACT]["over learned's"] == pytest.approx(2.0)
    assert rows["rubble_field", LONG, QUASI_STATIC]["over learned's"] == pytest.approx(0.5)
    assert rows["rubble_field", LONG, RAW]["by programs"] == 14


def test_the_gap_and_the_slope_stand_above_the_published_times(monkeypatch) -> None:
    found = QueryOutcome(
        found=2, first_s=0.2, first_feasible_s=0.2, confirm_s=0.5, tested=1, objective=7.0, transitions=9
    )
    said: list[str] = []
    monkeypatch.setattr(
        crossings, "_cross", lambda *asked: {"outcome": asdict(found), "program_s": 0.5, "why": str(asked[3])}
    )
    table = crossings.table(ROBOT, None, KeptCases(None), said.append)
    rows = {(row[0], row[2]): dict(zip(table.columns, row, strict=True)) for row in table.rows}
    assert (rows["wide_gap", LEARNED]["contacts"], rows["wide_gap", "learned, published"]["first s"]) == (11, 0.143)
    assert rows["steep_slope", "learned, published"]["program s"] == 6.32
    assert [line.split()[-1] for line in said] == ["inner"] * 3 + ["diamond"] * 2


def baselines() -> tuple[list[FirstSequence], list[WholePlan]]:
    firsts = [FirstSequence(name, seed, True, seed == 0 or name != "gcs", 10.0 + k, 0.3, "scip")
              for k, name in enumerate(FORMULATIONS) for seed in (0, 1)]  # fmt: skip
    plans = [WholePlan(name, seed, (name, seed) != ("footsteps", 1), 2.0 * k + 0.1, 5.0, 0, "why")
             for k, name in enumerate((LEARNED, *FORMULATIONS)) for seed in (0, 1)]  # fmt: skip
    return firsts, plans


def test_only_what_is_feasible_and_verified_counts_against_the_learned_search() -> None:
    firsts, plans = baselines()
    table = times.table(times.all_series(invented(), firsts), firsts, plans, 0.97)
    rows = {row[:2]: row for row in table.rows}
    place = {name: k for k, name in enumerate(table.columns)}
    assert rows["rubble_field", "gcs"][place["feasible"]] == "1/2"
    assert rows["rubble_field", "footsteps"][place["verified"]] == "1/2"
    assert rows["rubble_field", "footsteps"][place["over learned"]] == pytest.approx(10.0 / 0.2)
    assert rows["rubble_field", "footsteps"][place["over learned "]] == pytest.approx(2.1 / 0.1)
    assert rows["rubble_field", "learned, published"][place["mean s"]] == 0.098
    assert any("footsteps: 50 times" in note for note in table.notes)
    assert any("footsteps takes 21 times" in note for note in table.notes)
    assert "footsteps seed 1, not verified: why" in table.notes
    assert "97 % of a core" in table.notes[-1]


def test_the_ratio_is_of_means_over_the_seeds_of_both() -> None:
    assert times.ratio_of_means({0: 4.0, 1: 6.0, 2: 1e9}, {0: 1.0, 1: 4.0, 3: 1e9}) == pytest.approx(2.0)
    assert np.isnan(times.ratio_of_means({0: 1.0}, {1: 1.0}))


def test_a_few_far_points_do_not_move_the_robust_line() -> None:
    rng = np.random.default_rng(0)
    x = rng.uniform(1500.0, 3000.0, 60)
    y = 1.4 * x - 500.0 + rng.normal(0.0, 20.0, 60)
    slope, intercept = prediction.robust_line(x, y)
    assert (slope, intercept) == (pytest.approx(1.4, abs=0.02), pytest.approx(-500.0, abs=50.0))
    y[np.argsort(x)[-3:]] -= 3000.0
    robust, _ = prediction.robust_line(x, y)
    assert abs(robust - 1.4) < 0.05 < abs(np.polyfit(x, y, 1)[0] - 1.4)
    assert np.isnan(prediction.robust_line(x[:2], y[:2])).all()


def test_the_robust_line_is_the_line_where_there_is_one_and_moves_with_its_units() -> None:
    x = np.array([1.0, 2.0, 3.0, 5.0, 8.0])
    assert prediction.robust_line(x, 3.0 * x - 7.0) == pytest.approx((3.0, -7.0))
    assert prediction.robust_line(1e3 * x, np.full(5, 2e6)) == pytest.approx((0.0, 2e6), abs=1e-6)
    assert np.isnan(prediction.robust_line(np.ones(5), x)).all()
    rng = np.random.default_rng(1)
    x = rng.uniform(0.0, 1.0, 2000)
    y = 2.0 * x + 1.0 + rng.normal(0.0, 0.1, 2000)
    slope, intercept = prediction.robust_line(x, y)
    least_squares = np.polyfit(x, y, 1)
    assert (slope, intercept) == pytest.approx(least_squares, abs=5e-3), "nothing is far: 0.6 standard errors"
    assert prediction.robust_line(1e4 * x - 3.0, 5e3 * y) == pytest.approx(
        (0.5 * slope, 5e3 * intercept + 1.5 * slope), rel=1e-6
    )


def test_pictures_are_drawn_from_the_tables(tmp_path: Path) -> None:
    firsts, _ = baselines()
    queries = invented()
    predictions = prediction.predictions(queries)
    assert [p.scene for p in predictions] == [*SCENES, "both"] and len(predictions[-1].actual) == 2 * (3 + 2)
    for k, figure in enumerate(
        (
            draw_prediction(predictions),
            draw_times(times.all_series(queries, firsts)),
            draw_robustness(robustness_table.table(queries)),
        )
    ):
        save(figure, tmp_path / "new" / f"{k}.png")
        assert (tmp_path / "new" / f"{k}.png").stat().st_size > 5000
