"""ANA* against brute force on small random graphs, and its promises about limits, bounds and lazy confirmation."""

from __future__ import annotations

import heapq
import itertools

import numpy as np
import pytest

from drakeplan.search.ana_star import AnaStar, Limits


class RandomGraph:
    """A directed graph with an admissible heuristic (the true cost to go, scaled down) and edges that may be refused."""

    def __init__(self, seed: int, nodes: int = 30, refuse: float = 0.0) -> None:
        rng = np.random.default_rng(seed)
        self.edges = {
            i: [(int(j), float(rng.uniform(0.1, 2))) for j in rng.choice(nodes, 4, replace=False) if j != i]
            for i in range(nodes)
        }
        self.refused = {(i, j) for i in self.edges for j, _ in self.edges[i] if rng.random() < refuse}
        self.goal = nodes - 1
        self.to_go = self._true_costs(include_refused=True)
        self.scale = float(rng.uniform(0.2, 1.0))
        self.asked: list[tuple[int, int]] = []

    def _true_costs(self, *, include_refused: bool) -> np.ndarray:
        """Dijkstra on the reversed graph: the slow, obvious twin."""
        cost = np.full(len(self.edges), np.inf)
        cost[self.goal] = 0.0
        heap = [(0.0, self.goal)]
        back: dict[int, list[tuple[int, float]]] = {i: [] for i in self.edges}
        for i, out in self.edges.items():
            for j, c in out:
                if include_refused or (i, j) not in self.refused:
                    back[j].append((i, c))
        while heap:
            d, j = heapq.heappop(heap)
            if d > cost[j]:
                continue
            for i, c in back[j]:
                if d + c < cost[i]:
                    cost[i] = d + c
                    heapq.heappush(heap, (d + c, i))
        return cost

    def successors(self, state: int) -> tuple[list[int], np.ndarray]:
        return [j for j, _ in self.edges[state]], np.array([c for _, c in self.edges[state]])

    def heuristic(self, states: list[int]) -> np.ndarray:
        return self.scale * self.to_go[list(states)]

    def is_goal(self, state: int) -> bool:
        return state == self.goal

    def confirm(self, parent: int, state: int) -> bool:
        self.asked.append((parent, state))
        return (parent, state) not in self.refused

    def path_cost(self, path: tuple[int, ...]) -> float:
        return sum(dict(self.edges[a])[b] for a, b in itertools.pairwise(path))


class Endless:
    """A binary tree without an end and without a goal."""

    def successors(self, state: int) -> tuple[list[int], np.ndarray]:
        return [2 * state + 1, 2 * state + 2], np.ones(2)

    def heuristic(self, states: list[int]) -> np.ndarray:
        return np.ones(len(states))

    def is_goal(self, state: int) -> bool:
        return False

    def confirm(self, parent: int, state: int) -> bool:
        return True


@pytest.mark.parametrize("epsilon", [0.0, 0.3])
@pytest.mark.parametrize("refuse", [0.0, 0.3])
def test_the_last_path_is_the_cheapest_one_and_every_bound_holds(epsilon: float, refuse: float) -> None:
    solved = 0
    for seed in range(200):
        graph = RandomGraph(seed, refuse=refuse)
        optimum = graph._true_costs(include_refused=False)[0]
        search = AnaStar(graph, 0, epsilon, seed)
        found = list(search.run())
        assert search.ended_by == "exhausted"
        if not np.isfinite(optimum):
            assert not found
            continue
        solved += 1
        costs = [f.cost for f in found]
        assert costs == sorted(costs, reverse=True)
        assert found[-1].cost == pytest.approx(optimum)
        for f in found:
            assert f.path[0] == 0 and f.path[-1] == graph.goal
            assert f.cost == pytest.approx(graph.path_cost(f.path))
            assert f.cost <= f.bound * optimum * (1 + 1e-9)
            assert not graph.refused & set(itertools.pairwise(f.path))
    assert solved > 100


def test_an_edge_is_confirmed_only_when_its_end_is_about_to_be_expanded() -> None:
    graph = RandomGraph(3)
    search = AnaStar(graph, 0)
    next(search.run())
    assert 0 < len(graph.asked) <= search.expansions + 1  # and the goal, which is not expanded
    made = sum(len(graph.edges[i]) for i in (0, *(j for _, j in graph.asked)))
    assert len(graph.asked) < 0.5 * made


def test_the_same_seed_gives_the_same_run() -> None:
    runs = [[(f.path, f.cost, f.expansions) for f in AnaStar(RandomGraph(5), 0, 0.3, 11).run()] for _ in range(2)]
    assert runs[0] == runs[1]


def test_an_expansion_budget_is_kept_exactly() -> None:
    for budget in (0, 1, 5):
        search = AnaStar(Endless(), 0, limits=Limits(expansions=budget))
        assert list(search.run()) == []
        assert (search.expansions, search.ended_by) == (budget, "expansions")


def test_a_deadline_ends_an_endless_search_in_time() -> None:
    now = itertools.count()
    search = AnaStar(Endless(), 0, limits=Limits(deadline=500.0), clock=lambda: float(next(now)))
    assert list(search.run()) == []
    assert search.ended_by == "deadline"
    assert next(now) < 520


def test_a_cancelled_search_keeps_what_it_found() -> None:
    graph = RandomGraph(2)
    cancelled = []
    search = AnaStar(graph, 0, limits=Limits(stop=lambda: bool(cancelled)))
    found = []
    for incumbent in search.run():
        found.append(incumbent)
        cancelled.append(True)
    assert len(found) == 1
    assert search.ended_by == "cancelled"


def test_an_unreachable_goal_exhausts_the_search_without_an_expansion() -> None:
    graph = RandomGraph(0)
    graph.to_go[:] = np.inf
    search = AnaStar(graph, 0)
    assert list(search.run()) == []
    assert (search.ended_by, search.expansions) == ("exhausted", 0)


def test_epsilon_outside_its_range_is_refused() -> None:
    with pytest.raises(ValueError, match="epsilon"):
        AnaStar(RandomGraph(0), 0, epsilon=1.0)
