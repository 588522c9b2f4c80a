"""Plans to export: one of contacts only, one without palms in it, one of a georeferenced scene, one of any robot."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from drakeplan.export import Exported, export_plan
from drakeplan.plan.body_poses import body_poses
from drakeplan.plan.plan import Plan, PlanCentroidal, PlanContacts, PlanMotion, PlanPhases
from scenes.effector import EFFECTORS
from scenes.robots.plant import build_plant, nominal_posture
from scenes.robots.robot import Robot

OFFSET = np.array([431250.0, 5411000.0, 12.0])  # [m]
ON_THE_FLOOR = """\
format: drakeplan-scene
version: 1
name: floor
surfaces:
  - {name: floor, vertices: [[-2, -2, 0], [2, -2, 0], [2, 2, 0], [-2, 2, 0]]}
"""


@pytest.fixture
def write(tmp_path: Path) -> Callable[..., Exported]:
    """Exports into the test's folder."""
    return lambda plan, to, name, **options: export_plan(plan, to, tmp_path / name, **options)


@pytest.fixture(scope="session")
def contacts_plan(stepping_plan: Plan) -> Plan:
    """The same contacts without dynamics and motion."""
    return replace(stepping_plan, phases=None, centroidal=None, motion=None)


@pytest.fixture(scope="session")
def map_plan(stepping_plan: Plan) -> Plan:
    """A plan whose scene was georeferenced."""
    marked = stepping_plan.scene_yaml + f"origin_offset: {OFFSET.tolist()}\n"
    return replace(stepping_plan, scene_yaml=marked)


@pytest.fixture(scope="session")
def feet_plan(stepping_plan: Plan) -> Plan:
    """Two end effectors in place of four: the first stance, held."""
    assert stepping_plan.phases is not None
    assert stepping_plan.centroidal is not None
    assert stepping_plan.motion is not None
    knots = stepping_plan.centroidal.t < 0.35
    course = {
        name: getattr(stepping_plan.centroidal, name)[knots]
        for name in ("t", "com", "linear_momentum", "angular_momentum")
    }
    course |= {
        name: getattr(stepping_plan.centroidal, name)[knots][:, :2]
        for name in ("contact", "force_W", "cop_C", "torque_n")
    }
    frames = stepping_plan.motion.t < 0.31
    motion = {name: getattr(stepping_plan.motion, name)[frames] for name in ("t", "q", "v")}
    return replace(
        stepping_plan,
        effectors=EFFECTORS[:2],
        half_extent=stepping_plan.half_extent[:2],
        contacts=_rows(stepping_plan.contacts, 2),
        stances=stepping_plan.stances[:1, :2],
        phases=PlanPhases(np.array([0.0]), np.array([0.3]), stepping_plan.phases.contact[:1, :2]),
        centroidal=PlanCentroidal(**course),
        motion=replace(stepping_plan.motion, **motion),
    )


def _rows(contacts: PlanContacts, count: int) -> PlanContacts:
    fields = ("X_WC", "effector", "surface", "friction", "support")
    return PlanContacts(**{name: getattr(contacts, name)[:count] for name in fields})


@pytest.fixture(scope="session")
def wriggling_plan() -> Callable[[Robot], Plan]:
    """Makes a plan of any robot."""
    return make_wriggling_plan


def make_wriggling_plan(robot: Robot) -> Plan:
    """A robot whose feet are on the floor at first, and whose joints then go somewhere; nothing in it is physical."""
    plant, rng = build_plant(robot).plant, np.random.default_rng(1)
    q = np.tile(nominal_posture(robot), (4, 1))
    low, high = plant.GetPositionLowerLimits()[7:], plant.GetPositionUpperLimits()[7:]
    q[1:, 7:] = np.clip(q[1:, 7:] + rng.normal(0.0, 0.3, (3, q.shape[1] - 7)), low, high)
    q[1:, :4] += rng.normal(0.0, 0.2, (3, 4))
    q[:, :4] /= np.linalg.norm(q[:, :4], axis=1, keepdims=True)
    t = 0.1 * np.arange(4)
    poses = body_poses(robot, q[:1], EFFECTORS[:2])
    held = np.array([[0, 1, -1, -1]])
    weight = np.zeros((4, 4, 3))
    weight[:, :2, 2] = robot.mass * 9.81 / 2
    nv = plant.num_velocities()
    return Plan(
        robot=robot.name,
        robot_model=str(robot.model),
        robot_model_sha256=robot.model_sha256,
        mass=robot.mass,
        friction_cone="inner",
        scene_name="floor",
        scene_yaml=ON_THE_FLOOR,
        triangles=np.zeros((0, 3, 3)),
        half_extent=robot.half_extents,
        contacts=PlanContacts(
            np.array([poses[name][0] for name in EFFECTORS[:2]]), np.array([0, 1]), np.array([0, 0]), np.full(2, 0.5)
        ),
        stances=held,
        phases=PlanPhases(np.array([0.0]), np.array([0.3]), held),
        centroidal=PlanCentroidal(
            t,
            np.tile([0.0, 0.0, robot.com_height[1]], (4, 1)),
            np.zeros((4, 3)),
            np.zeros((4, 3)),
            np.repeat(held, 4, axis=0),
            weight,
            np.zeros((4, 4, 2)),
            np.zeros((4, 4)),
        ),
        motion=PlanMotion(
            t,
            q,
            rng.normal(0.0, 1.0, (4, nv)),
            tuple(plant.GetPositionNames()),
            tuple(plant.GetVelocityNames()),
            np.zeros((4, plant.num_actuators())),
            tuple(plant.get_joint_actuator(a).name() for a in plant.GetJointActuatorIndices()),
        ),
    )
