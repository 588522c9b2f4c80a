"""What `drakeplan plan` asks of a query: the options of the command line as those of the library."""

from __future__ import annotations

import math
import shlex
import sys
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING

from drakeplan.cli import supervisor
from drakeplan.cli.output import seconds_since_process_start

if TYPE_CHECKING:
    from drakeplan.cli.plan import Arguments
    from drakeplan.plan.plan import Plan
    from drakeplan.query.options import PlanOptions
    from drakeplan.timing.step_timing import Timing


def plan_options(
    arguments: Arguments, stop: Callable[[], bool], keep: Callable[[Plan, dict[str, object]], None]
) -> PlanOptions:
    """The options of a query from those of the command line.

    Args:
        arguments: of the command line.
        stop: polled; True ends the query.
        keep: called with contacts before their motion is made.

    Raises:
        InputError: a value that cannot be planned with.
    """
    from drakeplan.deadline import compile_clock
    from drakeplan.query.options import PlanOptions, check_options
    from optimization.balance.friction import FrictionCone
    from optimization.balance.reserve import ALL, USUAL

    options = PlanOptions(
        seed=arguments.seed,
        start=_in_radians(arguments.start),
        goal=_in_radians(arguments.goal),
        start_z=arguments.start_z,
        goal_z=arguments.goal_z,
        goal_radius=arguments.goal_radius,
        friction=arguments.friction,
        cone=FrictionCone(arguments.cone),
        planner=arguments.planner,
        dynamics=arguments.dynamics,
        timing=_timing(arguments),
        transition_model=arguments.transition_model,
        deadline=arguments.deadline,
        improve=0.0 if arguments.first else arguments.improve,
        expansions=arguments.expansions,
        library=arguments.library,
        use_palms=not arguments.no_palms,
        full_soles=arguments.full_soles,
        heuristic=arguments.heuristic,
        guide=arguments.guide,
        footholds=arguments.footholds,
        capture=arguments.capture,
        stop=stop,
        used=seconds_since_process_start() - compile_clock.seconds() if supervisor.wire is not None else 0.0,
        keep=keep,
        explain=arguments.explain,
        reserve=ALL if arguments.no_reserve else USUAL,
        simulate=arguments.simulate,
        command=shlex.join(["drakeplan", *sys.argv[1:]]),
    )
    check_options(options)
    return options


def _timing(arguments: Arguments) -> Timing:
    """The durations that were asked for, else those that planning with or without pushes walks by."""
    from drakeplan.timing.step_timing import WALKING, Timing

    usual = WALKING if arguments.capture != "none" else Timing()
    shift = usual.shift if arguments.shift is None else arguments.shift
    swing = usual.swing if arguments.swing is None else arguments.swing
    return Timing(shift, swing, arguments.free_timing)


def _in_radians(place: Sequence[float]) -> tuple[float, ...] | None:
    """(x, y) or (x, y, yaw) with the yaw in radians; None for nothing."""
    if not place:
        return None
    return (*place[:2], *(math.radians(yaw) for yaw in place[2:]))
