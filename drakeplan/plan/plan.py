"""The result of planning: contacts, stances, phases, dynamics, motion and provenance.

The classes mirror the plan file one to one: a field is a dataset or an attribute of it. Arrays are time first, SI units,
W is the world. Everything is copied in, checked once and read-only from then on.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike

from drakeplan.plan.arrays import (
    SAME_TIME,
    Shape,
    freeze,
    last_before,
    read_only,
    require_contact_table,
    require_indices,
)
from drakeplan.plan.contacts import PlanContacts as PlanContacts
from drakeplan.plan.contacts import tabulate_stances as tabulate_stances
from drakeplan.plan.robustness import PlanRobustness as PlanRobustness
from drakeplan.plan.state import PlanState
from drakeplan.plan.trajectories import PlanCentroidal as PlanCentroidal
from drakeplan.plan.trajectories import PlanMotion as PlanMotion
from drakeplan.plan.trajectories import PlanPhases as PlanPhases
from scenes.contact import Contact, contact_heading, patch_corners
from scenes.effector import EFFECTORS, is_foot
from scenes.input_error import InputError
from scenes.scene import Scene
from scenes.stance import Stance

COMPLETE, CONTACTS_ONLY = "complete", "contacts"  # the two values of a plan's status
CHANGED = "changed_contacts"  # key of a plan's provenance: contacts that were changed after it was planned


@dataclass(frozen=True, eq=False, repr=False)
class Plan:
    """A crossing: contacts in order, and for a complete plan the dynamics and the motion that go with them.

    A complete plan also gives arrays that all have one row for each of the T frames of its motion: `t`, `q`, `v`, `tau`, `com`
    and `forces`, with `joint_names` and `actuator_names`; `at` gives any moment between two frames. A plan of contacts alone
    raises an InputError where it is asked for them.

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
        freeze(self, "plan", floats=floats, indices={"stances"})
        if not np.isfinite(self.mass) or self.mass <= 0:
            raise ValueError(f"mass must be a positive number, got {self.mass}")
        parts = (self.phases, self.centroidal, self.motion)
        if any(part is None for part in parts) and any(part is not None for part in parts):
            raise ValueError("phases, centroidal and motion come together or not at all")
        require_indices("contacts/effector", self.contacts.effector, 0, num_effectors)
        require_indices("contacts/surface", self.contacts.surface, 0, None)
        object.__setattr__(self, "contacts", self.contacts.with_whole_patches(self.half_extent))
        require_contact_table("stances/contact", self.stances, num_effectors, len(self.contacts))
        if self.phases is not None and self.centroidal is not None:
            require_contact_table("phases/contact", self.phases.contact, num_effectors, len(self.contacts))
            require_contact_table("centroidal/contact", self.centroidal.contact, num_effectors, len(self.contacts))
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

    def __repr__(self) -> str:
        return (
            f"<Plan of {self.robot} on {self.scene_name}: {self.status}, {len(self.contacts)} contacts, "
            f"{len(self.stances)} stances, {self.duration:.1f} s>"
        )

    # Arrays, one row a frame ------------------------------------------------------------------------------------------

    @property
    def t(self) -> np.ndarray:
        """(T,) times of the frames [s]."""
        return self._motion("t").t

    @property
    def q(self) -> np.ndarray:
        """(T, nq) positions: base quaternion (w, x, y, z), base position in W [m], then `joint_names` [rad]."""
        return self._motion("q").q

    @property
    def v(self) -> np.ndarray:
        """(T, nv) velocities: of the base, angular [rad/s] and linear [m/s] in W, then of `joint_names` [rad/s]."""
        return self._motion("v").v

    @property
    def tau(self) -> np.ndarray:
        """(T, A) torques of `actuator_names` [N m]; row i acts from frame i to the next.

        Their order is not that of `joint_names`; `actuator_names` says which column is whose.
        """
        tau = self._motion("tau").tau
        if tau is None:
            raise InputError("tau: this plan has no torques: an earlier release wrote it; plan again")
        return tau

    @cached_property
    def com(self) -> np.ndarray:
        """(T, 3) centre of mass in W at the frames [m]; `centroidal` has it at its knots."""
        return read_only(self._dynamics("com").com_at(self.t))

    @cached_property
    def forces(self) -> np.ndarray:
        """(T, E, 3) contact force on the robot at each of `effectors`, in W [N]; row i acts from frame i on."""
        return read_only(self._dynamics("forces").forces_at(self.t))

    @property
    def joint_names(self) -> tuple[str, ...]:
        """(nq - 7,) names of the joints, in the order of q[:, 7:] and v[:, 6:]."""
        return self._motion("joint_names").joint_names

    @property
    def actuator_names(self) -> tuple[str, ...]:
        """(A,) names of the actuators, in the order of tau's columns."""
        return self._motion("actuator_names").actuator_names

    def at(self, t: float) -> PlanState:
        """The plan at one moment.

        Joints, velocities, centre of mass and momenta are linear between rows, the base turns at constant rate (slerp);
        forces hold from one knot to the next, contacts through a phase.

        Args:
            t: time from the first frame to the last [s].

        Raises:
            InputError: the time lies outside, or the plan has no motion.
        """
        motion, dynamics, phases = self._motion("at"), self._dynamics("at"), self.phases
        assert phases is not None  # it comes with the motion
        first, last = float(motion.t[0]), float(motion.t[-1])
        if not first - SAME_TIME <= t <= last + SAME_TIME:
            raise InputError(f"at: expected a time within [{first:g}, {last:g}] s, got {t:g}")
        t = min(max(float(t), first), last)
        q, v = motion.at(t)
        linear, angular = dynamics.momenta_at(t)
        held = phases.contact[last_before(phases.start, t)]
        return PlanState(t, q, v, dynamics.com_at(t), linear, angular, dynamics.forces_at(t), self._stance(held))

    def frames(self, *bodies: str) -> dict[str, np.ndarray]:
        """(T, 4, 4) pose X_WB of each body in W at the frames [m], by name; soles and palms are named like `effectors`.

        Args:
            *bodies: their names; none: all bodies of the robot.

        Raises:
            InputError: no such body, no motion, or the robot is not here.
        """
        from drakeplan.plan.body_poses import body_poses  # Drake, for whoever asks
        from drakeplan.plan.robot_of_plan import RobotMark, find_robot

        return body_poses(find_robot(RobotMark.of(self)), self._motion("frames").q, bodies)

    # Contacts ---------------------------------------------------------------------------------------------------------

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
        return self._stance(self.stances[index])

    def contact_sequence(self) -> tuple[Stance, ...]:
        """All stances in order."""
        return tuple(self.stance(k) for k in range(len(self.stances)))

    def scene(self) -> Scene:
        """The scene as it was planned on: meshes turned into surfaces, the start, goal and friction that were used."""
        from scenes.files.scene_file import scene_from_yaml  # pydantic, for whoever asks

        return scene_from_yaml(self.scene_yaml, f"plan of {self.scene_name}", mesh_triangles=self.triangles)

    def with_contact(
        self, index: int, X_WC: ArrayLike, *, surface: int | None = None, friction: float | None = None
    ) -> Plan:
        """The same plan with one contact elsewhere, to have it verified again.

        Dynamics and motion are not remade: they still belong to the contact where it was, and the verifier says so. To
        have them made for contacts that you have changed, give `contact_sequence()` of the new plan to
        `drakeplan.plan_motion`. What pushes do to the plan (`robustness`) is left out.

        Args:
            index: row of `contacts`.
            X_WC: (4, 4) its pose in W [m]: z along the surface normal, x forward.
            surface: index into the scene's surfaces; None: as before.
            friction: Coulomb coefficient; None: as before.

        Raises:
            InputError: no such contact, or no pose.
        """
        if not 0 <= index < len(self.contacts):
            raise InputError(f"with_contact: expected an index from 0 to {len(self.contacts) - 1}, got {index}")
        pose = np.asarray(X_WC, float)
        if pose.shape != (4, 4) or not np.isfinite(pose).all():
            raise InputError(f"with_contact: X_WC: expected a finite (4, 4) pose, got shape {pose.shape}")
        X, surfaces, coefficients = (
            np.array(a) for a in (self.contacts.X_WC, self.contacts.surface, self.contacts.friction)
        )
        X[index] = pose
        surfaces[index] = surfaces[index] if surface is None else surface
        coefficients[index] = coefficients[index] if friction is None else friction
        before = self.provenance.get(CHANGED, ())
        changed = sorted({index, *(before if isinstance(before, list | tuple) else ())})
        return replace(
            self,
            contacts=replace(self.contacts, X_WC=X, surface=surfaces, friction=coefficients),
            provenance={**self.provenance, CHANGED: changed},
            robustness=None,
        )

    def _stance(self, row: np.ndarray) -> Stance:
        """The stance of these contacts by end effector."""
        return Stance(tuple(self.contact(int(c)) if c >= 0 else None for c in row))

    def _motion(self, asked: str) -> PlanMotion:
        if self.motion is None or not len(self.motion):
            raise InputError(f"{asked}: this plan has contacts alone, no motion (its status is {self.status!r})")
        return self.motion

    def _dynamics(self, asked: str) -> PlanCentroidal:
        self._motion(asked)
        assert self.centroidal is not None  # it comes with the motion
        return self.centroidal
