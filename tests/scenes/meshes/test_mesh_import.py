"""Meshes as terrain: our own and those of hpp-environments."""

import numpy as np
import pytest
import shapely
import trimesh

from scenes.files.scene_source import load_scene
from scenes.footholds.convex_cover import min_width
from scenes.input_error import InputError
from scenes.meshes.mesh_import import MESH_PREFIX, NARROWEST, check_up_axis, import_mesh
from scenes.meshes.mesh_path import package_folder
from scenes.pose import pose_matrix

needs_hpp = pytest.mark.skipif(package_folder("hpp_environments") is None, reason="hpp-environments is not installed")
PLANNED = ("darpa", "stairs", "rubbles_stairs_1", "sideWall_long", "cross_gap")


def slab(path, size, name="slab.stl"):
    trimesh.creation.box(size).export(path / name)
    return path / name


def contains(surface, point, slack=0.0):
    inward = np.cross(surface.normal, np.roll(surface.vertices, -1, axis=0) - surface.vertices)
    inward /= np.linalg.norm(inward, axis=1, keepdims=True)
    return bool((((point - surface.vertices) * inward).sum(axis=1) > -slack).all())


def foot_surfaces(terrain):
    return [s for s in terrain.surfaces if s.allows("left_foot")]


def test_a_mesh_is_an_obstacle_whose_flat_faces_are_surfaces(tmp_path):
    mesh = import_mesh(slab(tmp_path, (2.0, 1.0, 0.2)), friction=0.7)
    assert mesh.obstacle.name == "slab"
    assert len(mesh.obstacle.faces) == 12
    assert all(s.name.startswith(MESH_PREFIX + "slab/") for s in mesh.surfaces)
    assert len(mesh.surfaces) == 5, "nothing can use the face that looks down"
    assert {s.friction for s in mesh.surfaces} == {0.7}
    assert sum(s.allows("left_foot") for s in mesh.surfaces) == 1
    assert sum(s.allows("left_palm") for s in mesh.surfaces) == 4


def test_a_mesh_in_millimetres_is_refused_until_its_scale_is_given(tmp_path):
    file = slab(tmp_path, (2000.0, 1000.0, 200.0))
    with pytest.raises(InputError, match=r"slab.stl: 2000 m across, as if it were in millimetres: .* scale: 0.001"):
        import_mesh(file)
    assert np.ptp(import_mesh(file, scale=0.001).obstacle.faces.reshape(-1, 3)[:, 0]) == pytest.approx(2.0)
    assert np.ptp(import_mesh(file, scale=1.0).obstacle.faces.reshape(-1, 3)[:, 0]) == pytest.approx(2000.0)


def test_a_mesh_that_leaves_the_world_is_refused(tmp_path):
    with pytest.raises(InputError, match="expected at most 100 km"):
        import_mesh(slab(tmp_path, (2.0, 1.0, 0.2)), scale=1e6)
    with pytest.raises(InputError, match="expected at most 100 km"):
        import_mesh(slab(tmp_path, (2.0, 1.0, 0.2)), scale=1e300)


def test_a_terrain_on_its_side_is_refused_and_its_turned_twin_is_not(tmp_path):
    file = slab(tmp_path, (4.0, 0.1, 3.0))
    with pytest.raises(InputError, match=r"as if y were up: .*rpy: \[1.5708, 0, 0\]"):
        check_up_axis((import_mesh(file).obstacle,))
    with pytest.raises(InputError, match="as if y were up"):
        load_scene(str(file))
    check_up_axis((import_mesh(file, X_WM=pose_matrix((0, 0, 0), (np.pi / 2, 0, 0))).obstacle,))


def test_a_mesh_with_nothing_to_stand_on_is_no_scene(tmp_path):
    file = slab(tmp_path, (1.0, 0.03, 0.01), "rail.stl")  # narrower than anything fits on
    with pytest.raises(InputError, match="no surface to stand on"):
        load_scene(str(file))
    pyramid = trimesh.creation.cone(0.3, 2.0, sections=4)
    pyramid.export(tmp_path / "spire.stl")
    with pytest.raises(InputError, match="no surface to stand on"):
        load_scene(str(tmp_path / "spire.stl"))


def test_a_mesh_of_needles_alone_is_refused(tmp_path):
    (tmp_path / "line.obj").write_text("v 0 0 0\nv 1 0 0\nv 2 0 0\nf 1 2 3\n")
    with pytest.raises(InputError, match="no face has an area"):
        import_mesh(tmp_path / "line.obj")


def test_names_of_files_become_plain_names_of_meshes(tmp_path):
    mesh = import_mesh(slab(tmp_path, (1, 1, 1), "großer Stein (2).stl"))
    assert mesh.obstacle.name == "gro_er_Stein_2_"


@needs_hpp
@pytest.mark.parametrize("name", PLANNED)
def test_every_surface_lies_on_its_mesh_faces_the_same_way_and_is_wide_enough(name):
    terrain = load_scene(f"hpp/{name}").terrain
    assert all(terrain.surfaces_of_meshes)
    mesh = trimesh.Trimesh(terrain.triangles.reshape(-1, 3), np.arange(terrain.triangles.size // 3).reshape(-1, 3))
    rng = np.random.default_rng(0)
    for surface in terrain.surfaces:
        weights = rng.dirichlet(np.ones(len(surface.vertices)), 4)
        _, off, face = trimesh.proximity.closest_point_naive(mesh, weights @ surface.vertices)
        assert off.max() < 2e-3
        aligned = mesh.face_normals @ surface.normal > np.cos(np.deg2rad(1.5))
        near = np.abs((mesh.triangles_center - surface.centroid) @ surface.normal) < 2e-3
        assert (aligned & near).any(), f"{surface.name} looks along no face's normal (nearest face {face})"
        axes = np.linalg.svd(surface.vertices - surface.centroid)[2][:2]
        flat = shapely.orient_polygons(shapely.Polygon((surface.vertices - surface.centroid) @ axes.T))
        assert min_width(np.array(flat.exterior.coords)[:-1]) > NARROWEST - 1e-4


@needs_hpp
@pytest.mark.parametrize("name", PLANNED)
def test_the_highest_point_over_each_spot_that_faces_up_belongs_to_a_surface(name):
    """Rays from above: what they hit first is never buried, so it must have been kept, up to rims and slivers."""
    terrain = load_scene(f"hpp/{name}").terrain
    low, high = terrain.extent
    rng = np.random.default_rng(1)
    spots = rng.uniform(low[:2], high[:2], (400, 2))
    a, b, c = terrain.triangles[:, 0], terrain.triangles[:, 1], terrain.triangles[:, 2]
    normal = np.cross(b - a, c - a)
    kept = total = 0
    for spot in spots:
        heights = []
        for k in np.flatnonzero(np.abs(normal[:, 2]) > 1e-9):
            inside = shapely.Polygon([a[k, :2], b[k, :2], c[k, :2]]).distance(shapely.Point(spot)) == 0
            if inside:
                z = a[k, 2] - normal[k, :2] @ (spot - a[k, :2]) / normal[k, 2]
                heights.append((z, normal[k] / np.linalg.norm(normal[k])))
        if not heights:
            continue
        z, n = max(heights, key=lambda hit: hit[0])
        if n[2] < np.cos(np.pi / 4):
            continue
        total += 1
        point = np.array([*spot, z])
        kept += any(
            abs((point - s.centroid) @ s.normal) < 2e-3 and contains(s, point, 1e-3) for s in foot_surfaces(terrain)
        )
    assert total > 100
    assert kept >= 0.99 * total


@needs_hpp
def test_darpa_is_blocks_on_a_floor_whose_uncovered_part_is_whole():
    """Floor from -4.29 to 4.53 m and from -0.76 to 0.67 m, rubble between -0.68 and 1.13 m, up to 0.3 m high."""
    scene = load_scene("hpp/darpa")
    floor = [s for s in foot_surfaces(scene.terrain) if abs(s.centroid[2]) < 1e-4]
    for x in (-3.6, -0.8, 1.3, 3.9):
        for y in (-0.7, 0.0, 0.6):
            assert any(contains(s, np.array([x, y, 0.0])) for s in floor)
    assert not any(contains(s, np.array([0.2, 0.0, 0.0])) for s in floor), "the middle blocks stand there"
    ridge = [s for s in foot_surfaces(scene.terrain) if s.tilt < 1e-3 and s.vertices[:, 2].min() > 0.29]
    assert len(ridge) == 1, "eight blocks of 0.1 m make one top"
    assert np.ptp(ridge[0].vertices[:, 1]) == pytest.approx(0.8, abs=1e-3)


@needs_hpp
def test_the_treads_of_hpp_stairs_rise_by_ten_centimetres():
    scene = load_scene("hpp/stairs")
    heights = sorted(s.centroid[2] for s in foot_surfaces(scene.terrain))
    np.testing.assert_allclose(np.diff(heights), 0.1, atol=5e-3)
    for x, y, z in ((-0.6, 0.8, 0.0), (2.2, 0.8, 0.6)):
        assert any(
            contains(s, np.array([x, y, z])) for s in foot_surfaces(scene.terrain) if abs(s.centroid[2] - z) < 0.01
        )
