"""`drakeplan warm-up`: compiles the kernels that a query needs, so that nobody has to wait for them later."""

from __future__ import annotations

import os
import sys
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import tyro

from scenes.files.cache_folder import COMPILED, KERNELS, is_writable
from scenes.input_error import InputError

ABOUT = """Compiles all kernels of a query, two to five minutes once on a machine, and plans a small scene with them.

With --cache they go into a folder of your choice, for an image whose installation cannot be written. Set NUMBA_CACHE_DIR to
that folder there; where it cannot be written either, its kernels are copied to a temporary folder.

examples:
  drakeplan warm-up
  drakeplan warm-up --cache /opt/drakeplan-kernels
  NUMBA_CACHE_DIR=/opt/drakeplan-kernels drakeplan plan stairs"""


@dataclass(frozen=True)
class Arguments:
    """Arguments of `drakeplan warm-up`."""

    cache: Annotated[str | None, tyro.conf.arg(metavar="DIR", help_behavior_hint="")] = None
    """folder for the kernels (default: where drakeplan keeps them)"""
    robot: Annotated[str, tyro.conf.arg(metavar="NAME")] = "escher"
    """robot that plans the small scene"""
    json: bool = False
    """one JSON object on standard output"""


def run(arguments: Arguments) -> int:
    """Compiles, and says where the kernels are."""
    if arguments.cache is not None:
        if "numba" in sys.modules:
            raise InputError("--cache: numba is imported already, and keeps its folder: start a new process")
        folder = Path(arguments.cache).expanduser().resolve()
        if not is_writable(folder):
            raise InputError(f"--cache: nothing can be written to {folder}")
        os.environ[KERNELS] = str(folder)
    from drakeplan.cli.output import print_json
    from drakeplan.progress import ProgressPrinter
    from drakeplan.query.one_planner import CAPTURE_KERNELS, load_kernels
    from drakeplan.query.options import PlanOptions
    from drakeplan.query.planning import plan_scene
    from optimization.inverse_kinematics.whole_body_ik import WholeBodyIK
    from scenes.files.scene_source import load_scene
    from scenes.robots.robot import load_robot

    began = time.perf_counter()
    with ProgressPrinter(sys.stderr) as progress:
        options = PlanOptions(goal=(0.5, 0.0), improve=0.0, deadline=600.0)
        robot = load_robot(arguments.robot)
        ik = WholeBodyIK(robot)
        load_kernels(robot, ik, "guided", progress)
        load_kernels(robot, ik, "search", progress, CAPTURE_KERNELS)
        plan_scene(load_scene("flat"), robot, options, progress)
    kept = os.environ.get(KERNELS)
    number = len(list(Path(kept).rglob(COMPILED))) if kept else None
    if arguments.json:
        print_json({"status": "compiled", "cache": kept, "files": number, "seconds": time.perf_counter() - began})
    else:
        print(f"kernels are compiled{f': {number} files in {kept}' if kept else ''}")
    return 0
