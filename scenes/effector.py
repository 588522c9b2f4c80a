"""The four end effectors, in the one order that arrays use."""

from __future__ import annotations

EFFECTORS = ("left_foot", "right_foot", "left_palm", "right_palm")
FEET, PALMS = EFFECTORS[:2], EFFECTORS[2:]
LEFT_FOOT, RIGHT_FOOT, LEFT_PALM, RIGHT_PALM = range(4)


def is_foot(effector: str) -> bool:
    """Whether the end effector of this name is a foot."""
    return effector.endswith("_foot")
