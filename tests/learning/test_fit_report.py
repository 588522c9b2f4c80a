"""The table of a fit: counted by hand for a surrogate that says what the test has it say."""

from __future__ import annotations

import json
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from learning.fit_report import DOCUMENTED, fit_report
from learning.labelled_transitions import TEST, LearningSet, learning_set
from learning.surrogate import TransitionPrediction


def says(data: LearningSet, probability: np.ndarray, cost: np.ndarray, off: float) -> SimpleNamespace:
    """A surrogate with these answers for the test rows, final CoM and velocity off by `off` along each axis."""

    def answer(c, relative) -> TransitionPrediction:
        rows = data.rows(TEST)
        com = c.points_to_world(data.com[rows] + off)
        velocity = c.vectors_to_world(data.velocity[rows] - off)
        n = len(rows)
        return TransitionPrediction(
            probability, probability >= 0.3, cost, com, velocity, np.zeros(n, bool), c.category
        )  # fmt: skip

    return SimpleNamespace(card={"kind": "told"}, predict_canonical=answer)


@pytest.fixture
def data(toy_labels) -> LearningSet:
    return learning_set(toy_labels(3000, categories=(0, 5)))


def test_the_numbers_are_those_counted_by_hand(data) -> None:
    rows = data.rows(TEST)
    truth, category = data.feasible[rows], data.representatives.category[rows]
    probability = np.where(truth, 0.9, 0.2)
    wrong = np.flatnonzero(truth)[::4]
    probability[wrong] = 0.4  # infeasible at one half, feasible at the threshold
    cost = data.cost[rows] * 1.1
    cost[np.flatnonzero(truth)[0]] *= 1e6  # the mean runs away, the median does not
    report = fit_report(says(data, probability, cost, 0.002), data)
    assert [fit.category for fit in report.rows] == [0, 5, -1]
    for fit in report.rows:
        mine = (category == fit.category) | (fit.category < 0)
        yes, no = int(truth[mine].sum()), int((~truth[mine]).sum())
        missed = np.isin(np.flatnonzero(mine), wrong).sum()
        assert (fit.test, fit.infeasible) == (yes + no, no)
        assert fit.feasible == pytest.approx(yes / (yes + no)) and fit.majority == pytest.approx(
            max(yes, no) / (yes + no)
        )
        assert fit.accuracy == pytest.approx(1 - missed / (yes + no))
        assert fit.balanced == pytest.approx(0.5 * (1 - missed / yes) + 0.5)
        assert fit.recall == 1.0 and fit.balanced_at_threshold == 1.0
        assert fit.objective_median == pytest.approx(0.1, rel=1e-6)
        assert fit.com_error == pytest.approx(0.002) and fit.velocity_error == pytest.approx(0.002)
        assert fit.com_distance == pytest.approx(0.002 * 3**0.5)
    assert report.rows[-1].objective_error > 1e3


def test_states_as_the_planner_meets_them_have_a_table_of_their_own(data) -> None:
    rows = data.rows(TEST)
    met = np.zeros(len(data.visited), bool)
    met[rows[:100]] = True
    answer = says(data, np.full(len(rows), 0.8), data.cost[rows], 0.0)
    report = fit_report(answer, replace(data, visited=met))
    assert report.visited[-1].test == 100 and report.rows[-1].test == len(rows)
    text = report.text()
    assert "states as the planner meets them" in text and text.count("Lin et al. 2019") == 4
    assert f"{DOCUMENTED[5][1]:.2f}" in text
    facts = json.loads(json.dumps(report.facts(), allow_nan=False))
    assert len(facts["visited"]) == len(facts["categories"]) == 3
    nowhere = fit_report(answer, replace(data, visited=np.zeros(len(data.visited), bool)))
    assert nowhere.visited == () and "as the planner" not in nowhere.text()


def test_columns_stand_below_their_headings(data) -> None:
    rows = data.rows(TEST)
    lines = fit_report(says(data, np.full(len(rows), 0.8), data.cost[rows], 0.0), data).text().splitlines()
    assert len({len(line) for line in lines if line not in ("", "Test scenes") and "planner" not in line}) == 1


def test_one_class_only_leaves_blanks_and_no_division_by_nothing(data) -> None:
    rows = data.rows(TEST)
    infeasible = replace(data, feasible=np.zeros(len(data.feasible), bool))
    with np.errstate(all="raise"):
        total = fit_report(says(data, np.full(len(rows), 0.2), data.cost[rows], 0.0), infeasible).rows[-1]
    assert np.isnan([total.balanced, total.recall, total.objective_median, total.com_error]).all()
    assert total.infeasible == total.test and total.accuracy == 1.0
