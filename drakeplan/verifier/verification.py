"""Runs all checks on a plan file."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from .contacts import check_contacts
from .ends import check_ends
from .forces import check_forces, check_momentum
from .motion import check_motion
from .phases import check_phases, check_stances
from .plan_file import PlanFile, check_data, find_model, read_plan
from .report import Report, Sheet
from .robot import RobotModel, check_patches_on_robot
from .scene import read_scene


def verify(path: str | Path, robot_model: str | Path | None = None) -> Report:
    """Checks a plan file.

    Args:
        path: the plan file.
        robot_model: the model that Drake's parser loads alone; by default the path that the file names.

    Raises:
        UnreadablePlan: missing, truncated or foreign file, data of the wrong shape, or a plan for another model.
    """
    plan = read_plan(Path(path))
    model = find_model(plan, robot_model)
    sheet = Sheet()
    with np.errstate(all="ignore"):  # extreme numbers overflow to inf or NaN, and these fail their checks
        remark = check_data(sheet, plan)
        if not remark:
            _check_plan(sheet, plan, model)
    return Report(str(path), tuple(sheet.checks), remark)


def _check_plan(sheet: Sheet, plan: PlanFile, model: Path) -> None:
    scene, robot = read_scene(plan.text["scene/yaml"]), RobotModel(model)
    judged = check_contacts(sheet, plan, scene)
    check_patches_on_robot(sheet, plan, robot)
    check_stances(sheet, plan)
    if plan.complete:
        check_phases(sheet, plan)
        if judged:
            check_forces(sheet, plan)
            check_momentum(sheet, plan, robot)
        check_motion(sheet, plan, robot, scene)
    check_ends(sheet, plan, scene)
