"""What stands in the way of a query without contacts: the first relaxation that opens a way, and where its way needs it.

No reason is said that was not tested: a relaxation is named only if a search with it, and without it none, found contacts.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import asdict, dataclass

import numpy as np
import shapely

from drakeplan.contact_planning.contact_plan import ContactPlan, PlannerOptions
from drakeplan.contact_planning.search_planner import SearchPlanner
from drakeplan.context import QueryContext
from drakeplan.query.friction_proof import too_slippery
from drakeplan.query.head_room import no_head_room, too_low
from drakeplan.query.refusal import Refusal
from drakeplan.query.relaxations import Relaxation, needed_friction, relaxations, with_terrain
from drakeplan.search.ana_star import Limits
from scenes.contact import Contact
from scenes.effector import EFFECTORS
from scenes.stance import changed_effector
from scenes.terrain.solids import solid_at
from scenes.terrain.surface import Surface
from scenes.terrain.terrain import Terrain

RUNG_TIME = 1.0  # [s] at most for one relaxation
RUNG_EXPANSIONS = 2_000  # at most for one, whatever the machine
SAMPLES = 0.06  # [m] between the points at which the torso box is looked for in solids
SNUG = 0.01  # [m] a stone that is longer and wider than a sole by no more than this is called small


@dataclass(frozen=True)
class Obstacle:
    """What stands in the way.

    Attributes:
        kind: "friction", "stride", "sole", "collision", "search" (palms or dynamics hindered), "motion" (of contacts that
            were found) or "unknown".
        obstacle: name of the surface or obstacle, "" where none can be named.
        place: (x, y, z) in W [m]; where nothing helped, the mean of the feet that came nearest to the goal; or None.
        limit: numbers, each key ends with its unit.
        remedy: command line options that help, or "".
        tested: what was tried, and how each search ended: "found", "exhausted", "expansions", "deadline", "cancelled",
            "unreachable" where the goal is proved to be so, or "start" where the robot cannot stand at the start.
        text: the same as one sentence.
    """

    kind: str
    obstacle: str
    place: tuple[float, float, float] | None
    limit: dict[str, float]
    remedy: str
    tested: dict[str, str]
    text: str

    def as_dict(self) -> dict[str, object]:
        """Plain data for JSON."""
        return asdict(self)


def find_obstacle(context: QueryContext, options: PlannerOptions, seconds: float) -> Obstacle:
    """Climbs the ladder of relaxations until one opens a way.

    Args:
        context: of the query.
        options: of its search.
        seconds: for the whole ladder.
    """
    began, tested = time.perf_counter(), dict[str, str]()
    nearest, blocked = None, ""
    rungs = relaxations(context, options)
    for k, rung in enumerate(rungs):
        left = began + seconds - time.perf_counter()
        if left <= 0.0 or context.deadline.why():
            break
        share = min(left / (len(rungs) - k), RUNG_TIME)
        planner, plan, tested[rung.change] = _search(rung.context, rung.options, share, context)
        if plan is not None:
            return _named(context, options, rung, plan, tested, lambda: began + seconds - time.perf_counter())
        if rung.kind == "search":
            nearest = planner.nearest()
            blocked = next((name for name, count in planner.domain.rejections.most_common(1) if count), "")
    text = f"no way was found with {', with '.join(tested)}"
    if nearest is None:
        return Obstacle("unknown", "", None, {}, "", tested, text)
    place, distance = nearest
    text += f"; the feet came nearest to the goal at {_at(place)}, {distance:.2f} m from it"
    text += f"; most candidates were rejected by: {blocked}" if blocked else ""
    return Obstacle("unknown", "", place, {"distance_m": distance}, "", tested, text)


def proved_obstacle(context: QueryContext, options: PlannerOptions) -> Obstacle | None:
    """What is proved to close every way before any search; None where nothing is.

    Args:
        context: of the query.
        options: of its search.
    """
    surface = too_slippery(context, options)
    if surface is None:
        return _too_low(context, options)
    limit, what = _friction_text(surface)
    tested = {"chains of steps that leave out what holds no foot": "unreachable"}
    text = f"{what}, and every way to the goal leads over such ground"
    return Obstacle("friction", surface.name, _tuple(surface.centroid), limit, "", tested, text)


def _too_low(context: QueryContext, options: PlannerOptions) -> Obstacle | None:
    """A ceiling that is proved to be too low wherever steps lead; None where none is."""
    found = no_head_room(context, options)
    if found is None:
        return None
    name, place, limit, what = found
    tested = {"chains of stances whose torso is free": "unreachable"}
    return Obstacle("collision", name, place, limit, "", tested, f"{what}, and no way leads round it")


def refused_motion(refusal: Refusal) -> Obstacle | None:
    """Where contacts were found but their motion was refused: the first transition at fault; None where none is known.

    Args:
        refusal: of the last contact sequence.
    """
    at = refusal.transitions()
    if not at:
        return None
    stances = refusal.sequence.stances
    place = _tuple(stances[at[0] + 1].feet_mean())
    mover = EFFECTORS[changed_effector(stances[at[0]], stances[at[0] + 1])]
    text = f"transition {at[0]}, which moves the {mover.replace('_', ' ')}, at {_at(place)}: {refusal.reason}"
    return Obstacle("motion", "", place, {"transition": at[0]}, "", {"motion over the contacts": "refused"}, text)


def _search(
    context: QueryContext, options: PlannerOptions, seconds: float, query: QueryContext
) -> tuple[SearchPlanner, ContactPlan | None, str]:
    """The planner of a relaxed query, its first plan if it has one, and how it ended."""
    planner = SearchPlanner(context, options)
    if planner.start_problem():
        return planner, None, "start"
    limits = Limits(
        deadline=max(seconds - planner.setup_s, 0.0),
        expansions=RUNG_EXPANSIONS,
        improve=0.0,
        stop=query.deadline.stop,
    )
    plan = next(iter(planner.plans(limits)), None)
    if plan is not None:
        return planner, plan, "found"
    return planner, None, "unreachable" if planner.goal_unreachable() else planner.counts().ended_by


def _named(
    context: QueryContext,
    options: PlannerOptions,
    rung: Relaxation,
    plan: ContactPlan,
    tested: dict[str, str],
    left: Callable[[], float],
) -> Obstacle:
    """The obstacle that a relaxation removed, and where the way that it opened needs it."""
    name, place, limit, what = "", None, dict[str, float](), ""
    if rung.kind == "stride":
        name, place, limit, what = _longest_step(context, plan, options.longest_stride)
    elif rung.kind == "friction":
        name, place, limit, what = _steepest(context, plan)
    elif rung.kind == "sole":
        name, place, limit, what = _too_small(context, plan)
    elif rung.kind == "collision":
        name, place, limit, what = _struck(context, plan)
        if name:
            alone = Terrain(
                context.scene.terrain.surfaces,
                tuple(o for o in context.scene.terrain.obstacles if not name.endswith(f"'{o.name}'")),
            )
            change, seconds = f"no {name}", min(left(), RUNG_TIME)
            if seconds > 0.0:
                _, _, tested[change] = _search(with_terrain(context, alone), rung.options, seconds, context)
            if tested.get(change) == "found":
                text = f"{what}; with {change} the way is open"
                return Obstacle(rung.kind, name, place, limit, rung.remedy, tested, text)
    text = f"{what}; " * bool(what) + f"with {rung.change} the way is open" + f": {rung.remedy}" * bool(rung.remedy)
    return Obstacle(rung.kind, name, place, limit, rung.remedy, tested, text)


Found = tuple[str, tuple[float, float, float] | None, dict[str, float], str]
NOTHING: Found = ("", None, {}, "")


def _longest_step(context: QueryContext, plan: ContactPlan, reach: float) -> Found:
    """The longest step forward or back beyond this reach [m], from one surface to another where there is such a one."""
    best, found = (False, reach), NOTHING
    surfaces = context.scene.terrain.surfaces
    for before, after in zip(plan.stances, plan.stances[1:], strict=False):
        mover = changed_effector(before, after)
        stand, moved = after.contacts[1 - mover] if mover < 2 else None, after.contacts[mover]
        if stand is None or moved is None:
            continue
        length = abs(float((moved.p_WC - stand.p_WC) @ stand.R_WC[:, 0]))
        rank = (stand.surface != moved.surface, length)
        if length > reach and rank > best:
            a, b = surfaces[stand.surface].name, surfaces[moved.surface].name
            place = _tuple(0.5 * (moved.p_WC + stand.p_WC))
            what = f"from {a!r} to {b!r} at {_at(place)} a stride of {length:.2f} m was found, the steps reach {reach:.2f} m"
            best, found = rank, (b, place, {"stride_m": length, "reach_m": reach}, what)
    return found


def _steepest(context: QueryContext, plan: ContactPlan) -> Found:
    """The surface on the way that lacks most friction."""
    least, found = 0.0, NOTHING
    for contact in _contacts(plan):
        surface = context.scene.terrain.surfaces[contact.surface]
        needed = needed_friction(surface.normal)
        if surface.friction - needed < least or (surface.friction == 0.0 and not found[0]):
            least = surface.friction - needed
            limit, what = _friction_text(surface)
            found = (surface.name, _tuple(contact.p_WC), limit, what)
    return found


def _friction_text(surface: Surface) -> tuple[dict[str, float], str]:
    """Numbers and words of a surface whose friction holds no foot."""
    needed, tilt = needed_friction(surface.normal), float(np.degrees(surface.tilt))
    what = f"slope {surface.name!r} of {tilt:.0f} deg needs friction {needed:.2f}, has {surface.friction:g}"
    if surface.friction == 0.0 and needed < 1e-3:
        what = f"{surface.name!r} has friction 0, which holds nobody"
    return {"tilt_deg": tilt, "needed": needed, "friction": surface.friction}, what


def _too_small(context: QueryContext, plan: ContactPlan) -> Found:
    """The surface on the way that is smallest against a sole, where it is no larger than one."""
    half = context.robot.effectors[0].half_extent
    least, found = SNUG, NOTHING
    for contact in _contacts(plan):
        surface = context.scene.terrain.surfaces[contact.surface]
        flat = (surface.vertices - contact.p_WC) @ contact.R_WC[:, :2]
        corners = shapely.get_coordinates(shapely.MultiPoint(flat).minimum_rotated_rectangle)
        width, length = sorted(np.linalg.norm(np.diff(corners[:3], axis=0), axis=1).tolist())
        spare = min(length - 2 * max(half), width - 2 * min(half))
        if spare <= least - 1e-9:
            limit = {"length_m": length, "width_m": width, "sole_length_m": 2 * half[0], "sole_width_m": 2 * half[1]}
            what = (
                f"stone {surface.name!r} is {100 * length:.3g} x {100 * width:.3g} cm, "
                f"a sole {200 * half[0]:.3g} x {200 * half[1]:.3g} cm"
            )
            least, found = spare, (surface.name, _tuple(contact.p_WC), limit, what)
    return found


def _struck(context: QueryContext, plan: ContactPlan) -> Found:
    """The first solid that the torso box meets on the way."""
    terrain, robot = context.scene.terrain, context.robot
    centre, size = robot.lowest_torso_box
    half = 0.5 * size
    ticks = [np.linspace(-h, h, int(np.ceil(2 * h / SAMPLES)) + 1) for h in half]
    points = np.stack(np.meshgrid(*ticks, indexing="ij"), axis=-1).reshape(-1, 3) + centre
    for stance in plan.stances:
        mean, yaw = stance.feet_mean(), stance.contacts[0].heading if stance.contacts[0] else 0.0
        c, s = np.cos(yaw), np.sin(yaw)
        for x, y, z in (points @ np.array([[c, s, 0], [-s, c, 0], [0, 0, 1]]) + mean).tolist():
            name = solid_at(terrain, context.packed, x, y, z)
            if not name:
                continue
            solid = next(o for o in terrain.obstacles if name.endswith(f"'{o.name}'"))
            under = float(solid.triangles()[..., 2].min() - mean[2])
            if under > centre[2] - half[2]:
                return name, (x, y, z), *too_low(name, under, robot)
            what = f"{name} stands in the way of the torso, which is {2 * half[1]:.2f} m wide with its arms"
            return name, (x, y, z), {"width_m": float(2 * half[1])}, what
    return NOTHING


def _contacts(plan: ContactPlan) -> list[Contact]:
    return [c for stance in plan.stances for c in stance.contacts[:2] if c is not None]


def _tuple(p: np.ndarray) -> tuple[float, float, float]:
    x, y, z = (float(v) for v in p)
    return x, y, z


def _at(place: tuple[float, float, float]) -> str:
    return f"({place[0]:.2f}, {place[1]:.2f}, {place[2]:.2f})"
