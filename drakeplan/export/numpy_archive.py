"""The arrays of a plan by name in one NumPy archive, without pickled objects."""

from __future__ import annotations

import io
import json
from pathlib import Path

import numpy as np

from drakeplan.export.formats import ExportOptions, Product
from drakeplan.export.source import Source

UNITS = {
    "t": "s; (T,) instants of the motion",
    "base_position": "m; (T, 3) in W",
    "base_quaternion": "(T, 4) w x y z of the base in W",
    "base_linear_velocity": "m/s; (T, 3) in W",
    "base_angular_velocity": "rad/s; (T, 3) in W",
    "joint_position": "rad, m; (T, J) in the order of joint_names, Drake's order of positions",
    "joint_velocity": "rad/s, m/s; (T, J)",
    "joint_torque": "N m, N; (T, J), from each sample to the next; absent where the plan has no torques",
    "joint_names": "(J,) text",
    "com": "m; (T, 3) in W, linear between the plan's knots",
    "linear_momentum": "kg m/s; (T, 3) in W",
    "angular_momentum": "kg m^2/s; (T, 3) about the centre of mass in W",
    "effectors": "(E,) text",
    "contact": "(T, E) row of the contacts, -1 without; held from knot to knot, as forces are",
    "force": "N; (T, E, 3) on the robot in W",
    "cop": "m; (T, E, 3) centre of pressure in W, NaN without contact",
    "cop_C": "m; (T, E, 2) the same in the contact's frame",
    "torque_n": "N m; (T, E) on the robot about the contact's normal at the centre of pressure",
    "half_extent": "m; (E, 2) half length and half width of each patch",
    "contact_X_WC": "m; (C, 4, 4) pose of each contact's frame in W, z along its normal",
    "contact_effector": "(C,) index into effectors",
    "contact_friction": "(C,) Coulomb coefficient",
}
OF_SAMPLES = ("t", "base_position", "base_quaternion", "base_linear_velocity", "base_angular_velocity", "joint_position",
              "joint_velocity", "joint_torque", "com", "linear_momentum", "angular_momentum", "contact", "force", "cop",
              "cop_C", "torque_n")  # fmt: skip


def export(source: Source, file: Path, options: ExportOptions) -> Product:
    """The archive of a plan.

    Args:
        source: the plan.
        file: not used, the archive is one file.
        options: not used.
    """
    plan, samples = source.plan, source.map_samples
    X_WC = np.array(plan.contacts.X_WC)
    X_WC[:, :3, 3] += source.offset
    arrays = {name: getattr(samples, name) for name in OF_SAMPLES}
    arrays |= {
        "joint_names": np.array(samples.joint_names, dtype=str),
        "effectors": np.array(plan.effectors, dtype=str),
        "half_extent": plan.half_extent,
        "contact_X_WC": X_WC,
        "contact_effector": plan.contacts.effector,
        "contact_friction": plan.contacts.friction,
    }
    arrays = {name: value for name, value in arrays.items() if value is not None}
    header = {"format": "drakeplan-npz", "version": 1, **source.header(), "arrays": {n: UNITS[n] for n in arrays}}
    return Product(
        archive_bytes({**arrays, "header": np.array(json.dumps(header))}),
        facts={"rows": len(samples.t), "arrays": len(arrays) + 1},
    )


def archive_bytes(arrays: dict[str, np.ndarray]) -> bytes:
    """A NumPy archive in memory; NumPy dates its members 1980, so the same arrays give the same bytes."""
    image = io.BytesIO()
    np.savez(image, allow_pickle=False, **arrays)  # pyright: ignore[reportArgumentType]
    return image.getvalue()
