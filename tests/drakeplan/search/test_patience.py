"""Dead ends of many states that differ by little: with patience the search leaves them, and finds what it found without."""

from __future__ import annotations

import numpy as np
import pytest

from drakeplan.search.ana_star import AnaStar, Limits

State = tuple[str, int]
POCKET, ROAD = 3000, 12


class Pocket:
    """A road to the goal that first leads away from it, beside a pocket that looks nearer and has no way out."""

    def __init__(self) -> None:
        self.expanded: list[State] = []

    def successors(self, state: State) -> tuple[list[State], np.ndarray]:
        self.expanded.append(state)
        where, k = state
        if where == "road":
            found = [("road", k + 1)] if k < ROAD else []
            found += [("pocket", 0)] if k == 0 else []
        else:
            found = [("pocket", j) for j in range(2 * k + 1, 2 * k + 3) if j < POCKET]
        return found, np.ones(len(found))

    def heuristic(self, states: list[State]) -> np.ndarray:
        road = {k: 5.0 + min(k, 3) - max(k - 3, 0) * 8.0 / (ROAD - 3) for k in range(ROAD + 1)}
        return np.array([road[k] if where == "road" else 3.0 + 1e-4 * k for where, k in states])

    def is_goal(self, state: State) -> bool:
        return state == ("road", ROAD)

    def confirm(self, parent: State, state: State) -> bool:
        return True


def alike(state: State) -> tuple[str, int]:
    return (state[0], state[1] if state[0] == "road" else 0)


def first_path(patience: float) -> tuple[AnaStar, tuple[State, ...], int]:
    domain = Pocket()
    search = AnaStar(domain, ("road", 0), alike=alike, patience=patience)
    found = next(search.run())
    return search, found.path, found.expansions


def test_a_patient_search_leaves_a_pocket_after_a_few_states() -> None:
    _, path, expansions = first_path(0.0)
    assert expansions > POCKET
    _, same, few = first_path(1.0)
    assert same == path
    assert few < 2 * ROAD + 10


@pytest.mark.parametrize("patience", [0.0, 0.3, 5.0])
def test_patience_changes_the_order_and_not_what_is_found_in_the_end(patience: float) -> None:
    domain = Pocket()
    search = AnaStar(domain, ("road", 0), alike=alike, patience=patience)
    last = list(search.run())[-1]
    assert search.ended_by == "exhausted"
    assert last.cost == ROAD
    assert last.path[-1] == ("road", ROAD)


def test_patience_keeps_limits_and_repeats() -> None:
    runs = []
    for _ in range(2):
        domain = Pocket()
        search = AnaStar(domain, ("road", 0), 0.2, 3, Limits(expansions=40), alike=alike, patience=0.5)
        assert len(list(search.run())) <= 1
        runs.append(domain.expanded)
    assert runs[0] == runs[1]
    assert len(runs[0]) <= 41
