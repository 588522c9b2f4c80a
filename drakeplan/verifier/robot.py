"""The robot's model as Drake loads it."""

# pydrake's stubs read "float64[m, 1]" as a shape and refuse every array.
# pyright: reportArgumentType=false, reportCallIssue=false, reportReturnType=false

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from pydrake.multibody.parsing import Parser
from pydrake.multibody.plant import AddMultibodyPlantSceneGraph
from pydrake.multibody.tree import RigidBody
from pydrake.systems.framework import DiagramBuilder

from .geometry import in_world, patch
from .limits import (
    EFFECTORS,
    PATCH_OFF_BODY,
)
from .plan_file import PlanFile, UnreadablePlan
from .report import Sheet


@dataclass(frozen=True, eq=False)
class BodyBoxes:
    """Boxes around the S collision shapes of a robot.

    Attributes:
        bodies: the B bodies that have any.
        body: (S,) index of each shape's body among these.
        X_BO: (S, 4, 4) pose of each box's middle in the body [m].
        half: (S, 3) half edges [m].
    """

    bodies: tuple[RigidBody, ...]
    body: np.ndarray
    X_BO: np.ndarray
    half: np.ndarray


class RobotModel:
    """The robot as Drake's parser gives it.

    Attributes:
        frames: of the end effectors, in their order.
        mass: of the whole robot [kg].
        actuator_names: (A,) names.
        actuated: (A,) index of each actuator's joint among the velocities.
        effort: (A,) greatest torque of each actuator [N m].
    """

    def __init__(self, model: Path) -> None:
        self.model = model
        builder = DiagramBuilder()
        self.plant, self.scene_graph = AddMultibodyPlantSceneGraph(builder, time_step=0.0)
        try:
            Parser(self.plant).AddModels(model)
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

    def body_boxes(self) -> BodyBoxes:
        """The bodies that have collision shapes, and a box around each shape.

        Raises:
            UnreadablePlan: a shape without bounds.
        """
        inspector, bodies = self.scene_graph.model_inspector(), []
        body_of, poses, halves = [], [], []
        for index in self.plant.GetBodyIndices(self.frames[0].model_instance()):
            body = self.plant.get_body(index)
            shapes = self.plant.GetCollisionGeometriesForBody(body)
            for geometry in shapes:
                obb = inspector.GetObbInGeometryFrame(geometry)
                if obb is None:
                    raise UnreadablePlan(f"{self.model}: {body.name()}: expected collision shapes of finite size")
                body_of.append(len(bodies))
                poses.append((inspector.GetPoseInFrame(geometry) @ obb.pose()).GetAsMatrix4())
                halves.append(obb.half_width())
            if shapes:
                bodies.append(body)
        return BodyBoxes(
            tuple(bodies),
            np.array(body_of, dtype=int),
            np.array(poses).reshape(-1, 4, 4),
            np.array(halves).reshape(-1, 3),
        )

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
    used = set(plan["contacts/effector"].tolist())
    for e, frame in enumerate(robot.frames):
        if e not in used and not plan["effectors_half_extent"][e].any():  # a palm that the robot does not have
            distances[e] = 0.0
            continue
        welded = robot.plant.GetBodiesWeldedTo(frame.body())
        own = {g for body in welded for g in robot.plant.GetCollisionGeometriesForBody(body)}
        X_WE = frame.CalcPoseInWorld(robot.plant_context).GetAsMatrix4()
        for k, corner in enumerate(in_world(X_WE, patch(plan["effectors_half_extent"][e]))):
            found = [d.distance for d in query.ComputeSignedDistanceToPoint(corner) if d.id_G in own]
            distances[e, k] = min(found, default=np.nan)
    sheet.add("patch on robot", distances, PATCH_OFF_BODY, "m", lambda i: EFFECTORS[i[0]])
