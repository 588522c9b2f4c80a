"""A robot as Drake sees it, in plain data: a tree of bodies with joints, inertias and shapes."""

# pydrake's stubs read "float64[m, 1]" as a shape and refuse every array.
# pyright: reportArgumentType=false, reportCallIssue=false, reportAttributeAccessIssue=false

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Literal

import numpy as np
from pydrake.geometry import (
    Box,
    Capsule,
    Convex,
    Cylinder,
    Ellipsoid,
    GeometryId,
    Mesh,
    Rgba,
    Role,
    SceneGraphInspector,
    Sphere,
)
from pydrake.math import RigidTransform
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import Joint, PrismaticJoint, RevoluteJoint, RigidBody, WeldJoint

from scenes.input_error import InputError
from scenes.meshes.mesh_file import read_mesh
from scenes.robots.plant import build_plant
from scenes.robots.robot import Robot

GREY = (0.7, 0.7, 0.72, 1.0)
Kind = Literal["box", "sphere", "cylinder", "capsule", "ellipsoid", "mesh", "hull"]


@dataclass(frozen=True, eq=False)
class BodyShape:
    """A shape on a body, for display or for collision.

    Attributes:
        kind: of `size`: edges of a box; radius of a sphere; radius and length of a cylinder or capsule (between its two
            half spheres); three half axes of an ellipsoid; nothing for a mesh or a hull.
        size: [m].
        X_BG: (4, 4) pose in the body's frame.
        colour: red, green, blue, alpha in [0, 1].
        points: (K, 3, 3) triangles of a mesh, (V, 3) corners of a hull, in the frame G [m].
    """

    kind: Kind
    size: tuple[float, ...]
    X_BG: np.ndarray
    colour: tuple[float, float, float, float]
    points: np.ndarray


@dataclass(frozen=True)
class BodyJoint:
    """A joint of one degree of freedom that moves a body.

    Attributes:
        name: of the joint.
        sliding: whether it slides; else it turns.
        axis: (3,) in the body's frame.
        anchor: (3,) a point on the axis in the body's frame [m].
        limits: least and greatest position [rad, m].
        speed: greatest velocity [rad/s, m/s].
        effort: greatest torque or force of its motor [N m, N]; None without a motor.
        damping: [N m s, N s/m].
    """

    name: str
    sliding: bool
    axis: np.ndarray
    anchor: np.ndarray
    limits: tuple[float, float]
    speed: float
    effort: float | None
    damping: float


@dataclass(frozen=True, eq=False)
class Body:
    """One rigid body.

    Attributes:
        name: of the link.
        parent: name of the body it hangs on, None for the floating base.
        X_PB: (4, 4) pose in the parent with the joint at 0.
        joint: None for the base and for bodies that are welded to their parent.
        mass: [kg].
        com: (3,) in the body's frame [m].
        inertia: (3, 3) about the centre of mass, in the body's frame [kg m^2].
        looks: shapes for display.
        collision: shapes for collision.
    """

    name: str
    parent: str | None
    X_PB: np.ndarray
    joint: BodyJoint | None
    mass: float
    com: np.ndarray
    inertia: np.ndarray
    looks: tuple[BodyShape, ...]
    collision: tuple[BodyShape, ...]


@lru_cache(maxsize=4)
def robot_bodies(robot: Robot) -> tuple[Body, ...]:
    """All bodies, parents before children, joints in the order of Drake's positions.

    Raises:
        InputError: a joint that neither turns, slides nor is fixed.
    """
    built = build_plant(robot)
    plant, inspector = built.plant, built.scene_graph.model_inspector()
    base = plant.GetBodyByName(robot.base_body)
    world = plant.world_body().index()
    above = {}
    for index in plant.GetJointIndices():
        joint = plant.get_joint(index)
        if world not in (joint.parent_body().index(), joint.child_body().index()):
            above[joint.child_body().name()] = joint
    order = _depth_first(plant, base, above)
    return tuple(_body(plant, inspector, body, above.get(body.name())) for body in order)


def filtered_pairs(robot: Robot) -> list[tuple[str, str]]:
    """Names of the pairs of bodies with collision shapes that the model lets pass through each other."""
    built = build_plant(robot)
    plant, inspector = built.plant, built.scene_graph.model_inspector()
    solid = [
        (body.name(), plant.GetCollisionGeometriesForBody(body)[0])
        for body in (plant.get_body(i) for i in plant.GetBodyIndices(_instance(plant, robot)))
        if plant.GetCollisionGeometriesForBody(body)
    ]
    return [
        (a, b)
        for k, (a, first) in enumerate(solid)
        for b, second in solid[k + 1 :]
        if inspector.CollisionFiltered(first, second)
    ]


def _instance(plant: MultibodyPlant, robot: Robot):  # noqa: ANN202  (Drake's index type)
    return plant.GetBodyByName(robot.base_body).model_instance()


def _depth_first(plant: MultibodyPlant, base: RigidBody, above: dict[str, Joint]) -> list[RigidBody]:
    below: dict[str, list[str]] = {}
    for child, joint in above.items():
        below.setdefault(joint.parent_body().name(), []).append(child)

    def first_velocity(name: str) -> int:
        own = above[name]
        starts = [own.velocity_start()] if own.num_velocities() else []
        return min([*starts, *map(first_velocity, below.get(name, ()))], default=plant.num_velocities())

    def walk(name: str) -> Iterator[str]:
        yield name
        for child in sorted(below.get(name, ()), key=first_velocity):
            yield from walk(child)

    return [plant.GetBodyByName(name) for name in walk(base.name())]


def _body(plant: MultibodyPlant, inspector: SceneGraphInspector, body: RigidBody, joint: Joint | None) -> Body:
    inertia = body.default_spatial_inertia()
    mass, com = inertia.get_mass(), np.array(inertia.get_com())
    about_com = np.zeros((3, 3))
    if mass > 0.0:
        about_origin = inertia.CalcRotationalInertia().CopyToFullMatrix3()
        about_com = about_origin - mass * ((com @ com) * np.eye(3) - np.outer(com, com))
    frame = plant.GetBodyFrameIdOrThrow(body.index())
    shapes = {
        role: tuple(_shape(inspector, g, role) for g in inspector.GetGeometries(frame, role))
        for role in (Role.kIllustration, Role.kProximity)
    }
    X_PB, parent = np.eye(4), None
    if joint is not None:
        X_PJ = joint.frame_on_parent().GetFixedPoseInBodyFrame()
        X_JB = joint.frame_on_child().GetFixedPoseInBodyFrame().inverse()
        between = joint.X_FM() if joint.type_name() == WeldJoint.kTypeName else RigidTransform()
        X_PB, parent = (X_PJ @ between @ X_JB).GetAsMatrix4(), joint.parent_body().name()
    moving = None if joint is None or joint.num_velocities() == 0 else _joint(plant, joint)
    return Body(
        body.name(), parent, X_PB, moving, mass, com, about_com, shapes[Role.kIllustration], shapes[Role.kProximity]
    )


def _joint(plant: MultibodyPlant, joint: Joint) -> BodyJoint:
    if isinstance(joint, RevoluteJoint):
        axis = np.array(joint.revolute_axis())
    elif isinstance(joint, PrismaticJoint):
        axis = np.array(joint.translation_axis())
    else:
        raise InputError(f"joint {joint.name()!r} is {joint.type_name()}, expected revolute, prismatic or fixed")
    X_BJ = joint.frame_on_child().GetFixedPoseInBodyFrame()
    motors = [plant.get_joint_actuator(a) for a in plant.GetJointActuatorIndices()]
    motor = next((m for m in motors if m.joint().index() == joint.index()), None)
    return BodyJoint(
        name=joint.name(),
        sliding=isinstance(joint, PrismaticJoint),
        axis=X_BJ.rotation().matrix() @ axis,
        anchor=X_BJ.translation(),
        limits=(float(joint.position_lower_limits()[0]), float(joint.position_upper_limits()[0])),
        speed=float(joint.velocity_upper_limits()[0]),
        effort=None if motor is None else float(motor.effort_limit()),
        damping=float(joint.default_damping_vector()[0]),
    )


def _shape(inspector: SceneGraphInspector, geometry: GeometryId, role: Role) -> BodyShape:
    X_BG = inspector.GetPoseInFrame(geometry).GetAsMatrix4()
    kind, size, points = _kind(inspector, geometry, role)
    properties = inspector.GetIllustrationProperties(geometry)
    colour = Rgba(*GREY) if properties is None else properties.GetPropertyOrDefault("phong", "diffuse", Rgba(*GREY))
    return BodyShape(kind, size, X_BG, (colour.r(), colour.g(), colour.b(), colour.a()), points)


def _kind(
    inspector: SceneGraphInspector, geometry: GeometryId, role: Role
) -> tuple[Kind, tuple[float, ...], np.ndarray]:
    shape, none = inspector.GetShape(geometry), np.zeros((0, 3))
    if isinstance(shape, Box):
        return "box", tuple(map(float, shape.size())), none
    if isinstance(shape, Sphere):
        return "sphere", (shape.radius(),), none
    if isinstance(shape, Cylinder | Capsule):
        kind: Kind = "capsule" if isinstance(shape, Capsule) else "cylinder"
        return kind, (shape.radius(), shape.length()), none
    if isinstance(shape, Ellipsoid):
        return "ellipsoid", (shape.a(), shape.b(), shape.c()), none
    if role == Role.kIllustration and isinstance(shape, Mesh | Convex) and shape.source().is_path():
        return "mesh", (), read_mesh(Path(shape.source().path())) * np.array(shape.scale3())
    hull = inspector.GetConvexHull(geometry)
    if hull is None:
        raise InputError(f"the robot's model has a shape {type(shape).__name__}, which cannot be exported")
    return "hull", (), np.array([hull.vertex(i) for i in range(hull.num_vertices())])
