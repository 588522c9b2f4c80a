"""What covers a sole."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import pytest

from drakeplan.plan.plan import Plan, PlanContacts
from drakeplan.plan.plan_file import write_plan
from drakeplan.verifier import verify


@pytest.mark.parametrize(
    ("x", "z", "covers"),
    [
        (0.110, 0.1, False),  # a step up that touches the sole's edge
        (0.108, 0.1, False),  # 2 mm under the sole's edge: rounding
        (0.100, 0.1, True),  # 1 cm into the sole
        (0.100, 0.002, False),  # a plate 2 mm higher
        (0.100, 0.006, True),  # a plate 6 mm higher
        (0.100, -0.01, False),  # a plate under the sole
        (-1.0, 0.05, True),  # a shelf that a foot does not fit under
        (-1.0, 0.5, False),  # a table
    ],
)
def test_a_neighbour_covers_a_sole_when_it_stands_in_it(
    stepping_plan: Plan, tmp_path: Path, x: float, z: float, covers: bool
) -> None:
    """A plate from x on, at height z, and the riser under it; the soles end at x = 0.11."""
    added = (
        f"  - {{name: step, vertices: [[{x}, -0.5, {z}], [1, -0.5, {z}], [1, 0, {z}], [{x}, 0, {z}]]}}\n"
        f"  - {{name: riser, vertices: [[{x}, 0, -1], [{x}, 0, {z}], [{x}, -0.5, {z}], [{x}, -0.5, -1]]}}\n"
    )
    table = stepping_plan.contacts
    feet = PlanContacts(table.X_WC[:2], table.effector[:2], table.surface[:2], table.friction[:2])
    text = stepping_plan.scene_yaml.replace("obstacles:", f"{added}obstacles:")
    standing = dataclasses.replace(
        stepping_plan,
        scene_yaml=text,
        contacts=feet,
        stances=stepping_plan.stances[:1],
        phases=None,
        centroidal=None,
        motion=None,
    )
    write_plan(standing, tmp_path / "plan.h5")
    check = verify(tmp_path / "plan.h5").check("patch uncovered")
    assert check.ok != covers, check
