"""A model becomes a robot that goes by its name: description, robot file, picture."""

from __future__ import annotations

import contextlib
import re
import tempfile
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path

from drakeplan.robot_setup.describe import describe_robot
from drakeplan.robot_setup.description import Description
from drakeplan.robot_setup.model_source import find_model_source
from drakeplan.robot_setup.pictures import write_pictures
from drakeplan.robot_setup.robot_file import write_robot_file
from scenes.files.whole_file import require_writable
from scenes.input_error import InputError
from scenes.robots.robot import ROBOTS, Robot, load_robot, own_robots_folder


@dataclass(frozen=True, eq=False)
class AddedRobot:
    """What adding a robot made.

    Attributes:
        robot: ready to plan with.
        file: its robot file; every value has a comment that says where it comes from.
        picture: PNG file with the robot from four sides as it was understood.
        description: what was found; `description.notes` is what a user should know, a line each.
    """

    robot: Robot
    file: Path
    picture: Path
    description: Description


def add_robot(
    model: str | Path,
    *,
    name: str | None = None,
    folder: str | Path | None = None,
    picture: str | Path | None = None,
    packages: Mapping[str, Path] | None = None,
    links: Mapping[str, str] | None = None,
    replace: bool = False,
    seed: int = 0,
    say: Callable[[str], None] = lambda line: None,
) -> AddedRobot:
    """Describes a humanoid's model and writes its robot file; takes some seconds, with large meshes a minute.

    Args:
        model: path of a URDF, SDF or MJCF file, or PACKAGE/FILE of an installed Python package.
        name: of the robot; None for the model file's.
        folder: of the robot file `<name>.yaml`; None for the user's data folder, where `load_robot` finds it by name.
        picture: PNG file; None for `<name>.png` beside the robot file.
        packages: folders of package:// addresses by package name.
        links: effector -> link, of those that are not found ("left_foot": "l_sole").
        replace: whether a robot file that is there is replaced.
        seed: of random postures.
        say: takes a line for each step.

    Raises:
        InputError: the model is no humanoid on flat feet, a name that is taken, or files that cannot be written.
    """
    packages = packages or {}
    found = find_model_source(str(model), packages)
    name = _name(name, found.file, own=folder is None)
    place = Path(folder).expanduser() if folder is not None else own_robots_folder() / name
    file = place / f"{name}.yaml"
    drawn = Path(picture) if picture is not None else place / f"{name}.png"
    if drawn.resolve() == file.resolve():
        raise InputError(f"--picture {drawn}: the same file as the robot file: choose another")
    with _folder_for(file, replace):
        require_writable(drawn)
        description = describe_robot(found, name, links, seed=seed, say=say)
        with tempfile.TemporaryDirectory(prefix="drakeplan-robot-") as scratch:  # what cannot be read is not written
            write_robot_file(description, Path(scratch) / file.name)
            load_robot(Path(scratch) / file.name, packages)
        write_robot_file(description, file)
    robot = load_robot(file, packages)
    say("draw")
    write_pictures(robot, drawn)
    return AddedRobot(robot, file, drawn, description)


def _name(name: str | None, model: Path, *, own: bool) -> str:
    if name is None:
        name = re.sub(r"[^\w.+-]+", "_", model.stem).strip("_.") or "robot"
    if not re.fullmatch(r"\w[\w .+-]{0,63}", name):
        raise InputError(
            f"--name {name}: expected letters, digits, spaces and . + - _, at most 64, the first a letter or digit"
        )
    if own and (ROBOTS / name / f"{name}.yaml").is_file():
        raise InputError(f"--name {name}: a robot of this name comes with drakeplan: choose another")
    return name


@contextlib.contextmanager
def _folder_for(file: Path, replace: bool) -> Iterator[None]:
    """Makes the folder of the robot file, and takes it away again where no robot is added; refuses to write over one."""
    if file.exists() and not replace:
        raise InputError(f"{file}: there is a robot of this name: add --replace, or choose another --name")
    made = [f for f in (file.parent, *file.parent.parents) if not f.exists()]
    try:
        file.parent.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(f"{file.parent}: cannot be made ({error.strerror}): choose a folder with --out DIR") from None
    try:
        require_writable(file)
        yield
    except BaseException:
        for folder in made:
            with contextlib.suppress(OSError):
                folder.rmdir()
        raise
