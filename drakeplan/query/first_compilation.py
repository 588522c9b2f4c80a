"""On the first day kernels compile for minutes: those of the motion in a second process, beside those of the search.

Both write to the same cache, so that each loads what the other has compiled.
"""

from __future__ import annotations

import contextlib
import json
import os
import subprocess
import sys
import threading
from collections.abc import Callable, Iterator

import numpy as np

from drakeplan.context import QueryContext
from drakeplan.motion.maker import MotionMaker, MotionOptions
from optimization.inverse_kinematics.whole_body_ik import WholeBodyIK
from scenes.contact import Contact
from scenes.effector import EFFECTORS
from scenes.robots.robot import Robot, load_robot
from scenes.scene import Goal, Scene, Start
from scenes.stance import Stance
from scenes.terrain.surface import Surface
from scenes.terrain.terrain import Terrain

COMPILING = 5.0  # [s] after which loading kernels must be compiling them
COARSE = MotionOptions(rate=10, rounds=1, attempts=1)  # every kernel, few frames
CALL = "import json, sys; sys.path[:] = json.loads(sys.argv[1]); from {0} import compile_motion; compile_motion(sys.argv[2])"


@contextlib.contextmanager
def compile_beside(robot: Robot, tell: Callable[[], None]) -> Iterator[None]:
    """While this lasts longer than loading takes, a second process compiles the kernels of the motion.

    Args:
        robot: whose motion the second process makes.
        tell: called when compiling begins.
    """
    helpers: list[subprocess.Popen] = []
    ended = threading.Event()

    def begin() -> None:
        tell()
        if (os.cpu_count() or 1) < 2 or ended.is_set():
            return
        named = str(robot.source) if robot.given_by_path else robot.name
        command = [sys.executable, "-c", CALL.format(__name__), json.dumps(sys.path), named]
        quiet = subprocess.DEVNULL
        with contextlib.suppress(OSError):  # then this process compiles all of them
            helpers.append(subprocess.Popen(command, stdin=quiet, stdout=quiet, stderr=quiet))

    patience = threading.Timer(COMPILING, begin)
    patience.daemon = True
    patience.start()
    try:
        yield
    finally:
        ended.set()
        patience.cancel()
        patience.join()
        for helper in helpers:  # what it has not finished this process has compiled itself
            helper.kill()
            helper.wait()


def compile_motion(name: str) -> None:
    """Moves a robot one step ahead on level ground.

    Args:
        name: of the robot, or its file.
    """
    robot = load_robot(name)
    corners = np.array([[-1.0, -1, 0], [2, -1, 0], [2, 1, 0], [-1, 1, 0]])
    scene = Scene("step", Terrain((Surface("floor", corners),)), Start((0.0, 0.0, 0.0)), Goal((0.5, 0.0, 0.0), 0.1))
    context = QueryContext(scene, robot, WholeBodyIK(robot))
    feet = tuple(_foot(e, 0.0) for e in range(2))
    stance = Stance((*feet, None, None))
    MotionMaker(context, COARSE).run((stance, stance.replace(0, _foot(0, 0.15))), lambda event: None)


def _foot(effector: int, x: float) -> Contact:
    X_WC = np.eye(4)
    X_WC[:2, 3] = x, 0.1 - 0.2 * effector
    return Contact(EFFECTORS[effector], 0, X_WC, 0.5)
