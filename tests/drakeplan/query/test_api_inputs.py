"""Scenes and robots may be given by name, as a file or ready-made, and whoever watches is told how far a query is."""

from __future__ import annotations

import io
import multiprocessing
import sys
import time
import types
from pathlib import Path

import numpy as np
import pytest

from drakeplan.progress import ProgressEvent
from drakeplan.query import planning, watching
from drakeplan.query.options import PlanOptions, with_options
from drakeplan.query.planning import plan_scene
from drakeplan.query.result import PlanResult
from drakeplan.query.watching import in_notebook, watched
from scenes.files.scene_file import write_scene
from scenes.files.scene_source import load_scene
from scenes.input_error import InputError
from scenes.robots.robot import Robot, load_robot
from scenes.scene import Scene

UPSIDE_DOWN = """\
format: drakeplan-scene
version: 1
name: one_floor
robot: escher
surfaces:
  - {name: floor, vertices: [[-1, -1, 0], [-1, 1, 0], [2, 1, 0], [2, -1, 0]]}
start: {xyz: [0, 0, 0]}
goal: {xyz: [1, 0, 0]}
"""


class Terminal(io.StringIO):
    """Standard error that a person sees."""

    def isatty(self) -> bool:
        return True


class Asked:
    """Stands for the planner: keeps what it was asked, and answers at once."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self.scene: Scene
        self.robot: Robot
        self.options: PlanOptions

        def answer(scene: Scene, robot: Robot, options: PlanOptions, tell) -> PlanResult:
            self.scene, self.robot, self.options = scene, robot, options
            tell(ProgressEvent("search", "a message"))
            return PlanResult("none", "not planned", None, {}, notes=("from the planner",))

        monkeypatch.setattr(planning, "plan_with_one", answer)


@pytest.fixture(autouse=True)
def without_commands(monkeypatch: pytest.MonkeyPatch) -> None:
    """As in a script, whatever other tests have loaded."""
    monkeypatch.delitem(sys.modules, watching.COMMANDS, raising=False)


@pytest.fixture
def asked(monkeypatch: pytest.MonkeyPatch) -> Asked:
    return Asked(monkeypatch)


def test_names_are_taken_and_the_seed_of_the_options_draws_the_scene(asked: Asked) -> None:
    plan_scene("rubble_field", "escher", PlanOptions(seed=3))
    assert asked.scene.terrain.surfaces == load_scene("rubble_field", seed=3).terrain.surfaces
    assert asked.scene.terrain.surfaces != load_scene("rubble_field", seed=0).terrain.surfaces
    assert asked.robot is load_robot("escher")
    assert asked.options.seed == 3
    assert asked.options.used > 0.0  # reading counts


def test_files_are_taken_as_text_or_path(asked: Asked, tmp_path: Path) -> None:
    path = tmp_path / "Prüfstand 1.yaml"
    write_scene(load_scene("stairs"), path)
    for scene, robot in ((path, load_robot("escher").source), (str(path), str(load_robot("escher").source))):
        plan_scene(scene, robot)
        assert asked.scene.name == "stairs"
        assert asked.robot.source == load_robot("escher").source


def test_what_is_ready_made_is_taken_as_it_is(asked: Asked) -> None:
    scene, robot, options = load_scene("flat"), load_robot("escher"), PlanOptions()
    result = plan_scene(scene, robot, options)
    assert asked.scene is scene and asked.robot is robot and asked.options is options
    assert result.notes == ("from the planner",)


def test_the_robot_is_the_scenes_else_escher(asked: Asked, tmp_path: Path) -> None:
    plan_scene("flat")
    assert asked.robot.name == "escher"
    (tmp_path / "scene.yaml").write_text(UPSIDE_DOWN.replace("robot: escher", "robot: no_such"))
    with pytest.raises(InputError, match="unknown robot 'no_such'"):
        plan_scene(tmp_path / "scene.yaml")


def test_notes_of_a_scene_that_was_read_come_with_the_result(asked: Asked, tmp_path: Path) -> None:
    (tmp_path / "scene.yaml").write_text(UPSIDE_DOWN)
    result = plan_scene(tmp_path / "scene.yaml")
    assert len(result.notes) == 2 and "floor" in result.notes[0] and result.notes[1] == "from the planner"
    assert result.report["notes"] == list(result.notes)


@pytest.mark.parametrize(
    ("scene", "robot", "error", "said"),
    [
        ("flatt", None, InputError, "unknown scene 'flatt': did you mean flat"),
        ("flat", "eschr", InputError, "unknown robot 'eschr': did you mean escher"),
        ("/no/such/scene.yaml", None, InputError, "/no/such/scene.yaml"),
        (3, None, TypeError, "scene: expected a Scene, a name or a path, got int"),
        ("flat", 3, TypeError, "robot: expected a Robot, a name or a YAML file, got int"),
    ],
)
def test_what_names_nothing_is_refused(asked: Asked, scene, robot, error: type[Exception], said: str) -> None:
    with pytest.raises(error, match=said):
        plan_scene(scene, robot)


# ---- surfaces to avoid


def test_nothing_may_touch_an_avoided_surface_and_the_others_stay() -> None:
    scene = load_scene("rubble_corridor")
    first, *others = scene.terrain.surfaces
    without = with_options(scene, PlanOptions(avoid=(first.name,))).terrain.surfaces
    assert without[0].effectors == frozenset() and np.array_equal(without[0].vertices, first.vertices)
    assert list(without[1:]) == others
    with pytest.raises(InputError, match="unknown surface 'no_such'"):
        with_options(scene, PlanOptions(avoid=("no_such",)))


@pytest.mark.slow
def test_a_plan_goes_round_a_stone_that_it_would_have_stepped_on() -> None:
    def stones(options: PlanOptions) -> set[str]:
        result = plan_scene("rubble_field", "escher", options)
        assert result.status == "complete" and result.plan is not None, result.reason
        surfaces = result.plan.scene().terrain.surfaces
        return {name for k in result.plan.contacts.surface if (name := surfaces[k].name).startswith("stone")}

    liked = stones(PlanOptions(expansions=80))
    avoided = tuple(sorted(liked))[:2]
    assert len(avoided) == 2
    assert not stones(PlanOptions(expansions=80, avoid=avoided)) & set(avoided)


def test_a_text_for_the_names_of_avoided_surfaces_is_refused() -> None:
    with pytest.raises(InputError, match="avoid: expected names of surfaces in a tuple, got the text 'ground'"):
        plan_scene("flat", "escher", PlanOptions(avoid="ground"))  # type: ignore[arg-type]


# ---- progress


def test_nothing_is_shown_where_nobody_watches(asked: Asked, capsys: pytest.CaptureFixture[str]) -> None:
    plan_scene("flat")
    plan_scene("flat", progress=False)
    assert capsys.readouterr() == ("", "")


def test_lines_are_shown_where_they_are_asked_for(asked: Asked, capsys: pytest.CaptureFixture[str]) -> None:
    plan_scene("flat", progress=True)
    out, err = capsys.readouterr()
    assert out == "" and "search" in err and "a message" in err


def test_a_person_at_a_terminal_sees_them_unless_they_want_silence(
    asked: Asked, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(sys, "stderr", Terminal())
    plan_scene("flat", progress=False)
    assert sys.stderr.getvalue() == ""
    plan_scene("flat")
    assert "a message" in sys.stderr.getvalue() and sys.stderr.getvalue().endswith("\n")


def test_a_worker_process_is_silent_on_a_terminal_too(asked: Asked, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys, "stderr", Terminal())
    monkeypatch.setattr(multiprocessing, "parent_process", lambda: object())
    plan_scene("flat")
    assert sys.stderr.getvalue() == ""


def test_a_command_tells_its_own_progress_and_no_other(asked: Asked, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys, "stderr", Terminal())
    monkeypatch.setitem(sys.modules, watching.COMMANDS, types.ModuleType(watching.COMMANDS))
    plan_scene("flat")
    assert sys.stderr.getvalue() == ""


def test_a_notebook_is_known_by_its_kernel(monkeypatch: pytest.MonkeyPatch) -> None:
    for shell, expected in ((types.SimpleNamespace(kernel=1), True), (types.SimpleNamespace(), False), (None, False)):
        module = types.SimpleNamespace(get_ipython=lambda shell=shell: shell)
        monkeypatch.setitem(sys.modules, "IPython", module)
        assert in_notebook() == expected
    monkeypatch.delitem(sys.modules, "IPython")
    assert not in_notebook()


def test_a_function_is_called_with_each_event_and_may_return_anything(asked: Asked) -> None:
    events: list[ProgressEvent] = []
    plan_scene("flat", progress=lambda event: events.append(event) or "anything")
    assert [(event.stage, event.message) for event in events] == [("search", "a message")]


def test_a_long_step_is_seen_to_go_on_at_a_terminal(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys, "stderr", Terminal())
    monkeypatch.setattr(watching, "TICK", 0.02)
    with watched(None) as tell:
        tell(ProgressEvent("motion", "long"))
        until = time.monotonic() + 10.0
        while sys.stderr.getvalue().count("long") < 3 and time.monotonic() < until:
            time.sleep(0.01)
    shown = sys.stderr.getvalue()
    assert shown.count("long") >= 3
    time.sleep(0.1)
    assert sys.stderr.getvalue() == shown  # it ends with the query


def test_what_the_function_raises_ends_the_query(asked: Asked) -> None:
    def refuse(event: ProgressEvent) -> None:
        raise KeyError(event.stage)

    with pytest.raises(KeyError, match="search"):
        plan_scene("flat", progress=refuse)
