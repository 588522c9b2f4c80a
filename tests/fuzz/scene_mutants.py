"""Scene files that are nearly right, and the way a user's scene takes: read, packed, start and goal set down, written again."""

from __future__ import annotations

import io
import math
from functools import lru_cache
from pathlib import Path
from random import Random

import numpy as np
from mesh_mutants import MESHES, stl_bytes
from mutation import mutate_bytes, mutate_tree, nodes_of, to_document

from scenes.files.scene_file import scene_from_yaml, scene_to_yaml
from scenes.files.scene_schema import SceneEntry
from scenes.files.scene_source import load_scene
from scenes.footholds.start_stance import check_goal, start_stance
from scenes.robots.robot import Robot, load_robot
from scenes.terrain.packed_terrain import pack_terrain

SECONDS = 2.0


def rectangle(x: float, y: float, z: float, length: float, width: float) -> list[list[float]]:
    return [[x + a * length / 2, y + b * width / 2, z] for a, b in ((-1, -1), (1, -1), (1, 1), (-1, 1))]


def good_scenes() -> dict[str, dict[str, object]]:
    """Scene files that are right, between them every key there is."""
    head: dict[str, object] = {"format": "drakeplan-scene", "version": 1}
    ends = {"start": {"xyz": [0.0, 0.0, 0.0], "yaw": 0.0}, "goal": {"xyz": [2.0, 0.0, 0.0], "radius": 0.2, "yaw": None}}
    pose = {"xyz": [1.0, 0.6, 0.4], "rpy": [0.0, 0.1, 0.3]}
    palms = ["left_palm", "right_palm"]
    wall = [[0.0, 1.0, 0.5], [2.0, 1.0, 0.5], [2.0, 1.0, 1.6], [0.0, 1.0, 1.6]]
    foot = {"surface": "ground", "xyz": [0.0, 0.1, 0.0], "rpy": [0.0, 0.0, 0.0]}
    scenes = {
        "stones": {
            **head, "name": "stones", "robot": "escher", "friction": 0.6,
            "surfaces": [
                {"name": "ground", "vertices": rectangle(0, 0, 0, 1, 1)},
                {"name": "stone", "vertices": rectangle(1, 0.1, 0.1, 0.4, 0.3), "friction": 0.4, "normal": [0.0, 0.0, 1.0]},
                {"name": "end", "vertices": rectangle(2, 0, 0.0, 1, 1), "contact": ["left_foot", "right_foot"]},
                {"name": "wall", "vertices": wall, "normal": [0.0, -1.0, 0.0], "contact": palms},
            ],
            "obstacles": [{"name": "pillar", "box": [0.2, 0.2, 0.8], "pose": pose}],
            **ends,
        },
        "stance": {
            **head, "robot": "escher", "surfaces": [{"name": "ground", "vertices": rectangle(1, 0, 0, 4, 1)}],
            "start": {"stance": {"left_foot": foot, "right_foot": {**foot, "xyz": [0.0, -0.1, 0.0]}}},
            "goal": {"xyz": [2.0, 0.0, None]},
            "disturbances": [
                {"region": {"box": [2.0, 2.0, 2.0], "pose": pose}, "impulses": [[0, 38, 0]], "probability": 0.01},
                {"region": None, "impulses": [[1.0, 0, 0], [0, 2.0, 0]], "probability": 0.5},
            ],
        },
        "tiles": {
            **head, "surfaces": [{"vertices": rectangle(0.3 * k, 0, 0, 0.3, 0.6)} for k in range(9)],
            "start": {"xyz": [0.1, 0.0]}, "goal": {"xyz": [2.2, 0.0, 0.0]},
        },
        "mesh": {
            **head, "meshes": [{"file": "step.stl", "pose": {"xyz": [0.8, -0.5, 0.0], "rpy": [0.0, 0.0, 0.0]}, "scale": 1.0}],
            "surfaces": [{"name": "ground", "vertices": rectangle(0.1, 0, 0, 1.4, 1.0)}],
            **ends, "goal": {"xyz": [2.0, 0.0, 0.2]},
        },
    }  # fmt: skip
    if "contact" in _fields("obstacles"):
        scenes["stones"]["obstacles"].append(
            {
                "name": "beam",
                "box": [2.0, 0.3, 0.1],
                "pose": pose,
                "contact": ["left_foot", "right_foot"],
                "friction": 0.5,
            }
        )
    if "heightmaps" in SceneEntry.model_fields:
        grid = {"file": "ground.npz", "resolution": 0.05, "origin": [-0.5, -0.5], "friction": 0.6}
        scenes["heights"] = {**head, "heightmaps": [grid], **ends}
    if "origin_offset" in SceneEntry.model_fields:
        far = [431250.0, 5411000.0, 0.0]
        moved = [[v + o for v, o in zip(corner, far, strict=True)] for corner in rectangle(1, 0, 0, 4, 1)]
        scenes["far"] = {**head, "origin_offset": far, "surfaces": [{"vertices": moved}]}
    return scenes


def _fields(key: str) -> set[str]:
    from scenes.files import scene_schema

    return set({"obstacles": scene_schema.ObstacleEntry}[key].model_fields)


def make(rng: Random, folder: Path) -> Path:
    """Writes one scene that is nearly right, with the files that it names, and returns its path."""
    scenes = good_scenes()
    name = rng.choice(
        [*sorted(scenes.keys() - {"mesh"}) * 3, "mesh"]
    )  # meshes take ten times as long, and have a fuzzer of their own
    path = folder / "scene.yaml"
    write_companions(rng, scenes[name], folder)
    if rng.random() < 0.25:
        path.write_bytes(mutate_bytes(rng, to_document(scenes[name]).encode()))
    else:
        text = to_document(mutate_tree(rng, scenes[name], OWN))
        path.write_bytes(text.encode("utf-8", "surrogatepass"))
    return path


def write_companions(rng: Random | None, scene: dict, folder: Path) -> None:
    """The mesh and the height map that a scene names; a height map is itself nearly right where `rng` is given."""
    if "meshes" in scene:
        (folder / "step.stl").write_bytes(stl_bytes(MESHES["box"]))
    if "heightmaps" in scene:
        data = height_map(rng)
        if rng is not None and rng.random() < 0.2:
            data = mutate_bytes(rng, data)
        (folder / "ground.npz").write_bytes(data)


def height_map(rng: Random | None = None) -> bytes:
    """A level height map of 3 m x 1 m as an NPZ file, changed where `rng` is given."""
    heights: object = np.zeros((21, 61))
    name = "height"
    if rng is not None:
        heights[rng.randrange(21), rng.randrange(61)] = rng.choice((np.nan, np.inf, -np.inf, 1e308, 0.3, 0.01, 1e5))
        changes = (
            lambda h: h, lambda h: h.astype(np.float32), lambda h: h.astype(complex), lambda h: h.astype("U8"), lambda h: h > 0,
            lambda h: h.astype(object), lambda h: np.array([{"a": 1}], dtype=object), lambda h: h[0], lambda h: h[None],
            lambda h: h[:0],
            lambda h: h[:1, :1], lambda h: np.full_like(h, np.nan), lambda h: np.float64(3.0), lambda h: h.T,
            lambda h: np.asfortranarray(h),
            lambda h: np.zeros(3, dtype=[("a", float)]), lambda h: h.astype(np.datetime64), lambda h: h.astype(">f8"),
        )  # fmt: skip
        with np.errstate(all="ignore"):
            heights = rng.choice(changes)(heights)
        name = rng.choice(("height", "height", "height", "height", "heights", "a/b"))
    file = io.BytesIO()
    np.savez(file, **{name: heights})
    return file.getvalue()


def _polygon(rng: Random, tree: dict) -> list:
    return rng.choice(tree["surfaces"])["vertices"]


def _shuffled(rng: Random, tree: dict) -> None:
    rng.shuffle(_polygon(rng, tree))


def _repeated_corner(rng: Random, tree: dict) -> None:
    polygon = _polygon(rng, tree)
    k = rng.randrange(len(polygon))
    polygon.insert(k, [v + rng.choice((0.0, 1e-12, 1e-7, 1e-5)) for v in polygon[k]])


def _off_plane(rng: Random, tree: dict) -> None:
    polygon = _polygon(rng, tree)
    polygon[rng.randrange(len(polygon))][rng.randrange(3)] += rng.choice((-1, 1)) * 10 ** rng.uniform(-12, 1)


def _on_a_line(rng: Random, tree: dict) -> None:
    axis = rng.randrange(3)
    for corner in _polygon(rng, tree):
        corner[axis] = corner[axis] * rng.choice((0.0, 1e-3, 1e-7))


def _tiny(rng: Random, tree: dict) -> None:
    scale = 10 ** rng.uniform(-9, 5)
    for corner in _polygon(rng, tree):
        corner[:] = [v * scale for v in corner]


def _far(rng: Random, tree: dict) -> None:
    shift = rng.choice((-1, 1)) * 10 ** rng.uniform(0, 5)
    for corner in _polygon(rng, tree):
        corner[0] += shift


def _tilted(rng: Random, tree: dict) -> None:
    angle = rng.choice((10 ** rng.uniform(-12, 0), rng.uniform(0, 2 * math.pi), math.pi / 4, math.pi / 2, math.pi))
    c, s = math.cos(angle), math.sin(angle)
    for corner in _polygon(rng, tree):
        x, _, z = corner
        corner[0], corner[2] = c * x - s * z, s * x + c * z


def _many_corners(rng: Random, tree: dict) -> None:
    count = rng.choice((3, 8, 60, 99, 100, 101, 500))
    radius = rng.uniform(0.01, 2.0)
    rng.choice(tree["surfaces"])["vertices"] = [
        [radius * math.cos(2 * math.pi * k / count), radius * math.sin(2 * math.pi * k / count), 0.0]
        for k in range(count)
    ]


def _dented(rng: Random, tree: dict) -> None:
    polygon = _polygon(rng, tree)
    k = rng.randrange(len(polygon))
    middle = [sum(axis) / len(polygon) for axis in zip(*polygon, strict=True)]
    share = rng.uniform(0.0, 1.5)
    polygon[k] = [v + share * (m - v) for v, m in zip(polygon[k], middle, strict=True)]


def _stacked(rng: Random, tree: dict) -> None:
    above = [[x, y, z + rng.choice((0.0, 1e-9, 1e-3, 0.01, 0.3, 2.5))] for x, y, z in _polygon(rng, tree)]
    tree["surfaces"].append({"vertices": above})


def _sized(rng: Random, tree: dict) -> None:
    box = rng.choice(tree["obstacles"])["box"]
    box[rng.randrange(3)] = 10 ** rng.uniform(-12, 5)


def _posed(rng: Random, tree: dict) -> None:
    poses = [parent[key] for parent, key in nodes_of(tree) if key == "pose"]
    rng.choice(poses)["rpy"][rng.randrange(3)] = rng.choice((1e5, math.pi, math.pi / 2, 1e-9, -1e-300))


def _moved_end(rng: Random, tree: dict) -> None:
    place = rng.choice((tree["start"], tree["goal"]))
    place["xyz"][rng.randrange(2)] += rng.choice((-1, 1)) * 10 ** rng.uniform(-3, 3)


def _scaled_mesh(rng: Random, tree: dict) -> None:
    rng.choice(tree["meshes"])["scale"] = rng.choice((0, 1e-300, 1e-9, 1e-3, 25.4, 1e3, 1e5, -1.0))


def _crowded(rng: Random, tree: dict) -> None:
    piece = rng.choice(tree["surfaces"])
    for k in range(rng.choice((5, 50))):
        moved = [[x + 0.31 * k, y, z] for x, y, z in piece["vertices"]]
        tree["surfaces"].append({**piece, "name": f"{piece.get('name', 'piece')}_{k}", "vertices": moved})


OWN = (
    _shuffled, _repeated_corner, _off_plane, _on_a_line, _tiny, _far, _tilted, _many_corners, _dented, _stacked, _sized, _posed,
    _moved_end,
    _scaled_mesh, _crowded,
)  # fmt: skip


@lru_cache(maxsize=1)
def _robot() -> Robot:
    return load_robot("escher")


def read(path: Path) -> None:
    """Reads a scene as a query does, and as `scenes export` does.

    Raises:
        InputError: the scene is not right.
        AssertionError: what was read is not sound, or does not come back from a file.
    """
    scene = load_scene(str(path))
    assert all(np.isfinite(s.vertices).all() and np.isfinite(s.normal).all() for s in scene.terrain.surfaces)
    assert all("\n" not in note for note in scene.notes)
    packed = pack_terrain(scene.terrain)
    assert all(np.isfinite(a).all() for a in (packed.normal, packed.offset, packed.edge_normal, packed.edge_offset))
    again = scene_from_yaml(scene_to_yaml(scene, folder=path.parent), "again", folder=path.parent)
    assert [s.name for s in again.terrain.surfaces] == [s.name for s in scene.terrain.surfaces]
    z = math.nan
    if scene.start is not None:
        stance = start_stance(scene, packed, _robot())
        assert all(np.isfinite(c.X_WC).all() for c in stance.held)
        z = float(stance.feet_mean()[2])
    if scene.goal is not None:
        assert np.isfinite(check_goal(scene, packed, _robot(), z).xyz).all()
