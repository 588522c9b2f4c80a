"""Contact sequences as users give them: read, checked step by step, and held against the terrain by the verifier."""

from __future__ import annotations

import dataclasses
import itertools
import re
from collections.abc import Mapping, Sequence

import numpy as np

from drakeplan.contact_planning.contact_domain import is_at_goal
from drakeplan.contact_planning.sequence_check import feet_heading
from drakeplan.context import QueryContext
from drakeplan.motion.assembly import assemble_plan
from drakeplan.plan.plan import tabulate_stances
from drakeplan.plan.verified import verify_plan
from drakeplan.verifier import UnreadablePlan
from scenes.contact import Contact, contact_heading
from scenes.effector import EFFECTORS, is_foot
from scenes.input_error import InputError, unknown_name
from scenes.scene import Goal, Scene, Start
from scenes.stance import Stance

GIVEN = "given"  # what the record and the provenance call the planner of such sequences
GOAL_RADIUS = 0.2  # [m] of the goal where the scene has none


def given_stances(stances: Sequence[Stance | Mapping[str, Contact]], friction: float | None) -> tuple[Stance, ...]:
    """The stances with the headings of their frames, one end effector changing at a time.

    Args:
        stances: two or more; see `drakeplan.query.given_contacts.plan_motion`.
        friction: replaces that of every contact; None: it stays.

    Raises:
        InputError: no such end effectors, or consecutive stances that differ in none or in more than one of them.
    """
    found = [_stance(k, given, friction) for k, given in enumerate(stances)]
    if len(found) < 2:
        raise InputError(f"plan_motion: stances: expected two or more, got {len(found)}")
    for k, (before, after) in enumerate(itertools.pairwise(found)):
        changed = [e for e, a, b in zip(EFFECTORS, before.contacts, after.contacts, strict=True) if a != b]
        if not changed:
            raise InputError(f"plan_motion: stances {k} and {k + 1} are the same: leave one out")
        if len(changed) > 1:
            raise InputError(
                f"plan_motion: stances {k} and {k + 1} differ in {' and '.join(changed)}: expected one end effector that "
                "makes, moves or breaks its contact"
            )
    for k, name in ((0, "first"), (-1, "last")):
        if not any(found[k].contacts[:2]):
            raise InputError(f"plan_motion: stances: no foot is held in the {name} one")
    return tuple(found)


def _stance(k: int, given: Stance | Mapping[str, Contact], friction: float | None) -> Stance:
    if isinstance(given, Stance):
        contacts = {c.effector: c for c in given.held}
    elif isinstance(given, Mapping):
        contacts = {name: c for name, c in given.items() if c is not None}
    else:
        raise InputError(f"plan_motion: stances[{k}]: expected a Stance or a dict, got {type(given).__name__}")
    for name, contact in contacts.items():
        if name not in EFFECTORS:
            raise unknown_name("end effector", name, EFFECTORS)
        if not isinstance(contact, Contact):
            raise InputError(
                f"plan_motion: stances[{k}][{name!r}]: expected a Contact (make_contact), got {type(contact).__name__}"
            )
        if contact.effector != name:
            raise InputError(f"plan_motion: stances[{k}][{name!r}]: holds a contact of {contact.effector}")
    return Stance(tuple(None if c is None else _plain(c, friction) for c in map(contacts.get, EFFECTORS)))


def _plain(contact: Contact, friction: float | None) -> Contact:
    """The contact with the heading that its frame has, and this friction if any."""
    heading = contact_heading(contact.X_WC) if is_foot(contact.effector) else contact.heading
    return dataclasses.replace(contact, heading=heading, friction=contact.friction if friction is None else friction)


def from_first_to_last(scene: Scene, stances: Sequence[Stance], notes: list[str]) -> Scene:
    """The scene with the start and the goal that the sequence has; its own goal is kept where the sequence ends there.

    Args:
        scene: with the terrain.
        stances: the sequence.
        notes: gets a line where the goal is another one.
    """
    first, last = stances[0].feet_mean(), stances[-1].feet_mean()
    x, y, z = first.tolist()
    start = Start((x, y, z), feet_heading(stances[0]))
    goal, (x, y, z) = scene.goal, last.tolist()
    if goal is None or not is_at_goal(goal, last, feet_heading(stances[-1])):
        if goal is not None:
            notes.append(f"the contacts end at x {x:.2f}, y {y:.2f}, not at the scene's goal; that is the plan's goal")
        goal = Goal((x, y, z), GOAL_RADIUS if goal is None else goal.radius)
    elif not np.isfinite(goal.xyz[2]):
        goal = dataclasses.replace(goal, xyz=(*goal.xyz[:2], z))
    return dataclasses.replace(scene, start=start, goal=goal)


def require_on_terrain(context: QueryContext, stances: Sequence[Stance]) -> None:
    """Raises InputError with the first thing that the verifier has against the contacts alone.

    Args:
        context: scene and robot.
        stances: the sequence.
    """
    plan = assemble_plan(context.scene, context.robot, stances, None, cone=context.cone, provenance={"planner": GIVEN})
    try:
        report = verify_plan(plan)
    except UnreadablePlan as error:
        raise InputError(f"plan_motion: {error}") from None
    wrong = next((check for check in report.checks if not check.ok and check.name != "complete"), None)
    if wrong is None:
        return
    number = re.match(r"contact (\d+)", wrong.where)
    _, table = tabulate_stances(stances)
    rows = [] if number is None else np.flatnonzero((table == int(number[1])).any(axis=1)).tolist()
    where = f"stance {rows[0]}: {wrong.where}" if rows else wrong.where
    raise InputError(
        f"plan_motion: {where}: {wrong.name}: {wrong.worst:.3g} {wrong.unit}, expected at most {wrong.limit:g}; "
        "make_contact sets a patch on the terrain"
    )
