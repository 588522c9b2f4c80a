"""Steps from foothold to foothold as a graph of convex sets (Marcucci et al. 2024), one layer per step.

A vertex stands for "the i-th step goes to region r". Its point holds where that foot is set down, in the region's plane,
and where the other foot stands: x = (u (2), q (3)), p = o + X u. An edge from one step to the next passes the foot on,

    q_v = p_u,        p_v within reach of p_u,        cost a function of p_v - q_u, the translation of the moving foot,

so a walk through the layers is a sequence of steps and its cost the sum over the moving feet.

Marcucci, Umenberger, Parrilo, Tedrake 2024: "Shortest paths in graphs of convex sets", SIAM J. Optim. 34(1).
"""

# pydrake's stubs read "float64[m, 1]" as a shape and refuse every array.
# pyright: reportArgumentType=false, reportCallIssue=false, reportAttributeAccessIssue=false

from __future__ import annotations

import contextlib
import logging
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from pydrake.geometry.optimization import (
    GraphOfConvexSets,
    GraphOfConvexSetsOptions,
    HPolyhedron,
    Hyperellipsoid,
    Point,
)
from pydrake.solvers import (
    Binding,
    ClarabelSolver,
    CommonSolverOption,
    Constraint,
    Cost,
    L2NormCost,
    LinearConstraint,
    LinearCost,
    LinearEqualityConstraint,
    LorentzConeConstraint,
    QuadraticCost,
    SolverOptions,
)

from scenes.footholds.foothold_regions import FootholdRegion

Edge = GraphOfConvexSets.Edge


@dataclass(frozen=True, eq=False)
class Foothold:
    """A vertex: a foot set down in a region, or the start stance.

    Attributes:
        vertex: of the graph.
        region: None for the start.
        surface: index of the surface.
        P, p: the foot's point is P x + p [m], in W.
        Q, q: the other foot's point is Q x + q.
    """

    vertex: GraphOfConvexSets.Vertex
    region: FootholdRegion | None
    surface: int
    P: np.ndarray
    p: np.ndarray
    Q: np.ndarray
    q: np.ndarray

    @property
    def placed(self) -> FootholdRegion:
        """The region of a vertex that is not the start."""
        assert self.region is not None
        return self.region

    @property
    def mean(self) -> tuple[np.ndarray, np.ndarray]:
        """(2, d) and (2,): the mean of the feet in the plan view is A x + b."""
        return 0.5 * (self.P + self.Q)[:2], 0.5 * (self.p + self.q)[:2]

    @property
    def mean_height(self) -> tuple[np.ndarray, np.ndarray]:
        """(1, d) and (1,): the height of the mean of the feet is A x + b."""
        return 0.5 * (self.P + self.Q)[2:], 0.5 * (self.p + self.q)[2:]


class StepGraph:
    """Vertices and edges of steps; what is built from it decides costs and reach.

    Attributes:
        gcs: Drake's graph.
    """

    def __init__(self, low: np.ndarray, high: np.ndarray) -> None:
        """An empty graph; feet lie between low and high (3,) [m]."""
        self.gcs = GraphOfConvexSets()
        self._low, self._high = low, high

    def add_foothold(self, region: FootholdRegion, name: str) -> Foothold:
        """A vertex for a step to this region.

        Args:
            region: where the foot may stand.
            name: of the vertex.
        """
        origin = region.vertices[0]
        x = region.vertices[1] - origin
        x = x / np.linalg.norm(x)
        X = np.stack([x, np.cross(region.normal, x)], axis=1)
        edges = region.A @ X
        A = np.zeros((len(edges) + 6, 5))
        A[: len(edges), :2] = edges
        A[len(edges) :, 2:] = np.vstack([np.eye(3), -np.eye(3)])
        b = np.concatenate([region.b - region.A @ origin, self._high, -self._low])
        P, Q = np.zeros((3, 5)), np.zeros((3, 5))
        P[:, :2], Q[:, 2:] = X, np.eye(3)
        vertex = self.gcs.AddVertex(HPolyhedron(A, b), name)
        return Foothold(vertex, region, region.surface, P, origin, Q, np.zeros(3))

    def add_start(self, p: np.ndarray, q: np.ndarray, surface: int) -> Foothold:
        """The start as seen by the first step: p (3,) the foot that stands, q (3,) the foot that will move [m].

        Args:
            p: (3,) the foot that stands, in W [m].
            q: (3,) the foot that moves first, in W [m].
            surface: index of the surface that the foot p stands on.
        """
        P, Q = np.zeros((3, 6)), np.zeros((3, 6))
        P[:, :3], Q[:, 3:] = np.eye(3), np.eye(3)
        vertex = self.gcs.AddVertex(Point(np.concatenate([p, q])), "start")
        return Foothold(vertex, None, surface, P, np.zeros(3), Q, np.zeros(3))

    def add_goal(self, centre: np.ndarray, radius: float) -> GraphOfConvexSets.Vertex:
        """The goal: a disc of means of the feet, centre (2,) [m].

        Args:
            centre: (2,) in x and y of W [m].
            radius: [m].
        """
        return self.gcs.AddVertex(Hyperellipsoid.MakeHypersphere(radius, centre), "goal")

    def add_step(self, u: Foothold, v: Foothold) -> Edge:
        """An edge for the step from u to v, passing on the foot that stands: q_v = p_u.

        Args:
            u, v: consecutive footholds.
        """
        edge = self.gcs.AddEdge(u.vertex, v.vertex)
        A, b = np.hstack([v.Q, -u.P]), u.p - v.q
        edge.AddConstraint(Binding[Constraint](LinearEqualityConstraint(A, b), np.append(edge.xv(), edge.xu())))
        return edge

    def add_arrival(self, u: Foothold, goal: GraphOfConvexSets.Vertex) -> Edge:
        """An edge to the goal: the mean of the feet is the goal vertex's point.

        Args:
            u: last foothold.
            goal: vertex of the goal.
        """
        edge = self.gcs.AddEdge(u.vertex, goal)
        A, b = u.mean
        rows = np.hstack([A, -np.eye(2)])
        edge.AddConstraint(Binding[Constraint](LinearEqualityConstraint(rows, -b), np.append(edge.xu(), edge.xv())))
        return edge

    @staticmethod
    def apart(u: Foothold, v: Foothold) -> tuple[np.ndarray, np.ndarray]:
        """(3, dv + du), (3,): the vector from the standing foot to the new one, p_v - p_u, over (x_v, x_u).

        Args:
            u, v: consecutive footholds.
        """
        return np.hstack([v.P, -u.P]), v.p - u.p

    @staticmethod
    def travel(u: Foothold, v: Foothold) -> tuple[np.ndarray, np.ndarray]:
        """(3, dv + du), (3,): the translation of the moving foot, p_v - q_u, over (x_v, x_u).

        Args:
            u, v: consecutive footholds.
        """
        return np.hstack([v.P, -u.Q]), v.p - u.q

    @staticmethod
    def keep_within(edge: Edge, A: np.ndarray, b: np.ndarray, radius: float) -> None:
        """|A (x_v, x_u) + b| <= radius.

        Args:
            edge: from u to v.
            A: (m, dv + du) matrix.
            b: (m,) offset [m].
            radius: [m].
        """
        rows = np.vstack([np.zeros((1, A.shape[1])), A])
        cone = LorentzConeConstraint(rows, np.append(radius, b))
        edge.AddConstraint(Binding[Constraint](cone, np.append(edge.xv(), edge.xu())))

    @staticmethod
    def keep_between(edge: Edge, A: np.ndarray, b: np.ndarray, low: np.ndarray, high: np.ndarray) -> None:
        """low <= A (x_v, x_u) + b <= high.

        Args:
            edge: from u to v.
            A: (m, dv + du) matrix.
            b: (m,) offset [m].
            low, high: (m,) bounds [m].
        """
        rows = LinearConstraint(A, low - b, high - b)
        edge.AddConstraint(Binding[Constraint](rows, np.append(edge.xv(), edge.xu())))

    @staticmethod
    def add_length(edge: Edge, A: np.ndarray, b: np.ndarray) -> None:
        """Cost |A (x_v, x_u) + b|.

        Args:
            edge: from u to v.
            A: (m, dv + du) matrix.
            b: (m,) offset [m].
        """
        edge.AddCost(Binding[Cost](L2NormCost(A, b), np.append(edge.xv(), edge.xu())))

    @staticmethod
    def add_square(edge: Edge, weight: float, A: np.ndarray, b: np.ndarray) -> None:
        """Cost weight |A (x_v, x_u) + b|^2.

        Args:
            edge: from u to v.
            weight: of the square [1/m^2].
            A: (m, dv + du) matrix.
            b: (m,) offset [m].
        """
        cost = QuadraticCost(2 * weight * A.T @ A, 2 * weight * A.T @ b, weight * float(b @ b), True)
        edge.AddCost(Binding[Cost](cost, np.append(edge.xv(), edge.xu())))

    @staticmethod
    def add_constant(edge: Edge, value: float) -> None:
        """Cost of taking the edge at all.

        Args:
            edge: from u to v.
            value: cost.
        """
        edge.AddCost(Binding[Cost](LinearCost(np.zeros(len(edge.xu())), value), edge.xu()))


def could_step(u: Foothold, v: FootholdRegion, reach: float, rise: float) -> bool:
    """Whether some point of region v may be within reach [m] of some point of u, judged by their bounds.

    Args:
        u: foothold that stands.
        v: region to step to.
        reach: greatest horizontal distance [m].
        rise: greatest difference of height [m].
    """
    if u.region is None:
        low_u = high_u = u.vertex.set().x()[:3]
    else:
        low_u, high_u = u.region.vertices.min(axis=0), u.region.vertices.max(axis=0)
    low_v, high_v = v.vertices.min(axis=0), v.vertices.max(axis=0)
    gap = np.maximum(np.maximum(low_v - high_u, low_u - high_v), 0.0)
    return bool(np.hypot(gap[0], gap[1]) <= reach and gap[2] <= rise)


@contextlib.contextmanager
def quiet() -> Iterator[None]:
    """Inside, Drake's graph does not log every solve."""
    logger = logging.getLogger("drake")
    level = logger.level
    logger.setLevel(max(level, logging.WARNING))
    try:
        yield
    finally:
        logger.setLevel(level)


def graph_options(time_limit: float, seed: int, tolerance: float = 1e-7) -> GraphOfConvexSetsOptions:
    """The convex relaxation, by Clarabel on one thread, without rounding.

    Args:
        time_limit: of each convex program [s].
        seed: of the rounding.
        tolerance: relative and absolute gap of the solver.
    """
    options = GraphOfConvexSetsOptions()
    options.convex_relaxation, options.preprocessing, options.max_rounded_paths = True, False, 0
    options.rounding_seed, options.max_rounding_trials = seed, 200
    options.solver = options.restriction_solver = ClarabelSolver()
    settings, clarabel = SolverOptions(), ClarabelSolver().solver_id()
    settings.SetOption(CommonSolverOption.kMaxThreads, 1)
    for key, value in (
        ("time_limit", time_limit),
        ("tol_gap_rel", tolerance),
        ("tol_gap_abs", tolerance),
        ("tol_feas", 1e-8),
    ):
        settings.SetOption(clarabel, key, float(value))
    options.solver_options = settings
    return options
