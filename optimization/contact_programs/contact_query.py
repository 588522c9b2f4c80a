"""What a contact program is asked, what it costs, and what it answers: shared by all formulations of footsteps."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from optimization.balance.friction import DEFAULT_CONE, FrictionCone
from optimization.contact_programs.step_reach import StepReach
from optimization.mixed_integer.solver import MixedIntegerRecord
from scenes.contact import Contact
from scenes.input_error import InputError
from scenes.robots.robot import Robot
from scenes.scene import Goal
from scenes.stance import Stance
from scenes.terrain.packed_terrain import PackedTerrain, pack_terrain
from scenes.terrain.terrain import Terrain

GOAL_YAW_TOLERANCE = np.deg2rad(15.0)
SAME_PLACE = 1e-3  # [m, rad] a contact that moves less than this has not moved


@dataclass(frozen=True, eq=False)
class ContactQuery:
    """What a mixed-integer contact program is asked.

    Attributes:
        terrain: surfaces.
        robot: who crosses.
        start: the first stance, both feet held.
        goal: where the mean of the feet ends.
        reach: of steps and palms.
        cone: friction cone.
        narrowed: by surfaces of left and right foot: the share of the reach that is left while the feet stand on these,
            because stances at its edge have failed a stricter check; 0 bars the pair.

    Raises:
        InputError: a foot is in the air at the start, or a number is not finite.
    """

    terrain: Terrain
    robot: Robot
    start: Stance
    goal: Goal
    reach: StepReach
    cone: FrictionCone = DEFAULT_CONE
    narrowed: Mapping[tuple[int, int], float] = field(default_factory=dict)

    def __post_init__(self) -> None:
        object.__setattr__(self, "cone", FrictionCone(self.cone))  # a name is taken too
        if self.start.contacts[0] is None or self.start.contacts[1] is None:
            raise InputError("mixed-integer planner: start: expected both feet on the ground")
        if not np.isfinite([*self.goal.xyz[:2], self.goal.radius]).all() or self.goal.radius <= 0:
            raise InputError(f"mixed-integer planner: goal: expected finite numbers and a radius > 0, got {self.goal}")

    @cached_property
    def packed(self) -> PackedTerrain:
        """The terrain as arrays."""
        return pack_terrain(self.terrain)

    @property
    def feet(self) -> tuple[Contact, Contact]:
        """The contacts of left and right foot at the start."""
        left, right = self.start.contacts[:2]
        assert left is not None
        assert right is not None
        return left, right


@dataclass(frozen=True)
class FootstepOptions:
    """What to plan and what it costs.

    Attributes:
        num_contacts: contacts placed, feet and palms together; the documents' 12, 18 and 24.
        first: the foot that moves first (0 left, 1 right).
        palms: palms that may be used (2 left, 3 right); each follows the foot of its side in the sequence.
        headings: intervals of heading [rad], one piece of the rotation each; empty means the start's heading alone.
        trim: lets the first contacts of the sequence stay where they are, so that `num_contacts` is only the most.
        step: cost of a squared translation [1/m^2].
        turn: cost of a squared turn between the feet [1/rad^2].
        goal: cost of the squared distance from the goal [1/m^2].
        contact: cost of every contact that is made; counts only where contacts may be left out.
        free_palm: cost of leaving a palm free for one turn.
    """

    num_contacts: int = 12
    first: int = 0
    palms: tuple[int, ...] = ()
    headings: tuple[tuple[float, float], ...] = ()
    trim: bool = False
    step: float = 1.0
    turn: float = 0.3
    goal: float = 1.0
    contact: float = 0.5
    free_palm: float = 1.0

    def __post_init__(self) -> None:
        if self.num_contacts < 1:
            raise InputError(f"mixed-integer planner: num_contacts: expected 1 or more, got {self.num_contacts}")
        if self.first not in (0, 1) or not set(self.palms) <= {2, 3}:
            raise InputError(
                f"mixed-integer planner: first foot {self.first} and palms {self.palms}: expected 0 or 1, and of 2, 3"
            )
        if any(not np.isfinite(h).all() or h[0] > h[1] for h in self.headings):
            raise InputError(f"mixed-integer planner: headings: expected (low, high) in rad, got {self.headings}")


@dataclass(frozen=True, eq=False)
class ContactEstimate:
    """What a mixed-integer contact program says.

    Attributes:
        feasible: whether there is a contact sequence.
        stances: from start to goal, consecutive ones differ in one end effector; empty where there is none.
        cost: of the program; inf where there is no answer.
        limited: the time limit fired: the sequence is the incumbent, not the optimum.
        reason: why there is none, "" where there is one.
        record: what was run; None where the geometry alone says no.
    """

    feasible: bool
    stances: tuple[Stance, ...]
    cost: float
    limited: bool
    reason: str
    record: MixedIntegerRecord | None


def movers(options: FootstepOptions) -> list[int]:
    """(num_contacts,) who moves: feet in turn, each followed by the palm of its side where that may be used."""
    cycle = []
    for foot in (options.first, 1 - options.first):
        cycle += [foot] + [2 + foot] * (2 + foot in options.palms)
    return [cycle[k % len(cycle)] for k in range(options.num_contacts)]
