"""Where a scene comes from: a name, a scene file, a mesh of hpp-environments or a mesh file."""

from __future__ import annotations

import inspect

from scenes.input_error import unknown_name
from scenes.library import NAMED_SCENES
from scenes.scene import Scene


def load_scene(source: str, *, seed: int = 0) -> Scene:
    """The scene that `source` names.

    Args:
        source: one of `list_scenes()`.
        seed: of the named scenes that draw something.

    Raises:
        InputError: nothing goes by that name, or what does cannot be read.
    """
    if source in NAMED_SCENES:
        return NAMED_SCENES[source](seed)
    raise unknown_name("scene", source, NAMED_SCENES)


def list_scenes() -> dict[str, str]:
    """Name and one-line description of every named scene."""
    return {name: (inspect.getdoc(build) or name).splitlines()[0] for name, build in NAMED_SCENES.items()}
