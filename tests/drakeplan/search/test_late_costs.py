"""Costs that are known only once an edge is confirmed: the same answers as if they had been known before."""

from __future__ import annotations

import numpy as np
import pytest

from drakeplan.search.ana_star import AnaStar


class Ladder:
    """A directed graph over rungs 0..n-1 with edges to the next three rungs; part of every cost comes late."""

    def __init__(self, seed: int, late: bool, rungs: int = 14) -> None:
        rng = np.random.default_rng(seed)
        self.early = rng.uniform(0.5, 1.0, (rungs, 2, 4, 2))
        self.late = rng.uniform(0.0, 2.0, (rungs, 2))  # of reaching a node, whichever way
        self.rungs, self.asked = rungs, 0
        if late:
            self.late_cost = lambda state: float(self.late[state])

    def successors(self, state):
        rung, side = state
        ends = [(rung + k, s) for k in (1, 2, 3) for s in (0, 1) if rung + k < self.rungs]
        known = not hasattr(self, "late_cost")
        costs = [self.early[rung, side, r - rung, s] + (self.late[r, s] if known else 0.0) for r, s in ends]
        return ends, np.array(costs)

    def heuristic(self, states):
        return np.array([0.5 * np.ceil((self.rungs - 1 - rung) / 3) for rung, _ in states])

    def is_goal(self, state):
        return state[0] == self.rungs - 1

    def confirm(self, parent, state):
        self.asked += 1
        return True


@pytest.mark.parametrize("heuristic_weight", [1.0, 20.0, np.inf])
def test_late_costs_count_in_full_and_the_last_path_is_the_cheapest(heuristic_weight: float) -> None:
    for seed in range(40):
        late, early = Ladder(seed, True), Ladder(seed, False)
        found = list(AnaStar(late, (0, 0), heuristic_weight=heuristic_weight).run())
        known = list(AnaStar(early, (0, 0)).run())
        assert found[-1].cost == pytest.approx(known[-1].cost)
        for f in found:
            steps = zip(f.path[:-1], f.path[1:], strict=True)
            cost = sum(late.early[*a, b[0] - a[0], b[1]] + late.late[b] for a, b in steps)
            assert f.cost == pytest.approx(cost)


def test_less_heuristic_weight_finds_a_cheaper_first_path() -> None:
    def first(heuristic_weight: float) -> float:
        return float(
            np.mean(
                [
                    next(AnaStar(Ladder(k, True), (0, 0), heuristic_weight=heuristic_weight).run()).cost
                    for k in range(40)
                ]
            )
        )

    assert first(1.0) < first(5.0) < first(np.inf)


def test_heuristic_weight_must_be_positive() -> None:
    with pytest.raises(ValueError, match="heuristic_weight"):
        AnaStar(Ladder(0, True), (0, 0), heuristic_weight=0.0)
