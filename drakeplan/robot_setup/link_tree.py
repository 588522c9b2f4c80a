"""A robot model as a tree of links: masses, joints, and the points of its collision shapes, seen at its zero posture."""

# pydrake's stubs read "float64[3, 1]" as a shape and refuse every array.
# pyright: reportArgumentType=false, reportCallIssue=false, reportAttributeAccessIssue=false, reportReturnType=false

from __future__ import annotations

import contextlib
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from pydrake.geometry import Box, Capsule, Cylinder, Ellipsoid, GeometryId, Role, SceneGraphInspector, Sphere
from pydrake.math import RigidTransform, RotationMatrix
from pydrake.multibody.plant import AddMultibodyPlantSceneGraph, MultibodyPlant
from pydrake.multibody.tree import RigidBody
from pydrake.systems.framework import Context, Diagram, DiagramBuilder

from scenes.robots.drake_parser import add_model, reading
from scenes.robots.solid_points import solid_points


@dataclass(frozen=True, eq=False)
class Link:
    """A rigid part of the robot: a body with everything that is welded to it.

    Attributes:
        name: of its heaviest body.
        moved: the body that the joint moves; the others are welded to it.
        bodies: names of all bodies in it.
        parent: name of the link it hangs on, None for the base.
        joint: name of the joint between the two, None for the base.
        mass: [kg].
        points: (N, 3) corners of its collision shapes in W at the zero posture [m]; of what is drawn where it has none.
        drawn_only: whether the points come from what is drawn.
        drawn: body that is drawn and has no collision shape -> (N, 3) corners of what is drawn, as `points`.
    """

    name: str
    moved: str
    bodies: tuple[str, ...]
    parent: str | None
    joint: str | None
    mass: float
    points: np.ndarray
    drawn_only: bool
    drawn: dict[str, np.ndarray] = field(default_factory=dict)


@dataclass(frozen=True, eq=False)
class LinkTree:
    """All links of a robot whose base stands at the world's origin, every joint at 0 (or at the nearest limit).

    Attributes:
        links: by name.
        plant: of the robot alone, finalized.
        diagram: the plant with its geometry.
        context: of the plant, at the zero posture.
        root: name of the base's link.
    """

    links: dict[str, Link]
    plant: MultibodyPlant
    diagram: Diagram
    context: Context
    root: str
    _children: dict[str, tuple[str, ...]] = field(default_factory=dict, repr=False)

    def children(self, name: str) -> tuple[str, ...]:
        """Names of the links that hang on this one."""
        if not self._children:
            self._children.update({n: tuple(k for k, c in self.links.items() if c.parent == n) for n in self.links})
        return self._children[name]

    def below(self, name: str) -> list[str]:
        """This link and all that hang on it."""
        found = [name]
        for child in self.children(name):
            found += self.below(child)
        return found

    def way(self, name: str) -> list[str]:
        """Links from the base to this one, both included."""
        way = [name]
        while (parent := self.links[way[0]].parent) is not None:
            way.insert(0, parent)
        return way

    def origin(self, name: str) -> np.ndarray:
        """(3,) where the link's joint moves it: the origin of its body's frame in W [m]."""
        return self.pose(name)[:3, 3]

    def pose(self, body: str) -> np.ndarray:
        """(4, 4) pose of a body in W."""
        return self.plant.EvalBodyPoseInWorld(self.context, self.plant.GetBodyByName(body)).GetAsMatrix4()

    @contextlib.contextmanager
    def posture(self, q: np.ndarray) -> Iterator[None]:
        """Inside, the robot has the positions q (nq,); after it, those of before."""
        before = self.plant.GetPositions(self.context).copy()
        self.plant.SetPositions(self.context, q)
        try:
            yield
        finally:
            self.plant.SetPositions(self.context, before)

    def axis(self, joint: str) -> np.ndarray:
        """(3,) axis of a joint in W."""
        found = self.plant.GetJointByName(joint)
        local = found.translation_axis() if found.type_name() == "prismatic" else found.revolute_axis()
        return found.frame_on_child().CalcPoseInWorld(self.context).rotation() @ local


def read_tree(model: Path, R_WB: np.ndarray | None = None) -> LinkTree:
    """Reads a URDF that Drake's parser loads alone.

    Args:
        model: the file.
        R_WB: (3, 3) how the base stands in W, None for along its axes.

    Raises:
        InputError: Drake cannot make a plant of it.
    """
    builder = DiagramBuilder()
    plant, scene_graph = AddMultibodyPlantSceneGraph(builder, time_step=0.0)
    add_model(plant, model)
    with reading(model):
        plant.Finalize()
    diagram = builder.Build()
    context = plant.GetMyContextFromRoot(diagram.CreateDefaultContext())
    q = np.clip(np.zeros(plant.num_positions()), plant.GetPositionLowerLimits(), plant.GetPositionUpperLimits())
    q[:7] = (1, 0, 0, 0, 0, 0, 0)
    plant.SetPositions(context, q)
    if R_WB is not None:
        (base,) = plant.GetFloatingBaseBodies()
        plant.SetFreeBodyPose(context, plant.get_body(base), RigidTransform(RotationMatrix(R_WB), np.zeros(3)))
    return LinkTree(_links(plant, scene_graph.model_inspector(), context), plant, diagram, context, _root(plant))


def _root(plant: MultibodyPlant) -> str:
    (base,) = plant.GetFloatingBaseBodies()
    return _name(plant.GetBodiesWeldedTo(plant.get_body(base)))


def _name(bodies: list[RigidBody]) -> str:
    """The heaviest body stands for all that are welded to it; the first of them where none has a mass."""
    return max(bodies, key=lambda b: b.default_mass() if b.default_mass() > 0.0 else 0.0).name()


def _links(plant: MultibodyPlant, inspector: SceneGraphInspector, context: Context) -> dict[str, Link]:
    links: dict[str, Link] = {}
    done: set[str] = set()
    joints = {}
    for index in plant.GetJointIndices():
        joint = plant.get_joint(index)
        if joint.num_positions() == 1:
            joints[joint.child_body().name()] = joint
    for index in plant.GetBodyIndices(plant.get_body(next(iter(plant.GetFloatingBaseBodies()))).model_instance()):
        body = plant.get_body(index)
        if body.name() in done:
            continue
        bodies = plant.GetBodiesWeldedTo(body)
        done |= {b.name() for b in bodies}
        joint = next((joints[b.name()] for b in bodies if b.name() in joints), None)
        points, drawn_only = _points(plant, inspector, context, bodies)
        name = _name(bodies)
        links[name] = Link(
            name=name,
            moved=_name(bodies) if joint is None else joint.child_body().name(),
            bodies=tuple(b.name() for b in bodies),
            parent=None if joint is None else _name(plant.GetBodiesWeldedTo(joint.parent_body())),
            joint=None if joint is None else joint.name(),
            mass=sum(b.default_mass() for b in bodies),
            points=points,
            drawn_only=drawn_only,
            drawn={
                b.name(): _points(plant, inspector, context, [b])[0]
                for b in bodies
                if _is_drawn_only(plant, inspector, b)
            },
        )
    return links


def _is_drawn_only(plant: MultibodyPlant, inspector: SceneGraphInspector, body: RigidBody) -> bool:
    frame = plant.GetBodyFrameIdOrThrow(body.index())
    proximity, illustration = (inspector.GetGeometries(frame, r) for r in (Role.kProximity, Role.kIllustration))
    return bool(illustration) and not proximity


def _points(
    plant: MultibodyPlant, inspector: SceneGraphInspector, context: Context, bodies: list[RigidBody]
) -> tuple[np.ndarray, bool]:
    for role in (Role.kProximity, Role.kIllustration):
        parts = []
        for body in bodies:
            X_WB = plant.EvalBodyPoseInWorld(context, body)
            for geometry in inspector.GetGeometries(plant.GetBodyFrameIdOrThrow(body.index()), role):
                X_WG = X_WB @ inspector.GetPoseInFrame(geometry)
                parts.append((X_WG.rotation().matrix() @ shape_points(inspector, geometry).T).T + X_WG.translation())
        if parts:
            return np.concatenate(parts), role == Role.kIllustration
    return np.zeros((0, 3)), False


def shape_points(inspector: SceneGraphInspector, geometry: GeometryId) -> np.ndarray:
    """(N, 3) points whose convex hull is a geometry's shape in its own frame, or nearly so where it is round [m].

    Args:
        inspector: of the scene graph that holds it.
        geometry: which one.
    """
    shape = inspector.GetShape(geometry)
    if isinstance(shape, Box):
        return solid_points("box", shape.size())
    if isinstance(shape, Sphere):
        return solid_points("sphere", [shape.radius()])
    if isinstance(shape, Ellipsoid):
        return solid_points("ellipsoid", [shape.a(), shape.b(), shape.c()])
    if isinstance(shape, Capsule | Cylinder):
        kind = "capsule" if isinstance(shape, Capsule) else "cylinder"
        return solid_points(kind, [shape.radius(), shape.length()])
    hull = inspector.GetConvexHull(geometry)
    return np.array([hull.vertex(i) for i in range(hull.num_vertices())]) if hull else np.zeros((0, 3))
