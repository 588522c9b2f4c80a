"""A plan with what exporters read of it, each made once."""

from __future__ import annotations

import json
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np

from drakeplan.export.samples import MotionSamples, sample_motion
from drakeplan.plan.plan import Plan, PlanCentroidal, PlanMotion, PlanPhases
from scenes.files.scene_file import scene_from_yaml
from scenes.input_error import InputError
from scenes.robots.robot import Robot
from scenes.scene import Scene


@dataclass(frozen=True, eq=False)
class Source:
    """A plan on its way to another format.

    Attributes:
        plan: what is exported.
        robot: its robot, None where the format does not ask for it.
    """

    plan: Plan
    robot: Robot | None = None

    @property
    def parts(self) -> tuple[PlanPhases, PlanCentroidal, PlanMotion]:
        """Phases, centroidal trajectory and motion of a complete plan."""
        plan = self.plan
        if plan.phases is None or plan.centroidal is None or plan.motion is None or not len(plan.motion):
            raise InputError("a plan without a motion")
        return plan.phases, plan.centroidal, plan.motion

    @property
    def model(self) -> Path:
        """The robot's model file."""
        assert self.robot is not None, "the format does not say that it needs the robot"
        return self.robot.model

    @cached_property
    def samples(self) -> MotionSamples:
        """Everything at the motion's samples, in W without the offset of a georeferenced scene."""
        return sample_motion(self.plan)

    @cached_property
    def scene(self) -> Scene:
        """The scene as planned, with its meshes."""
        plan = self.plan
        return scene_from_yaml(plan.scene_yaml, f"plan of {plan.scene_name}", mesh_triangles=plan.triangles)

    @cached_property
    def offset(self) -> np.ndarray:
        """(3,) what was subtracted from the coordinates of a georeferenced scene [m]; zeros where nothing was."""
        return np.array(self.scene.origin_offset or (0.0, 0.0, 0.0))

    @cached_property
    def map_samples(self) -> MotionSamples:
        """`samples` with the offset of a georeferenced scene added again."""
        return self.samples.moved(self.offset)

    def header(self) -> dict[str, object]:
        """What every format says of the plan."""
        plan = self.plan
        return {
            "robot": plan.robot,
            "robot_model_sha256": plan.robot_model_sha256,
            "mass": plan.mass,
            "scene": plan.scene_name,
            "status": plan.status,
            "friction_cone": plan.friction_cone,
            "effectors": list(plan.effectors),
            "origin_offset": self.offset.tolist(),
        }


def json_text(value: object) -> str:
    """JSON with one key a line, lists of numbers on one line; numbers come back bit by bit.

    Args:
        value: of dicts, lists, texts, finite numbers and None.
    """
    return _json(value, "") + "\n"


def _json(value: object, indent: str) -> str:
    inner = indent + " "
    if isinstance(value, dict) and value:
        rows = [f"{inner}{json.dumps(str(k), ensure_ascii=False)}: {_json(v, inner)}" for k, v in value.items()]
        return "{\n" + ",\n".join(rows) + f"\n{indent}}}"
    if isinstance(value, list) and any(isinstance(v, dict) for v in value):
        return "[\n" + ",\n".join(inner + _json(v, inner) for v in value) + f"\n{indent}]"
    return json.dumps(value, ensure_ascii=False, allow_nan=False)
