"""Shows a plan in Meshcat, live or as one self-contained page: terrain, robot, contacts, forces, time slider.

It reads only the plan and the robot's model; what it shows was computed elsewhere.
"""

from __future__ import annotations

import contextlib
import logging
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from pydrake.geometry import Meshcat, MeshcatParams

from drakeplan.plan.plan import Plan
from drakeplan.plan.robot_of_plan import RobotMark, find_robot
from drakeplan.playback.animation import animate
from drakeplan.playback.page import finished_page, finished_scene_page
from drakeplan.playback.still import draw_scene, draw_still, light_and_look
from drakeplan.playback.view import View, choose_view
from scenes.files.scene_file import scene_from_yaml
from scenes.files.whole_file import write_whole
from scenes.input_error import InputError
from scenes.robots.robot import Robot
from scenes.scene import Scene

HOST = "localhost"  # Drake's default listens on every interface
UP = np.array([0.0, 0.0, 1.0])
MOST_LIT = 2.5  # times the size of the way: farther off there is no sun, for the sake of sharp shadows
HEAD_ABOVE_COM = 0.75  # [m] that the camera leaves room for

__all__ = [
    "open_meshcat",
    "page_html",
    "robot_of",
    "scene_page_html",
    "show_plan",
    "write_page",
    "write_scene_page",
]


def show_plan(plan: Plan, meshcat: Meshcat, robot: Robot | None = None) -> View:
    """Draws a plan and hands meshcat its animation, ready to be played with the panel's controls.

    Args:
        plan: what to show; one of status "contacts" shows its contacts alone.
        meshcat: where.
        robot: the plan's robot, looked up by name when not given.

    Returns:
        the camera that was chosen.

    Raises:
        InputError: an unknown robot, or one whose model is not the plan's.
    """
    robot = robot or robot_of(plan)
    scene = _scene_of(plan)
    draw_still(meshcat, plan, scene)
    animate(meshcat, plan, robot)
    view, extent = _camera(plan, scene)
    light_and_look(meshcat, view, extent)
    return view


def page_html(plan: Plan, robot: Robot | None = None) -> str:
    """The plan as one page with everything inline, animation and time slider included.

    Args:
        plan: complete or of contacts alone.
        robot: the plan's; None: loaded by its name.

    Raises:
        InputError: as `show_plan`.
    """
    robot = robot or robot_of(plan)
    meshcat = open_meshcat()
    show_plan(plan, meshcat, robot)
    return finished_page(meshcat.StaticHtml(), plan, _scene_of(plan))


def scene_page_html(scene: Scene) -> str:
    """A scene without a plan as one page with everything inline: terrain, goal, disturbances."""
    meshcat = open_meshcat()
    triangles = scene.terrain.triangles
    pushes = draw_scene(meshcat, scene, triangles)
    corners = np.stack(scene.terrain.extent)
    ends = [e.xyz for e in (scene.start, scene.goal) if e is not None and np.isfinite(e.xyz).all()]
    way = np.array(ends) if len(ends) == 2 else corners.mean(axis=0, keepdims=True)
    points = np.concatenate([*(s.vertices for s in scene.terrain.surfaces), triangles.reshape(-1, 3), pushes])
    view = choose_view(way + 0.1 * UP, points, np.concatenate([*_fans(scene), triangles]))
    light_and_look(meshcat, view, float(np.linalg.norm(points - view.target, axis=1).max()) + 1.0)
    return finished_scene_page(meshcat.StaticHtml(), scene)


def write_scene_page(scene: Scene, path: str | Path) -> None:
    """Writes `scene_page_html` in one step.

    Args:
        scene: to show.
        path: the HTML file.

    Raises:
        InputError: the file cannot be written.
    """
    write_whole(path, scene_page_html(scene).encode())


def write_page(plan: Plan, path: str | Path, robot: Robot | None = None) -> None:
    """Writes `page_html` in one step: a reader of the path sees the old file or the whole new one.

    Args:
        plan: complete or of contacts alone.
        path: the HTML file.
        robot: the plan's; None: loaded by its name.

    Raises:
        InputError: as `show_plan`, or the file cannot be written.
    """
    write_whole(path, page_html(plan, robot).encode())


def open_meshcat(port: int | None = None) -> Meshcat:
    """A Meshcat server that only this machine can reach.

    Args:
        port: where it listens; None for any free one from 7000 on.

    Raises:
        InputError: the port is taken or not allowed.
    """
    parameters = MeshcatParams(host=HOST, port=port, show_stats_plot=False)
    with _quiet_drake():
        try:
            return Meshcat(parameters)
        except RuntimeError as error:
            where = f"port {port}" if port is not None else "any port from 7000 to 7999"
            raise InputError(f"cannot open {HOST} at {where}: it is taken or not allowed ({error})") from None


def robot_of(plan: Plan) -> Robot:
    """The robot that the plan names, provided that its model is still the one the plan was made for.

    Raises:
        InputError: an unknown robot or another model.
    """
    return find_robot(RobotMark.of(plan))


def _scene_of(plan: Plan) -> Scene:
    return scene_from_yaml(plan.scene_yaml, f"plan of {plan.scene_name}", mesh_triangles=plan.triangles)


def _fans(scene: Scene) -> list[np.ndarray]:
    """The surfaces as triangles, (K, 3, 3) each [m]."""
    return [
        np.stack([np.broadcast_to(s.vertices[0], (len(s.vertices) - 2, 3)), s.vertices[1:-1], s.vertices[2:]], axis=1)
        for s in scene.terrain.surfaces
    ]


def _camera(plan: Plan, scene: Scene) -> tuple[View, float]:
    """The view on the whole way, and how far from its target the sun must reach [m]."""
    contacts = plan.contacts.X_WC[:, :3, 3]
    way = plan.centroidal.com if plan.centroidal is not None else contacts + 0.1 * UP
    top = HEAD_ABOVE_COM if plan.centroidal is not None else 0.0
    goal = [scene.goal.xyz] if scene.goal is not None and np.isfinite(scene.goal.xyz).all() else []
    points = np.concatenate([way, way + top * UP, contacts, np.reshape(goal, (-1, 3))])
    view = choose_view(way, points, np.concatenate([*_fans(scene), plan.triangles]))
    near = float(np.linalg.norm(points - view.target, axis=1).max()) + 1.0
    corners = np.stack(scene.terrain.extent)
    whole = float(np.linalg.norm(np.maximum(*np.abs(corners - view.target))))
    return view, float(np.clip(whole, near, MOST_LIT * near))


@contextlib.contextmanager
def _quiet_drake() -> Iterator[None]:
    """Meshcat announces its address on the log; the command line says it in its own way."""
    logger = logging.getLogger("drake")
    before = logger.level
    logger.setLevel(logging.WARNING)
    try:
        yield
    finally:
        logger.setLevel(before)
