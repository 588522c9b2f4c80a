"""Momenta and a whole-body motion that agree: the centroidal program and whole-body kinematics in turns.

Herzog et al. 2016: A. Herzog, S. Schaal, L. Righetti, "Structured contact force optimization for kino-dynamic motion
generation", IROS 2016, sec. III; as used in Lin 2020 sec. 7.3.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np

from optimization.centroidal.estimate import CentroidalEstimate
from optimization.centroidal.options import CentroidalOptions
from optimization.centroidal.problem import CentroidalProblem
from optimization.centroidal.program import CentroidalProgram
from optimization.centroidal.program_cache import ProgramCache
from optimization.centroidal.trajectory import CentroidalTrajectory
from optimization.inverse_kinematics.frame_task import DistanceRows, TrackingTargets, no_rows
from optimization.kinodynamic.alternation import alternate
from optimization.kinodynamic.joint_torques import TorqueRows
from optimization.kinodynamic.momentum_gap import Gap, MomentumGap
from optimization.kinodynamic.momentum_tracking import MomentumTargets, TrackedMotion, track_momentum
from optimization.kinodynamic.swing_arcs import effector_arcs
from optimization.multibody.inverse_dynamics import effort_limits
from optimization.multibody.kinematics import Kinematics
from scenes.input_error import InputError
from scenes.robots.plant import RobotPlant, build_plant
from scenes.robots.robot import Robot

HOLD = 300.0  # [1/m] weight of contacts that are held
# Where CoM, linear and angular momentum of both halves agree, RMS and worst.
AGREEMENT = MomentumGap(Gap(0.01, 0.01), Gap(2.0, 6.0), Gap(2.0, 5.0))
SWING = (60.0, 15.0)  # [1/m, 1/rad] weights of the place and turn of an end effector in the air


@dataclass(frozen=True, eq=False)
class KinodynamicProblem:
    """What a kino-dynamic program is about, at the N knots of the contact schedule; SI and W.

    Attributes:
        centroidal: contacts in time, mass, patches, and the CoM and momenta at knot 0. Its references, where it has
            some, hold in the first iteration; afterwards the kinematic solution's take their place.
        q_start: (nq,) configuration at knot 0, which stays.
        v_start: (nv,) velocity there; None for rest.
        q_reference: (N, nq) posture to stay near; None for `q_start` throughout (base position free).
        X_WE: (N, E, 4, 4) poses that end effectors should take while they carry nothing; None for arcs from contact to
            contact, free where there is no next one.
        effector_weight: (N, E, 2) weights of their places [1/m] and turns [1/rad], 0 where an end effector is free; with
            X_WE.
        distances: called with a motion (N, nq), says which pairs of bodies must keep which distances; None for none.
    """

    centroidal: CentroidalProblem
    q_start: np.ndarray
    v_start: np.ndarray | None = None
    q_reference: np.ndarray | None = None
    X_WE: np.ndarray | None = None
    effector_weight: np.ndarray | None = None
    distances: Callable[[np.ndarray], DistanceRows] | None = None


@dataclass(frozen=True)
class KinodynamicOptions:
    """What a user may choose about a kino-dynamic program.

    Attributes:
        iterations: of dynamics and kinematics, at most.
        agreement: gap at which they agree.
        give_up: after iteration i (the last entry holds for the rest) a gap of more than this many agreements ends it;
            empty for never.
        centroidal: options of the centroidal program.
        com_pull: weight of |com - kinematics' com|^2 in the dynamics from the second iteration on [1/m^2].
        momentum_pull: weight of |k - kinematics' k|^2 there [1/(N m s)^2].
        com_weight: of the CoM in the kinematics [1/m].
        linear_weight: of the linear momentum [s/(kg m)].
        angular_weight: of the angular momentum [1/(N m s)].
        base_weight: of the base's orientation [1/rad].
        posture_weight: of the joints [1/rad].
        smooth_weight: of accelerations [s^2/rad].
        speed_share: of the joints' speed limits that may be used.
        torque_limits: whether joint torques bound the contact forces from the second iteration on.
        kinematic_steps: Gauss-Newton steps of the kinematics, each iteration.
        contact_tolerance: [m] error of a held contact up to which a motion counts, 1 rad as `LEVER` m.
    """

    iterations: int = 3
    agreement: MomentumGap = AGREEMENT
    give_up: tuple[float, ...] = ()
    centroidal: CentroidalOptions = field(default_factory=CentroidalOptions)
    com_pull: float = 2e4
    momentum_pull: float = 2.0
    com_weight: float = 30.0
    linear_weight: float = 0.1
    angular_weight: float = 0.3
    base_weight: float = 0.6
    posture_weight: float = 0.1
    smooth_weight: float = 1e-3
    speed_share: float = 0.98
    torque_limits: bool = False
    kinematic_steps: int = 8
    contact_tolerance: float = 5e-3


@dataclass(frozen=True, eq=False)
class KinodynamicEstimate:
    """Answer of a kino-dynamic program.

    Attributes:
        feasible: whether forces and motion keep every constraint and agree.
        reason: "" where feasible, else which part fails first.
        gaps: kinematics less dynamics after each iteration, at knots 1..N-1. The momenta of the kinematics at knot n
            are those from configuration n - 1 to n, as the centroidal equations com[n] = com[n-1] + dt l[n] / M say.
        centroidal: the last answer of the dynamics; None where there was none.
        q: (N, nq) the last motion, (0, nq) where there is none.
        momentum: (N - 1, 6) its angular [N m s] and linear [kg m/s] momentum from each knot to the next.
        held_error: greatest distance of a held end effector from its contact, 1 rad as `LEVER` m [m].
        speed_share: greatest joint speed over its limit.
        torque_share: greatest joint torque over its limit, inertia included.
    """

    feasible: bool
    reason: str
    gaps: tuple[MomentumGap, ...]
    centroidal: CentroidalEstimate | None
    q: np.ndarray
    momentum: np.ndarray
    held_error: float = np.inf
    speed_share: float = np.inf
    torque_share: float = np.inf


class KinodynamicProgram:
    """Moves a whole robot over fixed contacts so that its momenta are those that the contact forces bring about.

        repeat    com, l, k, forces   =  centroidal program, near the com and k of the last motion
                  q                   =  argmin  |com(q) - com|^2 + |A(q) v - (k, l)|^2 + contacts + posture + smoothness
                                         s.t. joint limits, joint speeds, distances           (see `momentum_tracking`)
        until     com, l, k of both agree

    From the second iteration on, joint torques may bound the contact wrenches w of the dynamics: with q and v of the last
    motion, -tau_max <= M vdot + C v - tau_g - J^T w <= tau_max are linear rows (Herzog et al. 2016 sec. III-C).

    One program serves any number of problems (`solve`); what can be reused from one to the next is.

    ```python
    program = KinodynamicProgram(load_robot("escher"))
    estimate = program.solve(KinodynamicProblem(centroidal_problem, q_start))
    ```
    """

    def __init__(
        self, robot: Robot, options: KinodynamicOptions | None = None, *, robot_plant: RobotPlant | None = None
    ) -> None:
        """Reads the robot; `robot_plant` saves loading the model where the caller has it already."""
        self.robot, self.options = robot, options or KinodynamicOptions()
        plant = (robot_plant or build_plant(robot)).plant
        self.kinematics = Kinematics.from_plant(plant, [e.frame for e in robot.effectors])
        self.effort = effort_limits(plant)
        weights = self.options.centroidal.weights
        pulled = replace(weights, com_tracking=self.options.com_pull, angular_momentum=self.options.momentum_pull)
        self._first = ProgramCache(self.options.centroidal)
        self._again = ProgramCache(replace(self.options.centroidal, weights=pulled))

    def solve(self, problem: KinodynamicProblem) -> KinodynamicEstimate:
        """Dynamics and kinematics in turns.

        Raises:
            InputError: arrays of the wrong shape or not finite.
        """
        problem = self._checked(problem)
        targets, links = self._targets(problem), self._links(problem)
        first = self._dynamics(problem, None, None)
        if first.trajectory is None or not first.feasible:
            return self._answer(problem, targets, first, None, [], f"dynamics: {first.reason}")
        estimate, motion, reason = first, None, ""
        gaps: list[MomentumGap] = []

        def kinematics() -> MomentumGap:
            nonlocal motion
            assert estimate.trajectory is not None
            motion = self._kinematics(problem, targets, links, estimate.trajectory, motion)
            gaps.append(knot_gap(estimate.trajectory, motion))
            return gaps[-1]

        def dynamics() -> bool:
            nonlocal estimate
            estimate = self._dynamics(problem, motion, estimate)
            return estimate.trajectory is not None

        def finished(gap: MomentumGap) -> bool:
            assert motion is not None
            if estimate.feasible and gap.within(self.options.agreement):
                held = self._held_error(targets, motion) <= self.options.contact_tolerance
                return held and not self.options.torque_limits
            return self._hopeless(gaps)

        alternate(kinematics, dynamics, finished, self.options.iterations)
        if not estimate.feasible:
            reason = f"dynamics: {estimate.reason}"
        elif not gaps[-1].within(self.options.agreement):
            reason = f"dynamics and kinematics disagree: {gaps[-1]}"
        return self._answer(problem, targets, estimate, motion, gaps, reason)

    def _hopeless(self, gaps: list[MomentumGap]) -> bool:
        """Whether the last gap is beyond what `give_up` allows after so many iterations."""
        limits = self.options.give_up
        return bool(limits) and gaps[-1].over(self.options.agreement) > limits[min(len(gaps), len(limits)) - 1]

    def _posture_weight(self) -> np.ndarray:
        """(nv,) weights of base orientation, base position (none) and joints."""
        joints = np.full(len(self.kinematics.tree.lower), self.options.posture_weight)
        return np.concatenate([np.full(3, self.options.base_weight), np.zeros(3), joints])

    def _dynamics(
        self, problem: KinodynamicProblem, motion: TrackedMotion | None, last: CentroidalEstimate | None
    ) -> CentroidalEstimate:
        """The centroidal program: at first as it is given, then near what the motion does."""
        centroidal = problem.centroidal
        if motion is not None:
            start = centroidal.initial_angular_momentum
            centroidal = replace(
                centroidal,
                com_reference=motion.com,
                angular_momentum_reference=np.vstack([start, motion.momentum[:, :3]]),
            )
        if motion is None:
            program = self._first.program(centroidal)
        elif self.options.torque_limits:
            program, rows = CentroidalProgram(centroidal, self._again.options), self._torque_rows(problem, motion)
            program.add_rows("joint torques", lambda: rows.in_program(program.data.index["wrench"]))
        else:
            program = self._again.program(centroidal)
        if last is not None and last.trajectory is not None:
            program.start_from(last.trajectory)
        return program.solve()

    def _kinematics(
        self,
        problem: KinodynamicProblem,
        targets: TrackingTargets,
        links: MomentumTargets,
        trajectory: CentroidalTrajectory,
        motion: TrackedMotion | None,
    ) -> TrackedMotion:
        """All configurations, near the CoM and momenta of the trajectory."""
        momentum = np.hstack([trajectory.angular_momentum, trajectory.linear_momentum])[1:]
        q = np.tile(problem.q_start, (len(trajectory.t), 1)) if motion is None else motion.q
        if motion is None:
            q[:, 4:7] += trajectory.com - trajectory.com[0]
        if problem.distances is not None:
            targets = replace(targets, rows=problem.distances(q))
        targets, links = replace(targets, com=trajectory.com), replace(links, momentum=momentum)
        return track_momentum(
            self.kinematics.tree, targets, links, q, max_iterations=self.options.kinematic_steps, tolerance=1e-2
        )

    def _targets(self, problem: KinodynamicProblem) -> TrackingTargets:
        """What each knot should do, but for the CoM."""
        schedule, options, tree = problem.centroidal.schedule, self.options, self.kinematics.tree
        N = schedule.num_knots
        X_WE, weight = effector_arcs(schedule, self.kinematics.effector_poses(problem.q_start), HOLD, SWING)
        if problem.X_WE is not None and problem.effector_weight is not None:
            free = weight[:, :, 0] < HOLD
            X_WE[free], weight[free] = problem.X_WE[free], problem.effector_weight[free]
        q_ref = np.tile(problem.q_start, (N, 1)) if problem.q_reference is None else problem.q_reference
        return TrackingTargets(
            X_WE=X_WE,
            place_weight=weight[:, :, 0],
            turn_weight=weight[:, :, 1],
            com=np.zeros((N, 3)),
            com_weight=np.full((N, 3), options.com_weight),
            q_ref=q_ref,
            posture_weight=self._posture_weight(),
            lower=tree.lower,
            upper=tree.upper,
            rows=no_rows(N),
        )

    def _links(self, problem: KinodynamicProblem) -> MomentumTargets:
        """What joins the knots, but for the momenta."""
        options, tree = self.options, self.kinematics.tree
        dt = problem.centroidal.schedule.dt
        nv = self.kinematics.num_velocities
        weight = np.tile(np.repeat([options.angular_weight, options.linear_weight], 3), (len(dt), 1))
        rest = options.centroidal.rest_at_end
        return MomentumTargets(
            dt=dt,
            momentum=np.zeros((len(dt), 6)),
            weight=weight,
            smooth=np.full(nv, options.smooth_weight),
            speed=options.speed_share * tree.speed,
            v_start=np.zeros(nv) if problem.v_start is None else problem.v_start,
            v_end=np.zeros(nv) if rest else None,
            fixed=np.arange(len(dt) + 1) == 0,
        )

    def _velocities(self, problem: KinodynamicProblem, q: np.ndarray) -> np.ndarray:
        """(N, nv) velocity at v_start's knot, then from each knot to the next."""
        dt = problem.centroidal.schedule.dt
        v = [self.kinematics.difference(a, b) / step for a, b, step in zip(q[:-1], q[1:], dt, strict=True)]
        start = np.zeros(self.kinematics.num_velocities) if problem.v_start is None else problem.v_start
        return np.vstack([start, v])

    def _torque_rows(self, problem: KinodynamicProblem, motion: TrackedMotion) -> TorqueRows:
        return TorqueRows(
            self.kinematics, problem.centroidal, self.effort, motion.q, self._velocities(problem, motion.q)
        )

    def _held_error(self, targets: TrackingTargets, motion: TrackedMotion) -> float:
        held = targets.place_weight >= HOLD
        return float(np.where(held, motion.effector_error, 0.0)[1:].max())

    def _answer(
        self,
        problem: KinodynamicProblem,
        targets: TrackingTargets,
        estimate: CentroidalEstimate | None,
        motion: TrackedMotion | None,
        gaps: list[MomentumGap],
        reason: str,
    ) -> KinodynamicEstimate:
        """Judges the last motion; the first thing that is wrong with it is the reason."""
        if motion is None or estimate is None or estimate.trajectory is None:
            nothing = np.zeros((0, 1 + self.kinematics.num_velocities))
            return KinodynamicEstimate(False, reason, tuple(gaps), estimate, nothing, np.zeros((0, 6)))
        held = self._held_error(targets, motion)
        v = self._velocities(problem, motion.q)
        speed = float((np.abs(v[1:, 6:]) / self.kinematics.tree.speed).max())
        rows = TorqueRows(self.kinematics, problem.centroidal, self.effort, motion.q, v)
        torque = float((np.abs(rows.torques(estimate.trajectory)) / self.effort).max())
        if not reason and held > self.options.contact_tolerance:
            reason = f"kinematics: a held contact is off by {1e3 * held:.1f} mm"
        if not reason and speed > 1.0 + 1e-6:
            reason = f"kinematics: a joint moves at {speed:.2f} of its speed limit"
        if not reason and self.options.torque_limits and torque > 1.0 + 1e-3:
            reason = f"torques: a joint needs {torque:.2f} of its limit"
        return KinodynamicEstimate(
            not reason, reason, tuple(gaps), estimate, motion.q, motion.momentum, held, speed, torque
        )

    def _checked(self, problem: KinodynamicProblem) -> KinodynamicProblem:
        """The same problem with arrays that kernels can take.

        Raises:
            InputError: a shape that is wrong or a number that is not finite.
        """
        nv, N, E = self.kinematics.num_velocities, problem.centroidal.schedule.num_knots, len(self.robot.effectors)
        shapes = {
            "q_start": (nv + 1,),
            "v_start": (nv,),
            "q_reference": (N, nv + 1),
            "X_WE": (N, E, 4, 4),
            "effector_weight": (N, E, 2),
        }
        clean: dict[str, np.ndarray] = {}
        for name, shape in shapes.items():
            value = getattr(problem, name)
            if value is None:
                continue
            clean[name] = np.array(value, dtype=float)
            if clean[name].shape != shape or not np.isfinite(clean[name]).all():
                raise InputError(
                    f"kino-dynamic problem: {name}: expected finite numbers of shape {shape}, got {clean[name].shape}"
                )
        if (problem.X_WE is None) != (problem.effector_weight is None):
            raise InputError("kino-dynamic problem: X_WE and effector_weight come together")
        return replace(problem, **clean)


def knot_gap(trajectory: CentroidalTrajectory, motion: TrackedMotion) -> MomentumGap:
    """Kinematics less dynamics at knots 1..N-1, in the centroidal program's discrete equations.

    Args:
        trajectory: of the dynamics, N knots.
        motion: of the kinematics, N frames at the same times.
    """
    return MomentumGap(
        Gap.of(motion.com[1:] - trajectory.com[1:]),
        Gap.of(motion.momentum[:, 3:] - trajectory.linear_momentum[1:]),
        Gap.of(motion.momentum[:, :3] - trajectory.angular_momentum[1:]),
    )
