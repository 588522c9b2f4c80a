"""Whether stances change one contact at a time, and phases follow them."""

from __future__ import annotations

import itertools

import numpy as np

from .limits import (
    EFFECTORS,
    SAME_TIME,
)
from .plan_file import PlanFile
from .report import Sheet


def check_stances(sheet: Sheet, plan: PlanFile) -> None:
    """Contacts of the stances, and what changes from one to the next.

    Args:
        sheet: takes the checks.
        plan: the plan file.
    """
    stances = plan["stances/contact"]
    sheet.add("stance effectors", _wrong_effector(plan, stances), 0, "", lambda i: f"stance {i[0]}, {EFFECTORS[i[1]]}")
    changes = np.abs((stances[1:] != stances[:-1]).sum(axis=1) - 1)
    sheet.add("one change a stance", changes, 0, "", lambda i: f"stance {i[0]} to {i[0] + 1}", empty="a single stance")
    sheet.add("stance holds", (stances < 0).all(axis=1), 0, "", lambda i: f"stance {i[0]} holds nothing")


def _wrong_effector(plan: PlanFile, table: np.ndarray) -> np.ndarray:
    """Where a table (..., 4) of contacts names one that belongs to another end effector."""
    return (table >= 0) & (plan["contacts/effector"][np.maximum(table, 0)] != np.arange(4))


def check_phases(sheet: Sheet, plan: PlanFile) -> None:
    """Times of the phases, and their contacts against those of stances and forces.

    Args:
        sheet: takes the checks.
        plan: the plan file.
    """
    start, end, contact = plan["phases/start"], plan["phases/end"], plan["phases/contact"]
    sheet.add(
        "phases contiguous",
        np.abs(start[1:] - end[:-1]),
        SAME_TIME,
        "s",
        lambda i: f"after phase {i[0]}",
        empty="one phase",
    )
    span = {name: plan[name][[0, -1]] - [start[0], end[-1]] for name in ("centroidal/t", "motion/t")}
    sheet.add("one time span", np.abs(list(span.values())), SAME_TIME, "s", lambda i: list(span)[i[0]])
    sheet.add("phase effectors", _wrong_effector(plan, contact), 0, "", lambda i: f"phase {i[0]}, {EFFECTORS[i[1]]}")
    sheet.add("phase holds", (contact < 0).all(axis=1), 0, "", lambda i: f"phase {i[0]} holds nothing")
    # From one stance to the next the contacts that both hold stay; the moving one carries nothing in between.
    stances = plan["stances/contact"]
    expected = [stances[0]]
    for before, after in itertools.pairwise(stances):
        expected += [np.where(before == after, before, -1), after]
    wanted, _ = _merged(expected)
    got, first = _merged(list(contact))
    differ = [a != b for a, b in zip(wanted, got, strict=False)] + [True] * abs(len(wanted) - len(got))

    def where(index: tuple[int, ...]) -> str:
        return f"phase {first[index[0]]}" if index[0] < len(first) else "phases end too early"

    sheet.add("phases follow stances", differ, 0, "", where)
    t = plan["centroidal/t"]
    phase = np.clip(np.searchsorted(start, t[:-1] + SAME_TIME, side="right") - 1, 0, len(start) - 1)
    crosses = (t[1:] > end[phase] + SAME_TIME) | (t[:-1] < start[phase] - SAME_TIME)
    disagree = (plan["centroidal/contact"][:-1] != contact[phase]).any(axis=1) | crosses
    sheet.add("phases agree with forces", disagree, 0, "", lambda i: f"knot {i[0]}, t = {t[i[0]]:.3f} s")


def _merged(rows: list[np.ndarray]) -> tuple[list[tuple[int, ...]], list[int]]:
    """Rows without immediate repetitions, and the index of the first of each."""
    merged, first = [], []
    for k, row in enumerate(rows):
        if not merged or merged[-1] != tuple(row):
            merged.append(tuple(row))
            first.append(k)
    return merged, first
