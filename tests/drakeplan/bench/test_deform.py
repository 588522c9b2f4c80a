"""The bench counts what it says it counts, and goes on where it stopped."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from drakeplan.bench import deform as bench
from drakeplan.bench.kept_cases import RESUME
from drakeplan.bench.table import BenchOptions
from drakeplan.experience.deformation import DeformResult
from scenes.robots.robot import Robot


def fake_part(
    asked: list[tuple[str, str, int]], plan_of: object, robot: Robot, part: str, name: str, seed: int
) -> dict:
    """Even seeds are deformed, seed 3 is not planned again, seed 4 has no plan to deform."""
    asked.append((part, name, seed))
    if part == "replan":
        return {"replan": "none" if seed == 3 else "complete", "replan_s": 2.0}
    if seed == 4:
        return {"deform": bench.NO_PLAN, "deform_reason": "none", "deform_s": np.nan, "deform_total_s": np.nan}
    failed = seed % 2 == 1
    return {"deform": "strip" if failed else "complete", "deform_reason": "strip: balance" if failed else "",
            "deform_s": 1.0 + seed, "deform_total_s": 4.0}  # fmt: skip


def test_the_share_is_that_of_scenes_which_planning_again_solves(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    asked: list[tuple[str, str, int]] = []
    monkeypatch.setattr(bench, "_run_part", lambda *args: fake_part(asked, *args))
    monkeypatch.setenv(RESUME, str(tmp_path / "cases.jsonl"))
    bench.run(BenchOptions(seeds=2))
    assert len(asked) == 8
    table = bench.run(BenchOptions(seeds=5))
    assert len(asked) == 20, "what stands in the file is not run again"
    row = dict(zip(table.columns, table.rows[0], strict=True))
    assert (row["moved scenes"], row["planned again"], row["deformed"], row["both"]) == (4, 3, 2, 2)
    assert row["share of planned"] == pytest.approx(2 / 3)
    assert row["deformation median s"] == pytest.approx(2.5)
    assert "rubble_field: 2 times strip: balance" in table.notes


def test_a_line_cut_off_by_a_kill_is_run_again(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    asked: list[tuple[str, str, int]] = []
    monkeypatch.setattr(bench, "_run_part", lambda *args: fake_part(asked, *args))
    file = tmp_path / "cases.jsonl"
    monkeypatch.setenv(RESUME, str(file))
    bench.run(BenchOptions(seeds=1))
    file.write_text(file.read_text()[:-20])
    bench.run(BenchOptions(seeds=1))
    assert len(asked) == 5


def test_a_moved_scene_is_the_same_every_time() -> None:
    (_, first), (scene, again) = bench.moved_scene("rubble_corridor", 7), bench.moved_scene("rubble_corridor", 7)
    assert first.terrain.surfaces == again.terrain.surfaces
    assert [s.name for s in scene.terrain.surfaces] == [s.name for s in again.terrain.surfaces]


@pytest.mark.parametrize(
    ("status", "reason", "expected"),
    [
        ("complete", "", ""),
        ("none", "contact 6 (right_foot): no contact region within 0.35 m of where it was", "no contact region"),
        ("contacts", "no posture for transition 5, transition 6", "no posture"),
        ("contacts", "the motion fails: jerk at 13.38 s: right_hip_roll, 2.957 (limit 0.36)", "the motion fails: jerk"),
        ("contacts", "verification failed: held contacts stay", "verification failed: held contacts stay"),
    ],
)
def test_reasons_are_counted_without_their_numbers(status: str, reason: str, expected: str) -> None:
    assert bench._category(DeformResult(status, reason, None, None, None, {})) == expected
