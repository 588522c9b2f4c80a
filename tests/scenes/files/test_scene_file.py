"""Scene files: what is written is read back, and what is wrong is refused in one line."""

import numpy as np
import pytest
import trimesh
import yaml
from hypothesis import given
from hypothesis import strategies as st

from scenes.contact import Contact, contact_pose
from scenes.disturbance import Disturbance
from scenes.effector import EFFECTORS, is_foot
from scenes.files.scene_file import read_scene, scene_from_yaml, scene_to_yaml, write_scene
from scenes.files.scene_source import load_scene
from scenes.input_error import InputError
from scenes.library import NAMED_SCENES
from scenes.library.plates import tilt_rotation
from scenes.meshes.planar_regions import GRID
from scenes.pose import pose_matrix
from scenes.scene import Goal, Scene, Start
from scenes.terrain.surface import Surface
from scenes.terrain.terrain import Box, Terrain, TriangleMesh

HEAD = "format: drakeplan-scene\nversion: 1\n"
GROUND = "surfaces: [{name: ground, vertices: [[-1,-1,0],[1,-1,0],[1,1,0],[-1,1,0]]}]\n"


def assert_same(a, b):
    """Equal to the bit, poses to rounding."""
    assert (a.name, a.robot, a.goal) == (b.name, b.robot, b.goal)
    assert a.terrain.surfaces == b.terrain.surfaces
    assert a.terrain.surfaces_of_meshes == b.terrain.surfaces_of_meshes
    np.testing.assert_allclose(a.terrain.triangles, b.terrain.triangles, atol=1e-9)
    assert [o.name for o in a.terrain.obstacles] == [o.name for o in b.terrain.obstacles]
    for p, q in zip(a.disturbances, b.disturbances, strict=True):
        np.testing.assert_array_equal(p.impulses, q.impulses)
        assert (p.probability, p.box_size) == (q.probability, q.box_size)
        if p.box_size is not None:
            np.testing.assert_allclose(p.X_WR, q.X_WR, atol=1e-12)
    assert (a.start is None) == (b.start is None)
    if a.start is not None:
        np.testing.assert_allclose(a.start.xyz, b.start.xyz, atol=1e-12)
        assert np.exp(1j * a.start.yaw) == pytest.approx(np.exp(1j * b.start.yaw))
        for c, d in zip(a.start.stance, b.start.stance, strict=True):
            assert (c.effector, c.surface, c.friction) == (d.effector, d.surface, d.friction)
            np.testing.assert_allclose(c.X_WC, d.X_WC, atol=1e-12)
            np.testing.assert_array_equal(c.p_WC, d.p_WC)


# What hypothesis draws ---------------------------------------------------------------------------------------------

COORDINATES = st.floats(-50.0, 50.0)
ANGLES = st.floats(-3.1, 3.1)
NAMES = st.text(st.characters(codec="utf-8", exclude_categories=("C", "Z")), min_size=1, max_size=12)
FRICTIONS = st.one_of(st.just(0.5), st.floats(0.0, 2.0))
TRIPLES = st.tuples(COORDINATES, COORDINATES, COORDINATES)
POSES = st.builds(pose_matrix, TRIPLES, st.tuples(ANGLES, st.one_of(ANGLES, st.just(np.pi / 2)), ANGLES))


@st.composite
def surfaces(draw, name):
    """A regular polygon, tilted, with or without a list of who may touch it; never a floor drawn upside down."""
    count, radius = draw(st.integers(3, 8)), draw(st.floats(0.1, 5.0))
    turns = 2 * np.pi * np.arange(count) / count
    flat = radius * np.stack([np.cos(turns), np.sin(turns)], axis=1)
    R = tilt_rotation(draw(ANGLES), draw(ANGLES))
    vertices = flat @ R[:, :2].T + draw(TRIPLES)
    effectors = draw(st.none() | st.frozensets(st.sampled_from(EFFECTORS if R[2, 2] >= 0 else EFFECTORS[2:])))
    return Surface(name, vertices, draw(FRICTIONS), effectors)


@st.composite
def starts(draw, surfaces):
    feet = [i for i, s in enumerate(surfaces) if s.allows("left_foot")]
    if not feet or draw(st.booleans()):
        return draw(st.none() | st.builds(Start, TRIPLES, ANGLES))
    contacts = []
    for effector in EFFECTORS:
        able = [i for i, s in enumerate(surfaces) if s.allows(effector)]
        if able and (effector == "left_foot" or draw(st.booleans())):
            i = draw(st.sampled_from(able))
            X_WC = contact_pose(effector, surfaces[i].centroid, surfaces[i].normal, draw(ANGLES))
            contacts.append(Contact(effector, i, X_WC, surfaces[i].friction))
    grounded = [c for c in contacts if is_foot(c.effector)]
    mean = np.mean([c.p_WC for c in grounded], axis=0)
    return Start(tuple(mean.tolist()), 0.0, tuple(contacts))


@st.composite
def scenes(draw):
    names = draw(st.lists(NAMES, min_size=1, max_size=4, unique=True))
    polygons = [draw(surfaces(name)) for name in names]
    boxes = [Box(f"box {i}", np.array(draw(st.tuples(*[st.floats(0.01, 3.0)] * 3))), draw(POSES)) for i in range(2)]
    pushes = [
        Disturbance(np.array([draw(TRIPLES)]), draw(st.floats(0.0, 1.0))),
        Disturbance(np.array([draw(TRIPLES), draw(TRIPLES)]), 0.5, (1.0, 2.0, 3.0), draw(POSES)),
    ]
    goal = draw(st.none() | st.builds(Goal, TRIPLES, st.floats(1e-6, 2.0), st.none() | ANGLES))
    return Scene(
        draw(NAMES),
        Terrain(tuple(polygons), tuple(boxes[: draw(st.integers(0, 2))])),
        draw(starts(polygons)),
        goal,
        draw(st.none() | NAMES),
        tuple(pushes[: draw(st.integers(0, 2))]),
    )


# Without loss ------------------------------------------------------------------------------------------------------


@given(scenes())
def test_a_scene_survives_being_written_and_read(scene):
    again = scene_from_yaml(scene_to_yaml(scene), "it")
    if scene.start is not None and scene.start.stance:
        # The heading of a stance is read off its feet, so it is compared by itself.
        yaw = again.start.yaw
        again = Scene(**{**_fields(again), "start": Start(again.start.xyz, 0.0, again.start.stance)})
        feet = [c for c in again.start.stance if is_foot(c.effector)]
        if len(feet) == 1:
            X_WC = contact_pose("left_foot", feet[0].p_WC, feet[0].R_WC[:, 2], yaw)
            np.testing.assert_allclose(X_WC, feet[0].X_WC, atol=1e-9)
    assert_same(again, scene)
    assert again.notes == ()


def _fields(scene):
    return {name: getattr(scene, name) for name in scene.__dataclass_fields__}


@given(scenes())
def test_pyyaml_alone_reads_the_same_numbers(scene):
    data = yaml.safe_load(scene_to_yaml(scene))
    for entry, surface in zip(data["surfaces"], scene.terrain.surfaces, strict=True):
        np.testing.assert_array_equal(np.array(entry["vertices"], dtype=object), surface.vertices)
        assert entry.get("friction", data["friction"]) == surface.friction


@pytest.mark.parametrize("name", NAMED_SCENES)
def test_every_named_scene_survives_a_file(name, tmp_path):
    scene = load_scene(name, seed=7)
    write_scene(scene, tmp_path / "scene.yaml")
    assert_same(read_scene(tmp_path / "scene.yaml"), scene)
    assert [p.name for p in tmp_path.iterdir()] == ["scene.yaml"]


@pytest.fixture
def meshed(tmp_path):
    """A scene file with a plate, a box and two copies of one mesh in a folder beside it."""
    (tmp_path / "parts").mkdir()
    trimesh.creation.box((1.0, 0.5, 0.2)).export(tmp_path / "parts" / "block.stl")
    text = HEAD + (
        "friction: 0.7\n"
        "surfaces: [{name: ground, vertices: [[-1,-1,0],[1,-1,0],[1,1,0],[-1,1,0]], friction: 0.4}]\n"
        "meshes:\n"
        "  - {file: parts/block.stl}\n"
        "  - {file: parts/block.stl, pose: {xyz: [3, 0, 1], rpy: [0, 0, 0.5]}, scale: 2}\n"
        "obstacles: [{name: pillar, box: [0.2, 0.2, 2], pose: {xyz: [1, 2, 3], rpy: [0.1, 0.2, 0.3]}}]\n"
    )
    (tmp_path / "meshed.yaml").write_text(text)
    return tmp_path


def test_a_mesh_becomes_surfaces_and_an_obstacle_where_its_pose_and_scale_put_it(meshed):
    scene = read_scene(meshed / "meshed.yaml")
    terrain = scene.terrain
    assert scene.name == "meshed"
    assert [o.name for o in terrain.obstacles] == ["pillar", "block", "block_1"]
    assert terrain.surfaces_of_meshes == (False,) + (True,) * 10, "five faces of a box face up or sideways"
    assert [s.friction for s in terrain.surfaces] == [0.4] + [0.7] * 10
    top = next(s for s in terrain.surfaces if s.name.startswith("mesh:block_1/") and s.tilt < 1e-6)
    np.testing.assert_allclose(top.centroid, [3.0, 0.0, 1.2], atol=GRID)
    long_edge = max(np.roll(top.vertices, -1, axis=0) - top.vertices, key=np.linalg.norm)
    assert np.linalg.norm(long_edge) == pytest.approx(2.0, abs=2 * GRID)
    assert abs(long_edge @ [np.cos(0.5), np.sin(0.5), 0]) == pytest.approx(2.0, abs=2 * GRID)


def test_a_scene_with_meshes_is_written_with_the_files_it_came_from(meshed):
    scene = read_scene(meshed / "meshed.yaml")
    write_scene(scene, meshed / "copy.yaml")
    assert "parts/block.stl" in (meshed / "copy.yaml").read_text()
    again = read_scene(meshed / "copy.yaml")
    assert_same(Scene(**{**_fields(again), "name": "meshed"}), scene)
    (meshed / "elsewhere").mkdir()
    with pytest.raises(InputError, match="in the folder of the scene file or below"):
        write_scene(scene, meshed / "elsewhere" / "copy.yaml")
    assert list((meshed / "elsewhere").iterdir()) == []


def test_a_plan_file_keeps_the_surfaces_of_meshes_in_their_order_and_the_reader_finds_their_body_again(meshed):
    scene = read_scene(meshed / "meshed.yaml")
    text = scene_to_yaml(scene, meshes_as_surfaces=True)
    assert "meshes:" not in text.replace("mesh:", "")
    again = scene_from_yaml(text, "plan.h5", mesh_triangles=scene.terrain.triangles)
    assert again.terrain.surfaces == scene.terrain.surfaces
    assert again.terrain.surfaces_of_meshes == scene.terrain.surfaces_of_meshes
    np.testing.assert_allclose(again.terrain.triangles, scene.terrain.triangles, atol=1e-12)
    assert scene_to_yaml(again, meshes_as_surfaces=True) == text


def test_without_its_triangles_a_mesh_surface_is_a_plate_and_that_is_said(meshed):
    scene = read_scene(meshed / "meshed.yaml")
    again = scene_from_yaml(scene_to_yaml(scene, meshes_as_surfaces=True), "it")
    assert not any(again.terrain.surfaces_of_meshes)
    assert again.notes == (
        "it: 10 surfaces called mesh:... come from mesh files that are not listed: used as plates of 2 cm",
    )


def test_a_mesh_that_came_from_no_file_cannot_be_written_as_one():
    mesh = TriangleMesh("rock", np.array([[[0, 0, 0], [1, 0, 0], [0, 1, 0]]], float))
    terrain = Terrain(load_scene("flat").terrain.surfaces, (mesh,))
    with pytest.raises(InputError, match="'rock' has no file"):
        scene_to_yaml(Scene("rocky", terrain))
    assert "rock" not in scene_to_yaml(Scene("rocky", terrain), meshes_as_surfaces=True).replace("rocky", "")


def test_a_file_that_cannot_be_written_leaves_nothing_behind(tmp_path):
    with pytest.raises(InputError, match="cannot be written"):
        write_scene(load_scene("flat"), tmp_path / "missing" / "scene.yaml")
    (tmp_path / "taken").mkdir()
    with pytest.raises(InputError, match="cannot be written"):
        write_scene(load_scene("flat"), tmp_path / "taken")
    assert [p.name for p in tmp_path.iterdir()] == ["taken"]


# Turned over and said ----------------------------------------------------------------------------------------------

SQUARE = "[[0,0,0],[1,0,0],[1,1,0],[0,1,0]]"
CLOCKWISE = "[[0,0,0],[0,1,0],[1,1,0],[1,0,0]]"
WALL = "[[0,1,0],[1,1,0],[1,1,1],[0,1,1]]"  # counter-clockwise seen from -y


@pytest.mark.parametrize(
    ("entry", "normal", "note"),
    [
        (f"vertices: {SQUARE}", [0, 0, 1], None),
        (
            f"vertices: {CLOCKWISE}",
            [0, 0, 1],
            "it: surfaces[0]: 'a' faced down; it was flipped so that feet can stand on it",
        ),
        (f"vertices: {CLOCKWISE}, contact: [left_foot, left_palm]", [0, 0, 1], "it: surfaces[0]: 'a' faced down"),
        (f"vertices: {CLOCKWISE}, contact: [left_palm]", [0, 0, -1], None),
        (f"vertices: {CLOCKWISE}, contact: []", [0, 0, -1], None),
        (f"vertices: {CLOCKWISE}, normal: [0, 0, -2]", [0, 0, -1], None),
        (f"vertices: {CLOCKWISE}, normal: [0, 0, 3]", [0, 0, 1], "'a' is clockwise seen from the side of its normal"),
        (f"vertices: {CLOCKWISE}, normal: [0, 0, -1], contact: [left_foot]", [0, 0, 1], "'a' faced down"),
        (f"vertices: {WALL}", [0, -1, 0], None),
        (f"vertices: {WALL}, normal: [0, 1, 0]", [0, 1, 0], "'a' is clockwise seen from the side of its normal"),
        (f"vertices: {WALL}, normal: [0, -1, 0.01]", [0, -1, 0], None),
    ],
)
def test_winding_gives_the_normal_unless_the_normal_or_the_feet_ask_for_the_other_side(entry, normal, note):
    scene = scene_from_yaml(HEAD + f"surfaces: [{{name: a, {entry}}}]", "it")
    np.testing.assert_allclose(scene.terrain.surfaces[0].normal, normal, atol=1e-12)
    assert len(scene.notes) == (note is not None)
    assert note is None or note in scene.notes[0]


# A start given as a stance -----------------------------------------------------------------------------------------


def stance(**entries):
    lines = [f"    {effector}: {entry}" for effector, entry in entries.items()]
    return HEAD + GROUND + "start:\n  stance:\n" + "\n".join(lines) + "\n"


def test_a_stance_starts_at_the_mean_of_its_feet_with_their_heading():
    text = stance(
        left_foot="{surface: ground, xyz: [0.0, 0.1, 0], rpy: [0, 0, 0.4]}",
        right_foot="{surface: ground, xyz: [0.2, -0.1, 0], rpy: [0, 0, 0.2]}",
    )
    start = scene_from_yaml(text, "it").start
    assert start.xyz == pytest.approx((0.1, 0.0, 0.0))
    assert start.yaw == pytest.approx(0.3)
    assert [c.effector for c in start.stance] == ["left_foot", "right_foot"]


def test_the_heading_of_a_foot_on_a_slope_is_the_one_that_was_projected():
    normal = np.array([0.3, -0.2, 0.9]) / np.linalg.norm([0.3, -0.2, 0.9])
    corners = contact_pose("left_foot", np.zeros(3), normal, 0.0)[:3, :3] @ np.array(
        [[-1, 1, 1, -1], [-1, -1, 1, 1], [0, 0, 0, 0]]
    )
    ramp = Surface("ramp", corners.T)
    X_WC = contact_pose("left_foot", np.zeros(3), normal, 0.7)
    scene = Scene("ramp", Terrain((ramp,)), Start((0, 0, 0), 0.7, (Contact("left_foot", 0, X_WC, 0.5, 0.7),)))
    assert scene_from_yaml(scene_to_yaml(scene), "it").start.yaw == pytest.approx(0.7)


@pytest.mark.parametrize(
    ("entry", "expected"),
    [
        (
            "{surface: grund, xyz: [0,0,0]}",
            "start.stance.left_foot.surface: unknown surface 'grund': did you mean ground?",
        ),
        ("{surface: ground, xyz: [0,0,0.1]}", "start.stance.left_foot.xyz: expected a point on 'ground'"),
        ("{surface: ground, xyz: [1.5,0,0]}", "0.5 m outside its edges"),
        ("{surface: ground, xyz: [0,0,0], rpy: [0.2,0,0]}", "expected the z axis along the normal of 'ground'"),
    ],
)
def test_a_contact_lies_on_its_surface(entry, expected):
    with pytest.raises(InputError) as error:
        scene_from_yaml(stance(left_foot=entry), "it")
    assert expected in str(error.value)


def test_a_palm_may_not_start_on_a_floor_and_a_stance_needs_a_foot():
    palm = "{surface: ground, xyz: [0, 0, 0]}"
    with pytest.raises(InputError, match="'ground' does not take a left_palm"):
        scene_from_yaml(stance(left_palm=palm), "it")
    with pytest.raises(InputError, match="expected a foot on the ground"):
        scene_from_yaml(HEAD + GROUND + "start: {stance: {}}", "it")
    with pytest.raises(InputError, match="not both"):
        scene_from_yaml(HEAD + GROUND + "start: {xyz: [0,0,0], stance: {}}", "it")
    with pytest.raises(InputError, match="expected xyz or stance"):
        scene_from_yaml(HEAD + GROUND + "start: {yaw: 1}", "it")


# Refused -----------------------------------------------------------------------------------------------------------


def surface(entry):
    return f"surfaces: [{{name: ground, vertices: {SQUARE}}}, {{name: ramp, {entry}}}]"


REFUSED = {
    "not a scene": ("- 1", "bad.yaml: format: expected a scene file"),
    "version": ("format: drakeplan-scene\nversion: 2", "bad.yaml: version: expected 1"),
    "unknown key": ("surfces: []", "bad.yaml: surfces: unknown key, did you mean 'surfaces'?"),
    "unknown key inside": (
        surface(f"vertices: {SQUARE}, mu: 1"),
        "surfaces[1].mu: unknown key, expected some of contact",
    ),
    "duplicate key": (GROUND + GROUND, "bad.yaml: the key 'surfaces' appears twice (line 4)"),
    "missing vertices": (surface("friction: 1"), "surfaces[1].vertices: missing, expected a list of [x, y, z]"),
    "two coordinates": (
        surface("vertices: [[0,0],[1,0],[1,1]]"),
        "surfaces[1].vertices[0]: expected at least 3 entries",
    ),
    "two corners": (surface("vertices: [[0,0,0],[1,0,0]]"), "surfaces[1].vertices: expected at least 3 entries"),
    "nan": (surface("vertices: [[0,0,.nan],[1,0,0],[1,1,0]]"), "vertices[0][2]: expected a finite number, got nan"),
    "infinite": (
        surface("vertices: [[0,0,1e999],[1,0,0],[1,1,0]]"),
        "vertices[0][2]: expected a finite number, got inf",
    ),
    "text": (surface("vertices: [[0,0,x],[1,0,0],[1,1,0]]"), "vertices[0][2]: expected a number, got 'x'"),
    "far": (surface("vertices: [[0,0,1e9],[1,0,0],[1,1,0]]"), "vertices[0][2]: expected at most 100000"),
    "friction": (surface(f"vertices: {SQUARE}, friction: -0.1"), "surfaces[1].friction: expected at least 0, got -0.1"),
    "scene friction": ("friction: -1\n" + GROUND, "bad.yaml: friction: expected at least 0, got -1"),
    "radius": (GROUND + "goal: {xyz: [0,0,0], radius: -0.1}", "goal.radius: expected more than 0, got -0.1"),
    "not planar": (
        surface("vertices: [[0,0,0],[1,0,0],[1,1,0.1],[0,1,0]]"),
        "surfaces[1].vertices: 'ramp' must lie in one plane, one is 0.0251 m off it; cut the polygon into flat pieces",
    ),
    "not convex": (
        surface("vertices: [[0,0,0],[1,0,0],[0.2,0.2,0],[0,1,0]]"),
        "surfaces[1].vertices: 'ramp' must be convex",
    ),
    "crossing": (
        surface("vertices: [[0,0,0],[1,1,0],[1,0,0],[0,1,0]]"),
        "surfaces[1].vertices: 'ramp' cross themselves (Self-intersection",
    ),
    "no area": (surface("vertices: [[0,0,0],[1,0,0],[2,0,0]]"), "surfaces[1].vertices: 'ramp' enclose no area"),
    "same corner": (surface("vertices: [[0,0,0],[1,0,0],[1,1,0],[0,0,0]]"), "[3] and [0] are the same"),
    "odd normal": (
        surface(f"vertices: {SQUARE}, normal: [0,1,1]"),
        "surfaces[1].normal: expected [0, 0, 1] or its opposite",
    ),
    "zero normal": (surface(f"vertices: {SQUARE}, normal: [0,0,0]"), "surfaces[1].normal: expected [0, 0, 1]"),
    "effector": (surface(f"vertices: {SQUARE}, contact: [left_hand]"), "surfaces[1].contact[0]: expected 'left_foot'"),
    "same name": (
        GROUND.replace("]}]", f"]}}, {{name: ground, vertices: {SQUARE}}}]"),
        "surfaces[1].name: 'ground' is",
    ),
    "control name": (GROUND.replace("ground", '"a\\nb"'), "surfaces[0].name: expected printable text"),
    "no surfaces": ("name: empty", "bad.yaml: surfaces: expected at least one"),
    "flat box": (GROUND + "obstacles: [{box: [1,1,0]}]", "obstacles[0].box[2]: expected more than 0, got 0"),
    "probability": (
        GROUND + "disturbances: [{impulses: [[0,1,0]], probability: 2}]",
        "disturbances[0].probability: expected at most 1, got 2",
    ),
    "goal without place": (GROUND + "goal: {radius: 1}", "goal.xyz: missing, expected [x, y, z]"),
    "no mapping": (GROUND + "goal: 3", "goal: expected a mapping"),
    "mesh above": (
        GROUND + "meshes: [{file: ../x.stl}]",
        "meshes[0].file: expected a path inside the scene file's folder",
    ),
    "mesh at root": (GROUND + "meshes: [{file: /etc/passwd}]", "meshes[0].file: expected a path inside"),
    "mesh out of package": (
        GROUND + "meshes: [{file: package://hpp_environments/../../x.stl}]",
        "bad.yaml: meshes[0].file: ",
    ),
    "mesh unknown package": (GROUND + "meshes: [{file: package://nowhere/x.stl}]", "no installed package has a folder"),
    "mesh missing": (GROUND + "meshes: [{file: x.stl}]", "x.stl: no such mesh file"),
    "mesh of another kind": (GROUND + "meshes: [{file: x.txt}]", "expected a mesh file that ends in one of .stl"),
    "mesh scale": (GROUND + "meshes: [{file: x.stl, scale: -1}]", "meshes[0].scale: expected more than 0, got -1"),
}


@pytest.mark.parametrize(("text", "expected"), REFUSED.values(), ids=REFUSED)
def test_bad_input_is_one_line_that_names_file_key_and_what_was_expected(text, expected, tmp_path):
    (tmp_path / "bad.yaml").write_text((HEAD if not text.startswith(("format", "- ")) else "") + text)
    with pytest.raises(InputError) as error:
        read_scene(tmp_path / "bad.yaml")
    message = str(error.value)
    assert expected in message
    assert "bad.yaml: " in message
    assert "\n" not in message
    assert len(message) < 400


@pytest.mark.parametrize(("off", "moved"), [(0.0, False), (2e-6, False), (1.3e-3, True), (4e-3, True)])
def test_a_polygon_that_is_nearly_flat_is_moved_onto_its_best_plane_and_that_is_said(off, moved):
    """A square with two opposite corners up and two down: the best plane is level and every corner `off` away from it."""
    corners = f"[[0,0,{off}],[1,0,{-off}],[1,1,{off}],[0,1,{-off}]]"
    scene = scene_from_yaml(HEAD + f"surfaces: [{{name: floor, vertices: {corners}}}]", "map.yaml")
    heights = scene.terrain.surfaces[0].vertices[:, 2]
    if moved:
        np.testing.assert_allclose(heights, 0.0, atol=1e-12)
        (note,) = scene.notes
        assert "map.yaml: surfaces[0]: 'floor' is not flat" in note
        assert f"by up to {1e3 * off:.2g} mm" in note
        again = scene_from_yaml(scene_to_yaml(scene), "again.yaml")
        assert again.notes == ()
    else:
        np.testing.assert_array_equal(np.abs(heights), off)
        assert scene.notes == ()


def test_more_than_five_millimetres_off_the_plane_is_refused_with_the_distance():
    corners = "[[0,0,0.006],[1,0,-0.006],[1,1,0.006],[0,1,-0.006]]"
    with pytest.raises(InputError, match=r"one is 0.006 m off it; cut the polygon into flat pieces"):
        scene_from_yaml(HEAD + f"surfaces: [{{name: floor, vertices: {corners}}}]", "map.yaml")
