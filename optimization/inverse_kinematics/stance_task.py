"""What a posture must hold, how far one falls short of it, and the step that brings it closer.

The terms are those of `optimization.inverse_kinematics.whole_body_ik`; nothing here chooses steps or starts.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit

from optimization.inverse_kinematics.ik_tasks import (
    StepProgram,
    add_diagonal,
    add_frame_task,
    add_inequality,
    add_row,
    clear_program,
    edge_normal,
    frame_error,
)
from optimization.multibody.body_capsules import BodyCapsules, CapsuleRows, close_pairs, distance_row, make_rows
from optimization.multibody.kinematic_tree import KinematicTree, center_of_mass, com_jacobian, forward, rotation_error

_MAX_CLOSE_PAIRS = 12  # pairs of body parts that a step looks at
_MAX_EDGES = 24  # edges of the polygon that a step looks at
_EDGE_NEAR = 0.03  # [m] the CoM is at most this far inside an edge that a step looks at
NEAR = 0.03  # [m] capsules closer than this beyond what they must keep take part
MAX_ROWS = _MAX_CLOSE_PAIRS + _MAX_EDGES  # inequality rows that `build_step` may add


class IkOptions(NamedTuple):
    """Tolerances, weights and limits; a weight of 1 belongs to a contact's position error in metres.

    Attributes:
        position_tolerance: of held contacts [m].
        angle_tolerance: of held contacts [rad].
        com_margin: how far inside the polygon the CoM must be [m].
        com_tolerance: distance allowed between the CoM and its target [m].
        penetration: how far capsules may come closer than they should [m].
        max_iterations: of one attempt.
        restarts: further attempts, from joints nearer the middle of their limits, then from a lower pelvis.
        angle_weight: of contacts' orientation [m/rad].
        posture_weight: of the joints' distance from nominal [m/rad].
        upright_weight: of the base's tilt and heading [m/rad].
        com_weight: of the CoM's polygon and target [-].
        distance_weight: of the capsules' distances [-].
    """

    position_tolerance: float = 1e-3
    angle_tolerance: float = 0.2 * np.pi / 180
    com_margin: float = 0.0
    com_tolerance: float = 2e-3
    penetration: float = 5e-3
    max_iterations: int = 30
    restarts: int = 0
    angle_weight: float = 0.3
    posture_weight: float = 0.02
    upright_weight: float = 0.05
    com_weight: float = 1.0
    distance_weight: float = 0.5


class WholeBodyModel(NamedTuple):
    """What the solver needs of a robot.

    Attributes:
        tree: its kinematics, the end effectors as named frames.
        capsules: its shape.
        q_nominal: (nq,) standing at the origin and facing x.
        hip: (3,) the left hip in the frame T of `Robot` [m].
        leg_length: hip to sole when nearly straight [m].
    """

    tree: KinematicTree
    capsules: BodyCapsules
    q_nominal: np.ndarray
    hip: np.ndarray
    leg_length: float


class StanceTask(NamedTuple):
    """What a posture must hold.

    Attributes:
        X_WE: (E, 4, 4) target poses [m].
        active: (E,) which of them are held.
        region: (V, 2) convex polygon for the CoM in x and y [m], counter-clockwise.
        num_vertices: how many of its vertices count; 0: the CoM may be anywhere.
        com_target: (3,) where the CoM should be [m], NaN where a coordinate is free.
    """

    X_WE: np.ndarray
    active: np.ndarray
    region: np.ndarray
    num_vertices: int
    com_target: np.ndarray


class Shortfall(NamedTuple):
    """How far a posture is from holding a task.

    Attributes:
        position: greatest position error of the active contacts [m].
        angle: greatest orientation error of them [rad].
        com_violation: CoM outside the polygon less its margin [m].
        com_error: CoM to its target [m].
        clearance: least distance of capsules beyond what they must keep [m], at most `NEAR`.
        unmet: weighted sum of the squares of all that.
        strain: the same of what is only preferred, the posture and an upright base.
    """

    position: float
    angle: float
    com_violation: float
    com_error: float
    clearance: float
    unmet: float
    strain: float


class MeasuredPosture(NamedTuple):
    """One configuration and all that the tasks measure on it.

    Attributes:
        q: (nq,) positions.
        R, p: (n, 3, 3) and (n, 3) poses of the links in W [m].
        com: (3,) centre of mass [m].
        error: (E, 6) what `frame_error` says of the active end effectors.
        turn: (3,) rotation vector from the base to upright [rad].
        rows: the close pairs of capsules.
    """

    q: np.ndarray
    R: np.ndarray
    p: np.ndarray
    com: np.ndarray
    error: np.ndarray
    turn: np.ndarray
    rows: CapsuleRows


@njit(cache=True)
def make_posture(model: WholeBodyModel) -> MeasuredPosture:
    """Room for one posture of this robot; its contents are undefined."""
    n = model.tree.parent.shape[0]
    return MeasuredPosture(
        np.empty(6 + n),
        np.empty((n, 3, 3)),
        np.empty((n, 3)),
        np.empty(3),
        np.zeros((model.tree.frame_link.shape[0], 6)),
        np.empty(3),
        make_rows(_MAX_CLOSE_PAIRS),
    )


@njit(cache=True)
def measure(
    model: WholeBodyModel, task: StanceTask, options: IkOptions, R_upright: np.ndarray, pose: MeasuredPosture
) -> tuple[Shortfall, int]:
    """Fills a pose from its q; returns its shortfall and the number of close pairs.

    Args:
        model: of the robot.
        task: what the posture must hold.
        options: weights and margins.
        R_upright: (3, 3) orientation preferred of the base, in W.
        pose: its q is read, the rest written.
    """
    tree, q = model.tree, pose.q
    forward(tree, q, pose.R, pose.p)
    center_of_mass(tree, pose.R, pose.p, pose.com)
    position, angle, unmet = 0.0, 0.0, 0.0
    for e in range(task.active.shape[0]):
        if task.active[e]:
            frame_error(tree, pose.R, pose.p, e, task.X_WE[e], pose.error[e])
            r = pose.error[e]
            turn2, move2 = r[0] * r[0] + r[1] * r[1] + r[2] * r[2], r[3] * r[3] + r[4] * r[4] + r[5] * r[5]
            position, angle = max(position, np.sqrt(move2)), max(angle, np.sqrt(turn2))
            unmet += move2 + options.angle_weight**2 * turn2
    violation, cost = _outside(task, options.com_margin, pose.com)
    com_error2 = 0.0
    for a in range(3):
        if not np.isnan(task.com_target[a]):
            com_error2 += (pose.com[a] - task.com_target[a]) ** 2
    unmet += options.com_weight**2 * (cost + com_error2)
    clearance = NEAR
    close = close_pairs(model.capsules, pose.R, pose.p, clearance, pose.rows)
    for k in range(close):
        gap = pose.rows.distance[k] - model.capsules.clearance[pose.rows.pair[k]]
        clearance = min(clearance, gap)
        unmet += options.distance_weight**2 * min(gap, 0.0) ** 2
    turn = rotation_error(pose.R[0], R_upright, pose.turn)
    strain = options.upright_weight**2 * turn * turn
    for j in range(7, q.shape[0]):
        strain += options.posture_weight**2 * (q[j] - model.q_nominal[j]) ** 2
    return Shortfall(position, angle, violation, np.sqrt(com_error2), clearance, unmet, strain), close


@njit(cache=True)
def _outside(task: StanceTask, margin: float, com: np.ndarray) -> tuple[float, float]:
    """How far the CoM is outside the polygon less its margin [m] (0 inside), and the sum of squares over its edges."""
    worst, cost = 0.0, 0.0
    normal = np.empty(2)
    for k in range(task.num_vertices):
        b = edge_normal(task.region, k, task.num_vertices, normal)
        v = normal[0] * com[0] + normal[1] * com[1] - b + margin
        if v > 0.0:
            worst = max(worst, v)
            cost += v * v
    return worst, cost


@njit(cache=True)
def is_held(shortfall: Shortfall, options: IkOptions) -> bool:
    """Whether a posture that falls short by this much counts as found. False for NaN.

    Args:
        shortfall: of a posture.
        options: tolerances.
    """
    return (
        shortfall.position <= options.position_tolerance
        and shortfall.angle <= options.angle_tolerance
        and shortfall.com_violation <= 1e-6
        and shortfall.com_error <= options.com_tolerance
        and shortfall.clearance >= -options.penetration
    )


@njit(cache=True)
def build_step(
    model: WholeBodyModel,
    task: StanceTask,
    options: IkOptions,
    pose: MeasuredPosture,
    close: int,
    damping: float,
    preference: float,
    J_com: np.ndarray,
    program: StepProgram,
) -> int:
    """Writes the quadratic program of one damped step; returns how many unknowns it has.

    Args:
        model: of the robot.
        task: what the posture must hold.
        options: weights and margins.
        pose: measured.
        close: number of close pairs in it.
        damping: added to the diagonal of H for the joints, a tenth of it for the base.
        preference: factor of what is only preferred, the posture and an upright base.
        J_com: (3, nv) scratch, the Jacobian of the CoM.
        program: written.
    """
    tree = model.tree
    nv = J_com.shape[1]
    clear_program(program)
    for e in range(task.active.shape[0]):
        if task.active[e]:
            add_frame_task(tree, pose.R, pose.p, e, pose.error[e], options.angle_weight, 1.0, program)
    com_jacobian(tree, pose.R, pose.p, pose.com, J_com)
    for a in range(3):
        if not np.isnan(task.com_target[a]):
            add_row(J_com[a], task.com_target[a] - pose.com[a], options.com_weight, program)
    num_rows = _add_edges(task, options, pose.com, J_com, program)
    row = np.empty(nv)
    for k in range(close):
        distance_row(tree, pose.R, pose.p, pose.rows, k, row)
        gap = pose.rows.distance[k] - model.capsules.clearance[pose.rows.pair[k]]
        num_rows = add_inequality(row, -gap, options.distance_weight, num_rows, program)
    for a in range(3):
        add_diagonal(a, pose.turn[a], preference * options.upright_weight, program)
        add_diagonal(a, 0.0, np.sqrt(0.1 * damping), program)
        add_diagonal(3 + a, 0.0, np.sqrt(0.1 * damping), program)
        program.lower[a], program.upper[a] = -np.inf, np.inf
        program.lower[3 + a], program.upper[3 + a] = -np.inf, np.inf
    for j in range(nv - 6):
        add_diagonal(6 + j, model.q_nominal[7 + j] - pose.q[7 + j], preference * options.posture_weight, program)
        add_diagonal(6 + j, 0.0, np.sqrt(damping), program)
        program.lower[6 + j] = tree.lower[j] - pose.q[7 + j]
        program.upper[6 + j] = tree.upper[j] - pose.q[7 + j]
    return nv + num_rows


@njit(cache=True)
def _add_edges(task: StanceTask, options: IkOptions, com: np.ndarray, J_com: np.ndarray, program: StepProgram) -> int:
    """Adds the polygon's edges that a step may reach, aimed a little inside; returns how many."""
    nv = J_com.shape[1]
    row, normal = np.empty(nv), np.empty(2)
    num_rows = 0
    for k in range(task.num_vertices):
        b = edge_normal(task.region, k, task.num_vertices, normal)
        room = b - options.com_margin - (normal[0] * com[0] + normal[1] * com[1])
        if room < _EDGE_NEAR and num_rows < _MAX_EDGES:
            for i in range(nv):
                row[i] = -normal[0] * J_com[0, i] - normal[1] * J_com[1, i]
            num_rows = add_inequality(row, 2e-3 - room, options.com_weight, num_rows, program)
    return num_rows
