"""Shows a plan in Meshcat, live or as one self-contained page: terrain, robot, contacts, forces, time slider.

It reads only the plan and the robot's model; what it shows was computed elsewhere.
"""

from __future__ import annotations

import contextlib
import logging
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np
from pydrake.geometry import Meshcat, MeshcatParams

from drakeplan.plan.plan import Plan
from drakeplan.plan.robot_of_plan import RobotMark, find_robot
from drakeplan.playback.animation import animate
from drakeplan.playback.beside import joined
from drakeplan.playback.contact_timeline import contact_timeline, has_motion
from drakeplan.playback.frame_times import frame_times
from drakeplan.playback.legend import plan_legend, scene_legend
from drakeplan.playback.page import Pane, finished_page
from drakeplan.playback.page_data import page_data
from drakeplan.playback.push_rose import risk_bar
from drakeplan.playback.robot_motion import draw_robot
from drakeplan.playback.server import HOST
from drakeplan.playback.still import draw_scene, draw_still, light_and_look
from drakeplan.playback.view import ASPECT, View, choose_view
from scenes.files.scene_file import scene_from_yaml
from scenes.files.whole_file import write_whole
from scenes.input_error import InputError
from scenes.robots.robot import Robot
from scenes.scene import Scene

UP = np.array([0.0, 0.0, 1.0])
MOST_LIT = 2.5  # times the size of the way: farther off there is no sun, for the sake of sharp shadows
HEAD_ABOVE_COM = 0.75  # [m] that the camera leaves room for

__all__ = [
    "beside_page_html",
    "open_meshcat",
    "page_html",
    "robot_of",
    "scene_page_html",
    "show_plan",
    "write_beside_page",
    "write_page",
    "write_scene_page",
]


def show_plan(plan: Plan, meshcat: Meshcat, robot: Robot | None = None) -> View:
    """Draws a plan and hands meshcat its animation, ready to be played with the panel's controls.

    Captions, torques and the colours of forces need a page: see `page_html`.

    Args:
        plan: what to show; one of status "contacts" shows its contacts alone.
        meshcat: where.
        robot: the plan's robot, looked up by name when not given.

    Returns:
        the camera that was chosen.

    Raises:
        InputError: an unknown robot, or one whose model is not the plan's.
    """
    _draw(plan, meshcat, robot or robot_of(plan))
    view, extent = _camera([plan])
    light_and_look(meshcat, view, extent)
    return view


def page_html(plan: Plan, robot: Robot | None = None) -> str:
    """The plan as one page with everything inline, animation and controls included.

    Args:
        plan: complete or of contacts alone.
        robot: the plan's; None: loaded by its name.

    Raises:
        InputError: as `show_plan`.
    """
    robot = robot or robot_of(plan)
    meshcat = open_meshcat()
    show_plan(plan, meshcat, robot)
    return finished_page(meshcat.StaticHtml(), [_pane(plan, robot)])


def beside_page_html(
    plans: tuple[Plan, Plan], names: tuple[str, str], robots: tuple[Robot, Robot] | None = None
) -> str:
    """Two plans as one page, side by side, with one time bar. Where both cross one scene, the cameras move together.

    Args:
        plans: the first one is shown on the left.
        names: what to call them, such as the names of their files.
        robots: the plans'; None: loaded by their names.

    Raises:
        InputError: as `show_plan`.
    """
    first, second = plans
    robots = robots or (robot_of(first), robot_of(second))
    linked = first.scene_yaml == second.scene_yaml and np.array_equal(first.triangles, second.triangles)
    pages = []
    for plan, robot in zip(plans, robots, strict=True):
        meshcat = open_meshcat()
        _draw(plan, meshcat, robot)
        light_and_look(meshcat, *_camera(plans if linked else [plan], aspect=0.5 * ASPECT))
        pages.append(meshcat.StaticHtml())
    short = [Path(name).name for name in names]
    titles = short if short[0] != short[1] else names
    panes = [_pane(plan, robot, title) for plan, robot, title in zip(plans, robots, titles, strict=True)]
    return finished_page(joined(*pages), panes, linked=linked)


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
    return finished_page(meshcat.StaticHtml(), [Pane(scene_legend(scene))])


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


def write_beside_page(
    plans: tuple[Plan, Plan], path: str | Path, names: tuple[str, str], robots: tuple[Robot, Robot] | None = None
) -> None:
    """Writes `beside_page_html` in one step.

    Args:
        plans: the first one is shown on the left.
        path: the HTML file.
        names: what to call them, such as the names of their files.
        robots: the plans'; None: loaded by their names.

    Raises:
        InputError: as `show_plan`, or the file cannot be written.
    """
    write_whole(path, beside_page_html(plans, names, robots).encode())


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


def _draw(plan: Plan, meshcat: Meshcat, robot: Robot) -> None:
    """All of a plan. The robot comes first: drawn in the same order, it is the same, byte by byte, on every page."""
    timeline = contact_timeline(plan)
    frames = frame_times(timeline.duration)
    bodies = draw_robot(meshcat, plan.motion, robot, frames) if has_motion(plan) and plan.motion is not None else None
    draw_still(meshcat, plan, _scene_of(plan))
    animate(meshcat, plan, timeline, frames, bodies)


def _pane(plan: Plan, robot: Robot, name: str = "") -> Pane:
    return Pane(plan_legend(plan, _scene_of(plan), name), page_data(plan, robot), risk_bar(plan))


def _camera(plans: Sequence[Plan], aspect: float = ASPECT) -> tuple[View, float]:
    """The view on the whole way of plans in one scene, and how far from its target the sun must reach [m]."""
    scene, plan = _scene_of(plans[0]), plans[0]
    ways, points = [], []
    for plan in plans:
        contacts = plan.contacts.X_WC[:, :3, 3]
        moves = plan.centroidal is not None and has_motion(plan)
        ways.append(plan.centroidal.com if plan.centroidal is not None and moves else contacts + 0.1 * UP)
        points += [ways[-1], ways[-1] + (HEAD_ABOVE_COM if moves else 0.0) * UP, contacts]
    goal = [scene.goal.xyz] if scene.goal is not None and np.isfinite(scene.goal.xyz).all() else []
    held = np.concatenate([*points, np.reshape(goal, (-1, 3))])
    if not len(ways[0]):  # a plan of nothing shows its terrain
        ways, held = [np.stack(scene.terrain.extent)], np.concatenate([held, np.stack(scene.terrain.extent)])
    view = choose_view(ways[0], held, np.concatenate([*_fans(scene), plan.triangles]), aspect)
    near = float(np.linalg.norm(held - view.target, axis=1).max()) + 1.0
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
