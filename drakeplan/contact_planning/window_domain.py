"""Contact planning with the exact dynamics of the last transitions together, solved only when a state is popped.

The sixth number of a state stands for a window: the stances of the last transitions and the body's state before them.
That state is fixed; the states within the window are free. d_dyn is the window's least objective over its transitions.

One transition after the other with least effort (Lin 2020 sec. 6.4) gets stuck where a step needs speed that the ones
before it had no reason to give. And a program for every child would mean about forty programs where one or two children
are popped: d_dyn is charged when its state is confirmed.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from drakeplan.contact_planning.com_costs import DynamicWeights
from drakeplan.contact_planning.contact_domain import ContactDomain
from drakeplan.contact_planning.contact_pool import Held
from drakeplan.contact_planning.dynamic_domain import DynamicDomain, State
from drakeplan.contact_planning.dynamics_evaluator import stance_of
from optimization.centroidal.window_dynamics import BodyState, WindowDynamics

WINDOW = 5  # transitions
HEURISTIC_WEIGHT = 200.0  # of the search until there is a first path: g counts this much less than h


@dataclass(eq=False)
class _Window:
    """The last stances of a path, and the result of its program once it was solved.

    Attributes:
        start: the body's state when the first stance's shift begins.
        held: contact numbers of consecutive stances, at most `WINDOW` transitions.
        reason: why these transitions cannot be made in a row, "" if they can, None while nobody has asked.
        cost: least objective of all transitions of the window.
        second: state at the second stance, which the windows that follow a full one start from.
        end: state at the last stance.

    Args:
        reason: why these transitions cannot be made in a row, "" if they can, None before the program was solved.
    """

    start: BodyState
    held: tuple[Held, ...]
    reason: str | None = None
    cost: float = 0.0
    second: BodyState | None = None
    end: BodyState | None = None


class WindowDomain(DynamicDomain):
    """States that carry the window of transitions behind them; dynamics are charged when a state is confirmed.

    Attributes:
        window: transitions that are solved together.
    """

    def __init__(
        self,
        contacts: ContactDomain,
        evaluator: WindowDynamics,
        weights: DynamicWeights | None = None,
        window: int = WINDOW,
    ) -> None:
        """Wraps a contact domain.

        Args:
            contacts: states without the CoM.
            evaluator: solves windows, and counts what it was asked.
            weights: of the edge cost (Lin 2020 eq. 6.6).
            window: transitions that are solved together, at least one.
        """
        if window < 1:
            raise ValueError(f"window: expected at least one transition, got {window}")
        super().__init__(contacts, weights)
        self.evaluator: WindowDynamics = evaluator
        self.window = window
        self._windows: list[_Window] = []

    def start(self, held: Held, com: np.ndarray) -> State:
        """The state of standing still.

        Args:
            held: contact numbers by end effector.
            com: (3,) CoM [m].
        """
        at_rest = BodyState(np.array(com, float))
        number = self._window_number(at_rest, (tuple(held),))
        window = self._windows[number]
        window.reason, window.end = "", at_rest
        return (*held, -1, number)

    def com_state(self, state: State) -> tuple[np.ndarray, np.ndarray]:
        """(3,) CoM [m] and (3,) its velocity [m/s] in a state that was confirmed, as its own window has them end."""
        end = self._windows[state[5]].end
        if end is None:
            raise ValueError(f"state {state} has not been confirmed")
        return end.com, end.linear_momentum / self.contacts.robot.mass

    def successors(self, state: State) -> tuple[Sequence[State], np.ndarray]:
        """Every next state that closed-form bounds allow, with its cost but for its dynamics."""
        children, _ = self.contacts.successors(state[:5])
        if not children:
            return [], np.zeros(0)
        window = self._windows[state[5]]
        start, kept = window.start, window.held
        if len(kept) > self.window:
            assert window.second is not None  # only confirmed states are expanded
            start, kept = window.second, kept[1:]
        states = [(*child, self._window_number(start, (*kept, tuple(child[:4])))) for child in children]
        return states, self.costs.step_costs(state, states)

    def dynamics_reason(self, state: State) -> str:
        """Why forces cannot bring the window about, or the body cannot follow at either end of its last swing."""
        window = self._windows[state[5]]
        if window.reason is None:
            self._ask(window)
        assert window.reason is not None
        return window.reason

    def late_cost(self, state: State) -> float:
        """What the dynamics add to the cost of the edge to a confirmed state (Lin 2020 eq. 6.6)."""
        window = self._windows[state[5]]
        return self.costs.weights.dynamics * window.cost / (len(window.held) - 1)

    def _ask(self, window: _Window) -> None:
        """Solves a window's program and looks for postures."""
        dynamics, pool, check = self.evaluator, self.contacts.pool, self.check
        estimate = dynamics.solve(window.start, [stance_of(pool, held) for held in window.held])
        trajectory = estimate.trajectory
        if not estimate.feasible or trajectory is None:
            window.reason = "dynamics"
            return
        last = len(window.held) - 2
        window.cost = estimate.cost
        window.second, window.end = dynamics.at_touchdown(trajectory, 0), dynamics.at_touchdown(trajectory, last)
        lift = dynamics.at_lift_off(trajectory, last)
        window.reason = check.at_com(window.held[-2], lift.com) or check.at_com(window.held[-1], window.end.com)

    def _window_number(self, start: BodyState, held: tuple[Held, ...]) -> int:
        velocity = start.linear_momentum / self.contacts.robot.mass
        number = self._number(held, start.com, velocity, len(self._windows))
        if number == len(self._windows):
            self._windows.append(_Window(start, held))
        return number
