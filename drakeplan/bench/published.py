"""The published draws of the rubble scenes, planned and verified.

The file lin_centroidal_scenes.json (polygons read out of the authors' own scene generator) is not part of drakeplan:
name the folder that holds it in the environment variable DRAKEPLAN_CASES.
"""

from __future__ import annotations

import json
import os
from pathlib import Path

import numpy as np

from drakeplan.bench.table import BenchOptions, BenchTable
from drakeplan.query.options import PlanOptions
from drakeplan.query.planning import plan_scene
from drakeplan.query.warm_up import warm_up
from optimization.inverse_kinematics.whole_body_ik import WholeBodyIK
from scenes.files.scene_file import read_scene, write_scene
from scenes.input_error import InputError
from scenes.robots.robot import load_robot
from scenes.scene import Goal, Scene, Start
from scenes.terrain.surface import Surface
from scenes.terrain.terrain import Terrain

FILE = "lin_centroidal_scenes.json"
SCENES = {"dynopt_test_env_1": "rubble_field", "dynopt_test_env_8": "rubble_corridor"}


def published_scenes(folder: Path) -> list[Scene]:
    """The five draws of the rubble field and of the corridor, as scenes.

    Raises:
        InputError: the file is missing or not of the expected form.
    """
    path = folder / FILE
    try:
        data = json.loads(path.read_text(encoding="utf-8"))
        found = [
            _scene(f"{SCENES[s['name']]}_{instance['seed']}", instance, data["planner"])
            for s in data["scenes"]
            if s["name"] in SCENES
            for instance in s["instances"]
        ]
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise InputError(f"{path}: expected the published scenes ({error})") from error
    return found


def _scene(name: str, instance: dict, planner: dict) -> Scene:
    surfaces = []
    for entry in instance["surfaces"]:
        feet = entry["type"] == "ground"
        effectors = frozenset({"left_foot", "right_foot"} if feet else {"left_palm", "right_palm"})
        surface = Surface(f"{entry['type']}_{entry['id']}", entry["vertices"], planner["friction"], effectors)
        surfaces.append(surface if surface.normal @ np.array(entry["normal"]) > 0 else surface.flipped())
    x, y = instance["goal_xy"]
    start = Start((0.025, 0.0, 0.0))
    return Scene(name, Terrain(tuple(surfaces)), start, Goal((x, y, 0.0), planner["goal_radius_m"]))


def run(options: BenchOptions) -> BenchTable:
    """Each draw goes through a scene file, the planner and the verifier."""
    folder = os.environ.get("DRAKEPLAN_CASES")
    if not folder:
        return BenchTable(
            "published", "Published draws: skipped, DRAKEPLAN_CASES names no folder", ("scene",), (), most_seeds=0
        )
    robot = load_robot(options.robot)
    warm_up(robot, WholeBodyIK(robot))
    scratch = Path("out") / "published"
    scratch.mkdir(parents=True, exist_ok=True)
    rows = []
    for scene in published_scenes(Path(folder)):
        write_scene(scene, scratch / f"{scene.name}.yaml")
        found = plan_scene(read_scene(scratch / f"{scene.name}.yaml"), robot, PlanOptions())
        r = found.report
        rows.append((scene.name, found.status, r["stances"], r["palms_used"], r["time_to_first_s"], r["total_s"],
                     found.reason))  # fmt: skip
        options.tell(f"{scene.name}: {found.status} {found.reason}")
    columns = ("scene", "status", "stances", "palms used", "first s", "total s", "reason")
    return BenchTable("published", "Published draws of the rubble scenes", columns, tuple(rows), most_seeds=0)
