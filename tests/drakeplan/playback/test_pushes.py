"""Pushes are drawn where they act, as long as they are great, and the page says how likely they are."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from drakeplan import playback
from drakeplan.cli import main
from drakeplan.playback.pushes import ARROW_LENGTH, CHEST, draw_pushes
from scenes.disturbance import Disturbance
from scenes.files.scene_file import write_scene
from scenes.library.flat import named as flat
from scenes.pose import pose_matrix
from scenes.scene import Scene

X_WR = pose_matrix([1.0, 0.2, 0.9], [0.0, 0.0, 0.4])


@pytest.fixture(scope="module")
def pushed() -> Scene:
    scene = flat(0)
    disturbances = (
        Disturbance(np.array([[0.0, 38.0, 0.0], [0.0, -76.0, 0.0]]), 0.01, (1.0, 0.8, 1.8), X_WR),
        Disturbance(np.array([[30.0, 0.0, 0.0], [0.0, 0.0, 0.0]]), 0.002),
    )
    return Scene(scene.name, scene.terrain, scene.start, scene.goal, disturbances=disturbances)


def test_arrows_point_along_their_impulses_and_are_as_long_as_these_are_great(pushed: Scene) -> None:
    meshcat = playback.open_meshcat()
    shown = draw_pushes(meshcat, pushed, "/test")
    np.testing.assert_allclose(shown[8:10], [X_WR[:3, 3], X_WR[:3, 3] + [0, 38 * ARROW_LENGTH, 0]], atol=1e-9)
    np.testing.assert_allclose(shown[10:12], [X_WR[:3, 3], X_WR[:3, 3] - [0, 76 * ARROW_LENGTH, 0]], atol=1e-9)
    assert pushed.start is not None
    over_start = np.add(pushed.start.xyz, [0, 0, CHEST])
    np.testing.assert_allclose(shown[12:], [over_start, np.add(over_start, [30 * ARROW_LENGTH, 0, 0])], atol=1e-9)


def test_every_region_and_every_push_but_none_of_nothing_stands_in_the_picture(pushed: Scene) -> None:
    meshcat = playback.open_meshcat()
    draw_pushes(meshcat, pushed, "/test")
    there = ("0/region", "0/edges", "0/impulse_0/shaft", "0/impulse_0/head", "0/impulse_1/head", "1/impulse_0/head")
    for path in there:
        assert meshcat.HasPath(f"/test/disturbances/{path}"), path
    for path in ("1/region", "1/impulse_1"):
        assert not meshcat.HasPath(f"/test/disturbances/{path}"), path


def test_the_corners_of_a_region_are_those_of_its_turned_box(pushed: Scene) -> None:
    corners = draw_pushes(playback.open_meshcat(), pushed, "/test")[:8]
    p_RP = (corners - X_WR[:3, 3]) @ X_WR[:3, :3]
    np.testing.assert_allclose(np.abs(p_RP), np.tile([0.5, 0.4, 0.9], (8, 1)))
    assert len(np.unique(np.sign(p_RP), axis=0)) == 8


def test_a_scene_page_names_its_pushes_and_a_scene_without_any_does_not(pushed: Scene) -> None:
    page = playback.scene_page_html(pushed)
    assert "pushes (4), 1 %, 0.2 % in 0.1 s" in page
    assert "<title>flat" in page
    assert "pushes (" not in playback.scene_page_html(flat(0))


def test_scenes_show_writes_the_page_of_a_scene_file(
    pushed: Scene, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    write_scene(pushed, tmp_path / "pushed.yaml")
    assert main(["scenes", "show", str(tmp_path / "pushed.yaml"), "--html", str(tmp_path / "p.html")]) == 0
    assert "pushes (4)" in (tmp_path / "p.html").read_text(encoding="utf-8")
    assert main(["scenes", "list", "--html", str(tmp_path / "no.html")]) == 2
    assert "--html" in capsys.readouterr().err
    assert main(["scenes", "show", "flat", "--html", str(tmp_path / "no" / "p.html")]) == 2
