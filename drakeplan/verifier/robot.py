"""The robot's model as Drake loads it."""

# pydrake's stubs read "float64[m, 1]" as a shape and refuse every array.
# pyright: reportArgumentType=false, reportCallIssue=false, reportReturnType=false

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from pydrake.geometry import Convex
from pydrake.math import RigidTransform
from pydrake.multibody.parsing import Parser
from pydrake.multibody.plant import AddMultibodyPlantSceneGraph, CoulombFriction
from pydrake.multibody.tree import RigidBody
from pydrake.systems.framework import DiagramBuilder

from .geometry import corners
from .limits import (
    EFFECTORS,
    PATCH_OFF_BODY,
)
from .plan_file import PlanFile, UnreadablePlan
from .report import Sheet


class RobotModel:
    """The robot as Drake's parser gives it, with solids around it on the world body.

    Attributes:
        frames: of the end effectors, in their order.
        mass: of the whole robot [kg].
        actuator_names: (A,) names.
        actuated: (A,) index of each actuator's joint among the velocities.
        effort: (A,) greatest torque of each actuator [N m].
    """

    def __init__(self, model: Path, solids: Sequence[np.ndarray] = ()) -> None:
        self.model = model
        builder = DiagramBuilder()
        self.plant, self.scene_graph = AddMultibodyPlantSceneGraph(builder, time_step=0.0)
        try:
            Parser(self.plant).AddModels(model)
            for k, points in enumerate(solids):
                hull, name, friction = Convex(points.T, "solid"), f"solid {k}", CoulombFriction(1.0, 1.0)
                self.plant.RegisterCollisionGeometry(self.plant.world_body(), RigidTransform(), hull, name, friction)
            self.plant.Finalize()
            frames = [self.plant.GetFrameByName(name) for name in EFFECTORS]
        except RuntimeError as error:
            raise UnreadablePlan(f"{model}: not a model of this robot ({error})") from None
        base = list(self.plant.GetFloatingBaseBodies())
        free = [self.plant.get_body(index) for index in base]
        if len(free) != 1 or not free[0].has_quaternion_dofs() or free[0].floating_positions_start() != 0:
            raise UnreadablePlan(f"{model}: expected a model with one floating base whose positions come first")
        self.frames = frames
        self.diagram = builder.Build()
        self.context = self.diagram.CreateDefaultContext()
        self.plant_context = self.plant.GetMyMutableContextFromRoot(self.context)
        self.scene_context = self.scene_graph.GetMyContextFromRoot(self.context)
        self.mass = self.plant.CalcTotalMass(self.plant_context)
        actuators = [self.plant.get_joint_actuator(index) for index in self.plant.GetJointActuatorIndices()]
        self.actuator_names = [actuator.name() for actuator in actuators]
        self.actuated = np.array([actuator.joint().velocity_start() for actuator in actuators], dtype=int)
        self.effort = np.array([actuator.effort_limit() for actuator in actuators])

    def colliding_bodies(self) -> tuple[list[RigidBody], np.ndarray]:
        """The bodies that have collision shapes, and (B,) radii about their origins that hold the shapes [m]."""
        inspector, bodies, radii = self.scene_graph.model_inspector(), [], []
        for index in self.plant.GetBodyIndices(self.frames[0].model_instance()):
            body, reach = self.plant.get_body(index), 0.0
            for geometry in self.plant.GetCollisionGeometriesForBody(body):
                obb = inspector.GetObbInGeometryFrame(geometry)
                centre = (inspector.GetPoseInFrame(geometry) @ obb.pose()).translation() if obb else np.zeros(3)
                reach = max(reach, np.linalg.norm(centre) + np.linalg.norm(obb.half_width()) if obb else np.inf)
            if reach:
                bodies.append(body)
                radii.append(reach)
        return bodies, np.array(radii)

    @property
    def carriers(self) -> frozenset[int]:
        """Indices of the bodies that carry a sole or a palm."""
        return frozenset(int(b.index()) for f in self.frames for b in self.plant.GetBodiesWeldedTo(f.body()))


def check_patches_on_robot(sheet: Sheet, plan: PlanFile, robot: RobotModel) -> None:
    """Corners of the patches against the bodies that should carry them: too large a sole would balance anything.

    Args:
        sheet: takes the checks.
        plan: the plan file.
        robot: the robot's model.
    """
    query = robot.scene_graph.get_query_output_port().Eval(robot.scene_context)
    distances = np.full((4, 4), np.nan)
    for e, frame in enumerate(robot.frames):
        welded = robot.plant.GetBodiesWeldedTo(frame.body())
        own = {g for body in welded for g in robot.plant.GetCollisionGeometriesForBody(body)}
        X_WE = frame.CalcPoseInWorld(robot.plant_context).GetAsMatrix4()
        for k, corner in enumerate(corners(X_WE, plan["effectors_half_extent"][e])):
            found = [d.distance for d in query.ComputeSignedDistanceToPoint(corner) if d.id_G in own]
            distances[e, k] = min(found, default=np.nan)
    sheet.add("patch on robot", distances, PATCH_OFF_BODY, "m", lambda i: EFFECTORS[i[0]])
