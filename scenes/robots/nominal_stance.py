"""Whether a robot file describes a robot that stands: soles level, apart and under the right leg, joints within limits."""

# pydrake's stubs read "float64[3, 1]" as a shape and refuse every array.
# pyright: reportArgumentType=false, reportAttributeAccessIssue=false

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import shapely

from scenes.effector import EFFECTORS
from scenes.input_error import InputError
from scenes.robots.nominal_distances import measure_distances
from scenes.robots.plant import RobotPlant, build_plant, nominal_posture
from scenes.robots.robot import Robot

LEVEL = np.deg2rad(20.0)  # of a sole in the nominal posture
AHEAD = np.deg2rad(60.0)  # of a sole's x axis from the robot's
SAME_HEIGHT = 0.05  # [m] of the two soles
OFF_BODY = 0.01  # [m] of a patch's corner from the body that carries it: the verifier allows no more
OVERLAP = 0.005  # [m] of two bodies: the verifier allows no more
IN_LIMITS = 1e-6  # [rad]


def check_nominal_stance(robot: Robot) -> None:
    """Refuses a robot that cannot stand as it is described.

    Raises:
        InputError: the first thing that is wrong, with the key of the robot file to look at.
    """
    with np.errstate(over="ignore"):  # frames may be anywhere
        fault = next(_faults(build_plant(robot), nominal_posture(robot)), None)
    if fault is not None:
        raise InputError(f"{robot.source}: {fault}")


def _faults(robot_plant: RobotPlant, q: np.ndarray) -> Iterator[str]:
    yield from _joints_out_of_limits(robot_plant, q)
    context = robot_plant.new_context()
    plant, plant_context = robot_plant.plant, robot_plant.plant.GetMyContextFromRoot(context)
    plant.SetPositions(plant_context, q)
    X_WE = [plant.EvalBodyPoseInWorld(plant_context, b).GetAsMatrix4() for b in robot_plant.effector_bodies]
    for name, X in zip(EFFECTORS[:2], X_WE[:2], strict=True):
        yield from _wrong_axes(name, X[:3, :3])
    yield from _wrong_places(robot_plant.robot, X_WE[0], X_WE[1])
    query = plant.get_geometry_query_input_port().Eval(plant_context)
    for e, X in enumerate(X_WE):
        half = np.array(robot_plant.robot.effectors[e].half_extent)
        if not half.all() or not robot_plant.effector_geometry[e]:
            continue
        for sign in ((1, 1), (-1, 1), (-1, -1), (1, -1)):
            corner = X[:3, 3] + X[:3, :2] @ (half * sign)
            near = query.ComputeSignedDistanceToPoint(corner, OFF_BODY + 1.0)
            off = min((d.distance for d in near if d.id_G in robot_plant.effector_geometry[e]), default=np.inf)
            if off > OFF_BODY:
                yield (
                    f"effectors.{EFFECTORS[e]}.half_extent: a corner of the patch is {1e3 * off:.0f} mm off the body that "
                    f"carries it, at most {1e3 * OFF_BODY:.0f} mm are allowed"
                )
    for (a, b), distance in measure_distances(robot_plant, q).items():
        if distance < -OVERLAP:
            yield (
                f"nominal: bodies {a} and {b} are {-1e3 * distance:.0f} mm inside each other: change the posture, or name "
                f"them in changes.ignored_pairs"
            )


def _joints_out_of_limits(robot_plant: RobotPlant, q: np.ndarray) -> Iterator[str]:
    plant = robot_plant.plant
    for name, angle in robot_plant.robot.nominal.items():
        joint = plant.GetJointByName(name)
        if joint.num_positions() != 1:
            yield f"nominal.{name}: the joint does not move in the model"
            continue
        low, high = joint.position_lower_limits()[0], joint.position_upper_limits()[0]
        if not low - IN_LIMITS <= angle <= high + IN_LIMITS:
            yield f"nominal.{name}: {angle:g} is outside the joint's limits {low:.3g} to {high:.3g}"


def _wrong_axes(name: str, R_WE: np.ndarray) -> Iterator[str]:
    up, ahead = float(R_WE[2, 2]), float(R_WE[0, 0])
    if up < np.cos(LEVEL):
        where = (
            "down" if up < -np.cos(LEVEL) else f"{np.degrees(np.arccos(np.clip(up, -1, 1))):.0f} deg off the vertical"
        )
        yield (
            f"effectors.{name}.frame: its z axis points {where} in the nominal posture; the z axis of a sole points up, out of "
            f"the ground"
        )
    elif ahead < np.cos(AHEAD):
        where = "backwards" if ahead < -np.cos(AHEAD) else "sideways"
        yield f"effectors.{name}.frame: its x axis points {where} in the nominal posture; the x axis of a sole points to the toes"


def _wrong_places(robot: Robot, X_WL: np.ndarray, X_WR: np.ndarray) -> Iterator[str]:
    left, right = X_WL[:3, 3], X_WR[:3, 3]
    if left[1] <= right[1]:
        yield (
            f"effectors: left_foot stands {1e2 * (right[1] - left[1]):.0f} cm to the right of right_foot in the nominal "
            f"posture: are they exchanged?"
        )
    if abs(left[2] - right[2]) > SAME_HEIGHT:
        yield f"nominal: one sole is {1e2 * abs(left[2] - right[2]):.0f} cm above the other: choose a posture that stands"
    soles = [_outline(X, robot.effectors[e].half_extent) for e, X in enumerate((X_WL, X_WR))]
    shared = soles[0].intersection(soles[1])
    if shared.area > 0.0:
        width = np.ptp(np.array(shared.exterior.coords)[:, 1]) if hasattr(shared, "exterior") else 0.0
        yield (
            f"effectors: the soles overlap by {1e3 * width:.0f} mm in the nominal posture: check half_extent, or stand wider "
            f"in nominal"
        )


def _outline(X_WE: np.ndarray, half: tuple[float, float]) -> shapely.Polygon:
    corners = np.array([[1, 1], [-1, 1], [-1, -1], [1, -1]]) * half
    return shapely.Polygon(X_WE[:2, 3] + corners @ X_WE[:2, :2].T)
