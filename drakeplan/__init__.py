"""drakeplan plans how a humanoid crosses hard terrain with its feet and palms, and checks every plan.

    import drakeplan

    scene = drakeplan.load_scene("rubble_corridor", seed=0)
    result = drakeplan.plan_scene(scene, drakeplan.load_robot("escher"))
    if result.plan is not None:
        drakeplan.write_plan(result.plan, "plan.h5")
        drakeplan.write_page(result.plan, "plan.html")

Names are imported when they are first used: `import drakeplan` loads neither Drake nor a compiler.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING

import scenes  # noqa: F401  (chooses the folder of compiled kernels before numba is imported)

if TYPE_CHECKING:
    from drakeplan.execution import ExecutionOptions, ExecutionReport, Physics, play_plan
    from drakeplan.execution.played import played_plan
    from drakeplan.experience.deformation import DeformOptions, DeformResult, deform
    from drakeplan.experience.library import Library
    from drakeplan.experience.shipped import library_folder
    from drakeplan.experience.stored_plan import store_plan
    from drakeplan.plan.plan import Plan
    from drakeplan.plan.plan_file import inspect_plan, read_plan, write_plan
    from drakeplan.playback import show_plan, write_page
    from drakeplan.query.options import PlanOptions
    from drakeplan.query.planning import plan_scene
    from drakeplan.query.result import PlanResult
    from drakeplan.verifier import Report, verify
    from scenes.files.scene_source import list_scenes, load_scene
    from scenes.input_error import InputError
    from scenes.robots.robot import Robot, load_robot, robot_names
    from scenes.scene import Goal, Scene, Start
    from scenes.terrain.surface import Surface
    from scenes.terrain.terrain import Terrain

__all__ = [
    "DeformOptions",
    "DeformResult",
    "ExecutionOptions",
    "ExecutionReport",
    "Goal",
    "InputError",
    "Library",
    "Physics",
    "Plan",
    "PlanOptions",
    "PlanResult",
    "Report",
    "Robot",
    "Scene",
    "Start",
    "Surface",
    "Terrain",
    "deform",
    "inspect_plan",
    "library_folder",
    "list_scenes",
    "load_robot",
    "load_scene",
    "plan_scene",
    "play_plan",
    "played_plan",
    "read_plan",
    "robot_names",
    "show_plan",
    "store_plan",
    "verify",
    "write_page",
    "write_plan",
]

_HOMES = {
    "drakeplan.execution": ("ExecutionOptions", "ExecutionReport", "Physics", "play_plan"),
    "drakeplan.execution.played": ("played_plan",),
    "drakeplan.experience.deformation": ("DeformOptions", "DeformResult", "deform"),
    "drakeplan.experience.library": ("Library",),
    "drakeplan.experience.shipped": ("library_folder",),
    "drakeplan.experience.stored_plan": ("store_plan",),
    "drakeplan.plan.plan": ("Plan",),
    "drakeplan.plan.plan_file": ("inspect_plan", "read_plan", "write_plan"),
    "drakeplan.query.options": ("PlanOptions",),
    "drakeplan.query.planning": ("plan_scene",),
    "drakeplan.query.result": ("PlanResult",),
    "drakeplan.playback": ("show_plan", "write_page"),
    "drakeplan.verifier": ("Report", "verify"),
    "scenes.input_error": ("InputError",),
    "scenes.robots.robot": ("Robot", "load_robot", "robot_names"),
    "scenes.scene": ("Goal", "Scene", "Start"),
    "scenes.files.scene_source": ("list_scenes", "load_scene"),
    "scenes.terrain.surface": ("Surface",),
    "scenes.terrain.terrain": ("Terrain",),
}


def __getattr__(name: str) -> object:
    """Imports a public name on first use (PEP 562)."""
    for module, names in _HOMES.items():
        if name in names:
            value = getattr(import_module(module), name)
            globals()[name] = value
            return value
    raise AttributeError(f"module 'drakeplan' has no attribute {name!r}")


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
