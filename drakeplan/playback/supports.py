"""Shows where a sole or palm really touches while it is held: its support polygon, seen through the foot that stands on it."""

# pydrake's stubs take the first parameter of ndarray for its type, and reject every array.
# pyright: reportArgumentType=false, reportCallIssue=false

from __future__ import annotations

import numpy as np
from pydrake.geometry import Meshcat, MeshcatAnimation, Rgba

from drakeplan.plan.plan import Plan
from drakeplan.playback.contact_timeline import ContactTimeline
from drakeplan.playback.frame_times import FrameTimes
from drakeplan.playback.still import ROOT
from scenes.contact import patch_corners

SUPPORTS = f"{ROOT}/supports"
SUPPORT_COLOUR = Rgba(1.0, 0.93, 0.0)
OPACITY = 0.92  # below 1: what is transparent is drawn after all that is not, and so over the foot


def animate_supports(
    meshcat: Meshcat, animation: MeshcatAnimation, plan: Plan, timeline: ContactTimeline, frames: FrameTimes
) -> None:
    """Draws the support polygon of every contact, visible while the contact is held.

    Args:
        meshcat: to draw in.
        animation: gets the instants at which polygons appear and vanish.
        plan: whose contacts they are.
        timeline: which of them are held.
        frames: of the animation.
    """
    for contact in range(len(plan.contacts)):
        path = f"{SUPPORTS}/{contact}"
        corners = support_in_world(plan, contact)
        k = np.arange(1, len(corners) - 1)
        fan = np.stack([np.zeros_like(k), k, k + 1]).astype(np.int32)
        colour = Rgba(SUPPORT_COLOUR.r(), SUPPORT_COLOUR.g(), SUPPORT_COLOUR.b(), OPACITY)
        meshcat.SetTriangleMesh(path, corners.T, fan, colour, False, 1.0, Meshcat.SideOfFaceToRender.kDoubleSide)
        meshcat.SetProperty(f"{path}/<object>", "material.depthTest", False)  # else the foot hides it
        meshcat.SetProperty(f"{path}/<object>", "receiveShadow", False)
        keys = held_keys(timeline, contact, frames)
        meshcat.SetProperty(path, "visible", keys[0])
        for frame, held in keys.items():
            animation.SetProperty(frame, path, "visible", held)


def support_in_world(plan: Plan, contact: int) -> np.ndarray:
    """(V, 3) corners in W of what carries a contact, the whole patch where all of it does [m].

    Args:
        plan: whose contact it is.
        contact: row of the plan's table of contacts.
    """
    corners, X_WC = plan.contacts.corners(contact), plan.contacts.X_WC[contact]
    if not len(corners):
        corners = patch_corners(plan.half_extent[plan.contacts.effector[contact]])
    world: np.ndarray = corners @ X_WC[:3, :2].T + X_WC[:3, 3]
    return world


def held_keys(timeline: ContactTimeline, contact: int, frames: FrameTimes) -> dict[int, bool]:
    """Whether a contact is held, by frame: at the first, wherever that changes, and at the last, where the animation repeats.

    Args:
        timeline: of the plan, not empty.
        contact: row of the plan's table of contacts.
        frames: of the animation.
    """
    held = (timeline.contact == contact).any(axis=1)
    changes = np.flatnonzero(np.diff(held)) + 1
    keys = {int(f): bool(h) for f, h in zip(frames.at(timeline.start[changes]), held[changes], strict=True)}
    return {0: bool(held[0])} | keys | {frames.last: bool(held[-1])}
