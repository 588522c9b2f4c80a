"""Two plans made without the planner.

`strolling_plan` is made up, with everything in it that can be shown: feet on stones, palms on panels, forces, a moving
robot. Nothing in it is physical. It is for what reads plans without judging them: playback and the command line.

`stepping_plan` holds: two steps along a wall with a palm on it, slow enough for statics. Its forces come from one small
linear program per knot and its motion from Newton steps on Drake's Jacobians, the slow and obvious twins of the
planner's stages. It is for the verifier, and for whatever needs a plan that is right.
"""

from __future__ import annotations

import numpy as np
import pytest
import scipy.optimize
from pydrake.common.eigen_geometry import AngleAxis
from pydrake.math import RigidTransform, RotationMatrix
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import JacobianWrtVariable
from pydrake.systems.framework import Context

from drakeplan.plan.plan import Plan, PlanCentroidal, PlanContacts, PlanMotion, PlanPhases, tabulate_stances
from scenes.contact import Contact, contact_pose
from scenes.effector import EFFECTORS, LEFT_FOOT, LEFT_PALM, RIGHT_FOOT, RIGHT_PALM
from scenes.files.scene_file import scene_to_yaml
from scenes.library.rubble_corridor import named as rubble_corridor
from scenes.robots.plant import build_plant, nominal_posture
from scenes.robots.robot import Robot, load_robot
from scenes.stance import Stance
from scenes.terrain.terrain import Box

STANCE_TIME = 0.6  # [s]
KNOT = 0.1  # [s]
FRAME = 0.02  # [s]


@pytest.fixture(scope="session")
def strolling_plan() -> Plan:
    """Escher glides through the rubble corridor while its contacts come and go."""
    return make_strolling_plan()


def make_strolling_plan() -> Plan:
    """The fixture's plan, for scripts."""
    robot = load_robot("escher")
    scene = rubble_corridor(0)
    stances = _stances(scene)
    contacts, table = tabulate_stances(stances)
    duration = STANCE_TIME * len(stances)
    starts = STANCE_TIME * np.arange(len(stances))
    t = np.arange(round(duration / KNOT) + 1) * KNOT
    at_knot = table[np.minimum((t / STANCE_TIME + 1e-9).astype(int), len(stances) - 1)]
    com = np.array([_com(stances, instant) for instant in t])
    loaded = (at_knot >= 0) * [1.0, 1.0, 0.25, 0.25]
    weight = robot.mass * 9.81
    force = weight * (loaded / loaded.sum(axis=1, keepdims=True))[..., None] * [0.0, 0.0, 1.0]
    for effector, sideways in ((LEFT_PALM, -0.15), (RIGHT_PALM, 0.15)):
        force[:, effector, 1] = sideways * weight * (at_knot[:, effector] >= 0)
    motion = _motion(robot, stances, duration)
    return Plan(
        robot=robot.name,
        robot_model=str(robot.model),
        robot_model_sha256=robot.model_sha256,
        mass=robot.mass,
        friction_cone="inner",
        scene_name=scene.name,
        scene_yaml=scene_to_yaml(scene),
        triangles=scene.terrain.triangles,
        half_extent=robot.half_extents,
        contacts=contacts,
        stances=table,
        phases=PlanPhases(starts, starts + STANCE_TIME, table),
        centroidal=PlanCentroidal(
            t=t,
            com=com,
            linear_momentum=np.zeros((len(t), 3)),
            angular_momentum=np.zeros((len(t), 3)),
            contact=at_knot,
            force_W=force,
            cop_C=np.zeros((len(t), 4, 2)),
            torque_n=np.zeros((len(t), 4)),
        ),
        motion=motion,
        provenance={"seed": 0},
    )


def _stances(scene) -> list[Stance]:
    feet = (_contact(scene, LEFT_FOOT, 0.0, 0.12), _contact(scene, RIGHT_FOOT, 0.0, -0.12))
    stances = [Stance((*feet, None, None))]
    panels = {LEFT_PALM: "left_panel_1", RIGHT_PALM: "right_panel_2"}
    for step in range(8):
        foot = (LEFT_FOOT, RIGHT_FOOT)[step % 2]
        x = min(0.25 * (step + 1), 2.6)
        stances.append(stances[-1].replace(foot, _contact(scene, foot, x, 0.12 if foot == LEFT_FOOT else -0.12)))
        if step in (2, 4):
            palm = (LEFT_PALM, RIGHT_PALM)[step == 4]
            surface = next(i for i, s in enumerate(scene.terrain.surfaces) if s.name == panels[palm])
            panel = scene.terrain.surfaces[surface]
            pose = contact_pose(EFFECTORS[palm], panel.centroid, panel.normal, 0.0)
            stances.append(stances[-1].replace(palm, Contact(EFFECTORS[palm], surface, pose, panel.friction)))
    return stances


def _contact(scene, foot: int, x: float, y: float) -> Contact:
    """On the highest surface that a foot may use above (x, y); the nearest one where there is none."""
    usable = [(i, s) for i, s in enumerate(scene.terrain.surfaces) if s.allows(EFFECTORS[foot])]
    index, surface = min(usable, key=lambda pair: np.linalg.norm(pair[1].centroid[:2] - [x, y]))
    for i, s in usable:
        low, high = s.vertices[:, :2].min(axis=0) + 0.05, s.vertices[:, :2].max(axis=0) - 0.05
        if (low < [x, y]).all() and ([x, y] < high).all():
            index, surface = i, s
    height = surface.centroid[2] - surface.normal[:2] @ ([x, y] - surface.centroid[:2]) / surface.normal[2]
    return Contact(EFFECTORS[foot], index, contact_pose(EFFECTORS[foot], [x, y, height], surface.normal, 0.0), 0.5)


def _com(stances: list[Stance], instant: float) -> np.ndarray:
    """Over the mean of the feet, gliding from one stance to the next."""
    means = np.array([s.feet_mean() for s in stances])
    times = STANCE_TIME * (np.arange(len(stances)) + 0.5)
    glide = np.array([np.interp(instant, times, column) for column in means.T])
    return glide + np.array([0.0, 0.04 * np.sin(np.pi * instant / STANCE_TIME), 0.93])


def _motion(robot, stances: list[Stance], duration: float) -> PlanMotion:
    plant = build_plant(robot).plant
    t = np.arange(round(duration / FRAME) + 1) * FRAME
    q = np.tile(nominal_posture(robot), (len(t), 1))
    standing = _com(stances, 0.0) * [1, 1, 0] + [0.0, 0.0, 0.93]
    q[:, 4:7] += np.array([_com(stances, instant) for instant in t]) - standing
    names = tuple(plant.GetPositionNames())
    for name, swing in (("left_shoulder_pitch", 0.4), ("right_shoulder_pitch", -0.4)):
        joint = next(i for i, n in enumerate(names) if name in n)
        q[:, joint] += swing * np.sin(np.pi * t / STANCE_TIME)
    velocity_names = tuple(plant.GetVelocityNames())
    actuators = tuple(plant.get_joint_actuator(index).name() for index in plant.GetJointActuatorIndices())
    tau = np.outer(np.sin(t), np.arange(len(actuators)))
    return PlanMotion(t, q, np.zeros((len(t), len(velocity_names))), names, velocity_names, tau, actuators)


# ---- two steps along a wall

LIFT = 0.06  # [m] height of a step
GROUND_FRICTION, WALL_FRICTION = 0.5, 0.6
WALL_Y = 0.6  # [m]
PILLAR = Box("pillar", np.array([0.2, 0.2, 1.0]), RigidTransform([1.5, -0.5, 0.5]).GetAsMatrix4())
ALONG_A_WALL = f"""\
format: drakeplan-scene
version: 1
name: along_a_wall
friction: {GROUND_FRICTION}
surfaces:
  - {{name: ground, vertices: [[-1, -1, 0], [2, -1, 0], [2, {WALL_Y}, 0], [-1, {WALL_Y}, 0]]}}
  - name: wall
    vertices: [[-1, {WALL_Y}, 0.5], [2, {WALL_Y}, 0.5], [2, {WALL_Y}, 2], [-1, {WALL_Y}, 2]]
    friction: {WALL_FRICTION}
obstacles:
  - {{name: pillar, box: [0.2, 0.2, 1.0], pose: {{xyz: [1.5, -0.5, 0.5]}}}}
start: {{xyz: [0, 0, 0], yaw: 0}}
goal: {{xyz: [0.2, 0, 0], radius: 0.1, yaw: 0}}
"""
# phase by phase: seconds, stance, end effector that moves to the next stance or None, CoM (x, y) at its end [m]
PHASES = (
    (0.4, 0, None, (0.0, 0.0)),
    (1.0, 0, LEFT_PALM, (0.0, 0.0)),
    (1.4, 1, None, (0.0, -0.09)),
    (1.0, 1, LEFT_FOOT, (0.02, -0.09)),
    (1.2, 2, None, (0.1, 0.0)),
    (1.0, 2, LEFT_PALM, (0.16, 0.06)),
    (1.0, 3, None, (0.2, 0.09)),
    (1.0, 3, RIGHT_FOOT, (0.2, 0.09)),
    (1.8, 4, None, (0.2, 0.0)),
)
SECONDS = np.array([seconds for seconds, *_ in PHASES])
ENDS = np.round(np.cumsum(SECONDS), 9)
STARTS = np.concatenate([[0.0], ENDS[:-1]])


@pytest.fixture(scope="session")
def stepping_plan() -> Plan:
    """Escher takes two steps along a wall and the plan holds."""
    return make_stepping_plan()


def make_stepping_plan() -> Plan:
    """The fixture's plan, for scripts."""
    robot = load_robot("escher")
    plant = build_plant(robot).plant
    contacts, table = tabulate_stances(_wall_stances())
    carried = np.array([table[stance] for _, stance, _, _ in PHASES])
    for phase, (_, _, mover, _) in enumerate(PHASES):
        if mover is not None:
            carried[phase, mover] = -1
    knots, frames = (np.arange(round(ENDS[-1] / step) + 1) * step for step in (KNOT, FRAME))
    context = plant.CreateDefaultContext()
    plant.SetPositions(context, nominal_posture(robot))
    height = plant.CalcCenterOfMassPositionInWorld(context)[2] - 0.02
    centroidal = _statics(robot, contacts, carried, knots, np.array([_course(t, height) for t in knots]))
    along = np.stack([np.interp(frames, knots, column) for column in centroidal.com.T], axis=1)
    q, v = _whole_body(robot, plant, contacts, table, frames, along)
    return Plan(
        robot=robot.name,
        robot_model=str(robot.model),
        robot_model_sha256=robot.model_sha256,
        mass=robot.mass,
        friction_cone="inner",
        scene_name="along_a_wall",
        scene_yaml=ALONG_A_WALL,
        triangles=PILLAR.triangles(),
        half_extent=robot.half_extents,
        contacts=contacts,
        stances=table,
        phases=PlanPhases(STARTS, ENDS, carried),
        centroidal=centroidal,
        motion=PlanMotion(frames, q, v, tuple(plant.GetPositionNames()), tuple(plant.GetVelocityNames())),
        provenance={"seed": 0},
    )


def _wall_stances() -> list[Stance]:
    """Feet; palm on the wall; left foot ahead; palm off; right foot ahead."""
    up, out = np.array([0.0, 0.0, 1.0]), np.array([0.0, -1.0, 0.0])

    def foot(effector: int, x: float, y: float) -> Contact:
        return Contact(EFFECTORS[effector], 0, contact_pose(EFFECTORS[effector], [x, y, 0.0], up, 0.0), GROUND_FRICTION)

    palm = Contact("left_palm", 1, contact_pose("left_palm", [0.3, WALL_Y, 1.2], out, 0.0), WALL_FRICTION)
    stances = [Stance((foot(LEFT_FOOT, 0.0, 0.1), foot(RIGHT_FOOT, 0.0, -0.1), None, None))]
    stances.append(stances[-1].replace(LEFT_PALM, palm))
    stances.append(stances[-1].replace(LEFT_FOOT, foot(LEFT_FOOT, 0.2, 0.1)))
    stances.append(stances[-1].replace(LEFT_PALM, None))
    stances.append(stances[-1].replace(RIGHT_FOOT, foot(RIGHT_FOOT, 0.2, -0.1)))
    return stances


def _phase_at(t: float) -> int:
    return int(np.clip(np.searchsorted(STARTS, t + 1e-9, side="right") - 1, 0, len(STARTS) - 1))


def _smooth(u: float) -> float:
    return u**3 * (10 - 15 * u + 6 * u**2)


def _course(t: float, height: float) -> np.ndarray:
    """(3,) CoM at time t: at rest at the end of every phase [m]."""
    phase = min(int(np.searchsorted(ENDS, t - 1e-9)), len(ENDS) - 1)
    before, after = np.array(PHASES[max(phase - 1, 0)][3]), np.array(PHASES[phase][3])
    u = np.clip((t - STARTS[phase]) / (0.8 * SECONDS[phase]), 0.0, 1.0)
    return np.array([*(before + _smooth(u) * (after - before)), height])


def _statics(
    robot: Robot, contacts: PlanContacts, carried: np.ndarray, knots: np.ndarray, com: np.ndarray
) -> PlanCentroidal:
    """Momenta that follow from the CoM (N, 3), no angular momentum, and forces that bring them about."""
    held = carried[[_phase_at(t) for t in knots]]
    held[-1] = held[-2]
    momentum = np.zeros_like(com)
    momentum[1:] = robot.mass * np.diff(com, axis=0) / KNOT
    force, cop, torque = np.zeros((len(knots), 4, 3)), np.zeros((len(knots), 4, 2)), np.zeros((len(knots), 4))
    for n in range(len(knots) - 1):
        total = (momentum[n + 1] - momentum[n]) / KNOT + [0, 0, 9.81 * robot.mass]
        force[n], cop[n], torque[n] = _share(robot, contacts, held[n], com[n + 1], total)
    force[-1], cop[-1], torque[-1] = force[-2], cop[-2], torque[-2]
    return PlanCentroidal(knots, com, momentum, np.zeros_like(com), held, force, cop, torque)


def _share(
    robot: Robot, contacts: PlanContacts, held: np.ndarray, com: np.ndarray, total: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """(4, 3) forces in W [N], (4, 2) centres of pressure [m], (4,) torques [N m] with this sum and no moment.

    Every corner pushes inside the octagon; the corner that pushes hardest pushes as little as possible.
    """
    angle = 2 * np.pi * np.arange(8) / 8
    blocks, corners = [], []
    for e in np.flatnonzero(held >= 0):
        X_WC, mu = contacts.X_WC[held[e]], contacts.friction[held[e]]
        rays = np.stack([mu * np.cos(angle), mu * np.sin(angle), np.ones(8)])
        for signs in ((1, 1, 0), (-1, 1, 0), (-1, -1, 0), (1, -1, 0)):
            corner = np.array(signs) * [*robot.half_extents[e], 0.0]
            f_W = X_WC[:3, :3] @ rays
            arm = X_WC[:3, :3] @ corner + X_WC[:3, 3] - com
            blocks.append(np.vstack([f_W, np.cross(arm, f_W.T).T]))
            corners.append((e, corner, rays))
    n = len(blocks)
    push = np.hstack([np.kron(np.eye(n), np.ones((1, 8))), -np.ones((n, 1))])
    answer = scipy.optimize.linprog(
        [*np.zeros(8 * n), 1.0],
        A_ub=push,
        b_ub=np.zeros(n),
        A_eq=np.hstack([*blocks, np.zeros((6, 1))]),
        b_eq=[*total, 0.0, 0.0, 0.0],
    )
    assert answer.success, "the contacts cannot carry the robot along this course"
    f_C, moment = np.zeros((4, 3)), np.zeros((4, 3))
    for (e, corner, rays), weights in zip(corners, answer.x[:-1].reshape(n, 8), strict=True):
        f_C[e] += rays @ weights
        moment[e] += np.cross(corner, rays @ weights)
    force, cop, torque = np.zeros((4, 3)), np.zeros((4, 2)), np.zeros(4)
    for e in np.flatnonzero((held >= 0) & (f_C[:, 2] > 1e-9)):
        force[e] = contacts.X_WC[held[e], :3, :3] @ f_C[e]
        cop[e] = np.array([-moment[e, 1], moment[e, 0]]) / f_C[e, 2]
        torque[e] = moment[e, 2] - (cop[e, 0] * f_C[e, 1] - cop[e, 1] * f_C[e, 0])
    return force, cop, torque


def _whole_body(
    robot: Robot, plant: MultibodyPlant, contacts: PlanContacts, table: np.ndarray, frames: np.ndarray, com: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """(T, nq) positions and (T, nv) velocities that hold the contacts, swing what moves and follow the CoM (T, 3)."""
    context = plant.CreateDefaultContext()
    q = np.array(nominal_posture(robot))
    rows, left = [], {}  # where each moving end effector was when its phase began
    for t, p_com in zip(frames, com, strict=True):
        phase = _phase_at(t)
        _, stance, mover, _ = PHASES[phase]
        targets = {e: RigidTransform(contacts.X_WC[c]) for e, c in enumerate(table[stance]) if c >= 0 and e != mover}
        if mover is not None:
            if phase not in left:
                plant.SetPositions(context, q)
                left[phase] = plant.GetFrameByName(EFFECTORS[mover]).CalcPoseInWorld(context)
            landing = table[stance + 1, mover]
            # A palm that leaves the wall goes back beside the body, which has come forward since.
            beside = RigidTransform(left[1].rotation(), left[1].translation() + np.array([0.12, 0.0, 0.0]))
            goal = RigidTransform(contacts.X_WC[landing]) if landing >= 0 else beside
            u = (t - STARTS[phase]) / SECONDS[phase]
            targets[mover] = _between(left[phase], goal, _smooth(u), LIFT * np.sin(np.pi * u) ** 2 * (mover < 2))
        q = _reach(robot, plant, context, q, targets, p_com)
        rows.append(q)
    q = np.array(rows)
    q[:3] = q[3]  # the first frames settle
    v = np.zeros((len(q), plant.num_velocities()))
    for n in range(1, len(q) - 1):
        plant.SetPositions(context, q[n])
        v[n] = plant.MapQDotToVelocity(context, (q[n + 1] - q[n - 1]) / (2 * FRAME))
    return q, v


def _reach(
    robot: Robot,
    plant: MultibodyPlant,
    context: Context,
    q: np.ndarray,
    targets: dict[int, RigidTransform],
    p_com: np.ndarray,
) -> np.ndarray:
    """(nq,) nearby positions with end effectors and CoM where they should be, drawn to the nominal posture."""
    W, wrt = plant.world_frame(), JacobianWrtVariable.kV
    for attempt in range(60):
        plant.SetPositions(context, q)
        errors = [p_com - plant.CalcCenterOfMassPositionInWorld(context)]
        rows = [plant.CalcJacobianCenterOfMassTranslationalVelocity(context, wrt, W, W)]
        for e, X_WE in targets.items():
            frame = plant.GetFrameByName(EFFECTORS[e])
            now = frame.CalcPoseInWorld(context)
            turn = AngleAxis((X_WE.rotation() @ now.rotation().inverse()).matrix())
            errors += [turn.angle() * turn.axis(), X_WE.translation() - now.translation()]
            rows.append(plant.CalcJacobianSpatialVelocity(context, wrt, frame, np.zeros(3), W, W))
        J, error = np.vstack(rows), np.concatenate(errors)
        if attempt and np.abs(error).max() < 1e-7:
            return q
        inverse = np.linalg.pinv(J, rcond=1e-4)
        step = inverse @ error
        if not attempt:
            home = np.zeros(plant.num_velocities())
            home[:3], home[6:] = -2 * q[1:4], nominal_posture(robot)[7:] - q[7:]
            step += 0.02 * (home - inverse @ (J @ home))
        step *= min(1.0, 0.2 / max(np.abs(step).max(), 1e-9))
        q = q + plant.MapVelocityToQDot(context, step)
        q[:4] /= np.linalg.norm(q[:4])
        q[7:] = np.clip(q[7:], plant.GetPositionLowerLimits()[7:], plant.GetPositionUpperLimits()[7:])
    raise AssertionError("no posture reaches the targets")


def _between(X_WA: RigidTransform, X_WB: RigidTransform, u: float, lift: float) -> RigidTransform:
    """The pose that is the share u of the way from A to B, lifted [m]."""
    turn = AngleAxis((X_WA.rotation().inverse() @ X_WB.rotation()).matrix())
    R = X_WA.rotation() @ RotationMatrix(AngleAxis(turn.angle() * u, turn.axis()))
    return RigidTransform(R, (1 - u) * X_WA.translation() + u * X_WB.translation() + [0.0, 0.0, lift])
