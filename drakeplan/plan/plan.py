"""The result of planning: contacts, stances, phases, dynamics, motion and provenance.

The classes mirror the plan file one to one: a field is a dataset or an attribute of it. Arrays are time first, SI units,
W is the world. Everything is copied in, checked once and read-only from then on.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from scenes.contact import Contact, contact_heading, patch_corners, require_support
from scenes.effector import EFFECTORS, is_foot
from scenes.stance import Stance

COMPLETE, CONTACTS_ONLY = "complete", "contacts"  # the two values of a plan's status


@dataclass(frozen=True, eq=False)
class PlanContacts:
    """Every contact that any stance of the plan holds, one row each.

    Attributes:
        X_WC: (C, 4, 4) pose of the contact frame in W [m].
        effector: (C,) index into the plan's effectors.
        surface: (C,) index into the surfaces of the plan's scene.
        friction: (C,) Coulomb coefficient there [-].
        support: (C, V, 2) corners of what of the patch rests on something, convex, counter-clockwise in the contact frame
            [m], padded with NaN; a row without numbers is the whole patch, and so are all rows where it is None.
    """

    X_WC: np.ndarray
    effector: np.ndarray
    surface: np.ndarray
    friction: np.ndarray
    support: np.ndarray | None = None

    def __post_init__(self) -> None:
        _freeze(self, "contacts", floats={"X_WC": (None, 4, 4), "friction": (None,)}, indices={"effector", "surface"})
        _same_length(self, "contacts", "X_WC", "effector", "surface", "friction")
        support = np.full((len(self), 4, 2), np.nan) if self.support is None else np.array(self.support, float)
        if support.ndim != 3 or support.shape[0] != len(self) or support.shape[2] != 2:
            raise ValueError(f"contacts/support must be {len(self)} x any x 2, got shape {support.shape}")
        for corners in support:
            filled = int(np.isfinite(corners).all(axis=1).sum())
            if not np.isnan(corners[filled:]).all():
                raise ValueError("contacts/support holds a number that is not finite")
            if filled:
                require_support(corners[:filled])
        support.setflags(write=False)
        object.__setattr__(self, "support", support)

    def __len__(self) -> int:
        return len(self.effector)

    def corners(self, index: int) -> np.ndarray:
        """(n, 2) corners of one contact's support in its frame [m]; none where the whole patch is meant."""
        assert self.support is not None  # filled in where it was made
        return self.support[index][np.isfinite(self.support[index, :, 0])]

    def with_whole_patches(self, half_extent: np.ndarray) -> PlanContacts:
        """The same contacts with the corners of the patch in the rows that have none.

        Args:
            half_extent: (E, 2) half extents of each end effector's patch [m].
        """
        whole = patch_corners(half_extent)[self.effector].reshape(-1, 4, 2)
        rows = [c if len(c) else w for c, w in zip(map(self.corners, range(len(self))), whole, strict=True)]
        most = max((len(row) for row in rows), default=4)
        support = np.full((len(rows), most, 2), np.nan)
        for k, row in enumerate(rows):
            support[k, : len(row)] = row
        return replace(self, support=support)


@dataclass(frozen=True, eq=False)
class PlanPhases:
    """Stretches of time in which the set of contacts that may carry load is constant.

    Attributes:
        start: (P,) [s].
        end: (P,) [s], each the start of the next phase.
        contact: (P, E) index into the plan's contacts, -1 where the end effector is free.
    """

    start: np.ndarray
    end: np.ndarray
    contact: np.ndarray

    def __post_init__(self) -> None:
        _freeze(self, "phases", floats={"start": (None,), "end": (None,)}, indices={"contact"})
        _same_length(self, "phases", "start", "end", "contact")

    def __len__(self) -> int:
        return len(self.start)


@dataclass(frozen=True, eq=False)
class PlanCentroidal:
    """Momentum and contact forces. Row n of the forces acts over [t_n, t_n+1):

        l[n+1]   = l[n] + dt (sum_e f_e[n] + M g)
        com[n+1] = com[n] + dt l[n+1] / M
        k[n+1]   = k[n] + dt sum_e ((p_cop_e[n] - com[n+1]) x f_e[n] + torque_n_e[n] n_e)

    The last row of contact, force_W, cop_C and torque_n repeats the one before.

    Attributes:
        t: (N,) [s].
        com: (N, 3) centre of mass in W [m].
        linear_momentum: (N, 3) l in W [kg m/s].
        angular_momentum: (N, 3) k about the centre of mass, in W [kg m^2/s].
        contact: (N, E) index into the plan's contacts, -1 where the end effector carries nothing.
        force_W: (N, E, 3) force on the robot in W [N].
        cop_C: (N, E, 2) centre of pressure in the contact frame [m].
        torque_n: (N, E) torque on the robot about the contact normal at the centre of pressure [N m].
    """

    t: np.ndarray
    com: np.ndarray
    linear_momentum: np.ndarray
    angular_momentum: np.ndarray
    contact: np.ndarray
    force_W: np.ndarray
    cop_C: np.ndarray
    torque_n: np.ndarray

    def __post_init__(self) -> None:
        three = (None, 3)
        floats: dict[str, Shape] = {"t": (None,), "com": three, "linear_momentum": three, "angular_momentum": three}
        floats |= {"force_W": (None, None, 3), "cop_C": (None, None, 2), "torque_n": (None, None)}
        _freeze(self, "centroidal", floats=floats, indices={"contact"})
        _same_length(self, "centroidal", *floats, "contact")

    def __len__(self) -> int:
        return len(self.t)


@dataclass(frozen=True, eq=False)
class PlanMotion:
    """Whole-body configurations of the plant that `Parser().AddModels(robot_model)` alone gives.

    Attributes:
        t: (T,) [s].
        q: (T, nq) positions: base quaternion (w, x, y, z), base position [m], joints [rad].
        v: (T, nv) velocities: base angular [rad/s] and linear [m/s] in W, joints [rad/s].
        position_names: (nq,) as `MultibodyPlant.GetPositionNames` gives them.
        velocity_names: (nv,) as `MultibodyPlant.GetVelocityNames` gives them.
        tau: (T, A) torques of the actuators [N m]: inverse dynamics of q, v and the change of v to the next frame, under
            the planned contact forces. Row i acts over [t_i, t_i+1), the last repeats the one before. None in files of
            earlier releases.
        actuator_names: (A,) in the plant's order of actuators; () without `tau`.
    """

    t: np.ndarray
    q: np.ndarray
    v: np.ndarray
    position_names: tuple[str, ...]
    velocity_names: tuple[str, ...]
    tau: np.ndarray | None = None
    actuator_names: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        object.__setattr__(self, "position_names", tuple(self.position_names))
        object.__setattr__(self, "velocity_names", tuple(self.velocity_names))
        object.__setattr__(self, "actuator_names", tuple(self.actuator_names))
        widths: dict[str, Shape] = {"q": (None, len(self.position_names)), "v": (None, len(self.velocity_names))}
        if self.tau is not None:
            widths["tau"] = (None, len(self.actuator_names))
        _freeze(self, "motion", floats={"t": (None,), **widths}, indices=set())
        _same_length(self, "motion", "t", *widths)

    def __len__(self) -> int:
        return len(self.t)


@dataclass(frozen=True, eq=False)
class PlanRobustness:
    """What pushes do to the plan: each of D impulses at each of R moments, by the exact kino-dynamic question.

    Attributes:
        t: (R,) moments [s].
        impulse: (D, 3) in W [kg m/s].
        probability: (R, D) that the impulse happens within 0.1 s there [-].
        captured: (R, D) 0 the robot falls, 1 it stands with what it holds, 2 with one new contact; -1 not tried.
        capture_point: (R, D, 3) where the new contact is made, in W [m]; 0 where none is.
        effector: (R, D) index of the end effector that makes it, -1 for none.
        p_success: probability that no push fells the robot on the way (Lin 2020 eq. 7.6).
        method: how it was found, as JSON.
    """

    t: np.ndarray
    impulse: np.ndarray
    probability: np.ndarray
    captured: np.ndarray
    capture_point: np.ndarray
    effector: np.ndarray
    p_success: float
    method: str

    def __post_init__(self) -> None:
        shape = len(np.atleast_1d(self.t)), len(np.atleast_2d(self.impulse))
        floats: dict[str, Shape] = {
            "t": (None,),
            "impulse": (None, 3),
            "probability": shape,
            "capture_point": (*shape, 3),
        }
        _freeze(self, "robustness", floats=floats, indices={"captured", "effector"})
        for name in ("captured", "effector"):
            if getattr(self, name).shape != shape:
                raise ValueError(f"robustness/{name} must be {shape[0]} x {shape[1]}, got {getattr(self, name).shape}")
        if self.captured.size and not (self.captured.min() >= -1 and self.captured.max() <= 2):
            raise ValueError("robustness/captured: expected -1, 0, 1 or 2")
        if not 0.0 <= self.p_success <= 1.0:
            raise ValueError(f"robustness: p_success must lie in [0, 1], got {self.p_success}")


@dataclass(frozen=True, eq=False)
class Plan:
    """A crossing: contacts in order, and for a complete plan the dynamics and the motion that go with them.

    Attributes:
        robot: name of the robot.
        robot_model: absolute path of the model file that Drake's parser loads alone.
        robot_model_sha256: hash of that file, in hexadecimal.
        mass: of the robot [kg].
        friction_cone: name of the cone that contact forces were held to.
        scene_name: what the scene calls itself.
        scene_yaml: the scene as planned: meshes turned into surfaces; the start, goal and friction that were used.
        triangles: (K, 3, 3) every obstacle and mesh in W, for collision [m].
        half_extent: (E, 2) half length (x) and half width (y) of each sole or palm patch [m].
        contacts: every contact, in the order that indices refer to.
        stances: (S, E) index into `contacts` or -1; consecutive rows differ in exactly one entry.
        phases: None unless the plan is complete; so are centroidal and motion.
        centroidal: momentum and forces.
        motion: whole-body configurations.
        provenance: what made the plan (versions, seed, command, limits that fired); must fit JSON.
        effectors: (E,) names.
        robustness: what pushes do to it, where that was tried.

    Raises:
        ValueError: a shape, an index or a number that cannot be.
    """

    robot: str
    robot_model: str
    robot_model_sha256: str
    mass: float
    friction_cone: str
    scene_name: str
    scene_yaml: str
    triangles: np.ndarray
    half_extent: np.ndarray
    contacts: PlanContacts
    stances: np.ndarray
    phases: PlanPhases | None = None
    centroidal: PlanCentroidal | None = None
    motion: PlanMotion | None = None
    provenance: Mapping[str, object] = field(default_factory=dict)
    effectors: tuple[str, ...] = EFFECTORS
    robustness: PlanRobustness | None = None

    def __post_init__(self) -> None:
        object.__setattr__(self, "effectors", tuple(self.effectors))
        num_effectors = len(self.effectors)
        floats: dict[str, Shape] = {"triangles": (None, 3, 3), "half_extent": (num_effectors, 2)}
        _freeze(self, "plan", floats=floats, indices={"stances"})
        if not np.isfinite(self.mass) or self.mass <= 0:
            raise ValueError(f"mass must be a positive number, got {self.mass}")
        parts = (self.phases, self.centroidal, self.motion)
        if any(part is None for part in parts) and any(part is not None for part in parts):
            raise ValueError("phases, centroidal and motion come together or not at all")
        _check_indices("contacts/effector", self.contacts.effector, 0, num_effectors)
        _check_indices("contacts/surface", self.contacts.surface, 0, None)
        object.__setattr__(self, "contacts", self.contacts.with_whole_patches(self.half_extent))
        _check_contact_table("stances/contact", self.stances, num_effectors, len(self.contacts))
        if self.phases is not None and self.centroidal is not None:
            _check_contact_table("phases/contact", self.phases.contact, num_effectors, len(self.contacts))
            _check_contact_table("centroidal/contact", self.centroidal.contact, num_effectors, len(self.contacts))
            if self.centroidal.force_W.shape[1] != num_effectors:
                raise ValueError(f"centroidal/force_W must have {num_effectors} end effectors")

    @property
    def status(self) -> str:
        """`COMPLETE` with dynamics and motion, else `CONTACTS_ONLY`."""
        return CONTACTS_ONLY if self.motion is None else COMPLETE

    @property
    def duration(self) -> float:
        """Length of the motion [s], 0 without one."""
        return 0.0 if self.motion is None or not len(self.motion) else float(self.motion.t[-1] - self.motion.t[0])

    def contact(self, index: int) -> Contact:
        """The contact in this row of the table, with the heading that its frame was made from."""
        table = self.contacts
        X_WC, effector = table.X_WC[index], self.effectors[table.effector[index]]
        support, whole = table.corners(index), patch_corners(self.half_extent[table.effector[index]])
        return Contact(
            effector=effector,
            surface=int(table.surface[index]),
            X_WC=X_WC,
            friction=float(table.friction[index]),
            heading=contact_heading(X_WC) if is_foot(effector) else float(np.arctan2(X_WC[1, 0], X_WC[0, 0])),
            support=None if np.array_equal(support, whole) else support,
        )

    def stance(self, index: int) -> Stance:
        """The stance in this row of `stances`."""
        return Stance(tuple(self.contact(c) if c >= 0 else None for c in self.stances[index]))

    def contact_sequence(self) -> tuple[Stance, ...]:
        """All stances in order."""
        return tuple(self.stance(k) for k in range(len(self.stances)))


def tabulate_stances(stances: Sequence[Stance]) -> tuple[PlanContacts, np.ndarray]:
    """The table of all contacts in `stances`, in order of appearance, and (S, E) indices into it.

    A contact held through several stances gets one row; one that is broken and made again at the same place another.
    """
    rows: list[Contact] = []
    indices = np.full((len(stances), len(EFFECTORS)), -1, dtype=np.int64)
    for s, stance in enumerate(stances):
        for e, contact in enumerate(stance.contacts):
            if contact is None:
                continue
            before = indices[s - 1, e] if s else -1
            if before >= 0 and rows[before] == contact:
                indices[s, e] = before
            else:
                indices[s, e] = len(rows)
                rows.append(contact)
    support = np.full((len(rows), max((len(c.support) for c in rows if c.support is not None), default=4), 2), np.nan)
    for k, contact in enumerate(rows):
        if contact.support is not None:
            support[k, : len(contact.support)] = contact.support
    table = PlanContacts(
        X_WC=np.array([c.X_WC for c in rows]).reshape(-1, 4, 4),
        effector=np.array([EFFECTORS.index(c.effector) for c in rows], dtype=np.int64),
        surface=np.array([c.surface for c in rows], dtype=np.int64),
        friction=np.array([c.friction for c in rows], dtype=float),
        support=support,
    )
    return table, indices


Shape = tuple[int | None, ...]  # None: any length


def _freeze(record: object, name: str, *, floats: Mapping[str, Shape], indices: set[str]) -> None:
    """Copies the named arrays in, read-only, after checking that they are finite numbers of the right shape."""
    for key, shape in floats.items():
        array = np.array(getattr(record, key), dtype=np.float64, order="C")
        if array.ndim != len(shape) or any(n is not None and n != m for n, m in zip(shape, array.shape, strict=True)):
            expected = " x ".join("any" if n is None else str(n) for n in shape)
            raise ValueError(f"{name}/{key} must be {expected}, got shape {array.shape}")
        if not np.isfinite(array).all():
            raise ValueError(f"{name}/{key} holds a number that is not finite")
        array.setflags(write=False)
        object.__setattr__(record, key, array)
    for key in sorted(indices):
        array = np.asarray(getattr(record, key))
        if array.size and not np.issubdtype(array.dtype, np.integer):
            raise ValueError(f"{name}/{key} must hold integers, got {array.dtype}")
        array = np.array(array, dtype=np.int64, order="C")
        array.setflags(write=False)
        object.__setattr__(record, key, array)


def _same_length(record: object, name: str, first: str, *others: str) -> None:
    length = len(getattr(record, first))
    for key in others:
        if len(getattr(record, key)) != length:
            raise ValueError(f"{name}/{key} has {len(getattr(record, key))} rows, {name}/{first} {length}")


def _check_indices(name: str, array: np.ndarray, lowest: int, count: int | None) -> None:
    if array.ndim != 1:
        raise ValueError(f"{name} must be a list of indices, got shape {array.shape}")
    if array.size and (array.min() < lowest or (count is not None and array.max() >= count)):
        raise ValueError(f"{name} holds an index that names nothing")


def _check_contact_table(name: str, table: np.ndarray, num_effectors: int, num_contacts: int) -> None:
    if table.ndim != 2 or table.shape[1] != num_effectors:
        raise ValueError(f"{name} must have {num_effectors} columns, got shape {table.shape}")
    if table.size and (table.min() < -1 or table.max() >= num_contacts):
        raise ValueError(f"{name} holds an index that names no contact")
