"""Robots of `humanoids.py`, each described once in a session, with a cache and a data folder of their own."""

from __future__ import annotations

import sys
import tempfile
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import platformdirs
import pytest

from drakeplan.robot_setup.describe import describe_robot
from drakeplan.robot_setup.description import Description
from drakeplan.robot_setup.model_source import find_model_source
from drakeplan.robot_setup.robot_file import write_robot_file
from scenes.robots.robot import Robot, load_robot

HERE = str(Path(__file__).parent)
if HERE not in sys.path:
    sys.path.insert(0, HERE)  # tests import humanoids.py by its name

from humanoids import Humanoid  # noqa: E402


@dataclass(frozen=True)
class Described:
    """A humanoid, what was found of it, the robot file and what is read from that."""

    humanoid: Humanoid
    description: Description
    file: Path
    robot: Robot


@pytest.fixture(scope="session")
def shared_folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("robots")


@pytest.fixture(autouse=True)
def own_folders(shared_folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Nothing is read from or written to the user's own folders."""
    monkeypatch.setattr(platformdirs, "user_cache_dir", lambda name: str(shared_folder / "cache" / name))
    monkeypatch.setenv("XDG_DATA_HOME", str(tmp_path / "data"))


@pytest.fixture(scope="session")
def described(shared_folder: Path) -> Callable[[Humanoid], Described]:
    """Describes a humanoid, at its first call in a session."""
    known: dict[Humanoid, Described] = {}

    def describe(humanoid: Humanoid) -> Described:
        if humanoid not in known:
            with pytest.MonkeyPatch.context() as patch:
                patch.setattr(platformdirs, "user_cache_dir", lambda name: str(shared_folder / "cache" / name))
                folder = Path(tempfile.mkdtemp(dir=shared_folder))
                found = describe_robot(find_model_source(str(humanoid.write(folder)), {}), "toy")
                write_robot_file(found, folder / "toy.yaml")
                known[humanoid] = Described(humanoid, found, folder / "toy.yaml", load_robot(folder / "toy.yaml"))
        return known[humanoid]

    return describe
