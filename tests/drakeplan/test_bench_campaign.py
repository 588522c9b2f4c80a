"""The campaign benchmark measures the same data on one worker and on two."""

import pytest

from drakeplan.bench import campaign
from drakeplan.bench.table import BenchOptions


@pytest.mark.slow
def test_two_workers_make_the_labels_of_one(monkeypatch):
    monkeypatch.setattr(campaign, "QUOTA", 1)
    table = campaign.run(BenchOptions(seeds=2))
    one, two = (dict(zip(table.columns, row, strict=True)) for row in table.rows)
    assert (one["workers"], two["workers"]) == (1, 2)
    assert one["labels"] == two["labels"] > 0
    assert one["data"] == two["data"] == "same"
    assert one["efficiency"] == 1.0 and two["efficiency"] > 0
