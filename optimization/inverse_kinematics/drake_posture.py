"""Whole-body postures by nonlinear programming: the third and strictest tier of DESIGN's truth.

A posture holds given contact poses, keeps the centre of mass over a balance region, keeps joint limits, and keeps clear
of itself and of the terrain. Drake's InverseKinematics states it and SNOPT solves it; the answer is measured again from
the plant alone, because a solver's own verdict is wrong both ways.
"""

# pydrake's stubs read "float64[m, 1]" as a shape and refuse every array.
# pyright: reportArgumentType=false, reportCallIssue=false, reportAttributeAccessIssue=false, reportReturnType=false, reportOperatorIssue=false

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from pydrake.geometry import CollisionFilterDeclaration, GeometryId, GeometrySet
from pydrake.math import RigidTransform
from pydrake.multibody.inverse_kinematics import (
    ComInPolyhedronConstraint,
    DistanceConstraint,
    InverseKinematics,
    MinimumDistanceLowerBoundConstraint,
)
from pydrake.solvers import SnoptSolver, SolverOptions
from pydrake.systems.framework import Context

from scenes.effector import EFFECTORS
from scenes.robots.nominal_distances import nominal_distances, ordered
from scenes.robots.plant import RobotPlant

FLIPPED = 1.0  # [rad] from here an orientation went the wrong way round
LEVER = 0.1  # [m] arm of the two points that fix an orientation; a patch's own size, so errors weigh like positions


@dataclass(frozen=True)
class PostureOptions:
    """What a posture must keep, and how long to try.

    Attributes:
        min_distance: clearance to itself and to the terrain [m]; held soles and palms against the terrain are left out,
            since the contact's pose alone decides that, and bodies that are nearer than this in the robot's nominal
            posture are asked for nearly what they have there.
        influence: extra distance at which a pair begins to matter to the solver [m].
        position_tolerance: of a held contact [m].
        orientation_tolerance: of a held contact [rad].
        distance_tolerance: how far below `min_distance` the answer may end [m].
        region_tolerance: how far outside its region the CoM may end [m].
        base_weight: cost of moving the base from the guess, relative to 1 for a joint.
        major_iterations: SNOPT's limit.
    """

    min_distance: float = 0.005
    influence: float = 0.015
    position_tolerance: float = 1e-3
    orientation_tolerance: float = 5e-3
    distance_tolerance: float = 1e-3
    region_tolerance: float = 1e-3
    base_weight: float = 0.1
    major_iterations: int = 120


@dataclass(frozen=True)
class Violation:
    """Something that a posture does not keep: what, by how much, and how much is allowed [m or rad]."""

    name: str
    value: float
    limit: float


@dataclass(frozen=True, eq=False)
class PostureAnswer:
    """A posture and what is wrong with it.

    Attributes:
        ok: nothing is.
        q: (nq,) the best that was found, unit quaternion.
        violations: worst first, relative to what is allowed; empty when ok.
    """

    ok: bool
    q: np.ndarray
    violations: tuple[Violation, ...]


@dataclass(frozen=True)
class ClosePair:
    """Two geometries of the robot that stand nearer to each other than the usual clearance.

    Attributes:
        geometries: their identifiers.
        least: distance that they keep instead [m].
    """

    geometries: tuple[GeometryId, GeometryId]
    least: float


@dataclass(frozen=True, eq=False)
class _Held:
    """A context whose filter leaves one set of held patches out, and the clearances that are measured in it.

    Pairs of the robot's own geometries that can never keep the clearance have their own, each with its constraint.
    """

    context: Context
    plant_context: Context
    clearance: MinimumDistanceLowerBoundConstraint
    own: tuple[tuple[ClosePair, DistanceConstraint], ...]


@dataclass(eq=False)
class PostureSolver:
    """Finds postures on one terrain. Not for two threads at once.

    Collision filters live in contexts, and building the clearance constraint takes 25 ms over 500 plates: both are kept
    per set of held contacts.

        min   |q - q_guess|^2_W                                         nearness
        s.t.  p_C = 0, and the frame's x and z axes along C's           contact, six rows each
              A c(q)_xy <= b                                            balance region
              q_lower <= q <= q_upper,  |quaternion| = 1                joints
              distance(pair) >= d for every pair but held patch-terrain collision

    Attributes:
        robot_plant: robot and terrain.
        options: tolerances and limits.
    """

    robot_plant: RobotPlant
    options: PostureOptions = PostureOptions()
    _held: dict[tuple[bool, ...], _Held] = field(default_factory=dict, repr=False)

    def solve(
        self,
        X_WE: Sequence[np.ndarray | None],
        com_region: np.ndarray | None,
        q_guess: np.ndarray,
    ) -> PostureAnswer:
        """The posture nearest to a guess.

        Args:
            X_WE: per end effector its (4, 4) pose in W, None where it is free.
            com_region: (V, 2) counter-clockwise polygon in W for the CoM's x and y [m], None for anywhere.
            q_guess: (nq,).

        Raises:
            ValueError: data that is not finite or of the wrong shape.
        """
        X_WE, com_region, q_guess = _checked(self.robot_plant, X_WE, com_region, q_guess)
        answer = self._attempt(self.program(X_WE, com_region), X_WE, com_region, q_guess)
        if any(v.name.endswith("orientation") and v.value > FLIPPED for v in answer.violations):
            answer = self._attempt(self.program(X_WE, com_region, one_sided=True), X_WE, com_region, q_guess)
        return answer

    def _attempt(
        self,
        ik: InverseKinematics,
        X_WE: Sequence[np.ndarray | None],
        com_region: np.ndarray | None,
        q_guess: np.ndarray,
    ) -> PostureAnswer:
        self._add_nearness(ik, q_guess)
        result = SnoptSolver().Solve(ik.prog(), q_guess, self._solver_options())
        q = result.GetSolution(ik.q())
        if not np.isfinite(q).all():
            return PostureAnswer(
                False, q_guess, (Violation("the solver returned numbers that are not finite", 1.0, 0.0),)
            )
        q[:4] /= max(np.linalg.norm(q[:4]), 1e-12)
        violations = self.violations(q, X_WE, com_region)
        return PostureAnswer(not violations, q, violations)

    def program(
        self, X_WE: Sequence[np.ndarray | None], com_region: np.ndarray | None, *, one_sided: bool = False
    ) -> InverseKinematics:
        """All constraints and no cost, for callers who want another cost than nearness; valid until the next call.

        Args:
            X_WE: as for `solve`.
            com_region: as for `solve`.
            one_sided: also rule out frames turned by half a turn, which costs a quarter more time.
        """
        held = self._filtered(X_WE)
        ik = InverseKinematics(self.robot_plant.plant, held.plant_context)
        self._add_contacts(ik, X_WE, one_sided)
        self._add_balance(ik, com_region)
        ik.prog().AddConstraint(held.clearance, ik.q())
        for _, distance in held.own:
            ik.prog().AddConstraint(distance, ik.q())
        return ik

    def violations(
        self, q: np.ndarray, X_WE: Sequence[np.ndarray | None], com_region: np.ndarray | None
    ) -> tuple[Violation, ...]:
        """What a posture does not keep, measured from the plant; worst first.

        Args:
            q: (nq,) posture in Drake's order.
            X_WE: (4, 4) pose wanted of each end effector in W [m], None where it is free.
            com_region: (V, 2) convex polygon for the CoM, counter-clockwise [m]; None for anywhere.
        """
        plant, options = self.robot_plant.plant, self.options
        held = self._filtered(X_WE)
        plant_context = held.plant_context
        plant.SetPositions(plant_context, q)
        found = []
        for effector, X_WC, body in zip(EFFECTORS, X_WE, self.robot_plant.effector_bodies, strict=True):
            if X_WC is None:
                continue
            X_CE = RigidTransform(X_WC).inverse() @ plant.EvalBodyPoseInWorld(plant_context, body)
            angle = X_CE.rotation().ToAngleAxis().angle()
            distance = float(np.linalg.norm(X_CE.translation()))
            found.append(Violation(f"{effector} position", distance, options.position_tolerance))
            found.append(Violation(f"{effector} orientation", abs(angle), options.orientation_tolerance))
        if com_region is not None:
            A, b = half_planes(com_region)
            com = plant.CalcCenterOfMassPositionInWorld(plant_context)
            found.append(Violation("CoM outside its region", float((A @ com[:2] - b).max()), options.region_tolerance))
        lower, upper = plant.GetPositionLowerLimits(), plant.GetPositionUpperLimits()
        found.append(Violation("joint limit", float(np.maximum(q - upper, lower - q).max()), 1e-5))
        found += self._collisions(held)
        wrong = [v for v in found if not v.value <= v.limit]
        return tuple(sorted(wrong, key=lambda v: v.value / max(v.limit, 1e-9), reverse=True))

    def _collisions(self, held: _Held) -> list[Violation]:
        scene = self.robot_plant.plant.get_geometry_query_input_port().Eval(held.plant_context)
        least, tolerance = self.options.min_distance, self.options.distance_tolerance
        found = []

        def add(ids: tuple[GeometryId, GeometryId], distance: float, asked: float) -> None:
            names = " and ".join(self.robot_plant.body_of(g) for g in ids)
            found.append(Violation(f"{names} closer than {asked:.4g} m", asked - distance, tolerance))

        for pair in scene.ComputeSignedDistancePairwiseClosestPoints(max(least, 0.0)):
            add((pair.id_A, pair.id_B), pair.distance, least)
        for close, _ in held.own:
            add(close.geometries, scene.ComputeSignedDistancePairClosestPoints(*close.geometries).distance, close.least)
        return found

    def _filtered(self, X_WE: Sequence[np.ndarray | None]) -> _Held:
        held = tuple(X is not None for X in X_WE)
        if held not in self._held:
            context = held_context(self.robot_plant, held)
            plant_context = self.robot_plant.plant.GetMyContextFromRoot(context)
            close = close_pairs(self.robot_plant, self.options.min_distance)
            if close:
                scene_graph = self.robot_plant.scene_graph
                manager = scene_graph.collision_filter_manager(scene_graph.GetMyContextFromRoot(context))
                for pair in close:
                    manager.Apply(CollisionFilterDeclaration().ExcludeWithin(GeometrySet(list(pair.geometries))))
            clearance = MinimumDistanceLowerBoundConstraint(
                self.robot_plant.plant, self.options.min_distance, plant_context, None, self.options.influence
            )
            clearance.set_description("clearance")
            plant = self.robot_plant.plant
            own = tuple((p, DistanceConstraint(plant, p.geometries, plant_context, p.least, np.inf)) for p in close)
            self._held[held] = _Held(context, plant_context, clearance, own)
        return self._held[held]

    def _add_contacts(self, ik: InverseKinematics, X_WE: Sequence[np.ndarray | None], one_sided: bool) -> None:
        # Centre (3 rows), a point along x (its y and z), a point along y (its z): six rows that never lose rank, where
        # an angle's cosine has no gradient at the solution. A frame turned by half a turn keeps them too, unless the
        # points must also lie on the positive side.
        world = self.robot_plant.plant.world_frame()
        zero, side = np.zeros(3), LEVER / 2 if one_sided else -np.inf
        rows = (
            (zero, zero, zero),
            (np.array([LEVER, 0, 0]), np.array([side, 0, 0]), np.array([np.inf, 0, 0])),
            (np.array([0, LEVER, 0]), np.array([-np.inf, side, 0]), np.array([np.inf, np.inf, 0])),
        )
        for effector, X_WC, body in zip(EFFECTORS, X_WE, self.robot_plant.effector_bodies, strict=True):
            if X_WC is None:
                continue
            for point, lower, upper in rows:
                binding = ik.AddPositionConstraint(body.body_frame(), point, world, RigidTransform(X_WC), lower, upper)
                binding.evaluator().set_description(f"contact of {effector}")

    def _add_balance(self, ik: InverseKinematics, com_region: np.ndarray | None) -> None:
        if com_region is None:
            return
        plant = self.robot_plant.plant
        A, b = half_planes(com_region)
        rows = np.asfortranarray(np.column_stack([A, np.zeros(len(A))]))
        balance = ComInPolyhedronConstraint(
            plant, None, plant.world_frame(), rows, np.full(len(b), -np.inf), b, ik.context()
        )
        balance.set_description("balance region")
        ik.prog().AddConstraint(balance, ik.q())

    def _add_nearness(self, ik: InverseKinematics, q_guess: np.ndarray) -> None:
        weights = np.ones(len(q_guess))
        weights[:7] = self.options.base_weight
        ik.prog().AddQuadraticErrorCost(np.diag(weights), q_guess, ik.q())

    def _solver_options(self) -> SolverOptions:
        options = SolverOptions()
        solver = SnoptSolver().solver_id()
        options.SetOption(solver, "Major iterations limit", self.options.major_iterations)
        options.SetOption(solver, "Major feasibility tolerance", 1e-5)
        options.SetOption(solver, "Major optimality tolerance", 1e-2)
        return options


def solve_posture(
    robot_plant: RobotPlant,
    X_WE: Sequence[np.ndarray | None],
    com_region: np.ndarray | None,
    q_guess: np.ndarray,
    options: PostureOptions = PostureOptions(),
) -> PostureAnswer:
    """One posture; a caller with many keeps a `PostureSolver`, which is what this makes.

    Args:
        robot_plant: of the robot, with the terrain that it must not touch.
        X_WE: (4, 4) pose wanted of each end effector in W [m], None where it is free.
        com_region: (V, 2) convex polygon for the CoM, counter-clockwise [m]; None for anywhere.
        q_guess: (nq,) to start from, in Drake's order.
        options: tolerances and weights.
    """
    return PostureSolver(robot_plant, options).solve(X_WE, com_region, q_guess)


def held_context(robot_plant: RobotPlant, held: Sequence[bool]) -> Context:
    """A diagram context whose collision filter leaves held soles and palms against the terrain out.

    Args:
        robot_plant: of the robot.
        held: (E,) whether each end effector holds a contact.
    """
    context = robot_plant.new_context()
    terrain = list(robot_plant.terrain_geometry)
    patches = [g for on, ids in zip(held, robot_plant.effector_geometry, strict=True) if on for g in ids]
    if terrain and patches:
        manager = robot_plant.scene_graph.collision_filter_manager(
            robot_plant.scene_graph.GetMyContextFromRoot(context)
        )
        manager.Apply(CollisionFilterDeclaration().ExcludeBetween(GeometrySet(patches), GeometrySet(terrain)))
    return context


def close_pairs(robot_plant: RobotPlant, distance: float) -> tuple[ClosePair, ...]:
    """The robot's own geometries that cannot keep this distance, since they have less in the nominal posture.

    Args:
        robot_plant: of the robot.
        distance: that all others keep [m].
    """
    nominal = nominal_distances(robot_plant.robot)
    limits = {bodies: least for bodies in nominal.distance if (least := nominal.limit(bodies)) < distance}
    inspector = robot_plant.scene_graph.model_inspector()
    return tuple(
        ClosePair(ids, limits[bodies])
        for ids in (sorted(inspector.GetCollisionCandidates(), key=_by_value) if limits else ())
        if (bodies := ordered((robot_plant.body_of(ids[0]), robot_plant.body_of(ids[1])))) in limits
        and not set(ids) & set(robot_plant.terrain_geometry)
    )


def _by_value(ids: tuple[GeometryId, GeometryId]) -> tuple[int, int]:
    return ids[0].get_value(), ids[1].get_value()


def half_planes(polygon: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """A (V, 2) and b (V,) with A x <= b inside a counter-clockwise polygon (V, 2); rows are unit vectors, b is in m."""
    edges = np.roll(polygon, -1, axis=0) - polygon
    lengths = np.linalg.norm(edges, axis=1)
    keep = lengths > 1e-9
    outward = np.column_stack([edges[keep, 1], -edges[keep, 0]]) / lengths[keep, None]
    return outward, np.einsum("ij,ij->i", outward, polygon[keep])


def _checked(
    robot_plant: RobotPlant, X_WE: Sequence[np.ndarray | None], com_region: np.ndarray | None, q_guess: np.ndarray
) -> tuple[list[np.ndarray | None], np.ndarray | None, np.ndarray]:
    poses = [None if X is None else np.asarray(X, float) for X in X_WE]
    if len(poses) != len(EFFECTORS):
        raise ValueError(f"X_WE has {len(EFFECTORS)} entries, got {len(poses)}")
    for X in poses:
        if X is not None and (X.shape != (4, 4) or not np.isfinite(X).all()):
            raise ValueError("every pose in X_WE must be a finite (4, 4) array")
    if com_region is not None:
        com_region = np.asarray(com_region, float)
        if com_region.ndim != 2 or com_region.shape[1] != 2 or len(com_region) < 3 or not np.isfinite(com_region).all():
            raise ValueError("com_region must be a finite (V, 2) polygon with V >= 3")
    q_guess = np.array(q_guess, float)
    if q_guess.shape != (robot_plant.plant.num_positions(),) or not np.isfinite(q_guess).all():
        raise ValueError(f"q_guess must be {robot_plant.plant.num_positions()} finite numbers")
    return poses, com_region, q_guess
