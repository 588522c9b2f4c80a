"""A plan's terrain and robot in Drake's discrete physics.

Soles and palms touch with small spheres at the corners of their patches and of every support that the plan uses: the
pressure of a stiff sole on a stiff stone is not spread evenly, and evenly spread pressure holds half the yaw torque.
Rectangles are Boxes, on which spheres are exact. Other polygons are Convex bodies. Of a sphere near their edge Drake's
collision library returns the face that the ray from the body's middle through the sphere leaves by: on a plate of 3 cm the
side, up to 1 cm and more from the edge; on a body as deep as it is wide always the top. Those that the plan stands on are as
deep as nothing forbids.
"""

# pydrake's stubs read "float64[m, 1]" as a shape and refuse every array.
# pyright: reportArgumentType=false, reportCallIssue=false

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from pydrake.geometry import (
    AddContactMaterial,
    Box,
    CollisionFilterDeclaration,
    Convex,
    GeometrySet,
    ProximityProperties,
    Role,
    Sphere,
)
from pydrake.math import RigidTransform, RotationMatrix
from pydrake.multibody.parsing import Parser
from pydrake.multibody.plant import AddMultibodyPlant, CoulombFriction, MultibodyPlantConfig
from pydrake.multibody.tree import BodyIndex
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder
from scipy.spatial import ConvexHull

from drakeplan.motion.resting_place import inset
from drakeplan.plan.plan import Plan
from scenes.effector import is_foot
from scenes.files.scene_file import scene_from_yaml
from scenes.terrain.surface import Surface
from scenes.terrain.terrain import Box as BoxObstacle

PLATE = 0.03  # [m] thickness of a rectangle, down from its face
SLAB, WALL = 0.03, 0.20  # [m] the same of another polygon, and of one that palms use
DEPTHS = (2.0, 1.0, 0.5, 0.25)  # of one that feet use, in units of its radius: the first in which no other contact lies
CLEAR = 0.02  # [m] over its surface that a contact needs free
CORNER = 0.004  # [m] radius of the spheres that touch
RING = [(1, 1), (0, 1), (-1, 1), (-1, 0), (-1, -1), (0, -1), (1, -1), (1, 0)]  # of a patch, in half extents
NEIGHBOURS = 3  # joints up the limb: links up to there do not collide with its patch
INNER = 0.75  # size of a second ring
APART = 0.01  # [m] spheres nearer than this to one that is there already are left out
INSET = 0.008  # [m] from the edge of a support, where others touch: a foot never lands exactly
FOOT_DEPTH, PALM_DEPTH = 0.03, 0.02  # [m] of the box behind a patch
GRIP = (
    1e6  # friction of the robot: Drake combines two as 2 m n / (m + n), half the terrain's and this give the terrain's
)


@dataclass(frozen=True)
class Physics:
    """How the world is simulated.

    Attributes:
        step: of time [s].
        stiffness: of each touching sphere [N/m].
        dissipation: of every contact [s/m] (Hunt and Crossley).
        friction: of all terrain; None: as the plan says.
    """

    step: float = 2e-3
    stiffness: float = 2e5
    dissipation: float = 5.0
    friction: float | None = None


class World:
    """The robot of a plan on its terrain.

    Attributes:
        plant: both.
        simulator: of them.
        left_out: triangles of meshes that no surface stands for and that nothing can collide with here.
    """

    def __init__(self, plan: Plan, model: str, physics: Physics) -> None:
        """Builds the simulation.

        Args:
            plan: with its scene.
            model: file of the robot's model.
            physics: options.
        """
        self._physics = physics
        terrain = scene_from_yaml(plan.scene_yaml, "the plan").terrain
        used = {int(k) for k in plan.contacts.surface if k >= 0}
        builder = DiagramBuilder()
        config = MultibodyPlantConfig(
            time_step=physics.step, contact_model="point", discrete_contact_approximation="lagged"
        )
        self.plant, self._graph = AddMultibodyPlant(config, builder)
        Parser(self.plant).AddModels(model)
        for number, surface in enumerate(terrain.surfaces):
            self._add_surface(number, surface, _depth(surface, number, plan) if number in used else SLAB)
        boxes = [o for o in terrain.obstacles if isinstance(o, BoxObstacle)]
        for box in boxes:
            X_WO = RigidTransform(box.X_WO)
            self.plant.RegisterCollisionGeometry(
                self.plant.world_body(), X_WO, Box(*box.size), f"obstacle {box.name}", self._ground(0.5)
            )
        self.left_out = len(plan.triangles) - sum(len(box.triangles()) for box in boxes)
        self._patches = [self.plant.GetFrameByName(name).body() for name in plan.effectors]
        for e in range(len(plan.effectors)):
            self._add_patch(plan, e)
        self.plant.Finalize()
        self._exclude_neighbours()
        self.simulator = Simulator(builder.Build())
        self._context = self.plant.GetMyMutableContextFromRoot(self.simulator.get_mutable_context())
        self._actuation = self.plant.get_actuation_input_port()
        self._actuation.FixValue(self._context, np.zeros(self.plant.num_actuators()))
        self._numbers = {int(body.index()): e for e, body in enumerate(self._patches)}

    def begin(self, q: np.ndarray) -> None:
        """Puts the robot at rest into a configuration (nq,)."""
        self.plant.SetPositions(self._context, q)
        self.plant.SetVelocities(self._context, np.zeros(self.plant.num_velocities()))
        self.simulator.Initialize()

    def state(self) -> tuple[np.ndarray, np.ndarray]:
        """(nq,) configuration and (nv,) velocity."""
        return self.plant.GetPositions(self._context), self.plant.GetVelocities(self._context)

    def push(self, change: np.ndarray) -> None:
        """Changes the velocity of the whole robot at once, by (3,) [m/s]."""
        v = self.plant.GetVelocities(self._context).copy()
        v[3:6] += change
        self.plant.SetVelocities(self._context, v)

    def advance(self, time: float, u: np.ndarray) -> None:
        """Simulates on.

        Args:
            time: to which [s].
            u: (A,) torques of the actuators [N m].

        Raises:
            RuntimeError: Drake's solver finds no next state.
        """
        self._actuation.FixValue(self._context, u)
        self.simulator.AdvanceTo(time)

    def contacts(self) -> tuple[np.ndarray, list[str]]:
        """(E, 3) force on each sole and palm in W [N], and pairs of bodies that touch and should not."""
        force, others = np.zeros((len(self._patches), 3)), []
        results = self.plant.get_contact_results_output_port().Eval(self._context)
        for i in range(results.num_point_pair_contacts()):
            info = results.point_pair_contact_info(i)
            a, b, on_a = int(info.bodyA_index()), int(info.bodyB_index()), -info.contact_force()
            if a in self._numbers:
                force[self._numbers[a]] += on_a
            if b in self._numbers:
                force[self._numbers[b]] -= on_a
            if 0 not in (a, b) or not {a, b} & set(self._numbers):
                others.append("/".join(self.plant.get_body(BodyIndex(k)).name() for k in (a, b)))
        return force, others

    def _ground(self, friction: float) -> ProximityProperties:
        return self._material(0.5 * (friction if self._physics.friction is None else self._physics.friction))

    def _material(self, friction: float) -> ProximityProperties:
        properties = ProximityProperties()
        AddContactMaterial(
            dissipation=self._physics.dissipation,
            point_stiffness=2 * self._physics.stiffness,
            friction=CoulombFriction(friction, friction),
            properties=properties,
        )
        return properties

    def _add_surface(self, number: int, surface: Surface, slab: float) -> None:
        box, material = _as_box(surface), self._ground(surface.friction)
        world, name = self.plant.world_body(), f"surface {number}"
        if box is not None:
            X_WB, size = box
            self.plant.RegisterCollisionGeometry(world, X_WB, Box(*size, PLATE), name, material)
            return
        shape = Convex(_body_under(surface, slab).T, name)
        self.plant.RegisterCollisionGeometry(world, RigidTransform(), shape, name, material)

    def _add_patch(self, plan: Plan, e: int) -> None:
        """Spheres in place of what the model has for a sole or palm and what is welded to it."""
        body, half = self._patches[e], plan.half_extent[e]
        X_BE = self.plant.GetFrameByName(plan.effectors[e]).GetFixedPoseInBodyFrame()
        for part in self.plant.GetBodiesWeldedTo(body):
            for old in self.plant.GetCollisionGeometriesForBody(part):
                self._graph.RemoveRole(self.plant.get_source_id(), old, Role.kProximity)
        depth = FOOT_DEPTH if is_foot(plan.effectors[e]) else PALM_DEPTH
        properties = self._material(GRIP)
        for k, (x, y) in enumerate(_touching_points(plan, e)):
            X_BG = X_BE @ RigidTransform([x, y, CORNER])
            self.plant.RegisterCollisionGeometry(body, X_BG, Sphere(CORNER), f"corner {k} of {e}", properties)
        lift = 1.5 * CORNER  # the box between the corners only keeps edges of the terrain out
        X_BG = X_BE @ RigidTransform([0, 0, 0.5 * (depth + lift)])
        size = (*(2 * half - 0.002), depth - lift)
        self.plant.RegisterCollisionGeometry(body, X_BG, Box(*size), f"patch {e}", properties)

    def _exclude_neighbours(self) -> None:
        """Geometry added after parsing escapes the model's filters: a patch ignores the links that carry it."""
        parents = {}
        for index in self.plant.GetJointIndices():
            joint = self.plant.get_joint(index)
            parents[joint.child_body().index()] = joint.parent_body(), joint.num_velocities() > 0
        for body in self._patches:
            near, link, moving = [], body, 0
            while link.index() in parents and moving < NEIGHBOURS:
                link, free = parents[link.index()]
                moving += free
                near += self.plant.GetCollisionGeometriesForBody(link)
            mine = GeometrySet(self.plant.GetCollisionGeometriesForBody(body))
            filters = self._graph.collision_filter_manager()
            filters.Apply(CollisionFilterDeclaration().ExcludeBetween(mine, GeometrySet(near)))


def _is_floor(surface: Surface) -> bool:
    return bool(surface.normal[2] > 0.7)


def _body_under(surface: Surface, depth: float) -> np.ndarray:
    """(2 V, 3) corners of the body with that depth under a surface: straight down, or into the wall."""
    down = np.array([0.0, 0.0, -1.0]) if _is_floor(surface) else -surface.normal
    return np.vstack([surface.vertices, surface.vertices + depth * down])


def _depth(surface: Surface, number: int, plan: Plan) -> float:
    """How deep the body under a surface that the plan uses can be without reaching over another of its contacts [m]."""
    if not _is_floor(surface):
        return WALL
    radius = float(np.linalg.norm(surface.vertices - surface.vertices.mean(axis=0), axis=1).max())
    points = []
    for k in np.flatnonzero(plan.contacts.surface != number).tolist():
        X_WC = plan.contacts.X_WC[k]
        points += list(X_WC[:3, 3] + CLEAR * X_WC[:3, 2] + plan.contacts.corners(k) @ X_WC[:3, :2].T)
    for depth in (share * radius for share in DEPTHS):
        faces = ConvexHull(_body_under(surface, depth)).equations
        if all((faces[:, :3] @ point + faces[:, 3]).max() > 0.0 for point in points):
            return max(depth, SLAB)
    return SLAB


def _touching_points(plan: Plan, e: int) -> list[np.ndarray]:
    """(2,) points of a patch that touch: two rings, and the corners of every support of its contacts and others inside [m].

    With its corners alone a sole whose corner is over an edge would tilt until its middle touches. The corners of a support
    lie on the edge of the terrain itself: those of a sole that stands a millimetre off touch nothing.
    """
    half = plan.half_extent[e]
    points = [half * np.array(p) for p in RING] + [INNER * half * np.array(p) for p in RING]
    for k in np.flatnonzero(plan.contacts.effector == e):
        corners = plan.contacts.corners(int(k))
        for corner in [*corners, *inset(corners, INSET)]:
            if min(np.linalg.norm(corner - p) for p in points) > APART:
                points.append(corner)
    return points


def _as_box(surface: Surface) -> tuple[RigidTransform, tuple[float, float]] | None:
    """Pose and edges of the plate under a rectangle, None where the surface is another polygon."""
    V = surface.vertices
    if len(V) != 4:
        return None
    a, b = V[1] - V[0], V[3] - V[0]
    if np.linalg.norm(V[0] + a + b - V[2]) > 1e-5 or abs(a @ b) > 1e-5:
        return None
    x = a / np.linalg.norm(a)
    R = np.column_stack([x, np.cross(surface.normal, x), surface.normal])
    X_WB = RigidTransform(RotationMatrix(R), V.mean(axis=0) - 0.5 * PLATE * surface.normal)
    return X_WB, (float(np.linalg.norm(a)), float(np.linalg.norm(b)))
