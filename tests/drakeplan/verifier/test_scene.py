"""Scenes as the verifier reads them."""

from __future__ import annotations

import numpy as np

from drakeplan.verifier.scene import read_scene


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
    scene = read_scene(text)
    assert [plate.name for plate in scene.plates] == ["null", "down"]
    assert [plate.friction for plate in scene.plates] == [0.1, 0.1]
    assert scene.plates[0].allowed == {"left_foot", "right_foot"}
    assert scene.plates[1].allowed == {"left_palm"}
    np.testing.assert_array_equal(scene.plates[1].normal, [0, 0, -1])
    X_WO, size = scene.boxes[0]
    np.testing.assert_allclose(X_WO[:3, :2], [[0, -1], [1, 0], [0, 0]], atol=1e-15)
    np.testing.assert_array_equal(size, [1, 2, 3])
    assert scene.goal["yaw"] is None
