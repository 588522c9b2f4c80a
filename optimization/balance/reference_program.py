"""Static equilibrium as a Drake program: the checked twin of `static_equilibrium`, which is what planners call.

It shares nothing with the compiled simplex but the meaning of the friction cones, and uses their faces where that uses
their edges.

Bretl & Lall 2008: "Testing static equilibrium for legged robots", IEEE T-RO 24(4).
Lin 2020: "Learning for Humanoid Multi-Contact Navigation Planning", sec. 3.3.
"""

# pydrake's stubs read "float64[m, 1]" as a shape and refuse every array.
# pyright: reportArgumentType=false, reportCallIssue=false, reportAttributeAccessIssue=false, reportReturnType=false, reportOperatorIssue=false

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from pydrake.solvers import ClpSolver, MathematicalProgram, SolutionResult

from optimization.balance.friction import DEFAULT_CONE, FrictionCone, cone_rows
from optimization.convex.solver import worst_violation
from scenes.contact import Contact, support_corners
from scenes.effector import EFFECTORS

if TYPE_CHECKING:
    from scenes.robots.robot import Robot

ACCEPT = 1e-7  # Clp's own feasibility tolerance [M g, M g m]; an answer that violates a row by more is none


class StaticEquilibriumProgram:
    """Holds a robot at rest by the forces at the corners of its supports.

        max   d . com                                                where the robot can lean (`farthest` only)
        s.t.  sum_ck R_c f_ck = e_z                                  newton
              sum_ck (p_c + R_c s_ck) x R_c f_ck = (com_y, -com_x, 0)   euler
              cone_rows_c f_ck <= 0                                  friction cone, no pulling
              sum_k e_z . f_ck <= limit_c                            force limit

    Decision variables: f (C, V, 3), force of contact c at its corner k in the contact frame [M g]; com (2,), the centre
    of mass seen from above [m], measured from `origin`. s_ck are the V corners of the support. For `second_order` the cone
    is the 16-gon inscribed in the true one.

    Attributes:
        prog: the program; constraints may be added to it.
        f: (C, V, 3) variables.
        com: (2,) variables.
        origin: (3,) mean of the contact points in W [m].
    """

    def __init__(self, contacts: Sequence[Contact], robot: Robot, cone: FrictionCone = DEFAULT_CONE) -> None:
        """Builds the program.

        Raises:
            InputError: no friction cone has this name.
            ValueError: no contact.
        """
        if not contacts:
            raise ValueError("a robot without contacts has no equilibrium to compute")
        self.contacts = tuple(contacts)
        self.origin = np.mean([c.p_WC for c in contacts], axis=0)
        self.prog = MathematicalProgram()
        self._corners = support_corners(contacts, np.array([e.half_extent for e in robot.effectors]))
        num_corners = self._corners.shape[1]
        self.f = np.array([self.prog.NewContinuousVariables(num_corners, 3, f"f_{c.effector}") for c in contacts])
        self.com = self.prog.NewContinuousVariables(2, "com")
        self._add_newton_euler()
        self._add_friction_cones(cone)
        self._add_force_limits(robot)
        self._com_bounds = self.prog.AddBoundingBoxConstraint(-np.inf, np.inf, self.com)
        self._com_bounds.evaluator().set_description("com")
        self._lean = self.prog.AddLinearCost(np.zeros(2), 0.0, self.com)

    def _add_newton_euler(self) -> None:
        blocks = []
        for contact, corners in zip(self.contacts, self._corners, strict=True):
            for corner in corners:
                p = contact.p_WC - self.origin + contact.R_WC[:, :2] @ corner
                moment = np.array([[0, -p[2], p[1]], [p[2], 0, -p[0]], [-p[1], p[0], 0]]) @ contact.R_WC
                blocks.append(np.vstack([contact.R_WC, moment]))
        com = np.zeros((6, 2))
        com[3, 1], com[4, 0] = -1.0, 1.0
        rows = np.hstack([*blocks, com])
        variables = np.concatenate([self.f.ravel(), self.com])
        newton = self.prog.AddLinearEqualityConstraint(rows[:3], np.array([0.0, 0.0, 1.0]), variables)
        newton.evaluator().set_description("newton")
        euler = self.prog.AddLinearEqualityConstraint(rows[3:], np.zeros(3), variables)
        euler.evaluator().set_description("euler")

    def _add_friction_cones(self, cone: FrictionCone) -> None:
        for contact, f in zip(self.contacts, self.f, strict=True):
            rows = cone_rows(cone, contact.friction)
            for k in range(len(f)):
                binding = self.prog.AddLinearConstraint(rows, np.full(len(rows), -np.inf), np.zeros(len(rows)), f[k])
                binding.evaluator().set_description(f"friction cone {contact.effector} corner {k}")

    def _add_force_limits(self, robot: Robot) -> None:
        for contact, f in zip(self.contacts, self.f, strict=True):
            limit = robot.force_limit[EFFECTORS.index(contact.effector)]
            binding = self.prog.AddLinearConstraint(np.ones((1, len(f))), [-np.inf], [limit], f[:, 2])
            binding.evaluator().set_description(f"force limit {contact.effector}")

    def is_balanced(self, com_xy: np.ndarray) -> bool:
        """Whether the robot can rest with its centre of mass over `com_xy` (2,) [m] in W."""
        self._lean.evaluator().UpdateCoefficients(np.zeros(2), 0.0)
        return self._solve(np.asarray(com_xy, float) - self.origin[:2]) is not None

    def farthest(self, direction: np.ndarray) -> np.ndarray | None:
        """The (2,) point [m] in W farthest along `direction` (2,) over which the robot can rest, None if nowhere."""
        self._lean.evaluator().UpdateCoefficients(-np.asarray(direction, float), 0.0)
        com = self._solve(None)
        return None if com is None else com + self.origin[:2]

    def _solve(self, com_xy: np.ndarray | None) -> np.ndarray | None:
        """The (2,) com of an optimum with the com held at `com_xy`, or free; None when there is none."""
        low, high = (np.full(2, -np.inf), np.full(2, np.inf)) if com_xy is None else (com_xy, com_xy)
        self._com_bounds.evaluator().set_bounds(low, high)
        if not self._is_finite() or (com_xy is not None and not np.isfinite(com_xy).all()):
            raise ValueError("static equilibrium: a contact, a limit or the centre of mass is not finite")
        result = ClpSolver().Solve(self.prog)
        x = result.get_x_val()
        if result.get_solution_result() != SolutionResult.kSolutionFound or not np.isfinite(x).all():
            return None
        worst, _ = worst_violation(self.prog, x)
        return result.GetSolution(self.com) if worst <= ACCEPT else None

    def _is_finite(self) -> bool:
        linear = [*self.prog.linear_equality_constraints(), *self.prog.linear_constraints()]
        matrices = [b.evaluator().GetDenseA() for b in linear] + [b.evaluator().a() for b in self.prog.linear_costs()]
        return all(np.isfinite(m).all() for m in matrices)
