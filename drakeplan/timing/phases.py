"""When which contacts may carry load: the fixed timing of a contact sequence (Lin 2020 sec. 6.7)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from scenes.contact import Contact
from scenes.effector import EFFECTORS
from scenes.stance import Stance, changed_effector

BREAK, MAKE, MOVE = "break", "make", "move"
ON_GRID = 1e-6  # [steps] a boundary this close to a multiple of the time step is on it


@dataclass(frozen=True)
class Phase:
    """A span of time in which the same contacts may carry load.

    Attributes:
        start, end: [s].
        contacts: one entry per end effector: index into `Schedule.contacts`, -1 where it carries nothing.
        stance: index of the stance it belongs to; a swing phase belongs to the stance that it leaves.
        mover: the end effector in the air, -1 in a stance phase.
    """

    start: float
    end: float
    contacts: tuple[int, ...]
    stance: int
    mover: int = -1


@dataclass(frozen=True, eq=False)
class Schedule:
    """A contact sequence laid out in time.

    Stance phase 0, swing phase 0, stance phase 1, ..., last stance phase: phase 2 k belongs to stance k and phase
    2 k + 1 is the swing from stance k to k + 1. A palm that makes its first contact, or breaks one, swings too.

    Attributes:
        stances: the sequence, consecutive ones differ in one end effector.
        contacts: in the order of first use; one that is broken and made again at the same place comes twice.
        stance_contact: (S, E) index into `contacts` or -1.
        phases: contiguous, 2 S - 1 of them, the first starts at 0.
    """

    stances: tuple[Stance, ...]
    contacts: tuple[Contact, ...]
    stance_contact: np.ndarray
    phases: tuple[Phase, ...]

    @property
    def duration(self) -> float:
        """End of the last phase [s]."""
        return self.phases[-1].end

    @cached_property
    def boundaries(self) -> np.ndarray:
        """(P + 1,) start of every phase and the end of the last [s]."""
        return np.array([p.start for p in self.phases] + [self.duration])

    def times(self, step: float) -> np.ndarray:
        """(N,) samples every `step` seconds from 0 to the end, both included.

        Raises:
            ValueError: a phase boundary is no multiple of the step.
        """
        if not _on_grid(self.boundaries, step):
            raise ValueError(f"phase boundaries must be multiples of {step} s")
        return np.arange(round(self.duration / step) + 1) * step

    def phase_at(self, t: np.ndarray) -> np.ndarray:
        """(N,) index of the phase that holds over [t, next sample): a boundary belongs to what starts there."""
        found = np.searchsorted(self.boundaries, np.asarray(t) + 1e-9, side="right") - 1
        return np.clip(found, 0, len(self.phases) - 1)

    def contact_at(self, t: np.ndarray) -> np.ndarray:
        """(N, E) contact that may carry load over [t, next sample), -1 for none."""
        table = np.array([p.contacts for p in self.phases])
        return table[self.phase_at(t)]

    def kind(self, transition: int) -> str:
        """Whether transition k (from stance k to k + 1) breaks, makes or moves a contact."""
        mover = self.phases[2 * transition + 1].mover
        before, after = self.stance_contact[transition, mover], self.stance_contact[transition + 1, mover]
        return MAKE if before < 0 else BREAK if after < 0 else MOVE


def make_schedule(
    stances: Sequence[Stance],
    *,
    shift: float | np.ndarray = 1.0,
    swing: float | np.ndarray = 1.0,
    rest: float = 1.0,
) -> Schedule:
    """Lays a contact sequence out in time: shift the CoM over all contacts, then move one end effector.

    Lin 2020 sec. 6.7 gives both a second; one number holds for every transition, an array (S - 1,) has one for each.

    Args:
        stances: at least one; consecutive ones differ in one end effector.
        shift: duration of the stance phase before each swing [s].
        swing: duration of each swing phase [s].
        rest: duration of the last stance phase, in which the robot comes to rest [s].

    Raises:
        ValueError: no stance, consecutive stances that differ in none or in several end effectors, a foot in the
            air, or a duration that is not positive.
    """
    if not stances:
        raise ValueError("a contact sequence needs at least one stance")
    num = len(stances) - 1
    shifts, swings = np.broadcast_to(shift, num), np.broadcast_to(swing, num)
    if rest <= 0 or (num and min(shifts.min(), swings.min()) <= 0):
        raise ValueError("every phase needs a positive duration")
    contacts: list[Contact] = []
    table = np.full((len(stances), len(EFFECTORS)), -1)
    for s, stance in enumerate(stances):
        if stance.contacts[0] is None or stance.contacts[1] is None:
            raise ValueError(f"stance {s} has a foot in the air")
        for e, contact in enumerate(stance.contacts):
            if contact is None:
                continue
            held = s > 0 and stances[s - 1].contacts[e] == contact
            table[s, e] = table[s - 1, e] if held else len(contacts)
            if not held:
                contacts.append(contact)
    phases: list[Phase] = []
    t = 0.0
    for k in range(num):
        mover = changed_effector(stances[k], stances[k + 1])
        middle, end = round(t + shifts[k], 9), round(t + shifts[k] + swings[k], 9)
        carried = table[k].copy()
        carried[mover] = -1
        phases.append(Phase(t, middle, tuple(table[k].tolist()), k))
        phases.append(Phase(middle, end, tuple(carried.tolist()), k, mover))
        t = end
    phases.append(Phase(t, round(t + rest, 9), tuple(table[-1].tolist()), num))
    table.setflags(write=False)
    return Schedule(tuple(stances), tuple(contacts), table, tuple(phases))


def _on_grid(t: np.ndarray, step: float) -> bool:
    steps = t / step
    return bool(np.abs(steps - np.round(steps)).max() < ON_GRID)
