"""Footsteps as a shortest path in a graph of convex sets: the third baseline, beyond the documents.

The same steps, regions, reach and costs as `FootstepProgram`, but the choice of surfaces is a walk through layers of
vertices, whose convex relaxation is far tighter than that of big-M and is solved once, by an interior-point method;
its flows are then rounded to paths. Its optimum is a lower bound on the cost of every sequence of these steps.

Marcucci, Umenberger, Parrilo, Tedrake 2024: "Shortest paths in graphs of convex sets", SIAM J. Optim. 34(1).
"""

# pydrake's stubs read "float64[m, 1]" as a shape and refuse every array.
# pyright: reportArgumentType=false, reportCallIssue=false, reportAttributeAccessIssue=false

from __future__ import annotations

import time
from collections.abc import Callable
from functools import partial

import numpy as np

from optimization.balance.friction import stands_alone
from optimization.contact_programs.contact_choice import within
from optimization.contact_programs.contact_query import (
    GOAL_YAW_TOLERANCE,
    SAME_PLACE,
    ContactEstimate,
    ContactQuery,
    FootstepOptions,
)
from optimization.contact_programs.step_graph import Edge, Foothold, StepGraph, could_step, graph_options, quiet
from optimization.mixed_integer.solver import (
    FAILED,
    FOUND,
    INFEASIBLE,
    LIMIT,
    MixedIntegerRecord,
    MixedIntegerSettings,
    Progress,
)
from scenes.footholds.foothold_regions import FootholdRegion, foothold_regions
from scenes.input_error import InputError
from scenes.scene import GOAL_HEIGHT
from scenes.stance import Stance

ROUNDED_PATHS = 50  # tried from the flows of the relaxation
ACCEPT = 1e-5  # [m] by which a rounded path may miss a constraint, by our own check


class ConvexSetGraph:
    """A given number of steps to the goal over convex regions, as a graph of convex sets.

        min   sum_i w_step |p_i - p_(i-2)|^2 + w_goal |mean - goal|^2
        s.t.  a walk through the layers; reach, rise, stride and goal as in `FootstepProgram`

    Headings are the ends of the intervals, so that rotation costs vertices, not binaries. Palms are not part of it.

    Attributes:
        graph: vertices and edges.
        layers: the footholds of each step.
        reason: "" or why the geometry alone leaves no answer.
    """

    def __init__(self, query: ContactQuery, options: FootstepOptions | None = None) -> None:
        """Builds the graph; palms and `trim` in the options are not for it.

        Raises:
            InputError: `trim` was asked for.
        """
        self.query, self.options = query, options or FootstepOptions()
        if self.options.trim:
            raise InputError("graph of convex sets: trim: the number of steps is that of its layers")
        low, high = query.terrain.extent
        self.graph = StepGraph(low - 1.0, high + 1.0)
        self.reason = ""
        first = self.options.first
        # A graph of steps knows no palms: their share of the contacts is left out.
        share = 1.0 + 0.5 * len(self.options.palms)
        self.num_steps = int(np.ceil(self.options.num_contacts / share))
        stand, mover = query.feet[1 - first], query.feet[first]
        self._start = self.graph.add_start(stand.p_WC, mover.p_WC, stand.surface)
        goal = np.array(query.goal.xyz[:2])
        self._goal = self.graph.add_goal(goal, query.goal.radius - SAME_PLACE)
        self.layers: list[list[Foothold]] = []
        self._regions = {e: self._candidates(e) for e in (0, 1)}
        self._footholds: dict[str, Foothold] = {}
        previous = [self._start]
        for i in range(self.num_steps):
            previous = self._add_layer(i, (first + i) % 2, previous)
            if not previous:
                self.reason = f"step {i}: no surface takes it within reach of start and goal"
                return
        for u in previous:
            self._add_arrival(u)

    def _candidates(self, effector: int) -> list[FootholdRegion]:
        heading = self.query.feet[0].heading
        intervals = self.options.headings or ((heading, heading),)
        ends = sorted({end for interval in intervals for end in interval})
        packed, robot, holds = self.query.packed, self.query.robot, partial(stands_alone, self.query.cone)
        return [r for h in ends for r in foothold_regions(packed, robot, effector, (h, h), holds=holds)]

    def _add_layer(self, i: int, mover: int, previous: list[Foothold]) -> list[Foothold]:
        reach, goal = self.query.reach, self.query.goal
        to_goal = goal.radius + reach.farthest * (self.num_steps - i - 0.5) + SAME_PLACE
        regions = within(self._regions[mover], np.array(goal.xyz), to_goal)
        layer = []
        for k, region in enumerate(regions):
            before = [u for u in previous if self._could(u, region, mover) and self._may_end(i, u, region)]
            if not before:
                continue
            name = f"{i}/{k}"
            v = self._footholds[name] = self.graph.add_foothold(region, name)
            for u in before:
                self._add_step(u, v, mover)
            layer.append(v)
        self.layers.append(layer)
        return layer

    def _could(self, u: Foothold, region: FootholdRegion, mover: int) -> bool:
        reach = self.query.reach
        if self._share(u, region.surface, mover) <= 0:
            return False
        side = 1.0 if mover == 0 else -1.0
        turn = side * (region.heading[0] - self._heading(u))
        if not -reach.turn_in - 1e-9 <= turn <= reach.turn_out + 1e-9:
            return False
        return could_step(u, region, reach.farthest, reach.rise)

    def _may_end(self, i: int, u: Foothold, region: FootholdRegion) -> bool:
        """Whether the walk may end with this step as far as the goal's heading goes; yes for every step but the last."""
        yaw = self.query.goal.yaw
        if i < self.num_steps - 1 or yaw is None:
            return True
        off = 0.5 * (self._heading(u) + region.heading[0]) - yaw
        return abs((off + np.pi) % (2 * np.pi) - np.pi) <= GOAL_YAW_TOLERANCE

    def _heading(self, u: Foothold) -> float:
        start = self.query.feet[1 - self.options.first]
        return u.region.heading[0] if u.region is not None else start.heading

    def _share(self, u: Foothold, surface: int, mover: int) -> float:
        """What is left of the reach while the feet stand on this pair of surfaces."""
        pair = (surface, u.surface) if mover == 0 else (u.surface, surface)
        return self.query.narrowed.get(pair, 1.0)

    def _add_step(self, u: Foothold, v: Foothold, mover: int) -> None:
        edge, side = self.graph.add_step(u, v), 1.0 if mover == 0 else -1.0
        reach = self.query.reach
        A, b = self.graph.apart(u, v)
        c, s = np.cos(self._heading(u)), np.sin(self._heading(u))
        for o, radius in reach.scaled(self._share(u, v.surface, mover)).discs(side):
            centre = np.array([c * o[0] - s * o[1], s * o[0] + c * o[1]])
            self.graph.keep_within(edge, A[:2], b[:2] - centre, radius)
        self.graph.keep_between(edge, A[2:], b[2:], np.array([-reach.rise]), np.array([reach.rise]))
        A, b = self.graph.travel(u, v)
        self.graph.keep_within(edge, A, b, reach.stride)
        self.graph.add_square(edge, self.options.step, A, b)
        turn = v.placed.heading[0] - self._heading(u)
        self.graph.add_constant(edge, self.options.turn * turn * turn)

    def _add_arrival(self, u: Foothold) -> None:
        edge: Edge = self.graph.add_arrival(u, self._goal)
        A, b = u.mean
        rows = np.hstack([np.zeros((2, 2)), A])  # over (x_v, x_u)
        off = u.mean_height[1] - self.query.goal.xyz[2]
        if np.isfinite(off).all():
            height, room = np.hstack([np.zeros((1, 2)), u.mean_height[0]]), np.array([GOAL_HEIGHT])
            self.graph.keep_between(edge, height, off, -room, room)
        self.graph.add_square(edge, self.options.goal, rows, b - np.array(self.query.goal.xyz[:2]))

    # Answers ----------------------------------------------------------------------------------------------------

    def solve(
        self,
        settings: MixedIntegerSettings | None = None,
        on_incumbent: Callable[[Progress, tuple[Stance, ...]], None] | None = None,
        stop: Callable[[], bool] | None = None,
    ) -> ContactEstimate:
        """The best rounded path; the record's bound is the relaxation's optimum.

        Args:
            settings: its time limit counts; the solver is Clarabel whatever it says.
            on_incumbent: called with every rounded path that is better.
            stop: polled between the solves.
        """
        settings = settings or MixedIntegerSettings()
        began = time.perf_counter()
        if self.reason:
            return ContactEstimate(False, (), np.inf, False, self.reason, None)
        options = graph_options(settings.time_limit, seed=0)
        with quiet():
            relaxed = self.graph.gcs.SolveShortestPath(self._start.vertex, self._goal, options)
        spent = time.perf_counter() - began
        if not relaxed.is_success():
            limited = spent >= settings.time_limit
            word = LIMIT if limited else INFEASIBLE
            message = "graph of convex sets: " + ("the time limit fired" if limited else "no walk reaches the goal")
            record = self._record(word, message, np.inf, -np.inf, began, ())
            return ContactEstimate(False, (), np.inf, limited, message, record)
        bound = float(relaxed.get_optimal_cost())
        best: tuple[float, tuple[Stance, ...]] | None = None
        history = [Progress(spent, np.inf, bound)]
        limited = False
        for path in self._paths(relaxed, options):
            limited = time.perf_counter() - began > settings.time_limit or (stop is not None and stop())
            if limited:
                break
            cost, stances = self._restrict(path, options)
            if best is None or cost < best[0]:
                if not np.isfinite(cost):
                    continue
                best = (cost, stances)
                history.append(Progress(time.perf_counter() - began, cost, bound))
                if on_incumbent is not None:
                    on_incumbent(history[-1], stances)
            if history[-1].gap <= settings.gap:
                break
        if best is None:
            message = "graph of convex sets: none of the rounded paths is feasible"
            record = self._record(LIMIT if limited else FAILED, message, np.inf, bound, began, tuple(history))
            return ContactEstimate(False, (), np.inf, limited, message, record)
        message = f"graph of convex sets: gap {history[-1].gap:.3g}"
        record = self._record(LIMIT if limited else FOUND, message, best[0], bound, began, tuple(history))
        return ContactEstimate(True, best[1], best[0], limited, "", record)

    def _record(
        self, status: str, message: str, cost: float, bound: float, began: float, history: tuple[Progress, ...]
    ) -> MixedIntegerRecord:
        elapsed = time.perf_counter() - began
        first = next((p.time for p in history if np.isfinite(p.cost)), np.nan)
        return MixedIntegerRecord("clarabel", status, message, None, cost, bound, 0.0, "", elapsed, first, history)

    def _paths(self, relaxed: object, options: object) -> list[list[Edge]]:
        """Paths drawn by the relaxation's flows."""
        options.max_rounded_paths = ROUNDED_PATHS
        with quiet():
            return self.graph.gcs.SamplePaths(self._start.vertex, self._goal, relaxed, options)

    def _restrict(self, path: list[Edge], options: object) -> tuple[float, tuple[Stance, ...]]:
        """The best steps along one path, and their cost; inf where there are none."""
        result = self.graph.gcs.SolveConvexRestriction(path, options)
        if not result.is_success():
            return np.inf, ()
        found = [self.query.start]
        for edge in path[:-1]:
            v = self._footholds[edge.v().name()]
            x = np.asarray(result.GetSolution(edge.v().x()), float)
            if not np.isfinite(x).all():
                return np.inf, ()
            p = v.P @ x + v.p
            if (v.placed.A @ p - v.placed.b).max() > ACCEPT:
                return np.inf, ()
            contact = v.placed.contact(p, v.placed.heading[0])
            held = found[-1].contacts[v.placed.effector]
            assert held is not None
            if np.linalg.norm(contact.p_WC - held.p_WC) < SAME_PLACE and contact.surface == held.surface:
                continue
            found.append(found[-1].replace(v.placed.effector, contact))
        return float(result.get_optimal_cost()), tuple(found)
