"""Contacts together with simplified momentum dynamics as one mixed-integer program (Ponton et al. 2016).

Ponton, Herzog, Schaal, Righetti 2016: "A convex model of humanoid momentum dynamics for multi-contact motion
generation", Humanoids. Lin et al. 2019 sec. VIII-C and Lin 2020 sec. 6.7.3 use it as the baseline on the rubble field:
point contacts, orientation fixed, timing fixed, a given number of contacts (12, 18, 24).

Units in the program: m, s, force / (M g), moment / (M g m).
"""

# pydrake's stubs read "float64[m, 1]" as a shape and refuse every array.
# pyright: reportArgumentType=false, reportCallIssue=false, reportAttributeAccessIssue=false

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from optimization.balance.friction import FrictionCone, cone_rows
from optimization.contact_programs.contact_choice import Place, given_place
from optimization.contact_programs.contact_query import ContactEstimate, ContactQuery, FootstepOptions
from optimization.contact_programs.footstep_program import FootstepProgram
from optimization.mixed_integer.data import MixedIntegerData, read_program
from optimization.mixed_integer.solver import MixedIntegerSettings, Progress
from scenes.footholds.start_stance import standing_com
from scenes.gravity import GRAVITY
from scenes.input_error import InputError
from scenes.stance import Stance

LEVER = 1.5  # [m] greatest component of a contact's lever arm to the CoM
PRODUCTS = ((1, 2), (2, 1), (2, 0), (0, 2), (0, 1), (1, 0))  # (j, k) of l_j f_k: x+, x-, y+, y-, z+, z- of l x f
QUARTER = 0.25


@dataclass(frozen=True)
class ContactDynamicsOptions:
    """Timing, bounds and weights of the momentum model.

    Attributes:
        dt: time step [s].
        shift: time with all contacts before each move [s] (Lin et al. 2019 sec. VIII).
        swing: time of each move [s].
        cone: friction cone; the square is inside the true one and has the fewest faces.
        moment: bound on each component of the angular momentum's rate [M g m].
        speed: bound on each component of the CoM's velocity [m/s].
        acceleration, velocity, rate, force: weights of their squares; `tight` that of the products' bounds.
    """

    dt: float = 0.5
    shift: float = 1.0
    swing: float = 1.0
    cone: FrictionCone = FrictionCone.SQUARE
    moment: float = 0.1
    speed: float = 1.5
    acceleration: float = 0.02
    velocity: float = 0.2
    rate: float = 10.0
    force: float = 0.05
    tight: float = 0.05

    def __post_init__(self) -> None:
        object.__setattr__(self, "cone", FrictionCone(self.cone))  # a name is taken too
        for key in ("dt", "shift", "swing", "moment", "speed"):
            value = getattr(self, key)
            if not (np.isfinite(value) and value > 0):
                raise InputError(f"contact dynamics: {key}: expected a finite number > 0, got {value}")
        if self.dt > min(self.shift, self.swing):
            raise InputError(f"contact dynamics: dt {self.dt} s is longer than a phase")


@dataclass(frozen=True, eq=False)
class MomentumAnswer:
    """The momentum that came with a contact sequence.

    Attributes:
        com: (N + 1, 3) [m], at the start and after each step.
        velocity: (N + 1, 3) of the CoM [m/s].
        force: per step, (contact point (3,) [m], force (3,) [M g]) of everything that carries load.
        moment: (N, 3) rate of angular momentum that the relaxation claims [M g m].
    """

    com: np.ndarray
    velocity: np.ndarray
    force: tuple[tuple[tuple[np.ndarray, np.ndarray], ...], ...]
    moment: np.ndarray

    def relaxation_gap(self) -> float:
        """The most that the claimed rate of angular momentum differs from sum (p - r) x f [M g m]."""
        gaps = [
            np.abs(sum((np.cross(p - r, f) for p, f in forces), np.zeros(3)) - m).max()
            for r, forces, m in zip(self.com[1:], self.force, self.moment, strict=True)
        ]
        return float(max(gaps, default=0.0))


class ContactDynamicsProgram:
    """Chooses contacts and a momentum trajectory over them.

        min   the cost of `FootstepProgram` + sum_n w_v |v|^2 + w_a |a|^2 + w_k |kdot|^2 + w_f |f|^2 + w_t (P + Q)
        s.t.  contacts as in `FootstepProgram`
              r[n] = r[n-1] + dt v[n],  v[n] = v[n-1] + dt a[n]                     newton
              a / g + e_z = sum_e f_e                                               forces, in units of M g
              f_e in the friction cone of region r where b_er = 1                   big-M
              kdot = sum_e (p_e - r) x f_e, every product l f = (P - Q) / 4 with
                     P >= (l + f)^2, Q >= (l - f)^2                                 convex model of the momentum
              |p_e - r| <= reach of the CoM, r_z - p_z >= least height              kinematics, second order
              |kdot| <= bound, v[N] = 0                                             at rest in the end

    The last but two makes it a relaxation: `MomentumAnswer.relaxation_gap` says how far off the claimed moment is, and
    the motion stage solves the true dynamics over the contacts. Point contacts: the CoP is the patch's centre.

    Attributes:
        steps: the program of the contacts, to which the dynamics are added.
        prog: the MathematicalProgram.
    """

    def __init__(
        self,
        query: ContactQuery,
        options: FootstepOptions | None = None,
        dynamics: ContactDynamicsOptions | None = None,
    ) -> None:
        """Builds the program.

        Raises:
            InputError: `trim` was asked for: the timing is fixed by the number of contacts.
        """
        options = options or FootstepOptions()
        if options.trim:
            raise InputError("contact dynamics: trim: the timing is fixed by the number of contacts")
        self.query, self.dynamics = query, dynamics or ContactDynamicsOptions()
        self.steps = FootstepProgram(query, options, standing=False)
        self.prog = self.steps.prog
        self._without_dynamics = read_program(self.prog)  # before they are added: its variables come first
        self.reason = self.steps.reason
        self._forces: list[list[tuple[Place, np.ndarray]]] = []
        if self.reason:
            return
        self._schedule = self._phases()
        self._add_variables()
        self._add_newton()
        for n in range(len(self._schedule)):
            self._add_forces(n)
        self._add_costs()

    def _phases(self) -> list[list[Place]]:
        """What may carry load in each time step: all contacts while the CoM shifts, all but the mover's while it swings."""
        held, schedule = self._start_places(), []
        shift, swing = (round(t / self.dynamics.dt) for t in (self.dynamics.shift, self.dynamics.swing))
        for place, after in zip(self.steps.places, self.steps.held, strict=True):
            schedule += [list(held.values())] * shift
            schedule += [[p for e, p in held.items() if e != place.effector]] * swing
            held = after
        return schedule + [list(held.values())] * shift

    def _start_places(self) -> dict[int, Place]:
        return {e: given_place(c, e) for e, c in enumerate(self.query.start.contacts) if c is not None}

    def _add_variables(self) -> None:
        prog, N, limits = self.prog, len(self._schedule), self.dynamics
        self.r = prog.NewContinuousVariables(N, 3, "r")
        self.v = prog.NewContinuousVariables(N, 3, "v")
        self.a = prog.NewContinuousVariables(N, 3, "a")
        self.kdot = prog.NewContinuousVariables(N, 3, "kdot")
        low, high = self.query.terrain.extent
        tall = self.query.robot.com_height[2]
        for n in range(N):
            prog.AddBoundingBoxConstraint(low - 1.0, high + np.array([1.0, 1.0, 1.0 + tall]), self.r[n])
        prog.AddBoundingBoxConstraint(-limits.speed, limits.speed, self.v.ravel())
        prog.AddBoundingBoxConstraint(-GRAVITY, GRAVITY, self.a.ravel())
        prog.AddBoundingBoxConstraint(-limits.moment, limits.moment, self.kdot.ravel())
        prog.AddBoundingBoxConstraint(0.0, 0.0, self.v[-1])

    def _start_com(self) -> np.ndarray:
        return standing_com(self.query.robot, self.query.start)

    def _add_newton(self) -> None:
        dt, eye = self.dynamics.dt, np.eye(3)
        for n in range(len(self._schedule)):
            for now, rate, name, before in (
                (self.r, self.v, "position", self._start_com()),
                (self.v, self.a, "velocity", np.zeros(3)),
            ):
                if n == 0:
                    rows, right, variables = np.hstack([eye, -dt * eye]), before, [now[0], rate[0]]
                else:
                    rows, right, variables = (
                        np.hstack([eye, -dt * eye, -eye]),
                        np.zeros(3),
                        [now[n], rate[n], now[n - 1]],
                    )
                self.prog.AddLinearEqualityConstraint(
                    rows, right, np.concatenate(variables)
                ).evaluator().set_description(f"{name}[{n}]")

    def _add_forces(self, n: int) -> None:
        """Forces of one time step with friction, kinematics and the convex model of their moments."""
        forces, moments = [], []
        for place in self._schedule[n]:
            name = f"{place.effector}[{n}]"
            f = self.prog.NewContinuousVariables(3, f"f {name}")
            most = float(self.query.robot.force_limit[place.effector])
            self.prog.AddBoundingBoxConstraint(-most, most, f)
            self._add_friction(f"friction {name}", place, f, most)
            self._add_kinematics(name, place, self.r[n])
            moments.append(self._add_products(name, place, f, self.r[n], most))
            forces.append((place, f))
        eye = np.eye(3)
        rows = np.hstack([eye / GRAVITY, *([-eye] * len(forces))])
        variables = np.concatenate([self.a[n], *(f for _, f in forces)])
        self.prog.AddLinearEqualityConstraint(rows, [0.0, 0.0, -1.0], variables).evaluator().set_description(
            f"newton[{n}]"
        )
        for i in range(3):
            pq = np.concatenate([m[2 * i : 2 * i + 2].ravel() for m in moments])
            signs = np.tile([QUARTER, -QUARTER, -QUARTER, QUARTER], len(moments))
            self.prog.AddLinearEqualityConstraint(
                np.append(1.0, -signs)[None], [0.0], np.append(self.kdot[n, i], pq)
            ).evaluator().set_description(f"moment {'xyz'[i]}[{n}]")
        self._forces.append(forces)

    def _add_friction(self, name: str, place: Place, f: np.ndarray, most: float) -> None:
        if place.given is not None:
            C = cone_rows(self.dynamics.cone, place.given.friction) @ place.given.R_WC.T
            self.prog.AddLinearConstraint(C, np.full(len(C), -np.inf), np.zeros(len(C)), f).evaluator().set_description(
                name
            )
            return
        for region, b in zip(place.regions, place.choice, strict=True):
            C = cone_rows(self.dynamics.cone, region.friction) @ region.R_WC.T
            M = np.abs(C).sum(axis=1) * most
            self.prog.AddLinearConstraint(
                np.hstack([C, M[:, None]]), np.full(len(C), -np.inf), M, np.append(f, b)
            ).evaluator().set_description(name)
        if not isinstance(place.skipped, float):  # a free palm carries nothing
            rows = np.hstack([np.vstack([np.eye(3), -np.eye(3)]), np.full((6, 1), most)])
            self.prog.AddLinearConstraint(rows, np.full(6, -np.inf), np.full(6, most), np.append(f, place.skipped))

    def _add_kinematics(self, name: str, place: Place, r: np.ndarray) -> None:
        robot, far = self.query.robot, 0.0
        if not isinstance(place.skipped, float):
            far = float(np.linalg.norm(np.subtract(*self.query.terrain.extent))) + robot.com_height[2]
        reach = float(robot.com_reach[place.effector])
        given = place.given is not None
        skip = [] if isinstance(place.skipped, float) else [place.skipped]
        A = np.zeros((4, 3 + 3 * (not given) + len(skip)))
        A[1:, :3] = np.eye(3)
        if not given:
            A[1:, 3:6] = -np.eye(3)
        A[0, 6:] = far
        b = np.concatenate([[reach], -place.p if given else np.zeros(3)])
        variables = np.concatenate([r, *([] if given else [place.p]), skip])
        self.prog.AddLorentzConeConstraint(A, b, variables).evaluator().set_description(f"reach of the CoM {name}")
        if place.effector < 2:
            least = robot.com_height[0]
            height = [r[2]] if given else [r[2], place.p[2]]
            self.prog.AddLinearConstraint(
                np.array([[1.0, -1.0][: len(height)]]), [least + (place.p[2] if given else 0.0)], [np.inf], height
            ).evaluator().set_description(f"height of the CoM {name}")

    def _add_products(self, name: str, place: Place, f: np.ndarray, r: np.ndarray, most: float) -> np.ndarray:
        """(6, 2) bounds P, Q on (l + f)^2 and (l - f)^2 for the six products of (p - r) x f."""
        PQ = self.prog.NewContinuousVariables(6, 2, f"PQ {name}")
        self.prog.AddBoundingBoxConstraint(0.0, (LEVER + most) ** 2, PQ.ravel())
        given = place.given is not None
        for q, (j, k) in enumerate(PRODUCTS):
            for w, sign in enumerate((1.0, -1.0)):
                variables = [PQ[q, w], r[j], f[k]] + ([] if given else [place.p[j]])
                A = np.zeros((3, len(variables)))
                A[0, 0] = 1.0
                A[2, 1:3] = [-1.0, sign]
                if not given:
                    A[2, 3] = 1.0
                b = np.array([0.0, 1.0, place.p[j] if given else 0.0])
                self.prog.AddRotatedLorentzConeConstraint(A, b, np.array(variables)).evaluator().set_description(
                    f"product {q} {name}"
                )
        self.prog.AddLinearCost(np.full(12, self.dynamics.tight * self.dynamics.dt), 0.0, PQ.ravel())
        return np.asarray(PQ)

    def _add_costs(self) -> None:
        w, dt = self.dynamics, self.dynamics.dt
        for weight, block in ((w.velocity, self.v), (w.acceleration, self.a), (w.rate, self.kdot)):
            for row in block:
                self.prog.AddQuadraticCost(2 * weight * dt * np.eye(3), np.zeros(3), row, True)
        for forces in self._forces:
            for _, f in forces:
                self.prog.AddQuadraticCost(2 * w.force * dt * np.eye(3), np.zeros(3), f, True)

    # Answers ----------------------------------------------------------------------------------------------------

    def solve(
        self,
        settings: MixedIntegerSettings | None = None,
        on_incumbent: Callable[[Progress, tuple[Stance, ...]], None] | None = None,
        stop: Callable[[], bool] | None = None,
    ) -> ContactEstimate:
        """The contact sequence, as `FootstepProgram.solve`.

        Args:
            settings: of the mixed-integer solver; the defaults where None.
            on_incumbent: called with each better sequence that is found; None for none.
            stop: asked now and then; True ends the search.
        """
        return self.steps.solve(settings, on_incumbent, stop, data=self.data())

    def data(self) -> MixedIntegerData:
        """The program's numbers, with those of the contacts alone as the easier program to try first."""
        return replace(read_program(self.prog), easier=self._without_dynamics)

    def momentum(self, x: np.ndarray) -> MomentumAnswer:
        """The momentum trajectory of an answer x (n,)."""
        index = self.prog.FindDecisionVariableIndices

        def value(block: np.ndarray) -> np.ndarray:
            return x[np.asarray(index(block.ravel()))].reshape(block.shape)

        forces = tuple(
            tuple((place.p if place.given is not None else value(place.p), value(f)) for place, f in step)
            for step in self._forces
        )
        com = np.vstack([self._start_com(), value(self.r)])
        velocity = np.vstack([np.zeros(3), value(self.v)])
        return MomentumAnswer(com, velocity, forces, value(self.kdot))
