"""Assembles a plan from its parts; every planner ends here."""

from __future__ import annotations

import dataclasses
import sys
from collections.abc import Mapping, Sequence
from importlib.metadata import version

import numpy as np

from drakeplan.motion.maker import MotionResult
from drakeplan.plan.plan import Plan, PlanCentroidal, PlanMotion, PlanPhases, tabulate_stances
from optimization.balance.friction import FrictionCone
from scenes.files.scene_file import scene_to_yaml
from scenes.robots.robot import Robot
from scenes.scene import Scene
from scenes.stance import Stance

PACKAGES = ("drakeplan", "drake", "numpy", "numba", "scipy")


def assemble_plan(
    scene: Scene,
    robot: Robot,
    stances: Sequence[Stance],
    motion: MotionResult | None,
    *,
    cone: FrictionCone,
    provenance: Mapping[str, object],
) -> Plan:
    """The plan of a contact sequence, complete where there is a motion with dynamics.

    Args:
        scene: with the start, goal and friction that were used.
        robot: who moves.
        stances: the contact sequence.
        motion: None for the contacts alone.
        cone: friction cone.
        provenance: what made it; versions are added.
    """
    contacts, table = tabulate_stances(stances)
    phases = centroidal = whole_body = None
    if motion is not None and motion.centroidal is not None:
        schedule, c = motion.schedule, motion.centroidal
        carried = np.array([p.contacts for p in schedule.phases])
        phases = PlanPhases(schedule.boundaries[:-1], schedule.boundaries[1:], carried)
        centroidal = PlanCentroidal(
            c.t, c.com, c.linear_momentum, c.angular_momentum, c.contact, c.force_W, c.cop_C, c.torque_n
        )
        names = motion.position_names, motion.velocity_names, motion.actuator_names
        whole_body = PlanMotion(motion.t, motion.q, motion.v, *names[:2], motion.tau, names[2])
    return Plan(
        robot=robot.name,
        robot_model=str(robot.model),
        robot_model_sha256=robot.model_sha256,
        mass=robot.mass,
        friction_cone=FrictionCone(cone).value,
        scene_name=scene.name,
        scene_yaml=scene_to_yaml(_on_the_ground(scene, stances[0]), meshes_as_surfaces=True),
        triangles=scene.terrain.triangles,
        half_extent=np.array([e.half_extent for e in robot.effectors]),
        contacts=contacts,
        stances=table,
        phases=phases,
        centroidal=centroidal,
        motion=whole_body,
        provenance={"versions": versions(), **provenance},
    )


def versions() -> dict[str, str]:
    """Of what a plan depends on."""
    return {name: version(name) for name in PACKAGES} | {"python": sys.version.split()[0]}


def _on_the_ground(scene: Scene, stance: Stance) -> Scene:
    """The scene with a start on the ground: a start given in plan view leaves the height open, no scene file can."""
    start = scene.start
    if start is None or np.isfinite(start.xyz[2]):
        return scene
    height = float(stance.feet_mean()[2])
    return dataclasses.replace(scene, start=dataclasses.replace(start, xyz=(*start.xyz[:2], height)))
