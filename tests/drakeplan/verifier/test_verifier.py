"""The verifier stands alone, and its parts agree with closed forms and with slow, obvious twins."""

from __future__ import annotations

import ast
import dataclasses
import itertools
import json
import shutil
import subprocess
import sys
from pathlib import Path

import h5py
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from pydrake.math import RollPitchYaw, RotationMatrix
from scipy.spatial import ConvexHull

from drakeplan import verifier
from drakeplan.plan.plan import Plan, PlanContacts
from drakeplan.plan.plan_file import write_plan
from drakeplan.verifier import CONES, TRUE_CONE, Cone, UnreadablePlan, verify, wrench_distance

SOURCE = Path(verifier.__file__)
HALF = np.array([0.11, 0.05])  # [m] of a sole
MU = 0.5
EVERYWHERE = np.full(3, -1e3), np.full(3, 1e3)


@pytest.fixture(scope="module")
def good(stepping_plan: Plan, tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("plans") / "good.h5"
    write_plan(stepping_plan, path)
    return path


# ---- it stands alone


def test_the_verifier_shares_no_code_with_what_it_judges() -> None:
    allowed = {"numpy", "scipy", "h5py", "yaml", "pydrake"} | set(sys.stdlib_module_names)
    for node in ast.walk(ast.parse(SOURCE.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            imported = [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0
            imported = [node.module or ""]
        elif isinstance(node, ast.Call) and isinstance(node.func, ast.Name):
            assert node.func.id not in ("__import__", "exec", "eval"), f"line {node.lineno}"
            continue
        else:
            continue
        for module in imported:
            assert module.split(".")[0] in allowed - {"importlib", "runpy"}, f"line {node.lineno} imports {module}"


def test_the_file_alone_judges_a_plan_without_the_packages(good: Path, tmp_path: Path) -> None:
    alone = shutil.copy(SOURCE, tmp_path / "judge.py")
    code = (
        "import sys, runpy\n"
        "for name in ('drakeplan', 'scenes', 'optimization', 'learning'): sys.modules[name] = None  # no import\n"
        f"sys.argv = ['judge.py', {str(good)!r}, '--json']\n"
        f"runpy.run_path({str(alone)!r}, run_name='__main__')\n"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert json.loads(done.stdout)["holds"] is True


# ---- reports


def test_a_report_is_a_table_for_people_and_plain_data_for_programs(good: Path) -> None:
    report = verify(good)
    lines = report.table().splitlines()
    assert len(lines) == len(report.checks) + 1
    assert lines[-1] == "the plan holds"
    data = json.loads(json.dumps(report.as_dict(), allow_nan=False))
    assert data["failed"] == []
    assert {"name", "ok", "worst", "limit", "unit", "where"} == set(data["checks"][0])
    assert len({check.name for check in report.checks}) == len(report.checks)


def test_what_is_not_a_number_never_passes() -> None:
    sheet = verifier._Sheet()
    assert not sheet.add("a NaN", [0.0, np.nan, 1.0], 2.0, "m", lambda i: f"entry {i[0]}")
    assert sheet.checks[0].where == "entry 1"
    assert not sheet.add("nothing", [], 1.0, "m", "nowhere")
    assert sheet.add("nothing, rightly", [], 1.0, "m", "nowhere", empty="a single stance")
    assert verifier.Report("x", tuple(sheet.checks)).as_dict()["checks"][0]["worst"] is None
    assert not verifier.Report("x", ()).holds


def test_a_plan_without_motion_is_judged_as_far_as_it_goes_and_does_not_hold(
    stepping_plan: Plan, tmp_path: Path
) -> None:
    contacts = dataclasses.replace(stepping_plan, phases=None, centroidal=None, motion=None)
    write_plan(contacts, tmp_path / "plan.h5")
    report = verify(tmp_path / "plan.h5")
    assert report.failed == ("complete",)
    assert not report.holds
    assert report.check("patch uncovered").ok


# ---- what it refuses to judge


@pytest.mark.parametrize(
    ("name", "value", "expected"),
    [
        ("format", "weather", "expected format"),
        ("version", 7, "expected format"),
        ("friction_cone", "ice cream", "friction_cone: expected one of"),
        ("status", "fine", "attribute status"),
        ("mass", "heavy", "attribute mass"),
        ("robot_model_sha256", "0" * 64, "made for another robot model"),
        ("robot_model", "/no/such/model.urdf", "there is no robot model"),
    ],
)
def test_a_foreign_attribute_is_refused_in_one_line(
    good: Path, tmp_path: Path, name: str, value: object, expected: str
) -> None:
    path = Path(shutil.copy(good, tmp_path / "plan.h5"))
    with h5py.File(path, "r+") as file:
        file.attrs[name] = value
    with pytest.raises(UnreadablePlan, match=expected) as caught:
        verify(path)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("name", "value", "expected"),
    [
        ("contacts/X_WC", None, "contacts/X_WC: the dataset is missing"),
        ("motion/q", np.zeros((3, 34)), "motion/q: expected a length of"),
        ("motion/v", np.zeros(5), "motion/v: expected 2 dimensions"),
        ("stances/contact", np.zeros((5, 4)), "stances/contact: expected integers"),
        ("effectors", ["left_foot", "right_foot", "right_palm", "left_palm"], "effectors: expected"),
        ("scene/yaml", "surfaces: 3", "scene/yaml: not a scene"),
        ("scene/yaml", "- [" * 1, "scene/yaml: not a scene"),
        ("scene/yaml", "[" * 100_000, "nested too deep"),
        ("scene/yaml", "- " * 100_000, "nested too deep"),
        ("scene/yaml", "surfaces: [{vertices: [[0, 0, 0], [1, 1, 0], [2, 2, 0]]}]", "encloses no area"),
        (
            "scene/yaml",
            "surfaces: [{vertices: [[0, 0, .nan], [1, 1, 0], [2, 0, 0]]}]",
            "convert string to float: '.nan'",
        ),
        ("scene/yaml", "surfaces: [{vertices: [[0, 0, nan], [1, 1, 0], [2, 0, 0]]}]", "finite numbers"),
        ("scene/yaml", "a: &a [1]\nsurfaces: *a", "aliases are not for scenes"),
        ("scene/yaml", "surfaces: []\nsurfaces: []", "a key stands twice"),
        ("scene/yaml", "{a: 1}\n---\n{b: 1}", "expected one document"),
        ("scene/yaml", "surfaces: []\nobstacles: [{box: [1, 2]}]", "scene/yaml: not a scene"),
    ],
)
def test_a_misshapen_dataset_is_refused_in_one_line(
    good: Path, tmp_path: Path, name: str, value: object, expected: str
) -> None:
    path = Path(shutil.copy(good, tmp_path / "plan.h5"))
    with h5py.File(path, "r+") as file:
        del file[name]
        if value is not None:
            file[name] = value
    with pytest.raises(UnreadablePlan, match=expected) as caught:
        verify(path)
    assert "\n" not in str(caught.value)
    assert str(path) in str(caught.value) or name in str(caught.value)


def test_a_scene_without_start_or_goal_is_refused(good: Path, tmp_path: Path) -> None:
    path = Path(shutil.copy(good, tmp_path / "plan.h5"))
    with h5py.File(path, "r+") as file:
        text = file["scene/yaml"].asstr()[()]
        file["scene/yaml"][()] = text.split("start:")[0]
    with pytest.raises(UnreadablePlan, match="start or goal is missing"):
        verify(path)


def test_truncated_foreign_and_missing_files_are_refused(good: Path, tmp_path: Path) -> None:
    whole = good.read_bytes()
    path = tmp_path / "plan.h5"
    for content in (whole[: len(whole) // 2], b"walk there", b""):
        path.write_bytes(content)
        with pytest.raises(UnreadablePlan):
            verify(path)
    with pytest.raises(UnreadablePlan, match="no such plan file"):
        verify(tmp_path / "nowhere.h5")


def test_another_model_is_refused_even_if_it_would_do(good: Path, stepping_plan: Plan, tmp_path: Path) -> None:
    lighter = tmp_path / "escher.urdf"
    lighter.write_text(Path(stepping_plan.robot_model).read_text() + "<!-- -->")
    with pytest.raises(UnreadablePlan, match="made for another robot model"):
        verify(good, robot_model=lighter)
    same = shutil.copy(stepping_plan.robot_model, tmp_path / "same.urdf")
    assert verify(good, robot_model=same).holds


# ---- admissible wrenches, in closed form


def distance(f_C: list[float], cop: list[float], torque: float, cone: Cone = TRUE_CONE, mu: float = MU) -> float:
    one = [np.array([value], dtype=float) for value in (f_C, cop, torque, HALF, mu)]
    return float(wrench_distance(cone, *one)[0])


@pytest.mark.parametrize("direction", np.deg2rad([0.0, 17.0, 45.0, 100.0]))
def test_a_block_slides_where_the_slope_exceeds_the_friction_angle(direction: float) -> None:
    for steeper, slides in ((-1e-4, False), (0.01, True)):
        slope = np.arctan(MU) + steeper
        along = np.sin(slope) * np.array([np.cos(direction), np.sin(direction)])
        found = distance([*along, np.cos(slope)], [0.0, 0.0], 0.0)
        assert (found > 1e-3) == slides
        assert slides or found < 1e-9


def test_the_cones_stop_where_their_names_say() -> None:
    # Along x the octagon has a vertex on the true cone, the square an edge, the diamond a vertex outside.
    steepest = {"inner": MU, "second_order": MU, "square": MU / np.sqrt(2), "diamond": np.sqrt(2) * MU}
    for name, slope in steepest.items():
        assert distance([slope - 1e-6, 0.0, 1.0], [0.0, 0.0], 0.0, CONES[name]) < 1e-8, name
        assert distance([slope + 1e-3, 0.0, 1.0], [0.0, 0.0], 0.0, CONES[name]) > 1e-5, name
    # Between the octagon's vertices its edge is nearer by cos 22.5 deg.
    edge = MU * np.cos(np.pi / 8) * np.array([np.cos(np.pi / 8), np.sin(np.pi / 8)])
    assert distance([*(0.999 * edge), 1.0], [0.0, 0.0], 0.0, CONES["inner"]) < 1e-9
    assert distance([*(1.01 * edge), 1.0], [0.0, 0.0], 0.0, CONES["inner"]) > 1e-4
    assert distance([*(1.01 * edge), 1.0], [0.0, 0.0], 0.0, TRUE_CONE) < 1e-9


def test_pressure_reaches_the_rim_and_no_farther() -> None:
    assert distance([0.0, 0.0, 1.0], [HALF[0], HALF[1]], 0.0) < 1e-9
    beyond = 0.004  # [m]; taking the load back by this much restores the moment, so it is the distance
    assert distance([0.0, 0.0, 1.0], [HALF[0] + beyond, 0.0], 0.0) == pytest.approx(beyond, rel=0.2)


def test_at_a_corner_nothing_is_left_to_turn_with() -> None:
    assert distance([0.3, 0.0, 1.0], [HALF[0], HALF[1]], 0.0) < 1e-9
    assert distance([0.3, 0.0, 1.0], [HALF[0], HALF[1]], 0.01) > 1e-4


def test_the_greatest_yaw_torque_is_friction_times_the_corners_distance() -> None:
    greatest = MU * np.hypot(*HALF)
    assert distance([0.0, 0.0, 1.0], [0.0, 0.0], 0.999 * greatest) < 1e-9
    assert distance([0.0, 0.0, 1.0], [0.0, 0.0], 1.01 * greatest) > 1e-4


def test_a_contact_cannot_pull_nor_push_sideways_without_load() -> None:
    assert distance([0.0, 0.0, -0.1], [0.0, 0.0], 0.0) == pytest.approx(0.1, abs=1e-6)
    assert distance([0.1, 0.0, 0.0], [0.0, 0.0], 0.0) > 0.05
    assert distance([0.0, 0.0, 0.0], [0.0, 0.0], 0.0) == 0.0


@given(seed=st.integers(0, 10_000), name=st.sampled_from(sorted(CONES)))
def test_whatever_four_corners_push_is_admissible(seed: int, name: str) -> None:
    rng = np.random.default_rng(seed)
    cone, corners = CONES[name], np.array([[1, 1], [-1, 1], [-1, -1], [1, -1]]) * HALF
    rays = Cone(32).rays(MU) if name == "second_order" else cone.rays(MU)
    forces = (rays @ (rng.random((rays.shape[1], 4)) * (rng.random((rays.shape[1], 4)) < 0.2))).T
    total = forces.sum(axis=0)
    if total[2] < 1e-6:
        return
    moment = np.cross(np.column_stack([corners, np.zeros(4)]), forces).sum(axis=0)
    cop = np.array([-moment[1], moment[0]]) / total[2]
    torque = moment[2] - (cop[0] * total[1] - cop[1] * total[0])
    assert distance(list(total), list(cop), torque, cone) < 1e-7
    if name in ("inner", "square"):  # inside the true cone
        assert distance(list(total), list(cop), torque, TRUE_CONE) < 1e-7


@given(seed=st.integers(0, 10_000))
def test_what_the_closed_form_admits_the_program_admits_too(seed: int) -> None:
    rng = np.random.default_rng(seed)
    f = np.array([*rng.uniform(-0.4, 0.4, 2), 1.0])
    cop, torque = rng.uniform(-1, 1, 2) * HALF, rng.uniform(-0.03, 0.03)
    found = distance(list(f), list(cop), torque, CONES["inner"])
    wrench = np.array([*f, cop[1], -cop[0], cop[0] * f[1] - cop[1] * f[0] + torque])
    block = verifier._corner_wrenches(np.eye(4), HALF, CONES["inner"].rays(MU), np.zeros(3))
    program = verifier._distance_to_cones([block], wrench[None])[0]
    assert found == pytest.approx(program, abs=1e-7)


# ---- scenes


def test_a_scene_is_read_as_the_rest_of_the_world_reads_yaml() -> None:
    text = """
friction: 1e-1
surfaces:
  - {name: "null", vertices: [[0, 0, 0], [1, 0, 0], [1, 1, 0]], friction: null}
  - name: down
    vertices: [[0, 0, 0], [1, 0, 0], [1, 1, 0]]
    normal: [0, 0, -1]
    contact: [left_palm]
obstacles:
- {box: [1, 2, 3], pose: {xyz: [1, 0, 0], rpy: [0, 0, 1.5707963267948966]}}
goal: {xyz: [1, 0, 0], yaw: ~}
"""
    scene = verifier._read_scene(text)
    assert [plate.name for plate in scene.plates] == ["null", "down"]
    assert [plate.friction for plate in scene.plates] == [0.1, 0.1]
    assert scene.plates[0].allowed == {"left_foot", "right_foot"}
    assert scene.plates[1].allowed == {"left_palm"}
    np.testing.assert_array_equal(scene.plates[1].normal, [0, 0, -1])
    X_WO, size = scene.boxes[0]
    np.testing.assert_allclose(X_WO[:3, :2], [[0, -1], [1, 0], [0, 0]], atol=1e-15)
    np.testing.assert_array_equal(size, [1, 2, 3])
    assert scene.goal["yaw"] is None


# ---- covered patches


@given(seed=st.integers(0, 10_000))
def test_clipping_finds_the_highest_point_over_a_patch(seed: int) -> None:
    """Against the twin that looks at many points of the polygon."""
    rng = np.random.default_rng(seed)
    outline = rng.uniform(-1, 1, (12, 2))
    outline = outline[ConvexHull(outline).vertices]
    slope, height = rng.uniform(-0.5, 0.5, 2), rng.uniform(-0.3, 0.8)
    polygon = np.column_stack([outline, outline @ slope + height])
    low, high = np.array([-0.3, -0.2, 0.0]), np.array([0.3, 0.2, 0.5])
    clipped = verifier._clip(polygon, low, high)
    grid = np.stack(np.meshgrid(*(np.linspace(low[k], high[k], 121) for k in range(2))), axis=-1).reshape(-1, 2)
    hull = ConvexHull(outline)
    inside = (grid @ hull.equations[:, :2].T + hull.equations[:, 2] < 0).all(axis=1)
    z = grid[inside] @ slope + height
    z = z[(z >= 0) & (z <= 0.5)]
    step = 0.01  # [m] what the grid may miss: its spacing times the slope, and slivers between its points
    if len(z) > 30:
        assert z.max() - 1e-9 <= clipped[:, 2].max() <= z.max() + step
    if not len(clipped):
        assert not len(z)
    if len(clipped):
        assert (clipped >= low - 1e-12).all()
        assert (clipped <= high + 1e-12).all()


@pytest.mark.parametrize(
    ("x", "z", "covers"),
    [
        (0.110, 0.1, False),  # a step up that touches the sole's edge
        (0.108, 0.1, False),  # 2 mm under the sole's edge: rounding
        (0.100, 0.1, True),  # 1 cm into the sole
        (0.100, 0.002, False),  # a plate 2 mm higher
        (0.100, 0.006, True),  # a plate 6 mm higher
        (0.100, -0.01, False),  # a plate under the sole
        (-1.0, 0.05, True),  # a shelf that a foot does not fit under
        (-1.0, 0.5, False),  # a table
    ],
)
def test_a_neighbour_covers_a_sole_when_it_stands_in_it(
    stepping_plan: Plan, tmp_path: Path, x: float, z: float, covers: bool
) -> None:
    """A plate from x on, at height z, and the riser under it; the soles end at x = 0.11."""
    added = (
        f"  - {{name: step, vertices: [[{x}, -0.5, {z}], [1, -0.5, {z}], [1, 0, {z}], [{x}, 0, {z}]]}}\n"
        f"  - {{name: riser, vertices: [[{x}, 0, -1], [{x}, 0, {z}], [{x}, -0.5, {z}], [{x}, -0.5, -1]]}}\n"
    )
    table = stepping_plan.contacts
    feet = PlanContacts(table.X_WC[:2], table.effector[:2], table.surface[:2], table.friction[:2])
    text = stepping_plan.scene_yaml.replace("obstacles:", f"{added}obstacles:")
    standing = dataclasses.replace(
        stepping_plan,
        scene_yaml=text,
        contacts=feet,
        stances=stepping_plan.stances[:1],
        phases=None,
        centroidal=None,
        motion=None,
    )
    write_plan(standing, tmp_path / "plan.h5")
    check = verify(tmp_path / "plan.h5").check("patch uncovered")
    assert check.ok != covers, check


# ---- motion


@given(st.integers(0, 10_000))
def test_a_steady_turn_has_that_angular_velocity(seed: int) -> None:
    rng = np.random.default_rng(seed)
    w_WB, dt = rng.uniform(-3, 3, 3), 0.02
    q = np.zeros((2, 7))
    R = RotationMatrix(RollPitchYaw(rng.uniform(-1, 1, 3)))
    angle = np.linalg.norm(w_WB) * dt
    K = np.cross(np.eye(3), w_WB * dt / angle)  # Rodrigues: R1 = exp(w dt) R0
    turned = RotationMatrix(np.eye(3) + np.sin(angle) * K + (1 - np.cos(angle)) * K @ K) @ R
    q[0, :4], q[1, :4] = R.ToQuaternion().wxyz(), turned.ToQuaternion().wxyz()
    if q[0, :4] @ q[1, :4] < 0:
        q[1, :4] *= -1
    q[1, 4:] = [0.02, 0.04, 0.06]
    found = verifier._difference(np.array([0.0, dt]), q)[0]
    np.testing.assert_allclose(found, [*w_WB, 1.0, 2.0, 3.0], atol=1e-9)


@given(st.floats(0.0, 3.0))
def test_the_angle_between_two_frames_is_the_angle_one_was_turned_by(angle: float) -> None:
    R = RotationMatrix(RollPitchYaw(0.3, -0.2, 1.0)).matrix()
    turned = R @ RotationMatrix.MakeXRotation(angle).matrix()
    assert verifier._angle(turned[None], R)[0] == pytest.approx(angle, abs=1e-7)


# ---- collision


def on_mesh(plan: Plan, tiles: int, sink: float) -> Plan:
    """The same plan on a floor of many triangles, everything `sink` metres lower than the floor."""
    edge = np.linspace(-0.5, 0.5, tiles + 1)
    squares = [
        [[a, c, 0.0], [b, c, 0.0], [b, d, 0.0], [a, d, 0.0]]
        for a, b in itertools.pairwise(edge)
        for c, d in itertools.pairwise(edge)
    ]
    triangles = np.array([[s[i] for i in corner] for s in squares for corner in ((0, 1, 2), (0, 2, 3))])
    q = plan.motion.q.copy()
    q[:, 6] -= sink
    triangles = np.concatenate([triangles, plan.triangles])
    return dataclasses.replace(plan, triangles=triangles, motion=dataclasses.replace(plan.motion, q=q))


def test_a_sole_3_mm_deep_in_a_fine_mesh_is_3_mm_deep(stepping_plan: Plan, tmp_path: Path) -> None:
    """Point-pair penetration alone says 17 mm here."""
    write_plan(on_mesh(stepping_plan, tiles=10, sink=0.003), tmp_path / "plan.h5")
    check = verify(tmp_path / "plan.h5").check("sole and palm collision")
    assert check.worst == pytest.approx(0.003, abs=1e-4)


def test_a_mesh_is_not_taken_for_its_convex_hull(stepping_plan: Plan, tmp_path: Path) -> None:
    """The robot walks through a gate whose hull it would fill."""
    gate = np.concatenate(
        [
            [[[0.1, y, 0.5], [0.2, y, 0.5], [0.1, y, 2.2]], [[0.1, -1.2, 2.2], [0.2, -1.2, 2.2], [0.1, 1.2, 2.2]]]
            for y in (-1.2, 1.2)
        ]
    )
    triangles = np.concatenate([stepping_plan.triangles, gate])
    write_plan(dataclasses.replace(stepping_plan, triangles=triangles), tmp_path / "plan.h5")
    report = verify(tmp_path / "plan.h5")
    assert report.holds, report.table()


def test_frusta_do_not_poke_through_the_far_side_of_a_ridge() -> None:
    """Behind every face of a wedge of 50 deg, the verifier's bodies stay inside the wedge."""
    half = np.deg2rad(25.0)
    left = np.array([[0.0, 0.0, 1.0], [-np.sin(half), 0.0, 1.0 - np.cos(half)], [0.0, 1.0, 1.0]])
    right = left * [-1.0, 1.0, 1.0]
    normals = [np.array([-np.cos(half), 0.0, np.sin(half)]), np.array([np.cos(half), 0.0, np.sin(half)])]
    for face, own, other in ((left, *normals), (right[::-1], *normals[::-1])):
        if np.cross(face[1] - face[0], face[2] - face[0]) @ own < 0:
            face = face[::-1]
        ((polygon, normal),) = zip(*verifier._upright(face[None]), strict=True)
        np.testing.assert_allclose(normal, own, atol=1e-12)
        rear = verifier._Face("f", polygon, normal, tapered=True).solid(*EVERYWHERE)[3:]
        apex = np.array([0.0, 0.0, 1.0])
        assert ((rear - apex) @ own).max() < 0
        assert ((rear - apex) @ other).max() < 1e-9


def test_a_box_is_six_faces_that_look_outwards() -> None:
    X_WO = np.eye(4)
    X_WO[:3, :3] = RotationMatrix(RollPitchYaw(0.3, -0.5, 1.0)).matrix()
    X_WO[:3, 3] = [1.0, 2.0, 3.0]
    size = np.array([0.2, 0.4, 0.6])
    faces = list(verifier._boxes(verifier._Scene((), ((X_WO, size),), {}, {})))
    outward = np.array([face.normal for face in faces])
    looks = {tuple(np.round(look).astype(int)) for look in outward @ X_WO[:3, :3]}
    assert looks == {(1, 0, 0), (-1, 0, 0), (0, 1, 0), (0, -1, 0), (0, 0, 1), (0, 0, -1)}
    corners = {tuple(np.round(corner, 9)) for face in faces for corner in face.polygon}
    assert len(corners) == 8
    for face in faces:
        _, (newell,) = verifier._upright(face.polygon[None, :3])
        np.testing.assert_allclose(newell, face.normal, atol=1e-12)
        distance_to_face = (face.polygon - X_WO[:3, 3]) @ face.normal
        np.testing.assert_allclose(distance_to_face, size @ np.abs(face.normal @ X_WO[:3, :3]) / 2)
        behind = face.solid(*EVERYWHERE) - X_WO[:3, 3]
        assert (np.abs(behind @ X_WO[:3, :3]) <= size / 2 + 1e-12).all()


def test_slivers_are_left_to_their_neighbours() -> None:
    sliver = np.array([[0.0, 0, 0], [1, 0, 0], [0.5, 1e-4, 0]])
    assert verifier._Face("f", sliver, np.array([0.0, 0, 1]), tapered=True).solid(*EVERYWHERE) is None


def test_ground_without_end_is_judged_in_no_time_and_as_deep_as_it_is(stepping_plan: Plan, tmp_path: Path) -> None:
    """Drake's signed distance never returns for a sole in a plate of this size."""
    text = stepping_plan.scene_yaml.replace(
        "[[-1, -1, 0], [2, -1, 0], [2, 0.6, 0], [-1, 0.6, 0]]",
        "[[-900, -900, 0], [900, -900, 0], [900, 900, 0], [-900, 900, 0]]",
    )
    q = stepping_plan.motion.q - 0.003 * np.eye(stepping_plan.motion.q.shape[1])[6]
    motion = dataclasses.replace(stepping_plan.motion, q=q)
    write_plan(dataclasses.replace(stepping_plan, scene_yaml=text, motion=motion), tmp_path / "plan.h5")
    report = verify(tmp_path / "plan.h5")
    assert report.holds, report.table()
    assert report.check("sole and palm collision").worst == pytest.approx(0.003, abs=1e-4)


def test_surfaces_that_lie_on_a_mesh_are_its_body_and_not_another_plate() -> None:
    square = np.array([[0.0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]])
    triangles = np.array([square[[0, 1, 2]], square[[0, 2, 3]]])
    normals = np.tile([0.0, 0.0, 1.0], (2, 1))

    def plate(vertices: np.ndarray, normal: float = 1.0) -> verifier._Plate:
        return verifier._Plate("p", vertices, np.array([0.0, 0.0, normal]), MU, frozenset())

    assert verifier._on_mesh(plate(square), triangles, normals)
    assert verifier._on_mesh(plate(0.2 + 0.5 * square * [1, 1, 0] + [0, 0, 1e-3 - 0.2]), triangles, normals)
    assert not verifier._on_mesh(plate(np.add(square, [0.5, 0, 0])), triangles, normals)
    assert not verifier._on_mesh(plate(np.add(square, [0, 0, 0.1])), triangles, normals)
    assert not verifier._on_mesh(plate(square[::-1], -1.0), triangles, normals)


def test_a_long_way_is_checked_stretch_by_stretch_without_losing_a_piece() -> None:
    """Every piece that a body touches in a frame is in that frame's group."""
    rng = np.random.default_rng(0)
    centres = rng.uniform([0, -0.4, 0], [30, 0.4, 1], (1500, 3))
    up = np.array([0.0, 0.0, 1.0])
    faces = [verifier._Face("f", c + 0.02 * rng.standard_normal((3, 3)), up, tapered=True) for c in centres]
    origins = np.column_stack([np.linspace(0, 30, 1500), np.zeros(1500), np.full(1500, 0.5)])[:, None]
    radii = np.array([0.3])
    groups = list(verifier._groups(origins, radii, faces))
    assert [k for frames, _ in groups for k in range(frames.start, frames.stop)] == list(range(1500))
    assert len(groups) > 1
    low, high = (np.array([getattr(f.polygon, end)(axis=0) for f in faces]) for end in ("min", "max"))
    for frames, near in groups:
        assert np.ptp(origins[frames, 0], axis=0).max() < verifier.STRETCH + 2.0
        for origin in origins[frames, 0]:
            apart = (low > origin + radii).any(axis=1) | (high < origin - radii).any(axis=1)
            assert set(np.flatnonzero(~apart)) <= set(near)


# ---- where it starts


@given(st.floats(-3.0, 3.0), st.floats(-0.7, 0.7), st.floats(-0.7, 0.7))
def test_a_heading_is_read_back_from_feet_on_tilted_ground(yaw: float, roll: float, pitch: float) -> None:
    normal = RotationMatrix(RollPitchYaw(roll, pitch, 0.0)).matrix()[:, 2]
    forward = np.array([np.cos(yaw), np.sin(yaw), 0.0])
    x = forward - (forward @ normal) * normal
    x /= np.linalg.norm(x)
    X = np.eye(4)
    X[:3, :3] = np.column_stack([x, np.cross(normal, x), normal])
    plan = verifier._PlanFile(Path(), {}, 1.0, {"contacts/X_WC": np.stack([X, X])}, {}, {})
    _, heading = verifier._feet(plan, np.array([0, 1, -1, -1]))
    assert abs(verifier._wrap(heading - yaw)) < 1e-9
