"""The campaign benchmark measures the same data on one worker, on two, and on two that are stopped half way."""

import pytest

from drakeplan.bench import campaign
from drakeplan.bench.table import BenchOptions


@pytest.mark.slow
def test_two_workers_make_the_labels_of_one_also_when_they_are_stopped_half_way(monkeypatch):
    monkeypatch.setattr(campaign, "QUOTA", 1)
    monkeypatch.setattr(campaign, "WARM", 1)
    table = campaign.run(BenchOptions(seeds=2))
    one, two, resumed = (dict(zip(table.columns, row, strict=True)) for row in table.rows)
    assert [row["workers"] for row in (one, two, resumed)] == ["1", "2", "2, stopped and resumed"]
    assert one["labels"] == two["labels"] == resumed["labels"] > 0
    assert one["data"] == two["data"] == resumed["data"] == "same"
    assert one["efficiency"] == 1.0
    for row in (one, two, resumed):
        assert row["labels/s"] == pytest.approx(row["labels"] / row["wall s"])
        assert 0 < row["workers busy"] <= 1.0, "no worker is busier than the clock"
        assert row["start-up s"] > 0
    product = two["labels per CPU s"] / one["labels per CPU s"] * two["workers busy"] / one["workers busy"]
    assert two["efficiency"] == pytest.approx(product)
    assert resumed["workers' CPU s"] > 0 and "1 of 2 environments" in table.notes[2], (
        "the one that had ended is done again"
    )
