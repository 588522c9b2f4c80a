"""Hypothesis without deadlines (the first call of a compiled kernel takes seconds) and with the same examples each run.

Long files run first, so that at the end no worker waits for the other. The very first of them compiles the kernels of a
query, beside one that needs none.
"""

import pytest
from hypothesis import settings

settings.register_profile("repeatable", deadline=None, derandomize=True)
settings.load_profile("repeatable")

LONG = (
    "test_cli.py",
    "test_fuzz.py",
    "06_dynamic_crossings.ipynb",
    "test_dynamic_crossings.py",
    "test_nearly_level_contacts.py",
    "test_planning.py",
    "test_whole_body_ik.py",
    "test_centroidal.py",
)


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Puts the long files first; within a file the order stays."""
    order = {name: place for place, name in enumerate(LONG)}
    items.sort(key=lambda item: order.get(item.path.name, len(LONG)))
