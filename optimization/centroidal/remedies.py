"""A report on an infeasible centroidal problem that a person can act on: where it is blocked, and what would free it."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np

from optimization.centroidal.adjustments import (
    Lever,
    Question,
    force_lever,
    friction_lever,
    height_levers,
    momentum_levers,
    place_levers,
    reach_lever,
    time_levers,
)
from optimization.centroidal.check import violations
from optimization.centroidal.contact_schedule import ContactSchedule
from optimization.centroidal.estimate import CentroidalEstimate
from optimization.centroidal.explanation import shortfalls
from optimization.centroidal.flight import impossible_flight
from optimization.centroidal.options import CentroidalOptions
from optimization.centroidal.problem import CentroidalProblem
from optimization.centroidal.program import CentroidalProgram
from scenes.effector import EFFECTORS

INTERVAL_BLOCKS = {"friction cone", "force limit", "pressure centre", "angular momentum rate limit"}  # others: knots
TOGETHER = 4  # levers that may be moved at once where no single one is enough
NO_MORE = 1.02  # times another's size: as small a change
TOLD = 3  # remedies in the one-line text
PHASES = 3  # whose levers are tried
DIRECT = {
    "friction cone": "friction",
    "force limit": "force",
    "reach": "reach",
    "com height": "height",
    "angular momentum limit": "momentum",
    "angular momentum rate limit": "momentum",
    "rest: angular momentum": "momentum",
    "com box": "place",
    "final com box": "place",
}


@dataclass(frozen=True)
class Blockage:
    """One constraint that must give way for the problem to have an answer.

    Attributes:
        block: name of the constraint.
        phase: number of the contact phase.
        start, end: of that phase [s].
        held: end effectors that may carry load in it.
        time: where in it [s].
        effector: whose constraint, "" where it is nobody's.
        contact: index of the contact in the schedule, -1 where it is nobody's.
        amount: how much is missing.
        unit: of the amount.
    """

    block: str
    phase: int
    start: float
    end: float
    held: tuple[str, ...]
    time: float
    effector: str
    contact: int
    amount: float
    unit: str

    def __str__(self) -> str:
        who = f" of {self.effector} (contact {self.contact})" if self.contact >= 0 else ""
        where = f"phase {self.phase}, {self.start:.2f} to {self.end:.2f} s, {', '.join(self.held) or 'no contact'}"
        return f"{self.block}{who} is {self.amount:.3g} {self.unit} short at {self.time:.2f} s ({where})"


@dataclass(frozen=True)
class Change:
    """One number that would have to be another.

    Attributes:
        kind: "friction", "reach", "height", "time", "force", "momentum" or "place".
        what: whose number, in words.
        now, needed: its value and the value that is enough.
        unit: of both.
    """

    kind: str
    what: str
    now: float
    needed: float
    unit: str

    def __str__(self) -> str:
        return f"{self.what} {self.now:.4g} -> {self.needed:.4g} {self.unit}".rstrip()


@dataclass(frozen=True)
class Remedy:
    """Changes that free the problem, confirmed by solving it again.

    Attributes:
        changes: one, or several where no single one is enough.
        size: sum of the changes over what is usual for each [-].
        cost: of the plan that they allow.
    """

    changes: tuple[Change, ...]
    size: float
    cost: float

    def __str__(self) -> str:
        return " with ".join(str(change) for change in self.changes)


@dataclass(frozen=True)
class InfeasibilityReport:
    """Why a problem has no answer, and the smallest changes that give it one.

    Attributes:
        feasible: whether it has one as it is.
        flight: which phase without contacts is too long to survive, in closed form; "" where none is.
        blockages: what stands in the way, the worst first.
        remedies: the smallest first; each is enough by itself.
        solves: programs that were solved.
        complete: whether all levers were tried before a limit fired.
    """

    feasible: bool
    flight: str
    blockages: tuple[Blockage, ...]
    remedies: tuple[Remedy, ...]
    solves: int
    complete: bool

    def __str__(self) -> str:
        if self.feasible:
            return "feasible as it is"
        why = self.flight or (
            str(self.blockages[0]) if self.blockages else "no constraint that could give way explains it"
        )
        told = " or ".join(str(remedy) for remedy in self.remedies[:TOLD])
        cure = f"enough: {told}" if told else "no change that was tried is enough"
        return f"{why}; {cure}{'' if self.complete else ' (stopped by a limit, not all was tried)'}"


@dataclass
class _Trials:
    """Solves questions, counts them, and knows when it is time to stop."""

    build: Callable[[CentroidalProblem, CentroidalOptions], CentroidalProgram]
    most: int
    deadline: float
    solves: int = 0
    stopped: bool = field(default=False)

    def solve(self, question: Question) -> tuple[CentroidalProgram, CentroidalEstimate]:
        self.solves += 1
        problem, options = question
        program = self.build(problem, replace(options, explain=False))
        return program, program.solve()

    def feasible(self, question: Question) -> bool:
        return self.solve(question)[1].feasible

    def may_go_on(self) -> bool:
        self.stopped |= self.solves >= self.most or time.perf_counter() > self.deadline
        return not self.stopped


def unblock(
    problem: CentroidalProblem,
    options: CentroidalOptions | None = None,
    *,
    build: Callable[[CentroidalProblem, CentroidalOptions], CentroidalProgram] = CentroidalProgram,
    most_solves: int = 300,
    time_limit: float = 30.0,
) -> InfeasibilityReport:
    """Finds what blocks a problem and, for each thing that may change, the least change that frees it.

    A relaxation says which blocks must give way, where, and by how much: that of the convex program where it has no
    answer, else the penalised one that the program itself solved. Each number that bears on those phases is then
    changed alone, as far as it may go, and where that helps the least change is found by bisection; every step is a
    solve and a check of the whole problem, so what is reported is confirmed. Where no single change is enough, the
    blockages are removed one after the other.

    Args:
        problem, options: as for `CentroidalProgram`.
        build: makes the program.
        most_solves: programs solved at most.
        time_limit: seconds after which no further one is started.
    """
    question: Question = problem, options or CentroidalOptions()
    trials = _Trials(build, most_solves, time.perf_counter() + time_limit)
    program, estimate = trials.solve(question)
    if estimate.feasible:
        return InfeasibilityReport(True, "", (), (), trials.solves, True)
    blockages = find_blockages(program, estimate)
    remedies = _single(question, blockages, trials)
    if not remedies and blockages:
        together = _one_after_the_other(question, trials)
        remedies = [together] if together is not None else []
    remedies.sort(key=lambda remedy: remedy.size)
    flight = impossible_flight(*question)
    return InfeasibilityReport(False, flight, tuple(blockages), tuple(remedies), trials.solves, not trials.stopped)


def _single(question: Question, blockages: list[Blockage], trials: _Trials) -> list[Remedy]:
    """The least change of each number that is enough by itself, those that the blocks are about first."""
    direct = {DIRECT.get(blockage.block) for blockage in blockages}
    found: list[tuple[Lever, Remedy]] = []
    vain: list[Lever] = []
    for lever in sorted(_levers(question, blockages), key=lambda lever: lever.kind not in direct):
        if any(lever.part_of(other) for other in vain):
            continue  # where everybody's friction is not enough, one's is not
        if not trials.may_go_on():
            break
        remedy = _least(question, lever, trials)
        if remedy is None:
            vain.append(lever)
        else:
            found.append((lever, remedy))
    return [remedy for lever, remedy in found if not any(_says_more(one, lever, remedy) for one in found)]


def _says_more(one: tuple[Lever, Remedy], lever: Lever, remedy: Remedy) -> bool:
    """Whether as little a change to fewer members does the same."""
    return one[0].part_of(lever) and one[1].size <= NO_MORE * remedy.size


def find_blockages(program: CentroidalProgram, estimate: CentroidalEstimate) -> list[Blockage]:
    """What stands in the way of a problem that was found infeasible, the worst first.

    Args:
        program: of the problem, solved.
        estimate: its answer.
    """
    problem, options, trajectory = program.problem, program.options, estimate.trajectory
    found = shortfalls(program.prog, program.data) if trajectory is None else violations(problem, options, trajectory)
    schedule = problem.schedule
    phases, times = schedule.phases, schedule.times
    out = []
    for each in found:
        interval = each.knot if each.block in INTERVAL_BLOCKS else each.knot - 1
        interval = int(np.clip(interval, 0, len(phases) - 1))
        within = np.flatnonzero(phases == phases[interval])
        held = tuple(EFFECTORS[e] for e in np.flatnonzero(schedule.active[interval] >= 0))
        contact = _contact(schedule, interval, EFFECTORS.index(each.effector)) if each.effector else -1
        start, end = float(times[within[0]]), float(times[within[-1] + 1])
        out.append(
            Blockage(
                each.block,
                int(phases[interval]),
                start,
                end,
                held,
                each.time,
                each.effector,
                contact,
                each.amount,
                each.unit,
            )
        )
    return out


def _contact(schedule: ContactSchedule, interval: int, effector: int) -> int:
    """The contact of an end effector in an interval, or in the next one, before which it must be within reach."""
    held = schedule.active[interval : interval + 2, effector]
    return int(next((c for c in held if c >= 0), -1))


def _levers(question: Question, blockages: list[Blockage]) -> list[Lever]:
    """Everything that bears on the phases where the problem is blocked, and the length of every flight."""
    problem, options = question
    schedule = problem.schedule
    phases = schedule.phases
    blocked = list(dict.fromkeys(b.phase for b in blockages))[:PHASES]
    levers: list[Lever] = []
    contacts = {b.contact for b in blockages if b.contact >= 0}
    effectors = {EFFECTORS.index(b.effector) for b in blockages if b.effector}
    # what is taken hold of next must be within reach already
    touched = blocked + [b.phase + 1 for b in blockages if b.block == "reach" and b.phase < phases[-1]]
    for phase in touched:
        active = schedule.active[phases == phase][0]
        contacts |= set(active[active >= 0].tolist())
        effectors |= set(np.flatnonzero(active >= 0).tolist())
    levers += [friction_lever(problem, group) for group in _all_and_alone(contacts)]
    levers += [reach_lever(options, group) for group in _all_and_alone(effectors)]
    levers += [force_lever(options, group) for group in _all_and_alone(effectors)]
    levers += height_levers(options) + momentum_levers(options) + place_levers(problem, options)
    flights = {int(phases[n]) for n in np.flatnonzero((schedule.active < 0).all(axis=1))}
    for phase in dict.fromkeys([*blocked, *sorted(flights)]):
        levers += time_levers(problem, phase)
    return [lever for lever in levers if np.isfinite(lever.now)]


def _all_and_alone(numbers: set[int]) -> list[list[int]]:
    alone = [[number] for number in sorted(numbers)]
    return [sorted(numbers), *alone] if len(numbers) > 1 else alone


def _least(question: Question, lever: Lever, trials: _Trials) -> Remedy | None:
    """The least change of one number that frees the problem, None where its greatest does not."""
    if not trials.feasible(lever.apply(question, lever.greatest)):
        return None
    change = _bisect(lever, lambda amount: trials.feasible(lever.apply(question, amount)), trials)
    _, confirmed = trials.solve(lever.apply(question, change))
    return Remedy((_told(lever, change),), change / lever.usual, confirmed.cost)


def _bisect(lever: Lever, enough: Callable[[float], bool], trials: _Trials) -> float:
    """The least change on the lever's grid that is enough, the greatest being so."""
    short, far = 0, int(np.ceil(lever.greatest / lever.resolution))
    while far - short > 1 and trials.may_go_on():
        middle = (short + far) // 2
        if enough(min(middle * lever.resolution, lever.greatest)):
            far = middle
        else:
            short = middle
    return min(far * lever.resolution, lever.greatest)


def _one_after_the_other(question: Question, trials: _Trials) -> Remedy | None:
    """Gives way where the relaxation says, as little as makes it point elsewhere, until the problem has an answer."""
    now, changes, size = question, [], 0.0
    for _ in range(TOGETHER):
        program, estimate = trials.solve(now)
        if estimate.feasible:
            return Remedy(tuple(changes), size, estimate.cost)
        blockages = find_blockages(program, estimate)
        lever = _direct(now, blockages) if blockages and trials.may_go_on() else None
        if lever is None or not _elsewhere(now, lever, lever.greatest, blockages[0].block, trials):
            return None
        before, block, asked = now, blockages[0].block, lever
        change = _bisect(asked, lambda amount, q=before, m=asked, b=block: _elsewhere(q, m, amount, b, trials), trials)
        now = lever.apply(now, change)
        changes.append(_told(lever, change))
        size += change / lever.usual
    estimate = trials.solve(now)[1]
    return Remedy(tuple(changes), size, estimate.cost) if estimate.feasible else None


def _elsewhere(question: Question, lever: Lever, change: float, block: str, trials: _Trials) -> bool:
    """Whether after a change nothing is wrong with this block any more."""
    program, estimate = trials.solve(lever.apply(question, change))
    found = [] if estimate.feasible else find_blockages(program, estimate)
    return estimate.feasible or bool(found and all(blockage.block != block for blockage in found))


def _direct(question: Question, blockages: list[Blockage]) -> Lever | None:
    """The number that the worst block is about, of everybody who lacks in it."""
    worst = [b for b in blockages if b.block == blockages[0].block]
    levers = [lever for lever in _levers(question, worst) if lever.kind == DIRECT.get(worst[0].block)]
    named = [lever for lever in levers if lever.what.endswith(worst[0].block)]
    owners = {b.effector for b in worst if b.effector}
    mine = [lever for lever in levers if owners and all(owner in lever.what for owner in owners)]
    return next(iter(named or mine[-1:] or levers[:1]), None)  # of several, the one that touches no others


def _told(lever: Lever, change: float) -> Change:
    return Change(lever.kind, lever.what, lever.now, lever.now + lever.sign * change, lever.unit)
