"""A few steps that turn the robot on the spot: stored plans begin straight ahead, ways have corners (Lin 2020 sec. 5.9)."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from drakeplan.contact_planning.contact_plan import PlannerOptions
from drakeplan.contact_planning.search_planner import SearchPlanner
from drakeplan.contact_planning.sequence_check import feet_heading, wrap
from drakeplan.context import QueryContext
from drakeplan.search.ana_star import Limits
from scenes.scene import Goal
from scenes.stance import Stance

SHARP = np.deg2rad(30.0)  # turns up to this are left to the plan's own steps
NEAR = 0.4  # [m] that the feet may walk meanwhile
BUDGET = 300  # nodes expanded at most


def turn_towards(context: QueryContext, stances: tuple[Stance, ...], place: np.ndarray) -> tuple[Stance, ...]:
    """The stances, and where the way ahead bends those that let palms go and turn the feet; as they were where none are found.

    Args:
        context: of the query.
        stances: so far.
        place: (3,) that the feet shall be turned to [m].
    """
    last = stances[-1]
    ahead = place[:2] - last.feet_mean()[:2]
    heading = float(np.arctan2(ahead[1], ahead[0]))
    if abs(wrap(heading - feet_heading(last))) <= SHARP:
        return stances
    for e in (2, 3):
        if last.contacts[e] is not None:
            last = last.replace(e, None)
            stances = (*stances, last)
    x, y, z = last.feet_mean().tolist()
    made: dict[str, object] = {"packed": context.packed, "start": last, "goal": Goal((x, y, z), NEAR, heading)}
    options = PlannerOptions(dynamics="quasi-static", heuristic="euclidean", use_palms=False)
    planner = SearchPlanner(replace(context, made=made), options)
    found = next(iter(planner.plans(Limits(expansions=BUDGET, improve=0.0))), None)
    return stances if found is None else (*stances, *found.stances[1:])
