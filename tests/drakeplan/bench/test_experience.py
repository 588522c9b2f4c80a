"""The tables of `bench experience` count what their queries gave, and go on where they were stopped."""

from __future__ import annotations

from pathlib import Path

import pytest

from drakeplan.bench import experience
from drakeplan.bench.table import BenchOptions, BenchTable
from drakeplan.query.options import PlanOptions
from drakeplan.query.result import PlanResult
from scenes.robots.robot import Robot
from scenes.scene import Scene


class MadeUp:
    """Answers queries at once: adapting fails on sparse ground, everything else takes a second or two."""

    def __init__(self) -> None:
        self.asked = 0

    def __call__(self, scene: Scene, robot: Robot, options: PlanOptions) -> PlanResult:
        self.asked += 1
        sparse = len(scene.terrain.surfaces) < 40
        status = "none" if options.planner == "adapt" and sparse else "complete"
        used = "adapt" if options.planner == "parallel" else options.planner
        numbers = {"total_s": 1.0 + (used == "search"), "planning_s": 0.5, "palms_used": 0, "stances": 12}
        return PlanResult(status, "" if status == "complete" else "none fits", None, {**numbers, "planner": used})


@pytest.fixture
def made_up(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> MadeUp:
    answers = MadeUp()
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(experience, "plan_scene", answers)
    monkeypatch.setattr(experience, "load_kernels", lambda *_: None)
    times = BenchTable("experience_ranking", "times", ("plans",), (), most_seeds=0)
    monkeypatch.setattr(experience, "ranking_times", lambda *_: times)
    return answers


def test_experience_counts_every_way_and_density(made_up: MadeUp) -> None:
    ways, densities, _ = experience.run(BenchOptions(seeds=2))
    by_way = {row[0]: row for row in ways.rows}
    assert set(by_way) == set(experience.WAYS)
    assert all(row[2] == 2 for row in ways.rows)
    assert by_way["parallel"][-1] == 2  # all adapted first
    assert by_way["search"][6] == 2.0  # median seconds
    verified = {(row[0], row[1]): row[3] for row in densities.rows}
    assert verified[experience.DENSITIES[-1], "search"] == 2
    assert verified[experience.DENSITIES[-1], "adapt"] == 0
    assert experience.PICTURE.exists()
    before = made_up.asked
    experience.run(BenchOptions(seeds=2))
    assert made_up.asked == before  # everything was kept


def test_a_smaller_library_has_so_many_plans_of_the_shipped_one(made_up: MadeUp) -> None:
    experience.run(BenchOptions(seeds=1))
    folders = sorted(Path("out/libraries").iterdir())
    assert {len(list((folder / "plans").iterdir())) for folder in folders} == set(experience.SIZES)
