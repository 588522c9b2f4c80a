"""Drake's plant of a robot, with the terrain in SceneGraph for collision and display.

Everything that stands still is on the world body, so Drake leaves terrain against terrain out by itself.
"""

# pydrake's stubs read "float64[m, 1]" as a shape and refuse every array.
# pyright: reportArgumentType=false, reportCallIssue=false, reportAttributeAccessIssue=false, reportReturnType=false, reportOperatorIssue=false

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from functools import cached_property, lru_cache

import numpy as np
from pydrake.common import MemoryFile
from pydrake.geometry import (
    Box as DrakeBox,
)
from pydrake.geometry import (
    Convex,
    GeometryId,
    InMemoryMesh,
    Mesh,
    Meshcat,
    MeshcatVisualizer,
    SceneGraph,
    Shape,
)
from pydrake.math import RigidTransform
from pydrake.multibody.plant import AddMultibodyPlantSceneGraph, CoulombFriction, MultibodyPlant
from pydrake.multibody.tree import RigidBody
from pydrake.systems.framework import Context, Diagram, DiagramBuilder

from scenes.effector import EFFECTORS, is_foot
from scenes.meshes.convex_faces import join_coplanar
from scenes.robots.drake_parser import add_model, reading, set_joint
from scenes.robots.robot import Robot
from scenes.terrain.packed_terrain import THICKNESS
from scenes.terrain.polygon import polygon_normal
from scenes.terrain.surface import Surface
from scenes.terrain.terrain import Box, Terrain, TriangleMesh

NEAR = 2.0  # [m] further away no part of a robot gets while its contacts stay
MIN_ALTITUDE = 1e-4  # [m] triangles flatter than this hold no prism; their neighbours cover them
OBSTACLE_FRICTION = 0.5  # [-] nothing is planned to touch them

# RGBA. Stones alternate so that neighbours can be told apart; walls let the robot behind them shine through.
STONES = ((0.62, 0.60, 0.56, 1.0), (0.55, 0.54, 0.52, 1.0), (0.69, 0.66, 0.60, 1.0), (0.58, 0.61, 0.60, 1.0))
WALL = (0.55, 0.66, 0.78, 0.55)
UNUSED = (0.45, 0.45, 0.47, 1.0)
OBSTACLE = (0.50, 0.47, 0.44, 1.0)


@dataclass(frozen=True, eq=False)
class RobotPlant:
    """A finished diagram of one robot on one terrain (or none).

    Attributes:
        robot: whose model it is.
        terrain: what stands around it, None for nothing.
        plant: robot positions first, so q is the same with and without terrain.
        scene_graph: robot and terrain, roles proximity and illustration.
        diagram: both.
        surface_geometry: (S) proximity geometry of each surface's plate; None for a mesh's face and for one far away.
        terrain_geometry: name of everything that stands still, by proximity geometry.
    """

    robot: Robot
    terrain: Terrain | None
    plant: MultibodyPlant
    scene_graph: SceneGraph
    diagram: Diagram
    surface_geometry: tuple[GeometryId | None, ...]
    terrain_geometry: dict[GeometryId, str]

    @cached_property
    def effector_bodies(self) -> tuple[RigidBody, ...]:
        """The bodies whose frames are the contact frames, in the order of `EFFECTORS`."""
        return tuple(self.plant.GetBodyByName(e.frame) for e in self.robot.effectors)

    @cached_property
    def effector_geometry(self) -> tuple[frozenset[GeometryId], ...]:
        """Proximity geometries that move as one with each contact frame, in the order of `EFFECTORS`."""
        return tuple(
            frozenset(
                g for b in self.plant.GetBodiesWeldedTo(body) for g in self.plant.GetCollisionGeometriesForBody(b)
            )
            for body in self.effector_bodies
        )

    def new_context(self) -> Context:
        """A fresh context of the diagram."""
        return self.diagram.CreateDefaultContext()

    def body_of(self, geometry: GeometryId) -> str:
        """Name of the terrain piece or the robot's body that a proximity geometry belongs to."""
        if geometry in self.terrain_geometry:
            return self.terrain_geometry[geometry]
        inspector = self.scene_graph.model_inspector()
        return self.plant.GetBodyFromFrameId(inspector.GetFrameId(geometry)).name()

    def nominal_positions(self) -> np.ndarray:
        """(nq,) the nominal posture with the soles at z = 0 and the mean of the feet at the origin."""
        context = self.plant.CreateDefaultContext()
        for name, angle in self.robot.nominal.items():
            set_joint(self.plant.GetJointByName(name), context, angle)
        base = self.plant.GetBodyByName(self.robot.base_body)
        self.plant.SetFreeBodyPose(context, base, RigidTransform())
        p_BF = [self.plant.EvalBodyPoseInWorld(context, foot).translation() for foot in self.effector_bodies[:2]]
        self.plant.SetFreeBodyPose(context, base, RigidTransform(-np.mean(p_BF, axis=0)))
        return self.plant.GetPositions(context).copy()


def build_plant(
    robot: Robot, terrain: Terrain | None = None, *, meshcat: Meshcat | None = None, near: np.ndarray | None = None
) -> RobotPlant:
    """Parses the robot and puts the terrain around it.

    A surface becomes a plate, an obstacle's faces become prisms, each a convex body `THICKNESS` deep behind its face; a
    box stays a box. A surface that is the face of a mesh is not added: the mesh is its body. Without terrain and
    Meshcat the same object comes back each time, so leave the defaults of its plant alone.

    Args:
        robot: what to parse.
        terrain: surfaces and obstacles, None for the robot alone.
        meshcat: where to draw, None for nowhere.
        near: (P, 3) points [m]; only terrain within `NEAR` of one of them is added, None for all. Drake's time and
            memory for bodies that stand still grow with their square: 600 take 0.4 s, 5000 a minute.
    """
    if terrain is None and meshcat is None:
        return _robot_alone(robot)
    return _build(robot, terrain, meshcat, None if near is None else np.asarray(near, float).reshape(-1, 3))


@lru_cache(maxsize=8)
def nominal_posture(robot: Robot) -> np.ndarray:
    """(nq,) standing: soles at z = 0, mean of the feet at the origin, heading along x. Loads the model once."""
    q = build_plant(robot).nominal_positions()
    q.setflags(write=False)
    return q


@lru_cache(maxsize=8)
def _robot_alone(robot: Robot) -> RobotPlant:
    return _build(robot, None, None, None)


def _build(robot: Robot, terrain: Terrain | None, meshcat: Meshcat | None, near: np.ndarray | None) -> RobotPlant:
    builder = DiagramBuilder()
    plant, scene_graph = AddMultibodyPlantSceneGraph(builder, time_step=1e-3)
    add_model(plant, robot.model)
    surfaces: list[GeometryId | None] = []
    names: dict[GeometryId, str] = {}
    if terrain is not None:
        for k, surface in enumerate(terrain.surfaces):
            if terrain.surfaces_of_meshes[k] or not _is_near(surface.vertices[None], near)[0]:
                surfaces.append(None)
                continue
            plate = _add_plate(plant, surface, STONES[k % len(STONES)])
            surfaces.append(plate)
            names[plate] = surface.name
        for obstacle in terrain.obstacles:
            names |= dict.fromkeys(_add_obstacle(plant, obstacle, near), obstacle.name)
    with reading(robot.model):
        plant.Finalize()
    if meshcat is not None:
        MeshcatVisualizer.AddToBuilder(builder, scene_graph, meshcat)
    return RobotPlant(robot, terrain, plant, scene_graph, builder.Build(), tuple(surfaces), names)


def _is_near(pieces: np.ndarray, near: np.ndarray | None) -> np.ndarray:
    """(K,) whether the bounding box of each piece (K, V, 3) is within `NEAR` of one of the points (P, 3)."""
    if near is None:
        return np.ones(len(pieces), bool)
    low, high = pieces.min(axis=1)[:, None], pieces.max(axis=1)[:, None]
    gap = np.maximum(np.maximum(low - near, near - high), 0.0)
    return (np.linalg.norm(gap, axis=2) <= NEAR).any(axis=1)


def prism(face: np.ndarray, normal: np.ndarray, depth: float = THICKNESS) -> np.ndarray:
    """(2K, 3) vertices of the prism from a convex face (K, 3) to `depth` [m] behind it, against its normal (3,).

    Args:
        face: (K, 3) corners of the convex face in W [m].
        normal: (3,) its outward unit normal in W.
        depth: of the prism [m].
    """
    return np.concatenate([face, face - depth * normal])


def _add_plate(plant: MultibodyPlant, surface: Surface, stone: tuple[float, ...]) -> GeometryId:
    allowed = [e for e in EFFECTORS if surface.allows(e)]
    colour = stone if any(map(is_foot, allowed)) else WALL if allowed else UNUSED
    plate = Convex(prism(surface.vertices, surface.normal).T, _one_line(surface.name))
    return _register(plant, plate, RigidTransform(), f"surface::{surface.name}", surface.friction, colour)


def _add_obstacle(plant: MultibodyPlant, obstacle: Box | TriangleMesh, near: np.ndarray | None) -> list[GeometryId]:
    name = f"obstacle::{obstacle.name}"
    if not _is_near(obstacle.triangles().reshape(1, -1, 3), near)[0]:
        return []
    if isinstance(obstacle, Box):
        return [
            _register(plant, DrakeBox(*obstacle.size), RigidTransform(obstacle.X_WO), name, OBSTACLE_FRICTION, OBSTACLE)
        ]
    faces = _solid_triangles(obstacle.faces)
    looks = Mesh(InMemoryMesh(mesh_file=MemoryFile(_obj(faces), ".obj", _one_line(obstacle.name))))
    plant.RegisterVisualGeometry(plant.world_body(), RigidTransform(), looks, name, np.array(OBSTACLE))
    return [
        _register(
            plant,
            Convex(prism(face, polygon_normal(face)).T, f"face {k}"),
            RigidTransform(),
            f"{name}::{k}",
            OBSTACLE_FRICTION,
        )
        for k, face in enumerate(join_coplanar(faces[_is_near(faces, near)]))
    ]


def _register(
    plant: MultibodyPlant,
    shape: Shape,
    X_WG: RigidTransform,
    name: str,
    friction: float,
    colour: Iterable[float] | None = None,
) -> GeometryId:
    world = plant.world_body()
    if colour is not None:
        plant.RegisterVisualGeometry(world, X_WG, shape, name, np.array(colour))
    return plant.RegisterCollisionGeometry(world, X_WG, shape, name, CoulombFriction(friction, friction))


def _solid_triangles(faces: np.ndarray) -> np.ndarray:
    """The (K, 3, 3) triangles whose least altitude is worth a prism."""
    edges = np.roll(faces, -1, axis=1) - faces
    area = 0.5 * np.linalg.norm(np.cross(edges[:, 0], edges[:, 1]), axis=1)
    altitude = 2 * area / np.maximum(np.linalg.norm(edges, axis=2).max(axis=1), 1e-300)
    return faces[altitude > MIN_ALTITUDE]


def _obj(faces: np.ndarray) -> str:
    lines = [f"v {x:.6f} {y:.6f} {z:.6f}" for x, y, z in faces.reshape(-1, 3)]
    lines += [f"f {3 * k + 1} {3 * k + 2} {3 * k + 3}" for k in range(len(faces))]
    return "\n".join(lines) + "\n"


def _one_line(name: str) -> str:
    return " ".join(name.split())
