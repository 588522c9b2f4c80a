"""The contact sequence as JSON, with the fields of multicontact-api's ContactSequence and ContactPhase.

A plan of contacts only has one phase for each stance, without times and trajectories (null).
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from drakeplan.export.formats import ExportOptions, Product
from drakeplan.export.source import Source, json_text
from drakeplan.plan.arrays import SAME_TIME, last_before
from drakeplan.plan.plan import Plan, PlanCentroidal

ABOUT = {
    "units": "s, m, kg, N, N m; friction without unit",
    "frames": "W is the world, z up; C is a contact's frame: z along the contact's normal, x forward",
    "placement": "pose of C in W: translation, rotation by rows, quaternion x y z w",
    "half_extent": "half length (x) and half width (y) of the patch in C; contact_points_positions are the corners of what of "
    "it rests on something, in C",
    "c, dc, L": "centre of mass, its velocity, angular momentum about it, in W; _init and _final at both ends of the phase",
    "c_t, dc_t, L_t": "the same over time; linear between samples",
    "contact_forces": "value[n] acts from t[n] to t[n+1]: force on the robot in W, and the wrench at the origin of C in C "
    "(force, then torque)",
}


def export(source: Source, file: Path, options: ExportOptions) -> Product:
    """The phases of a plan.

    Args:
        source: the plan, complete or of contacts only.
        file: not used, the sequence is one file.
        options: not used.
    """
    plan = source.plan
    if plan.phases is None or plan.centroidal is None:
        spans: list[tuple[float, float] | None] = [None] * len(plan.stances)
        held = plan.stances
    else:
        spans = list(zip(plan.phases.start.tolist(), plan.phases.end.tolist(), strict=True))
        held = plan.phases.contact
    phases = [_phase(plan, source.offset, row, span) for row, span in zip(held, spans, strict=True)]
    document = {
        "format": "drakeplan-contacts",
        "version": 1,
        "about": ABOUT,
        **source.header(),
        "contact_phases": phases,
    }
    return Product(json_text(document).encode(), facts={"phases": len(phases), "contacts": len(plan.contacts)})


def _phase(plan: Plan, offset: np.ndarray, held: np.ndarray, span: tuple[float, float] | None) -> dict[str, object]:
    names = [name for name, contact in zip(plan.effectors, held, strict=True) if contact >= 0]
    phase: dict[str, object] = {
        "timeInitial": None if span is None else span[0],
        "timeFinal": None if span is None else span[1],
        "effectors_in_contact": names,
        "contact_patches": {plan.effectors[e]: _patch(plan, offset, int(held[e])) for e in np.flatnonzero(held >= 0)},
    }
    if span is None or plan.centroidal is None:
        return phase
    course = plan.centroidal
    t = times_within(course.t, *span)
    linear, angular = course.momenta_at(t)
    over_time = {"c": course.com_at(t) + offset, "dc": linear / plan.mass, "L": angular}
    for name, value in over_time.items():
        phase[f"{name}_init"], phase[f"{name}_final"] = value[0].tolist(), value[-1].tolist()
    for name, value in over_time.items():
        phase[f"{name}_t"] = {"t": t.tolist(), "value": value.tolist()}
    phase["contact_forces"] = {
        plan.effectors[e]: _forces(plan, course, t, int(e), int(held[e])) for e in np.flatnonzero(held >= 0)
    }
    return phase


def times_within(t: np.ndarray, start: float, end: float) -> np.ndarray:
    """Both ends of a span and the knots between them [s].

    Args:
        t: (N,) knots [s].
        start: of the span [s].
        end: of the span [s].
    """
    inside = t[(t > start + SAME_TIME) & (t < end - SAME_TIME)]
    return np.array([start, *inside, end])


def _patch(plan: Plan, offset: np.ndarray, contact: int) -> dict[str, object]:
    from scipy.spatial.transform import Rotation

    table = plan.contacts
    X_WC, half = table.X_WC[contact], plan.half_extent[table.effector[contact]]
    corners = table.corners(contact)
    mu = float(table.friction[contact])
    return {
        "placement": {
            "translation": (X_WC[:3, 3] + offset).tolist(),
            "rotation": X_WC[:3, :3].tolist(),
            "quaternion": Rotation.from_matrix(X_WC[:3, :3]).as_quat(canonical=True).tolist(),
        },
        "friction": mu,
        "surface": int(table.surface[contact]),
        "contact_model": {
            "contact_type": "CONTACT_PLANAR",
            "mu": mu,
            "half_extent": half.tolist(),
            "num_contact_points": len(corners),
            "contact_points_positions": [[x, y, 0.0] for x, y in corners.tolist()],
        },
    }


def _forces(plan: Plan, course: PlanCentroidal, t: np.ndarray, e: int, contact: int) -> dict[str, object]:
    """Forces of an end effector at the times of a phase; the last repeats the one before, which acts until then."""
    knot = last_before(course.t, t)
    knot[-1] = knot[-2]
    carries = (course.contact[knot, e] == contact)[:, None]
    R_WC = plan.contacts.X_WC[contact, :3, :3]
    force_W = np.where(carries, course.force_W[knot, e], 0.0)
    force_C, cop = force_W @ R_WC, np.where(carries, course.cop_C[knot, e], 0.0)
    torque_C = np.cross(np.column_stack([cop, np.zeros(len(t))]), force_C)
    torque_C[:, 2] += np.where(carries[:, 0], course.torque_n[knot, e], 0.0)
    return {
        "t": t.tolist(),
        "force_W": force_W.tolist(),
        "wrench_C": np.hstack([force_C, torque_C]).tolist(),
        "cop_C": cop.tolist(),
    }
