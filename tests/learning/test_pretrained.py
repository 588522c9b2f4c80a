"""The weights that come with drakeplan: whole, small, quick, and right about what anyone can see."""

from __future__ import annotations

import json
import time
from collections.abc import Callable

import numpy as np
import pytest

from drakeplan.bench.surrogate_times import by_numpy, expansion
from drakeplan.campaigns.campaign import rows_table
from drakeplan.campaigns.dynamics import DynamicsCampaign
from drakeplan.campaigns.label_walk import WalkOptions
from learning.dataset import Dataset
from learning.fit_report import DOCUMENTED
from learning.labelled_transitions import LabelledTransitions
from learning.palm_networks import PALMS
from learning.relative_features import relative_features
from learning.surrogate import DynamicsSurrogate, load_surrogate
from learning.transition_batch import TransitionBatch
from learning.transition_features import NUM_CATEGORIES, canonicalise
from learning.transition_labels import SCHEMA
from learning.weights import PRETRAINED
from optimization.centroidal.transition_dynamics import TransitionDynamics
from scenes.contact import Contact, contact_pose
from scenes.robots.robot import load_robot
from scenes.stance import Stance

UP = np.array([0.0, 0.0, 1.0])
NEW_SEED = 2026  # of terrains that no network was trained on


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


def test_the_measurements_in_the_card_reach_those_of_lin_2020(surrogate) -> None:
    """Lin 2020 fig. 6.10: CoM errors in states as a planner meets them; balanced accuracy on all held-out scenes."""
    fits = [fit for fit in surrogate.card["measured"]["categories"] if fit["category"] >= 0]
    assert all(fit["balanced"] > 0.9 and min(fit["feasible"], 1 - fit["feasible"]) >= 0.2 for fit in fits)
    met = [fit for fit in surrogate.card["measured"]["visited"] if fit["category"] >= 0]
    assert sum(fit["com_error"] <= DOCUMENTED[fit["category"]][3] for fit in met) >= 8


@pytest.mark.slow
def test_on_scenes_never_seen_the_networks_are_as_good_as_their_card_says(surrogate) -> None:
    """The exact program labels walks through terrains of a seed that no training data have.

    The rows of one terrain err together, so a share over so few terrains spreads by some 0.02: four times that are allowed.
    """
    assert surrogate.card["data"]["seed"] != NEW_SEED
    campaign = DynamicsCampaign(walk=WalkOptions(quota=4, max_states=40))
    rows = [r for k in range(9) for r in campaign.rows(np.random.SeedSequence(NEW_SEED, spawn_key=(0, k)), k)]
    labels = LabelledTransitions.from_dataset(Dataset(rows_table(SCHEMA, rows), {}))
    says, truth = surrogate.predict(labels.batch), labels.feasible
    measured = next(fit for fit in surrogate.card["measured"]["categories"] if fit["category"] == -1)
    right = says.feasible == truth
    assert len(truth) > 200 and 0.5 < truth.mean() < 0.85
    assert right.mean() > measured["accuracy"] - 0.08
    assert 0.5 * (right[truth].mean() + right[~truth].mean()) > measured["balanced"] - 0.08
    assert np.abs(says.com - labels.com)[truth].mean() < 1.5 * measured["com_error"]
    assert np.abs(says.velocity - labels.velocity)[truth].mean() < 1.5 * measured["velocity_error"]


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


def test_an_answer_costs_less_than_twice_the_products_of_its_networks_in_numpy(surrogate) -> None:
    """Category, features, calibration and distance are in the answer; NumPy does the matrix products alone, in turn."""
    batch, arguments = expansion(60, 1)
    category = canonicalise(batch, surrogate.network.frame)
    network = surrogate.network.networks[PALMS[category.category[0]]]
    x = relative_features(category)

    def spent(run: Callable[[], object]) -> float:
        began = time.perf_counter()
        run()
        return time.perf_counter() - began

    ours, theirs = [], []
    for _ in range(300):
        ours.append(spent(lambda: surrogate.predict(TransitionBatch.of_children(*arguments))))
        theirs.append(spent(lambda: by_numpy(network.members, x)))
    assert min(ours) < 2.0 * min(theirs)
