"""Where the bodies of a robot are in every frame of a motion, by Drake."""

# pydrake's stubs read "float64[m, 1]" as a shape and refuse every array.
# pyright: reportArgumentType=false, reportCallIssue=false

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from drakeplan.plan.arrays import read_only
from scenes.input_error import unknown_name
from scenes.robots.plant import build_plant
from scenes.robots.robot import Robot


def body_poses(robot: Robot, q: np.ndarray, names: Sequence[str]) -> dict[str, np.ndarray]:
    """(T, 4, 4) X_WB of each named body of a robot at T configurations [m].

    Args:
        robot: whose model has the bodies.
        q: (T, nq) positions in the order of its plant.
        names: of the bodies; none: all of them.

    Raises:
        InputError: the model has no such body.
    """
    plant = build_plant(robot).plant
    context = plant.CreateDefaultContext()
    known = [
        plant.get_body(index).name()
        for index in plant.GetBodyIndices(plant.GetBodyByName(robot.base_body).model_instance())
    ]
    for name in names:
        if name not in known:
            raise unknown_name("body", name, known)
    bodies = [plant.GetBodyByName(name) for name in names or known]
    X_WB = np.empty((len(bodies), len(q), 4, 4))
    for k, positions in enumerate(q):
        plant.SetPositions(context, positions)
        for b, body in enumerate(bodies):
            X_WB[b, k] = plant.EvalBodyPoseInWorld(context, body).GetAsMatrix4()
    return {body.name(): read_only(poses) for body, poses in zip(bodies, X_WB, strict=True)}
