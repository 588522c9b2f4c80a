"""Figures of a guiding path, of capture and of what the verifier found."""

from __future__ import annotations

import numpy as np
from figure_plans import KEPT, ROBOT, planned, scene_of
from figure_style import (
    AMBER,
    BAD,
    BLUE,
    COLOURS,
    EDGE,
    GOOD,
    INK,
    STEP,
    WALL,
    WIDE,
    arrow,
    from_above,
    patch_of,
    save,
)
from matplotlib import pyplot as plt
from matplotlib.axes import Axes
from matplotlib.lines import Line2D
from matplotlib.patches import Circle, PathPatch, Polygon
from matplotlib.path import Path as MplPath
from matplotlib.projections.polar import PolarAxes

import drakeplan
from drakeplan.bench.capture_rose import footholds, standing
from drakeplan.playback.guide_path import guide_of
from optimization.capture.checker import CaptureChecker, capture_options
from optimization.capture.inverted_pendulum import capture_point
from optimization.capture.question import CaptureQuestion
from scenes.contact import Contact


def segment() -> None:
    """A guiding path between two rooms, cut into segments, and the footsteps along it."""
    plan = planned("two_staircases", "guided")
    scene, path = scene_of(plan), guide_of(plan)
    figure, axes = plt.subplots(figsize=(WIDE, 3.7))
    way = np.concatenate([part.way for part in path])
    low, high = way[:, :2].min(axis=0) - np.array([0.7, 0.9]), way[:, :2].max(axis=0) + np.array([0.7, 0.9])
    seen = [
        s
        for s in scene.terrain.surfaces
        if (s.vertices[:, :2] > low).any(axis=0).all() and (s.vertices[:, :2] < high).any(axis=0).all()
    ]
    for steep, fill, edge in ((False, "#e8e4dc", "#bdb8ac"), (True, WALL, EDGE)):  # one outline of many: a small file
        outlines = [MplPath(s.vertices[:, :2], closed=False) for s in seen if (abs(s.normal[2]) < 0.5) == steep]
        axes.add_patch(PathPatch(MplPath.make_compound_path(*outlines), fc=fill, ec=edge, lw=0.4))
    for c in range(len(plan.contacts)):
        held = plan.contact(c)
        axes.add_patch(
            Polygon(
                patch_of(held, ROBOT)[:, :2], closed=True, fc=COLOURS[held.effector], ec="none", alpha=0.75, zorder=3
            )
        )
        if held.effector.endswith("palm"):
            axes.plot(*held.p_WC[:2], "s", color=COLOURS[held.effector], ms=6, mec="white", zorder=4)
    modes = {"feet": (BLUE, "feet"), "left_palm": (COLOURS["left_palm"], "feet, left palm"), "any": ("#777", "any palms"),
             "right_palm": (COLOURS["right_palm"], "feet, right palm"), "all": ("#7d3cb5", "feet, both palms")}  # fmt: skip
    for part in path:
        axes.plot(
            *part.way[:, :2].T, color=modes[part.mode][0], lw=6 if part.method == "adapt" else 2.4, zorder=2, alpha=0.8
        )
        axes.plot(*part.way[0, :2], "o", color="white", mec=INK, ms=5, zorder=5)
    assert scene.goal is not None
    axes.add_patch(Circle(scene.goal.xyz[:2], scene.goal.radius, fc="none", ec=AMBER, lw=1.8, zorder=4))
    axes.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]))
    from_above(axes)
    handles = [
        Line2D([], [], color=modes[m][0], lw=2.4, label=modes[m][1]) for m in dict.fromkeys(part.mode for part in path)
    ]
    handles += [
        Line2D([], [], color="#555", lw=6, label="thick: adapted from a stored plan"),
        Line2D([], [], color=INK, marker="o", mfc="white", ls="", label="a segment begins"),
        Line2D([], [], color=AMBER, marker="o", mfc="none", ms=9, mew=1.6, ls="", label="goal"),
    ]
    axes.legend(
        handles=handles, loc="upper center", bbox_to_anchor=(0.5, 0.0), ncols=4, frameon=False, columnspacing=1.4
    )
    save(figure, "segment")


def capture() -> None:
    """A push and the step that catches it; which pushes a standing robot takes."""
    figure = plt.figure(figsize=(WIDE, 3.6), layout="constrained")
    grid = figure.add_gridspec(1, 2, width_ratios=(1.2, 1))
    checker, base = CaptureChecker(ROBOT, capture_options(ROBOT)), standing(ROBOT)
    impulse = np.array([8.0, 38.0, 0.0])
    pushed = base.pushed(impulse)
    steps = [
        CaptureQuestion(pushed.stance, pushed.com, pushed.linear_momentum, new_contact=f)
        for f in footholds(pushed, ROBOT)
    ]
    caught = next(step.new_contact for step in steps if checker.check(step).captured)
    draw_push(figure.add_subplot(grid[0]), base, impulse, caught)
    axes = figure.add_subplot(grid[1], projection="polar")
    angles, sizes = 2 * np.pi * np.arange(16) / 16, np.arange(15.0, 80.0, 12.0)
    kinds = [(GOOD, "o", "stands"), (STEP, "s", "one step"), (BAD, "x", "no capture found")]
    found = [
        (a, s, verdict(checker, base.pushed(s * np.array([np.cos(a), np.sin(a), 0.0])))) for a in angles for s in sizes
    ]
    for kind, (colour, marker, label) in enumerate(kinds):
        points = np.array([(a, s) for a, s, v in found if v == kind]).reshape(-1, 2)
        axes.plot(*points.T, marker, color=colour, ms=4.4, mew=1.1, label=label, zorder=3, clip_on=False)
    assert isinstance(axes, PolarAxes)
    axes.set_theta_zero_location("N")
    axes.set_rlim(0, 80)
    axes.set_rgrids([20, 40, 60, 80], ["", "40", "60", "80"], angle=169)
    axes.set_xticks(np.deg2rad([0, 90, 180, 270]), ["ahead", "left", "back", "right"])
    axes.tick_params(pad=1)
    axes.set_title("pushes on the standing robot [kg m/s]")
    axes.legend(
        frameon=False, loc="upper center", bbox_to_anchor=(0.5, -0.08), ncols=3, handletextpad=0.2, columnspacing=1.0
    )
    save(figure, "capture")


def draw_push(axes: Axes, base: CaptureQuestion, impulse: np.ndarray, caught: Contact | None) -> None:
    """From above, ahead is up: the feet, the push, the capture point, the step."""
    assert caught is not None
    flip = np.array([[0.0, -1.0], [1.0, 0.0]])  # x up, y to the left
    for held in base.stance.held:
        moves = held.effector == caught.effector
        corners = patch_of(held, ROBOT)[:, :2] @ flip.T
        look = (
            {"fc": "none", "ec": COLOURS[held.effector], "ls": (0, (3, 2))}
            if moves
            else {"fc": COLOURS[held.effector], "ec": "white"}
        )
        axes.add_patch(Polygon(corners, closed=True, lw=1.2, **look))
    axes.add_patch(
        Polygon(patch_of(caught, ROBOT)[:, :2] @ flip.T, closed=True, fc=COLOURS[caught.effector], ec="white", lw=1.2)
    )
    com = flip @ base.com[:2]
    point = flip @ capture_point(base.com, impulse / ROBOT.mass)
    arrow(axes, com, com + 0.006 * flip @ impulse[:2], INK, 2.0)
    axes.plot(*com, "o", color=INK, ms=6)
    axes.plot(*point, "X", color=BLUE, ms=9, mec="white", zorder=7)
    line = {"arrowstyle": "-", "color": INK, "lw": 0.8, "shrinkB": 3}
    axes.annotate("centre of mass", (com[0], com[1]), (com[0] + 0.02, -0.19), ha="center", va="top", arrowprops=line)
    axes.text(com[0] - 0.03, com[1] + 0.045, "push", ha="center", va="bottom", fontweight="bold")
    axes.text(point[0], point[1] - 0.03, "capture\npoint", ha="center", va="top", color=BLUE)
    step = flip @ caught.p_WC[:2]
    axes.text(step[0], step[1] - 0.13, "new contact", ha="center", va="top", color=COLOURS[caught.effector])
    axes.set(xlim=(-0.46, 0.2), ylim=(-0.24, 0.2))
    from_above(axes)
    axes.set_title("a push to the left, caught by a step")


def verdict(checker: CaptureChecker, pushed: CaptureQuestion) -> int:
    """0 the robot stands, 1 a step catches it, 2 neither was found."""
    if checker.check(pushed).captured:
        return 0
    steps = (
        CaptureQuestion(pushed.stance, pushed.com, pushed.linear_momentum, new_contact=f)
        for f in footholds(pushed, ROBOT)
    )
    return 1 if any(checker.check(step).captured for step in steps) else 2


def verifier() -> None:
    """Worst value over limit of the verifier's checks that have room, for one plan."""
    planned("rubble_corridor")
    report = drakeplan.verify(KEPT / "rubble_corridor.h5")
    measured = [c for c in report.checks if c.limit > 0 and c.worst > 1e-3 * c.limit and not c.name.endswith("spacing")]
    shares = {c.name: c.worst / c.limit for c in measured}
    names = sorted(shares, key=lambda n: shares[n])
    figure, axes = plt.subplots(figsize=(WIDE, 0.2 * len(names) + 0.7))
    axes.barh(
        names, [100 * shares[n] for n in names], color=[GOOD if shares[n] < 0.8 else STEP for n in names], height=0.62
    )
    axes.axvline(100, color="#b02020", lw=1.2)
    axes.text(100, len(names) - 0.3, "limit", color="#b02020", ha="right", va="bottom")
    axes.set(xlim=(0, 104), xlabel="worst value of the plan, in percent of the limit")
    axes.margins(y=0.01)
    axes.tick_params(length=0)
    axes.spines[["top", "right", "left"]].set_visible(False)
    save(figure, "verifier")
