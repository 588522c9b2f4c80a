"""Which contacts may carry load in each interval between knots: the data of a centroidal program."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from scenes.contact import Contact
from scenes.effector import EFFECTORS
from scenes.input_error import InputError
from scenes.stance import Stance, changed_effector


@dataclass(frozen=True)
class ContactSpan:
    """One contact and when it may carry load.

    Attributes:
        contact: which.
        start, end: when it is made and when it is broken [s].
    """

    contact: Contact
    start: float
    end: float


@dataclass(frozen=True, eq=False)
class ContactSchedule:
    """N knots, the contacts that may carry load between them, and the time between them.

    Attributes:
        contacts: the C contacts that occur, each once.
        active: (N-1, E) index into `contacts`, or -1 where the end effector is free in that interval.
        dt: (N-1,) length of each interval [s].
    """

    contacts: tuple[Contact, ...]
    active: np.ndarray
    dt: np.ndarray

    def __post_init__(self) -> None:
        active, dt = (np.array(self.active, dtype=np.int64), np.array(self.dt, dtype=float))
        if active.ndim != 2 or active.shape[0] < 1 or active.shape[1] != len(EFFECTORS):
            raise InputError(f"contact schedule: expected at least one interval of {len(EFFECTORS)} end effectors")
        if dt.shape != (len(active),):
            raise InputError(
                f"contact schedule: expected a length dt for each of {len(active)} intervals, got {dt.shape}"
            )
        if not (np.isfinite(dt) & (dt > 0)).all():
            bad = int(np.argmin(np.isfinite(dt) & (dt > 0)))
            raise InputError(
                f"contact schedule: interval {bad} of phase {_phases(active)[bad]} has dt = {dt[bad]} s, expected a finite "
                "length > 0"
            )
        if active.min() < -1 or active.max() >= len(self.contacts):
            raise InputError("contact schedule: an interval refers to a contact that does not exist")
        for interval, effector in zip(*np.nonzero(active >= 0), strict=True):
            contact = self.contacts[active[interval, effector]]
            if contact.effector != EFFECTORS[effector]:
                raise InputError(
                    f"contact schedule: interval {interval} gives {EFFECTORS[effector]} a contact of {contact.effector}"
                )
        for array, name in ((active, "active"), (dt, "dt")):
            array.setflags(write=False)
            object.__setattr__(self, name, array)

    @classmethod
    def from_rows(cls, rows: Sequence[Sequence[Contact | None]], dt: float | np.ndarray) -> ContactSchedule:
        """One row of E contacts (None where free) for each interval.

        Args:
            rows: (N-1) of them.
            dt: length of every interval, or (N-1,) of each [s].

        Raises:
            InputError: no rows, or a row that is not one entry per end effector.
        """
        index: dict[Contact, int] = {}
        active = np.full((len(rows), len(EFFECTORS)), -1)
        for n, row in enumerate(rows):
            if len(row) != len(EFFECTORS):
                raise InputError(f"contact schedule: interval {n} has {len(row)} entries, expected {len(EFFECTORS)}")
            for e, contact in enumerate(row):
                if contact is not None:
                    active[n, e] = index.setdefault(contact, len(index))
        return cls(tuple(index), active, np.broadcast_to(np.asarray(dt, float), (len(rows),)))

    @classmethod
    def from_spans(cls, spans: Sequence[ContactSpan], *, dt: float, duration: float | None = None) -> ContactSchedule:
        """Contacts with the times at which they are made and broken, rounded to whole intervals.

        Times at which nothing is held are flight.

        Args:
            spans: in any order.
            dt: length of an interval [s].
            duration: of the whole [s], by default to the end of the last span.

        Raises:
            InputError: no spans, times that are not finite or do not ascend, or an end effector that would hold two
                contacts at once.
        """
        if not (np.isfinite(dt) and dt > 0):
            raise InputError(f"contact schedule: dt must be a finite number > 0 s, got {dt}")
        if not spans:
            raise InputError("contact schedule: the contact sequence is empty")
        for i, span in enumerate(spans):
            if not (np.isfinite([span.start, span.end]).all() and 0 <= span.start < span.end):
                raise InputError(
                    f"contact schedule: span {i} ({span.contact.effector}) lasts from {span.start} to {span.end} s, expected "
                    "finite times that ascend from 0"
                )
        end = max(span.end for span in spans) if duration is None else duration
        count = round(end / dt) if np.isfinite(end) else 0
        if count < 1:
            raise InputError(f"contact schedule: a duration of {end} s leaves no interval of {dt} s")
        rows: list[list[Contact | None]] = [[None] * len(EFFECTORS) for _ in range(count)]
        for i, span in enumerate(spans):
            effector = EFFECTORS.index(span.contact.effector)
            for n in range(round(span.start / dt), min(round(span.end / dt), count)):
                if rows[n][effector] is not None:
                    raise InputError(
                        f"contact schedule: {span.contact.effector} holds two contacts at {n * dt:.2f} s: span {i} "
                        f"({span.start:.2f} to {span.end:.2f} s) overlaps an earlier one"
                    )
                rows[n][effector] = span.contact
        return cls.from_rows(rows, dt)

    @classmethod
    def from_stances(
        cls,
        stances: Sequence[Stance],
        *,
        dt: float = 0.2,
        shift_time: float = 1.0,
        swing_time: float = 1.0,
        settle_time: float | None = None,
    ) -> ContactSchedule:
        """The documents' timing (Lin 2020 sec. 6.7): shift on each stance, then move one end effector to the next.

        While it moves, an end effector carries no load. Times are rounded to whole intervals, at least one each.

        Args:
            stances: consecutive ones differ in one end effector.
            dt: length of an interval [s].
            shift_time: time on each stance before the next transition [s].
            swing_time: time in which an end effector moves [s].
            settle_time: time on the last stance, `shift_time` where None [s]. For a single transition `dt` is enough to
                make the new contact count.

        Raises:
            InputError: no stances.
        """
        if not stances:
            raise InputError("contact schedule: the contact sequence is empty")
        settle_time = shift_time if settle_time is None else settle_time
        shift, swing, settle = (max(1, round(duration / dt)) for duration in (shift_time, swing_time, settle_time))
        rows: list[Sequence[Contact | None]] = []
        for before, after in pairwise(stances):
            moving = changed_effector(before, after)
            rows += [before.contacts] * shift + [before.replace(moving, None).contacts] * swing
        return cls.from_rows(rows + [stances[-1].contacts] * settle, dt)

    @property
    def num_knots(self) -> int:
        """N: one more than there are intervals."""
        return len(self.dt) + 1

    @property
    def times(self) -> np.ndarray:
        """(N,) time of each knot, from zero [s]."""
        return np.concatenate(([0.0], np.cumsum(self.dt)))

    @property
    def phases(self) -> np.ndarray:
        """(N-1,) number of the phase of each interval, from 0: the longest runs of the same active contacts."""
        return _phases(self.active)

    def phase_name(self, interval: int) -> str:
        """The phase of an interval in words, with its times."""
        within = np.flatnonzero(self.phases == self.phases[interval])
        start, end = self.times[within[0]], self.times[within[-1] + 1]
        return f"phase {self.phases[interval]} ({start:.2f} to {end:.2f} s)"

    def poses(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """(C, 3) points p_WC [m], (C, 3, 3) orientations R_WC and (C,) friction of the contacts."""
        if not self.contacts:
            return np.zeros((0, 3)), np.zeros((0, 3, 3)), np.zeros(0)
        X_WC = np.stack([contact.X_WC for contact in self.contacts])
        return (X_WC[:, :3, 3], X_WC[:, :3, :3], np.array([contact.friction for contact in self.contacts]))

    def feet_mean(self) -> np.ndarray:
        """(N-1, 3) mean of the foot contact points in each interval [m], NaN where no foot is in contact."""
        p_WC, _, _ = self.poses()
        feet = self.active[:, :2]
        held = (feet >= 0)[..., None]
        points = np.where(held, p_WC[np.maximum(feet, 0)], 0.0) if len(p_WC) else np.zeros((*feet.shape, 3))
        with np.errstate(invalid="ignore"):
            return points.sum(axis=1) / held.sum(axis=1)


def _phases(active: np.ndarray) -> np.ndarray:
    changed = (np.diff(active, axis=0) != 0).any(axis=1)
    return np.concatenate([np.zeros(1, int), np.cumsum(changed)])
