"""A motion over a contact sequence that the user gives: no search, and the same dynamics, motion and verifier.

stances -> contacts checked by the verifier -> dynamics, motion, verification (-> execution in physics)
"""

from __future__ import annotations

import dataclasses
import time
from collections.abc import Callable, Iterator, Mapping, Sequence

from drakeplan.contact_planning.contact_plan import ContactPlan, PlannerCounts
from drakeplan.contact_planning.sequence_check import SequenceCheck
from drakeplan.context import QueryContext
from drakeplan.deadline import Deadline
from drakeplan.motion.check import excess
from drakeplan.motion.maker import MotionResult
from drakeplan.plan.plan import Plan
from drakeplan.progress import Progress, ProgressEvent
from drakeplan.query.given_stances import GIVEN, from_first_to_last, given_stances, require_on_terrain
from drakeplan.query.inputs import AnyRobot, AnyScene, as_robot, as_scene
from drakeplan.query.one_planner import load_kernels
from drakeplan.query.options import PlanOptions, check_options, with_options
from drakeplan.query.query import Query
from drakeplan.query.record import QueryRecord
from drakeplan.query.result import PlanResult
from drakeplan.query.watching import Watcher, watched
from drakeplan.search.ana_star import Limits
from optimization.balance.reserve import ALL, Reserve
from optimization.inverse_kinematics.whole_body_ik import WholeBodyIK
from scenes.contact import Contact
from scenes.robots.nominal_stance import check_nominal_stance
from scenes.stance import Stance


def plan_motion(
    scene: AnyScene,
    robot: AnyRobot | None,
    stances: Sequence[Stance | Mapping[str, Contact]],
    options: PlanOptions | None = None,
    progress: Watcher = None,
) -> PlanResult:
    """Makes momenta, forces and a whole-body motion over contacts that you choose, and has the plan verified.

    The plan starts and ends where the sequence does, whatever start and goal the scene has. Where no motion holds, the
    result has status "contacts", and its reason says what gave way.

    Args:
        scene: with the terrain; see `plan_scene`.
        robot: who moves; see `plan_scene`.
        stances: the contacts held at once, in order; consecutive ones differ in one end effector. Each is a `Stance`, or a
            dict from the names of end effectors to contacts (`make_contact`).
        options: of these, friction, avoid, cone, timing, reserve, deadline, simulate, stop and keep count; see `PlanOptions`.
        progress: see `plan_scene`.

    Raises:
        InputError: no such scene or robot, bad options, stances that differ in more than one end effector, or a contact
            that is not on the terrain.
    """
    options = options or PlanOptions()
    check_options(options)
    ground = with_options(as_scene(scene, options.seed), options)
    who = as_robot(robot, ground)
    check_nominal_stance(who)
    sequence = given_stances(stances, options.friction)
    record = QueryRecord(planner=GIVEN)
    with watched(progress) as tell:
        tell(ProgressEvent("load", f"{who.name} on {ground.name}, {len(sequence)} stances", elapsed=0.0))
        ik = WholeBodyIK(who)
        ground = from_first_to_last(ground, sequence, record.notes)
        assert ground.goal is not None
        record.start, record.goal = sequence[0].feet_mean().tolist(), list(ground.goal.xyz)
        made: dict[str, object] = {"start": sequence[0], "goal": ground.goal}  # else they would be looked for
        deadline = Deadline(options.deadline, options.stop, options.used)
        context = QueryContext(ground, who, ik, options.cone, deadline, options.full_soles, options.reserve, made)
        require_on_terrain(context, sequence)
        load_kernels(who, ik, "search", tell)
        deadline.start()
        result = _with_or_without_reserve(context, options, sequence, record, tell)
    total = {"total_s": time.perf_counter() - record.began}
    if result.refusal is not None:
        reason = result.refusal.reason
        return dataclasses.replace(result, reason=reason, report={**result.report, "reason": reason, **total})
    return dataclasses.replace(result, report={**result.report, **total})


def _with_or_without_reserve(
    context: QueryContext, options: PlanOptions, stances: Sequence[Stance], record: QueryRecord, tell: Progress
) -> PlanResult:
    """The verified plan with the greatest reserve of friction and supports; else the answer without one."""
    reserves = list(dict.fromkeys((context.reserve, context.reserve.eased(), ALL)))
    result: PlanResult | None = None
    for left, reserve in zip(range(len(reserves), 0, -1), reserves, strict=True):
        within = context.keeping(reserve).until(context.deadline.part(1.0 / left))
        result = _GivenQuery(within, options, _GivenContacts(within, stances), record, tell).run(options.deadline, 0)
        refused = result.refusal.motion if result.refusal is not None else None
        hopeless = refused is not None and (refused.blocked or refused.alike)
        if result.status == "complete" or hopeless or context.deadline.why():
            break
        if left > 1:
            why = result.reason if result.refusal is None else result.refusal.reason
            record.notes.append(f"no motion keeps {_share(reserve)} ({why})")
            record.limits_fired = [limit for limit in record.limits_fired if limit != "deadline"]  # of a part alone
            tell(ProgressEvent("dynamics", record.notes[-1]))
    assert result is not None
    return dataclasses.replace(result, notes=tuple(record.notes))


def _share(reserve: Reserve) -> str:
    return f"a reserve of friction and supports of {1 - reserve.friction:.2g} and {1 - reserve.pressure:.2g}"


class _GivenContacts:
    """A planner that knows one sequence; see `drakeplan.contact_planning.planner.ContactPlanner`."""

    setup_s = 0.0

    def __init__(self, context: QueryContext, stances: Sequence[Stance]) -> None:
        cost = SequenceCheck(context).cost(stances)
        self._left = [ContactPlan(tuple(stances), (), cost, None, 0, 0.0)]

    def start_problem(self) -> str:
        """Nothing: the verifier has seen the contacts."""
        return ""

    def plans(self, limits: Limits, clock: Callable[[], float] = time.perf_counter) -> Iterator[ContactPlan]:
        """Yields the sequence, once.

        Args:
            limits: without effect.
            clock: the same.
        """
        while self._left:
            yield self._left.pop()

    def forbid(self, plan: ContactPlan, transition: int) -> None:
        """Does nothing: there is no other sequence.

        Args:
            plan: the sequence.
            transition: that was refused.
        """

    def ask_for_swings(self, swing_is_clear: Callable[[Stance, Stance], bool]) -> None:
        """Does nothing."""

    def require_static_balance(self, required: bool) -> bool:
        """Changes nothing."""
        return False

    def why_not(self) -> str:
        """Why there is no plan; said by the step that refused the sequence."""
        return "the given contacts have no motion"

    def counts(self) -> PlannerCounts:
        """Nothing was searched."""
        return PlannerCounts(ended_by="exhausted")


class _GivenQuery(Query):
    """A query that moves on without rests where the robot cannot rest between the given transitions."""

    def _make_motion(self, sequence: ContactPlan) -> MotionResult:
        motion = super()._make_motion(sequence)
        if motion.centroidal is not None or motion.blocked or not self._whole_sequence_feasible(sequence):
            return motion
        moving = self._maker(sequence).run(sequence.stances, self.tell, self._courses[sequence.stances])
        return min(moving, motion, key=lambda m: (not m.ok, m.centroidal is None, excess(m.problems)))

    def _assemble(self, sequence: ContactPlan, motion: MotionResult | None) -> Plan:
        plan = super()._assemble(sequence, motion)
        made = {"planner": GIVEN, "footholds": "", "dynamics": ""}
        return dataclasses.replace(plan, provenance={**plan.provenance, **made})
