"""What an elastic strip is given, may choose and gives back."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from optimization.balance.friction import DEFAULT_CONE, FrictionCone
from scenes.contact import Contact
from scenes.footholds.contact_regions import ContactRegions
from scenes.input_error import InputError

LIMITS, CONTACT, BALANCE, CLEARANCE, PLACE = "joint limits", "contact", "balance", "clearance", "start and goal"


@dataclass(frozen=True, eq=False)
class StripProblem:
    """A trajectory of N configurations, the C contacts that it makes, and where those may go.

    Attributes:
        t: (N,) [s], ascending.
        q: (N, nq) the trajectory as planned.
        phase: (N,) index of the phase that each configuration belongs to, for messages.
        contacts: (C) as they should come out where nothing speaks against it, on the new terrain.
        planned: (C) the same contacts as the trajectory makes them.
        regions: (C) circles that each contact's centre may be in.
        held: (N, E) contact in place, -1 where the end effector is free.
        support: (N, E) contact that carries, -1 for none: those that balance is asked of.
        swing: (N, E, 2) contacts between which an end effector is in the air, -1 where that is not known.
        share: (N,) how far along its swing the moving end effector is, 0 to 1.
        gatherings: places that the means of groups of contacts must be near.

    Raises:
        InputError: shapes that do not match, or a number that is not finite.
    """

    t: np.ndarray
    q: np.ndarray
    phase: np.ndarray
    contacts: tuple[Contact, ...]
    planned: tuple[Contact, ...]
    regions: tuple[ContactRegions, ...]
    held: np.ndarray
    support: np.ndarray
    swing: np.ndarray
    share: np.ndarray
    gatherings: tuple[Gathering, ...] = ()

    def __post_init__(self) -> None:
        num, num_contacts = len(self.t), len(self.contacts)
        if num < 2:
            raise InputError(f"elastic strip: expected two configurations or more, got {num}")
        shapes = {"q": (num, None), "phase": (num,), "held": (num, 4), "support": (num, 4), "swing": (num, 4, 2)}
        for key, shape in (shapes | {"share": (num,)}).items():
            got = np.shape(getattr(self, key))
            if len(got) != len(shape) or any(n is not None and n != m for n, m in zip(shape, got, strict=True)):
                raise InputError(f"elastic strip: {key} has shape {got}, expected {shape}")
        for key in ("t", "q", "share"):
            if not np.isfinite(getattr(self, key)).all():
                raise InputError(f"elastic strip: {key} holds a number that is not finite")
        if (np.diff(self.t) <= 0.0).any():
            raise InputError("elastic strip: t must ascend")
        if len(self.planned) != num_contacts or len(self.regions) != num_contacts:
            raise InputError(f"elastic strip: expected regions and a planned pose for each of {num_contacts} contacts")
        for key in ("held", "support", "swing"):
            table = getattr(self, key)
            if table.size and (table.min() < -1 or table.max() >= num_contacts):
                raise InputError(f"elastic strip: {key} names a contact that does not exist")
        for c, regions in enumerate(self.regions):
            if self.contacts[c].surface not in regions.surface:
                where = f"contact {c} ({self.contacts[c].effector})"
                raise InputError(f"elastic strip: {where} has no region to go to on surface {self.contacts[c].surface}")


@dataclass(frozen=True)
class Gathering:
    """The mean of some contacts must be near a place in plan view: the feet of the first and the last stance.

    Attributes:
        name: for messages.
        contacts: indices of contacts.
        xy: (2,) the place [m].
        radius: of the circle about it [m].
    """

    name: str
    contacts: tuple[int, ...]
    xy: tuple[float, float]
    radius: float


@dataclass(frozen=True)
class StripOptions:
    """How a strip is deformed.

    Attributes:
        cone: friction cone.
        max_iterations: convex programs at most.
        time_limit: processor time after which no further one is begun [s]; wall time on a machine that is not busy.
        trust: greatest change of a joint or the base in one iteration [rad, m].
        trust_contact: greatest change of a contact's place in one iteration [m].
        turn: how far a foot contact may turn about its normal, in all [rad].
        margin: distance that the CoM keeps from the edge of the balance polygon, less in narrow ones [m].
        limb_clearance: distance that limbs keep from the terrain [m].
        air_clearance: distance that feet and hands in the air keep from the terrain [m]; little, since their capsules
            overfill them, and the motion stage plans the curves of swings anew.
        reserve: range that joints keep unused at either end where the plan leaves it [rad].
        contact_weight: [1/m^2]; an angle counts with a lever of 0.3 m.
        exact_penalty: cost of a metre outside balance or clearance; above every multiplier, so that they give way to
            nothing but the limits.
        tension: of the internal forces [s].
        memory: pull of each configuration towards its planned one [1].
        home: pull of each contact towards its projected place [1/m^2].
        solver: see `optimization.convex.solver.SOLVERS`.
    """

    cone: FrictionCone = DEFAULT_CONE
    max_iterations: int = 25
    time_limit: float = 4.0
    trust: float = 0.25
    trust_contact: float = 0.05
    turn: float = 0.1
    margin: float = 0.01
    limb_clearance: float = 0.01
    air_clearance: float = 0.0
    reserve: float = 0.05
    contact_weight: float = 3e4
    exact_penalty: float = 200.0
    tension: float = 0.3
    memory: float = 0.1
    home: float = 20.0
    solver: str = "auto"

    def __post_init__(self) -> None:
        object.__setattr__(self, "cone", FrictionCone(self.cone))  # a name is taken too
        for key, value in vars(self).items():
            if isinstance(value, int | float) and not (np.isfinite(value) and value >= 0):
                raise InputError(f"elastic strip: {key} must be finite and not negative, got {value}")
        if self.max_iterations < 1 or self.trust <= 0.0 or self.contact_weight <= 0.0:
            raise InputError("elastic strip: max_iterations, trust and contact_weight must be positive")


@dataclass(frozen=True)
class StripFault:
    """Where a strip breaks.

    Attributes:
        task: `CONTACT`, `BALANCE`, `CLEARANCE`, `LIMITS` or `PLACE`.
        configuration: index into the strip, -1 where it is about contacts alone.
        phase: that it belongs to, -1 where it is about contacts alone.
        contact: index of the contact, -1 where it is about none.
        about: end effector, or what else.
        value: by how much it fails [m, an angle counting 0.3 m; joints in rad].
        limit: what is accepted.
    """

    task: str
    configuration: int
    phase: int
    contact: int
    about: str
    value: float
    limit: float

    def __str__(self) -> str:
        where = f"phase {self.phase}, " if self.phase >= 0 else ""
        contact = f", contact {self.contact}" if self.contact >= 0 else ""
        return f"{where}{self.about}{contact}: {self.task} off by {self.value:.3g} (limit {self.limit:.3g})"


@dataclass(frozen=True)
class StripIteration:
    """One iteration: the state before it, and the convex program.

    Attributes:
        contact, balance, clearance: greatest violation before the step [m].
        cost: of the convex program.
        step: greatest change of any unknown [rad, m].
        solver: that was used.
        solve_time: wall time in the solver [s].
        time: processor time since the start [s].
    """

    contact: float
    balance: float
    clearance: float
    cost: float
    step: float
    solver: str
    solve_time: float
    time: float


@dataclass(frozen=True, eq=False)
class StripEstimate:
    """A deformed strip: the answer, or the best so far where it breaks.

    Attributes:
        feasible: whether every task is done, by a check of the configurations themselves.
        reason: one line; "" where feasible.
        q: (N, nq) configurations.
        contacts: (C) where the contacts came out.
        faults: what is wrong, the worst of each task in each phase first; empty where feasible.
        iterations: what happened.
        ended_by: "converged", "iterations", "time" or "solver".
    """

    feasible: bool
    reason: str
    q: np.ndarray
    contacts: tuple[Contact, ...]
    faults: tuple[StripFault, ...]
    iterations: tuple[StripIteration, ...]
    ended_by: str
