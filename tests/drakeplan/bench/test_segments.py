"""The table of `bench segments` counts what its queries gave, part by part, and goes on where it was stopped."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace

import pytest

from drakeplan.bench import segments
from drakeplan.bench.table import BenchOptions
from drakeplan.contact_planning.contact_plan import PlannerOptions
from drakeplan.context import QueryContext
from drakeplan.query.options import PlanOptions
from drakeplan.query.result import PlanResult
from scenes.robots.robot import Robot
from scenes.scene import Scene

GUIDE_S = 0.25  # [s] that the made-up guide takes
GUIDED = [way for way, asked in segments.WAYS.items() if "guide" in asked]


class MadeUp:
    """Answers queries at once: the search finds nothing with an odd seed, a guided one has two parts that are searched, one not."""

    def __init__(self) -> None:
        self.asked: list[PlanOptions] = []
        self.guides: list[bool] = []
        self.now = 0.0

    def __call__(self, scene: Scene, robot: Robot, options: PlanOptions) -> PlanResult:
        self.asked.append(options)
        guided = options.planner == "guided"
        status = "none" if options.planner == "search" and options.seed % 2 else "complete"
        numbers = {"total_s": 3.0 - guided + options.seed, "stances": 20 + 2 * options.seed, "palms_used": 1}
        methods = ("search", "adapt", "search") if guided and options.guide != "segments" else ("search",) * guided
        report = {
            **numbers,
            "planner": options.planner,
            "time_to_first_s": 0.5,
            "guide": [{"method": m} for m in methods],
        }
        return PlanResult(status, "" if status == "complete" else "no way", None, report)

    def guide(self, context: QueryContext, options: PlannerOptions, *, adapt: bool) -> None:
        """What stands for the planner along a guiding path: no more than the time it takes."""
        self.guides.append(adapt)
        self.now += GUIDE_S


@pytest.fixture
def made_up(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> MadeUp:
    answers = MadeUp()
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(segments, "plan_scene", answers)
    monkeypatch.setattr(segments, "load_kernels", lambda *_: None)
    monkeypatch.setattr(segments, "WholeBodyIK", lambda robot: None)
    monkeypatch.setattr(segments, "GuidedPlanner", answers.guide)
    monkeypatch.setattr(segments, "time", SimpleNamespace(perf_counter=lambda: answers.now))
    return answers


def test_every_scene_and_way_is_counted_and_what_is_verified_gives_the_numbers(made_up: MadeUp) -> None:
    table = segments.run(BenchOptions(seeds=2))
    assert [row[:3] for row in table.rows] == [(name, way, 2) for name in segments.SCENES for way in segments.WAYS]
    by_way = {row[1]: dict(zip(table.columns, row, strict=True)) for row in table.rows}
    assert by_way["search"]["verified"] == 1
    assert by_way["search"]["median s"] == 3.0 and by_way["search"]["stances"] == 20
    for way in GUIDED:
        assert by_way[way]["verified"] == 2
        assert by_way[way]["median s"] == 2.5 and by_way[way]["stances"] == 21
        assert by_way[way]["guiding path s"] == GUIDE_S
    assert by_way["guided, mean"]["searched / adapted"] == "2.0 / 1.0"
    assert by_way["segments, all searched"]["searched / adapted"] == "1.0 / 0.0"
    for way in set(segments.WAYS) - set(GUIDED):
        assert by_way[way]["searched / adapted"] == ""
    assert table.most_seeds == segments.MOST_SEEDS


def test_queries_are_asked_as_their_way_says_and_have_the_whole_deadline(made_up: MadeUp) -> None:
    segments.run(BenchOptions(seeds=1))
    ways = list(segments.WAYS.values()) * len(segments.SCENES)
    for options, way in zip(made_up.asked, ways, strict=True):
        assert options.deadline == segments.DEADLINE and options.seed == 0
        assert {key: getattr(options, key) for key in way} == way
    assert made_up.guides == [segments.WAYS[way]["guide"] != "segments" for way in GUIDED] * len(segments.SCENES)


def test_a_run_that_was_stopped_asks_only_for_what_is_missing(made_up: MadeUp) -> None:
    first = segments.run(BenchOptions(seeds=1))
    once = len(made_up.asked)
    assert segments.run(BenchOptions(seeds=1)) == first
    assert len(made_up.asked) == once
    lines = segments.KEPT.read_text(encoding="utf-8").splitlines(keepends=True)
    segments.KEPT.write_text("".join(lines[:-3]), encoding="utf-8")
    assert segments.run(BenchOptions(seeds=1)) == first
    assert len(made_up.asked) == once + 3
    segments.run(BenchOptions(seeds=2))
    assert len(made_up.asked) == 2 * once + 3
