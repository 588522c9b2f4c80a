"""What `drakeplan plan --library DIR` does with the library before and after planning."""

from __future__ import annotations

import sys
from typing import TYPE_CHECKING

from scenes.input_error import InputError

if TYPE_CHECKING:
    from drakeplan.query.result import PlanResult
    from scenes.robots.robot import Robot

ADAPTING = ("adapt", "parallel", "guided")


def open_library(folder: str, planner: str, robot: Robot) -> None:
    """Refuses a library that cannot be used; for `parallel`, which has the search beside it, a new one is begun.

    Args:
        folder: that the user named, "" for none.
        planner: that was asked for.
        robot: who plans.

    Raises:
        InputError: a library that is none, or of another robot, or not of use to this planner.
    """
    if not folder:
        return
    if planner not in ADAPTING:
        raise InputError(f"--library: goes with --planner {' or '.join(ADAPTING)}, not with --planner {planner}")
    from drakeplan.experience.library import Library

    if planner == "parallel" and not Library.is_at(folder):
        Library.create(folder, robot)
        print(f"note: a new library is begun in {folder}", file=sys.stderr)
    with Library(folder, robot) as library:
        for note in library.notes:
            print(f"note: {note}", file=sys.stderr)


def join_library(folder: str, result: PlanResult) -> dict[str, object] | None:
    """Adds a verified plan to the library that the user named, where it differs enough; what became of it.

    Args:
        folder: that the user named, "" for none.
        result: of the query.
    """
    if not folder or result.status != "complete" or result.plan is None:
        return None
    from drakeplan.experience.library import Library
    from drakeplan.experience.stored_plan import store_plan

    try:
        with Library(folder) as library:
            addition = library.add(store_plan(result.plan))
    except (
        InputError
    ) as error:  # a folder that cannot be written, or a way of a few steps: the plan is good all the same
        print(f"note: not added to the library: {error}", file=sys.stderr)
        return None
    if addition.added:
        print(f"note: added to the library {folder} as {addition.name}", file=sys.stderr)
    return {"folder": folder, "added": addition.added, "name": addition.name, "distance": addition.distance}
