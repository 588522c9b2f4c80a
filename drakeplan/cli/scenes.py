"""`drakeplan scenes`: the terrains that can be planned on."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated, Literal

import tyro

from scenes.input_error import InputError

if TYPE_CHECKING:
    from scenes.scene import Scene

ABOUT = """Lists the named scenes, shows one, or writes one to a scene file.

SCENE is a name, a scene file, hpp/MESH (a mesh of the hpp-environments package) or a mesh file.

examples:
  drakeplan scenes list
  drakeplan scenes show rubble_corridor --seed 3
  drakeplan scenes show narrow_flat --html strip.html
  drakeplan scenes show map.stl --picture map.png
  drakeplan scenes export rubble_corridor corridor.yaml --seed 3"""


@dataclass(frozen=True)
class Arguments:
    """Arguments of `drakeplan scenes`."""

    action: Annotated[
        Literal["list", "show", "export"], tyro.conf.Positional, tyro.conf.arg(metavar="list|show|export")
    ] = "list"
    """what to do"""
    scene: Annotated[str, tyro.conf.Positional, tyro.conf.arg(metavar="SCENE")] = ""
    """which scene to show or export"""
    file: Annotated[str, tyro.conf.Positional, tyro.conf.arg(metavar="FILE")] = ""
    """scene file to write"""
    seed: int = 0
    """seed of random scenes"""
    html: Annotated[str | None, tyro.conf.arg(metavar="FILE")] = None
    """with show: a page with the terrain, the goal and the disturbances"""
    picture: Annotated[str | None, tyro.conf.arg(metavar="FILE.png")] = None
    """with show: the scene from above as it was understood, with areas"""
    json: bool = False
    """one JSON object on standard output"""


def run(arguments: Arguments) -> int:
    """Does what `action` says."""
    wanted = {"list": 0, "show": 1, "export": 2}[arguments.action]
    given = bool(arguments.scene) + bool(arguments.file)
    if given != wanted:
        usage = {"list": "list", "show": "show SCENE", "export": "export SCENE FILE"}[arguments.action]
        raise InputError(f"drakeplan scenes: expected: drakeplan scenes {usage}")
    if arguments.html is not None and arguments.action != "show":
        raise InputError(f"--html: goes with scenes show, not with scenes {arguments.action}")
    if arguments.picture is not None and arguments.action != "show":
        raise InputError(f"--picture: goes with scenes show, not with scenes {arguments.action}")
    return {"list": _list, "show": _show, "export": _export}[arguments.action](arguments)


def _list(arguments: Arguments) -> int:
    from scenes.files.scene_source import list_scenes

    scenes = list_scenes()
    if arguments.json:
        from drakeplan.cli.output import print_json

        print_json({"scenes": [{"name": name, "about": about} for name, about in scenes.items()]})
    else:
        width = max(map(len, scenes))
        for name, about in scenes.items():
            print(f"{name:<{width}}  {about}")
    return 0


def _show(arguments: Arguments) -> int:
    if arguments.html is not None or arguments.picture is not None:
        from drakeplan.plan.plan_file import require_writable

        for file in (arguments.html, arguments.picture):
            if file is not None:
                require_writable(file)
    scene = _load(arguments)
    if arguments.picture is not None:
        from drakeplan.playback.plan_view import write_plan_view

        write_plan_view(scene, arguments.picture)
    if arguments.html is not None:
        from drakeplan.playback import write_scene_page

        write_scene_page(scene, arguments.html)
    facts = _facts(scene)
    if arguments.json:
        from drakeplan.cli.output import print_json

        print_json(facts)
        return 0
    del facts["notes"]  # one line each, below
    for key, value in facts.items():
        if value not in (None, []):
            print(f"{key.replace('_', ' '):<12} {_words(value)}")
    for note in scene.notes:
        print(f"note         {note}")
    return 0


def _export(arguments: Arguments) -> int:
    from drakeplan.plan.plan_file import require_writable
    from scenes.files.scene_file import write_scene

    require_writable(arguments.file)
    scene = _load(arguments)
    write_scene(scene, arguments.file)
    if arguments.json:
        from drakeplan.cli.output import print_json

        print_json({"name": scene.name, "file": arguments.file})
    else:
        print(arguments.file)
    return 0


def _load(arguments: Arguments) -> Scene:
    from drakeplan.cli.output import read_scene_aloud

    if arguments.seed < 0:
        raise InputError(f"--seed: expected 0 or more, got {arguments.seed}")
    return read_scene_aloud(arguments.scene, arguments.seed)


def _facts(scene: Scene) -> dict[str, object]:
    import dataclasses

    from scenes.terrain.packed_terrain import pack_terrain
    from scenes.terrain.usable_area import usable_area

    lowest, highest = scene.terrain.extent
    start, goal = scene.start, scene.goal
    floor = pack_terrain(scene.terrain).floor
    areas = dataclasses.asdict(usable_area(scene.terrain))
    frictions = [s.friction for s in scene.terrain.surfaces]
    return {
        "name": scene.name,
        "surfaces": len(scene.terrain.surfaces),
        "for_feet": sum(bool(s.allows("left_foot")) for s in scene.terrain.surfaces),
        "for_palms": sum(bool(s.allows("left_palm")) for s in scene.terrain.surfaces),
        "floors": int((floor < 0).sum() + len(set(floor[floor >= 0].tolist()))),
        "areas": {f"{key}_m2": round(value, 4) for key, value in areas.items()},
        "friction": sorted(set(frictions)),
        "obstacles": len(scene.terrain.obstacles),
        "triangles": len(scene.terrain.triangles),
        "from": [round(float(v), 3) for v in lowest],
        "to": [round(float(v), 3) for v in highest],
        "start": None if start is None else {"xyz": list(start.xyz), "yaw": start.yaw, "contacts": len(start.stance)},
        "goal": None if goal is None else {"xyz": list(goal.xyz), "radius": goal.radius, "yaw": goal.yaw},
        "robot": scene.robot,
        "disturbances": len(scene.disturbances),
        "origin_offset": None if scene.origin_offset is None else list(scene.origin_offset),
        "notes": list(scene.notes),
    }


def _words(value: object) -> str:
    if isinstance(value, dict):
        return ", ".join(f"{key} {_words(item)}" for key, item in value.items() if item is not None)
    if isinstance(value, list):
        return " ".join(_words(item) for item in value)
    return f"{value:g}" if isinstance(value, float) else str(value)
