"""Contact planning with the exact dynamics of the last transitions together, asked only when a state is popped.

A state is six integers: those of `contact_domain`, and the number of a tail. A tail is the stances of the last
`window` transitions and the body's state before them; what happened earlier is settled, what happens in between is not.

    edge cost  (6.6)   w_xy d + w_s + w_dyn d_dyn      d_dyn: the least objective of the tail over its transitions
    heuristic  (6.7)   w_xy D + w_s D / d_max

One transition after the other with least effort (Lin 2020 sec. 6.4) gets stuck where a step needs speed that the ones
before it had no reason to give. And a program for every child would be asked about forty where one or two are popped: d_dyn
is charged when its state is confirmed.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from drakeplan.contact_planning.com_costs import DynamicCosts, DynamicWeights
from drakeplan.contact_planning.com_domain import COM_CELL, VELOCITY_CELL, State
from drakeplan.contact_planning.contact_domain import ContactDomain
from drakeplan.contact_planning.contact_pool import Held
from drakeplan.contact_planning.dynamics_evaluator import stance_of
from optimization.centroidal.window_dynamics import BodyState, TailDynamics

WINDOW = 5  # transitions
GREED = 200.0  # of the search until there is a first path: g counts this much less than h


@dataclass(eq=False)
class _Tail:
    """The end of a path, and what its program said once it was asked.

    Attributes:
        start: the body's state when the first stance's shift begins.
        held: contact numbers of consecutive stances, at most `WINDOW` transitions.
        reason: why these transitions cannot be made in a row, "" if they can, None while nobody has asked.
        cost: least objective of all transitions of the tail.
        second: state at the second stance, which the tails that follow a full one start from.
        end: state at the last stance.
    """

    start: BodyState
    held: tuple[Held, ...]
    reason: str | None = None
    cost: float = 0.0
    second: BodyState | None = None
    end: BodyState | None = None


class HindsightDomain:
    """Successors, heuristic, goal, lazy confirmation and late costs of states that carry a tail.

    Attributes:
        evaluator: answers for tails, and counts what it was asked.
        rejections: edges turned down, by why.
        careful: whether a transition must pass its critical configurations at rest too, as for `DynamicDomain`.
    """

    def __init__(
        self,
        contacts: ContactDomain,
        evaluator: TailDynamics,
        weights: DynamicWeights | None = None,
        window: int = WINDOW,
    ) -> None:
        if window < 1:
            raise ValueError(f"window: expected at least one transition, got {window}")
        self.contacts, self.evaluator, self.window = contacts, evaluator, window
        self.costs = DynamicCosts(contacts, weights or DynamicWeights())
        self.rejections = contacts.rejections
        self.careful = False
        self._tails: list[_Tail] = []
        self._number: dict[tuple[object, ...], int] = {}

    def start(self, held: Held, com: np.ndarray) -> State:
        """The state of standing still on these contacts with the CoM (3,) here [m]."""
        at_rest = BodyState(np.array(com, float))
        number = self._tail(at_rest, (tuple(held),))
        tail = self._tails[number]
        tail.reason, tail.end = "", at_rest
        return (*held, -1, number)

    def com_state(self, state: State) -> tuple[np.ndarray, np.ndarray]:
        """(3,) CoM [m] and (3,) its velocity [m/s] in a state that was confirmed, as its own tail has them end."""
        end = self._tails[state[5]].end
        if end is None:
            raise ValueError(f"state {state} has not been confirmed")
        return end.com, end.linear_momentum / self.contacts.robot.mass

    def successors(self, state: State) -> tuple[Sequence[State], np.ndarray]:
        """Every next state that closed-form bounds allow, at cost (6.6) without its dynamics."""
        children, _ = self.contacts.successors(state[:5])
        if not children:
            return [], np.zeros(0)
        tail = self._tails[state[5]]
        start, kept = tail.start, tail.held
        if len(kept) > self.window:
            assert tail.second is not None  # only confirmed states are expanded
            start, kept = tail.second, kept[1:]
        states = [(*child, self._tail(start, (*kept, tuple(child[:4])))) for child in children]
        return states, self.costs.of_steps(state, states)

    def heuristic(self, states: Sequence[State]) -> np.ndarray:
        """(n,) estimated cost to go (6.7); future dynamics are not in it."""
        return self.costs.to_go(states)

    def is_goal(self, state: State) -> bool:
        """Whether the mean of the feet is in the goal region."""
        return self.contacts.is_goal(state[:5])

    def confirm(self, parent: State, state: State) -> bool:
        """Whether forces can bring the tail about, and the body can be where they take it at either end of its last swing."""
        if self.contacts.is_forbidden(parent[:5], state[:5]):
            self.rejections["motion"] += 1
            return False
        tail = self._tails[state[5]]
        if tail.reason is None:
            self._ask(tail)
        reason = tail.reason
        if self.careful:
            reason = reason or self.contacts.check.transition(parent[:4], state[:4])
        if reason:
            self.rejections[reason] += 1
        return not reason

    def late_cost(self, state: State) -> float:
        """What the dynamics add to the cost of the edge to a confirmed state (6.6)."""
        tail = self._tails[state[5]]
        return self.costs.weights.dynamics * tail.cost / (len(tail.held) - 1)

    def _ask(self, tail: _Tail) -> None:
        """Solves a tail's program and looks for postures."""
        dynamics, pool, check = self.evaluator, self.contacts.pool, self.contacts.check
        estimate = dynamics.solve(tail.start, [stance_of(pool, held) for held in tail.held])
        trajectory = estimate.trajectory
        if not estimate.feasible or trajectory is None:
            tail.reason = "dynamics"
            return
        last = len(tail.held) - 2
        tail.cost = estimate.cost
        tail.second, tail.end = dynamics.at_touchdown(trajectory, 0), dynamics.at_touchdown(trajectory, last)
        lift = dynamics.at_lift_off(trajectory, last)
        tail.reason = check.at_com(tail.held[-2], lift.com) or check.at_com(tail.held[-1], tail.end.com)

    def _tail(self, start: BodyState, held: tuple[Held, ...]) -> int:
        velocity = start.linear_momentum / self.contacts.robot.mass
        cell = (
            *np.round(start.com / COM_CELL).astype(int).tolist(),
            *np.round(velocity / VELOCITY_CELL).astype(int).tolist(),
        )
        number = self._number.setdefault((held, cell), len(self._tails))
        if number == len(self._tails):
            self._tails.append(_Tail(start, held))
        return number
