"""When contacts are made and broken, and which stance holds in between: what a page steps through."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from drakeplan.plan.plan import Plan

STANCE_TIME = 1.0  # [s] that a stance of a plan without motion is shown for


@dataclass(frozen=True, eq=False)
class ContactTimeline:
    """The contacts that are held, phase by phase.

    Attributes:
        start: (P,) of each phase, since the motion began [s].
        contact: (P, E) index into the plan's contacts, -1 where the end effector is free.
        stance: (P,) number of the stance that holds or is being left, from 0.
        duration: of all phases [s].
        timed: whether the plan has times; without a motion every stance takes `STANCE_TIME`.
    """

    start: np.ndarray
    contact: np.ndarray
    stance: np.ndarray
    duration: float
    timed: bool

    @property
    def changes(self) -> np.ndarray:
        """(K,) times at which a contact is made or broken [s]."""
        changed = (self.contact[1:] != self.contact[:-1]).any(axis=1)
        times: np.ndarray = self.start[1:][changed]
        return times


def has_motion(plan: Plan) -> bool:
    """Whether there is anything that moves."""
    parts = (plan.phases, plan.centroidal, plan.motion)
    return all(part is not None and len(part) for part in parts)


def contact_timeline(plan: Plan) -> ContactTimeline:
    """The phases of a plan; its stances one after the other where it has no motion."""
    if not has_motion(plan):
        numbers = np.arange(len(plan.stances))
        return ContactTimeline(STANCE_TIME * numbers, plan.stances, numbers, STANCE_TIME * len(numbers), timed=False)
    assert plan.phases is not None
    assert plan.motion is not None
    start = plan.phases.start - plan.motion.t[0]
    return ContactTimeline(
        start, plan.phases.contact, stance_of_phase(plan.stances, plan.phases.contact), plan.duration, timed=True
    )


def stance_of_phase(stances: np.ndarray, held: np.ndarray) -> np.ndarray:
    """(P,) number of each phase's stance: the next one as soon as it is reached, else the first with all of the contacts.

    Args:
        stances: (S, E) contacts or -1, in order.
        held: (P, E) contacts or -1 of phases that pass through the stances in order.
    """
    found, now = [], 0
    for row in held:
        ahead = stances[now:]
        if len(ahead) > 1 and np.array_equal(row, ahead[1]):
            now += 1
        elif len(ahead):
            now += int(np.argmax(((ahead == row) | (row < 0)).all(axis=1)))  # 0 where none has them all
        found.append(now)
    return np.array(found, dtype=int)
