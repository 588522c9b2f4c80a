"""Labels of torso poses: the same at every time, features and counts that fit each other, and what they depend on by name."""

from __future__ import annotations

import pickle
from dataclasses import replace

import numpy as np
import pytest

from drakeplan.campaigns.campaign import rows_table
from drakeplan.campaigns.card import Card
from drakeplan.campaigns.traversability import TraversabilityCampaign, _choose, counts_text
from drakeplan.cli import main
from drakeplan.guide.ground_view import documented_steps
from learning.traversability_labels import MODES, SCHEMA
from scenes.robots.robot import load_robot

SMALL = TraversabilityCampaign(poses=2)
MODEL, STEPS = documented_steps(load_robot("escher"))
V = len(STEPS.translations)
TASKS = 3


def seed(k: int) -> np.random.SeedSequence:
    return np.random.SeedSequence(11, spawn_key=(0, k))


@pytest.fixture(scope="module")
def rows() -> list[dict[str, object]]:
    """The labels of some environments."""
    return [dict(row) for k in range(TASKS) for row in SMALL.rows(seed(k), k)]


@pytest.fixture(scope="module")
def columns(rows) -> dict[str, np.ndarray]:
    return {name: np.array([row[name] for row in rows]) for name in SCHEMA.names}


def test_rows_fit_the_schema_and_hold_every_translation_of_every_mode_in_turn(rows, columns) -> None:
    table = rows_table(SCHEMA, rows)  # raises where a column is missing, null or not finite
    assert table.num_rows == len(rows) > 0 and len(rows) % (4 * V) == 0
    np.testing.assert_array_equal(columns["translation"], np.tile(np.arange(V), len(rows) // V))
    np.testing.assert_array_equal(columns["mode"], np.tile(np.repeat(np.arange(4), V), len(rows) // (4 * V)))
    keys = {(row["scene"], row["pose"], row["mode"], row["translation"]) for row in rows}
    assert len(keys) == len(rows)
    assert {row["pose"] for row in rows} <= set(range(SMALL.poses))


def test_the_rows_of_a_task_do_not_depend_on_what_ran_before(rows) -> None:
    last = max(row["scene"] for row in rows)
    again = rows_table(SCHEMA, SMALL.rows(seed(last), last)).to_pydict()
    assert pickle.dumps(again) == pickle.dumps(
        rows_table(SCHEMA, [row for row in rows if row["scene"] == last]).to_pydict()
    )


def test_another_seed_gives_other_poses(rows) -> None:
    other = SMALL.rows(np.random.SeedSequence(12, spawn_key=(0, 0)), 0)
    assert not {tuple(row["torso"]) for row in other} & {tuple(row["torso"]) for row in rows}


def test_no_more_pairs_are_useful_than_fit_and_some_are(columns) -> None:
    assert (columns["useful"] <= columns["pairs"]).all() and (columns["useful"] >= 0).all()
    assert (columns["useful"] > 0).any() and (columns["useful"] == 0).any()
    assert columns["pairs"].max() <= len(STEPS.pairs)


def test_features_are_sums_of_scores_and_counts_within_what_there_is(columns) -> None:
    most = np.bincount(STEPS.translation)[columns["translation"]]
    assert (columns["foot_scores"] <= most + 1e-9).all() and (columns["foot_scores"] > 0).any()
    assert (columns["pair_scores"] <= len(STEPS.pairs) + 1e-9).all()
    assert (columns["feet_fit"] == np.round(columns["feet_fit"])).all() and columns["feet_fit"].max() <= len(
        STEPS.pairs
    )
    for name in ("palm_scores", "palms_fit"):
        sides = columns[name].reshape(-1, 2, 2).sum(axis=2)
        assert (sides <= len(MODEL.rays) + 1e-9).all() and (columns[name] >= 0).all()
    assert (columns["palms_fit"] > 0).any(), "some of the environments have walls"


def test_the_features_of_a_pose_are_the_same_in_every_mode(columns) -> None:
    for name in ("foot_scores", "pair_scores", "palm_scores", "feet_fit", "palms_fit", "torso", "pairs"):
        by_pose = columns[name].reshape(-1, 4, V, *columns[name].shape[1:])
        np.testing.assert_array_equal(by_pose, np.repeat(by_pose[:, :1], 4, axis=1))


def test_where_there_is_no_wall_no_palm_finds_a_contact(columns) -> None:
    none = columns["walls"] == "none"
    assert not columns["palms_fit"][none].any() and not columns["palm_scores"][none].any()
    assert not columns["useful"][none & (columns["mode"] > 0)].any()


def test_fixed_feet_fit_nowhere_else_than_the_exact_features_say(rows, columns) -> None:
    (stay,) = np.flatnonzero(STEPS.direction_of_translation < 0)
    scene = next(int(row["scene"]) for row in rows if row["pairs"] > 0)
    fixed = replace(SMALL, footholds="fixed").rows(seed(scene), scene)
    assert fixed
    for row in fixed:
        if row["translation"] == stay:
            assert row["pairs"] == row["feet_fit"], "pairs that fit"


def test_parameters_name_all_that_labels_depend_on() -> None:
    base = SMALL.parameters
    assert base["translations"] == STEPS.translations.tolist() and base["transition_model"] == MODEL.name
    for other in (
        replace(SMALL, friction=0.6),
        replace(SMALL, cone="square"),
        replace(SMALL, footholds="fixed"),
        replace(SMALL, poses=3),
    ):
        assert other.parameters != base
    assert base["robot_model_sha256"] == load_robot("escher").model_sha256


def test_poses_without_footholds_are_drawn_rarely_and_none_twice() -> None:
    rng, pairs = np.random.default_rng(0), np.concatenate([np.zeros(20), np.full(20, 5.0)])
    drawn = [_choose(rng, pairs, 5) for _ in range(200)]
    assert all(len(set(chosen.tolist())) == 5 for chosen in drawn)
    share = (np.concatenate(drawn) < 20).mean()
    assert 0.03 < share < 0.25, "a tenth of the weight each"
    assert len(_choose(rng, np.ones(3), 5)) == 3


def test_the_table_of_counts_adds_up() -> None:
    counts = (
        {"mode": 0, "ground": "crossing", "rows": 30},
        {"mode": 3, "ground": "crossing", "rows": 20},
        {"mode": 0, "ground": "rubble", "rows": 10},
    )
    lines = counts_text(Card("traversability", 1, 0, {}, "", 1, 60, counts, (), (), "", ())).splitlines()
    assert lines[0].split() == ["mode", "labels", "crossing", "rubble"]
    said = {line.split()[0]: line.split()[1:] for line in lines[1:]}
    assert set(said) == set(MODES)
    assert said["feet"] == ["40", "30", "10"] and said["all"] == ["20", "20", "0"] and said["left_palm"] == ["0"] * 3


@pytest.mark.parametrize(
    ("words", "complaint"),
    [
        ("collect traversabilty --count 1 --out x", "did you mean traversability"),
        ("collect traversability --count 0 --out x", "--count: expected 1 or more"),
        ("collect traversability --count 1 --out x --friction 0", "--friction: expected more than 0"),
        ("collect traversability --count 1 --out x --robot eschr", "did you mean escher"),
    ],
)
def test_a_mistake_gets_one_line_and_exit_2(words: str, complaint: str, tmp_path, capsys, monkeypatch) -> None:
    monkeypatch.chdir(tmp_path)
    assert main(words.split()) == 2
    said = capsys.readouterr()
    lines = [line for line in said.err.replace("\r", "\n").splitlines() if "env/s" not in line and line.strip()]
    assert said.out == "" and len(lines) == 1 and complaint in lines[0]


def test_what_is_asked_for_on_the_command_line_is_what_is_collected() -> None:
    from drakeplan.cli.collect import Arguments, _campaign

    made = _campaign(Arguments("traversability", count=1, out="x", friction=0.7, footholds="fixed"))
    assert made == TraversabilityCampaign(friction=0.7, footholds="fixed")
