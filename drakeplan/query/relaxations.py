"""The ladder of relaxations: the query with one thing made easier, each of which may open a way that was closed.

Every rung is the query's scene for feet alone and quasi-static dynamics, which is quick to search, with one change. The
first rung has none: what it opens was closed by palms or dynamics, and what a later rung opens only by that rung's change.
"""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from typing import Literal

import numpy as np

from drakeplan.contact_planning.contact_plan import PlannerOptions
from drakeplan.context import QueryContext
from scenes.effector import FEET
from scenes.terrain.terrain import Terrain
from scenes.transition_model import transition_model

Kind = Literal["search", "friction", "stride", "sole", "collision"]
LONGER = ("long_stride", "leap_stride")
ENOUGH_FRICTION = 1.5  # holds on every surface for feet, which end at 45 deg, under every friction cone
SMALLER_SOLE = 0.4  # of the real one
MOST_SURFACES = 2_000  # of a terrain that is prepared anew; more take longer than a rung has


@dataclass(frozen=True, eq=False)
class Relaxation:
    """One rung.

    Attributes:
        kind: of what it makes easier.
        change: in words that follow "with".
        remedy: what the user can do, "" where the words of the obstacle say it.
        context: of the easier query.
        options: of its search.
    """

    kind: Kind
    change: str
    remedy: str
    context: QueryContext
    options: PlannerOptions


def relaxations(context: QueryContext, options: PlannerOptions) -> list[Relaxation]:
    """The rungs from the bottom; their contexts prepare nothing before they are asked.

    Args:
        context: of the query.
        options: of its search.
    """
    feet = dataclasses.replace(options, dynamics="quasi-static", use_palms=False, heuristic="grid")
    remedies = ["--no-palms"] * options.use_palms + ["--dynamics quasi-static"] * (options.dynamics != "quasi-static")
    rungs = [Relaxation("search", "feet alone and quasi-static dynamics", " ".join(remedies), context, feet)]
    terrain, robot = context.scene.terrain, context.robot
    small = len(terrain.surfaces) <= MOST_SURFACES
    if small and slippery(terrain):
        rough = [dataclasses.replace(s, friction=max(s.friction, ENOUGH_FRICTION)) for s in terrain.surfaces]
        easier = with_terrain(context, Terrain(tuple(rough), terrain.obstacles, terrain.surfaces_of_meshes))
        rungs.append(Relaxation("friction", f"friction {ENOUGH_FRICTION:g}", "", easier, feet))
    for name in LONGER:
        model = transition_model(name)
        if model.steps[:, 0].max() > options.longest_stride:
            longer = dataclasses.replace(feet, model=model, longer=None)
            rungs.append(Relaxation("stride", f"steps of {name}", f"--transition-model {name}", context, longer))
    if small and terrain.obstacles:
        rungs.append(
            Relaxation("collision", "no obstacles", "", with_terrain(context, Terrain(terrain.surfaces)), feet)
        )
    if small:
        soles = [
            dataclasses.replace(e, half_extent=(SMALLER_SOLE * e.half_extent[0], SMALLER_SOLE * e.half_extent[1]))
            for e in robot.effectors[:2]
        ]
        shorter = dataclasses.replace(robot, effectors=(*soles, *robot.effectors[2:]))
        easier = QueryContext(
            context.scene, shorter, context.ik, context.cone, full_soles=context.full_soles, reserve=context.reserve
        )
        rungs.append(Relaxation("sole", f"soles of {100 * SMALLER_SOLE:g} % of their size", "", easier, feet))
    return rungs


def slippery(terrain: Terrain) -> bool:
    """Whether a surface for feet is steeper than its friction holds a foot on it."""
    feet = (terrain.surfaces[k] for k in terrain.surfaces_for(*FEET))
    return any(s.friction < max(needed_friction(s.normal), 1e-3) for s in feet)


def needed_friction(normal: np.ndarray) -> float:
    """The friction coefficient that holds weight on a surface with this upward normal: the tangent of its tilt."""
    return float(np.hypot(*normal[:2]) / max(normal[2], 1e-9))


def with_terrain(context: QueryContext, terrain: Terrain) -> QueryContext:
    """The query on another terrain.

    Args:
        context: of the query.
        terrain: instead of its own.
    """
    scene = dataclasses.replace(context.scene, terrain=terrain)
    return QueryContext(
        scene, context.robot, context.ik, context.cone, full_soles=context.full_soles, reserve=context.reserve
    )
