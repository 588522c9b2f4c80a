"""On the first day kernels compile for minutes: half of them in a second process, beside those of the search.

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

from drakeplan.contact_planning.contact_plan import PlannerOptions
from drakeplan.context import QueryContext
from drakeplan.motion.maker import MotionMaker, MotionOptions
from optimization.inverse_kinematics.whole_body_ik import WholeBodyIK
from scenes.contact import Contact
from scenes.effector import EFFECTORS
from scenes.footholds.projection import patch_shape
from scenes.footholds.snap import Footholds, Snap
from scenes.robots.robot import Robot, load_robot
from scenes.scene import Goal, Scene, Start
from scenes.stance import Stance
from scenes.terrain.surface import Surface
from scenes.terrain.terrain import Box, Terrain

COMPILING = 5.0  # [s] after which loading kernels must be compiling them
COARSE = MotionOptions(rate=10, rounds=1, attempts=1)  # every kernel, few frames
CALL = "import json, sys; sys.path[:] = json.loads(sys.argv[1]); from {0} import compile_the_rest; compile_the_rest(sys.argv[2])"


@contextlib.contextmanager
def compile_beside(robot: Robot, tell: Callable[[], None]) -> Iterator[None]:
    """While this lasts longer than loading takes, a second process compiles what this one does not need at first.

    Args:
        robot: whom the second process moves.
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


def small_scene(robot: Robot) -> Scene:
    """A floor, a wall within reach of the left palm, and a post.

    Args:
        robot: whose shoulders say how high the wall is.
    """
    floor = Surface("floor", np.array([[-1.0, -1, 0], [2, -1, 0], [2, 1, 0], [-1, 1, 0]]))
    height = robot.shoulder[2]
    corners = [[-1.0, 0.65, height - 0.5], [2, 0.65, height - 0.5], [2, 0.65, height + 0.5], [-1, 0.65, height + 0.5]]
    wall = Surface("wall", np.array(corners))
    X_WO = np.eye(4)
    X_WO[:3, 3] = [1.9, -0.9, 0.5]
    post = Box("post", np.array([0.1, 0.1, 1.0]), X_WO)
    terrain = Terrain((floor, wall if wall.normal[1] < 0 else wall.flipped()), (post,))
    return Scene("warm_up", terrain, Start((0.0, 0.0, 0.0)), Goal((0.5, 0.0, 0.0), 0.1))


def compile_the_rest(name: str) -> None:
    """A posture, a moved step and a motion: what the search asks for late, in the order in which it does.

    Args:
        name: of the robot, or its file.
    """
    robot = load_robot(name)
    ik = WholeBodyIK(robot)
    feet = tuple(_foot(e, 0.0) for e in range(2))
    X_WE = np.tile(np.eye(4), (len(EFFECTORS), 1, 1))
    X_WE[:2] = [foot.X_WC for foot in feet]
    region = np.array([[-0.05, -0.1], [0.05, -0.1], [0.05, 0.1], [-0.05, 0.1]])
    ik.solve(X_WE, np.array([True, True, False, False]), region)
    context = QueryContext(small_scene(robot), robot, ik)
    move_a_step(context)
    stance = Stance((*feet, None, None))
    MotionMaker(context, COARSE).run((stance, stance.replace(0, _foot(0, 0.15))), lambda event: None)


def move_a_step(context: QueryContext) -> None:
    """Moves a step that hangs over the floor's edge, and a palm beside the wall: where most fit, the search moves none.

    Args:
        context: of a query on `small_scene`.
    """
    robot, edge = context.robot, float(context.packed.low[0, 0])
    wanted, stand = np.array([[edge, 0.0, 0.0]]), np.array([edge + 0.1, -0.2, 0.0])
    options, footholds = PlannerOptions(), Footholds(context.packed, 0.0, Snap())
    limits = options.step_limits(robot, options.model)
    footholds.place_feet(0, wanted, (-0.1, 0.1), patch_shape(robot.effectors[0]), stand, limits)
    if 2 not in context.usable_palms:
        return
    shoulder = np.array([edge - 0.05, 0.2, robot.shoulder[2]])
    footholds.place_palms(2, shoulder, np.array([[0.0, 1.0, 0.0]]), 0.0, (0.1, 0.7), patch_shape(robot.effectors[2]))


def _foot(effector: int, x: float) -> Contact:
    X_WC = np.eye(4)
    X_WC[:2, 3] = x, 0.1 - 0.2 * effector
    return Contact(EFFECTORS[effector], 0, X_WC, 0.5)
