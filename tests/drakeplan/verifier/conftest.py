"""A plan file that holds."""

from __future__ import annotations

from pathlib import Path

import pytest

from drakeplan.plan.plan import Plan
from drakeplan.plan.plan_file import write_plan


@pytest.fixture(scope="session")
def good(stepping_plan: Plan, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The file of `stepping_plan`; tests corrupt copies of it."""
    path = tmp_path_factory.mktemp("plans") / "good.h5"
    write_plan(stepping_plan, path)
    return path
