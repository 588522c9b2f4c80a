"""A lower bound on what any walk to the goal costs, from the convex relaxation of a graph of convex sets.

Every search result can show its gap against it: the search's own cost (Lin 2020 eq. 3.2) is a sum over transitions of
the moving end effector's translation, a term for turning that is not negative, and w_s.
"""

# pydrake's stubs read "float64[m, 1]" as a shape and refuse every array.
# pyright: reportArgumentType=false, reportCallIssue=false, reportAttributeAccessIssue=false

from __future__ import annotations

import time
from dataclasses import dataclass

import numpy as np
import shapely

from optimization.contact_programs.step_graph import Foothold, StepGraph, could_step, graph_options, quiet
from scenes.effector import PALMS
from scenes.footholds.foothold_regions import FootholdRegion, disc_region
from scenes.input_error import InputError
from scenes.robots.robot import Robot
from scenes.scene import Goal, Scene
from scenes.stance import Stance
from scenes.terrain.packed_terrain import pack_terrain
from scenes.transition_model import TransitionModel, transition_model

SAME_CONTACT = 0.02  # [m] contacts nearer than this along every axis may count as one (`drakeplan.contact_planning.contact_pool.CELL`)
TOLERANCE = 1e-4  # relative: what the interior-point method may lack of the relaxation's optimum
SPARE_STEPS = 4  # layers beyond what the straight line needs
TALLEST = 1.5  # times the greatest height between the feet: by how much a foot may rise in one step


@dataclass(frozen=True)
class LengthBound:
    """A lower bound.

    Attributes:
        cost: no walk to the goal costs less: sum of the feet's translations [m] + step_weight per foot step. -inf where
            the relaxation could not be solved, inf where no walk exists.
        straight: the same from the straight line alone.
        step_weight: cost of each step that is counted [m].
        steps: layers of the graph.
        time: seconds.
        reason: "" or why the bound is only the straight line's.
    """

    cost: float
    straight: float
    step_weight: float
    steps: int
    time: float
    reason: str = ""

    def gap(self, cost: float) -> float:
        """Relative gap (cost - bound) / cost of a plan that costs this much."""
        return max(cost - self.cost, 0.0) / max(cost, 1e-9)


def length_lower_bound(
    scene: Scene,
    robot: Robot,
    start: Stance,
    goal: Goal | None = None,
    model: TransitionModel | None = None,
    *,
    step_weight: float = 3.0,
    palms: bool = True,
    num_steps: int | None = None,
    time_limit: float = 60.0,
) -> LengthBound:
    """A lower bound on sum_k (translation of the mover + step_weight) over any transitions from start to goal.

    Why it is one. Take any contact sequence that the search may return, and only its foot moves. Between two moves of one
    foot the other may not have moved (palms did): such a run is put together to one move. What is left alternates.

    1. A run costs at least its straight line, and one step_weight; if the line is longer than one stride, it had two foot
       moves and a palm move between them at least, so at least three. These are the two edges between two vertices (one
       where no palm can be used). Turning and palms cost no less than nothing.
    2. Every contact point lies in its vertex's set: a sole inside a surface holds a disc of radius min(hx, hy) about its
       centre whatever its heading, so the centre keeps that distance from every edge. Obstacles are left out.
    3. A foot is set down within the transition model's longest step of the standing one in the plan view, and within the
       greatest height (and a contact's cell, since near contacts count as one), so every stance satisfies the edge.
    4. A walk may end in every layer once the mean of the feet is in the goal's disc. One with more steps than layers
       leaves the last layer by an edge that costs step_weight and the straight line: a foot's translation moves the mean
       by half as much, so what is left costs at least twice the mean's distance to the disc.

    So every sequence is a feasible walk that costs at least what the graph says; the graph's shortest path costs no more
    than the walk, its convex relaxation no more than the path, and what the solver reports, less its tolerance, no more
    than the relaxation. Both feet may move first: the lesser of two graphs.

    Args:
        scene: terrain; its goal counts where none is given.
        robot: soles, stride and step height.
        start: the first stance.
        goal: where the mean of the feet ends.
        model: the transition model that the search uses.
        step_weight: w_s of Lin 2020 eq. 3.2 [m]; 0 gives a bound on the length alone.
        palms: whether the search may use palms.
        num_steps: layers; None for a few more than a walk with the greatest strides needs.
        time_limit: seconds for each of the two relaxations.

    Raises:
        InputError: no goal, or a foot in the air at the start.
    """
    began = time.perf_counter()
    goal = goal or scene.goal
    if goal is None or not np.isfinite(goal.xyz[:2]).all():
        raise InputError(f"scene {scene.name}: length bound: expected a goal")
    if start.contacts[0] is None or start.contacts[1] is None:
        raise InputError(f"scene {scene.name}: length bound: expected both feet on the ground at the start")
    model = model or transition_model()
    walls = bool(scene.terrain.surfaces_for(*PALMS))
    held = any(c is not None for c in start.contacts[2:])
    bounds = _Bounds(scene, robot, start, goal, model, step_weight, palms and (walls or held))
    straight = bounds.straight()
    if num_steps is None:
        num_steps = int(np.ceil(2.0 * bounds.to_goal() / robot.max_foot_translation)) + SPARE_STEPS
    costs, reason = [], ""
    for first in (0, 1):
        cost, why = bounds.relaxation(first, num_steps, time_limit)
        costs.append(cost)
        reason = reason or why
    cost = max(min(costs), straight)  # both are bounds
    return LengthBound(cost, straight, step_weight, num_steps, time.perf_counter() - began, reason)


class _Bounds:
    """The relaxed steps of one query."""

    def __init__(
        self,
        scene: Scene,
        robot: Robot,
        start: Stance,
        goal: Goal,
        model: TransitionModel,
        step_weight: float,
        palms: bool,
    ) -> None:
        self.scene, self.robot, self.start, self.goal = scene, robot, start, goal
        self.packed = pack_terrain(scene.terrain)
        left, right = start.contacts[:2]
        assert left is not None
        assert right is not None
        self._feet = left, right
        self.step_weight, self.palms = step_weight, palms
        self.reach = float(np.hypot(model.steps[:, 0], model.steps[:, 1]).max()) + np.sqrt(2.0) * SAME_CONTACT
        self.rise = robot.max_step_height + SAME_CONTACT
        self._centre = np.array(goal.xyz[:2])
        self._regions = {e: self._candidates(e) for e in (0, 1)}

    def to_goal(self) -> float:
        """Distance of the feet's mean from the goal's disc [m]."""
        return max(float(np.hypot(*(self.start.feet_mean()[:2] - self._centre))) - self.goal.radius, 0.0)

    def straight(self) -> float:
        """The bound from the straight line alone: the mean moves by half of what a foot does, by a stride at most.

        With palms a foot may be moved twice in a row, which counts every stride just the same.
        """
        length = 2.0 * self.to_goal()
        return float(length + self.step_weight * np.ceil(length / self.robot.max_foot_translation - 1e-9))

    def _candidates(self, effector: int) -> list[FootholdRegion]:
        spec = self.robot.effectors[effector]
        numbers = np.flatnonzero(self.packed.allowed[: self.packed.num_surfaces, effector]).tolist()
        found = [disc_region(self.packed, k, effector, min(spec.half_extent)) for k in numbers]
        return [r for r in found if r is not None]

    def relaxation(self, first: int, num_steps: int, time_limit: float) -> tuple[float, str]:
        """The relaxation's optimum, less the tolerance, where this foot moves first; the straight line and why, if not."""
        if self.to_goal() <= 0.0:
            return 0.0, ""
        low, high = self.scene.terrain.extent
        graph = StepGraph(low - 1.0, high + 1.0)
        stand, mover = self._feet[1 - first], self._feet[first]
        source = graph.add_start(stand.p_WC, mover.p_WC, stand.surface)
        target = graph.add_goal(self._centre, self.goal.radius)
        layer = [source]
        for i in range(num_steps):
            layer = self._layer(graph, i, (first + i) % 2, layer)
            for u in layer:
                if self._near_goal(u):
                    graph.add_arrival(u, target)
        for u in layer:  # walks with more steps than layers
            edge = graph.gcs.AddEdge(u.vertex, target)
            A, b = u.mean
            graph.add_length(edge, np.hstack([-2.0 * np.eye(2), 2.0 * A]), 2.0 * b)
            graph.add_constant(edge, self.step_weight)
        with quiet():
            result = graph.gcs.SolveShortestPath(source.vertex, target, graph_options(time_limit, seed=0))
        cost = float(result.get_optimal_cost())
        if not result.is_success() or not np.isfinite(cost):
            return self.straight(), "the relaxation was not solved"
        return cost * (1.0 - TOLERANCE) - TOLERANCE, ""

    def _layer(self, graph: StepGraph, i: int, mover: int, previous: list[Foothold]) -> list[Foothold]:
        layer = []
        for k, region in enumerate(self._regions[mover]):
            before = [u for u in previous if could_step(u, region, self.reach, self.rise)]
            if not before:
                continue
            v = graph.add_foothold(region, f"{i}/{k}")
            for u in before:
                self._add_step(graph, u, v, long=False)
                if self.palms:
                    self._add_step(graph, u, v, long=True)
            layer.append(v)
        return layer

    def _add_step(self, graph: StepGraph, u: Foothold, v: Foothold, *, long: bool) -> None:
        edge = graph.add_step(u, v)
        A, b = graph.apart(u, v)
        graph.keep_within(edge, A[:2], b[:2], self.reach)
        graph.keep_between(edge, A[2:], b[2:], np.array([-self.rise]), np.array([self.rise]))
        A, b = graph.travel(u, v)
        if not long:
            graph.keep_within(edge, A, b, self.robot.max_foot_translation)
            tallest = np.array([TALLEST * self.robot.max_step_height])
            graph.keep_between(edge, A[2:], b[2:], -tallest, tallest)
        graph.add_length(edge, A, b)
        graph.add_constant(edge, self.step_weight * (3.0 if long else 1.0))

    def _near_goal(self, u: Foothold) -> bool:
        """Whether the mean may be in the disc: the foot is no farther from the mean than half the reach."""
        outline = shapely.MultiPoint(u.placed.vertices[:, :2]).convex_hull
        return outline.distance(shapely.Point(self._centre)) <= self.goal.radius + 0.5 * self.reach + 1e-9
