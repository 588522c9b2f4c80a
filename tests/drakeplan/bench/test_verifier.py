"""The table of motions beside the verifier's limits."""

from __future__ import annotations

import numpy as np
import pytest

from drakeplan import verifier as package
from drakeplan.bench import verifier
from drakeplan.bench.table import BenchOptions
from drakeplan.query.options import PlanOptions
from drakeplan.query.planning import PlanResult
from drakeplan.verifier import Check, Report
from drakeplan.verifier.limits import (
    ACCELERATION,
    ANGULAR,
    ANGULAR_MEDIAN,
    ANGULAR_RMS,
    LINEAR,
    LINEAR_RMS,
    TORQUE,
    VELOCITY,
)
from scenes.robots.robot import Robot
from scenes.scene import Scene

LIMITS = (VELOCITY, ACCELERATION, LINEAR, LINEAR_RMS, ANGULAR, ANGULAR_RMS, ANGULAR_MEDIAN, TORQUE)


def planned(scene: Scene, robot: Robot, options: PlanOptions) -> PlanResult:
    """A verdict without a plan: the worst values grow with the seed; stairs come to no motion."""
    if scene.name == "stairs":
        return PlanResult("none", "no way", None, {})
    worst = 0.01 * (1 + options.seed)
    checks = [Check(name, True, worst, limit, "", "") for name, limit in zip(verifier.TARGETS, LIMITS, strict=True)]
    return PlanResult("complete", "", None, {}, Report("plan.h5", tuple(checks)))


def test_a_row_has_the_worst_of_its_seeds_and_the_limits_stand_below(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(verifier, "plan_scene", planned)
    table = verifier.run(BenchOptions(seeds=3))
    rows = {(row[0], row[1]): row[2:] for row in table.rows}
    assert rows["flat", "escher"] == (3, 3, *[0.03] * len(LIMITS))
    assert rows["stairs", "escher"][:2] == (3, 0)
    assert np.isnan(rows["stairs", "escher"][2:]).all()
    assert rows["wide_gap in one stride", "escher"][:2] == (1, 1)
    assert rows["worst", ""][2:] == (0.03,) * len(LIMITS)
    assert rows["limit", ""][2:] == LIMITS
    assert rows["target", ""][2:] == tuple(verifier.TARGETS.values())


def test_the_checks_of_the_table_are_checks_of_the_verifier() -> None:
    named = {line.strip("|").split(" | ")[0].strip() for line in (package.__doc__ or "").splitlines() if "|" in line}
    assert set(verifier.TARGETS) <= named
