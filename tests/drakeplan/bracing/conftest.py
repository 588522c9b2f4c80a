"""What the tests of the braced robot share is imported by its module's name; its model is read once."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest

from drakeplan.bracing.bracer import Bracer

HERE = str(Path(__file__).parent)
if HERE not in sys.path:
    sys.path.insert(0, HERE)


@pytest.fixture(scope="session")
def bracer() -> Bracer:
    return Bracer()
