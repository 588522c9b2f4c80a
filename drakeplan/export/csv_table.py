"""One CSV table of the whole motion; lines that begin with # say units, frames and orders."""

from __future__ import annotations

import csv
import io
import json
from pathlib import Path

import numpy as np

from drakeplan.export.formats import ExportOptions, Product
from drakeplan.export.samples import MotionSamples
from drakeplan.export.source import Source

XYZ, WXYZ = ("x", "y", "z"), ("w", "x", "y", "z")


def export(source: Source, file: Path, options: ExportOptions) -> Product:
    """The table of a plan.

    Args:
        source: the plan.
        file: not used, the table is one file.
        options: not used.
    """
    samples = source.map_samples
    columns = table_columns(samples, source.plan.effectors)
    text = io.StringIO()
    text.writelines(f"# {line}\n" for line in _head(source, samples))
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(columns)
    writer.writerows(zip(*(column.tolist() for column in columns.values()), strict=True))
    return Product(text.getvalue().encode(), facts={"rows": len(samples.t), "columns": len(columns)})


def table_columns(samples: MotionSamples, effectors: tuple[str, ...]) -> dict[str, np.ndarray]:
    """Name -> (T,) values of every column, in order.

    Args:
        samples: of the motion.
        effectors: their names.
    """
    columns: dict[str, np.ndarray] = {"t": samples.t}

    def add(names: list[str], values: np.ndarray) -> None:
        columns.update(zip(names, values.T, strict=True))

    joints = samples.joint_names
    add([f"base_{k}" for k in XYZ], samples.base_position)
    add([f"base_q{k}" for k in WXYZ], samples.base_quaternion)
    add([f"q.{name}" for name in joints], samples.joint_position)
    add([f"base_v{k}" for k in XYZ], samples.base_linear_velocity)
    add([f"base_w{k}" for k in XYZ], samples.base_angular_velocity)
    add([f"v.{name}" for name in joints], samples.joint_velocity)
    if samples.joint_torque is not None:
        add([f"tau.{name}" for name in joints], samples.joint_torque)
    add([f"com_{k}" for k in XYZ], samples.com)
    add([f"linear_momentum_{k}" for k in XYZ], samples.linear_momentum)
    add([f"angular_momentum_{k}" for k in XYZ], samples.angular_momentum)
    for e, name in enumerate(effectors):
        columns[f"{name}.contact"] = (samples.contact[:, e] >= 0).astype(int)
        add([f"{name}.f{k}" for k in XYZ], samples.force[:, e])
        add([f"{name}.cop_{k}" for k in XYZ], samples.cop[:, e])
        columns[f"{name}.torque_n"] = samples.torque_n[:, e]
    return columns


def _head(source: Source, samples: MotionSamples) -> list[str]:
    plan, names = source.plan, json.dumps
    return [
        "drakeplan csv, version 1",
        f"robot: {names(plan.robot)}, mass {plan.mass:.9g} kg, model sha256 {names(plan.robot_model_sha256)}",
        f"scene: {names(plan.scene_name)}, friction cone: {names(plan.friction_cone)}",
        f"frame: world W, z up; origin_offset of the scene, added to every point: {source.offset.tolist()} m",
        "units: s, m, rad, kg, N; quaternions w x y z of the base in W",
        "base_x, base_q, base_v, base_w: position, orientation, linear and angular velocity of the base, all in W",
        f"q, v, tau: joints in the order of Drake's positions [rad, rad/s, N m]: {names(samples.joint_names)}",
        "tau acts from its row to the next; com and momenta are linear between the plan's knots, angular about the com, in W",
        f"end effectors in order: {', '.join(plan.effectors)}; contact is 1 where one may carry load",
        "f: force on the robot in W; cop: centre of pressure in W, nan without contact; torque_n: torque on the robot about the "
        "contact's normal there; all three act from one knot of the plan to the next (zero-order hold)",
    ]
