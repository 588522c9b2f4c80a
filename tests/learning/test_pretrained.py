"""The weights that come with drakeplan: whole, small, quick, and right about what anyone can see."""

from __future__ import annotations

import json
import time

import numpy as np
import pytest

from drakeplan.bench.surrogate_times import expansion
from learning.fit_report import DOCUMENTED
from learning.surrogate import DynamicsSurrogate, load_surrogate
from learning.transition_batch import TransitionBatch
from learning.transition_features import NUM_CATEGORIES
from learning.weights import PRETRAINED
from optimization.centroidal.transition_dynamics import TransitionDynamics
from scenes.contact import Contact, contact_pose
from scenes.robots.robot import load_robot
from scenes.stance import Stance

UP = np.array([0.0, 0.0, 1.0])
BUDGET = 8e-6  # [s] a transition, classifier and regressor together


@pytest.fixture(scope="module")
def surrogate() -> DynamicsSurrogate:
    return load_surrogate("escher")


def foot(effector: str, x: float, y: float) -> Contact:
    return Contact(effector, 0, contact_pose(effector, np.array([x, y, 0.0]), UP, 0.0), 0.5)


def step(length: float) -> tuple[Stance, Stance]:
    before = Stance((foot("left_foot", 0.0, 0.1), foot("right_foot", 0.0, -0.1), None, None))
    return before, before.replace(0, foot("left_foot", length, 0.1))


def test_all_weights_together_stay_below_twenty_megabytes() -> None:
    assert sum(path.stat().st_size for path in PRETRAINED.rglob("*") if path.is_file()) < 20e6


def test_the_card_says_what_the_weights_are(surrogate) -> None:
    card = surrogate.card
    assert card["robot"] == "escher" and card["data"]["fingerprint"] and card["measured"]["categories"]
    assert sum(card["rows"]["train"]) > 10_000 and min(card["rows"]["test"]) > 0
    assert surrogate.threshold.min() > 0.0 and surrogate.threshold.max() <= 0.5


def test_the_card_of_the_labels_is_that_of_the_data_they_were_trained_on(surrogate) -> None:
    labels = json.loads((PRETRAINED / "escher" / "labels.json").read_text())
    for key in ("campaign", "version", "seed", "rows", "sha256", "parameters"):
        assert labels[key] == surrogate.card["data"][key], key
    rows, infeasible = np.zeros(NUM_CATEGORIES, int), np.zeros(NUM_CATEGORIES, int)
    for entry in labels["counts"]:
        rows[entry["category"]] += entry["rows"]
        infeasible[entry["category"]] += entry["rows"] * (not entry["feasible"])
    assert rows.min() >= 20_000 and rows.sum() == labels["rows"]
    assert (infeasible / rows).min() > 0.2


def test_on_scenes_never_seen_it_is_as_good_as_the_documents_say(surrogate) -> None:
    """Lin 2020 fig. 6.10, on states as a planner meets them; balanced accuracy on all held-out scenes."""
    fits = [fit for fit in surrogate.card["measured"]["categories"] if fit["category"] >= 0]
    assert all(fit["balanced"] > 0.9 and min(fit["feasible"], 1 - fit["feasible"]) >= 0.2 for fit in fits)
    met = [fit for fit in surrogate.card["measured"]["visited"] if fit["category"] >= 0]
    assert sum(fit["com_error"] <= DOCUMENTED[fit["category"]][3] for fit in met) >= 8


def test_an_ordinary_step_is_feasible_and_ends_over_the_feet(surrogate) -> None:
    pairs, com = [step(length) for length in (0.1, 0.2, 0.3)], np.tile([0.0, 0.0, 0.95], (3, 1))
    says = surrogate.predict(TransitionBatch.from_stances(pairs, com, np.zeros((3, 3))))
    assert says.feasible.all() and not says.far.any()
    means = np.array([after.feet_mean() for _, after in pairs])
    assert np.abs(says.com - means)[:, :2].max() <= 0.121  # the program's box


def test_it_agrees_with_the_exact_program_on_ordinary_steps(surrogate) -> None:
    robot = load_robot("escher")
    exact = TransitionDynamics(robot)
    for length in (0.1, 0.25):
        before, after = step(length)
        com, velocity = np.array([0.0, -0.02, 0.95]), np.array([0.05, 0.0, 0.0])
        truth = exact.estimate(before, after, com, robot.mass * velocity)
        says = surrogate.predict(TransitionBatch.from_stances([(before, after)], com[None], velocity[None]))
        assert truth.feasible and says.feasible[0]
        assert np.linalg.norm(says.com[0] - exact.final_state(truth)[0]) < 0.06
        assert np.linalg.norm(says.velocity[0] - exact.final_state(truth)[1]) < 0.15


def test_what_the_robot_cannot_do_is_refused_or_handed_on(surrogate) -> None:
    """A stride of two metres, a CoM that has fallen over, a robot thrown at 3 m/s."""
    pairs = [step(2.0), step(0.2), step(0.2)]
    com = np.array([[0.0, 0, 0.95], [1.0, 0, 0.4], [0, 0, 0.95]])
    says = surrogate.predict(TransitionBatch.from_stances(pairs, com, np.array([[0, 0, 0], [0, 0, 0], [3.0, 0, 0]])))
    assert (says.far | ~says.feasible).all() and says.far.any()


def test_an_expansion_is_answered_in_the_time_of_a_search(surrogate) -> None:
    for n, categories in ((60, 1), (80, 3)):
        _, arguments = expansion(n, categories)
        spent = []
        for _ in range(300):
            start = time.perf_counter()
            surrogate.predict(TransitionBatch.of_children(*arguments))
            spent.append(time.perf_counter() - start)
        assert min(spent) / n < BUDGET
