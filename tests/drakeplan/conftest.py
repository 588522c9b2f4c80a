"""A made-up plan with everything in it that can be shown: feet on stones, palms on panels, forces, a moving robot.

Nothing here is physical. It is for what reads plans without judging them: playback and the command line.
"""

from __future__ import annotations

import numpy as np
import pytest
from scenes.scene_file import scene_to_yaml

from drakeplan.plan import Plan, PlanCentroidal, PlanMotion, PlanPhases, tabulate_stances
from scenes.contact import Contact, contact_pose
from scenes.effector import EFFECTORS, LEFT_FOOT, LEFT_PALM, RIGHT_FOOT, RIGHT_PALM
from scenes.library.rubble_corridor import named as rubble_corridor
from scenes.plant import build_plant
from scenes.robot import load_robot
from scenes.stance import Stance

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
    q = np.tile(robot.q_nominal, (len(t), 1))
    standing = _com(stances, 0.0) * [1, 1, 0] + [0.0, 0.0, 0.93]
    q[:, 4:7] += np.array([_com(stances, instant) for instant in t]) - standing
    names = tuple(plant.GetPositionNames())
    for name, swing in (("left_shoulder_pitch", 0.4), ("right_shoulder_pitch", -0.4)):
        joint = next(i for i, n in enumerate(names) if name in n)
        q[:, joint] += swing * np.sin(np.pi * t / STANCE_TIME)
    velocity_names = tuple(plant.GetVelocityNames())
    return PlanMotion(t, q, np.zeros((len(t), len(velocity_names))), names, velocity_names)
