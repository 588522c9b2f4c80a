"""A proof, before any search, that friction is too small: every chain of steps leads over ground that holds no foot.

A foot on a slope that is steeper than its friction holds pulls the robot downhill, however the forces are chosen. At rest
nothing can be done about it, so for quasi-static dynamics and feet alone such ground is no ground. In motion a short piece
can be run over. Not so a long one: let T pass with all feet on slopes that fall in one direction, forces there be inclined
by at least tau = tan(slope - friction angle) to the vertical, the CoM be within L of a standing foot, and h feet land in half
of T, each within R of the one that stands. Then every second difference of the CoM over T is at most B = 4 L + 2 h R, and
that downhill is at least tau (g T^2 / 4 - B).
"""

from __future__ import annotations

import numpy as np

from drakeplan.contact_planning.contact_plan import PlannerOptions
from drakeplan.contact_planning.reachability import MOST_SURFACES, surfaces_in_reach
from drakeplan.context import QueryContext
from drakeplan.query.relaxations import needed_friction
from optimization.balance.friction import FrictionCone
from scenes.effector import FEET
from scenes.gravity import GRAVITY
from scenes.terrain.surface import Surface

LANDINGS = (3, 4, 5)  # on ground that is left out for every kind of dynamics: the fewest of these that nobody makes
BODY = 0.4  # [m] a hip is no farther from the CoM
SAME_WAY = np.cos(np.deg2rad(2.0))  # slopes that fall in one direction


def too_slippery(context: QueryContext, options: PlannerOptions) -> Surface | None:
    """A surface that friction closes and every way to the goal needs; None where that is not proved.

    Args:
        context: of the query.
        options: of its search.
    """
    terrain, robot = context.scene.terrain, context.robot
    if options.use_palms and context.usable_palms:
        return None
    feet = terrain.surfaces_for(*FEET)
    if len(feet) > MOST_SURFACES:
        return None
    closed = [k for k in feet if _lack(terrain.surfaces[k], context.cone) > 1e-6]
    if not closed or any(c.surface in closed for c in context.start.contacts[:2] if c):
        return None  # of a start on such ground the search says at once that nobody stands there
    reach = options.step_reach(robot)
    if not context.full_soles:  # the middle of a sole may be beside what carries it
        reach += 2 * float(np.hypot(*robot.effectors[0].half_extent))
    if not surfaces_in_reach(terrain, robot, reach, context.start, context.goal, feet, 1.0):
        return None  # friction is not what is in the way
    stretches = [(closed, 1.0)] if options.dynamics == "quasi-static" else _no_runs(closed, context, options)
    for left_out, stretch in stretches:
        ground = sorted(set(feet) - set(left_out))
        if not surfaces_in_reach(terrain, robot, reach, context.start, context.goal, ground, stretch):
            return max((terrain.surfaces[k] for k in left_out), key=lambda s: _lack(s, context.cone))
    return None


def _no_runs(closed: list[int], context: QueryContext, options: PlannerOptions) -> list[tuple[list[int], float]]:
    """Surfaces on which nobody lands so many times, whatever the momentum, and the strides that lead over fewer landings."""
    surfaces = context.scene.terrain.surfaces
    found = []
    for landings in LANDINGS:
        slopes = [k for k in closed if _no_run(surfaces[k], landings, context, options)]
        if slopes and all(_falls_alike(surfaces[k], surfaces[slopes[0]]) for k in slopes):
            found.append((slopes, float(landings)))
    return found


def _lack(surface: Surface, cone: FrictionCone) -> float:
    """Tangent of the tilt less what friction gives at most, in the direction in which this cone is widest."""
    widest = np.sqrt(2.0) if cone == FrictionCone.DIAMOND else 1.0
    return needed_friction(surface.normal) - widest * surface.friction


def _no_run(surface: Surface, landings: int, context: QueryContext, options: PlannerOptions) -> bool:
    """Whether nobody lands so many times in a row on such a slope, whatever the momentum."""
    timing, robot = options.timing, context.robot
    if timing.free:
        return False
    step = timing.shift + timing.swing
    duration = timing.swing + (landings - 1) * step
    widest = np.sqrt(2.0) if context.cone == FrictionCone.DIAMOND else 1.0
    tau = np.tan(surface.tilt - np.arctan(widest * surface.friction))
    stride = float(np.hypot(np.hypot(*options.model.steps[:, :2].T).max(), robot.max_step_height))
    most = 4 * (float(robot.leg_reach[1]) + BODY) + 2 * (np.floor(0.5 * duration / step) + 1) * stride
    return bool(tau * (float(np.linalg.norm(GRAVITY)) * duration**2 / 4 - most) > most)


def _falls_alike(one: Surface, other: Surface) -> bool:
    a, b = one.normal[:2], other.normal[:2]
    return bool(a @ b >= SAME_WAY * np.linalg.norm(a) * np.linalg.norm(b))
