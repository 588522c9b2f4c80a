"""Scenes and robots as users give them: by name, as a file, or ready-made."""

from __future__ import annotations

import os
from typing import TypeAlias

from scenes.files.scene_source import load_scene
from scenes.robots.robot import Robot, load_robot
from scenes.scene import Scene

AnyScene: TypeAlias = Scene | str | os.PathLike[str]
AnyRobot: TypeAlias = Robot | str | os.PathLike[str]
DEFAULT_ROBOT = "escher"


def as_scene(scene: AnyScene, seed: int = 0) -> Scene:
    """The scene that is meant.

    Args:
        scene: ready-made, a name (`list_scenes()`), a scene file, `hpp/<mesh>` or a mesh file.
        seed: of the named scenes that draw something.

    Raises:
        InputError: nothing goes by that name, or what does cannot be read.
    """
    if isinstance(scene, Scene):
        return scene
    if not isinstance(scene, str | os.PathLike):
        raise TypeError(f"scene: expected a Scene, a name or a path, got {type(scene).__name__}")
    return load_scene(os.fspath(scene), seed=seed)


def as_robot(robot: AnyRobot | None, scene: Scene) -> Robot:
    """The robot that is meant.

    Args:
        robot: ready-made, a name (`robot_names()`) or a YAML file; None: the scene's, else `DEFAULT_ROBOT`.
        scene: that it crosses.

    Raises:
        InputError: no such robot, or a description that is wrong.
    """
    if isinstance(robot, Robot):
        return robot
    if robot is not None and not isinstance(robot, str | os.PathLike):
        raise TypeError(f"robot: expected a Robot, a name or a YAML file, got {type(robot).__name__}")
    return load_robot(os.fspath(robot or scene.robot or DEFAULT_ROBOT))
