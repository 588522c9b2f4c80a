"""The Protocol that every contact planner implements, and the registry of planners by name.

Nothing heavy is imported here, so that `--help` can list the planners at once.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from importlib import import_module
from typing import TYPE_CHECKING, Any, Protocol

from scenes.input_error import unknown_name

if TYPE_CHECKING:
    from drakeplan.contact_planning.contact_plan import ContactPlan, PlannerCounts, PlannerOptions
    from drakeplan.context import QueryContext
    from drakeplan.search.ana_star import Limits
    from scenes.stance import Stance


class ContactPlanner(Protocol):
    """Finds contact sequences for one query. All that a query needs of a contact planner."""

    setup_s: float
    """seconds of construction, packing of the terrain included unless it was done before"""

    def start_problem(self) -> str:
        """Why the robot cannot stand at the start, "" if it can."""
        ...

    def plans(self, limits: Limits, clock: Callable[[], float] = time.perf_counter) -> Iterator[ContactPlan]:
        """Yields ever cheaper plans until a limit fires; a later call continues with all cached results.

        Args:
            limits: deadline [s], expansions and the like.
            clock: seconds; what the deadline is measured by.
        """
        ...

    def forbid(self, plan: ContactPlan, transition: int) -> None:
        """Forbids a transition that failed a later, stricter check, so that the next plan avoids it.

        Args:
            plan: one that this planner gave.
            transition: k, from stance k to stance k + 1.
        """
        ...

    def ask_for_swings(self, swing_is_clear: Callable[[Stance, Stance], bool]) -> None:
        """From now on refuses every transition whose foot or palm finds no way past the terrain.

        Args:
            swing_is_clear: whether what moves from one stance to the next finds one.
        """
        ...

    def require_static_balance(self, required: bool) -> bool:
        """Sets whether transitions must also pass static balance at their critical configurations.

        Args:
            required: whether they must.

        Returns:
            Whether that changes anything for this planner.
        """
        ...

    def why_not(self) -> str:
        """Why there is no plan, in one line."""
        ...

    def counts(self) -> PlannerCounts:
        """What the last run did."""
        ...


@dataclass(frozen=True)
class PlannerEntry:
    """A planner by name.

    Attributes:
        about: what it is, for `--help`.
        build: makes one for a query; "module:name" where the module is to be imported when the planner is first used.
        judges_transitions: whether `--dynamics` chooses what each transition must satisfy; others have dynamics of
            their own.
        kernels: "module:name" of what loads its compiled kernels (robot, inverse kinematics), beside those of every query.
    """

    about: str
    build: Callable[[QueryContext, PlannerOptions], ContactPlanner] | str
    judges_transitions: bool = False
    kernels: str = ""


PLANNERS: dict[str, PlannerEntry] = {
    "search": PlannerEntry(
        "search of contacts (ANA*)", "drakeplan.contact_planning.search_planner:build", judges_transitions=True
    ),
    "adapt": PlannerEntry(
        "a stored plan adapted to the terrain, then the search where none fits",
        "drakeplan.experience.adapt_planner:build",
        kernels="drakeplan.experience.adapt_planner:warm_up",
    ),
    "parallel": PlannerEntry(
        "search and adapt at once, the first verified plan ends the other",
        "drakeplan.contact_planning.search_planner:build",
        judges_transitions=True,
        kernels="drakeplan.experience.adapt_planner:warm_up",
    ),
    "guided": PlannerEntry(
        "segments of a guiding path of the torso, each searched or adapted",
        "drakeplan.guide.guided_planner:build",
        kernels="drakeplan.guide.warm_up:warm_up",
    ),
    "footsteps": PlannerEntry(
        "mixed-integer program of footsteps", "drakeplan.contact_planning.program_planner:build_footsteps"
    ),
    "contacts": PlannerEntry(
        "mixed-integer program of contacts with momentum", "drakeplan.contact_planning.program_planner:build_contacts"
    ),
    "gcs": PlannerEntry("graph of convex sets", "drakeplan.contact_planning.program_planner:build_convex_set_graph"),
}


def planner_entry(name: str) -> PlannerEntry:
    """The planner of this name.

    Raises:
        InputError: there is none.
    """
    if name not in PLANNERS:
        raise unknown_name("planner", name, PLANNERS)
    return PLANNERS[name]


def make_planner(name: str, context: QueryContext, options: PlannerOptions) -> ContactPlanner:
    """The planner of this name for a query.

    Args:
        name: in `PLANNERS`.
        context: of the query.
        options: what is asked of it.

    Raises:
        InputError: no such planner; start or goal missing or off the terrain; no usable weights for learned dynamics.
    """
    build = planner_entry(name).build
    return (attribute_of(build) if isinstance(build, str) else build)(context, options)


def attribute_of(address: str) -> Callable[..., Any]:
    """What "module:name" means, imported now."""
    module, _, name = address.partition(":")
    return getattr(import_module(module), name)
