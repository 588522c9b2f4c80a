"""A gap in level ground that takes a long stride (Lin et al. 2019 sec. VII; Lin 2020 sec. 6.7.1)."""

from __future__ import annotations

from scenes.library.plates import GOAL_RADIUS, START, level_plate
from scenes.scene import Goal, Scene
from scenes.terrain.terrain import Terrain

GAP = 0.5  # [m]
NEAR_EDGE = 1.11  # [m]


def named(seed: int = 0, gap: float = GAP) -> Scene:
    """Level ground with a gap of 0.5 m: a foot of 0.22 m needs a stride of 0.72 m (Lin 2020 sec. 6.7.1; no draws).

    Args:
        seed: unused, nothing is drawn.
        gap: width of the gap [m]; the far platform and the goal move with it.
    """
    side = (-1.0, 0.5)
    far_edge = NEAR_EDGE + gap
    surfaces = (
        level_plate("start_platform", (-0.5, NEAR_EDGE), side),
        level_plate("goal_platform", (far_edge, far_edge + 2.22), side),
    )
    goal = Goal((far_edge + 1.51, 0.0, 0.0), GOAL_RADIUS)
    return Scene("wide_gap", Terrain(surfaces), START, goal, transition_model="long_stride")
