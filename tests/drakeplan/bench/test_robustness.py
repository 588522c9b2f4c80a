"""The table of `bench robustness` puts draws together, and goes on where it was stopped."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from drakeplan.bench import robustness
from drakeplan.bench.table import BenchOptions

PAIRS = {"swing_pairs": 40, "double_pairs": 60}


@pytest.fixture
def asked(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> list[tuple[str, int]]:
    """The trials that were made; draw n falls n times in swings, and the second draw of the stones has no plan."""
    made: list[tuple[str, int]] = []

    def trial(name: str, seed: int, robot: object, way: dict[str, object]) -> dict:
        made.append((name, seed))
        if (name, seed) == ("rubble_with_wall", 1):
            return {"status": "none", "reason": "no way", "p_success": None}
        return PAIRS | {
            "status": "complete", "reason": "", "p_success": 0.9 - 0.1 * seed, "steps": 5 + seed, "first_s": 0.2,
            "best_s": 20.0, "predicted": 0.95, "swing_failed": seed, "double_failed": 2,
        }  # fmt: skip

    monkeypatch.setattr(robustness, "_trial", trial)
    monkeypatch.setattr(robustness, "KEPT", tmp_path / "kept.jsonl")
    monkeypatch.setattr(robustness, "load_robot", lambda name: None)
    return made


def test_every_scene_has_every_way_and_its_own_number_of_draws(asked: list[tuple[str, int]]) -> None:
    table = robustness.run(BenchOptions(seeds=3))
    assert [row[:2] for row in table.rows] == [(name, way) for name in robustness.SCENES for way in robustness.WAYS]
    assert asked.count(("narrow_flat", 0)) == len(robustness.WAYS)
    assert asked.count(("rubble_with_wall", 2)) == len(robustness.WAYS)
    assert ("rubble_with_wall", 3) not in asked


def test_means_are_over_the_draws_that_have_a_plan(asked: list[tuple[str, int]]) -> None:
    rows = {row[:2]: dict(zip(robustness.run(BenchOptions(seeds=3)).columns, row, strict=True)) for row in
            robustness.run(BenchOptions(seeds=3)).rows}  # fmt: skip
    stones = rows["rubble_with_wall", "swing"]
    assert stones["verified"] == "2 of 3"
    assert stones["fell in swings"] == "1 of 40"
    assert stones["steps"] == pytest.approx(6.0)
    assert stones["P_success %"] == "80.0 ± 10.0"
    assert rows["narrow_flat", "swing"]["P_success %"] == "90.0"


def test_a_stopped_run_makes_no_trial_twice(asked: list[tuple[str, int]]) -> None:
    robustness.run(BenchOptions(seeds=2))
    before = len(asked)
    robustness.run(BenchOptions(seeds=2))
    assert len(asked) == before


def test_published_figures_are_of_scenes_and_ways_that_the_table_has() -> None:
    assert all(name in robustness.SCENES and way in robustness.WAYS for name, way in robustness.PUBLISHED)
    assert np.all([0 < float(value) <= 100 for value in robustness.PUBLISHED.values()])
