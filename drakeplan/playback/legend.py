"""The words of a page: what its heading says, and which colour means what."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from drakeplan.plan.plan import Plan
from drakeplan.playback.contact_timeline import has_motion
from drakeplan.playback.guide_path import MODE_COLOURS, guide_of
from drakeplan.playback.push_rose import OUTCOMES
from drakeplan.playback.pushes import PUSH_COLOUR
from drakeplan.playback.share_colours import gradient
from drakeplan.playback.still import COM_COLOUR, EFFECTOR_COLOURS, GOAL_COLOUR, PREDICTED_COLOUR, predicted_com
from drakeplan.playback.supports import SUPPORT_COLOUR
from scenes.disturbance import PERIOD
from scenes.scene import Scene


@dataclass(frozen=True)
class Entry:
    """A line of a legend.

    Attributes:
        fill: CSS background.
        text: what it means.
        until: "" for a colour; for a scale from 0 on, its other end.
    """

    fill: str
    text: str
    until: str = ""


@dataclass(frozen=True)
class Legend:
    """The heading, in pieces, and the entries below it."""

    heading: Sequence[str]
    entries: Sequence[Entry]


def plan_legend(plan: Plan, scene: Scene, name: str = "") -> Legend:
    """What the page of a plan says.

    Args:
        plan: whose page it is.
        scene: the plan's.
        name: what to call the plan, where several are on one page.
    """
    counts = [int((plan.contacts.effector == e).sum()) for e in range(len(plan.effectors))]
    shown = [
        Entry(_css(EFFECTOR_COLOURS[effector]), f"{effector.replace('_', ' ')} ({count})")
        for effector, count in zip(plan.effectors, counts, strict=True)
        if count
    ]
    if has_motion(plan):
        shown += [
            Entry(_css(COM_COLOUR), "centre of mass"),
            Entry(gradient(), "contact force, friction used 0", "100 %"),
        ]
    if len(plan.stances):
        shown.append(Entry(_css(SUPPORT_COLOUR), "what carries a foot or palm"))
    if predicted_com(plan) is not None:
        shown.append(Entry(_css(PREDICTED_COLOUR), "centre of mass as the search predicted it"))
    guide = {segment.words: _css(MODE_COLOURS[segment.mode]) for segment in guide_of(plan)}
    shown += [Entry(colour, words) for words, colour in guide.items()]
    if plan.robustness is not None:
        shown += [Entry(_css(colour), f"push: {outcome}") for outcome, colour in OUTCOMES]
    facts = _count(len(plan.stances), "stance")
    facts += f", {plan.duration:.1f} s" if has_motion(plan) else ", contacts only: no motion was found"
    if plan.robustness is not None:
        facts += f", {100 * plan.robustness.p_success:.1f} % likely to arrive under pushes"
    heading = [*([name] if name else []), plan.scene_name, plan.robot, facts]
    return Legend(heading, [*shown, *_of_scene(scene)])


def scene_legend(scene: Scene) -> Legend:
    """What the page of a scene without a plan says."""
    return Legend([scene.name, _count(len(scene.terrain.surfaces), "surface")], _of_scene(scene))


def _count(number: int, thing: str) -> str:
    return f"{number} {thing}" + ("s" if number != 1 else "")


def _of_scene(scene: Scene) -> list[Entry]:
    """The entries that a scene brings."""
    shown = [Entry(_css(GOAL_COLOUR), "goal")] if scene.goal is not None else []
    if scene.disturbances:
        count = sum(len(d.impulses) for d in scene.disturbances)
        likely = ", ".join(f"{100 * d.probability:.3g} %" for d in scene.disturbances[:4])
        more = ", ..." if len(scene.disturbances) > 4 else ""
        shown.append(Entry(_css(PUSH_COLOUR), f"pushes ({count}), {likely}{more} in {PERIOD} s"))
    return shown


def _css(colour: object) -> str:
    r, g, b = (round(255 * getattr(colour, key)()) for key in "rgb")
    return f"rgb({r},{g},{b})"
