"""Figures of a contact, a stance, a transition, supports and friction cones."""

from __future__ import annotations

import json

import numpy as np
from figure_plans import ROBOT, palm_stance, planned, scene_of
from figure_style import (
    AMBER,
    BLUE,
    COLOURS,
    EDGE,
    GOOD,
    INK,
    STONES,
    WIDE,
    arrow,
    draw_ground,
    draw_patch,
    from_above,
    patch_of,
    project,
    save,
)
from matplotlib import pyplot as plt
from matplotlib.lines import Line2D
from matplotlib.patches import Circle, Polygon, Rectangle

from optimization.balance.balance_regions import balance_region
from optimization.balance.friction import FrictionCone, cone_generators
from scenes.contact import contact_pose, patch_corners
from scenes.effector import EFFECTORS
from scenes.files.scene_file import scene_from_yaml
from scenes.footholds.partial_support import support_under
from scenes.stance import changed_effector
from scenes.terrain.packed_terrain import near, pack_terrain
from scenes.transition_model import transition_model

MU = 0.5


def contact() -> None:
    """A tilted stone with a sole on it, the frame C and the friction cone."""
    plan = planned("rubble_corridor")
    feet = [plan.contact(c) for c in range(len(plan.contacts)) if plan.contacts.effector[c] < 2]
    held = min(feet, key=lambda c: abs(c.R_WC[2, 2] - 0.955))
    stone = scene_of(plan).terrain.surfaces[held.surface]
    figure, axes = plt.subplots(figsize=(WIDE, 3.3))

    def seen(points: np.ndarray) -> np.ndarray:
        return project(points - held.p_WC, azimuth=-62.0, elevation=24.0)

    sole, colour = patch_of(held, ROBOT), COLOURS[held.effector]
    axes.add_patch(Polygon(seen(stone.vertices), closed=True, fc=STONES[0], ec=EDGE, lw=0.9))
    axes.add_patch(Polygon(seen(sole), closed=True, fc=colour, ec="white", alpha=0.85))
    rim = seen(held.p_WC + 0.15 * cone_generators(FrictionCone.INNER, held.friction) @ held.R_WC.T)
    for a, b in zip(rim, np.roll(rim, -1, axis=0), strict=True):
        axes.add_patch(Polygon([(0, 0), a, b], closed=True, fc=AMBER, alpha=0.13, ec=AMBER, lw=0.6, zorder=3))
    labels = (
        ("x, forward", 0.18, (5, 9), "left"),
        ("y, to the left", 0.17, (8, 2), "left"),
        ("z, along the normal", 0.24, (8, 0), "left"),
    )
    for column, (name, length, offset, side) in enumerate(labels):
        tip = seen(held.p_WC + length * held.R_WC[:, column])[0]
        arrow(axes, np.zeros(2), tip, INK)
        axes.annotate(name, tip, offset, textcoords="offset points", ha=side, va="center")
    axes.annotate(
        "friction cone", rim[np.argmin(rim[:, 0])], (-8, 4), textcoords="offset points", ha="right", color="#a87008"
    )
    low = seen(sole)[np.argmin(seen(sole)[:, 0])]
    axes.annotate("patch of the sole", low, (-120, -16), textcoords="offset points", color=colour, va="center", ha="left",
                  arrowprops={"arrowstyle": "-", "color": colour, "shrinkB": 1})  # fmt: skip
    corner = seen(stone.vertices)[np.argmin(seen(stone.vertices)[:, 1])]
    axes.text(*(0.72 * corner), "surface", color="#6c6c72", ha="center", va="center")
    axes.plot(0, 0, "o", color=INK, ms=4, zorder=7)
    axes.set(xlim=(-0.52, 0.52), ylim=(-0.25, 0.27))
    from_above(axes)
    save(figure, "contact")


def stance() -> None:
    """A stance of three contacts and where the centre of mass may rest over it."""
    plan = planned("rubble_corridor")
    scene, k = scene_of(plan), palm_stance(plan)
    now = plan.stance(k)
    figure, axes = plt.subplots(figsize=(WIDE, 3.4))
    draw_ground(axes, scene.terrain)
    for c in range(len(plan.contacts)):
        other = plan.contact(c)
        if other not in now.held:
            draw_patch(axes, other, ROBOT, held=False, zorder=2.5)
    for held in now.held:
        draw_patch(axes, held, ROBOT)
    for contacts, look, label in (
        (now.held, {"facecolor": "#1f4e9c33", "edgecolor": BLUE}, "the centre of mass can rest over this"),
        (now.held[:2], {"facecolor": "none", "edgecolor": INK, "linestyle": (0, (2, 2))}, "the same without the palm"),
    ):
        axes.add_patch(Polygon(balance_region(contacts, ROBOT), closed=True, lw=1.3, zorder=2.8, label=label, **look))
    middle = np.mean([c.p_WC[:2] for c in now.held], axis=0)
    for held in now.held[2:]:  # seen edge on
        axes.plot(*held.p_WC[:2], "s", color=COLOURS[held.effector], ms=7, mec="white", zorder=5)
    axes.set(xlim=(middle[0] - 1.1, middle[0] + 1.1), ylim=(-1.3, 0.75))
    from_above(axes)
    handles = [Rectangle((0, 0), 1, 1, color=COLOURS[c.effector], label=c.effector.replace("_", " ")) for c in now.held]
    handles += [
        axes.patches[-2],
        axes.patches[-1],
        Line2D([], [], color=EDGE, ls=(0, (3, 2)), label="held at another time"),
    ]
    axes.legend(handles=handles, loc="center left", bbox_to_anchor=(1.01, 0.5), frameon=False, handlelength=1.4)
    save(figure, "stance")


def transition() -> None:
    """The foot placements that the search tries, and two stances of a plan."""
    figure, (left, right) = plt.subplots(1, 2, figsize=(WIDE, 3.1), width_ratios=(1, 1.2), layout="constrained")
    model = transition_model()
    steps, _ = model.mirrored(left=True)
    half = ROBOT.effectors[0].half_extent
    foot = patch_corners(half)
    left.add_patch(Polygon(foot, closed=True, facecolor=COLOURS["right_foot"], edgecolor="white"))
    for x, y, yaw in steps:
        turn = np.array([[np.cos(yaw), -np.sin(yaw)], [np.sin(yaw), np.cos(yaw)]])
        left.plot(*np.array([[x, y], [x, y] + 0.05 * turn[:, 0]]).T, color=COLOURS["left_foot"], lw=0.9)
        left.plot(x, y, "o", color=COLOURS["left_foot"], ms=2.4)
    left.set(xlim=(-0.48, 0.48), ylim=(-0.2, 0.5))
    from_above(left)
    left.set_title(f"{len(steps)} placements of the left foot")
    left.annotate("standing right foot", (0.0, -half[1]), (0.0, -half[1] - 0.07), ha="center", va="top", fontsize=8.5)
    plan = planned("rubble_corridor")
    k = next(k for k in range(4, len(plan.stances) - 1) if (plan.stances[k] >= 0).sum() == 2 and (plan.stances[k, :2] >= 0).all()
             and (plan.stances[k + 1, :2] >= 0).all() and changed_effector(plan.stance(k), plan.stance(k + 1)) < 2)  # fmt: skip
    before, after = plan.stance(k), plan.stance(k + 1)
    moved = changed_effector(before, after)
    draw_ground(right, scene_of(plan).terrain, walls=False)
    old, new = before.contacts[moved], after.contacts[moved]
    assert old is not None
    assert new is not None
    for c in after.held:
        draw_patch(right, c, ROBOT)
    draw_patch(right, old, ROBOT, held=False)
    arrow(right, old.p_WC[:2], new.p_WC[:2], INK)
    assert plan.phases is not None
    middle = (old.p_WC[:2] + new.p_WC[:2]) / 2
    right.set(xlim=(middle[0] - 0.75, middle[0] + 0.75), ylim=(middle[1] - 0.55, middle[1] + 0.55))
    from_above(right)
    right.set_title(f"from stance {k} to stance {k + 1}: the {EFFECTORS[moved].replace('_', ' ')} moves")
    save(figure, "transition")


def support() -> None:
    """A sole on planks, over the edge of a step and on a small stone: what carries."""
    cases = (
        ("two planks", [(-0.13, -0.05, -0.2, 0.2), (0.02, 0.08, -0.2, 0.2)]),
        ("edge of a step", [(-0.2, 0.035, -0.2, 0.2)]),
        ("a small stone", [(-0.06, 0.07, -0.035, 0.03)]),
    )
    figure, row = plt.subplots(1, 3, figsize=(WIDE, 2.45), layout="constrained")
    for axes, (title, pieces) in zip(row, cases, strict=True):
        surfaces = [
            {"name": f"s{k}", "vertices": [[a, c, 0.0], [b, c, 0.0], [b, d, 0.0], [a, d, 0.0]]}
            for k, (a, b, c, d) in enumerate(pieces)
        ]
        scene = scene_from_yaml(
            json.dumps({"format": "drakeplan-scene", "version": 1, "name": "piece", "surfaces": surfaces}), title
        )
        draw_ground(axes, scene.terrain)
        X_WC = contact_pose("left_foot", np.zeros(3), np.array([0.0, 0.0, 1.0]), 0.0)
        half, corners, packed = ROBOT.effectors[0].half_extent, np.zeros((8, 2)), pack_terrain(scene.terrain)
        around = near(packed, -0.2, -0.2, 0.2, 0.2)
        count, area, _ = support_under(packed, 0, X_WC[:3, 3], X_WC[:3, :3], half[0], half[1], around, corners, False)
        sole = patch_corners(half)
        axes.add_patch(
            Polygon(sole, closed=True, fc="#de1a1a22", ec=COLOURS["left_foot"], lw=1.4, ls=(0, (3, 2)), zorder=2)
        )
        axes.add_patch(Polygon(corners[:count], closed=True, fc="#de1a1a99", ec=COLOURS["left_foot"], lw=1.6, zorder=3))
        axes.plot(*corners[:count].T, "o", color=INK, ms=4, zorder=4)
        axes.set(xlim=(-0.17, 0.17), ylim=(-0.115, 0.115))
        from_above(axes)
        axes.set_title(title)
        axes.text(
            0.0,
            -0.125,
            f"{1e4 * area:.0f} of {4e4 * half[0] * half[1]:.0f} cm²",
            ha="center",
            va="top",
            color="#55585f",
        )
    save(figure, "support")


def friction_cone() -> None:
    """Cross-sections of the cones, and what each says about slopes."""
    figure, (left, right) = plt.subplots(1, 2, figsize=(WIDE, 3.3), width_ratios=(1, 1.15), layout="constrained")
    left.add_patch(Circle((0, 0), MU, fc="#f0a81822", ec=AMBER, lw=2.2))
    looks = {
        FrictionCone.INNER: (BLUE, "-"),
        FrictionCone.SQUARE: (GOOD, "-"),
        FrictionCone.DIAMOND: ("#b03060", (0, (4, 2))),
    }
    for cone, (colour, line) in looks.items():
        left.add_patch(Polygon(cone_generators(cone, MU)[:, :2], closed=True, fc="none", ec=colour, lw=1.5, ls=line))
    left.set(xlim=(-0.78, 0.78), ylim=(-0.78, 0.78), aspect="equal", xlabel="$f_x / f_z$", ylabel="$f_y / f_z$")
    left.set_title(f"cross-section, friction {MU:g}")
    left.set_xticks([-0.5, 0, 0.5])
    left.set_yticks([-0.5, 0, 0.5])
    angle = np.deg2rad(np.linspace(0, 360, 721))
    for cone, (colour, line) in {FrictionCone.SECOND_ORDER: (AMBER, "-"), **looks}.items():
        reach = reach_of(cone, angle) if cone != FrictionCone.SECOND_ORDER else np.full(len(angle), MU)
        label = {"inner": "inner (default)", "second_order": "second_order: Coulomb's law"}.get(cone.value, cone.value)
        right.plot(np.rad2deg(angle), np.rad2deg(np.arctan(reach)), color=colour, ls=line, lw=1.8, label=label)
    right.set(xlim=(0, 90), ylim=(16, 40), xticks=[0, 22.5, 45, 67.5, 90], xlabel="downhill, from the foot's x axis [deg]",
              ylabel="steepest slope [deg]")  # fmt: skip
    right.xaxis.set_major_formatter("{x:g}")
    right.set_title("slope on which a foot can rest")
    right.legend(frameon=False, loc="upper center", ncols=2, fontsize=8.5)
    right.spines[["top", "right"]].set_visible(False)
    save(figure, "friction-cone")


def reach_of(cone: FrictionCone, angle: np.ndarray) -> np.ndarray:
    """(n,) distance from the axis to the edge of the cross-section, at these angles [rad]."""
    corners = cone_generators(cone, MU)[:, :2]
    along = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    edge = np.roll(corners, -1, axis=0) - corners
    normal = np.stack([edge[:, 1], -edge[:, 0]], axis=1)
    towards = along @ normal.T
    distance = np.where(towards > 1e-9, (normal * corners).sum(axis=1) / np.where(towards > 1e-9, towards, 1.0), np.inf)
    return np.asarray(distance.min(axis=1))
