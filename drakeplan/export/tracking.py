"""The reference motion that tracking pipelines of the Unitree G1 read: rows of numbers at a fixed rate, no head.

It is the layout of Unitree's retargeted LAFAN1 motions, which BeyondMimic's csv_to_npz reads: base position, base
quaternion with w last, joints.
"""

from __future__ import annotations

import io
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation, Slerp

from drakeplan.export.formats import ExportOptions, Product
from drakeplan.export.samples import MotionSamples
from drakeplan.export.source import Source, json_text
from drakeplan.plan.arrays import SAME_TIME


def export(source: Source, file: Path, options: ExportOptions) -> Product:
    """The rows of a plan, and a JSON file that says what they are.

    Args:
        source: the plan.
        file: of the rows; the other is called the same with .json added.
        options: the rate.
    """
    samples = source.samples
    rows = tracking_rows(samples, options.rate)
    text = io.StringIO()
    np.savetxt(text, rows, fmt="%.9g", delimiter=",")
    about = {
        "format": "drakeplan-tracking",
        "version": 1,
        "rate": options.rate,
        "rows": len(rows),
        "columns": ["base_x", "base_y", "base_z", "base_qx", "base_qy", "base_qz", "base_qw", *samples.joint_names],
        "joint_names": list(samples.joint_names),
        "units": "m, unit quaternion (x, y, z, w), rad; base in the world, z up, without origin_offset",
        **source.header(),
    }
    facts = {"rows": len(rows), "rate": options.rate, "joints": len(samples.joint_names)}
    return Product(text.getvalue().encode(), {f"{file.name}.json": json_text(about).encode()}, facts)


def tracking_rows(samples: MotionSamples, rate: int) -> np.ndarray:
    """(N, 7 + J) base position [m], base quaternion x, y, z, w, joints [rad] at t_0 + n / rate while the motion lasts.

    The base turns on the great circle between samples; all else is linear.

    Args:
        samples: of the motion.
        rate: rows per second [Hz].
    """
    start, end = samples.t[0], samples.t[-1]
    t = start + np.arange(int(np.floor((end - start) * rate + SAME_TIME * rate)) + 1) / rate
    t = np.minimum(t, end)
    xyzw = samples.base_quaternion[:, [1, 2, 3, 0]]
    turned = np.repeat(xyzw / np.linalg.norm(xyzw), len(t), axis=0)
    if len(samples.t) > 1:
        turned = Slerp(samples.t, Rotation.from_quat(xyzw))(t).as_quat()
    same_side = np.where((turned[1:] * turned[:-1]).sum(axis=1) < 0.0, -1.0, 1.0)
    turned *= np.concatenate([[1.0], np.cumprod(same_side)])[:, None]

    def linear(values: np.ndarray) -> np.ndarray:
        return np.stack([np.interp(t, samples.t, column) for column in values.T], axis=1)

    return np.hstack([linear(samples.base_position), turned, linear(samples.joint_position)])
