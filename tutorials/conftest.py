"""Tutorials that train need torch, so they run with `make test-train` rather than `make test`."""

from __future__ import annotations

import pytest

NEED_TORCH = {"05_learn_the_dynamics.ipynb"}


def pytest_itemcollected(item: pytest.Item) -> None:
    """Marks them `train`."""
    if item.path.name in NEED_TORCH:
        item.add_marker("train")
