"""Made-up ground is imported by its module's name; inverse kinematics are made once."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest

from optimization.inverse_kinematics.whole_body_ik import WholeBodyIK
from scenes.robots.robot import load_robot

HERE = str(Path(__file__).parent)
if HERE not in sys.path:
    sys.path.insert(0, HERE)


@pytest.fixture(scope="session")
def ik() -> WholeBodyIK:
    return WholeBodyIK(load_robot("escher"))
