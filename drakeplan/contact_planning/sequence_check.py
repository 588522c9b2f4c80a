"""Judges whole contact sequences by the search's own checks and costs, for planners that choose all contacts at once."""

from __future__ import annotations

import itertools
from collections.abc import Sequence

import numpy as np

from drakeplan.contact_planning.contact_domain import PlannerWeights
from drakeplan.contact_planning.contact_pool import ContactPool
from drakeplan.contact_planning.transition_check import TransitionCheck
from drakeplan.context import QueryContext
from scenes.contact import Contact
from scenes.stance import Stance, changed_effector


class SequenceCheck:
    """Checks sequences of one query; results are kept by contact, so that a sequence that differs little costs little.

    Attributes:
        check: of single transitions.
    """

    def __init__(self, context: QueryContext, weights: PlannerWeights | None = None) -> None:
        """Prepares the check.

        Args:
            context: of the query.
            weights: of the cost (Lin 2020 eq. 3.2).
        """
        self._pool = ContactPool(context.packed)
        self._weights = weights or PlannerWeights()
        self._numbers: dict[Contact, int] = {}
        self.check = TransitionCheck(
            self._pool, context.robot, context.ik, context.packed, context.cone, context.reserve
        )

    def start_problem(self, stance: Stance) -> str:
        """Why the robot cannot stand at the start, "" if it can."""
        reason = self.check.stance(self.held(stance))
        return reason and f"start infeasible: {reason}"

    def why_it_fails(self, stances: Sequence[Stance]) -> list[tuple[int, str]]:
        """(k, reason) for every transition from stances[k] to the next that fails the transition check."""
        reasons = [self.check.transition(self.held(a), self.held(b)) for a, b in itertools.pairwise(stances)]
        return [(k, reason) for k, reason in enumerate(reasons) if reason]

    def cost(self, stances: Sequence[Stance]) -> float:
        """The sequence's cost by the search's measure (Lin 2020 eq. 3.2)."""
        total = 0.0
        for before, after in itertools.pairwise(stances):
            mover = changed_effector(before, after)
            old, new = before.contacts[mover], after.contacts[mover]
            total += self._weights.step
            if old is not None and new is not None:
                total += float(np.linalg.norm(new.p_WC - old.p_WC))
            if mover < 2 and old is not None and new is not None:
                total += self._weights.turn * 0.5 * abs(wrap(new.heading - old.heading))
        return total

    def held(self, stance: Stance) -> tuple[int, ...]:
        """Contact numbers by end effector, -1 where free."""
        return tuple(-1 if c is None else self._number(c) for c in stance.contacts)

    def _number(self, contact: Contact) -> int:
        if contact not in self._numbers:
            self._numbers[contact] = self._pool.add_contact(contact)
        return self._numbers[contact]


def feet_heading(stance: Stance) -> float:
    """The heading halfway between those of the feet, along the shorter way round [rad]."""
    feet = [c.heading for c in stance.contacts[:2] if c is not None]
    return feet[0] + 0.5 * wrap(feet[-1] - feet[0])


def wrap(angle: float) -> float:
    """The angle in [-pi, pi) [rad]."""
    return float((angle + np.pi) % (2 * np.pi) - np.pi)
