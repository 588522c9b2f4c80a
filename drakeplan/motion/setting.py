"""What all motions of a query share."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from drakeplan.deadline import Deadline
from drakeplan.motion.proximity import ProximityMonitor
from optimization.inverse_kinematics.whole_body_ik import WholeBodyIK
from scenes.robots.robot import Robot
from scenes.terrain.packed_terrain import PackedTerrain


@dataclass(frozen=True, eq=False)
class Setting:
    """The robot, terrain and options shared by all motions of a query.

    Attributes:
        robot: whose.
        ik: its inverse kinematics.
        monitor: its distances to itself and the terrain.
        packed: the terrain.
        rate: frames per second [Hz].
        clearance: margin of swinging feet and palms to the terrain [m].
        effort: (nv - 6,) greatest joint torques [N m].
        deadline: of the query.
        feedback: whether dynamics and motion are made to agree.
    """

    robot: Robot
    ik: WholeBodyIK
    monitor: ProximityMonitor
    packed: PackedTerrain
    rate: int
    clearance: float
    effort: np.ndarray
    deadline: Deadline
    feedback: bool = True
