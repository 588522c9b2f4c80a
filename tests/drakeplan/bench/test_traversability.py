"""The tables of `bench traversability` count what their searches gave, and go on where they were stopped."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path
from types import SimpleNamespace

import pytest

from drakeplan.bench import traversability
from drakeplan.bench.table import BenchOptions, BenchTable
from drakeplan.bench.traversability import CONTACTS_WITHIN, STANDARD, WAYS, WHOLE
from drakeplan.contact_planning.contact_plan import PlannerOptions
from drakeplan.context import QueryContext
from drakeplan.query.options import PlanOptions
from drakeplan.query.result import PlanResult
from drakeplan.search.ana_star import Limits
from learning.traversability import KINDS
from scenes.robots.robot import Robot
from scenes.scene import Scene

SETUP, STANDARD_S, LEARNED_S = 0.25, 1.0, 0.5  # [s] of the made-up searches, by their own clock
HOPELESS = "ecc-svr"  # finds nothing at all


class MadeUp:
    """Searches that take no time: the standard one finds ways with odd seeds alone, estimates make it faster, one is useless."""

    def __init__(self) -> None:
        self.now, self.asked, self.planned = 0.0, [], []

    def search(self, context: QueryContext, options: PlannerOptions) -> SimpleNamespace:
        """What stands for the planner."""
        self.asked.append(options)
        learned = options.heuristic == "traversability"
        self.now += SETUP * learned
        found = options.seed % 2 == 1 or (learned and options.estimator != HOPELESS)

        def plans(limits: Limits) -> Iterator[SimpleNamespace]:
            assert limits.deadline == CONTACTS_WITHIN - SETUP * learned, "the estimates are part of the time"
            assert limits.improve == 0.0
            self.now += LEARNED_S if learned else STANDARD_S
            if found and options.estimator != HOPELESS:
                yield SimpleNamespace(stances=(None,) * (10 + learned))

        counts = SimpleNamespace(expansions=7 if learned else 70)
        return SimpleNamespace(plans=plans, setup_s=SETUP * learned, counts=lambda: counts)

    def plan(self, scene: Scene, robot: Robot, options: PlanOptions) -> PlanResult:
        """What stands for a whole query."""
        self.planned.append(options)
        status = "complete" if options.heuristic == "traversability" or options.seed % 2 else "contacts"
        report = {"total_s": 2.0 + options.seed, "stances": 12, "time_to_first_s": 0.5}
        return PlanResult(status, "" if status == "complete" else "no motion", None, report)


@pytest.fixture
def made_up(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> MadeUp:
    answers = MadeUp()
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(traversability, "plan_scene", answers.plan)
    monkeypatch.setattr(traversability, "SearchPlanner", answers.search)
    monkeypatch.setattr(traversability, "load_kernels", lambda *_: None)
    monkeypatch.setattr(traversability, "WholeBodyIK", lambda robot: None)
    monkeypatch.setattr(traversability, "_poses", lambda robot: (None, None))
    monkeypatch.setattr(traversability, "_microseconds", lambda view, torso, exact: 900.0 if exact else 9.0)
    monkeypatch.setattr(traversability, "time", SimpleNamespace(perf_counter=lambda: answers.now))
    return answers


def by_way(table: BenchTable) -> dict[str, dict[str, object]]:
    return {str(row[0]): dict(zip(table.columns, row, strict=True)) for row in table.rows}


def test_what_is_not_found_counts_the_whole_time_and_set_up_counts_for_what_is(made_up: MadeUp) -> None:
    contacts, _, _ = traversability.run(BenchOptions(seeds=2))
    rows = by_way(contacts)
    assert list(rows) == list(WAYS)
    for way, row in rows.items():
        assert row["scenes"] == 2, "that any way solved"
        if way.startswith(STANDARD):
            assert (row["found"], row["median s"], row["set-up s"]) == (1, STANDARD_S, 0.0)
            assert row["mean s over all"] == (STANDARD_S + CONTACTS_WITHIN) / 2
            assert (row["expansions"], row["stances"]) == (70, 10)
        elif way.startswith(HOPELESS):
            assert (row["found"], row["mean s over all"]) == (0, CONTACTS_WITHIN)
        else:
            assert (row["found"], row["median s"], row["set-up s"]) == (2, SETUP + LEARNED_S, SETUP)
            assert row["mean s over all"] == SETUP + LEARNED_S
            assert (row["expansions"], row["stances"]) == (7, 11)


def test_each_way_is_set_beside_the_standard_one_with_the_same_footholds(made_up: MadeUp) -> None:
    contacts, _, _ = traversability.run(BenchOptions(seeds=4))
    for way, row in by_way(contacts).items():
        expected = "0 : 0" if way.startswith(STANDARD) else "0 : 2" if way.startswith(HOPELESS) else "4 : 0"
        assert row["faster : slower"] == expected, way


def test_searches_are_asked_with_the_footholds_and_the_estimator_of_their_way(made_up: MadeUp) -> None:
    traversability.run(BenchOptions(seeds=1))
    for options, (way, asked) in zip(made_up.asked, WAYS.items(), strict=True):
        assert options.footholds == asked["footholds"]
        assert options.estimator == asked.get("estimator", "")
        assert options.heuristic == ("grid" if way.startswith(STANDARD) else "traversability")
        assert (options.longer is None) == (asked["footholds"] == "fixed")
    fixed = {asked.get("estimator") for asked in WAYS.values() if asked["footholds"] == "fixed"}
    assert fixed == {None, *KINDS} - {"network"}, "every regressor that learned from fixed steps"


def test_whole_plans_count_where_they_are_verified(made_up: MadeUp) -> None:
    _, whole, _ = traversability.run(BenchOptions(seeds=3))
    rows = by_way(whole)
    assert list(rows) == list(WHOLE)
    assert (rows["search"]["queries"], rows["search"]["verified"], rows["search"]["median s"]) == (3, 1, 3.0)
    assert rows["search with traversability"]["verified"] == 3
    assert all(options.deadline == traversability.DEADLINE for options in made_up.planned)


def test_regressors_have_the_errors_of_their_cards(made_up: MadeUp) -> None:
    _, _, regressors = traversability.run(BenchOptions(seeds=1))
    rows = by_way(regressors)
    assert list(rows) == list(KINDS)
    for kind, row in rows.items():
        assert row["labels"] in ("fixed", "snapped")
        assert 0.0 <= float(str(row["error of exp(-n)"])) <= 1.0, "costs are from 0 to 1"
        assert -1.0 <= float(str(row["rank correlation"])) <= 1.0
        assert row["features us"] == (900.0 if kind.startswith("ecc") else 9.0)
    assert regressors.most_seeds == 0 and regressors.bench == "traversability"


def test_a_run_that_was_stopped_goes_on(made_up: MadeUp) -> None:
    first = traversability.run(BenchOptions(seeds=2))
    searched, planned = len(made_up.asked), len(made_up.planned)
    assert traversability.run(BenchOptions(seeds=2)) == first
    assert (len(made_up.asked), len(made_up.planned)) == (searched, planned) == (2 * len(WAYS), 2 * len(WHOLE))
    traversability.run(BenchOptions(seeds=3))
    assert (len(made_up.asked), len(made_up.planned)) == (3 * len(WAYS), 3 * len(WHOLE))


def test_scenes_are_drawn_from_their_seed_alone() -> None:
    draw: Callable[[int], Scene] = traversability.draw
    assert draw(3).terrain.surfaces == draw(3).terrain.surfaces != draw(4).terrain.surfaces
    counts = [len(draw(seed).terrain.surfaces) for seed in range(20)]
    assert max(counts) > 2 * min(counts), "sparse and dense ones"
