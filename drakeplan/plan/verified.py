"""Verifies a plan file, or a plan in memory: the verifier reads files, so such a plan is written first."""

from __future__ import annotations

import dataclasses
import os
import tempfile
from pathlib import Path

from drakeplan.plan.plan import Plan
from drakeplan.plan.plan_file import write_plan
from drakeplan.plan.robot_of_plan import RobotMark, find_robot, model_for
from drakeplan.verifier import Report, UnreadablePlan
from drakeplan.verifier import verify as verify_file
from scenes.input_error import InputError
from scenes.robots.robot import Robot, load_robot

IN_MEMORY = "plan in memory"  # what the report calls the file of such a plan


def verify(
    plan: Plan | str | os.PathLike[str],
    robot_model: str | os.PathLike[str] | None = None,
    *,
    robot: Robot | str | os.PathLike[str] | None = None,
) -> Report:
    """Checks a plan with code that shares nothing with the planner (`drakeplan.verifier`).

    Args:
        plan: a plan in memory, or the path of a plan file.
        robot_model: the model that Drake's parser loads alone, where it is not to be looked for.
        robot: the robot, its name or its YAML file; None: found by what the plan says of it.

    Returns:
        One check a line in `table()`; `holds` where all of them are met.

    Raises:
        InputError: a file that cannot be read as a plan, or another robot than the plan's.
    """
    if not isinstance(plan, Plan | str | os.PathLike):
        hint = ": give its attribute plan" if hasattr(plan, "plan") else ""
        raise TypeError(f"verify: expected a Plan or the path of a plan file, got {type(plan).__name__}{hint}")
    model = None if robot_model is None else Path(robot_model)
    if isinstance(robot, Robot):
        model = robot.model
    elif robot is not None:
        model = load_robot(os.fspath(robot)).model
    try:
        if isinstance(plan, Plan):
            return verify_plan(plan, model if model is not None else _model_of(plan))
        return verify_file(os.fspath(plan), model if model is not None else model_for(os.fspath(plan)))
    except UnreadablePlan as error:
        raise InputError(str(error)) from None


def verify_plan(plan: Plan, model: Path | None = None) -> Report:
    """The verifier's report on the file that this plan would be written to.

    Args:
        plan: to check.
        model: of its robot; None for the file that the plan names.

    Raises:
        UnreadablePlan: there is no such model, or it is another one.
    """
    with tempfile.TemporaryDirectory(prefix="drakeplan-") as folder:
        path = Path(folder) / "plan.h5"
        write_plan(plan, path)
        return dataclasses.replace(verify_file(path, model), path=IN_MEMORY)


def _model_of(plan: Plan) -> Path | None:
    """The model of a plan's robot, which may lie elsewhere than where it was planned; None where it is not found."""
    try:
        return find_robot(RobotMark.of(plan)).model
    except InputError:
        return None
