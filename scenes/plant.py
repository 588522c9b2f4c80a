"""Drake's plant of a robot, with the terrain in SceneGraph for collision and display."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from pydrake.multibody.parsing import Parser
from pydrake.multibody.plant import AddMultibodyPlantSceneGraph, MultibodyPlant
from pydrake.systems.framework import Context, Diagram, DiagramBuilder
from pydrake.geometry import Meshcat, SceneGraph
from pydrake.math import RigidTransform

from scenes.robot import Robot
from scenes.terrain import Terrain


@dataclass(frozen=True, eq=False)
class RobotPlant:
    """A finished diagram of one robot on one terrain (or none).

    Attributes:
        robot: whose model it is.
        plant: robot positions first, so q is the same with and without terrain.
        scene_graph: robot and terrain, roles proximity and illustration.
        diagram: both.
    """

    robot: Robot
    plant: MultibodyPlant
    scene_graph: SceneGraph
    diagram: Diagram

    def new_context(self) -> Context:
        """A fresh context of the diagram."""
        return self.diagram.CreateDefaultContext()

    def nominal_positions(self) -> np.ndarray:
        """(nq,) the nominal posture with the soles at z = 0 and the mean of the feet at the origin."""
        context = self.plant.CreateDefaultContext()
        for name, angle in self.robot.nominal.items():
            self.plant.GetJointByName(name).set_angle(context, angle)
        base = self.plant.GetBodyByName(self.robot.base_body)
        self.plant.SetFreeBodyPose(context, base, RigidTransform())
        feet = [self.plant.GetBodyByName(e.frame) for e in self.robot.effectors[:2]]
        p_BF = [self.plant.EvalBodyPoseInWorld(context, f).translation() for f in feet]
        self.plant.SetFreeBodyPose(context, base, RigidTransform(-np.mean(p_BF, axis=0)))
        return self.plant.GetPositions(context).copy()


def build_plant(robot: Robot, terrain: Terrain | None = None, *, meshcat: Meshcat | None = None) -> RobotPlant:
    """Parses the robot and puts the terrain around it."""
    builder = DiagramBuilder()
    plant, scene_graph = AddMultibodyPlantSceneGraph(builder, time_step=1e-3)
    Parser(plant).AddModels(str(robot.model))
    plant.Finalize()
    return RobotPlant(robot, plant, scene_graph, builder.Build())
