"""The reach figures of a robot, measured from its model: what a new robot's YAML file is filled in from.

`python -m optimization.inverse_kinematics.robot_reach NAME` prints them as YAML.
"""

# pydrake's stubs read "float64[m, 1]" as a shape and refuse every array.
# pyright: reportArgumentType=false, reportCallIssue=false, reportAttributeAccessIssue=false, reportReturnType=false, reportOperatorIssue=false

from __future__ import annotations

import sys
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from pydrake.multibody.tree import RevoluteJoint, RigidBody
from pydrake.solvers import SnoptSolver
from scipy.optimize import minimize

from optimization.inverse_kinematics.drake_posture import PostureOptions, PostureSolver
from scenes.effector import EFFECTORS, LEFT_FOOT, LEFT_PALM
from scenes.robots.plant import RobotPlant, build_plant, nominal_posture
from scenes.robots.robot import load_robot

SAMPLES = 4000  # random joint angles per figure
STARTS = 6  # local searches from the best samples


@dataclass(frozen=True)
class ReachFigures:
    """What `Robot` calls by the same names, measured; lengths in m, points in frame T. None of a robot without palms."""

    shoulder: np.ndarray | None
    hip: np.ndarray
    arm_reach: tuple[float, float] | None
    leg_reach: tuple[float, float]
    com_height: tuple[float, float, float]
    com_reach: tuple[float, float]  # foot, palm
    foot_separation: float  # least


def measure_reach(robot_plant: RobotPlant, *, seed: int = 0) -> ReachFigures:
    """Measures a robot alone (no terrain); takes some seconds.

    Args:
        robot_plant: of the robot.
        seed: of the random postures.
    """
    rng = np.random.default_rng(seed)
    shoulder, arm = _limb_root(robot_plant, LEFT_PALM) if robot_plant.robot.palms else (None, [])
    hip, leg = _limb_root(robot_plant, LEFT_FOOT)
    return ReachFigures(
        shoulder=shoulder,
        hip=hip,
        arm_reach=None if shoulder is None else _distances(robot_plant, LEFT_PALM, arm, shoulder, rng),
        leg_reach=_distances(robot_plant, LEFT_FOOT, leg, hip, rng),
        com_height=_com_heights(robot_plant),
        com_reach=(
            _com_reach(robot_plant, LEFT_FOOT, leg, rng),
            0.0 if shoulder is None else _com_reach(robot_plant, LEFT_PALM, arm, rng),
        ),
        foot_separation=_least_separation(robot_plant),
    )


def _limb_root(robot_plant: RobotPlant, effector: int) -> tuple[np.ndarray, list[RevoluteJoint]]:
    """(3,) point nearest to the axes of the limb's first three joints, in T, and all joints of the limb."""
    plant, context = robot_plant.plant, robot_plant.plant.CreateDefaultContext()
    plant.SetPositions(context, nominal_posture(robot_plant.robot))
    trunk = {robot_plant.robot.base_body, robot_plant.robot.torso_body}
    joints: list[RevoluteJoint] = []
    body: RigidBody = robot_plant.effector_bodies[effector]
    parents = {plant.get_joint(j).child_body().name(): plant.get_joint(j) for j in plant.GetJointIndices()}
    while body.name() not in trunk:
        joint = parents[body.name()]
        if isinstance(joint, RevoluteJoint):
            joints.insert(0, joint)
        body = joint.parent_body()
    A, b = np.zeros((3, 3)), np.zeros(3)
    for joint in joints[:3]:
        X_WJ = joint.frame_on_child().CalcPoseInWorld(context)
        axis = X_WJ.rotation() @ joint.revolute_axis()
        across = np.eye(3) - np.outer(axis, axis)
        A, b = A + across, b + across @ X_WJ.translation()
    return np.linalg.solve(A, b), joints


def _distances(
    robot_plant: RobotPlant, effector: int, joints: list[RevoluteJoint], root: np.ndarray, rng: np.random.Generator
) -> tuple[float, float]:
    """Least distance of limb root and patch without self-collision, and the greatest of all [m]."""
    plant = robot_plant.plant
    diagram_context = robot_plant.new_context()
    context = plant.GetMyContextFromRoot(diagram_context)
    q = nominal_posture(robot_plant.robot).copy()
    columns = [j.position_start() for j in joints]
    lower, upper = (limit[columns] for limit in (plant.GetPositionLowerLimits(), plant.GetPositionUpperLimits()))
    body = robot_plant.effector_bodies[effector]

    def distance(angles: np.ndarray) -> float:
        q[columns] = angles
        plant.SetPositions(context, q)
        return float(np.linalg.norm(plant.EvalBodyPoseInWorld(context, body).translation() - root))

    def free() -> bool:
        scene = plant.get_geometry_query_input_port().Eval(context)
        return not scene.ComputeSignedDistancePairwiseClosestPoints(0.0)

    samples = rng.uniform(lower, upper, (SAMPLES, len(columns)))
    values = np.array([distance(s) for s in samples])
    order = np.argsort(values)
    least = next(values[k] for k in order if distance(samples[k]) is not None and free())
    greatest = _best(lambda angles: -distance(angles), samples[order[-STARTS:]], lower, upper)
    return float(least), -greatest


def _best(cost: Callable[[np.ndarray], float], starts: np.ndarray, lower: np.ndarray, upper: np.ndarray) -> float:
    bounds = list(zip(lower, upper, strict=True))
    return min(minimize(cost, s, bounds=bounds, method="L-BFGS-B").fun for s in starts)


def _com_heights(robot_plant: RobotPlant) -> tuple[float, float, float]:
    """Least, nominal and greatest CoM height with flat feet below it and no self-collision [m]."""
    plant, q = robot_plant.plant, nominal_posture(robot_plant.robot)
    context = plant.CreateDefaultContext()
    plant.SetPositions(context, q)
    nominal = plant.CalcCenterOfMassPositionInWorld(context)[2]
    heights = [_extreme_com_height(robot_plant, sign) for sign in (1.0, -1.0)]
    return heights[0], float(nominal), heights[1]


def _extreme_com_height(robot_plant: RobotPlant, sign: float) -> float:
    plant, q = robot_plant.plant, nominal_posture(robot_plant.robot)
    context = plant.CreateDefaultContext()
    plant.SetPositions(context, q)
    feet = [plant.EvalBodyPoseInWorld(context, b).GetAsMatrix4() for b in robot_plant.effector_bodies[:2]]
    over_feet = np.array([[-0.05, -0.05], [0.05, -0.05], [0.05, 0.05], [-0.05, 0.05]])
    solver = PostureSolver(robot_plant, PostureOptions(min_distance=0.002))
    best = None
    for knee in np.linspace(0.0, 1.0, 5):  # from the nominal posture towards a crouch
        guess = q.copy()
        guess[6] -= 0.3 * knee * max(sign, 0.0)
        ik = solver.program([*feet, None, None], over_feet)
        com = ik.prog().NewContinuousVariables(3, "com")
        _tie_com(robot_plant, ik, com)
        ik.prog().AddLinearCost(sign * com[2])
        result = SnoptSolver().Solve(ik.prog(), np.concatenate([guess, [0, 0, guess[6]]]))
        found = result.GetSolution(ik.q())
        found[:4] /= np.linalg.norm(found[:4])
        if solver.violations(found, [*feet, None, None], over_feet):
            continue
        plant.SetPositions(context, found)
        height = plant.CalcCenterOfMassPositionInWorld(context)[2]
        best = height if best is None else sign * min(sign * best, sign * height)
    if best is None:
        raise RuntimeError(f"{robot_plant.robot.name}: no posture with flat feet was found")
    return float(best)


def _tie_com(robot_plant: RobotPlant, ik, com: np.ndarray) -> None:  # noqa: ANN001
    from pydrake.multibody.inverse_kinematics import ComPositionConstraint

    plant = robot_plant.plant
    constraint = ComPositionConstraint(plant, None, plant.world_frame(), ik.context())
    ik.prog().AddConstraint(constraint, np.concatenate([ik.q(), com]))


def _com_reach(robot_plant: RobotPlant, effector: int, joints: list[RevoluteJoint], rng: np.random.Generator) -> float:
    """Greatest distance of the CoM from a patch while the other limbs stand in the nominal posture [m]."""
    plant = robot_plant.plant
    context = plant.CreateDefaultContext()
    q = nominal_posture(robot_plant.robot).copy()
    columns = [j.position_start() for j in joints]
    lower, upper = (limit[columns] for limit in (plant.GetPositionLowerLimits(), plant.GetPositionUpperLimits()))
    body = robot_plant.effector_bodies[effector]

    def closeness(angles: np.ndarray) -> float:
        q[columns] = angles
        plant.SetPositions(context, q)
        p_WE = plant.EvalBodyPoseInWorld(context, body).translation()
        return -float(np.linalg.norm(plant.CalcCenterOfMassPositionInWorld(context) - p_WE))

    samples = rng.uniform(lower, upper, (SAMPLES, len(columns)))
    values = np.array([closeness(s) for s in samples])
    return -_best(closeness, samples[np.argsort(values)[:STARTS]], lower, upper)


def _least_separation(robot_plant: RobotPlant) -> float:
    """Least lateral distance of parallel flat feet, side by side, without self-collision [m]."""
    q = nominal_posture(robot_plant.robot)
    solver = PostureSolver(robot_plant, PostureOptions(min_distance=0.002))
    wide = 2 * robot_plant.robot.hip[1]
    for separation in np.arange(0.08, wide, 0.01):
        X_WE: list[np.ndarray | None] = [None] * len(EFFECTORS)
        for k, side in enumerate((0.5, -0.5)):
            pose = np.eye(4)
            pose[1, 3] = side * separation
            X_WE[k] = pose
        if solver.solve(X_WE, None, q).ok:
            return float(separation)
    return float(wide)


def main(name: str) -> None:
    """Prints the figures of one robot as YAML."""
    figures = measure_reach(build_plant(load_robot(name)))
    for key, value in vars(figures).items():
        if value is not None:
            print(f"{key}: {np.round(value, 3).tolist()}")


if __name__ == "__main__":
    main(sys.argv[1])
