"""Two ROS 2 messages in one YAML file: trajectory_msgs/JointTrajectory and MultiDOFJointTrajectory of the base."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import yaml

from drakeplan.export.formats import ExportOptions, Product
from drakeplan.export.source import Source

NANO = 10**9
WORLD_FRAME = "world"


class _Dumper(yaml.CSafeDumper):
    """Writes a value that occurs twice twice; ROS knows no aliases."""

    def ignore_aliases(self, data: object) -> bool:
        return True


def export(source: Source, file: Path, options: ExportOptions) -> Product:
    """The messages of a plan, one YAML document each.

    Args:
        source: the plan.
        file: not used, the messages are one file.
        options: not used.
    """
    samples = source.map_samples
    stamps = [_since_start(t) for t in samples.t - samples.t[0]]
    rows = {
        "positions": samples.joint_position.tolist(),
        "velocities": samples.joint_velocity.tolist(),
        "accelerations": samples.joint_acceleration().tolist(),
        "effort": [[]] * len(stamps) if samples.joint_torque is None else samples.joint_torque.tolist(),
    }
    points = [
        {**{key: values[k] for key, values in rows.items()}, "time_from_start": stamp} for k, stamp in enumerate(stamps)
    ]
    w_dot, v_dot = samples.base_acceleration()
    poses = zip(samples.base_position.tolist(), samples.base_quaternion[:, [1, 2, 3, 0]].tolist(), strict=True)
    twists = zip(samples.base_linear_velocity.tolist(), samples.base_angular_velocity.tolist(), strict=True)
    rates = zip(v_dot.tolist(), w_dot.tolist(), strict=True)
    base_points = [
        {
            "transforms": [{"translation": _named(p, "xyz"), "rotation": _named(q, "xyzw")}],
            "velocities": [_twist(*twist)],
            "accelerations": [_twist(*rate)],
            "time_from_start": stamp,
        }
        for (p, q), twist, rate, stamp in zip(poses, twists, rates, stamps, strict=True)
    ]
    documents = [
        {"header": _header(), "joint_names": list(samples.joint_names), "points": points},
        {"header": _header(), "joint_names": [samples.base_name], "points": base_points},
    ]
    text = yaml.dump_all(
        documents,
        Dumper=_Dumper,
        default_flow_style=None,
        explicit_start=True,
        sort_keys=False,
        allow_unicode=True,
        width=100_000,
    )
    facts = {"points": len(points), "joints": len(samples.joint_names), "base": samples.base_name}
    return Product(text.encode(), facts=facts)


def _header() -> dict[str, object]:
    return {"stamp": {"sec": 0, "nanosec": 0}, "frame_id": WORLD_FRAME}


def _since_start(t: np.floating) -> dict[str, int]:
    sec, nanosec = divmod(round(float(t) * NANO), NANO)
    return {"sec": sec, "nanosec": nanosec}


def _named(values: list[float], names: str) -> dict[str, float]:
    return dict(zip(names, values, strict=True))


def _twist(linear: list[float], angular: list[float]) -> dict[str, object]:
    return {"linear": _named(linear, "xyz"), "angular": _named(angular, "xyz")}
