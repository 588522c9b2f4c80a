"""Contact planning as a search problem: the one place that is both a search `Domain` and about robots (Lin 2020 ch. III).

A state is five integers: the contact numbers of left foot, right foot, left palm, right palm (-1: free), and the end
effector that moved last, which may not move again at once. An action moves a foot, or makes, moves or breaks a palm.

    edge cost  (Lin 2020 eq. 3.2)   d_e + w_theta d_theta + w_s       translation of the mover, turn of the feet's mean, one step
    heuristic  (Lin 2020 eq. 6.7)   D (2 + 2 w_s / d_max)             D: torso box on the SE(2) grid, for the mean of the feet
               (Lin 2020 eq. 3.3)   the same with D the straight line
               admissible: feet only, straight line less the goal radius (a foot's translation moves the mean by half)

What a move's own data decide (where the foot fits, whether legs reach, whether the torso is free) is cached by contact.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from drakeplan.contact_planning.contact_plan import PlannerOptions
from drakeplan.contact_planning.contact_pool import ContactPool, Rest
from drakeplan.contact_planning.domain_parts import DistanceToGo, StepCheck
from drakeplan.contact_planning.torso_grid import TorsoGrid
from scenes.footholds.partial_support import WIGGLE, no_supports, rest_feet
from scenes.footholds.projection import Placements, patch_shape
from scenes.footholds.snap import Footholds, Snap, StepLimits
from scenes.footholds.support_polygon import holds_a_disc
from scenes.robots.robot import Robot
from scenes.scene import Goal
from scenes.terrain.free_boxes import boxes_are_free
from scenes.terrain.packed_terrain import PackedTerrain

State = tuple[int, ...]  # five: left foot, right foot, left palm, right palm, last mover
GOAL_YAW_TOLERANCE = np.deg2rad(15.0)
BLAMED_OUT = 2  # motion failures near a place after which it is not used again
SPOILED_RADIUS = 0.08  # [m]
LEG_SLACK = 1.02  # the torso may sit lower and lean: legs are bounded by their length and a little
ARM_SLACK = 1.15  # palms are looked for this far from the approximated shoulder, in arm lengths
OFF_GRID = 2.0  # [m] added to the straight line where the grid knows no way: ways that it knows are tried before
NEAR_WHOLE = 0.3  # [m] a foot rests on part of itself only where no candidate nearer than this rests whole
DETOUR = 0.2  # [m] that the search rather goes round than to stand on part of a sole: whole ones carry more
LEAST_WAY = 0.05  # [m] where no usual step brings the feet this much nearer to the goal, longer ones are tried
PLACE = 0.1  # [m] means of the feet nearer than this are one place
ON_A_GRID = ("grid", "traversability")  # heuristics that follow the torso round what is in its way
TORSO_SWAY = 0.35  # [m] the real shoulder may be this far from the approximated one while a palm is held


@dataclass(frozen=True)
class PlannerWeights:
    """Weights of the edge cost (Lin 2020 eq. 3.2), with the values of Lin 2020 as defaults.

    Attributes:
        step: w_s, cost of one transition [m].
        turn: w_theta [m/rad].
        unheld: added for each palm that a foot moves without and should not (`PlannerOptions.lean_on`) [m]; ours.
    """

    step: float = 3.0
    turn: float = 0.3
    unheld: float = 3.0


class ContactDomain:
    """Successors, heuristic, goal and lazy confirmation of contact states on one terrain.

    Attributes:
        full_soles: whether all of every sole has to rest on something; else part of it may where nothing whole is near.
        least_support: inner radius of the parts that may [m].
        max_travel: how far a foot moves in one transition [m]: the robot's usual bound, or the model's longest stride.
        beyond_grid: whether states from which the grid knows no way are estimated by the straight line; else they are
            left out. The grid's torso box and gaps are a guess, so that it proves nothing.
    """

    def __init__(
        self,
        packed: PackedTerrain,
        robot: Robot,
        goal: Goal,
        check: StepCheck,
        options: PlannerOptions,
        weights: PlannerWeights,
        grid: DistanceToGo | None = None,
        start_heading: float = 0.0,
    ) -> None:
        """Prepares the domain.

        Args:
            packed: terrain.
            robot: who crosses it.
            goal: with its height.
            check: what decides whether the body can do a step; its pool numbers the contacts.
            options: heuristic, palms, transition model; with dynamics other than quasi-static a foot may be lifted where
                the rest cannot carry the weight.
            weights: of the edge cost (Lin 2020 eq. 3.2).
            grid: distances on this terrain to this goal, where there are some already.
            start_heading: of the feet at the start [rad]; snapped feet turn by multiples of 5 deg from it.
        """
        self.packed, self.robot, self.goal, self.weights = packed, robot, goal, weights
        self.pool: ContactPool = check.pool
        self.check = check
        self.rejections: Counter[str] = Counter()
        self._forbidden: set[tuple[int, ...]] = set()
        self._blamed: list[int] = []
        self.grid: DistanceToGo = grid or TorsoGrid(packed, robot, goal)
        self.beyond_grid = False
        self.full_soles, self.least_support = False, 0.0
        self._models = [options.model.mirrored(True), options.model.mirrored(False)]
        self._longer = options.longer and [options.longer.mirrored(True)[0], options.longer.mirrored(False)[0]]
        self._heuristic_name = options.heuristic
        usable = np.flatnonzero(packed.allowed.any(axis=0)).tolist()
        palms = [e for e in options.lean_on or robot.palms if e in robot.palms and e in usable]
        self._palms = tuple(e - 2 for e in palms) if options.use_palms else ()
        self._lean_on = options.lean_on if options.use_palms else ()
        self._quasi_static = options.dynamics == "quasi-static"
        self._foot_moves: dict[tuple[int, int], np.ndarray] = {}
        self._palm_moves: dict[tuple[int, int, int], np.ndarray] = {}
        self._patches = [patch_shape(e) for e in robot.effectors]
        self._footholds = Footholds(packed, start_heading, Snap() if options.footholds == "snapped" else None)
        self._limits = options.step_limits(robot, options.model)
        self._longer_limits = options.step_limits(robot, options.longer or options.model)
        self._shoulder, self._hip = np.array(robot.shoulder), np.array(robot.hip)
        self._goal_xy = np.array(goal.xyz[:2])
        self.max_travel = options.longest_travel(robot)
        self._per_metre = cost_per_metre(weights, self.max_travel)

    # Search protocol -------------------------------------------------------------------------------------------

    def successors(self, state: State) -> tuple[Sequence[State], np.ndarray]:
        """Every next stance that closed-form bounds allow, and its edge cost (Lin 2020 eq. 3.2)."""
        states: list[State] = []
        costs: list[np.ndarray] = []
        last = state[4]
        for mover in (0, 1):
            if mover != last:
                self._move_foot(state, mover, states, costs)
        for side in self._palms:
            if 2 + side != last:
                self._move_palm(state, side, states, costs)
        return states, (np.concatenate(costs) if costs else np.zeros(0))

    def heuristic(self, states: Sequence[State]) -> np.ndarray:
        """(n,) estimated cost to go."""
        estimate = self.distance_to_go(states) * self._per_metre
        if self._heuristic_name == "euclidean" and self.goal.yaw is not None:
            estimate += self.weights.turn * np.abs(_wrap(self._feet(states)[1] - self.goal.yaw))
        return estimate

    def distance_to_go(self, states: Sequence[State]) -> np.ndarray:
        """(n,) distance to the goal of the mean of the feet, as the chosen heuristic measures it [m]."""
        distance = self._distance(*self._feet(states))
        if self.pool.supports and self._heuristic_name in ON_A_GRID:
            distance += DETOUR * self.pool.on_part[np.array([s[:2] for s in states])].sum(axis=1)
        return distance

    def _distance(self, mean: np.ndarray, yaw: np.ndarray) -> np.ndarray:
        """(n,) distance to the goal from means of the feet (n, 3) [m] with headings (n,) [rad]."""
        straight = np.hypot(*(mean[:, :2] - self._goal_xy).T)
        climb = self.goal.height_off(mean[:, 2])
        if self._heuristic_name == "admissible":
            return np.hypot(np.maximum(straight - self.goal.radius, 0.0), climb)
        if self._heuristic_name == "euclidean":
            return np.hypot(straight, climb)
        distance = self.grid.distance(mean[:, 0], mean[:, 1], mean[:, 2], yaw)
        if self.beyond_grid:
            distance = np.where(np.isfinite(distance), distance, np.hypot(straight, climb) + OFF_GRID)
        # Inside the goal's cells the grid says zero: the straight line still leads to the region itself.
        return np.maximum(distance, np.minimum(straight - self.goal.radius, 0.1).clip(0.0))

    def _feet(self, states: Sequence[State]) -> tuple[np.ndarray, np.ndarray]:
        """(n, 3) means of the feet [m] and (n,) their headings [rad]."""
        feet = np.array([s[:2] for s in states])
        mean = 0.5 * (self.pool.p[feet[:, 0]] + self.pool.p[feet[:, 1]])
        return mean, _mean_yaw(self.pool.yaw[feet[:, 0]], self.pool.yaw[feet[:, 1]])

    def alike(self, state: State) -> tuple[int, ...]:
        """What a state has in common with others about as good: the place of the feet's mean, and which palms are held.

        Args:
            state: its first four numbers are looked at.
        """
        mean = 0.5 * (self.pool.p[state[0], :2] + self.pool.p[state[1], :2]) / PLACE
        return round(float(mean[0])), round(float(mean[1])), state[2] >= 0, state[3] >= 0

    def is_goal(self, state: State) -> bool:
        """Whether the mean of the feet is in the goal region, on the goal's floor."""
        mean = 0.5 * (self.pool.p[state[0]] + self.pool.p[state[1]])
        return is_at_goal(self.goal, mean, float(_mean_yaw(self.pool.yaw[state[0]], self.pool.yaw[state[1]])))

    def confirm(self, parent: State, state: State) -> bool:
        """Checks balance and reach at both critical configurations of the transition (Lin 2020 sec. 3.3).

        Args:
            parent: the state before the transition.
            state: the state after it.

        Returns:
            Whether the transition passes and was not forbidden before.
        """
        if self.is_forbidden(parent, state):
            self.rejections["motion"] += 1
            return False
        reason = self.check.transition(parent[:4], state[:4])
        if reason:
            self.rejections[reason] += 1
        return not reason

    def is_forbidden(self, before: State, after: State) -> bool:
        """Whether the motion stage failed for this transition, or repeatedly near its new contact.

        Args:
            before: the state before the transition.
            after: the state after it.
        """
        return bool(self._forbidden) and (_move(before, after) in self._forbidden or self._spoiled(after[after[4]]))

    def forbid(self, before: State, after: State) -> None:
        """Forbids a transition for which the motion stage failed, and after repeated failures the contacts near its new one.

        A transition with other palm contacts but the same foot contacts is forbidden too.

        Args:
            before: the state before the transition.
            after: the state after it.
        """
        self._forbidden.add(_move(before, after))
        if after[after[4]] >= 0:
            self._blamed.append(after[after[4]])

    def _spoiled(self, made: int) -> bool:
        """Whether the motion stage failed repeatedly for contacts of this end effector near this one."""
        blamed = [n for n in self._blamed if self.pool.effector[n] == self.pool.effector[made]]
        if made < 0 or len(blamed) < BLAMED_OUT:
            return False
        return (
            int((np.linalg.norm(self.pool.p[blamed] - self.pool.p[made], axis=1) < SPOILED_RADIUS).sum()) >= BLAMED_OUT
        )

    # Moves -----------------------------------------------------------------------------------------------------

    def _move_foot(self, state: State, mover: int, states: list[State], costs: list[np.ndarray]) -> None:
        stand, old = state[1 - mover], state[mover]
        palms = [n for n in state[2:4] if n >= 0]
        if self._quasi_static and not palms and not self.check.stands_alone(stand):
            self.rejections["friction"] += 1
            return
        if (
            self._quasi_static and palms and (reason := self.check.can_lift(state[:4], mover))
        ):  # one answer spares every child's own check
            self.rejections[reason] += 1
            return
        numbers = self._foot_candidates(stand, mover)
        if not len(numbers):
            return
        p = self.pool.p[numbers]
        travel = np.linalg.norm(p - self.pool.p[old], axis=1)
        keep = (travel <= self.max_travel) & (numbers != old)
        keep &= np.abs(p[:, 2] - self.pool.p[old, 2]) <= 1.5 * self.robot.max_step_height
        yaw = _mean_yaw(self.pool.yaw[numbers], self.pool.yaw[stand])
        for side in (0, 1):
            if state[2 + side] >= 0:
                keep &= self._arm_reaches(0.5 * (p + self.pool.p[stand]), yaw, side, state[2 + side])
        self.rejections["reach"] += int((~keep).sum())
        numbers, travel, yaw = numbers[keep], travel[keep], yaw[keep]
        before = _mean_yaw(self.pool.yaw[old], self.pool.yaw[stand])
        unheld = self.weights.unheld * sum(state[e] < 0 for e in self._lean_on)
        costs.append(travel + self.weights.turn * np.abs(_wrap(yaw - before)) + self.weights.step + unheld)
        lp, rp = state[2], state[3]
        if mover == 0:
            states.extend((n, stand, lp, rp, 0) for n in numbers.tolist())
        else:
            states.extend((stand, n, lp, rp, 1) for n in numbers.tolist())

    def _move_palm(self, state: State, side: int, states: list[State], costs: list[np.ndarray]) -> None:
        left, right, held = state[0], state[1], state[2 + side]
        numbers = self._palm_candidates(left, right, side)
        numbers = numbers[numbers != held]
        travel = np.zeros(len(numbers))
        if held >= 0:
            travel = np.linalg.norm(self.pool.p[numbers] - self.pool.p[held], axis=1)
            keep = travel <= self.robot.max_palm_translation
            numbers = np.append(numbers[keep], -1)
            travel = np.append(travel[keep], 0.0)
        if not len(numbers):
            return
        costs.append(travel + self.weights.step)
        if side == 0:
            states.extend((left, right, n, state[3], 2) for n in numbers.tolist())
        else:
            states.extend((left, right, state[2], n, 3) for n in numbers.tolist())

    def _foot_candidates(self, stand: int, mover: int) -> np.ndarray:
        key = (stand, mover)
        found = self._foot_moves.get(key)
        if found is None:
            found = self._project_feet(stand, mover, self._models[mover][0], self._limits)
            if self._longer is not None and not self._leads_on(stand, found):
                longer = self._project_feet(stand, mover, self._longer[mover], self._longer_limits)
                found = np.union1d(found, longer)
            self._foot_moves[key] = found
        return found

    def _leads_on(self, stand: int, numbers: np.ndarray) -> bool:
        """Whether one of these steps of the other foot brings the feet on from where this one stands, or none has to."""
        feet = np.append(stand, numbers)
        mean = 0.5 * (self.pool.p[feet] + self.pool.p[stand])
        here, *there = self._distance(mean, _mean_yaw(self.pool.yaw[feet], self.pool.yaw[stand])).tolist()
        return not LEAST_WAY < here < np.inf or min(there, default=np.inf) <= here - LEAST_WAY

    def _project_feet(self, stand: int, mover: int, steps: np.ndarray, limits: StepLimits) -> np.ndarray:
        """Numbers of the contacts that these steps reach from a standing foot, legs and torso allowing."""
        p0, yaw0 = self.pool.p[stand].copy(), float(self.pool.yaw[stand])
        c, s = np.cos(yaw0), np.sin(yaw0)
        xy_yaw = np.column_stack(
            [p0[0] + c * steps[:, 0] - s * steps[:, 1], p0[1] + s * steps[:, 0] + c * steps[:, 1], yaw0 + steps[:, 2]]
        )
        rise = self.robot.max_step_height
        z_range = (p0[2] - rise, p0[2] + rise)
        standing = np.array([p0[0], p0[1], yaw0])
        placed = self._footholds.place_feet(mover, xy_yaw, z_range, self._patches[mover], standing, limits)
        supports = self._rest_on_parts(mover, xy_yaw, z_range, placed)
        p, R, surface = placed
        fits = surface >= 0
        self.rejections["no foothold"] += int((~fits).sum())
        mean, yaw = 0.5 * (p + p0), _mean_yaw(xy_yaw[:, 2], yaw0)
        keep = fits & self._legs_reach(mean, yaw, p, p0, mover)
        self.rejections["reach"] += int((fits & ~keep).sum())
        free = boxes_are_free(self.packed, mean, yaw, *self.robot.lowest_torso_box, keep)
        self.rejections["collision"] += int((keep & ~free).sum())
        keep = free
        rests = [supports[k] for k in np.flatnonzero(keep).tolist()] if supports else ()
        return np.unique(self.pool.add(mover, p[keep], R[keep], xy_yaw[keep, 2], surface[keep], rests))

    def _rest_on_parts(
        self, mover: int, xy_yaw: np.ndarray, z_range: tuple[float, float], placed: Placements
    ) -> list[Rest | None] | None:
        """Sets down on part of themselves the feet that found no foothold and are far from those that did; what all rest on.

        Near a whole foothold a partial one is of little use, and would cost an expansion twice the children.
        """
        lost = placed.surface < 0
        if self.full_soles or not lost.any():
            return None
        apart = xy_yaw[lost, None, :2] - placed.p[~lost, :2]
        lost[lost] = ~((apart**2).sum(axis=2) < NEAR_WHOLE**2).any(axis=1)
        if not lost.any():
            return None
        supports = no_supports(len(lost))
        rest_feet(self.packed, mover, xy_yaw, lost, z_range, self._patches[mover], WIGGLE, placed, supports)
        half = self.robot.effectors[mover].half_extent
        if self.least_support > 0.0:
            for k in np.flatnonzero(supports.count).tolist():
                if not holds_a_disc(supports.corners[k], int(supports.count[k]), self.least_support):
                    supports.count[k], placed.surface[k] = 0, -1
        found = zip(supports.count.tolist(), supports.friction.tolist(), strict=True)
        return [Rest(supports.of(k, half), friction) if count else None for k, (count, friction) in enumerate(found)]

    def _legs_reach(
        self, mean: np.ndarray, yaw: np.ndarray, p_new: np.ndarray, p_stand: np.ndarray, mover: int
    ) -> np.ndarray:
        """Whether some hip height serves both legs: feet apart by no more than two stretched legs and the hips allow."""
        apart = np.linalg.norm(p_new - p_stand, axis=1)
        hips = 2.0 * abs(self._hip[1])
        # With both legs stretched to the greatest angle the body would drop; the lowest CoM height bounds the spread.
        drop = max(self.robot.com_height[0] * 0.75, 0.1)
        spread = 2.0 * np.sqrt(max((LEG_SLACK * self.robot.leg_reach[1]) ** 2 - drop**2, 0.0)) + hips
        return apart <= spread

    def _palm_candidates(self, left: int, right: int, side: int) -> np.ndarray:
        key = (left, right, side)
        found = self._palm_moves.get(key)
        if found is None:
            found = self._palm_moves[key] = self._cast_rays(left, right, side)
        return found

    def _cast_rays(self, left: int, right: int, side: int) -> np.ndarray:
        """Numbers of the palm contacts seen from the approximated shoulder (Lin 2020 eq. 3.1)."""
        _, rays = self._models[side]
        mean = 0.5 * (self.pool.p[left] + self.pool.p[right])
        yaw = float(_mean_yaw(self.pool.yaw[left], self.pool.yaw[right]))
        shoulder = self._shoulders(mean[None], np.array([yaw]), side)[0]
        c, s = np.cos(yaw), np.sin(yaw)
        rays_W = np.ascontiguousarray(rays @ np.array([[c, s, 0], [-s, c, 0], [0, 0, 1]]))
        low, high = self.robot.arm_reach
        palm = self._patches[2 + side]
        p, R, surface = self._footholds.place_palms(2 + side, shoulder, rays_W, yaw, (low, ARM_SLACK * high), palm)
        keep = surface >= 0
        return np.unique(self.pool.add(2 + side, p[keep], R[keep], np.full(int(keep.sum()), 0.0), surface[keep]))

    def _arm_reaches(self, mean: np.ndarray, yaw: np.ndarray, side: int, palm: int) -> np.ndarray:
        distance = np.linalg.norm(self._shoulders(mean, yaw, side) - self.pool.p[palm], axis=1)
        return distance <= self.robot.arm_reach[1] + TORSO_SWAY

    def _shoulders(self, mean: np.ndarray, yaw: np.ndarray, side: int) -> np.ndarray:
        """(n, 3) approximated shoulder points in W [m] (Lin 2020 eq. 3.1)."""
        x, y, z = self._shoulder * [1.0, 1.0 if side == 0 else -1.0, 1.0]
        c, s = np.cos(yaw), np.sin(yaw)
        return mean + np.column_stack([c * x - s * y, s * x + c * y, np.full(len(c), z)])


def cost_per_metre(weights: PlannerWeights, max_travel: float) -> float:
    """What a metre of the mean of the feet costs at least: a foot that translates by d moves it by d / 2.

    Args:
        weights: of the edge cost.
        max_travel: how far a foot moves in one transition [m].
    """
    return 2.0 + 2.0 * weights.step / max_travel


def is_at_goal(goal: Goal, mean: np.ndarray, yaw: float) -> bool:
    """Whether feet with this mean and heading stand in a goal.

    Args:
        goal: with its floor and perhaps a heading.
        mean: (3,) of the feet [m].
        yaw: of the feet [rad].
    """
    if np.hypot(mean[0] - goal.xyz[0], mean[1] - goal.xyz[1]) > goal.radius or goal.height_off(float(mean[2])) > 0:
        return False
    return goal.yaw is None or bool(abs(_wrap(np.asarray(yaw - goal.yaw))) <= GOAL_YAW_TOLERANCE)


def _move(before: State, after: State) -> tuple[int, ...]:
    """The part of a transition that identifies it: mover, contacts of the standing feet, old and new contact."""
    mover = after[4]
    return (mover, *(n for e, n in enumerate(before[:2]) if e != mover), before[mover], after[mover])


def _wrap(angle: np.ndarray) -> np.ndarray:
    """The angle in (-pi, pi]."""
    return (angle + np.pi) % (2 * np.pi) - np.pi


def _mean_yaw(a: np.ndarray, b: np.ndarray | float) -> np.ndarray:
    """The heading halfway between two headings, along the shorter way round."""
    return a + 0.5 * _wrap(b - a)
