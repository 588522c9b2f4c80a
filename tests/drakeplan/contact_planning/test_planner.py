"""The registry of planners: a planner that the package does not know plans, is verified and is listed in the help."""

from __future__ import annotations

import json
import sys
from pathlib import Path

import numpy as np
import pytest

from drakeplan.cli import main
from drakeplan.cli.plan import _planner_help
from drakeplan.contact_planning.planner import PLANNERS, PlannerEntry, make_planner
from drakeplan.query.options import PlanOptions
from drakeplan.query.planning import plan_scene
from scenes.input_error import InputError
from scenes.robots.robot import load_robot
from scenes.scene import Goal, Scene, Start
from scenes.terrain.surface import Surface
from scenes.terrain.terrain import Terrain

ROBOT = load_robot("escher")


@pytest.fixture
def toy(monkeypatch: pytest.MonkeyPatch) -> str:
    monkeypatch.syspath_prepend(str(Path(__file__).parent))
    monkeypatch.setitem(PLANNERS, "straight", PlannerEntry("steps straight ahead", "toy_planner:build"))
    yield "straight"
    sys.modules.pop("toy_planner", None)


@pytest.mark.slow
def test_a_planner_from_outside_plans_through_the_command_line(toy: str, tmp_path: Path, capsys) -> None:
    out = tmp_path / "plan.h5"
    assert main(["plan", "flat", "--goal", "0.5", "0", "--planner", toy, "--out", str(out), "--json"]) == 0
    report = json.loads(capsys.readouterr().out)
    assert report["status"] == "complete" and report["verified"]["holds"]
    assert report["expansions"] == 1
    assert main(["verify", str(out)]) == 0


def test_its_help_comes_from_the_registry(toy: str) -> None:
    assert "straight: steps straight ahead" in _planner_help()


def test_the_reason_for_no_plan_is_the_planners_own(toy: str) -> None:
    cliff = Terrain((Surface("here", np.array([[-1.0, -1, 0], [0.4, -1, 0], [0.4, 1, 0], [-1, 1, 0]])), _there()))
    scene = Scene("cliff", cliff, Start((0.0, 0.0, 0.0)), Goal((2.0, 0.0, 0.0)))
    result = plan_scene(scene, ROBOT, PlanOptions(planner=toy))
    assert (result.status, result.reason) == ("none", "no ground straight ahead")


def _there() -> Surface:
    return Surface("there", np.array([[1.5, -1.0, 0], [3, -1, 0], [3, 1, 0], [1.5, 1, 0]]))


@pytest.mark.slow
def test_an_infeasible_sequence_is_explained_with_a_change_that_is_enough(toy: str) -> None:
    rise = 0.36  # tan of 20 deg, and friction 0.2
    ice = np.array([[-1, -1, -rise], [2, -1, 2 * rise], [2, 1, 2 * rise], [-1, 1, -rise]])
    terrain = Terrain((Surface("ice", ice, friction=0.2),))
    scene = Scene("ice", terrain, Start((0.0, 0.0, 0.0)), Goal((0.3, 0.0, 0.3 * rise), 0.2))
    result = plan_scene(scene, ROBOT, PlanOptions(planner=toy, explain=True))
    assert result.status != "complete"
    assert result.explanation is not None
    found = result.explanation.found
    assert not found.feasible
    assert found.blockages
    lines = result.explanation.lines()
    assert lines[0].startswith("dynamics of the whole sequence") and "infeasible" in lines[0]
    assert any("blocked" in line for line in lines)
    assert any("friction" in str(remedy) for remedy in found.remedies), lines
    assert json.loads(json.dumps(result.report))["explanation"]["lines"] == lines


def test_an_unknown_planner_is_refused_with_the_nearest_names() -> None:
    with pytest.raises(InputError, match="did you mean footsteps"):
        make_planner("footstep", None, None)
