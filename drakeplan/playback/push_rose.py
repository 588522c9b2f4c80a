"""Shows what pushes do to a plan while it plays: an arrow for each impulse at the CoM, in the colour of what comes of it.

Where a new contact catches the robot, a ball shows it. The time bar is coloured by the share of pushes that fell the robot.
"""

# pydrake's stubs take the first parameter of ndarray for its type, and reject every array.
# pyright: reportArgumentType=false, reportCallIssue=false

from __future__ import annotations

import numpy as np
from pydrake.geometry import Meshcat, MeshcatAnimation, Rgba, Sphere
from pydrake.math import RigidTransform

from drakeplan.plan.plan import Plan, PlanRobustness
from drakeplan.playback.pushes import draw_arrow
from drakeplan.playback.still import ROOT

PUSHES = f"{ROOT}/tried_pushes"
FALLS_COLOUR, STANDS_COLOUR, CATCHES_COLOUR = Rgba(0.84, 0.15, 0.12), Rgba(0.13, 0.62, 0.28), Rgba(0.05, 0.55, 0.85)
OUTCOMES = (("falls", FALLS_COLOUR), ("stands", STANDS_COLOUR), ("caught", CATCHES_COLOUR))  # by `captured`
MOST = 12  # impulses that are drawn; of more, those that fell the robot most
BALL = 0.05  # [m]


def animate_pushes(meshcat: Meshcat, animation: MeshcatAnimation, plan: Plan, rate: float, last: int) -> None:
    """Draws the pushes that were tried on a plan; nothing where none were.

    Args:
        meshcat: to draw in.
        animation: gets the instants at which arrows change.
        plan: with its momenta.
        rate: frames of the animation a second.
        last: number of its last frame.
    """
    found = plan.robustness
    if found is None or plan.centroidal is None or not len(found.t):
        return
    frames = np.round((found.t - plan.centroidal.t[0]) * rate).astype(int).clip(0, last)
    com = np.column_stack([np.interp(found.t, plan.centroidal.t, column) for column in plan.centroidal.com.T])
    fell = np.where(found.captured == 0, found.probability, 0.0).sum(axis=0)
    for d in np.argsort(-fell, kind="stable")[:MOST].tolist():
        path = f"{PUSHES}/{d}"
        for outcome, (name, colour) in enumerate(OUTCOMES):
            draw_arrow(meshcat, f"{path}/{name}", np.zeros(3), found.impulse[d], colour)
            shown = found.captured[:, d] == outcome
            _toggle(meshcat, animation, f"{path}/{name}", shown, frames, last)
        meshcat.SetTransform(path, RigidTransform(com[0]))
        for frame, place in zip(frames.tolist(), com, strict=True):
            animation.SetTransform(frame, path, RigidTransform(place))
        _animate_contact(meshcat, animation, found, d, frames, last)


def _animate_contact(
    meshcat: Meshcat, animation: MeshcatAnimation, found: PlanRobustness, d: int, frames: np.ndarray, last: int
) -> None:
    """A ball where a new contact catches the robot after impulse d."""
    caught = found.captured[:, d] == 2
    if not caught.any():
        return
    path = f"{PUSHES}/contact_{d}"
    meshcat.SetObject(path, Sphere(BALL), CATCHES_COLOUR)
    _toggle(meshcat, animation, path, caught, frames, last)
    until = np.append(frames[1:], last)
    for n in np.flatnonzero(caught).tolist():
        pose = RigidTransform(found.capture_point[n, d])
        animation.SetTransform(int(frames[n]), path, pose)
        animation.SetTransform(max(int(until[n]) - 1, int(frames[n])), path, pose)  # it jumps, and does not glide


def _toggle(
    meshcat: Meshcat, animation: MeshcatAnimation, path: str, shown: np.ndarray, frames: np.ndarray, last: int
) -> None:
    """Visible at the moments at which (R,) says so."""
    meshcat.SetProperty(path, "visible", bool(shown[0]))
    for n in [0, *(np.flatnonzero(np.diff(shown)) + 1).tolist()]:
        animation.SetProperty(int(frames[n]), path, "visible", bool(shown[n]))
    animation.SetProperty(last, path, "visible", bool(shown[-1]))


def risk_bar(plan: Plan) -> str:
    """CSS gradient along the time bar: from green, where every push is survived, to red, where none is; "" where none was tried."""
    found = plan.robustness
    if found is None or not len(found.t) or not plan.duration:
        return ""
    tried = np.where(found.captured >= 0, found.probability, 0.0).sum(axis=1)
    fell = np.where(found.captured == 0, found.probability, 0.0).sum(axis=1)
    share = np.where(tried > 0, fell / np.maximum(tried, 1e-12), 0.0)
    step = float(found.t[1] - found.t[0]) if len(found.t) > 1 else plan.duration
    start = plan.motion.t[0] if plan.motion is not None else 0.0
    stops = []
    for t, s in zip((found.t - start).tolist(), share.tolist(), strict=True):
        ends = 100.0 * t / plan.duration, 100.0 * min((t + step) / plan.duration, 1.0)
        stops.append(f"hsl({120.0 * (1.0 - s):.0f} 75% 42%) {ends[0]:.2f}% {ends[1]:.2f}%")
    return f"linear-gradient(to right, {', '.join(stops)})"
