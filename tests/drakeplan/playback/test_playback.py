"""Playback shows what the plan says, in few keyframes that play the same, on a page that needs nothing else."""

from __future__ import annotations

import dataclasses
import itertools
import re

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from drakeplan import playback
from drakeplan.plan.plan import Plan
from drakeplan.playback import animation, keyframes, terrain_mesh, view
from drakeplan.playback.frame_times import MAX_FRAMES, frame_times
from drakeplan.playback.still import predicted_com
from scenes.input_error import InputError
from scenes.terrain.surface import Surface

PAGE_LIMIT = 15e6  # [bytes] what a page may weigh
UNIT_SQUARE = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [1.0, 1.0, 0.0], [0.0, 1.0, 0.0]])


# ---- keyframes


@given(st.integers(0, 10_000), st.integers(2, 80), st.floats(1e-3, 0.3))
def test_dropped_positions_come_back_within_the_tolerance(seed: int, count: int, tolerance: float) -> None:
    rng = np.random.default_rng(seed)
    times = np.cumsum(rng.uniform(0.01, 0.1, count))
    positions = np.cumsum(rng.normal(0.0, 0.05, (count, 3)), axis=0)
    kept = keyframes.thin_positions(times, positions, tolerance)
    played = np.stack([np.interp(times, times[kept], column[kept]) for column in positions.T], axis=1)
    assert np.linalg.norm(played - positions, axis=1).max() <= tolerance + 1e-12
    assert kept[0] == 0
    assert kept[-1] == count - 1


@given(st.integers(0, 10_000), st.floats(0.01, 0.3))
def test_dropped_rotations_come_back_within_the_tolerance_on_the_great_circle(seed: int, tolerance: float) -> None:
    rng = np.random.default_rng(seed)
    times = np.linspace(0.0, 1.0, 60)
    quaternions = np.cumsum(rng.normal(0.0, 0.03, (60, 4)), axis=0) + np.array([1.0, 0.0, 0.0, 0.0])
    quaternions /= np.linalg.norm(quaternions, axis=1, keepdims=True)
    kept = keyframes.thin_quaternions(times, quaternions, tolerance)
    for first, last in itertools.pairwise(kept):
        for k in range(first, last + 1):
            shown = _slerp(quaternions[first], quaternions[last], (k - first) / (last - first))
            angle = 2 * np.arccos(min(1.0, abs(shown @ quaternions[k])))
            assert angle <= 1.02 * tolerance + 1e-6


def test_a_steady_motion_needs_only_its_ends() -> None:
    times = np.linspace(0.0, 2.0, 51)
    assert keyframes.thin_positions(times, np.outer(times, [1.0, 2.0, 3.0]), 1e-6).tolist() == [0, 50]


def test_signs_are_made_continuous_without_turning_anything() -> None:
    angles = np.linspace(0.0, 9.0, 40)
    smooth = np.stack([np.cos(angles / 2), np.sin(angles / 2), 0 * angles, 0 * angles], axis=1)
    flips = np.where(np.arange(40) % 3 == 1, -1.0, 1.0)
    mended = keyframes.continuous_signs(smooth * flips[:, None])
    np.testing.assert_allclose(mended, smooth)


def test_frames_reach_the_end_of_the_motion_and_stay_bounded() -> None:
    frames = frame_times(3.3)
    assert frames.t[-1] >= 3.3
    assert frames.t[-2] < 3.3
    assert len(frame_times(3600.0).t) <= MAX_FRAMES + 1


def _slerp(a: np.ndarray, b: np.ndarray, share: float) -> np.ndarray:
    angle = np.arccos(np.clip(a @ b, -1.0, 1.0))
    if angle < 1e-9:
        return a
    return (np.sin((1 - share) * angle) * a + np.sin(share * angle) * b) / np.sin(angle)


# ---- terrain


def test_a_plate_is_a_closed_body_as_thick_as_it_should_be() -> None:
    tilted = UNIT_SQUARE @ np.array([[0.8, 0.0, 0.6], [0.0, 1.0, 0.0], [-0.6, 0.0, 0.8]])
    mesh = terrain_mesh.plate_mesh([Surface("s", tilted)], [0])
    volume = np.einsum("ij,ij->i", mesh.triangles[:, 0], np.cross(mesh.triangles[:, 1], mesh.triangles[:, 2])).sum() / 6
    assert volume == pytest.approx(terrain_mesh.PLATE + terrain_mesh.LIFT)  # its face is one square metre
    normals = np.cross(mesh.triangles[:, 1] - mesh.triangles[:, 0], mesh.triangles[:, 2] - mesh.triangles[:, 0])
    np.testing.assert_allclose(normals.sum(axis=0), 0.0, atol=1e-12)  # a closed body has no net area


def test_a_tube_keeps_its_radius_along_a_straight_path() -> None:
    path = np.linspace([0.0, 0.0, 1.0], [2.0, 1.0, 1.5], 9)
    vertices, faces = terrain_mesh.tube(path, radius=0.01, sides=8)
    ahead = (path[-1] - path[0]) / np.linalg.norm(path[-1] - path[0])
    offset = vertices - path[0]
    distance = np.linalg.norm(offset - np.outer(offset @ ahead, ahead), axis=1)
    np.testing.assert_allclose(distance, 0.01, atol=1e-12)
    assert faces.max() == len(vertices) - 1


def test_facets_in_one_plane_share_a_colour_so_that_their_overlap_does_not_flicker() -> None:
    shifted = [Surface(f"s{i}", UNIT_SQUARE + np.array([0.3 * i, 0.0, 0.0])) for i in range(3)]
    above = Surface("above", UNIT_SQUARE + np.array([0.0, 0.0, 0.5]))
    mesh = terrain_mesh.facet_mesh([*shifted, above], range(4))
    assert len(np.unique(mesh.colours[:6], axis=0)) == 1
    assert not np.array_equal(mesh.colours[0], mesh.colours[-1])


# ---- view


@given(st.integers(0, 10_000))
def test_the_camera_sees_every_point(seed: int) -> None:
    rng = np.random.default_rng(seed)
    path = np.cumsum(rng.uniform(-0.1, 0.4, (12, 3)), axis=0)
    points = np.concatenate([path, path + rng.normal(0, 0.5, path.shape)])
    chosen = view.choose_view(path, points, np.zeros((0, 3, 3)))
    towards = (chosen.eye - chosen.target) / np.linalg.norm(chosen.eye - chosen.target)
    right = np.cross([0.0, 0.0, 1.0], towards)
    right /= np.linalg.norm(right)
    up = np.cross(towards, right)
    seen = points - chosen.eye
    depth = -seen @ towards
    half = np.tan(np.deg2rad(view.FIELD_OF_VIEW / 2))
    assert (depth > 0).all()
    assert (np.abs(seen @ up) <= half * depth).all()
    assert (np.abs(seen @ right) <= half * view.ASPECT * depth).all()


def test_the_camera_goes_where_no_wall_hides_the_way() -> None:
    path = np.linspace([0.0, 0.0, 1.0], [3.0, 0.0, 1.0], 10)
    free = view.choose_view(path, path, np.zeros((0, 3, 3)))
    side = np.sign(free.eye[1])
    corners = np.array([[-9.0, 0.6, -1.0], [12.0, 0.6, -1.0], [12.0, 0.6, 9.0], [-9.0, 0.6, 9.0]]) * [1, side, 1]
    order = [[0, 1, 2], [0, 2, 3]] if side < 0 else [[0, 2, 1], [0, 3, 2]]  # its outside faces the camera
    walled = view.choose_view(path, path, corners[order])
    assert np.sign(walled.eye[1]) == -side
    from_behind = view.choose_view(path, path, corners[order][:, ::-1])  # turned away: not drawn from that side
    np.testing.assert_allclose(from_behind.eye, free.eye)


# ---- forces


def test_arrows_stand_at_the_pressure_and_are_as_long_as_the_force_is_great(strolling_plan: Plan) -> None:
    frames = frame_times(strolling_plan.duration)
    keys = animation._arrow_keys(strolling_plan, 0, frames)
    contact = strolling_plan.contacts.X_WC[strolling_plan.stances[0, 0]]
    assert keys.frame[0] == 0
    assert keys.shown[0]
    np.testing.assert_allclose(keys.tail[0], contact[:3, 3])
    np.testing.assert_allclose(keys.direction[0], [0.0, 0.0, 1.0])
    assert keys.length[0] == pytest.approx(animation.FORCE_LENGTH / 2)  # two feet share the weight
    assert keys.frame[-1] == frames.last


@pytest.mark.parametrize("effector", range(4))
def test_no_arrow_glides_from_one_contact_to_the_next(strolling_plan: Plan, effector: int) -> None:
    keys = animation._arrow_keys(strolling_plan, effector, frame_times(strolling_plan.duration))
    assert any(keys.shown)
    for k in range(1, len(keys.frame)):
        if keys.shown[k - 1] and keys.shown[k] and keys.frame[k] - keys.frame[k - 1] > 1:
            assert np.linalg.norm(keys.tail[k] - keys.tail[k - 1]) < 0.25  # never farther than a sole is long


# ---- pages and servers


@pytest.fixture(scope="module")
def page(strolling_plan: Plan) -> str:
    return playback.page_html(strolling_plan)


def test_the_page_needs_nothing_from_anywhere(page: str) -> None:
    assert not re.findall(r"<(?:script|img|link|iframe)\b[^>]*\b(?:src|href)\s*=", page)
    assert len(page.encode()) < PAGE_LIMIT


def test_the_page_names_the_plan_and_its_contacts(page: str) -> None:
    assert "<title>rubble_corridor" in page
    for entry in ("left foot (5)", "right foot (5)", "left palm (1)", "right palm (1)", "contact force"):
        assert entry in page


def test_a_scene_cannot_smuggle_a_script_into_the_page(strolling_plan: Plan) -> None:
    evil = dataclasses.replace(strolling_plan, scene_name="<script>alert(1)</script>")
    assert "<script>alert(1)" not in playback.page_html(evil)


def test_contacts_without_a_motion_are_shown_without_a_robot(strolling_plan: Plan) -> None:
    partial = dataclasses.replace(strolling_plan, phases=None, centroidal=None, motion=None)
    meshcat = playback.open_meshcat()
    playback.show_plan(partial, meshcat)
    assert meshcat.HasPath("/drakeplan/contacts/left_palm")
    assert meshcat.HasPath("/drakeplan/terrain/plates")
    assert not meshcat.HasPath("/drakeplan/robot")
    playback.show_plan(strolling_plan, meshcat)
    assert meshcat.HasPath("/drakeplan/robot/escher/torso")
    assert meshcat.HasPath("/drakeplan/forces/left_foot")


def test_the_server_listens_on_this_machine_alone() -> None:
    meshcat = playback.open_meshcat()
    assert meshcat.web_url() == f"http://localhost:{meshcat.port()}"
    with open("/proc/net/tcp", encoding="ascii") as table:
        rows = [line.split() for line in table][1:]
    listening = [row[1] for row in rows if row[3] == "0A" and int(row[1].split(":")[1], 16) == meshcat.port()]
    assert listening
    assert all(address.startswith("0100007F:") for address in listening)  # 127.0.0.1


def test_a_taken_port_is_said_in_one_line() -> None:
    first = playback.open_meshcat()
    with pytest.raises(InputError, match=str(first.port())):
        playback.open_meshcat(first.port())


def test_a_plan_for_another_robot_model_is_refused(strolling_plan: Plan) -> None:
    with pytest.raises(InputError, match="made for a model of escher"):
        playback.page_html(dataclasses.replace(strolling_plan, robot_model_sha256="0" * 64))
    with pytest.raises(InputError, match="made for a model of eshcer"):
        playback.page_html(dataclasses.replace(strolling_plan, robot="eshcer"))


def test_a_page_is_written_whole_or_not_at_all(strolling_plan: Plan, tmp_path) -> None:
    playback.write_page(strolling_plan, tmp_path / "plan.html")
    assert (tmp_path / "plan.html").read_text().rstrip().endswith("</html>")
    (tmp_path / "folder.html").mkdir()
    with pytest.raises(InputError, match=r"folder\.html: cannot be written"):
        playback.write_page(strolling_plan, tmp_path / "folder.html")
    assert sorted(p.name for p in tmp_path.iterdir()) == ["folder.html", "plan.html"]


@pytest.mark.slow
def test_three_minutes_of_motion_still_fit_into_a_page(strolling_plan: Plan) -> None:
    times = 28
    motion, momenta = strolling_plan.motion, strolling_plan.centroidal
    assert motion is not None
    assert momenta is not None
    t = np.arange(times * len(motion.t)) * 0.02
    restless = np.tile(motion.q, (times, 1))
    restless[:, 7:] += 0.2 * np.sin(3.0 * t[:, None] + np.arange(restless.shape[1] - 7))
    longer = dataclasses.replace(
        strolling_plan,
        motion=dataclasses.replace(
            motion, t=t, q=restless, v=np.tile(motion.v, (times, 1)), tau=np.tile(motion.tau, (times, 1))
        ),
    )
    assert longer.duration > 180
    assert len(playback.page_html(longer).encode()) < PAGE_LIMIT


@pytest.mark.parametrize(
    ("said", "drawn"),
    [([[0, 0, 1], [1, 0, 1]], True), (None, False), ("soon", False), ([[0, 0, float("nan")], [1, 0, 1]], False)],
)
def test_a_path_that_the_search_predicted_is_shown_beside_the_optimised_one(
    strolling_plan: Plan, said: object, drawn: bool
) -> None:
    plan = dataclasses.replace(strolling_plan, provenance={"predicted_com": said})
    assert (predicted_com(plan) is not None) == drawn
