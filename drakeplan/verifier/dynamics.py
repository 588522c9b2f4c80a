"""Whether the model moves as the plan's momenta say, and its actuators can bring the motion about.

The planned forces are constant over [t_n, t_n+1), so the momenta that they bring about are linear between the knots: the
plan's momenta at a frame are interpolated linearly, and that is exact. The plan's CoM is integrated with the momentum at
the end of each interval, com[n+1] = com[n] + dt l[n+1] / M. A model whose CoM goes through the knots exactly has the
plan's linear momentum half an interval early, and differs from it by dt/2 times its rate of change.
"""

from __future__ import annotations

import numpy as np

from .limits import ANGULAR, ANGULAR_MEDIAN, ANGULAR_RMS, COM, LINEAR, LINEAR_RMS, STORED_TORQUE, TORQUE
from .plan_file import PlanFile
from .report import Sheet
from .robot import RobotModel
from .track import Track


def check_dynamics(sheet: Sheet, plan: PlanFile, robot: RobotModel, track: Track) -> None:
    """CoM, momenta and torques of the model in every frame.

    Args:
        sheet: takes the checks.
        plan: the plan file.
        robot: the robot's model.
        track: the model in every frame.
    """
    t = plan["motion/t"]

    def off(model: np.ndarray, name: str) -> np.ndarray:
        """(T,) length of the difference between the model's vectors (T, 3) and the plan's at the same time."""
        knots = plan[f"centroidal/{name}"]
        planned = np.stack([np.interp(t, plan["centroidal/t"], column) for column in knots.T], axis=1)
        return np.linalg.norm(model - planned, axis=1)

    def at(index: tuple[int, ...]) -> str:
        return f"frame {index[0]}, t = {t[index[0]]:.3f} s"

    sheet.add("com of model", off(track.com, "com"), COM, "m", at)
    for name, model, worst, rms, unit in (
        ("linear momentum", track.linear, LINEAR, LINEAR_RMS, "kg m/s"),
        ("angular momentum", track.angular, ANGULAR, ANGULAR_RMS, "N m s"),
    ):
        gap = off(model, name.replace(" ", "_"))
        sheet.add(f"{name} of model", gap, worst, unit, at)
        sheet.add(f"{name} of model, RMS", np.sqrt(np.mean(gap**2)), rms, unit, "all frames")
        if name == "angular momentum":
            sheet.add(f"{name} of model, median", np.median(gap), ANGULAR_MEDIAN, unit, "all frames")
    share = np.abs(track.torque) / robot.effort

    def joint(index: tuple[int, ...]) -> str:
        torque, limit = track.torque[index], robot.effort[index[1]]
        return f"{at(index)}, {robot.actuator_names[index[1]]}: {torque:.1f} N m of {limit:g}"

    sheet.add("joint torques", share, TORQUE, "", joint, empty="" if len(robot.effort) else "no actuators")
    stored = plan.data.get("motion/tau")
    off_by = np.zeros((0, 0)) if stored is None else np.abs(stored - np.vstack([track.torque, track.torque[-1:]]))
    missing = "the file has none" if stored is None else "no actuators"
    sheet.add("stored torques", off_by, STORED_TORQUE, "N m", at, empty="" if off_by.size else missing)
