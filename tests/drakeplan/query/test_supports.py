"""Ground that takes soles in part only, from the scene to the verified plan."""

from __future__ import annotations

from pathlib import Path

import pytest

from drakeplan.plan.plan_file import write_plan
from drakeplan.query.options import PlanOptions
from drakeplan.query.planning import plan_scene
from drakeplan.query.result import PlanResult
from drakeplan.verifier import verify
from scenes.contact import patch_corners
from scenes.files.scene_file import scene_from_yaml
from scenes.input_error import InputError
from scenes.robots.robot import load_robot

WIDE = (-0.6, 0.6)
Bounds = tuple[float, float]
PLATFORMS = [((-0.5, 0.3), WIDE), ((1.2, 2.2), WIDE)]


def scene_text(plates: list[tuple[Bounds, Bounds]], goal: float) -> str:
    lines = [
        f"- {{name: s{k}, vertices: [[{x0},{y0},0],[{x1},{y0},0],[{x1},{y1},0],[{x0},{y1},0]]}}"
        for k, ((x0, x1), (y0, y1)) in enumerate(plates)
    ]
    head = "format: drakeplan-scene\nversion: 1\nfriction: 0.6\nsurfaces:\n"
    return head + "\n".join(lines) + f"\nstart: {{xyz: [0, 0, 0]}}\ngoal: {{xyz: [{goal}, 0, 0], radius: 0.2}}\n"


PLANKS = [((round(-0.5 + 0.15 * k, 2), round(-0.4 + 0.15 * k, 2)), WIDE) for k in range(14)]
BARS = [((-0.5, 2.0), (y - 0.03, y + 0.03)) for y in (-0.1, 0.1)]
CROSSBARS = [((x, x + 0.04), WIDE) for x in (0.4, 0.54, 0.7, 0.84)]
STONES = [((0.39 + 0.3 * k, 0.51 + 0.3 * k), (0.04 - 0.2 * (k % 2), 0.16 - 0.2 * (k % 2))) for k in range(3)]
SCENES = {
    "planks of 10 cm, gaps of 5 cm": (PLANKS, 1.1),
    "two bars of 6 cm, one for each foot": (BARS, 1.0),
    "bars across the way between two platforms": ([*PLATFORMS, *CROSSBARS], 1.5),
    "stones of 12 cm": ([*PLATFORMS, *STONES], 1.5),
}


def planned(name: str, **options: object) -> PlanResult:
    scene = scene_from_yaml(scene_text(*SCENES[name]), source="test")
    return plan_scene(scene, load_robot("escher"), PlanOptions(deadline=120.0, improve=0.0, **options))


@pytest.mark.slow
@pytest.mark.parametrize("name", SCENES)
def test_a_robot_crosses_on_parts_of_its_soles(tmp_path: Path, name: str) -> None:
    result = planned(name)
    assert result.status == "complete", result.reason
    assert result.plan is not None
    robot, surfaces = load_robot("escher"), scene_from_yaml(result.plan.scene_yaml, source="plan").terrain.surfaces
    contacts = [result.plan.contact(k) for k in range(len(result.plan.contacts))]
    soles = [c.p_WC[:2] + patch_corners(robot.effectors[0].half_extent) @ c.R_WC[:2, :2].T for c in contacts]
    bounds = [
        (surfaces[c.surface].vertices[:, :2].min(axis=0), surfaces[c.surface].vertices[:, :2].max(axis=0))
        for c in contacts
    ]
    assert any((sole < low).any() or (sole > high).any() for sole, (low, high) in zip(soles, bounds, strict=True))
    write_plan(result.plan, tmp_path / "plan.h5")
    report = verify(tmp_path / "plan.h5")
    assert report.holds, report.table()


def test_whole_soles_do_not_cross_stones_and_the_reason_names_one() -> None:
    result = planned("stones of 12 cm", full_soles=True, footholds="fixed", expansions=50)
    assert result.status != "complete"
    assert "'s2' and 2 more take no whole sole of 22 x 10 cm" in result.reason


def test_whole_soles_cannot_even_start_on_bars() -> None:
    with pytest.raises(InputError, match="no ground takes both soles"):
        planned("two bars of 6 cm, one for each foot", full_soles=True)
