"""Anytime Nonparametric A* (van den Berg, Shah, Huang, Goldberg, AAAI 2011; Lin 2020 algorithm 1).

It searches any `Domain`; it knows no robots. Nodes carry their own parent, so every path that comes out has had each
of its edges confirmed, even when a state is reached again more cheaply later on.

    e(s) = (G - g(s)) / h(s)        the next node expanded is the one of greatest e       (Lin 2020 algorithm 1, line 1)
    E    = max of e over OPEN       G is at most E times the optimum if h never overestimates

Lin 2020 sec. 6.4 adds the epsilon-greedy choice: with probability epsilon any open node is expanded instead, which
lets the search leave dead ends and keeps every guarantee.

Costs may come late, as in Lazy Weighted A* (Cohen, Phillips, Likhachev, SoCS 2014): a domain may charge the rest of an edge
once it is confirmed, and the node then returns to OPEN with its full cost.
"""

from __future__ import annotations

import heapq
import time
from collections.abc import Callable, Hashable, Iterator, Sequence
from dataclasses import dataclass, field
from typing import Generic, Protocol, TypeVar, runtime_checkable

import numpy as np

State = TypeVar("State", bound=Hashable)
Reached = TypeVar("Reached", bound=Hashable, contravariant=True)

TINY = 1e-9  # a heuristic below this counts as zero: the state is as good as at the goal


class Domain(Protocol[State]):
    """What the search needs of a search problem."""

    def successors(self, state: State) -> tuple[Sequence[State], np.ndarray]:
        """The next states and the (n,) costs >= 0 of reaching them, in one batch."""
        ...

    def heuristic(self, states: Sequence[State]) -> np.ndarray:
        """(n,) estimates of the cost to go; inf where the goal cannot be reached."""
        ...

    def is_goal(self, state: State) -> bool:
        """Whether the search may end here."""
        ...

    def confirm(self, parent: State, state: State) -> bool:
        """The expensive check of one edge, called once the state is about to be expanded.

        Args:
            parent: the state that the edge leaves.
            state: the state that it leads to.

        Returns:
            Whether the edge holds.
        """
        ...


@runtime_checkable
class LateCosts(Protocol[Reached]):
    """A domain that knows the whole cost of reaching a state only after its first check."""

    def late_cost(self, state: Reached) -> float:
        """What is added, >= 0, to the cost of any edge to this state, which has been confirmed."""
        ...


@dataclass(frozen=True)
class Limits:
    """When to stop. None means no limit.

    Attributes:
        deadline: seconds from the start of the search.
        first_within: seconds from the start of the search in which the first solution has to come.
        expansions: nodes expanded; unlike a deadline it makes runs repeatable.
        improve: seconds after the first solution.
        improve_expansions: nodes expanded after the first solution.
        stop: polled before every pop; True stops the search (cancellation).
    """

    deadline: float | None = None
    expansions: int | None = None
    improve: float | None = None
    stop: Callable[[], bool] | None = None
    first_within: float | None = None
    improve_expansions: int | None = None


@dataclass(frozen=True)
class Incumbent(Generic[State]):
    """A better path than any before.

    Attributes:
        path: states from start to goal.
        cost: sum of its edge costs.
        bound: E; the cost is at most this many times the optimum, given an admissible heuristic.
        expansions: nodes expanded so far.
        elapsed: seconds since the search began.
    """

    path: tuple[State, ...]
    cost: float
    bound: float
    expansions: int
    elapsed: float


@dataclass(slots=True)
class _Node(Generic[State]):
    state: State
    g: float
    h: float
    parent: _Node[State] | None
    open: bool = True
    confirmed: bool = False
    charged: bool = False  # whether the late cost is in g
    wait: float = 0.0  # added to h where many states like this one were expanded


@dataclass
class AnaStar(Generic[State]):
    """One search; iterate over `run` for ever better paths.

    Attributes:
        domain: what to search.
        start: where from.
        epsilon: probability of expanding any open node instead of the best one.
        seed: of that choice.
        limits: when to stop.
        expansions: nodes expanded so far.
        rejected: edges that `confirm` turned down so far.
        ended_by: "exhausted", "deadline", "expansions", "improve" (its seconds), "improved" (its nodes), "cancelled" or ""
            while it runs.
        best_cost: G, of the best path so far.
        clock: seconds; a caller that works between two paths may pass one that it can stop.
        heuristic_weight: weight of the heuristic against the cost so far until there is a first path; by default that cost does
            not count, as if G were infinite.
        alike: what states have in common that are about as good as each other, None: nothing.
        patience: until there is a first path, each state that is expanded makes those like it wait: this much is added
            to their heuristic. Else a dead end of many states that differ by little is searched to its last corner.
    """

    domain: Domain[State]
    start: State
    epsilon: float = 0.0
    seed: int = 0
    limits: Limits = field(default_factory=Limits)
    expansions: int = 0
    rejected: int = 0
    ended_by: str = ""
    best_cost: float = np.inf
    clock: Callable[[], float] = time.perf_counter
    heuristic_weight: float = np.inf
    alike: Callable[[State], Hashable] | None = None
    patience: float = 0.0

    def __post_init__(self) -> None:
        if not 0 <= self.epsilon < 1:
            raise ValueError(f"epsilon must lie in [0, 1), got {self.epsilon}")
        if not self.heuristic_weight > 0:
            raise ValueError(f"heuristic_weight must be > 0, got {self.heuristic_weight}")
        self._charges = isinstance(self.domain, LateCosts)
        self._expanded: dict[Hashable, int] = {}  # how many states of each kind
        self._rng = np.random.default_rng(self.seed)
        self._heap: list[tuple[float, int, _Node[State]]] = []
        self._counter = 0
        self._best_open: dict[State, _Node[State]] = {}  # the cheapest node known to each state
        self._late: dict[State, float] = {}  # late costs that are known
        self._others: dict[State, list[_Node[State]]] = {}  # dearer ones, in case confirm turns the cheapest down
        self._began = 0.0
        self._first_at: float | None = None
        self._first_expansions = 0

    @property
    def bound(self) -> float:
        """E: the best solution costs at most this many times the optimum (admissible heuristics only)."""
        if not np.isfinite(self.best_cost):
            return np.inf
        open_nodes = [n for _, _, n in self._heap if n.open]
        if not open_nodes:
            return 1.0
        return max(1.0, max(self._ratio(n) for n in open_nodes))

    def reached(self) -> list[State]:
        """The states to which the cheapest known way was confirmed, the start among them."""
        return [state for state, node in self._best_open.items() if node.confirmed or node.parent is None]

    def run(self) -> Iterator[Incumbent[State]]:
        """Yields ever better paths until a limit fires or nothing better is left; `ended_by` says which."""
        self._began = self.clock()
        h = float(self.domain.heuristic([self.start])[0])
        if np.isfinite(h):
            self._add(_Node(self.start, 0.0, h, None))
        while True:
            node = self._improve()
            if node is None:
                return
            self.best_cost = node.g
            if self._first_at is None:
                self._first_at, self._first_expansions = self.clock(), self.expansions
            self._prune_and_rekey()
            yield Incumbent(_path(node), node.g, self.bound, self.expansions, self.clock() - self._began)

    def _improve(self) -> _Node[State] | None:
        while True:
            if self._out_of_budget():
                return None
            node = self._pop()
            if node is None:
                self.ended_by = "exhausted"
                return None
            if node.g + node.h >= self.best_cost:
                continue
            if node.parent is not None and not node.confirmed:
                if not self.domain.confirm(node.parent.state, node.state):
                    self.rejected += 1
                    self._next_best(node)
                    continue
                node.confirmed = True
                if self._charges:
                    self._late[node.state] = self.domain.late_cost(node.state)  # type: ignore[attr-defined]
                    if self._charge(node):  # back into OPEN, at its true cost
                        node.open = True
                        self._push(node)
                        continue
            if self.domain.is_goal(node.state):
                return node
            self._expand(node)

    def _charge(self, node: _Node[State]) -> bool:
        """Adds what has become known of the cost of reaching a node's state; whether that changes anything."""
        if node.charged or node.state not in self._late:
            return False
        node.g += self._late[node.state]
        node.charged = True
        return self._late[node.state] > 0

    def _waits(self, node: _Node[State]) -> bool:
        """Puts a node back into OPEN where states like it were expanded since it got there; whether it did."""
        if self.alike is None or np.isfinite(self.best_cost):
            return False
        wait = self.patience * self._expanded.get(self.alike(node.state), 0)
        if wait <= node.wait:
            return False
        node.wait, node.open = wait, True
        self._push(node)
        return True

    def _expand(self, node: _Node[State]) -> None:
        self.expansions += 1
        if self.alike is not None:
            kind = self.alike(node.state)
            self._expanded[kind] = self._expanded.get(kind, 0) + 1
        states, costs = self.domain.successors(node.state)
        if not len(states):
            return
        totals = node.g + np.asarray(costs, dtype=float)
        estimates = self.domain.heuristic(states)
        worthwhile = np.flatnonzero(totals + estimates < self.best_cost)
        for k in worthwhile.tolist():
            self._add(_Node(states[k], float(totals[k]), float(estimates[k]), node))

    def _add(self, node: _Node[State]) -> None:
        self._charge(node)
        known = self._best_open.get(node.state)
        if known is not None and known.g <= node.g:
            if known.open:  # not confirmed yet: this one may have to stand in for it
                self._others.setdefault(node.state, []).append(node)
            return
        if known is not None and known.open:
            known.open = False
            self._others.setdefault(node.state, []).append(known)
        self._best_open[node.state] = node
        self._push(node)

    def _next_best(self, node: _Node[State]) -> None:
        """After `confirm` rejected this node, puts the next cheapest path to its state into OPEN."""
        if self._best_open.get(node.state) is not node:
            return
        others = self._others.get(node.state)
        if not others:
            del self._best_open[node.state]
            return
        others.sort(key=lambda other: -other.g)
        best = others.pop()
        self._charge(best)
        best.open = True
        self._best_open[node.state] = best
        self._push(best)

    def _push(self, node: _Node[State]) -> None:
        self._counter += 1
        heapq.heappush(self._heap, (self._key(node), self._counter, node))

    def _pop(self) -> _Node[State] | None:
        if self.epsilon and self._heap and self._rng.random() < self.epsilon:
            for _ in range(8):  # closed entries stay in the heap until they surface
                node = self._heap[int(self._rng.integers(len(self._heap)))][2]
                if node.open:
                    node.open = False
                    return node
        while self._heap:
            node = heapq.heappop(self._heap)[2]
            if node.open:
                node.open = False
                if not self._waits(node):
                    return node
        return None

    def _key(self, node: _Node[State]) -> float:
        return (
            -self._ratio(node) if np.isfinite(self.best_cost) else node.h + node.wait + node.g / self.heuristic_weight
        )

    def _ratio(self, node: _Node[State]) -> float:
        """e(s); infinite where h says that the goal is at hand."""
        return (self.best_cost - node.g) / node.h if node.h > TINY else np.inf

    def _prune_and_rekey(self) -> None:
        keep = [(c, n) for _, c, n in self._heap if n.open and n.g + n.h < self.best_cost]
        self._heap = [(self._key(n), c, n) for c, n in keep]
        heapq.heapify(self._heap)

    def _out_of_budget(self) -> bool:
        limits = self.limits
        if limits.expansions is not None and self.expansions >= limits.expansions:
            self.ended_by = "expansions"
        elif limits.stop is not None and limits.stop():
            self.ended_by = "cancelled"
        else:
            now = self.clock()
            late = limits.deadline if self._first_at is not None else _least(limits.deadline, limits.first_within)
            if late is not None and now - self._began >= late:
                self.ended_by = "deadline"
            elif self._first_at is not None:
                if limits.improve is not None and now - self._first_at >= limits.improve:
                    self.ended_by = "improve"
                elif _reached(self.expansions - self._first_expansions, limits.improve_expansions):
                    self.ended_by = "improved"
        return bool(self.ended_by)


def _least(a: float | None, b: float | None) -> float | None:
    return min((v for v in (a, b) if v is not None), default=None)


def _reached(count: int, limit: int | None) -> bool:
    return limit is not None and count >= limit


def _path(node: _Node[State]) -> tuple[State, ...]:
    states = []
    step: _Node[State] | None = node
    while step is not None:
        states.append(step.state)
        step = step.parent
    return tuple(reversed(states))
