"""Plans a scene with one planner: chooses the dynamics, runs one query, and a second quasi-static one where that has no plan."""

from __future__ import annotations

import dataclasses
import time

import numpy as np

from drakeplan.contact_planning.contact_plan import DynamicsName, PlannerOptions
from drakeplan.contact_planning.planner import attribute_of, make_planner, planner_entry
from drakeplan.contact_planning.reachability import UNREACHABLE
from drakeplan.context import QueryContext
from drakeplan.deadline import Deadline
from drakeplan.progress import Progress, ProgressEvent
from drakeplan.query.explanation import explain_sequence
from drakeplan.query.first_compilation import compile_beside
from drakeplan.query.obstacle import find_obstacle, proved_obstacle, refused_motion
from drakeplan.query.options import PlanOptions, check_options, walking_feet, with_options
from drakeplan.query.query import Query, Rest
from drakeplan.query.record import QueryRecord
from drakeplan.query.refusal import Refusal
from drakeplan.query.relaxations import needed_friction
from drakeplan.query.result import PlanResult
from drakeplan.query.warm_up import warm_up
from drakeplan.search.ana_star import Limits
from learning.surrogate import FRICTION_TOLERANCE, load_surrogate
from learning.weights import NoWeightsError, OtherRobotError
from optimization.balance.friction import DEFAULT_CONE, FrictionCone
from optimization.balance.reserve import ALL
from optimization.inverse_kinematics.whole_body_ik import WholeBodyIK
from scenes.effector import FEET
from scenes.robots.nominal_stance import check_nominal_stance
from scenes.robots.robot import Robot
from scenes.scene import Scene
from scenes.transition_model import transition_model

_WARM: set[tuple[str, str]] = set()  # robots and planners whose kernels this process has loaded
CAPTURE_KERNELS = "drakeplan.robustness.warm_up:warm_up"
SURELY_HELD = np.cos(np.pi / 8)  # share of the friction that the octagon inside Coulomb's cone has in every direction
MAX_REPAIRS = 12  # times that a refused sequence is forbidden and the search resumes
RESERVE, MOST_RESERVE = 0.1, 3.0  # of the deadline, and seconds at most, kept back for what stands in the way
LEAST_RESERVE = 0.1  # [s] with less nothing is asked
RESERVED_SHARE = 0.3  # of the time that is left for a plan that keeps a reserve
PALMS_SHARE = 0.35  # of the deadline after which feet that know a way are tried alone, where palms brought no plan
LEARNED_SHARE = 0.3  # of the time for learned dynamics after which those that find no way over places to rest give up
RESTING_SHARE = 0.6  # of the time left for searching with quasi-static dynamics before a way without rest is asked for
SCOUTING = 3.0  # [s] at most for finding out whether a way has places to rest
RESERVE_SCOUTING = 2.0  # [s] the same for whether one keeps the reserve
FEET_SCOUTING = 0.6  # [s] the same for whether the feet alone find one
FEET_SHARE = 0.5  # of what is left then for searching with the feet alone
FEET_REPAIRS = 3  # of what they find
TRIED_REPAIRS = 3  # the same for learned dynamics that the user did not ask for


def plan_with_one(
    scene: Scene, robot: Robot, options: PlanOptions | None = None, progress: Progress | None = None
) -> PlanResult:
    """Plans a crossing with the planner of the options, and has it verified.

    Args:
        scene: terrain, start and goal.
        robot: who crosses.
        options: see `PlanOptions`.
        progress: called with events while it runs.

    Raises:
        InputError: bad options, a robot that does not stand as it is described, a start or goal off the terrain.
    """
    options = options or PlanOptions()
    tell = progress or (lambda event: None)
    check_options(options)
    if options.capture != "none":
        options = walking_feet(options)
    check_nominal_stance(robot)
    scene = with_options(scene, options)
    record = QueryRecord()
    if options.cone == FrictionCone.DIAMOND:
        record.notes.append(
            "friction cone diamond is up to 1.41 times larger than real friction: use it for comparison only"
        )
    tell(ProgressEvent("load", f"{robot.name} on {scene.name}", elapsed=0.0))
    deadline = Deadline(options.deadline, options.stop, options.used)
    context = QueryContext(
        scene, robot, WholeBodyIK(robot), options.cone, deadline, options.full_soles, options.reserve
    )
    load_kernels(robot, context.ik, options.planner, tell)
    if options.heuristic == "traversability":
        load_kernels(robot, context.ik, "guided", tell)
    if options.capture != "none":
        load_kernels(robot, context.ik, options.planner, tell, CAPTURE_KERNELS)
    deadline.start()
    tell = _with_time_left(tell, deadline)
    record.start, record.goal = context.start.feet_mean().tolist(), list(context.goal.xyz)
    record.notes += context.floor_notes
    dynamics = _dynamics(context, options, record.notes)
    for note in record.notes:
        tell(ProgressEvent("load", note))
    tell(ProgressEvent("search", elapsed=0.0))
    if planner_entry(options.planner).judges_transitions:
        proved = proved_obstacle(context, _planner_options(context, options, dynamics))
        if proved is not None:
            reason = f"{UNREACHABLE}: {proved.text}"
            report = {**record.as_dict("none", reason, None), "obstacle": proved.as_dict()}
            return PlanResult("none", reason, None, report, notes=tuple(record.notes))
    result = _within_the_reserve_or_not(context, options, dynamics, record, tell)
    if context.reserve != ALL and result.status != "complete":
        context = context.keeping(ALL)
    result = _or_at_rest(result, context, options, dynamics, record, tell)
    result = _with_obstacle(result, context, options, dynamics)
    refusal = result.refusal
    if options.explain and refusal is not None and refusal.without_dynamics:
        tell(ProgressEvent("explain", "what blocks the dynamics, and what would free them"))
        result = _explained(result, refusal, context, options)
    # The result may be that of an earlier attempt: its time is that of the whole query all the same.
    return dataclasses.replace(result, report={**result.report, "total_s": time.perf_counter() - record.began})


def _or_at_rest(
    result: PlanResult,
    context: QueryContext,
    options: PlanOptions,
    dynamics: DynamicsName,
    record: QueryRecord,
    tell: Progress,
) -> PlanResult:
    """The result; where learned dynamics brought no verified plan and others may, that of quasi-static ones."""
    if result.status == "complete" or result.hopeless or not record.expansions:
        return result
    if not _may_fall_back(context, options, dynamics):
        return result
    _note(
        record,
        tell,
        f"no verified plan with learned dynamics ({result.reason}); planned again with quasi-static dynamics",
    )
    second = _attempt(context, options, "quasi-static", record, tell)
    return dataclasses.replace(result if second.status == "none" else second, notes=tuple(record.notes))


def _note(record: QueryRecord, tell: Progress, text: str) -> None:
    """Keeps a note and tells it."""
    record.notes.append(text)
    tell(ProgressEvent("search", text))


def _with_time_left(tell: Progress, deadline: Deadline) -> Progress:
    """The same progress, every event with the seconds that are left."""
    return lambda event: tell(dataclasses.replace(event, left=deadline.left()))


def load_kernels(robot: Robot, ik: WholeBodyIK, planner: str, tell: Progress, kernels: str = "") -> None:
    """Loads what is compiled, before the clock of a query starts, and says so where it has to be compiled first.

    Args:
        robot: whose kernels are loaded.
        ik: its inverse kinematics.
        planner: whose kernels are loaded beside those of every query.
        tell: told what goes on.
        kernels: what loads them, if others than the planner's.
    """
    kernels = kernels or planner_entry(planner).kernels
    if {(robot.model_sha256, ""), (robot.model_sha256, kernels)} <= _WARM:
        return
    note = ProgressEvent("load", "compiling kernels, once on this machine: two to four minutes")
    with compile_beside(robot, lambda: tell(note)):
        if (robot.model_sha256, "") not in _WARM:
            warm_up(robot, ik)
        if kernels:
            attribute_of(kernels)(robot, ik)
    _WARM.update({(robot.model_sha256, ""), (robot.model_sha256, kernels)})


def _within_the_reserve_or_not(
    context: QueryContext, options: PlanOptions, dynamics: DynamicsName, record: QueryRecord, tell: Progress
) -> PlanResult:
    """One query that keeps the reserve of friction and supports; where it brings no verified plan, one with less, then none."""
    if context.reserve == ALL:
        return _palms_or_feet(context, options, dynamics, record, tell)
    for reserve in dict.fromkeys((context.reserve, context.reserve.eased())):
        name = "a reserve" if reserve == context.reserve else "a smaller reserve"
        within = context.keeping(reserve)
        if not _reserve_has_a_way(within, options):
            _note(record, tell, f"no way keeps {name} of friction and supports, as far as a short search says")
            continue
        result = _palms_or_feet(within.until(context.deadline.part(RESERVED_SHARE)), options, dynamics, record, tell)
        if result.status == "complete" or result.proved or result.hopeless or context.deadline.why():
            return result
        _note(record, tell, f"no verified plan keeps {name} of friction and supports ({result.reason})")
        record.limits_fired = [limit for limit in record.limits_fired if limit != "deadline"]
    _note(record, tell, "planned without a reserve of friction and supports")
    return _palms_or_feet(context.keeping(ALL), options, dynamics, record, tell)


def _reserve_has_a_way(context: QueryContext, options: PlanOptions) -> bool:
    """Whether a short search knows a way that keeps the reserve; one with a budget of expansions is not asked."""
    if options.expansions is not None or not planner_entry(options.planner).judges_transitions:
        return True
    return _finds_a_way(context, options, "quasi-static", RESERVE_SCOUTING)


def _palms_or_feet(
    context: QueryContext, options: PlanOptions, dynamics: DynamicsName, record: QueryRecord, tell: Progress
) -> PlanResult:
    """One query with palms; where they bring no verified plan, one of the feet alone, soon where these know a way."""
    spared = _may_spare_palms(context, options)
    hurried = spared and options.expansions is None and _feet_know_a_way(context, options, dynamics)
    first = context.until(context.deadline.part(PALMS_SHARE)) if hurried else context
    result = _at_rest_or_moving(first, options, dynamics, record, tell)
    if spared and result.status != "complete" and not result.proved and not context.deadline.why():
        alone = _feet_alone(context, options, dynamics, record, tell)
        if alone is not None and alone.rank > result.rank:
            return alone
    return result


def _at_rest_or_moving(
    context: QueryContext, options: PlanOptions, dynamics: DynamicsName, record: QueryRecord, tell: Progress
) -> PlanResult:
    """One query with these dynamics; where learned ones know no way over places to rest, quasi-static ones are asked.

    Learned dynamics refuse some of what a slow robot does near the limits of balance. A way that keeps moving, without
    a place to rest, is what the motion stage can follow least often: it is asked for last.
    """
    if not _may_fall_back(context, options, dynamics):
        return _attempt(context, options, dynamics, record, tell)
    result = _attempt(context, options, dynamics, record, tell, rest="only", share=LEARNED_SHARE)
    if result.status != "none" or not record.expansions or context.deadline.why():
        return result
    _note(
        record,
        tell,
        f"no way with learned dynamics and places to rest ({result.reason}); planned again with quasi-static dynamics",
    )
    resting = _attempt(context, options, "quasi-static", record, tell, share=RESTING_SHARE)
    if resting.status == "complete" or context.deadline.why():
        return resting
    return _attempt(context, options, dynamics, record, tell, rest="never")


def _attempt(
    context: QueryContext,
    options: PlanOptions,
    dynamics: DynamicsName,
    record: QueryRecord,
    tell: Progress,
    *,
    rest: Rest = "first",
    share: float = 1.0,
) -> PlanResult:
    """One query with these dynamics; learned ones that the user did not ask for leave time for another.

    Args:
        context: of the query.
        options: what the user chose.
        dynamics: what the search asks of transitions.
        record: numbers of the whole query.
        tell: told what goes on.
        rest: whether places to rest are asked for.
        share: of the time that is left, for searching.
    """
    record.planner = options.planner
    record.dynamics = dynamics if planner_entry(options.planner).judges_transitions else ""
    planner = make_planner(options.planner, context, _planner_options(context, options, dynamics))
    reason = planner.start_problem()
    if reason:
        return PlanResult("none", reason, None, record.as_dict("none", reason, None), notes=tuple(record.notes))
    if dynamics == "exact" and rest == "first" and not _has_rests(context, options):
        rest = "never"
    query = Query(context, options, planner, record, tell, rest)
    tried = options.dynamics is None and dynamics == "learned"
    search_for = (0.5 if tried else 1.0) * share * _time_to_search(context, options)
    return query.run(search_for, TRIED_REPAIRS if tried else MAX_REPAIRS)


def _has_rests(context: QueryContext, options: PlanOptions) -> bool:
    """Whether a short quasi-static search finds a way.

    Exact dynamics with places to rest ask for all that quasi-static dynamics ask for, and a program for each transition
    beside it: where there is no such way, they look for it a hundred times longer.
    """
    if not planner_entry(options.planner).judges_transitions:
        return True
    return _finds_a_way(context, options, "quasi-static", SCOUTING)


def _feet_know_a_way(context: QueryContext, options: PlanOptions, dynamics: DynamicsName) -> bool:
    """Whether a short search finds a way without palms: then they need not be waited for long."""
    return _finds_a_way(context, dataclasses.replace(options, use_palms=False), dynamics, FEET_SCOUTING)


def _finds_a_way(context: QueryContext, options: PlanOptions, dynamics: DynamicsName, most: float) -> bool:
    """Whether a search of so many seconds, or the budget of expansions, finds contacts."""
    scout = make_planner(options.planner, context, _planner_options(context, options, dynamics))
    if scout.start_problem():
        return False
    seconds = min(most, 0.1 * context.deadline.left()) if options.expansions is None else None
    limits = Limits(deadline=seconds, expansions=options.expansions, improve=0.0, stop=options.stop)
    return next(iter(scout.plans(limits)), None) is not None


def _may_spare_palms(context: QueryContext, options: PlanOptions) -> bool:
    """Whether the palms could touch something but the feet alone may do."""
    searches = planner_entry(options.planner).judges_transitions
    return options.use_palms and searches and bool(context.usable_palms)


def _feet_alone(
    context: QueryContext, options: PlanOptions, dynamics: DynamicsName, record: QueryRecord, tell: Progress
) -> PlanResult | None:
    """A plan of the feet alone, None where they cannot stand at the start.

    A palm that is held makes a motion stiff, and its contacts multiply the search: where no motion with palms holds, the
    feet alone may still walk past.
    """
    tell(ProgressEvent("search", "no verified plan with palms; planned again with the feet alone"))
    feet = dataclasses.replace(options, use_palms=False)
    alone = QueryRecord(notes=record.notes, began=record.began, start=record.start, goal=record.goal, dynamics=dynamics)
    planner = make_planner(options.planner, context, _planner_options(context, feet, dynamics))
    if planner.start_problem():
        return None
    search_for = FEET_SHARE * _time_to_search(context, options)
    return Query(context, feet, planner, alone, tell).run(search_for, FEET_REPAIRS)


def _planner_options(context: QueryContext, options: PlanOptions, dynamics: DynamicsName) -> PlannerOptions:
    """What is asked of the planner of contacts."""
    named = options.transition_model or context.scene.transition_model
    return PlannerOptions(
        seed=options.seed,
        use_palms=options.use_palms,
        lean_on=options.lean_on,
        heuristic=options.heuristic,
        estimator=options.estimator,
        guide=options.guide,
        capture=options.capture,
        odds=options.odds,
        catch_palms=options.catch_palms,
        dynamics=dynamics,
        timing=options.timing,
        footholds=options.footholds,
        model=transition_model(named or "experiments"),
        longer=None if named or options.footholds == "fixed" else transition_model("long_stride"),
        library=options.library,
        fit=options.fit,
    )


def reserve(options: PlanOptions) -> float:
    """Seconds that the search leaves for finding out what stands in its way."""
    searches = planner_entry(options.planner).judges_transitions
    return min(RESERVE * options.deadline, MOST_RESERVE) if searches else 0.0


def _time_to_search(context: QueryContext, options: PlanOptions) -> float:
    """Seconds that are left for searching; what is kept back is kept from the whole deadline, once."""
    deadline = context.deadline
    whole = deadline.whole or deadline
    return max(min(deadline.left(), whole.left() - reserve(options)), 0.0)


def _may_fall_back(context: QueryContext, options: PlanOptions, dynamics: DynamicsName) -> bool:
    """Whether learned dynamics were the default and there is time for a second query."""
    left = _time_to_search(context, options) > 0.0
    return options.dynamics is None and dynamics == "learned" and left and not context.deadline.why()


def _dynamics(context: QueryContext, options: PlanOptions, notes: list[str]) -> DynamicsName:
    """What the planner asks of transitions; where nothing was learned for this query, something else, and that is noted."""
    if not planner_entry(options.planner).judges_transitions:
        return "quasi-static"
    if options.dynamics in ("quasi-static", "exact"):
        return options.dynamics
    why = _not_learned(context, options)
    if not why:
        return "learned"
    instead: DynamicsName = "exact" if options.dynamics == "learned" else "quasi-static"
    notes.append(f"{why}: {instead} dynamics are used instead")
    return instead


def _not_learned(context: QueryContext, options: PlanOptions) -> str:
    """Why learned dynamics do not fit this query, "" if they do."""
    try:
        surrogate = load_surrogate(context.robot, times=options.timing.times)
    except NoWeightsError as error:
        return str(error).split(":")[0]
    except OtherRobotError:  # an own variant of a packaged robot, its name kept
        return f"learned dynamics exist for another robot named {context.robot.name!r}, not for this variant of it"
    learned = surrogate.card.get("cone", DEFAULT_CONE)
    if context.cone != learned:
        return f"learned dynamics exist only for --cone {learned}"
    terrain = context.scene.terrain
    surfaces = [terrain.surfaces[k] for k in terrain.surfaces_for(*FEET)]
    rough = surrogate.friction[1] + FRICTION_TOLERANCE
    for surface in surfaces:  # what holds a foot only by more friction than was learned is refused by what was learned
        if surface.friction > rough and needed_friction(surface.normal) > SURELY_HELD * surrogate.friction[1]:
            return (
                f"learned dynamics exist only for friction {surrogate.friction[1]:g}, "
                f"and {surface.name!r} of {np.degrees(surface.tilt):.0f} deg needs more"
            )
    best = max((s.friction for s in context.scene.terrain.surfaces), default=surrogate.friction[0])
    if best < surrogate.friction[0] - FRICTION_TOLERANCE:  # else what is slippery is left to the exact program
        return f"learned dynamics exist only for friction {surrogate.friction[0]:g} and above"
    return ""


def _with_obstacle(
    result: PlanResult, context: QueryContext, options: PlanOptions, dynamics: DynamicsName
) -> PlanResult:
    """The result with what stands in the way, where no contacts were found and there is time to find that out."""
    seconds = min(context.deadline.left(), MOST_RESERVE)
    if result.status == "contacts" and result.refusal is not None:
        found = refused_motion(result.refusal)
        report = result.report if found is None else {**result.report, "obstacle": found.as_dict()}
        return dataclasses.replace(result, report=report)
    if result.status != "none" or result.refusal is not None or not reserve(options):
        return result
    if context.deadline.why() or seconds < LEAST_RESERVE:
        return result
    obstacle = find_obstacle(context, _planner_options(context, options, dynamics), seconds)
    if result.proved and obstacle.kind == "unknown":
        return result
    reason = f"{result.reason}; {obstacle.text}"
    report = {**result.report, "reason": reason, "obstacle": obstacle.as_dict()}
    return dataclasses.replace(result, reason=reason, report=report)


def _explained(result: PlanResult, refusal: Refusal, context: QueryContext, options: PlanOptions) -> PlanResult:
    """The result with what stands in the way of the refused sequence's dynamics."""
    explanation = explain_sequence(context, refusal.sequence.stances, options.timing, refusal.reason)
    report = {**result.report, "explanation": explanation.as_dict()}
    return dataclasses.replace(result, report=report, explanation=explanation)
