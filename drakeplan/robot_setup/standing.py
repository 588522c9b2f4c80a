"""The nominal posture: the robot stands balanced on flat soles, knees a little bent, arms clear of the body.

min   w_h |p_hand - p_ready|^2 + w_q |q - q_0|^2
s.t.  both soles level, apart by a given width, at one height, toes ahead
      the base upright
      leg length = a share of the greatest one
      CoM over the middle between the soles
      q_right = +-q_left,  q_lower <= q <= q_upper
"""

# pydrake's stubs read "float64[3, 1]" as a shape and refuse every array.
# pyright: reportArgumentType=false, reportCallIssue=false, reportAttributeAccessIssue=false, reportReturnType=false, reportOperatorIssue=false

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from pydrake.math import RotationMatrix
from pydrake.multibody.inverse_kinematics import ComPositionConstraint, InverseKinematics
from pydrake.solvers import SnoptSolver

from drakeplan.robot_setup.link_tree import LinkTree
from drakeplan.robot_setup.palms import Palm
from drakeplan.robot_setup.soles import Sole
from drakeplan.robot_setup.symmetry import MirroredJoint

STRAIGHT = 0.955  # leg length of the posture, as a share of the greatest one
FORWARD, DOWN = 0.30, 0.60  # where a hand is carried before and below the shoulder, as shares of the arm's length
OUTWARD = (0.15, 0.25, 0.4, 0.55)  # beside the shoulder: the first that keeps the arms clear
CLEAR = 0.02  # [m] of the arms from legs and trunk
FLAT_ANGLE = 2e-3  # [rad] of the soles
BENT_BACK = 100.0  # cost of knees that bend backwards, more than any other posture costs
SMALL = 0.006  # [rad] angles below this are 0
TRIES = 6  # starts of the solver


@dataclass(frozen=True, eq=False)
class Standing:
    """A posture that stands.

    Attributes:
        angles: joint name -> angle [rad], rounded to a milliradian.
        q: (nq,) all positions, soles at z = 0.
        separation: of the soles, sideways [m].
        leg_length: greatest distance of hip and sole [m].
        arms_clear: least distance of arms from trunk and legs [m], infinite without arms.
        com: (3,) centre of mass [m].
    """

    angles: dict[str, float]
    q: np.ndarray
    separation: float
    leg_length: float
    arms_clear: float
    com: np.ndarray


def find_standing(
    tree: LinkTree,
    soles: tuple[Sole, Sole],
    palms: tuple[Palm, Palm] | None,
    mirrored: Sequence[MirroredJoint],
    R_BF: np.ndarray,
    *,
    seed: int = 0,
) -> Standing | str:
    """The nominal posture, or in words why none was found.

    Args:
        tree: of the robot, with fingers and head welded.
        soles: of both feet.
        palms: of both hands, None for a robot without arms.
        mirrored: joints that are moved as mirror images.
        R_BF: (3, 3) axes of the robot (ahead, left, up) in its base.
        seed: of the starts.
    """
    rng = np.random.default_rng(seed)
    hips = [tree.origin(n) for n in _hip_links(tree, soles)]
    wide = soles[0].half_extent[1] + soles[0].overhang[2]
    separation = max(abs(float(hips[0][1] - hips[1][1])), 2 * wide + 0.04)
    problem = _Problem(tree, soles, palms, mirrored, R_BF, separation)
    tall = problem.tallest(rng)
    if tall is None:
        return "no posture has both soles flat on the ground: are these the feet, and are the joint limits right?"
    best: Standing | None = None
    for outward in OUTWARD if palms else OUTWARD[:1]:
        found = problem.solve(tall, outward, rng)
        if found is None:
            continue
        if best is None or found.arms_clear > best.arms_clear:
            best = found
        if found.arms_clear > CLEAR:
            break
    return best or "the robot cannot stand balanced with bent knees: are its masses right?"


def _hip_links(tree: LinkTree, soles: tuple[Sole, Sole]) -> list[str]:
    """The third link of each leg: where the axes of a hip have come together."""
    ways = [tree.way(s.link) for s in soles]
    shared = sum(a == b for a, b in zip(*ways, strict=False))
    return [way[min(shared + 2, len(way) - 1)] for way in ways]


@dataclass(eq=False)
class _Problem:
    tree: LinkTree
    soles: tuple[Sole, Sole]
    palms: tuple[Palm, Palm] | None
    mirrored: Sequence[MirroredJoint]
    R_BF: np.ndarray
    separation: float

    def _program(self) -> InverseKinematics:
        plant = self.tree.plant
        ik = InverseKinematics(plant, with_joint_limits=True)
        R = RotationMatrix.ProjectToRotationMatrix(self.R_BF).inverse().ToQuaternion().wxyz()
        ik.prog().AddBoundingBoxConstraint(R, R, ik.q()[:4])
        ik.prog().SetInitialGuess(ik.q()[:4], R)
        world = plant.world_frame()
        for sole, side in zip(self.soles, (0.5, -0.5), strict=True):
            frame = plant.GetBodyByName(sole.body).body_frame()
            p, R_BE = sole.X_BE[:3, 3], RotationMatrix.ProjectToRotationMatrix(sole.X_BE[:3, :3])
            y = side * self.separation
            ik.AddPositionConstraint(frame, p, world, [-1e-4, y - 1e-4, -1e-4], [1e-4, y + 1e-4, 1e-4])
            ik.AddOrientationConstraint(world, RotationMatrix(), frame, R_BE, FLAT_ANGLE)
        for pair in self.mirrored:
            a, b = (plant.GetJointByName(n).position_start() for n in (pair.left, pair.right))
            ik.prog().AddLinearEqualityConstraint(ik.q()[b] - pair.sign * ik.q()[a], 0.0)
        return ik

    def _stiffness(self) -> np.ndarray:
        """(nq - 7,) cost of each joint's angle: the trunk stays upright, arms and legs move."""
        limbs = {name for pair in self.mirrored for name in (pair.left, pair.right)}
        plant = self.tree.plant
        found = np.full(plant.num_positions() - 7, 1.0)
        for name in limbs:
            found[plant.GetJointByName(name).position_start() - 7] = 0.02
        return found

    def _start(self, rng: np.random.Generator, spread: float) -> np.ndarray:
        plant = self.tree.plant
        q = plant.GetPositions(self.tree.context).copy()
        low, high = plant.GetPositionLowerLimits()[7:], plant.GetPositionUpperLimits()[7:]
        q[7:] = np.clip(q[7:] + spread * rng.standard_normal(len(q) - 7), low, high)
        for pair in self.mirrored:
            a, b = (plant.GetJointByName(n).position_start() for n in (pair.left, pair.right))
            q[b] = pair.sign * q[a]
        q[:4] = RotationMatrix.ProjectToRotationMatrix(self.R_BF).inverse().ToQuaternion().wxyz()
        hip = -min(float(s) for s in self._sole_heights())
        q[4:7] = 0.0, 0.0, 0.97 * hip
        return q

    def _sole_heights(self) -> list[float]:
        return [float((self.tree.pose(s.body) @ s.X_BE)[2, 3]) for s in self.soles]

    def tallest(self, rng: np.random.Generator) -> np.ndarray | None:
        """The posture with the highest base."""
        best = None
        for k in range(2 * TRIES):
            ik = self._program()
            ik.prog().AddLinearCost(-ik.q()[6])
            ik.prog().AddQuadraticErrorCost(1e-3 * np.eye(len(ik.q()) - 7), np.zeros(len(ik.q()) - 7), ik.q()[7:])
            found = self._answer(ik, self._start(rng, 0.1 + 0.1 * k))
            if found is not None and (best is None or found[0][6] > best[6]):
                best = found[0]
            if best is not None and k >= TRIES:
                break
        return best

    def _answer(self, ik: InverseKinematics, start: np.ndarray) -> tuple[np.ndarray, float] | None:
        """What the solver found and its cost, None where it does not stand."""
        result = SnoptSolver().Solve(ik.prog(), start)
        q = result.GetSolution(ik.q())
        if not np.isfinite(q).all():
            return None
        lower, upper = self.tree.plant.GetPositionLowerLimits(), self.tree.plant.GetPositionUpperLimits()
        ok = bool((q >= lower - 1e-5).all() and (q <= upper + 1e-5).all())
        with self.tree.posture(q):
            for sole, side in zip(self.soles, (0.5, -0.5), strict=True):
                X = self.tree.pose(sole.body) @ sole.X_BE
                ok &= bool(np.abs(X[:3, 3] - [0, side * self.separation, 0]).max() < 1e-3 and X[2, 2] > 1 - 1e-4)
        return (q, float(result.get_optimal_cost())) if ok else None

    def solve(self, tall: np.ndarray, outward: float, rng: np.random.Generator) -> Standing | None:
        """The posture at the chosen height with the hands beside the body."""
        plant, context = self.tree.plant, self.tree.context
        hip = self._hip_height(tall)
        best: tuple[float, np.ndarray] | None = None
        for k in range(TRIES):
            ik = self._program()
            height = tall[6] - (1.0 - STRAIGHT) * hip
            ik.prog().AddBoundingBoxConstraint(height, height, ik.q()[6])
            com = ik.prog().NewContinuousVariables(3, "com")
            ik.prog().AddConstraint(
                ComPositionConstraint(plant, None, plant.world_frame(), ik.context()), np.concatenate([ik.q(), com])
            )
            ik.prog().AddBoundingBoxConstraint([-0.02, -0.01], [0.02, 0.01], com[:2])
            ik.prog().AddQuadraticErrorCost(20.0 * np.eye(2), np.zeros(2), com[:2])
            ik.prog().AddQuadraticErrorCost(np.diag(self._stiffness()), np.zeros(len(ik.q()) - 7), ik.q()[7:])
            for palm, target in self._ready(tall, outward):
                frame = plant.GetBodyByName(palm.body).body_frame()
                ik.AddPositionCost(plant.world_frame(), target, frame, palm.X_BE[:3, 3], 4.0 * np.eye(3))
            start = tall + np.concatenate([np.zeros(7), (0.15 + 0.1 * k) * rng.standard_normal(len(tall) - 7)])
            start = np.clip(start, plant.GetPositionLowerLimits(), plant.GetPositionUpperLimits())
            found = self._answer(ik, np.concatenate([start, [0.0, 0.0, 0.5 * height]]))
            if found is None:
                continue
            cost = found[1] + (BENT_BACK if self._knees_behind(found[0]) else 0.0)
            if best is None or cost < best[0] - 1e-6:
                best = (cost, found[0])
        if best is None:
            return None
        q = best[1]
        angles = {
            j.name(): round(float(q[j.position_start()]), 3)
            for j in (plant.get_joint(i) for i in plant.GetJointIndices())
            if j.num_positions() == 1 and abs(q[j.position_start()]) > SMALL
        }
        for name, angle in angles.items():  # rounding may pass a limit
            joint = plant.GetJointByName(name)
            low, high = joint.position_lower_limits()[0], joint.position_upper_limits()[0]
            angles[name] = float(np.clip(angle, np.ceil(low * 1e4) / 1e4, np.floor(high * 1e4) / 1e4))
        with self.tree.posture(q):
            com_W = plant.CalcCenterOfMassPositionInWorld(context)
            clear = self._arms_clear()
        return Standing(angles, q, self.separation, hip, clear, com_W)

    def _hip_height(self, q: np.ndarray) -> float:
        with self.tree.posture(q):
            return float(np.mean([self.tree.origin(n)[2] for n in _hip_links(self.tree, self.soles)]))

    def _knees_behind(self, q: np.ndarray) -> bool:
        """Whether the middle of a leg is behind the line from hip to sole: knees of people bend forward."""
        way = self.tree.way(self.soles[0].link)
        with self.tree.posture(q):
            hip = self.tree.origin(_hip_links(self.tree, self.soles)[0])
            foot = self.tree.origin(self.soles[0].link)
            middle = min((self.tree.origin(n) for n in way[1:]), key=lambda p: abs(p[2] - 0.5 * (hip[2] + foot[2])))
        share = (hip[2] - middle[2]) / max(hip[2] - foot[2], 1e-6)
        return bool(middle[0] < hip[0] + share * (foot[0] - hip[0]) - 0.005)

    def _ready(self, q: np.ndarray, outward: float) -> list[tuple[Palm, np.ndarray]]:
        """Where each hand is carried."""
        found = []
        with self.tree.posture(q):
            for palm, side in zip(self.palms or (), (1.0, -1.0), strict=False):
                way = self.tree.way(palm.link)
                first = way[self._arm_start(way) :]
                shoulder = self.tree.origin(first[min(1, len(first) - 1)])
                hand = (self.tree.pose(palm.body) @ palm.X_BE)[:3, 3]
                places = [shoulder, *(self.tree.origin(n) for n in first[2:]), hand]
                length = sum(float(np.linalg.norm(b - a)) for a, b in pairwise(places))
                found.append((palm, shoulder + length * np.array([FORWARD, side * outward, -DOWN])))
        return found

    def _arm_start(self, way: list[str]) -> int:
        assert self.palms is not None
        other = self.tree.way(self.palms[1].link if way[-1] == self.palms[0].link else self.palms[0].link)
        return sum(a == b for a, b in zip(way, other, strict=False))

    def _arms_clear(self) -> float:
        """Least distance of the outer arms from trunk, legs and each other [m]; links beside each other are left out."""
        if self.palms is None:
            return float("inf")
        outer: dict[str, int] = {}
        for k, palm in enumerate(self.palms):
            way = self.tree.way(palm.link)
            arm = way[self._arm_start(way) :]
            for name in arm[len(arm) // 2 :]:
                outer |= {b: k for n in self.tree.below(name) for b in self.tree.links[n].bodies}
        query = self.tree.plant.get_geometry_query_input_port().Eval(self.tree.context)
        inspector = query.inspector()
        near = set()
        for palm in self.palms:
            way = self.tree.way(palm.link)
            near |= {b for n in way[self._arm_start(way) :] for b in self.tree.links[n].bodies}
        least = 0.5
        for pair in query.ComputeSignedDistancePairwiseClosestPoints(0.1):
            bodies = [
                self.tree.plant.GetBodyFromFrameId(inspector.GetFrameId(g)).name() for g in (pair.id_A, pair.id_B)
            ]
            sides = {outer.get(b) for b in bodies}
            if sides == {None} or (len(sides) == 1 and None not in sides):
                continue
            if None in sides and any(b in near and b not in outer for b in bodies):
                continue
            least = min(least, float(pair.distance))
        return least
