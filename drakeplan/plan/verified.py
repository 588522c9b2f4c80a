"""Verifies a plan in memory: the verifier reads files, so the plan is written first."""

from __future__ import annotations

import tempfile
from pathlib import Path

from drakeplan.plan.plan import Plan
from drakeplan.plan.plan_file import write_plan
from drakeplan.verifier import Report, verify


def verify_plan(plan: Plan) -> Report:
    """The verifier's report on the file that this plan would be written to."""
    with tempfile.TemporaryDirectory(prefix="drakeplan-") as folder:
        path = Path(folder) / "plan.h5"
        write_plan(plan, path)
        return verify(path)
