"""How much of its friction each contact force uses."""

from __future__ import annotations

import numpy as np

from drakeplan.plan.plan import Plan


def friction_used(plan: Plan) -> np.ndarray:
    """(N, E) |tangential force| / (friction * normal force): 0 along the normal, 1 on the edge of the true (round) cone.

    0 where an end effector carries nothing; infinite where a force has no normal part, or pulls. The plan's own cone, an octagon in
    the round one by default, is left at 0.92 to 1. Torque about the normal takes its share too and is not counted.
    """
    assert plan.centroidal is not None
    contact = plan.centroidal.contact
    held = contact >= 0
    X_WC = plan.contacts.X_WC[np.where(held, contact, 0)] if len(plan.contacts) else np.zeros((*contact.shape, 4, 4))
    f_C = np.einsum("neji,nej->nei", X_WC[..., :3, :3], plan.centroidal.force_W)
    tangential = np.hypot(f_C[..., 0], f_C[..., 1])
    mu = plan.contacts.friction[np.where(held, contact, 0)] if len(plan.contacts) else np.zeros(contact.shape)
    allowed = mu * np.maximum(f_C[..., 2], 0.0)
    with np.errstate(divide="ignore", invalid="ignore"):
        share = np.where(tangential > 0.0, tangential / allowed, 0.0)
    return np.where(held, share, 0.0)
