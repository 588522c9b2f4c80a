"""Labels say what the exact program says, of transitions that a planner would ask about, the same at every time."""

from __future__ import annotations

import pickle
from collections import Counter

import numpy as np
import pytest

from drakeplan.campaigns.campaign import rows_table
from drakeplan.campaigns.card import Card
from drakeplan.campaigns.dynamics import DynamicsCampaign, counts_text
from drakeplan.campaigns.label_walk import SHIFTS, Shift, WalkOptions
from drakeplan.campaigns.tilted_environment import GROUNDS, WALLS, draw_environment
from learning.dataset import Dataset
from learning.labelled_transitions import LabelledTransitions
from learning.transition_features import canonicalise
from learning.transition_labels import SCHEMA
from optimization.centroidal.transition_dynamics import TransitionDynamics, transition_options
from scenes.contact import Contact
from scenes.effector import EFFECTORS
from scenes.robots.robot import load_robot
from scenes.stance import Stance

SMALL = DynamicsCampaign(walk=WalkOptions(quota=2, max_states=25))


def seed(k: int) -> np.random.SeedSequence:
    return np.random.SeedSequence(5, spawn_key=(0, k))


@pytest.fixture(scope="module")
def rows() -> list[dict[str, object]]:
    """The labels of four environments."""
    return [row for k in range(4) for row in SMALL.rows(seed(k), k)]


@pytest.fixture(scope="module")
def table(rows: list[dict[str, object]]):
    return rows_table(SCHEMA, rows)


def stances(row: dict[str, object]) -> tuple[Stance, Stance]:
    """Before and after, from a row alone."""

    def contact(e: int, p: object, R: object, friction: float) -> Contact:
        X_WC = np.eye(4)
        X_WC[:3, :3], X_WC[:3, 3] = np.reshape(R, (3, 3)), p
        return Contact(EFFECTORS[e], 0, X_WC, friction)

    p, R, mover = np.reshape(row["p"], (4, 3)), np.reshape(row["R"], (4, 9)), row["mover"]
    held = [contact(e, p[e], R[e], row["friction"][e]) if row["held"][e] else None for e in range(4)]
    made = contact(mover, row["p_new"], row["R_new"], row["friction_new"]) if row["makes"] else None
    before = Stance(tuple(held))
    return before, before.replace(mover, made)


def test_the_exact_program_says_again_what_a_row_says(rows) -> None:
    robot = load_robot("escher")
    dynamics = TransitionDynamics(robot, transition_options(robot))
    step = max(len(rows) // 8, 1)
    for row in rows[::step]:
        before, after = stances(row)
        estimate = dynamics.estimate(before, after, row["com"], robot.mass * np.asarray(row["velocity"]))
        assert estimate.feasible == row["feasible"]
        if estimate.feasible:
            com, velocity = dynamics.final_state(estimate)
            assert estimate.cost == pytest.approx(row["cost"], rel=1e-6)
            np.testing.assert_allclose(com, row["final_com"], atol=1e-6)
            np.testing.assert_allclose(velocity, row["final_velocity"], atol=1e-6)


def test_the_rows_of_a_task_do_not_depend_on_what_ran_before(rows) -> None:
    last = [row for row in rows if row["scene"] == 3]
    again = list(SMALL.rows(seed(3), 3))
    assert pickle.dumps(rows_table(SCHEMA, again).to_pydict()) == pickle.dumps(rows_table(SCHEMA, last).to_pydict())


def test_rows_start_where_feasible_transitions_ended_or_were_shifted_from(rows) -> None:
    """A walk starts at rest over its feet, and goes on in a stance from where a transition to that stance ended."""
    height = np.array([0.0, 0.0, load_robot("escher").com_height[1]])
    spread = {shift.name: shift for shift in SHIFTS}
    ended: dict[tuple[int, Stance], list[np.ndarray]] = {}
    seen: Counter[str] = Counter()
    for row in rows:
        before, after = stances(row)
        if not any(scene == row["scene"] for scene, _ in ended):  # the first of its walk
            ended[row["scene"], before] = [np.concatenate([before.feet_mean() + height, np.zeros(3)])]
        assert (row["scene"], before) in ended, "no transition ended in this stance"
        off = np.concatenate([row["com"], row["velocity"]]) - np.array(ended[row["scene"], before])
        shift = spread[row["shift"]]
        if shift.name == "none":
            assert np.abs(off).max(axis=1).min() < 1e-12
        else:
            sigma = np.repeat([shift.com, shift.velocity[len(before.held) - 2]], 3)
            assert 0.01 < np.abs(off / sigma).max(axis=1).min() < 6.0, "six standard deviations: never in a lifetime"
        seen[shift.name] += 1
        if row["feasible"]:
            end = np.array([*row["final_com"], *row["final_velocity"]])
            ended.setdefault((row["scene"], after), []).append(end)
    assert set(seen) == set(spread)


def test_categories_mirror_and_quota_are_kept(rows, table) -> None:
    labels = LabelledTransitions.from_dataset(Dataset(table, {}))
    canonical = canonicalise(labels.batch)
    np.testing.assert_array_equal(canonical.category, [row["category"] for row in rows])
    np.testing.assert_array_equal(canonical.mirrored, [row["mirrored"] for row in rows])
    counts = Counter((row["scene"], row["category"]) for row in rows)
    assert max(counts.values()) <= SMALL.walk.quota
    assert {row["category"] for row in rows} == set(range(10))


def test_outcomes_are_there_exactly_where_there_is_a_trajectory(rows) -> None:
    assert any(row["feasible"] for row in rows)
    for row in rows:
        assert (row["reason"] == "") == row["feasible"]
        assert (row["cost"] is None) == (row["final_com"] is None) == (row["final_velocity"] is None)
        assert not row["feasible"] or row["cost"] >= 0
        assert row["iterations"] >= 1


def test_without_shifts_every_state_is_one_that_the_planner_would_reach() -> None:
    campaign = DynamicsCampaign(walk=WalkOptions(quota=1, max_states=8, shifts=(Shift("none", 1.0, 0.0, (0, 0, 0)),)))
    rows = campaign.rows(seed(1), 1)
    assert rows and {row["shift"] for row in rows} == {"none"}
    assert not np.any(rows[0]["velocity"])


def test_parameters_name_all_that_labels_depend_on() -> None:
    base = SMALL.parameters
    for other in (
        DynamicsCampaign(walk=WalkOptions(quota=3, max_states=25)),
        DynamicsCampaign(walk=SMALL.walk, friction=0.6),
        DynamicsCampaign(walk=SMALL.walk, cone="square"),
    ):
        assert other.parameters != base
    assert base["program"]["swing_time"] == 1.0
    assert sum(s.probability for s in SHIFTS) == pytest.approx(1.0)


def test_environments_are_as_various_as_they_say() -> None:
    drawn = [draw_environment(np.random.default_rng(k), 0.4) for k in range(100)]
    for choices, name in ((GROUNDS, "ground"), (WALLS, "walls")):
        share = Counter(getattr(e, name) for e in drawn)
        for choice, weight in choices.items():
            assert abs(share[choice] / len(drawn) - weight) < 0.15
    for environment in drawn:
        surfaces = environment.terrain.surfaces
        assert {s.friction for s in surfaces} == {0.4}
        sides = {s.name.split("_")[0] for s in surfaces} & {"left", "right"}
        assert sides <= {"none": set(), "both": {"left", "right"}}.get(environment.walls, {environment.walls})
        for s in surfaces:
            towards = {"left": -1.0, "right": 1.0}.get(s.name.split("_")[0])
            assert s.normal[2] > 0.5 if towards is None else towards * s.normal[1] > 0.5


def test_the_table_of_counts_adds_up() -> None:
    counts = (
        {"category": 0, "feasible": True, "ground": "rubble", "walls": "both", "shift": "none", "rows": 30},
        {"category": 0, "feasible": False, "ground": "slope", "walls": "both", "shift": "wild", "rows": 10},
    )
    card = Card("dynamics", 1, 0, {}, "", 1, 40, counts, (), (), "", ())
    line = next(x for x in counts_text(card).splitlines() if x.startswith("feet only: move a foot"))
    assert line.split()[-6:] == ["75.0", "%", "30", "10", "0", "0"]
    assert " 40 " in line
