"""`drakeplan scenes`: the terrains that can be planned on."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import tyro

from drakeplan.cli.arguments import Numbers
from drakeplan.cli.scene_facts import print_facts, scene_facts
from scenes.input_error import InputError

if TYPE_CHECKING:
    from scenes.scene import Scene

ABOUT = """Lists the named scenes, shows one, writes one to a file, or imports own terrain.

SCENE is a name, a scene file, hpp/MESH (a mesh of the hpp-environments package) or a mesh file. Imported are height maps
(.npz, .npy), point clouds (.ply, .pcd, .npy, .xyz, .txt, .csv), meshes (.stl, .obj, .ply, .dae), planar regions of IHMC's
software (a folder or a text file), polygons (.json, .npy, .txt) and lists of boxes (.json, .csv).

examples:
  drakeplan scenes list
  drakeplan scenes show rubble_corridor --seed 3
  drakeplan scenes show narrow_flat --html strip.html
  drakeplan scenes show map.stl --picture map.png
  drakeplan scenes export rubble_corridor corridor.yaml --seed 3
  drakeplan scenes export rubble_corridor corridor.sdf
  drakeplan scenes import cloud.ply --out site.yaml --picture site.png
  drakeplan scenes import room.stl --unit cm --up y --out room.yaml
  drakeplan scenes import heights.npy --resolution 0.02 --origin -1 -1 --out site.yaml"""


USAGE = {
    "list": "list",
    "show": "show SCENE",
    "export": "export SCENE FILE",
    "import": "import FILE --out SCENE.yaml",
}
OF_IMPORT = (
    "out", "robot", "friction", "name", "kind", "unit", "up", "resolution", "origin", "close", "viewpoint",
)  # fmt: skip
GOES_WITH = {"html": ("show",), "picture": ("show", "import")} | dict.fromkeys(OF_IMPORT, ("import",))
EXPORTS = (".yaml", ".yml", ".obj", ".sdf", ".xml")


@dataclass(frozen=True)
class Arguments:
    """Arguments of `drakeplan scenes`."""

    action: Annotated[
        Literal["list", "show", "export", "import"],
        tyro.conf.Positional,
        tyro.conf.arg(metavar="list|show|export|import"),
    ] = "list"
    """what to do"""
    scene: Annotated[str, tyro.conf.Positional, tyro.conf.arg(metavar="SCENE")] = ""
    """which scene to show or export; with import: the file of the terrain"""
    file: Annotated[str, tyro.conf.Positional, tyro.conf.arg(metavar="FILE")] = ""
    """with export: file to write, by its suffix a scene file (.yaml), .obj, .sdf or MJCF (.xml)"""
    seed: int = 0
    """seed of random scenes"""
    html: Annotated[str | None, tyro.conf.arg(metavar="FILE")] = None
    """with show: a page with the terrain, the goal and the disturbances"""
    picture: Annotated[str | None, tyro.conf.arg(metavar="FILE.png")] = None
    """with show and import: the scene from above as it was understood, with areas"""
    out: Annotated[str | None, tyro.conf.arg(metavar="SCENE.yaml")] = None
    """with import: scene file to write; a map or a mesh is kept beside it"""
    robot: Annotated[str | None, tyro.conf.arg(metavar="NAME")] = None
    """with import: the robot that the scene names"""
    friction: Annotated[float | None, tyro.conf.arg(metavar="MU")] = None
    """with import: friction of all surfaces that do not give theirs (default: 0.5)"""
    name: Annotated[str | None, tyro.conf.arg(metavar="NAME")] = None
    """with import: name of the scene (default: that of its file)"""
    kind: Literal["heights", "points", "mesh", "regions", "polygons", "boxes"] | None = None
    """with import: what the file holds (default: by its name and content)"""
    unit: Literal["m", "cm", "mm", "inch", "foot"] | None = None
    """with import: unit of the lengths in the file (default: m, and the size is checked)"""
    up: Literal["x", "y", "z"] | None = None
    """with import: the axis of the file that points up (default: z)"""
    resolution: Annotated[float | None, tyro.conf.arg(metavar="METRES")] = None
    """with import: edge of a height map's cell; of a cloud, of the cells that it is averaged over"""
    origin: Annotated[Numbers | None, tyro.conf.arg(metavar="X Y")] = None
    """with import: place of a height map's first height [m] (default: that of the file, else 0 0)"""
    close: Annotated[float | None, tyro.conf.arg(metavar="METRES")] = None
    """with import: holes in the ground up to this width are filled (default: 0.05)"""
    viewpoint: Annotated[Numbers | None, tyro.conf.arg(metavar="X Y Z")] = None
    """with import: where the sensor of a cloud was [m], which tells the outer side of walls"""
    json: bool = False
    """one JSON object on standard output"""


def run(arguments: Arguments) -> int:
    """Does what `action` says."""
    wanted = {"list": 0, "show": 1, "export": 2, "import": 1}[arguments.action]
    given = bool(arguments.scene) + bool(arguments.file)
    if given != wanted:
        raise InputError(f"drakeplan scenes: expected: drakeplan scenes {USAGE[arguments.action]}")
    for option, actions in GOES_WITH.items():
        if getattr(arguments, option) is not None and arguments.action not in actions:
            goes = " and ".join(f"scenes {action}" for action in actions)
            raise InputError(f"--{option}: goes with {goes}, not with scenes {arguments.action}")
    return {"list": _list, "show": _show, "export": _export, "import": _import}[arguments.action](arguments)


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
    facts = scene_facts(scene)
    if arguments.json:
        from drakeplan.cli.output import print_json

        print_json(facts)
        return 0
    print_facts(facts, scene.notes)
    return 0


def _export(arguments: Arguments) -> int:
    from drakeplan.plan.plan_file import require_writable
    from scenes.files.scene_file import write_scene
    from scenes.files.whole_file import write_whole

    path = Path(arguments.file)
    suffix = path.suffix.lower()
    require_writable(path)
    if suffix and suffix not in EXPORTS:
        raise InputError(f"{path}: expected a file that ends in one of {', '.join(EXPORTS)}")
    scene = _load(arguments)
    written = [path]
    if suffix == ".obj":
        from scenes.files.scene_to_obj import scene_to_obj

        write_whole(path, scene_to_obj(scene).encode())
    elif suffix == ".xml":
        from scenes.files.scene_to_mjcf import scene_to_mjcf

        write_whole(path, scene_to_mjcf(scene).encode())
    elif suffix == ".sdf":
        from scenes.files.scene_to_sdf import write_sdf

        written = write_sdf(scene, path)
    else:
        write_scene(scene, path)
    if arguments.json:
        from drakeplan.cli.output import print_json

        print_json({"name": scene.name, "file": arguments.file, "files": [str(file) for file in written]})
    else:
        print(arguments.file)
    return 0


def _import(arguments: Arguments) -> int:
    from drakeplan.cli.scenes_import import import_file
    from scenes.imports.built import ImportOptions

    if arguments.out is None:
        raise InputError("drakeplan scenes import: expected --out SCENE.yaml, the scene file to write")
    if arguments.origin is not None and len(arguments.origin) != 2:
        raise InputError("--origin: expected two numbers, X Y of the first height")
    if arguments.viewpoint is not None and len(arguments.viewpoint) != 3:
        raise InputError("--viewpoint: expected three numbers, X Y Z of the sensor")
    options = ImportOptions(
        kind=arguments.kind,
        unit=arguments.unit,
        up=arguments.up or "z",
        friction=0.5 if arguments.friction is None else arguments.friction,
        resolution=arguments.resolution,
        origin=None if arguments.origin is None else (arguments.origin[0], arguments.origin[1]),
        close=0.05 if arguments.close is None else arguments.close,
        viewpoint=None if arguments.viewpoint is None else (*arguments.viewpoint[:2], arguments.viewpoint[2]),
        name=arguments.name,
        robot=arguments.robot,
    )
    return import_file(
        arguments.scene, out=arguments.out, picture=arguments.picture, options=options, as_json=arguments.json
    )


def _load(arguments: Arguments) -> Scene:
    from drakeplan.cli.output import read_scene_aloud

    if arguments.seed < 0:
        raise InputError(f"--seed: expected 0 or more, got {arguments.seed}")
    return read_scene_aloud(arguments.scene, arguments.seed)
