"""What a person may change so that a centroidal problem gets an answer: friction, reach, height, time and limits."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace

import numpy as np

from optimization.centroidal.options import CentroidalOptions
from optimization.centroidal.problem import CentroidalProblem
from scenes.effector import EFFECTORS

Question = tuple[CentroidalProblem, CentroidalOptions]
SHORTEST = 0.01  # [s] that a phase may be shortened to


@dataclass(frozen=True)
class Lever:
    """One number that may change.

    Attributes:
        kind: "friction", "reach", "height", "time", "force", "momentum" or "place".
        what: whose number it is, in words.
        now: its value.
        sign: 1 where it would grow, -1 where it would shrink.
        greatest: change that is tried at most, > 0.
        resolution: smallest change worth telling.
        usual: change that counts as one; orders changes of different kinds.
        unit: of the number.
        apply: the question with the number changed by so much (>= 0).
        members: whose number: where a lever of the same name moves more members, it does all that this one does.
    """

    kind: str
    what: str
    now: float
    sign: int
    greatest: float
    resolution: float
    usual: float
    unit: str
    apply: Callable[[Question, float], Question]
    members: frozenset[object] = frozenset()

    def part_of(self, other: Lever) -> bool:
        """Whether the other lever, moved all the way, does all that this one can do."""
        return self.kind == other.kind and bool(self.members) and self.members < other.members


def friction_lever(problem: CentroidalProblem, contacts: Iterable[int]) -> Lever:
    """Raises the friction of these contacts to at least one value.

    Args:
        problem: the infeasible one.
        contacts: indices of contacts of its schedule.
    """
    chosen = sorted(contacts)
    all_contacts = problem.schedule.contacts
    now = min(all_contacts[c].friction for c in chosen)

    def apply(question: Question, change: float) -> Question:
        asked, options = question
        held = list(asked.schedule.contacts)
        for c in chosen:
            held[c] = replace(held[c], friction=max(held[c].friction, now + change))
        return replace(asked, schedule=replace(asked.schedule, contacts=tuple(held))), options

    names = " and ".join(f"{all_contacts[c].effector} (contact {c})" for c in chosen)
    return Lever(
        "friction", f"friction of {names}", now, 1, max(2.0 - now, 0.5), 0.001, 0.1, "", apply, frozenset(chosen)
    )


def reach_lever(options: CentroidalOptions, effectors: Iterable[int]) -> Lever:
    """Lets the CoM be farther from the contacts of these end effectors.

    Args:
        options: the present limits.
        effectors: indices of end effectors.
    """
    chosen = sorted(effectors)

    def apply(question: Question, change: float) -> Question:
        return question[0], replace(question[1], com_reach=_at_least(question[1].com_reach, chosen, now + change))

    now = min(options.com_reach[e] for e in chosen)
    return Lever("reach", f"reach of {_names(chosen)}", now, 1, 0.5, 0.001, 0.05, "m", apply, frozenset(chosen))


def height_levers(options: CentroidalOptions) -> list[Lever]:
    """Let the CoM be lower or higher over the feet."""

    def lower(question: Question, change: float) -> Question:
        low, nominal, high = question[1].com_height
        return question[0], replace(question[1], com_height=(low - change, nominal, high))

    def higher(question: Question, change: float) -> Question:
        low, nominal, high = question[1].com_height
        return question[0], replace(question[1], com_height=(low, nominal, high + change))

    low, _, high = options.com_height
    return [
        Lever("height", "least CoM height", low, -1, 0.5, 0.001, 0.05, "m", lower),
        Lever("height", "greatest CoM height", high, 1, 0.5, 0.001, 0.05, "m", higher),
    ]


def time_levers(problem: CentroidalProblem, phase: int) -> list[Lever]:
    """Make a phase shorter or longer; its intervals keep their shares of it.

    Args:
        problem: the infeasible one.
        phase: number of the phase in its schedule.
    """
    schedule = problem.schedule
    within = schedule.phases == phase
    now = float(schedule.dt[within].sum())

    def scaled(question: Question, duration: float) -> Question:
        dt = np.where(within, question[0].schedule.dt * (duration / now), question[0].schedule.dt)
        return replace(question[0], schedule=replace(question[0].schedule, dt=dt)), question[1]

    held = [EFFECTORS[e] for e in np.flatnonzero(schedule.active[within][0] >= 0)]
    what = f"duration of phase {phase} ({', '.join(held) or 'no contact'})"
    shorter = Lever(
        "time", what, now, -1, now - SHORTEST, 0.005, 0.2 * now, "s", lambda q, change: scaled(q, now - change)
    )
    longer = Lever("time", what, now, 1, 2.0 * now, 0.005, 0.2 * now, "s", lambda q, change: scaled(q, now + change))
    return [shorter, longer] if shorter.greatest > 0 else [longer]


def force_lever(options: CentroidalOptions, effectors: Iterable[int]) -> Lever:
    """Lets these end effectors push harder.

    Args:
        options: the present limits.
        effectors: indices of end effectors.
    """
    chosen = sorted(effectors)

    def apply(question: Question, change: float) -> Question:
        return question[0], replace(question[1], force_limit=_at_least(question[1].force_limit, chosen, now + change))

    now = min(options.force_limit[e] for e in chosen)
    return Lever("force", f"force limit of {_names(chosen)}", now, 1, 3.0, 0.005, 0.2, "M g", apply, frozenset(chosen))


def momentum_levers(options: CentroidalOptions) -> list[Lever]:
    """Let the body store more angular momentum, or change it faster, about all axes."""

    def more(question: Question, change: float) -> Question:
        limit = _all_raised(question[1].angular_momentum_limit, change)
        return question[0], replace(question[1], angular_momentum_limit=limit)

    def faster(question: Question, change: float) -> Question:
        limit = _all_raised(question[1].angular_momentum_rate_limit, change)
        return question[0], replace(question[1], angular_momentum_rate_limit=limit)

    def both(question: Question, change: float) -> Question:
        k, rate = (
            _scaled(limit, 1.0 + change)
            for limit in (question[1].angular_momentum_limit, question[1].angular_momentum_rate_limit)
        )
        return question[0], replace(question[1], angular_momentum_limit=k, angular_momentum_rate_limit=rate)

    k, rate = min(options.angular_momentum_limit), min(options.angular_momentum_rate_limit)
    return [
        Lever(
            "momentum",
            "both angular momentum limits, times",
            1.0,
            1,
            9.0,
            0.01,
            0.3,
            "",
            both,
            frozenset({"k", "kdot"}),
        ),
        Lever("momentum", "angular momentum limit", k, 1, 200.0, 0.1, 10.0, "N m s", more, frozenset({"k"})),
        Lever("momentum", "angular momentum rate limit", rate, 1, 400.0, 0.1, 20.0, "N m", faster, frozenset({"kdot"})),
    ]


def place_levers(problem: CentroidalProblem, options: CentroidalOptions) -> list[Lever]:
    """Let the CoM end farther from the last feet, and stray farther from its reference, along all axes.

    Args:
        problem: the infeasible one.
        options: the present limits.
    """

    def end(question: Question, change: float) -> Question:
        half = question[1].final_half_width
        return question[0], replace(question[1], final_half_width=_all_raised(half or (0.0, 0.0, 0.0), change))

    def stray(question: Question, change: float) -> Question:
        box = question[0].com_box
        return replace(question[0], com_box=None if box is None else box + change), question[1]

    levers = []
    if options.final_half_width is not None:
        now = min(options.final_half_width)
        levers.append(Lever("place", "half width of the final CoM box", now, 1, 1.0, 0.001, 0.05, "m", end))
    if problem.com_box is not None:
        now = float(problem.com_box.min())
        levers.append(Lever("place", "half width of the CoM box", now, 1, 1.0, 0.001, 0.05, "m", stray))
    return levers


def _names(effectors: list[int]) -> str:
    return " and ".join(EFFECTORS[e] for e in effectors)


def _at_least(
    values: tuple[float, float, float, float], chosen: list[int], least: float
) -> tuple[float, float, float, float]:
    a, b, c, d = (max(value, least) if i in chosen else value for i, value in enumerate(values))
    return a, b, c, d


def _all_raised(values: tuple[float, float, float], change: float) -> tuple[float, float, float]:
    x, y, z = values
    return x + change, y + change, z + change


def _scaled(values: tuple[float, float, float], factor: float) -> tuple[float, float, float]:
    x, y, z = values
    return x * factor, y * factor, z * factor
