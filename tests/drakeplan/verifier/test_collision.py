"""Penetration of the surroundings, as deep as it is."""

from __future__ import annotations

import dataclasses
import itertools
from pathlib import Path

import numpy as np
import pytest
from pydrake.math import RollPitchYaw, RotationMatrix

from drakeplan.plan.plan import Plan
from drakeplan.plan.plan_file import write_plan
from drakeplan.verifier import collision, verify
from drakeplan.verifier.faces import Face, Faces, NearBoxes, box_faces, on_mesh, upright
from drakeplan.verifier.scene import Plate, Scene

EVERYWHERE = np.full(3, -1e3), np.full(3, 1e3)
MU = 0.5


def sunk_in_mesh(plan: Plan, tiles: int, sink: float) -> Plan:
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
    write_plan(sunk_in_mesh(stepping_plan, tiles=10, sink=0.003), tmp_path / "plan.h5")
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
        ((polygon, normal),) = zip(*upright(face[None]), strict=True)
        np.testing.assert_allclose(normal, own, atol=1e-12)
        rear = Face("f", polygon, normal, tapered=True).solid(*EVERYWHERE)[3:]
        apex = np.array([0.0, 0.0, 1.0])
        assert ((rear - apex) @ own).max() < 0
        assert ((rear - apex) @ other).max() < 1e-9


def test_a_box_is_six_faces_that_look_outwards() -> None:
    X_WO = np.eye(4)
    X_WO[:3, :3] = RotationMatrix(RollPitchYaw(0.3, -0.5, 1.0)).matrix()
    X_WO[:3, 3] = [1.0, 2.0, 3.0]
    size = np.array([0.2, 0.4, 0.6])
    faces = list(box_faces(Scene((), ((X_WO, size),), {}, {})))
    outward = np.array([face.normal for face in faces])
    looks = {tuple(np.round(look).astype(int)) for look in outward @ X_WO[:3, :3]}
    assert looks == {(1, 0, 0), (-1, 0, 0), (0, 1, 0), (0, -1, 0), (0, 0, 1), (0, 0, -1)}
    corners = {tuple(np.round(corner, 9)) for face in faces for corner in face.polygon}
    assert len(corners) == 8
    for face in faces:
        _, (newell,) = upright(face.polygon[None, :3])
        np.testing.assert_allclose(newell, face.normal, atol=1e-12)
        distance_to_face = (face.polygon - X_WO[:3, 3]) @ face.normal
        np.testing.assert_allclose(distance_to_face, size @ np.abs(face.normal @ X_WO[:3, :3]) / 2)
        behind = face.solid(*EVERYWHERE) - X_WO[:3, 3]
        assert (np.abs(behind @ X_WO[:3, :3]) <= size / 2 + 1e-12).all()


def test_slivers_are_left_to_their_neighbours() -> None:
    sliver = np.array([[0.0, 0, 0], [1, 0, 0], [0.5, 1e-4, 0]])
    assert Face("f", sliver, np.array([0.0, 0, 1]), tapered=True).solid(*EVERYWHERE) is None


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

    def plate(vertices: np.ndarray, normal: float = 1.0) -> Plate:
        return Plate("p", vertices, np.array([0.0, 0.0, normal]), MU, frozenset())

    assert on_mesh(plate(square), triangles, normals)
    assert on_mesh(plate(0.2 + 0.5 * square * [1, 1, 0] + [0, 0, 1e-3 - 0.2]), triangles, normals)
    assert not on_mesh(plate(np.add(square, [0.5, 0, 0])), triangles, normals)
    assert not on_mesh(plate(np.add(square, [0, 0, 0.1])), triangles, normals)
    assert not on_mesh(plate(square[::-1], -1.0), triangles, normals)


def test_the_boxes_near_a_place_are_those_that_a_look_at_all_of_them_finds() -> None:
    rng = np.random.default_rng(0)
    for _ in range(50):
        centre, half = (
            rng.uniform(-3, 3, (200, 3)),
            rng.choice([0.01, 0.2, 3.0], (200, 1)) * rng.uniform(0, 1, (200, 3)),
        )
        low, high = centre - half, centre + half
        a, b = np.sort(rng.uniform(-4, 4, (2, 3)), axis=0)
        slow = np.flatnonzero(((low <= b) & (high >= a)).all(axis=1))
        np.testing.assert_array_equal(NearBoxes(low, high).near(a, b), slow)


def test_what_is_left_out_beforehand_penetrates_nothing(stepping_plan: Plan, tmp_path: Path) -> None:
    """The culled faces and Drake agree with Drake alone, on a robot that wades through rubble."""
    rng = np.random.default_rng(1)
    corner = rng.uniform([-0.5, -0.5, -0.05], [1.0, 0.5, 0.4], (60, 1, 3))
    triangles = corner + 0.1 * rng.standard_normal((60, 3, 3))
    write_plan(dataclasses.replace(stepping_plan, triangles=triangles), tmp_path / "plan.h5")
    kinds = ("terrain collision", "sole and palm collision", "self collision")
    quick = {kind: verify(tmp_path / "plan.h5").check(kind).worst for kind in kinds}
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(collision, "_reached", lambda faces, near, *_: np.ones(len(near), dtype=bool))
        patch.setattr(collision, "TOUCH", 0.0)
        slow = {kind: verify(tmp_path / "plan.h5").check(kind).worst for kind in kinds}
    assert slow["terrain collision"] > 0.0 and slow["sole and palm collision"] > 0.0
    assert quick == pytest.approx(slow, abs=2e-4)


def test_faces_within_a_box_are_those_of_the_whole_scene_that_meet_it() -> None:
    """A floor of a mesh stays one where the box holds a part of it alone."""
    rng = np.random.default_rng(1)
    strip = [[[x, -1.0, 0.0], [x + 1.0, -1.0, 0.0], [x, 1.0, 0.0]] for x in range(20)]
    strip += [[[x + 1.0, -1.0, 0.0], [x + 1.0, 1.0, 0.0], [x, 1.0, 0.0]] for x in range(20)]
    loose = rng.uniform([0.0, -1.0, 0.1], [20.0, 1.0, 2.0], (200, 1, 3)) + rng.uniform(-0.2, 0.2, (200, 3, 3))
    floor = np.array([[0.0, -1.0, 0.0], [20.0, -1.0, 0.0], [20.0, 1.0, 0.0], [0.0, 1.0, 0.0]])
    shelf = floor + np.array([0.0, 5.0, 1.0])
    plates = tuple(Plate(n, v, np.array([0.0, 0.0, 1.0]), MU, frozenset()) for n, v in (("f", floor), ("s", shelf)))
    scene, plan = Scene(plates, (), {}, {}), {"scene/triangles": np.concatenate([np.array(strip), loose])}
    every = Faces(plan, scene, *EVERYWHERE)  # type: ignore[arg-type]
    low, high = np.array([3.0, -0.5, -0.2]), np.array([5.0, 0.5, 1.5])
    some = Faces(plan, scene, low, high)  # type: ignore[arg-type]
    wanted, found = every.near(low, high), some.near(low, high)
    assert 0 < len(found) == len(wanted) < len(every.normal)
    assert len(found) == len(some.normal)
    for a, b in zip(found, wanted, strict=True):
        assert (some[a].name, some[a].tapered) == (every[b].name, every[b].tapered)
        np.testing.assert_array_equal(some[a].polygon, every[b].polygon)
    assert some[0].name == "f" and some[0].tapered
