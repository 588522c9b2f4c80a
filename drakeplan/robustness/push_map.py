"""A picture of the ground of a plan: the greatest push that the robot survives while it stands on each foothold.

The networks answer, not the program: a picture asks some thousand questions at every foothold.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from drakeplan.contact_planning.contact_pool import ContactPool
from drakeplan.plan.plan import Plan
from drakeplan.robustness.capture_odds import CaptureOdds
from drakeplan.robustness.capture_poses import CapturePoses
from drakeplan.robustness.moments import Moment, moments_of
from learning.capture_networks import load_capture
from scenes.contact import Contact, patch_corners
from scenes.effector import EFFECTORS, LEFT_FOOT, RIGHT_FOOT
from scenes.files.scene_file import scene_from_yaml
from scenes.robots.robot import Robot
from scenes.terrain.packed_terrain import pack_terrain

DIRECTIONS, STRENGTHS = 16, np.arange(0.05, 1.01, 0.05)  # of pushes: in the plane, and as changes of velocity [m/s]
SURVIVES = 0.5  # probability from which a push counts as survived


@dataclass(frozen=True, eq=False)
class Foothold:
    """One foothold and what the robot survives on it, while the other foot is in the air.

    Attributes:
        contact: of the foot.
        greatest: (16,) greatest change of velocity that is survived in each direction, all smaller ones too [m/s].
    """

    contact: Contact
    greatest: np.ndarray

    @property
    def weakest(self) -> float:
        """The same in the worst direction [m/s]."""
        return float(self.greatest.min())


def footholds_of(plan: Plan, robot: Robot, *, palms: bool = True) -> list[Foothold]:
    """The footholds that the plan stands on with one foot, in order, each with what is survived throughout.

    Args:
        plan: with dynamics.
        robot: of the plan.
        palms: whether palms may catch the robot.

    Raises:
        WeightsError: there are no networks of capture for this robot.
    """
    packed = pack_terrain(scene_from_yaml(plan.scene_yaml, "the plan", mesh_triangles=plan.triangles).terrain)
    pool = ContactPool(packed)
    odds = CaptureOdds(load_capture(robot), CapturePoses(packed, robot, pool, palms=palms))
    found: list[Foothold] = []
    number = -1
    for moment in moments_of(plan):
        standing = [c for c in (moment.stance.contacts[foot] for foot in (LEFT_FOOT, RIGHT_FOOT)) if c is not None]
        if len(standing) != 1:
            continue
        if not found or found[-1].contact != standing[0]:
            number = pool.add_contact(standing[0])
            found.append(Foothold(standing[0], np.full(DIRECTIONS, np.inf)))
        found[-1].greatest[:] = np.minimum(found[-1].greatest, _greatest(odds, number, moment, robot.mass))
    return found


def _greatest(odds: CaptureOdds, number: int, moment: Moment, mass: float) -> np.ndarray:
    """(16,) greatest change of velocity that is survived in each direction at one moment [m/s]."""
    angle = 2.0 * np.pi * np.arange(DIRECTIONS) / DIRECTIONS
    way = np.column_stack([np.cos(angle), np.sin(angle), np.zeros(DIRECTIONS)])
    pushed = moment.linear_momentum / mass + STRENGTHS[None, :, None] * way[:, None]
    com = np.tile(moment.com, (pushed.size // 3, 1))
    holds = odds.rejection(number, com, pushed.reshape(-1, 3)).reshape(DIRECTIONS, len(STRENGTHS)) >= SURVIVES
    until = np.where(holds.all(axis=1), len(STRENGTHS), np.argmin(holds, axis=1))
    return np.concatenate([[0.0], STRENGTHS])[until]


def draw_push_map(plan: Plan, robot: Robot, path: str | Path, *, palms: bool = True) -> None:
    """Draws the surfaces in plan view, and at each foothold a rose of the pushes that are survived.

    Args:
        plan: with dynamics.
        robot: of the plan.
        path: of the picture.
        palms: whether palms may catch the robot.
    """
    import matplotlib

    matplotlib.use("Agg")
    from matplotlib import pyplot as plt
    from matplotlib.collections import PolyCollection

    scene = scene_from_yaml(plan.scene_yaml, "the plan", mesh_triangles=plan.triangles)
    found = footholds_of(plan, robot, palms=palms)
    places = np.array([f.contact.p_WC for f in found]).reshape(-1, 3)
    low, high = scene.terrain.extent
    width, depth = np.maximum((high - low)[:2], 0.5).tolist()
    figure, axes = plt.subplots(
        figsize=(9.0, float(np.clip(9.0 * depth / width, 3.0, 9.0)) + 0.8), layout="constrained"
    )
    axes.add_collection(
        PolyCollection([s.vertices[:, :2] for s in scene.terrain.surfaces], facecolor="#e8e6e1", edgecolor="#b8b4aa")
    )
    for number, foothold in enumerate(found):
        x, y, _ = places[number]
        angle = 2.0 * np.pi * np.arange(DIRECTIONS + 1) / DIRECTIONS
        radius = 0.25 * np.append(foothold.greatest, foothold.greatest[0])
        axes.fill(x + radius * np.cos(angle), y + radius * np.sin(angle), color="#3b7dd8", alpha=0.35, lw=0)
        sole = patch_corners(robot.half_extents[EFFECTORS.index(foothold.contact.effector)])
        corners = foothold.contact.p_WC[:2] + (sole @ foothold.contact.R_WC[:2, :2].T)
        axes.fill(*corners.T, facecolor="none", edgecolor="#333", lw=0.8)
    shown = axes.scatter(
        places[:, 0], places[:, 1], c=[f.weakest for f in found], cmap="RdYlGn", vmin=0.0, vmax=0.6, s=45, zorder=3,
        edgecolor="#333",
    )  # fmt: skip
    figure.colorbar(shown, ax=axes, label="survived in the worst direction [m/s]", shrink=0.8)
    axes.set(aspect="equal", xlabel="x [m]", ylabel="y [m]")
    axes.set_title("greatest push survived on each foothold, by direction (1 m/s = 0.25 m)", fontsize=10)
    axes.autoscale_view()
    figure.savefig(path, dpi=120, format="png")
    plt.close(figure)
