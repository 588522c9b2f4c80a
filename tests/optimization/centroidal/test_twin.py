"""The centroidal program against a twin without any linearisation, written from the equations and solved by SNOPT."""

from dataclasses import replace

import numpy as np
import pytest
from pydrake.solvers import MathematicalProgram, QuadraticConstraint, SnoptSolver, SolverOptions

from optimization.centroidal.contact_schedule import ContactSchedule
from optimization.centroidal.options import CentroidalOptions, CentroidalWeights
from optimization.centroidal.problem import CentroidalProblem
from optimization.centroidal.program import CentroidalProgram
from optimization.convex.solver import worst_violation
from scenes.contact import Contact, contact_pose
from scenes.effector import EFFECTORS

MASS, G, DT = 76.0, 9.81, 0.2
WEIGHT = MASS * G
HALF = np.array([[0.11, 0.05], [0.11, 0.05], [0.05, 0.05], [0.05, 0.05]])
MU = 0.5
UNIT = 0.05  # [m]: moments are written in M g times this
HOLDS = 1e-5  # [units of the twin] that SNOPT may leave; it is asked for 1e-6
OPTIONS = CentroidalOptions(
    weights=CentroidalWeights(pressure_centre=0.0, torque=0.0),  # what is left is quadratic in the twin's variables
    com_height=(0.75, 0.9, 1.1),
    com_reach=(1.15, 1.15, 0.95, 0.95),
    force_limit=(2.0, 2.0, 0.5, 0.5),
    final_half_width=(0.15, 0.1, 0.12),
    rest_at_end=False,
)


def skew(a):
    return np.array([[0, -a[2], a[1]], [a[2], 0, -a[0]], [-a[1], a[0], 0]])


def transition(seed, palms):
    """The right foot steps forward over stones at up to 20 deg, starting with some velocity; palms on walls."""
    rng = np.random.default_rng(seed)
    u = rng.uniform

    def contact(e, point, normal):
        normal = np.asarray(normal) / np.linalg.norm(normal)
        return Contact(EFFECTORS[e], 0, contact_pose(EFFECTORS[e], np.array(point), normal, u(-0.2, 0.2)), MU)

    def stone(e, point):
        return contact(e, point, [*np.tan(u(-0.35, 0.35, 2)), 1.0])

    left, right = stone(0, [0.0, 0.1, 0.0]), stone(1, [u(-0.3, 0.3), u(-0.2, -0.08), u(-0.1, 0.1)])
    landed = stone(1, [u(0.0, 0.5), u(-0.22, -0.08), u(-0.12, 0.12)])
    hands = [
        contact(2 + i, [u(0.1, 0.5), side * u(0.4, 0.55), u(1.1, 1.5)], [u(-0.3, 0.3), -side, u(-0.3, 0.3)])
        if i < palms
        else None
        for i, side in enumerate((1, -1))
    ]
    rows = [(left, right, *hands)] * 5 + [(left, None, *hands)] * 5 + [(left, landed, *hands)]
    com = (left.p_WC + right.p_WC) / 2 + [u(-0.1, 0.1), u(-0.05, 0.05), 0.9 + u(-0.05, 0.05)]
    momentum = MASS * np.array([u(-0.1, 0.6), u(-0.3, 0.3), u(-0.05, 0.05)])
    return CentroidalProblem(ContactSchedule.from_rows(rows, DT), MASS, HALF, com, momentum)


def twin(data, limits, *, with_cost):
    """Variables com, v, k / (M g UNIT), kdot / (M g UNIT) at each knot and corner forces / (M g); hard limits."""
    w, schedule = OPTIONS.weights, data.schedule
    prog = MathematicalProgram()
    N = len(schedule.dt)
    com, v, k, rate = (prog.NewContinuousVariables(N, 3, name) for name in ("com", "v", "k", "rate"))
    unit = WEIGHT * UNIT
    for value, limit in zip((k, rate), limits, strict=True):
        prog.AddBoundingBoxConstraint(-limit / unit, limit / unit, value.ravel())
    for n in range(N):
        held = [schedule.contacts[i] for i in schedule.active[n] if i >= 0]
        force, moment = np.zeros((3, 0)), np.zeros((3, 0))
        corners = prog.NewContinuousVariables(12 * len(held), f"corners{n}")
        for i, c in enumerate(held):
            e = EFFECTORS.index(c.effector)
            mine = corners[12 * i : 12 * (i + 1)]
            for j, (sx, sy) in enumerate(((1, 1), (1, -1), (-1, 1), (-1, -1))):
                angle = np.pi / 8 + np.arange(8) * np.pi / 4
                faces = np.stack([np.cos(angle), np.sin(angle), np.full(8, -MU * np.cos(np.pi / 8))], axis=1)
                prog.AddLinearConstraint(faces, np.full(8, -np.inf), np.zeros(8), mine[3 * j : 3 * j + 3])
                p = c.p_WC + c.R_WC @ [sx * HALF[e, 0], sy * HALF[e, 1], 0]
                force, moment = np.hstack([force, c.R_WC]), np.hstack([moment, skew(p) @ c.R_WC])
            total = np.tile(np.eye(3), 4)
            prog.AddLinearConstraint(total[2:], [-np.inf], [OPTIONS.force_limit[e]], mine)
            if with_cost:
                root = np.sqrt([[w.force + w.lateral_force], [w.force + w.lateral_force], [w.force]])
                prog.Add2NormSquaredCost(root * total, np.zeros(3), mine)
        # value[n] - value[n-1] = A y + b
        for value, initial, A, b, y in (
            (v, data.initial_linear_momentum / MASS, DT * G * force, np.array([0, 0, -DT * G]), corners),
            (com, data.initial_com, DT * np.eye(3), np.zeros(3), v[n]),
            (k, np.zeros(3), DT * np.eye(3), np.zeros(3), rate[n]),
        ):
            if n == 0:
                prog.AddLinearEqualityConstraint(np.hstack([np.eye(3), -A]), b + initial, [*value[n], *y])
            else:
                row = np.hstack([np.eye(3), -np.eye(3), -A])
                prog.AddLinearEqualityConstraint(row, b, [*value[n], *value[n - 1], *y])
        for axis in range(3):  # UNIT rate = sum p x f - com x sum f
            b, c = (axis + 1) % 3, (axis + 2) % 3
            variables = np.concatenate([[rate[n, axis], com[n, b], com[n, c]], corners])
            Q, linear = np.zeros((len(variables),) * 2), np.concatenate([[UNIT, 0, 0], -moment[axis]])
            Q[1, 3:] = Q[3:, 1] = force[c]
            Q[2, 3:] = Q[3:, 2] = -force[b]
            prog.AddConstraint(QuadraticConstraint(Q, linear, 0.0, 0.0), variables)
        ground = np.mean([c.p_WC[2] for c in held if c.effector.endswith("foot")])
        prog.AddBoundingBoxConstraint(ground + 0.75, ground + 1.1, com[n, 2])
        after = [schedule.contacts[i] for i in schedule.active[min(n + 1, N - 1)] if i >= 0]
        for c in {*held, *after}:
            reach = OPTIONS.com_reach[EFFECTORS.index(c.effector)]
            ball = QuadraticConstraint(2 * np.eye(3), -2 * c.p_WC, -np.inf, reach**2 - c.p_WC @ c.p_WC)
            prog.AddConstraint(ball, com[n])
        if with_cost:
            for weight, value in (
                (w.linear_momentum * MASS**2, v[n]),
                (w.angular_momentum * unit**2, k[n]),
                (w.angular_momentum_rate * unit**2, rate[n]),
            ):
                prog.AddQuadraticErrorCost(weight * np.eye(3), np.zeros(3), value)
            root = np.sqrt(w.linear_momentum_rate) * WEIGHT
            prog.Add2NormSquaredCost(root * force, root * np.array([0, 0, 1.0]), corners)
    box = np.mean([c.p_WC for c in held if c.effector.endswith("foot")], axis=0)
    box[2] += 0.9
    prog.AddBoundingBoxConstraint(box - OPTIONS.final_half_width, box + OPTIONS.final_half_width, com[-1])
    start = np.zeros(prog.num_vars())
    start[prog.FindDecisionVariableIndices(com.ravel())] = np.linspace(data.initial_com, box, N).ravel()
    return prog, start


def snopt(prog, start):
    options = SolverOptions()
    for key, value in (("Major iterations limit", 300), ("Superbasics limit", 2000), ("Time limit", 20)):
        options.SetOption(SnoptSolver.id(), key, value)
    x = SnoptSolver().Solve(prog, start, options).get_x_val()
    return worst_violation(prog, x)[0], sum(prog.EvalBinding(cost, x).item() for cost in prog.GetAllCosts())


def solve(data, limits):
    k_limit, rate_limit = ((limit,) * 3 for limit in limits)
    options = replace(OPTIONS, angular_momentum_limit=k_limit, angular_momentum_rate_limit=rate_limit, tolerance=1e-5)
    return CentroidalProgram(data, options).solve()


@pytest.mark.parametrize(("seed", "palms"), [(0, 0), pytest.param(1, 1, marks=pytest.mark.slow)])
def test_snopt_finds_nothing_cheaper(seed, palms):
    data, limits = transition(seed, palms), (30.0, 60.0)
    ours = solve(data, limits)
    violation, cost = snopt(*twin(data, limits, with_cost=True))
    assert ours.feasible, ours.reason
    assert violation < HOLDS
    assert 0.99 * cost < ours.cost < 1.001 * cost  # SNOPT stops up to half a percent above


@pytest.mark.slow
@pytest.mark.parametrize("palms", [0, 1])
def test_snopt_finds_no_trajectory_where_there_is_said_to_be_none(palms):
    limits, infeasible = (4.0, 8.0), 0
    for seed in range(30):
        data = transition(seed, palms)
        if not solve(data, limits).feasible:
            infeasible += 1
            violation, _ = snopt(*twin(data, limits, with_cost=False))
            assert violation > HOLDS, seed
    assert 2 <= infeasible <= 20
