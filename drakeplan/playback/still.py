"""Draws what does not move: terrain, contacts, the path of the centre of mass, the goal, light and camera."""

# pydrake's stubs take the first parameter of ndarray for its type, and reject every array.
# pyright: reportArgumentType=false, reportCallIssue=false

from __future__ import annotations

import numpy as np
from pydrake.geometry import Box, Cylinder, Meshcat, Rgba
from pydrake.math import RigidTransform, RotationMatrix

from drakeplan.plan.plan import Plan
from drakeplan.playback import terrain_mesh
from drakeplan.playback.guide_path import draw_guide
from drakeplan.playback.pushes import draw_pushes
from drakeplan.playback.view import FIELD_OF_VIEW, View
from scenes.scene import Scene

ROOT = "/drakeplan"
COM = f"{ROOT}/com"  # the ball that moves along the path of the centre of mass
# red, green, cyan, magenta: the colours of the figures in Lin 2020
EFFECTOR_COLOURS = {
    "left_foot": Rgba(0.87, 0.10, 0.10),
    "right_foot": Rgba(0.10, 0.66, 0.16),
    "left_palm": Rgba(0.0, 0.72, 0.82),
    "right_palm": Rgba(0.84, 0.10, 0.74),
}
COM_COLOUR = Rgba(0.12, 0.16, 0.42)
PREDICTED_COLOUR = Rgba(0.80, 0.12, 0.12)  # as in Lin 2020 fig. 6.6, where the optimised path is blue
GOAL_COLOUR = Rgba(0.96, 0.70, 0.10)
PATCH = 0.008  # [m] thickness of a contact's patch, the greater part of it above the surface


def draw_still(meshcat: Meshcat, plan: Plan, scene: Scene) -> None:
    """Draws all of a plan that does not move.

    Args:
        meshcat: to draw in.
        plan: to draw.
        scene: the plan's.
    """
    draw_scene(meshcat, scene, plan.triangles)
    for c in range(len(plan.contacts)):
        _patch(meshcat, plan, c)
    if len(plan.contacts):
        corners = _patch_corners(plan)
        ends = np.roll(corners, -1, axis=1)
        meshcat.SetLineSegments(
            f"{ROOT}/contacts/outlines", corners.reshape(-1, 3).T, ends.reshape(-1, 3).T, 1.0, Rgba(0.1, 0.1, 0.12)
        )
    if plan.centroidal is not None and len(plan.centroidal):
        _com_path(meshcat, "com_path", plan.centroidal.com, COM_COLOUR)
    predicted = predicted_com(plan)
    if predicted is not None:
        _com_path(meshcat, "predicted_com_path", predicted, PREDICTED_COLOUR)
    draw_guide(meshcat, plan, ROOT)


def predicted_com(plan: Plan) -> np.ndarray | None:
    """(n, 3) CoM at each stance as the search predicted it [m]; None where it did not, or where that is no path."""
    found = plan.provenance.get("predicted_com")
    try:
        path: np.ndarray = np.array(found, float) if found is not None else np.zeros(0)
    except (TypeError, ValueError):
        return None
    return path if path.ndim == 2 and path.shape[1] == 3 and len(path) > 1 and np.isfinite(path).all() else None


def draw_scene(meshcat: Meshcat, scene: Scene, triangles: np.ndarray) -> np.ndarray:
    """Draws the terrain, the goal and the disturbances.

    Args:
        meshcat: where.
        scene: what.
        triangles: (K, 3, 3) of its obstacles and meshes [m].

    Returns:
        (M, 3) points that a picture of the disturbances must hold [m].
    """
    surfaces = scene.terrain.surfaces
    alone = [i for i, facet in enumerate(scene.terrain.surfaces_of_meshes) if not facet]
    facets = [i for i, facet in enumerate(scene.terrain.surfaces_of_meshes) if facet]
    walls = [i for i in alone if terrain_mesh.is_wall(surfaces[i])]
    plates = [i for i in alone if not terrain_mesh.is_wall(surfaces[i])]
    _mesh(meshcat, "terrain/plates", terrain_mesh.plate_mesh(surfaces, plates))
    _mesh(meshcat, "terrain/facets", terrain_mesh.facet_mesh(surfaces, facets))
    _walls(meshcat, terrain_mesh.wall_mesh(surfaces, walls))
    _mesh(meshcat, "terrain/obstacles", terrain_mesh.rock_mesh(triangles))
    starts, ends = terrain_mesh.outlines(surfaces)
    grey = Rgba(*terrain_mesh.OUTLINE)
    meshcat.SetLineSegments(f"{ROOT}/terrain/outlines", starts.T, ends.T, 1.0, grey)
    if scene.goal is not None:
        _goal(meshcat, np.asarray(scene.goal.xyz, float), scene.goal.radius)
    return draw_pushes(meshcat, scene, ROOT)


def _walls(meshcat: Meshcat, mesh: terrain_mesh.ColouredMesh) -> None:
    """Solid from in front, a mere tint from behind, so that a wall never hides a robot beside it."""
    if not len(mesh):
        return
    _mesh(meshcat, "terrain/walls", mesh, one_sided=True)
    vertices, faces = _soup(mesh)
    tint, behind = Rgba(*terrain_mesh.WALL * 0.9, 0.22), Meshcat.SideOfFaceToRender.kBackSide
    meshcat.SetTriangleMesh(f"{ROOT}/terrain/walls_from_behind", vertices, faces, tint, False, 1.0, behind)


def _soup(mesh: terrain_mesh.ColouredMesh) -> tuple[np.ndarray, np.ndarray]:
    """(3, 3K) vertices and (3, K) faces."""
    vertices = mesh.triangles.reshape(-1, 3).T
    return vertices, np.arange(vertices.shape[1], dtype=np.int32).reshape(-1, 3).T


def _mesh(meshcat: Meshcat, name: str, mesh: terrain_mesh.ColouredMesh, *, one_sided: bool = False) -> None:
    if not len(mesh):
        return
    vertices, faces = _soup(mesh)
    colours = np.repeat(mesh.colours, 3, axis=0).T
    side = Meshcat.SideOfFaceToRender.kFrontSide if one_sided else Meshcat.SideOfFaceToRender.kDoubleSide
    meshcat.SetTriangleColorMesh(f"{ROOT}/{name}", vertices, faces, colours, False, 1.0, side)


def _patch(meshcat: Meshcat, plan: Plan, index: int) -> None:
    effector = int(plan.contacts.effector[index])
    name = plan.effectors[effector]
    length, width = 2 * plan.half_extent[effector]
    path, colour = f"{ROOT}/contacts/{name}/{index}", EFFECTOR_COLOURS[name]
    X_WC = plan.contacts.X_WC[index]
    R_WC = RotationMatrix.ProjectToRotationMatrix(X_WC[:3, :3])  # a file may hold one that is off in its last digits
    support = plan.contact(index).support
    if support is not None:  # what carries stands out of a paler patch
        vertices, faces = _prism(support, 1.25 * PATCH)
        meshcat.SetTriangleMesh(f"{path}/support", vertices.T, faces.T, colour)
        colour = Rgba(*(0.35 * np.array([colour.r(), colour.g(), colour.b()]) + 0.6))
    meshcat.SetObject(f"{path}/patch", Box(length, width, PATCH), colour)
    meshcat.SetTransform(path, RigidTransform(R_WC, X_WC[:3, 3] + 0.3 * PATCH * X_WC[:3, 2]))


def _prism(polygon: np.ndarray, height: float) -> tuple[np.ndarray, np.ndarray]:
    """(2 V, 3) vertices and (F, 3) outward faces of a convex polygon (V, 2), counter-clockwise, made as high as this [m]."""
    n = len(polygon)
    top, bottom = (np.column_stack([polygon, np.full(n, z)]) for z in (0.5 * height, -0.5 * height))
    k, after = np.arange(n), np.roll(np.arange(n), -1)
    lid = np.column_stack([np.zeros(n - 2, int), k[1:-1], k[2:]])
    sides = np.concatenate([np.column_stack([n + k, n + after, after]), np.column_stack([n + k, after, k])])
    return np.vstack([top, bottom]), np.concatenate([lid, n + lid[:, ::-1], sides]).astype(np.int32)


def _patch_corners(plan: Plan) -> np.ndarray:
    """(C, 4, 3) corners of the patches' upper faces, in order around each [m]."""
    signs = np.array([[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]])
    flat = plan.half_extent[plan.contacts.effector][:, None] * signs
    p_CP = np.concatenate([flat, np.full((*flat.shape[:2], 1), 0.8 * PATCH + 0.001)], axis=2)
    X_WC = plan.contacts.X_WC
    return np.einsum("cij,ckj->cki", X_WC[:, :3, :3], p_CP) + X_WC[:, None, :3, 3]


def _com_path(meshcat: Meshcat, name: str, com: np.ndarray, colour: Rgba) -> None:
    step = max(1, len(com) // 600)
    path = np.concatenate([com[:-1:step], com[-1:]])
    moved = np.linalg.norm(np.diff(path, axis=0), axis=1) > 1e-4
    path = path[np.concatenate([[True], moved])]
    if len(path) < 2:
        return
    vertices, faces = terrain_mesh.tube(path, radius=0.009)
    meshcat.SetTriangleMesh(f"{ROOT}/{name}", vertices.T, faces.T.astype(np.int32), colour)


def _goal(meshcat: Meshcat, xyz: np.ndarray, radius: float) -> None:
    """A pole with a flag and a ring of the goal's radius around it."""
    pole = f"{ROOT}/goal/pole"
    height = 1.0
    meshcat.SetObject(pole, Cylinder(0.008, height), Rgba(0.35, 0.35, 0.38))
    meshcat.SetTransform(pole, RigidTransform(xyz + np.array([0.0, 0.0, height / 2])))
    flag = np.array([[0.0, 0.0, height], [0.0, 0.0, height - 0.16], [0.25, 0.0, height - 0.08]]) + xyz
    meshcat.SetTriangleMesh(f"{ROOT}/goal/flag", flag.T, np.array([[0, 1, 2]], np.int32).T, GOAL_COLOUR)
    turn = np.linspace(0, 2 * np.pi, 61)
    ring = xyz + radius * np.stack([np.cos(turn), np.sin(turn), np.full(61, 0.02)], axis=1) * [1, 1, 1 / radius]
    vertices, faces = terrain_mesh.tube(ring, radius=0.007)
    meshcat.SetTriangleMesh(f"{ROOT}/goal/ring", vertices.T, faces.T.astype(np.int32), GOAL_COLOUR)


def light_and_look(meshcat: Meshcat, view: View, extent: float) -> None:
    """One sun with soft shadows, a pale sky, the camera.

    Args:
        meshcat: to set up.
        view: the camera.
        extent: how far from the target the sun reaches [m].
    """
    meshcat.SetProperty("/Grid", "visible", False)
    meshcat.SetProperty("/Axes", "visible", False)
    meshcat.SetProperty("/Background/<object>", "top_color", [0.55, 0.68, 0.83])
    meshcat.SetProperty("/Background/<object>", "bottom_color", [0.90, 0.92, 0.94])
    meshcat.SetProperty("/Lights/PointLightNegativeX", "visible", False)
    meshcat.SetProperty("/Lights/PointLightPositiveX", "visible", False)
    meshcat.SetProperty("/Lights/AmbientLight/<object>", "intensity", 1.1)
    meshcat.SetProperty("/Lights/FillLight/<object>", "intensity", 0.5)
    _sun(meshcat, view, extent)
    meshcat.SetCamera(Meshcat.PerspectiveCamera(fov=FIELD_OF_VIEW, aspect=1, near=0.05, far=max(100.0, 20 * extent)))
    meshcat.SetCameraPose(view.eye, view.target)


def _sun(meshcat: Meshcat, view: View, extent: float) -> None:
    """Meshcat's spot light, far away and without decay; from behind the camera."""
    sun = "/Lights/SpotLight/<object>"
    look = view.eye - view.target
    azimuth = np.arctan2(look[1], look[0]) + np.deg2rad(50.0)
    height = np.deg2rad(52.0)
    distance = 4.0 * extent
    towards = np.array([np.cos(azimuth) * np.cos(height), np.sin(azimuth) * np.cos(height), np.sin(height)])
    meshcat.SetProperty("/Lights/SpotLight", "visible", True)
    meshcat.SetProperty(sun, "position", list(view.target + distance * towards))
    for axis, value in zip((12, 13, 14), view.target, strict=True):  # the light's target stands in no scene graph
        meshcat.SetProperty(sun, f"target.matrixWorld.elements[{axis}]", float(value))
    meshcat.SetProperty(sun, "decay", 0.0)
    meshcat.SetProperty(sun, "intensity", 2.4)
    meshcat.SetProperty(sun, "angle", float(1.15 * np.arctan2(extent, distance)))
    meshcat.SetProperty(sun, "penumbra", 0.2)
    meshcat.SetProperty(sun, "castShadow", True)
    for key in ("width", "height"):
        meshcat.SetProperty(sun, f"shadow.mapSize.{key}", 3072.0)
    meshcat.SetProperty(sun, "shadow.camera.near", 0.3 * distance)
    meshcat.SetProperty(sun, "shadow.camera.far", 2.5 * distance)
    meshcat.SetProperty(sun, "shadow.normalBias", 0.02)
    meshcat.SetProperty(sun, "shadow.bias", -0.0002)
