"""The table in the package's docstring says what the verifier really demands."""

from __future__ import annotations

import math
from pathlib import Path

from drakeplan import verifier
from drakeplan.verifier import verify

FROM_SCENE = {"goal"}  # limits that the scene gives


def rows() -> list[tuple[str, str, str, str]]:
    """Check, equation, limit and reason of every row; a row without a name goes on with the one before."""
    lines = [line for line in (verifier.__doc__ or "").splitlines() if line.startswith("|")]
    cells = [tuple(cell.strip() for cell in line.strip("|").split(" | ")) for line in lines[2:]]
    assert all(len(row) == 4 for row in cells)
    return [row for row in cells if row[0]]  # type: ignore[misc]


def number_and_unit(text: str) -> tuple[float, str]:
    number, _, unit = text.partition(" ")
    return (math.radians(float(number)), "rad") if unit == "deg" else (float(number), unit)


def test_every_check_of_a_complete_plan_stands_in_the_table_in_its_order(good: Path) -> None:
    assert [name for name, *_ in rows()] == [check.name for check in verify(good).checks]


def test_the_limits_in_the_table_are_those_that_are_enforced(good: Path) -> None:
    report = verify(good)
    for name, _, limit, _ in rows():
        if name in FROM_SCENE:
            continue
        check, (number, unit) = report.check(name), number_and_unit(limit)
        assert math.isclose(check.limit, number, rel_tol=1e-6), f"{name}: {check.limit} is enforced, {number} is said"
        assert check.unit == unit, name


def test_every_row_has_an_equation_and_a_reason() -> None:
    for name, equation, _, why in rows():
        assert equation, name
        assert why, name
