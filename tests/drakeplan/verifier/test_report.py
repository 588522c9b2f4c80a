"""Reports, for people and for programs."""

from __future__ import annotations

import dataclasses
import json
from pathlib import Path

import numpy as np

from drakeplan.plan.plan import Plan
from drakeplan.plan.plan_file import write_plan
from drakeplan.verifier import Report, verify
from drakeplan.verifier.report import Sheet


def test_a_report_is_a_table_for_people_and_plain_data_for_programs(good: Path) -> None:
    report = verify(good)
    lines = report.table().splitlines()
    assert len(lines) == len(report.checks) + 1
    assert lines[-1] == "the plan holds"
    data = json.loads(json.dumps(report.as_dict(), allow_nan=False))
    assert data["failed"] == []
    assert {"name", "ok", "worst", "limit", "unit", "where"} == set(data["checks"][0])
    assert len({check.name for check in report.checks}) == len(report.checks)


def test_what_is_not_a_number_never_passes() -> None:
    sheet = Sheet()
    assert not sheet.add("a NaN", [0.0, np.nan, 1.0], 2.0, "m", lambda i: f"entry {i[0]}")
    assert sheet.checks[0].where == "entry 1"
    assert not sheet.add("nothing", [], 1.0, "m", "nowhere")
    assert sheet.add("nothing, rightly", [], 1.0, "m", "nowhere", empty="a single stance")
    assert Report("x", tuple(sheet.checks)).as_dict()["checks"][0]["worst"] is None
    assert not Report("x", ()).holds


def test_a_plan_without_motion_is_judged_as_far_as_it_goes_and_does_not_hold(
    stepping_plan: Plan, tmp_path: Path
) -> None:
    contacts = dataclasses.replace(stepping_plan, phases=None, centroidal=None, motion=None)
    write_plan(contacts, tmp_path / "plan.h5")
    report = verify(tmp_path / "plan.h5")
    assert report.failed == ("complete",)
    assert not report.holds
    assert report.check("patch uncovered").ok
