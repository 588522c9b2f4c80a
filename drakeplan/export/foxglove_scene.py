"""Robot, terrain and contact forces as entities of Foxglove's SceneUpdate."""

# The generated Protobuf classes take dicts where their stubs name messages.
# pyright: reportMissingImports=false, reportArgumentType=false, reportAttributeAccessIssue=false

from __future__ import annotations

import numpy as np
from foxglove_schemas_protobuf.ArrowPrimitive_pb2 import ArrowPrimitive
from foxglove_schemas_protobuf.CubePrimitive_pb2 import CubePrimitive
from foxglove_schemas_protobuf.CylinderPrimitive_pb2 import CylinderPrimitive
from foxglove_schemas_protobuf.Pose_pb2 import Pose
from foxglove_schemas_protobuf.SceneEntity_pb2 import SceneEntity
from foxglove_schemas_protobuf.SpherePrimitive_pb2 import SpherePrimitive
from foxglove_schemas_protobuf.TriangleListPrimitive_pb2 import TriangleListPrimitive
from google.protobuf.timestamp_pb2 import Timestamp
from pydrake.geometry import Rgba
from scipy.spatial import ConvexHull
from scipy.spatial.transform import Rotation

from drakeplan.export.robot_bodies import Body, BodyShape
from drakeplan.playback.animation import FORCE_COLOUR
from drakeplan.playback.still import COM_COLOUR
from drakeplan.playback.terrain_mesh import ColouredMesh, facet_mesh, is_wall, plate_mesh, rock_mesh, wall_mesh
from scenes.terrain.terrain import Terrain

WORLD, COM_FRAME = "world", "centre_of_mass"
METRES_PER_NEWTON = 1e-3  # of force arrows
SHAFT, HEAD, HEAD_LENGTH = 0.02, 0.05, 0.06  # [m] diameters and length of their parts
COM_RADIUS = 0.04  # [m]
LEAST_FORCE = 1.0  # [N] a smaller one has no arrow
WALL_ALPHA = 0.4


def as_pose(p: np.ndarray, xyzw: np.ndarray | None = None) -> Pose:
    """Foxglove's pose.

    Args:
        p: (3,) position [m].
        xyzw: (4,) quaternion; None: no rotation.
    """
    q = [0.0, 0.0, 0.0, 1.0] if xyzw is None else xyzw.tolist()
    position, orientation = dict(zip("xyz", p.tolist(), strict=True)), dict(zip("xyzw", q, strict=True))
    return Pose(position=position, orientation=orientation)


def robot_entities(bodies: tuple[Body, ...]) -> list[SceneEntity]:
    """One entity for each link with shapes, which moves with the link's frame, and a ball at the centre of mass."""
    ball = SpherePrimitive(
        pose=as_pose(np.zeros(3)), size=dict.fromkeys("xyz", 2 * COM_RADIUS), color=_named(COM_COLOUR)
    )
    entities = [SceneEntity(id=COM_FRAME, frame_id=COM_FRAME, frame_locked=True, spheres=[ball])]
    for body in bodies:
        if not body.looks:
            continue
        entity = SceneEntity(id=body.name, frame_id=body.name, frame_locked=True)
        for shape in body.looks:
            _add_shape(entity, shape)
        entities.append(entity)
    return entities


def terrain_entities(terrain: Terrain) -> list[SceneEntity]:
    """Surfaces, walls and obstacles as triangles in W."""
    surfaces, of_mesh = terrain.surfaces, terrain.surfaces_of_meshes
    alone = [k for k in range(len(surfaces)) if not of_mesh[k]]
    walls = [k for k in alone if is_wall(surfaces[k])]
    parts = {
        "plates": plate_mesh(surfaces, [k for k in alone if k not in set(walls)]),
        "walls": wall_mesh(surfaces, walls),
        "facets": facet_mesh(surfaces, [k for k in range(len(surfaces)) if of_mesh[k]]),
        "obstacles": rock_mesh(terrain.triangles),
    }
    return [
        SceneEntity(id=name, frame_id=WORLD, triangles=[_coloured(mesh, WALL_ALPHA if name == "walls" else 1.0)])
        for name, mesh in parts.items()
        if len(mesh)
    ]


def contact_entity(stamp: Timestamp, cop: np.ndarray, force: np.ndarray) -> SceneEntity:
    """Arrows of the contact forces at their centres of pressure.

    Args:
        stamp: time.
        cop: (E, 3) in W [m], NaN without contact.
        force: (E, 3) on the robot in W [N].
    """
    arrows = []
    for point, f in zip(cop, force, strict=True):
        size = float(np.linalg.norm(f))
        if not np.isfinite(point).all() or size < LEAST_FORCE:
            continue
        length = METRES_PER_NEWTON * size
        head = min(HEAD_LENGTH, 0.5 * length)
        arrows.append(
            ArrowPrimitive(
                pose=as_pose(point, _from_x_to(f / size)),
                shaft_length=length - head,
                shaft_diameter=SHAFT,
                head_length=head,
                head_diameter=HEAD,
                color=_named(FORCE_COLOUR),
            )
        )
    return SceneEntity(timestamp=stamp, id="contacts", frame_id=WORLD, arrows=arrows)


def _from_x_to(direction: np.ndarray) -> np.ndarray:
    """(4,) quaternion x, y, z, w of the least rotation that turns the x axis into a unit vector (3,)."""
    axis, w = np.cross([1.0, 0.0, 0.0], direction), 1.0 + direction[0]
    if w < 1e-9:
        return np.array([0.0, 0.0, 1.0, 0.0])
    q = np.array([*axis, w])
    return q / np.linalg.norm(q)


def _named(colour: Rgba) -> dict[str, float]:
    return {"r": colour.r(), "g": colour.g(), "b": colour.b(), "a": colour.a()}


def _add_shape(entity: SceneEntity, shape: BodyShape) -> None:
    X, colour = shape.X_BG, dict(zip("rgba", shape.colour, strict=True))
    xyzw = Rotation.from_matrix(X[:3, :3]).as_quat(canonical=True)
    pose = as_pose(X[:3, 3], xyzw)

    def size(x: float, y: float, z: float) -> dict[str, float]:
        return {"x": x, "y": y, "z": z}

    if shape.kind == "box":
        entity.cubes.append(CubePrimitive(pose=pose, size=size(*shape.size), color=colour))
    elif shape.kind in ("sphere", "ellipsoid"):
        axes = shape.size * 3 if shape.kind == "sphere" else shape.size
        entity.spheres.append(SpherePrimitive(pose=pose, size=size(*(2 * a for a in axes)), color=colour))
    elif shape.kind in ("cylinder", "capsule"):
        radius, length = shape.size
        entity.cylinders.append(
            CylinderPrimitive(
                pose=pose, size=size(2 * radius, 2 * radius, length), bottom_scale=1.0, top_scale=1.0, color=colour
            )
        )
        for end in (-0.5, 0.5) if shape.kind == "capsule" else ():
            centre = as_pose(X[:3, 3] + end * length * X[:3, 2], xyzw)
            entity.spheres.append(SpherePrimitive(pose=centre, size=size(*[2 * radius] * 3), color=colour))
    else:
        triangles = shape.points if shape.kind == "mesh" else shape.points[ConvexHull(shape.points).simplices]
        entity.triangles.append(_triangles(triangles, pose, colour))


def _triangles(triangles: np.ndarray, pose: Pose, colour: dict[str, float]) -> TriangleListPrimitive:
    """Triangles (K, 3, 3) of one colour; corners that coincide to a micrometre are stored once."""
    vertices, indices = np.unique(np.round(triangles.reshape(-1, 3), 6), axis=0, return_inverse=True)
    points = [{"x": x, "y": y, "z": z} for x, y, z in vertices.tolist()]
    return TriangleListPrimitive(pose=pose, points=points, color=colour, indices=indices.ravel().tolist())


def _coloured(mesh: ColouredMesh, alpha: float) -> TriangleListPrimitive:
    points = [{"x": x, "y": y, "z": z} for x, y, z in mesh.triangles.reshape(-1, 3).tolist()]
    colours = [{"r": r, "g": g, "b": b, "a": alpha} for r, g, b in np.repeat(mesh.colours, 3, axis=0).tolist()]
    return TriangleListPrimitive(pose=as_pose(np.zeros(3)), points=points, colors=colours)
