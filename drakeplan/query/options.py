"""Options of a query, and the scene with these options applied."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import get_args

import numpy as np

from drakeplan.contact_planning.contact_plan import (
    CaptureName,
    DynamicsName,
    FitName,
    FootholdsName,
    GuideName,
    HeuristicName,
    OddsName,
)
from drakeplan.contact_planning.planner import PLANNERS, planner_entry
from drakeplan.plan.plan import Plan
from drakeplan.timing.step_timing import Timing
from learning.traversability import KINDS
from optimization.balance.friction import DEFAULT_CONE, FrictionCone
from optimization.balance.reserve import USUAL, Reserve
from optimization.convex import piqp_adapter
from scenes.input_error import InputError, unknown_name
from scenes.scene import Goal, Scene, Start
from scenes.terrain.georeference import to_local
from scenes.terrain.terrain import Terrain

MOST_FRICTION = 10.0  # above this the programs lose accuracy, and no real material has it


@dataclass(frozen=True)
class PlanOptions:
    """What a user may choose about a query. Angles in radians, lengths in metres, times in seconds.

    Attributes:
        seed: of every random choice.
        start: (x, y) or (x, y, yaw) that replaces the scene's.
        goal: the same for the goal.
        start_z: height of the start's floor; without it the start given here stands on the lowest with head room.
        goal_z: height of the goal's floor; without it the goal given here is on the one nearest the start's height.
        goal_radius: replaces the goal's.
        friction: replaces every friction in the scene.
        cone: friction cone.
        planner: a name in `drakeplan.contact_planning.planner.PLANNERS`.
        dynamics: what every transition must satisfy: "quasi-static" balance, the centroidal program ("exact"), or what
            has learned it ("learned"; the exact program where nothing was learned for the query). None: "learned" for the
            search, but "quasi-static" where nothing was learned; the other planners have dynamics of their own.
        timing: of every transition; networks exist for 1 s and 1 s (Lin 2020 sec. 6.7), and for feet alone for 0.6 s and 0.4 s
            (sec. 7.7).
        heuristic: "grid", "traversability", "euclidean" or "admissible"; only the last gives a bound.
        estimator: see `PlannerOptions.estimator`.
        guide: see `PlannerOptions.guide`.
        transition_model: name of the foot transition model, None for the scene's or the usual one.
        deadline: of the whole query, motion and verification included; kernels that compile first do not count.
        improve: the search stops this many seconds after the first plan; without effect when `expansions` is given. None: after
            150 more nodes, or 0.15 of the deadline, so that the same seed gives the same plan (other planners: after 1 s).
        expansions: nodes expanded at most; unlike times it makes runs repeatable.
        use_palms: whether palms may be used.
        lean_on: see `PlannerOptions.lean_on`.
        full_soles: whether all of every sole has to rest on something; else a part of it may.
        reserve: what is left unused of friction and supports; where no plan keeps it, one without it is looked for.
        footholds: "snapped": a step or a palm ray that finds no foothold moves to the nearest one; "fixed": it is lost, as in
            Lin 2020.
        capture: see `PlannerOptions.capture`; the feet walk alone then, on whole soles, and palms may catch the robot.
        odds: see `PlannerOptions.odds`.
        catch_palms: whether they may; set from `use_palms` by `walking_feet`.
        library: folder of stored plans for planners that adapt some; "" for the one that comes with the robot.
        fit: see `PlannerOptions.fit`.
        search_too: whether the planner "adapt" leaves half of the deadline to the search, where no stored plan fits.
        stop: polled; True ends the query, which then returns the best contacts so far.
        used: seconds of the deadline that were used before the call.
        keep: called with contacts, before their motion is made: what is left of the query should its process be killed.
        command: recorded in the plan's provenance.
        simulate: whether a plan has to be played in physics too before it counts: one that falls is refused like one that
            the verifier refuses.
        explain: whether a sequence whose dynamics are infeasible is asked what would make them feasible.
        avoid: names of surfaces that no sole and no palm may touch; they are still in the way of the body. The plan's scene
            says so, and the verifier holds the plan to it.
    """

    seed: int = 0
    start: tuple[float, ...] | None = None
    goal: tuple[float, ...] | None = None
    start_z: float | None = None
    goal_z: float | None = None
    goal_radius: float | None = None
    friction: float | None = None
    cone: FrictionCone = DEFAULT_CONE
    planner: str = "search"
    dynamics: DynamicsName | None = None
    timing: Timing = field(default_factory=Timing)
    heuristic: HeuristicName = "grid"
    estimator: str = ""
    guide: GuideName = "mean"
    transition_model: str | None = None
    use_palms: bool = True
    lean_on: tuple[int, ...] = ()
    full_soles: bool = False
    reserve: Reserve = USUAL
    footholds: FootholdsName = "snapped"
    deadline: float = 30.0
    improve: float | None = None
    expansions: int | None = None
    capture: CaptureName = "none"
    odds: OddsName = "motions"
    catch_palms: bool = True
    library: str = ""
    fit: FitName = "quick"
    search_too: bool = True
    stop: Callable[[], bool] | None = None
    used: float = 0.0
    keep: Callable[[Plan, dict[str, object]], None] | None = None
    command: str = ""
    explain: bool = False
    simulate: bool = False
    avoid: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        object.__setattr__(self, "cone", FrictionCone(self.cone))  # a name is taken too


def walking_feet(options: PlanOptions) -> PlanOptions:
    """The options of a query against pushes: feet alone, whole soles, dynamics that move the CoM (Lin 2020 sec. 7.2).

    Args:
        options: as they were asked for.
    """
    return dataclasses.replace(
        options,
        dynamics=options.dynamics or "learned",
        use_palms=False,
        catch_palms=options.use_palms,
        full_soles=True,
    )


def with_options(scene: Scene, options: PlanOptions) -> Scene:
    """The scene with the start, goal and friction that the options ask for, without contacts on what they avoid.

    Args:
        scene: as loaded.
        options: whose start, goal, their heights, goal radius and friction replace the scene's.

    Raises:
        InputError: a height for a start that is given as a stance, or an avoided surface that the scene does not have.
    """
    start, goal, terrain = scene.start, scene.goal, scene.terrain
    if options.start is not None:
        x, y, *heading = map(float, options.start)  # for whole numbers kernels compile anew
        x, y = to_local([x, y], scene.origin_offset and scene.origin_offset[:2]).tolist()
        start = Start((x, y, float("nan")), heading[0] if heading else 0.0)  # the floors there say how high
    if options.start_z is not None and start is not None:
        if start.stance:
            raise InputError(f"--start-z: scene {scene.name} gives the start as a stance; give --start X Y too")
        start = dataclasses.replace(start, xyz=(*start.xyz[:2], float(options.start_z)))
    radius = options.goal_radius if options.goal_radius is not None else (goal.radius if goal else 0.2)
    if options.goal is not None:
        x, y, *heading = map(float, options.goal)
        x, y = to_local([x, y], scene.origin_offset and scene.origin_offset[:2]).tolist()
        goal = Goal((x, y, float("nan")), radius, heading[0] if heading else None)
    elif goal is not None:
        goal = dataclasses.replace(goal, radius=radius)
    if options.goal_z is not None and goal is not None:
        goal = dataclasses.replace(goal, xyz=(*goal.xyz[:2], float(options.goal_z)))
    if options.friction is not None:
        surfaces = tuple(dataclasses.replace(s, friction=options.friction) for s in terrain.surfaces)
        terrain = dataclasses.replace(terrain, surfaces=surfaces)
    if options.avoid:
        terrain = _without_contacts(terrain, options.avoid)
    return dataclasses.replace(scene, start=start, goal=goal, terrain=terrain)


def _without_contacts(terrain: Terrain, names: tuple[str, ...]) -> Terrain:
    """The terrain with surfaces of these names that nothing may touch."""
    known = {surface.name for surface in terrain.surfaces}
    for name in names:
        if name not in known:
            raise unknown_name("surface", name, known)
    nobody: frozenset[str] = frozenset()
    surfaces = (dataclasses.replace(s, effectors=nobody) if s.name in names else s for s in terrain.surfaces)
    return dataclasses.replace(terrain, surfaces=tuple(surfaces))


def check_options(options: PlanOptions) -> None:
    """Raises on options that cannot be planned with.

    Raises:
        InputError: an unknown name, or a number that is none or out of range.
    """
    entry = planner_entry(options.planner)
    if options.simulate and not piqp_adapter.available():
        raise InputError("--simulate needs PIQP: pip install 'drakeplan[fast]'")
    if options.dynamics not in (None, *get_args(DynamicsName)):
        raise unknown_name("dynamics", options.dynamics, get_args(DynamicsName))
    if options.footholds not in get_args(FootholdsName):
        raise unknown_name("footholds", options.footholds, get_args(FootholdsName))
    if options.heuristic not in get_args(HeuristicName):
        raise unknown_name("heuristic", options.heuristic, get_args(HeuristicName))
    if options.guide not in get_args(GuideName):
        raise unknown_name("guide", options.guide, get_args(GuideName))
    if options.capture not in get_args(CaptureName):
        raise unknown_name("capture", options.capture, get_args(CaptureName))
    if options.odds not in get_args(OddsName):
        raise unknown_name("odds", options.odds, get_args(OddsName))
    if options.capture != "none" and (options.planner != "search" or options.dynamics == "quasi-static"):
        raise InputError(
            f"--capture {options.capture} needs --planner search and dynamics that move the CoM, got --planner "
            f"{options.planner}" + (" --dynamics quasi-static" if options.dynamics == "quasi-static" else "")
        )
    if options.estimator not in ("", *KINDS):
        raise unknown_name("estimator", options.estimator, KINDS)
    if not entry.judges_transitions and options.dynamics not in (None, "quasi-static"):
        able = " or ".join(name for name, other in PLANNERS.items() if other.judges_transitions)
        raise InputError(f"--dynamics {options.dynamics} needs --planner {able}, got --planner {options.planner}")
    for key in ("deadline", "improve", "friction", "goal_radius"):
        value = getattr(options, key)
        if value is not None and not (np.isfinite(value) and value >= 0):
            raise InputError(f"--{key.replace('_', '-')}: expected a finite number >= 0, got {value}")
    for key in ("start_z", "goal_z"):
        value = getattr(options, key)
        if value is not None and not np.isfinite(value):
            raise InputError(f"--{key.replace('_', '-')}: expected a finite number, got {value}")
    if options.friction is not None and not 0.0 < options.friction <= MOST_FRICTION:
        raise InputError(f"--friction: expected more than 0, at most {MOST_FRICTION:g}, got {options.friction:g}")
    if isinstance(options.avoid, str):
        raise InputError(f"avoid: expected names of surfaces in a tuple, got the text {options.avoid!r}")
    for key in ("start", "goal"):
        value = getattr(options, key)
        if value is not None and not (len(value) in (2, 3) and np.isfinite(value).all()):
            raise InputError(f"--{key}: expected X Y or X Y YAW, finite numbers, got {value}")
