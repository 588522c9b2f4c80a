"""The table of `bench braced_ramp` counts what its plans gave, and leaves Drake's checks out of the search."""

from __future__ import annotations

import numpy as np
import pytest

from drakeplan.bench import braced_ramp
from drakeplan.bench.table import BenchOptions
from drakeplan.bracing.braced_planner import BracedPlan, Heuristic


def made_up(
    ramp: object, bracer: object, heuristic: Heuristic, seed: int = 0, deadline: float = 0.0
) -> BracedPlan | None:
    """A plan at once: the standard heuristic finds one with even seeds alone, the other one with a step more each seed."""
    if heuristic == "grid" and seed % 2:
        return None
    steps = 8 + seed
    base, postures = np.zeros((steps, 4, 4)), np.zeros((steps, 2, 16))
    return BracedPlan(np.zeros((steps + 1, 2, 3)), base, postures, 10 * steps, 0, 1.0 + seed, 0.25)


def test_every_way_is_asked_for_every_wall_and_only_plans_have_numbers(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(braced_ramp, "plan_braced", made_up)
    table = braced_ramp.run(BenchOptions(seeds=3))
    rows = {str(row[0]): dict(zip(table.columns, row, strict=True)) for row in table.rows}
    assert list(rows) == list(braced_ramp.WAYS)
    standard, other = rows["standard"], rows["traversability"]
    assert (standard["walls"], standard["planned"]) == (3, 2)
    assert (other["walls"], other["planned"]) == (3, 3)
    assert standard["median s"] == 2.0 - 0.25 and standard["with Drake's checks s"] == 2.0
    assert standard["steps"] == "8 to 10" == other["steps"]
    assert other["expansions"] == 90


def test_where_nothing_is_planned_the_table_says_so(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(braced_ramp, "plan_braced", lambda *_: None)
    table = braced_ramp.run(BenchOptions(seeds=1))
    assert [row[1:3] for row in table.rows] == [(1, 0), (1, 0)]
    assert [dict(zip(table.columns, row, strict=True))["steps"] for row in table.rows] == ["", ""]
