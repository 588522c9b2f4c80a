"""drakeplan plans how a humanoid crosses hard terrain with its feet and palms, and checks every plan.

    import drakeplan

    result = drakeplan.plan_scene("rubble_corridor", "escher")   # names, files, or what load_scene and load_robot give
    plan = result.plan
    if result.status == "complete" and plan is not None:
        print(drakeplan.verify(plan).table())
        print(plan.t, plan.q, plan.com, plan.forces)             # one row a frame
        drakeplan.write_plan(plan, "plan.h5")
        drakeplan.write_page(plan, "plan.html")

`plan_motion` makes the motion over contacts of your own (`make_contact`), `plan_many` plans many scenes at once, and
`Plan.at`, `Plan.frames` and `Plan.contacts.to_pandas` say more of a plan.

Names are imported when they are first used: `import drakeplan` loads neither Drake nor a compiler.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING

from drakeplan.shadowed import refuse_shadows as _refuse_shadows

_refuse_shadows()

import scenes  # noqa: E402, F401  (chooses the folder of compiled kernels before numba is imported)

if TYPE_CHECKING:
    from drakeplan.execution import ExecutionOptions, ExecutionReport, Physics, play_plan
    from drakeplan.execution.played import played_plan
    from drakeplan.experience.deformation import DeformOptions, DeformResult, deform
    from drakeplan.experience.library import Library
    from drakeplan.experience.shipped import library_folder
    from drakeplan.experience.stored_plan import store_plan
    from drakeplan.export import export_plan
    from drakeplan.plan.plan import Plan
    from drakeplan.plan.plan_file import inspect_plan, read_plan, write_plan
    from drakeplan.plan.state import PlanState
    from drakeplan.plan.verified import verify
    from drakeplan.playback import show_plan, write_page
    from drakeplan.progress import ProgressEvent
    from drakeplan.query.batch import plan_many
    from drakeplan.query.contact_on_terrain import make_contact
    from drakeplan.query.given_contacts import plan_motion
    from drakeplan.query.options import PlanOptions
    from drakeplan.query.planning import plan_scene
    from drakeplan.query.result import PlanResult
    from drakeplan.robot_setup.add import AddedRobot, add_robot
    from drakeplan.timing.step_timing import Timing
    from drakeplan.verifier import Report
    from scenes.contact import Contact
    from scenes.files.scene_source import list_scenes, load_scene
    from scenes.imports.built import ImportOptions
    from scenes.imports.import_terrain import ImportedTerrain, import_terrain, write_terrain
    from scenes.input_error import InputError
    from scenes.robots.robot import Robot, load_robot, robot_names
    from scenes.scene import Goal, Scene, Start
    from scenes.stance import Stance
    from scenes.terrain.surface import Surface
    from scenes.terrain.terrain import Terrain

__all__ = [
    "AddedRobot",
    "Contact",
    "DeformOptions",
    "DeformResult",
    "ExecutionOptions",
    "ExecutionReport",
    "Goal",
    "ImportOptions",
    "ImportedTerrain",
    "InputError",
    "Library",
    "Physics",
    "Plan",
    "PlanOptions",
    "PlanResult",
    "PlanState",
    "ProgressEvent",
    "Report",
    "Robot",
    "Scene",
    "Stance",
    "Start",
    "Surface",
    "Terrain",
    "Timing",
    "add_robot",
    "deform",
    "export_plan",
    "import_terrain",
    "inspect_plan",
    "library_folder",
    "list_scenes",
    "load_robot",
    "load_scene",
    "make_contact",
    "plan_many",
    "plan_motion",
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
    "write_terrain",
]

_HOMES = {
    "drakeplan.execution": ("ExecutionOptions", "ExecutionReport", "Physics", "play_plan"),
    "drakeplan.execution.played": ("played_plan",),
    "drakeplan.experience.deformation": ("DeformOptions", "DeformResult", "deform"),
    "drakeplan.experience.library": ("Library",),
    "drakeplan.experience.shipped": ("library_folder",),
    "drakeplan.experience.stored_plan": ("store_plan",),
    "drakeplan.export": ("export_plan",),
    "drakeplan.plan.plan": ("Plan",),
    "drakeplan.plan.plan_file": ("inspect_plan", "read_plan", "write_plan"),
    "drakeplan.plan.state": ("PlanState",),
    "drakeplan.plan.verified": ("verify",),
    "drakeplan.progress": ("ProgressEvent",),
    "drakeplan.query.batch": ("plan_many",),
    "drakeplan.query.contact_on_terrain": ("make_contact",),
    "drakeplan.query.given_contacts": ("plan_motion",),
    "drakeplan.query.options": ("PlanOptions",),
    "drakeplan.query.planning": ("plan_scene",),
    "drakeplan.query.result": ("PlanResult",),
    "drakeplan.playback": ("show_plan", "write_page"),
    "drakeplan.timing.step_timing": ("Timing",),
    "drakeplan.verifier": ("Report",),
    "scenes.contact": ("Contact",),
    "drakeplan.robot_setup.add": ("AddedRobot", "add_robot"),
    "scenes.imports.built": ("ImportOptions",),
    "scenes.imports.import_terrain": ("ImportedTerrain", "import_terrain", "write_terrain"),
    "scenes.input_error": ("InputError",),
    "scenes.robots.robot": ("Robot", "load_robot", "robot_names"),
    "scenes.scene": ("Goal", "Scene", "Start"),
    "scenes.stance": ("Stance",),
    "scenes.files.scene_source": ("list_scenes", "load_scene"),
    "scenes.terrain.surface": ("Surface",),
    "scenes.terrain.terrain": ("Terrain",),
}


if not TYPE_CHECKING:  # a type checker shall know the names above, and no others

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
