"""Checks balance and reach of a transition at its two critical configurations (Lin 2020 sec. 3.3).

A transition is supported by the contacts that both stances share. At its first critical configuration the mover has
just broken its old contact, at the second it is about to make the new one; at both the centre of mass must lie over
the balance polygon of the support while every end effector is where its stance puts it. This is
fast whole-body inverse kinematics, run when the search is about to expand a state; every result is cached.
"""

from __future__ import annotations

import copy
from collections.abc import Callable

import numpy as np

from drakeplan.contact_planning.contact_pool import ContactPool, Held
from optimization.balance.balance_regions import balance_polygon
from optimization.balance.friction import FrictionCone, cone_generators, frame_stands_alone
from optimization.balance.reserve import ALL, Reserve
from optimization.balance.static_equilibrium import ContactArrays
from optimization.inverse_kinematics.standing_postures import NOMINAL, standing_postures
from optimization.inverse_kinematics.whole_body_ik import IkAnswer, IkOptions, WholeBodyIK
from optimization.multibody.terrain_clearance import limbs, penetration
from scenes.robots.robot import Robot
from scenes.stance import Stance
from scenes.terrain.packed_terrain import PackedTerrain

MAX_CORNERS = 48  # of a balance polygon
BALANCE_MARGIN = 0.01  # [m] the centre of mass stays this far inside the polygon,
MARGIN_SHARE = 0.4  # or, in narrow ones, this share of the way from the edge to the centroid
JOINT_RESERVE = 0.1  # [rad] of either end of a leg joint's range left to the motion, while no palm asks for a stretch
COM_ROOM = 0.08  # [m] half width of the square in which a posture's CoM must lie where the dynamics ask for a place
LIMB_DEPTH = 0.02  # [m] a limb may reach this deep into the terrain: the motion stage moves it out


class TransitionCheck:
    """Checks transitions of one robot on one terrain; results are cached by contact numbers.

    Attributes:
        reserve: what is left unused of friction and supports.
        swing_is_clear: whether what moves from one stance to the next finds a way past the terrain; None: not asked.
    """

    def __init__(
        self,
        pool: ContactPool,
        robot: Robot,
        ik: WholeBodyIK,
        packed: PackedTerrain,
        cone: FrictionCone,
        reserve: Reserve = ALL,
    ) -> None:
        """Prepares the check.

        Args:
            pool: contacts by number.
            robot: its force limits and contact patches.
            ik: inverse kinematics of this robot.
            packed: the terrain, for collisions of the limbs.
            cone: friction cone of every contact.
            reserve: what is left unused of friction and supports.
        """
        self.reserve = reserve
        self.pool, self.robot, self.cone, self.ik, self.packed = pool, robot, cone, ik, packed
        self._careful_ik = _with_reserve(ik)
        self._limbs = limbs(ik.model.tree, ik.model.capsules)
        self._cone_code = cone.code
        self._ik_options = IkOptions(restarts=0)
        self._half = np.array([e.half_extent for e in robot.effectors])
        self._limit = np.array(robot.force_limit, float)
        self._generators: dict[float, np.ndarray] = {}
        self._alone: dict[int, bool] = {}
        self._regions: dict[Held, np.ndarray | None] = {}
        self._postures: dict[tuple[Held, Held], tuple[str, np.ndarray]] = {}
        self._seeds: dict[Held, np.ndarray] = {}
        self._at_com: dict[tuple[Held, tuple[int, ...]], tuple[str, np.ndarray]] = {}
        self.swing_is_clear: Callable[[Stance, Stance], bool] | None = None
        self._swings: dict[tuple[int, ...], bool] = {}
        self.num_ik = 0

    def stands_alone(self, number: int) -> bool:
        """Whether a single contact can carry the weight at all: gravity lies inside its friction cone."""
        answer = self._alone.get(number)
        if answer is None:
            answer = frame_stands_alone(self._cone_code, self._friction(number), self.pool.R[number])
            self._alone[number] = answer
        return answer

    def region(self, held: Held) -> np.ndarray | None:
        """(V, 2) polygon of the CoM positions that these contacts can balance [m], None if there are none."""
        if held not in self._regions:
            self._regions[held] = self._solve_region(held)
        return self._regions[held]

    def stance(self, held: Held) -> str:
        """Why the robot cannot stand still with these contacts: "", "balance", "reach" or "collision"."""
        return self._posture(held, held, None)

    def transition(self, before: Held, after: Held) -> str:
        """Why the step from one stance to the next cannot be made: "", "balance", "reach", "collision" or "swing".

        Args:
            before: contact numbers by end effector, -1 where free.
            after: the same for the next stance, which differs in one end effector.
        """
        support = tuple(a if a == b else -1 for a, b in zip(before, after, strict=True))
        if self.region(support) is None:
            return "balance"
        reason = self._posture(before, support, self._seeds.get(before))
        if reason:
            return reason
        seed = self._postures[before, support][1]
        reason = self._posture(after, support, seed)
        if not reason:
            self._seeds.setdefault(after, self._postures[after, support][1])
        return reason or self.swing(before, after)

    def swing(self, before: Held, after: Held) -> str:
        """Why the moving end effector cannot get from one stance to the next: "" or "swing", where that is asked at all.

        Args:
            before: contact numbers by end effector, -1 where free.
            after: the same for the next stance, which differs in one end effector.
        """
        if self.swing_is_clear is None:
            return ""
        mover = next(e for e, n in enumerate(after) if n != before[e])
        key = (mover, before[mover], after[mover], *before[:2])
        if key not in self._swings:
            self._swings[key] = self.swing_is_clear(self._stance(before), self._stance(after))
        return "" if self._swings[key] else "swing"

    def can_lift(self, held: Held, mover: int) -> str:
        """Why this end effector cannot be lifted: "", "balance", "reach" or "collision".

        This is the first critical configuration of a transition, shared by all transitions that move this end
        effector.

        Args:
            held: contact numbers by end effector, -1 where free.
            mover: index into `EFFECTORS` of the one to lift.
        """
        support = (*held[:mover], -1, *held[mover + 1 :])
        return self._posture(held, support, self._seeds.get(held))

    def at_com(self, held: Held, com: np.ndarray) -> str:
        """Why no posture has these contacts and its CoM over this point: "", "reach", "balance" or "collision".

        Static balance is not required: in motion the dynamics decide. The CoM may lie anywhere in a square of half
        width `COM_ROOM` around the point, since the dynamics of the whole sequence will move it.

        Args:
            held: contact numbers by end effector, -1 where free.
            com: (3,) CoM in W [m]; its height is not used.
        """
        cell = tuple(np.round(com[:2] / (0.5 * COM_ROOM)).astype(int).tolist())
        known = self._at_com.get((held, cell))
        if known is None:
            square = com[:2] + COM_ROOM * np.array([[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]])
            known = self._at_com[held, cell] = self._solve_over(held, square, self._seeds.get(held))
            if not known[0]:
                self._seeds.setdefault(held, known[1])
        return known[0]

    def posture(self, held: Held, support: Held) -> np.ndarray | None:
        """(nq,) the configuration found for these contacts over this support, None if there is none.

        Args:
            held: contact numbers of the end effectors in place, -1 where free.
            support: contact numbers of those that carry load, -1 elsewhere.
        """
        reason, q = self._postures.get((held, support), ("unknown", np.zeros(0)))
        return None if reason else q

    def _stance(self, held: Held) -> Stance:
        return Stance(tuple(None if n < 0 else self.pool.contact(n) for n in held))

    def _posture(self, held: Held, support: Held, seed: np.ndarray | None) -> str:
        key = (held, support)
        known = self._postures.get(key)
        if known is None:
            known = self._postures[key] = self._solve_posture(held, support, seed)
        return known[0]

    def _solve_posture(self, held: Held, support: Held, seed: np.ndarray | None) -> tuple[str, np.ndarray]:
        region = self.region(support)
        return ("balance", np.zeros(0)) if region is None else self._solve_over(held, region, seed)

    def _solve_over(self, held: Held, region: np.ndarray, seed: np.ndarray | None) -> tuple[str, np.ndarray]:
        """A posture with these contacts and the CoM over a polygon, or why there is none."""
        active = np.array([n >= 0 for n in held])
        X_WE = np.tile(np.eye(4), (len(held), 1, 1))
        for e, n in enumerate(held):
            if n >= 0:
                X_WE[e, :3, :3], X_WE[e, :3, 3] = self.pool.R[n], self.pool.p[n]
        self.num_ik += 1
        options = self._ik_options._replace(com_margin=_margin(region))
        ik = self.ik if active[2:].any() else self._careful_ik
        answer = ik.solve(X_WE, active, region, seed, options=options)
        if not answer.ok and seed is not None:
            answer = ik.solve(X_WE, active, region, None, options=options)
        if answer.ok:
            if self._collides(answer.q):
                answer = self._out_of_the_way(ik, X_WE, active, region, answer, options)
            return ("collision" if self._collides(answer.q) else ""), answer.q
        return ("reach" if answer.contact_error > answer.com_violation else "balance"), answer.q

    def _collides(self, q: np.ndarray) -> bool:
        model = self.ik.model
        if penetration(model.tree, model.capsules, self._limbs, self.packed, q) > LIMB_DEPTH:
            return True
        return standing_postures(self.ik).is_inside(self.packed, q)

    def _out_of_the_way(
        self,
        ik: WholeBodyIK,
        X_WE: np.ndarray,
        active: np.ndarray,
        region: np.ndarray,
        found: IkAnswer,
        options: IkOptions,
    ) -> IkAnswer:
        """A lowered posture, or one with the arms elsewhere, where trunk, head or arms are in the terrain; else the given one."""
        standing, feet = standing_postures(self.ik), active[:2]
        if not feet.any() or standing.is_free(self.packed, found.q):
            return found
        heading = X_WE[:2][feet][:, :2, 0].sum(axis=0)
        place = np.append(self.ik.kinematics.com(found.q)[:2], X_WE[:2][feet][:, 2, 3].mean())
        way = standing.way_at(self.packed, [(place, float(np.arctan2(heading[1], heading[0])))])
        if way == NOMINAL:
            return found
        self.num_ik += 1
        other = copy.copy(ik)
        other.model = ik.model._replace(q_nominal=standing.postures[way])
        answer = other.solve(X_WE, active, region, None, options=options)
        return answer if answer.ok else found

    def _solve_region(self, held: Held) -> np.ndarray | None:
        numbers = [n for n in held if n >= 0]
        if not numbers:
            return None
        effectors = self.pool.effector[numbers]
        generators = np.stack([self._cone(self._friction(n)) for n in numbers])
        poses = self.pool.p[numbers], self.pool.R[numbers]
        supports = self.reserve.supports(self.pool.corners(numbers, self._half))
        arrays = ContactArrays(*poses, supports, generators, self._limit[effectors])
        corners = balance_polygon(arrays, MAX_CORNERS)
        return corners if len(corners) >= 3 else None

    def _friction(self, number: int) -> float:
        """The friction that may be used."""
        return self.reserve.friction * self.pool.friction(number)

    def _cone(self, mu: float) -> np.ndarray:
        if mu not in self._generators:
            self._generators[mu] = cone_generators(self.cone, mu)
        return self._generators[mu]


def _with_reserve(ik: WholeBodyIK) -> WholeBodyIK:
    """The same inverse kinematics with narrower ranges of the leg joints, so that the motion between postures has some range left."""
    tree = ik.model.tree
    reserve = np.zeros(len(tree.lower))
    for foot in (0, 1):
        link = int(tree.frame_link[foot])
        while link > 0:  # the joint of link i is the (i - 1)-th
            reserve[link - 1] = min(JOINT_RESERVE, 0.1 * (tree.upper[link - 1] - tree.lower[link - 1]))
            link = int(tree.parent[link])
    careful = copy.copy(ik)
    careful.model = ik.model._replace(tree=tree._replace(lower=tree.lower + reserve, upper=tree.upper - reserve))
    return careful


def _margin(region: np.ndarray) -> float:
    """Distance [m] that the centre of mass keeps from the edges of a counter-clockwise polygon (V, 2)."""
    edge = np.roll(region, -1, axis=0) - region
    length = np.hypot(edge[:, 0], edge[:, 1])
    to_centroid = region.mean(axis=0) - region
    inside = (edge[:, 0] * to_centroid[:, 1] - edge[:, 1] * to_centroid[:, 0])[length > 1e-9] / length[length > 1e-9]
    return float(np.clip(MARGIN_SHARE * inside.min(), 0.0, BALANCE_MARGIN))
