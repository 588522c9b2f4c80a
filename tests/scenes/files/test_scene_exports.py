"""Terrain for other programs: what Drake and MuJoCo load stands where it stood, and feels as it did."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st
from pydrake.geometry import Role
from pydrake.multibody.parsing import Parser
from pydrake.multibody.plant import AddMultibodyPlantSceneGraph
from pydrake.systems.framework import DiagramBuilder

from scenes.files.scene_file import scene_from_yaml
from scenes.files.scene_solids import hull_faces, solids_of
from scenes.files.scene_to_mjcf import scene_to_mjcf
from scenes.files.scene_to_obj import scene_to_obj
from scenes.files.scene_to_sdf import scene_to_sdf, write_sdf
from scenes.meshes.mesh_import import import_mesh
from scenes.scene import Scene
from scenes.terrain.packed_terrain import THICKNESS
from scenes.terrain.polygon import area_vectors
from scenes.terrain.terrain import Terrain

TEXT = """format: drakeplan-scene
version: 1
name: a scene
friction: 0.6
surfaces:
  - {name: level ground, vertices: [[0,0,0],[2,0,0],[2,1,0],[0,1,0]]}
  - {name: ramp, vertices: [[2,0,0],[3,0,0.3],[3,1,0.3],[2,1,0]], friction: 0.8}
  - {name: corner, vertices: [[0,1,0.1],[1,1,0.1],[0,2,0.1]]}
obstacles:
  - {name: "crate <1>", box: [0.4,0.4,0.5], pose: {xyz: [1,0.5,0.25], rpy: [0,0,0.4]}, friction: 0.3, contact: [left_foot, right_foot]}
  - {name: lamp, box: [0.1,0.1,0.1], pose: {xyz: [1.5,0.5,1.5]}}
"""


@pytest.fixture(scope="module")
def scene(tmp_path_factory: pytest.TempPathFactory) -> Scene:
    """Surfaces, boxes, a convex body of a mesh, and an open sheet of one with a dent."""
    made = scene_from_yaml(TEXT, "a.yaml")
    wedge = trimesh.convex.convex_hull(
        np.array([[3, 0, 0], [4, 0, 0], [3, 1, 0], [4, 1, 0], [4, 0, 0.5], [4, 1, 0.5]], float)
    )
    sheet = trimesh.Trimesh(
        [[0, -1, 0.2], [1, -1, 0.2], [2, -1, 0.4], [0, 0, 0.2], [1, 0, 0.2], [2, 0, 0.4]],
        [[0, 1, 4], [0, 4, 3], [1, 2, 5], [1, 5, 4]],
    )
    path = tmp_path_factory.mktemp("mesh") / "both.ply"
    trimesh.util.concatenate([wedge, sheet]).export(path)
    mesh = import_mesh(path, friction=0.7)
    terrain = Terrain(
        (*made.terrain.surfaces, *mesh.surfaces),
        (*made.terrain.obstacles, mesh.obstacle),
        (*made.terrain.surfaces_of_meshes, *(True,) * len(mesh.surfaces)),
    )
    return Scene("a scene", terrain, origin_offset=(431_200.0, 5_411_100.0, 0.0))


def height(scene: Scene, x: float, y: float) -> float:
    """The highest face of the terrain over a place, by the barycentric coordinates of its triangles; NaN over none."""
    fans = [
        np.stack([np.stack([s.vertices[0], s.vertices[k], s.vertices[k + 1]]) for k in range(1, len(s.vertices) - 1)])
        for s in scene.terrain.surfaces
    ]
    triangles = np.concatenate([*fans, scene.terrain.triangles])
    a, b, c = triangles.transpose(1, 0, 2)
    area = (b[:, 0] - a[:, 0]) * (c[:, 1] - a[:, 1]) - (b[:, 1] - a[:, 1]) * (c[:, 0] - a[:, 0])
    flat = np.abs(area) > 1e-9
    a, b, c, area = a[flat], b[flat], c[flat], area[flat]
    u = ((x - a[:, 0]) * (c[:, 1] - a[:, 1]) - (y - a[:, 1]) * (c[:, 0] - a[:, 0])) / area
    v = ((b[:, 0] - a[:, 0]) * (y - a[:, 1]) - (b[:, 1] - a[:, 1]) * (x - a[:, 0])) / area
    on = (u >= 0) & (v >= 0) & (u + v <= 1)
    return float((a + u[:, None] * (b - a) + v[:, None] * (c - a))[on, 2].max()) if on.any() else np.nan


def places(scene: Scene, count: int) -> list[tuple[float, float, float]]:
    """(x, y, height) at random places that are a centimetre from every drop."""
    rng = np.random.default_rng(0)
    found = []
    while len(found) < count:
        x, y = rng.uniform((0, -1), (4, 2))
        around = [height(scene, x + a, y + b) for a in (-0.01, 0, 0.01) for b in (-0.01, 0, 0.01)]
        if np.isfinite(around).all() and np.ptp(around) < 0.02:
            found.append((x, y, around[4]))
    return found


def test_solids_are_the_surfaces_the_boxes_and_the_bodies_of_meshes(scene: Scene) -> None:
    solids = {solid.name: solid for solid in solids_of(scene.terrain)}
    assert set(solids) >= {"level ground", "ramp", "corner", "crate <1>", "lamp", "both/0"}
    assert not [name for name in solids if name.startswith("crate <1>/")]  # its sides are the box
    frictions = [solids[name].friction for name in ("level ground", "ramp", "crate <1>", "lamp", "both/0")]
    assert frictions == [0.6, 0.8, 0.3, 0.5, 0.7]
    assert [solids[name].box is not None for name in ("level ground", "ramp", "corner", "crate <1>", "both/0")] == [
        True,
        True,
        False,
        True,
        False,
    ]
    slab = solids["corner"].corners
    np.testing.assert_allclose([slab[:, 2].min(), slab[:, 2].max()], [0.1 - THICKNESS, 0.1])
    assert len(solids["both/0"].corners) == 6  # the wedge is one


@settings(max_examples=30)
@given(st.integers(0, 10_000))
def test_hulls_are_closed_and_wound_outward(seed: int) -> None:
    points = np.random.default_rng(seed).normal(size=(12, 3)) * [1.0, 0.5, 0.02] + [100.0, 5.0, 1.0]
    corners, faces = hull_faces(points)
    doubled = area_vectors(corners[faces])
    np.testing.assert_allclose(doubled.sum(axis=0), 0.0, atol=1e-9)
    middle = corners.mean(axis=0)
    assert (((corners[faces[:, 0]] - middle) * doubled).sum(axis=1) > 0).all()
    np.testing.assert_allclose([corners.min(axis=0), corners.max(axis=0)], [points.min(axis=0), points.max(axis=0)])


def test_an_obj_file_has_each_surface_and_obstacle_under_its_name(scene: Scene, tmp_path: Path) -> None:
    text = scene_to_obj(scene)
    names = [line[2:] for line in text.splitlines() if line.startswith("o ")]
    assert names == [
        n.replace(" ", "_")
        for n in [s.name for s in scene.terrain.surfaces] + [o.name for o in scene.terrain.obstacles]
    ]
    assert "# origin_offset 431200 5411100 0 was subtracted" in text
    (tmp_path / "a.obj").write_text(text)
    again = import_mesh(tmp_path / "a.obj")
    for x, y, z in places(scene, 40):
        assert height(Scene("again", Terrain(again.surfaces, (again.obstacle,))), x, y) == pytest.approx(z, abs=1e-6)


def test_drake_finds_the_sdf_file_at_the_heights_of_the_terrain(scene: Scene, tmp_path: Path) -> None:
    written = write_sdf(scene, tmp_path / "Gelände süd.sdf")
    assert len(written) > 3
    builder = DiagramBuilder()
    plant, graph = AddMultibodyPlantSceneGraph(builder, time_step=1e-3)
    Parser(plant).AddModels(str(written[0]))
    plant.Finalize()
    assert plant.num_positions() == 0
    diagram = builder.Build()
    query = graph.get_query_output_port().Eval(graph.GetMyContextFromRoot(diagram.CreateDefaultContext()))
    for x, y, z in places(scene, 60):
        off = [d.distance for d in query.ComputeSignedDistanceToPoint([x, y, z + 1e-4], 0.1)]
        assert min(off) == pytest.approx(1e-4, abs=2.1e-5)
        below = [d.distance for d in query.ComputeSignedDistanceToPoint([x, y, z - 1e-3], 0.1)]
        assert min(below) < 0  # by a millimetre, less beside a joint: slabs open under it
    inspector = graph.model_inspector()
    proximity = [g for g in inspector.GetAllGeometryIds(Role.kProximity)]
    assert len(proximity) == len(solids_of(scene.terrain))
    found = {
        inspector.GetName(g).partition("::")[2].partition(" ")[2]: inspector.GetProximityProperties(g).GetProperty(
            "material", "coulomb_friction"
        )
        for g in proximity
    }
    for solid in solids_of(scene.terrain):
        friction = found["_".join(solid.name.split())]
        assert (friction.static_friction(), friction.dynamic_friction()) == (solid.friction, solid.friction)


def test_rays_in_mujoco_hit_the_heights_of_the_terrain(scene: Scene) -> None:
    mujoco = pytest.importorskip("mujoco")
    model = mujoco.MjModel.from_xml_string(scene_to_mjcf(scene))
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    geom = np.zeros(1, np.int32)
    for x, y, z in places(scene, 60):
        if x < 1.4 or x > 1.6 or y < 0.4 or y > 0.6:  # the lamp hangs there
            down = mujoco.mj_ray(model, data, np.array([x, y, 5.0]), np.array([0.0, 0.0, -1.0]), None, 1, -1, geom)
            assert 5.0 - down == pytest.approx(z, abs=1e-5)
    solids = solids_of(scene.terrain)
    assert model.ngeom == len(solids)
    np.testing.assert_allclose(model.geom_friction[:, 0], [solid.friction for solid in solids])


def test_names_that_xml_keeps_for_itself_are_written_so_that_it_reads_them(scene: Scene) -> None:
    text, files = scene_to_sdf(scene, "dir/a.sdf")
    assert "crate_&lt;1&gt;" in text
    assert all(name.startswith("a_meshes/") for name in files)
    assert "origin_offset 431200 5411100 0" in text and "origin_offset" in scene_to_mjcf(scene)
