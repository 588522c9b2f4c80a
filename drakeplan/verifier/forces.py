"""Whether contact forces are admissible, bring about the momenta, and start and end at rest."""

from __future__ import annotations

import numpy as np

from .limits import (
    AT_REST,
    BALANCE,
    EFFECTORS,
    GRAVITY,
    MASS,
    RESIDUAL,
    WRENCH,
)
from .plan_file import PlanFile
from .report import Sheet, which_end
from .robot import RobotModel
from .wrenches import CONES, TRUE_CONE, corner_wrenches, distance_to_cones, wrench_distance


def check_forces(sheet: Sheet, plan: PlanFile) -> None:
    """Contact wrenches against what patches and friction admit.

    Args:
        sheet: takes the checks.
        plan: the plan file.
    """
    t, contact, force = plan["centroidal/t"], plan["centroidal/contact"], plan["centroidal/force_W"]
    weight = plan.mass * -GRAVITY[2]

    def at(index: tuple[int, ...]) -> str:
        return f"knot {index[0]}, t = {t[index[0]]:.3f} s, {EFFECTORS[index[1]]}"

    idle = np.where(contact < 0, np.abs(force).max(axis=2) + np.abs(plan["centroidal/torque_n"]), 0.0)
    sheet.add("no force without contact", idle / weight, 1e-9, "M g", at)
    last = [
        np.abs(plan[f"centroidal/{name}"][-1] - plan[f"centroidal/{name}"][-2]).max() for name in ("contact", "force_W")
    ]
    sheet.add("last row repeats", last, 1e-9, "", lambda i: ("contact", "force_W")[i[0]])
    knot, effector = np.nonzero(contact >= 0)
    which = contact[knot, effector]
    R_WC, friction = plan["contacts/X_WC"][which, :3, :3], plan["contacts/friction"][which]
    f_C = np.einsum("kji,kj->ki", R_WC, force[knot, effector]) / weight
    pull = np.zeros(contact.shape)
    pull[knot, effector] = -f_C[:, 2]
    sheet.add("unilateral", pull, 1e-9, "M g", at)
    cop, torque = plan["centroidal/cop_C"][knot, effector], plan["centroidal/torque_n"][knot, effector] / weight
    supports = [plan.support(c) for c in which]
    for name, cone in (("true", TRUE_CONE), ("named", CONES[plan.attributes["friction_cone"]])):
        distance = np.zeros(contact.shape)
        distance[knot, effector] = wrench_distance(cone, f_C, cop, torque, supports, friction)
        sheet.add(f"wrench in {name} cone", distance, WRENCH, "M g", at)
    share, inner = plan.reserve()
    distance = np.zeros(contact.shape)
    if min(share, inner) < 1.0:
        drawn_in = [corners.mean(axis=0) + inner * (corners - corners.mean(axis=0)) for corners in supports]
        distance[knot, effector] = wrench_distance(TRUE_CONE, f_C, cop, torque, drawn_in, share * friction)
    sheet.add("wrench within the reserve", distance, WRENCH, "M g", at)


def check_momentum(sheet: Sheet, plan: PlanFile, robot: RobotModel) -> None:
    """Newton's and Euler's equations between the knots; rest and balance at both ends.

    Args:
        sheet: takes the checks.
        plan: the plan file.
        robot: the robot's model.
    """
    sheet.add("mass", abs(plan.mass / robot.mass - 1), MASS, "", f"file {plan.mass:.6g} kg, model {robot.mass:.6g} kg")
    t, com, force = plan["centroidal/t"], plan["centroidal/com"], plan["centroidal/force_W"]
    momentum, spin = plan["centroidal/linear_momentum"], plan["centroidal/angular_momentum"]
    contact = plan["centroidal/contact"]
    weight, dt = plan.mass * -GRAVITY[2], np.diff(t)[:, None]

    def at(index: tuple[int, ...]) -> str:
        return f"knot {index[0]}, t = {t[index[0]]:.3f} s, {'xyz'[index[1]]}"

    # force_W[n] acts over [t_n, t_n+1); the moment is taken about com[n+1].
    newton = np.diff(momentum, axis=0) / dt - (force[:-1].sum(axis=1) + plan.mass * GRAVITY)
    sheet.add("newton", np.abs(newton) / weight, RESIDUAL, "M g", at)
    sheet.add("com integration", np.abs(np.diff(com, axis=0) - dt * momentum[1:] / plan.mass), RESIDUAL, "m", at)
    X_WC = plan["contacts/X_WC"][np.maximum(contact, 0)]
    cop = np.concatenate([plan["centroidal/cop_C"], np.zeros((*contact.shape, 1))], axis=2)
    p_cop = X_WC[..., :3, 3] + np.einsum("neij,nej->nei", X_WC[..., :3, :3], cop)
    moment = np.cross(p_cop[:-1] - com[1:, None], force[:-1])
    moment = moment + plan["centroidal/torque_n"][:-1, :, None] * X_WC[:-1, :, :3, 2]
    moment = np.where(contact[:-1, :, None] >= 0, moment, 0.0).sum(axis=1)
    sheet.add("euler", np.abs(np.diff(spin, axis=0) / dt - moment) / weight, RESIDUAL, "M g m", at)
    ends = np.stack([momentum[[0, -1]], spin[[0, -1]]]) / plan.mass
    sheet.add(
        "momentum at rest", np.abs(ends), AT_REST, "m/s", lambda i: f"{('linear', 'angular')[i[0]]}, {which_end(i[1])}"
    )
    balance = [_imbalance(plan, contact[n], com[n]) for n in (0, -1)]
    sheet.add("balance at rest", balance, BALANCE, "M g", lambda i: which_end(i[0]))


def _imbalance(plan: PlanFile, held: np.ndarray, com: np.ndarray) -> float:
    """Distance of the robot's weight from what these contacts can carry inside the true cone [M g]."""
    rows = [c for c in held if c >= 0]
    if not rows:
        return np.inf
    blocks = [
        corner_wrenches(
            plan["contacts/X_WC"][c], plan.support(c), TRUE_CONE.rays(float(plan["contacts/friction"][c])), com
        )
        for c in rows
    ]
    return float(distance_to_cones([np.hstack(blocks)], np.array([[0, 0, 1.0, 0, 0, 0]]))[0])
