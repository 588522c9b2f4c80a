"""What covers a sole."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import pytest
import yaml

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


@pytest.mark.parametrize(
    ("pieces", "inside"),
    [
        ("[-1, 0.02], [0.02, 2]", True),  # a seam under both soles
        ("[-1, 0.02], [0.025, 2]", True),  # a joint of 5 mm
        ("[-1, 0.02], [0.04, 2]", True),  # a gap of 2 cm: the hull of what touches is the whole sole
        ("[-1, -0.09], [-0.09, -0.03], [-0.03, 0.05], [0.05, 0.2]", True),  # narrow tiles
        ("[-1, -0.09], [-0.09, 0.105]", False),  # the toes reach beyond the last tile
        ("[-1, 0.02], [0.02, 2, 0.002]", True),  # a step of 2 mm
        ("[-1, 0.02], [0.02, 2, -0.004]", False),  # the ground falls away by 4 mm
        ("[-1, 0.02], [0.02, 2, 0, 0.7]", True),  # more friction under the toes: the least counts
    ],
)
def test_a_sole_may_rest_on_several_surfaces_of_one_floor(
    stepping_plan: Plan, tmp_path: Path, pieces: str, inside: bool
) -> None:
    """Pieces of the ground from x to x, at a height, with a friction; the soles reach from -0.11 to 0.11."""
    lines = []
    for k, (x0, x1, z, mu) in enumerate([*piece, 0.0, 0.5][:4] for piece in yaml.safe_load(f"[{pieces}]")):
        mu = 0.7 if mu == 0.7 else 0.5
        corners = f"[[{x0}, -1, {z}], [{x1}, -1, {z}], [{x1}, 0.6, {z}], [{x0}, 0.6, {z}]]"
        lines.append(f"  - {{name: piece {k}, vertices: {corners}, friction: {mu}}}\n")
    text, table = stepping_plan.scene_yaml, stepping_plan.contacts
    ground = next(line for line in text.splitlines(keepends=True) if "name: ground" in line)
    under = next(k for k, line in enumerate(lines) if float(line.split("[[")[1].split(",")[0]) <= 0.0)
    while under + 1 < len(lines) and float(lines[under + 1].split("[[")[1].split(",")[0]) <= 0.0:
        under += 1
    feet = PlanContacts(table.X_WC[:2], table.effector[:2], table.surface[:2] * 0 + under, table.friction[:2])
    standing = dataclasses.replace(
        stepping_plan,
        scene_yaml=text.replace(ground, "".join(lines)),
        contacts=feet,
        stances=stepping_plan.stances[:1],
        phases=None,
        centroidal=None,
        motion=None,
    )
    write_plan(standing, tmp_path / "plan.h5")
    check = verify(tmp_path / "plan.h5").check("support on terrain")
    assert check.ok == inside, check
