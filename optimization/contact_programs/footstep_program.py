"""Footsteps, and palms beside them, over convex regions as one mixed-integer program (Deits & Tedrake 2014).

Deits and Tedrake 2014: "Footstep planning on uneven terrain with mixed-integer convex optimization", Humanoids.
Lin 2020 sec. 2.7 describes the family, sec. 6.7.3 compares it with search.
"""

# pydrake's stubs read "float64[m, 1]" as a shape and refuse every array.
# pyright: reportArgumentType=false, reportCallIssue=false, reportAttributeAccessIssue=false

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np
from pydrake.solvers import MathematicalProgram
from pydrake.symbolic import Expression

from optimization.balance.friction import frame_stands_alone, stands_alone
from optimization.contact_programs.contact_choice import Place, add_place, given_place, reachable, within
from optimization.contact_programs.contact_query import (
    GOAL_YAW_TOLERANCE,
    SAME_PLACE,
    ContactEstimate,
    ContactQuery,
    FootstepOptions,
    movers,
)
from optimization.mixed_integer.data import MixedIntegerData
from optimization.mixed_integer.solver import MixedIntegerSettings, Progress, solve_mixed_integer
from scenes.effector import EFFECTORS
from scenes.footholds.foothold_regions import FootholdRegion, foothold_regions
from scenes.scene import GOAL_HEIGHT
from scenes.stance import Stance


class FootstepProgram:
    """Places a given number of contacts, feet in turn, on convex regions.

        min   sum_i w_step |p_i - p_old(i)|^2 + w_turn (theta_i - theta_stand(i))^2 + w_goal |mean - goal|^2 + counts
        s.t.  p_i in region r where b_ir = 1, sum_r b_ir = 1                        one surface, big-M
              c_i, s_i on the chord of cos, sin over the heading's interval         piecewise rotation
              |p_i - p_stand - R(theta_stand) o_k| <= r_k, k = 1, 2                 reach: a lens, second order
              |z_i - z_stand| <= rise,  |p_i - p_old| <= stride                     step
              |p_palm - mean - R(theta) shoulder| <= arm + M free                   held palms, second order
              |mean of the last feet - goal| <= radius, in height <= 0.5 m          goal

    Deits & Tedrake 2014, eq. 1-13, with surfaces shrunk by the sole at every heading of the interval in place of IRIS
    regions. Decision variables: per contact p (3) [m], heading, cosine, sine, and one binary per candidate region.

    Attributes:
        prog: the program.
        places: the contacts in their order.
        last: by end effector, the place that it holds at the end.
        reason: "" or why the geometry alone leaves no answer.
    """

    def __init__(self, query: ContactQuery, options: FootstepOptions | None = None, *, standing: bool = True) -> None:
        """Builds the program.

        Args:
            query: terrain, robot, start, goal.
            options: see `FootstepOptions`.
            standing: leave out surfaces on which one foot cannot carry the weight at rest.
        """
        self.query, self.options = query, options or FootstepOptions()
        self.prog = MathematicalProgram()
        self.reason = ""
        self._standing = standing
        self.movers = movers(self.options)
        self.last: dict[int, Place] = {
            e: given_place(c, e) for e, c in enumerate(query.start.contacts) if c is not None
        }
        self.places: list[Place] = []
        self.held: list[dict[int, Place]] = []  # by contact: everything held once it is made
        self._regions = {e: self._candidates(e) for e in sorted(set(self.movers))}
        self._chain = self._chains()
        with np.errstate(invalid="ignore"):  # arithmetic of arrays of variables sets the flag without a NaN anywhere
            for i, mover in enumerate(self.movers):
                if not self._add_contact(i, mover):
                    return
            self._add_goal()

    # Variables --------------------------------------------------------------------------------------------------

    def _candidates(self, effector: int) -> list[FootholdRegion]:
        start = self.query.feet[0]
        headings = self.options.headings or ((start.heading, start.heading),)
        alone = self._standing and effector < 2 and not self.options.palms
        holds = partial(stands_alone, self.query.cone) if alone else None
        packed, robot = self.query.packed, self.query.robot
        return [r for h in headings for r in foothold_regions(packed, robot, effector, h, holds=holds)]

    def _add_contact(self, i: int, mover: int) -> bool:
        """The i-th contact; False where no surface is near enough to be its own."""
        name = f"{EFFECTORS[mover]}[{i}]"
        regions = self._near(i, mover)
        old = self.last.get(mover)
        start = self.query.start.contacts[mover]
        if not regions and not (mover >= 2 or self.options.trim):
            self.reason = f"contact {i} ({EFFECTORS[mover]}): no surface takes it within reach of start and goal"
            return False
        if not regions:
            regions = self._regions[mover]
        if not regions:
            self.reason = f"no surface takes the {EFFECTORS[mover]}"
            return False
        stay = start if self.options.trim and mover < 2 else None
        place = add_place(self.prog, name, regions, stay=stay, optional=mover >= 2)
        self.places.append(place)
        if mover < 2:
            self._add_step(name, place, self.last[1 - mover], old)
        elif old is not None:
            self._add_stride(name, place, old, self.query.reach.palm_stride, place.skipped + old.skipped)
        self.last[mover] = place
        self.held.append(dict(self.last))
        for palm in (2, 3):
            if palm in self.last:
                self._add_arm(f"{name} {EFFECTORS[palm]}", self.last[palm])
        self._add_order(i, mover)
        self._add_costs(place, old)
        return True

    def _near(self, i: int, mover: int) -> list[FootholdRegion]:
        """Regions that a chain of steps from the start reaches by then and from which one reaches the goal.

        The others are never chosen; leaving them out leaves out their binaries.
        """
        if mover < 2:
            return self._chain[sum(m < 2 for m in self.movers[:i])]
        reach, feet = self.query.reach, [m < 2 for m in self.movers]
        slack = reach.arm + float(np.hypot(*reach.shoulder[:2])) + 0.5 * reach.farthest
        stand = self.query.feet[1 - self.options.first]
        regions = within(self._regions[mover], stand.p_WC, reach.farthest * sum(feet[: i + 1]) + slack)
        to_goal = self.query.goal.radius + reach.farthest * (sum(feet[i + 1 :]) + 0.5) + slack
        return within(regions, np.array(self.query.goal.xyz), to_goal)

    def _chains(self) -> list[list[FootholdRegion]]:
        """By foot contact: the regions on some chain of steps, each within reach of the one before, from start to goal."""
        reach, goal = self.query.reach, self.query.goal
        order = [m for m in self.movers if m < 2]
        if not order:
            return []
        start = self.query.feet[1 - order[0]]
        first = within(self._regions[order[0]], start.p_WC, reach.farthest + SAME_PLACE)
        forward = [first]
        for mover in order[1:]:
            near = reachable(forward[-1], self._regions[mover], reach.farthest + SAME_PLACE, reach.rise)
            if self.options.trim:  # what is left out at the beginning may be followed by any first step
                both = [c.p_WC for c in self.query.feet]
                also = [r for p in both for r in within(self._regions[mover], p, reach.farthest + SAME_PLACE)]
                near = [r for r in self._regions[mover] if any(r is k for k in (*near, *also))]
            forward.append(near)
        last = within(forward[-1], np.array(goal.xyz), goal.radius + 0.5 * reach.farthest + SAME_PLACE)
        backward = [last]
        for k in range(len(order) - 2, -1, -1):
            near = reachable(backward[0], forward[k], reach.farthest + SAME_PLACE, reach.rise)
            backward.insert(0, near)
        return backward

    # Constraints ------------------------------------------------------------------------------------------------

    def _add_step(self, name: str, place: Place, stand: Place, old: Place) -> None:
        """Reach from the standing foot, turn, and the stride from where the foot was."""
        reach, side = self.query.reach, 1.0 if place.effector == 0 else -1.0
        c, s = stand.cosine, stand.sine
        apart = place.p - stand.p
        for k, (o, radius) in enumerate(reach.discs(side)):
            rows = [
                radius + self._start_lack(k, side) * place.skipped,
                apart[0] - (c * o[0] - s * o[1]),
                apart[1] - (s * o[0] + c * o[1]),
            ]
            _cone(self.prog, rows, f"reach {k} {name}")
        self._narrow(name, place, stand, apart, side)
        self._add_support(name, stand)
        left, right = (c.p_WC for c in self.query.feet)
        lack = max(abs(left[2] - right[2]) - reach.rise, 0.0) * place.skipped
        _between(self.prog, apart[2], -reach.rise - lack, reach.rise + lack, f"rise {name}")
        if not isinstance(place.heading, float) or not isinstance(stand.heading, float):
            turn = side * (place.heading - stand.heading)  # type: ignore[operator]
            lack = 2 * np.pi * place.skipped
            _between(self.prog, turn, -reach.turn_in - lack, reach.turn_out + lack, f"turn {name}")
        self._add_stride(name, place, old, reach.stride, 0.0)

    def _add_support(self, name: str, stand: Place) -> None:
        """While a foot swings, some palm is held if the other foot alone could not carry the weight at rest."""
        if not (self._standing and self.options.palms):
            return
        cone = self.query.cone.code

        def steep(friction: float, R_WC: np.ndarray) -> bool:
            return not frame_stands_alone(cone, friction, np.ascontiguousarray(R_WC))

        if stand.given is not None:
            needs: Any = float(steep(stand.given.friction, stand.given.R_WC))
        else:
            chosen = zip(stand.regions, stand.choice, strict=True)
            needs = sum((b for r, b in chosen if steep(r.friction, r.R_WC)), start=0.0)
        palms = [self.last[e] for e in (2, 3) if e in self.last]
        held = sum((1.0 - p.skipped for p in palms), start=0.0)
        if isinstance(held, float) and isinstance(needs, float):
            if held < needs:
                self.reason = f"{name}: neither foot nor palm can carry the weight while the other foot swings"
            return
        self.prog.AddLinearConstraint(held - needs, 0.0, np.inf).evaluator().set_description(f"support {name}")

    def _narrow(self, name: str, place: Place, stand: Place, apart: np.ndarray, side: float) -> None:
        """Less reach, or none, while the feet stand on a pair of surfaces where stances have failed."""
        for surfaces, share in self.query.narrowed.items():
            here, there = surfaces if place.effector == 0 else surfaces[::-1]
            both: Any = 2.0 - place.on(here) - stand.on(there)  # 0 where the pair is chosen
            if share <= 0:
                if not isinstance(both, float):
                    self.prog.AddLinearConstraint(both, 1.0, 2.0)
                continue
            c, s = stand.cosine, stand.sine
            for k, (o, radius) in enumerate(self.query.reach.scaled(share).discs(side)):
                off = [apart[0] - (c * o[0] - s * o[1]), apart[1] - (s * o[0] + c * o[1])]
                free = (2.0 * self.query.reach.farthest + 2.0 * radius) * both
                _cone(self.prog, [radius + free, *off], f"narrowed reach {k} {name}")

    def _start_lack(self, k: int, side: float) -> float:
        """What the start stance lacks to satisfy disc k of the reach: a foot that stays may keep it."""
        left, right = self.query.feet
        foot, stand = (left, right) if side > 0 else (right, left)
        o, radius = self.query.reach.discs(side)[k]
        c, s = np.cos(stand.heading), np.sin(stand.heading)
        apart = foot.p_WC[:2] - stand.p_WC[:2] - [c * o[0] - s * o[1], s * o[0] + c * o[1]]
        return max(float(np.linalg.norm(apart)) - radius, 0.0) + SAME_PLACE

    def _add_stride(self, name: str, place: Place, old: Place, stride: float, free: Any) -> None:
        """|p - p_old| <= stride; contacts that are not made (free >= 1) are not held to it."""
        far = float(np.linalg.norm(np.subtract(*self.query.terrain.extent)))
        _cone(self.prog, [stride + far * free, *(place.p - old.p)], f"stride {name}")

    def _add_arm(self, name: str, palm: Place) -> None:
        """|p_palm - mean - R(theta) shoulder| <= arm, unless the palm is free; theta is the mean heading of the feet."""
        left, right = self.last[0], self.last[1]
        side = 1.0 if palm.effector == 2 else -1.0
        x, y, z = self.query.reach.shoulder * np.array([1.0, side, 1.0])
        c, s = 0.5 * (left.cosine + right.cosine), 0.5 * (left.sine + right.sine)  # type: ignore[operator]
        shoulder = 0.5 * (left.p + right.p) + np.array([c * x - s * y, s * x + c * y, z])
        far = float(np.linalg.norm(np.subtract(*self.query.terrain.extent))) + z
        _cone(self.prog, [self.query.reach.arm + far * palm.skipped, *(palm.p - shoulder)], f"arm {name}")

    def _add_order(self, i: int, mover: int) -> None:
        """A foot may stay only while every foot before it stays: contacts left out are the first."""
        if not self.options.trim or mover >= 2:
            return
        before = [p for p in self.places[:-1] if p.effector < 2]
        if before:
            self.prog.AddLinearConstraint(before[-1].skipped - self.places[-1].skipped, 0.0, 1.0)

    def _add_goal(self) -> None:
        goal, last = self.query.goal, self.last
        mean = 0.5 * (last[0].p + last[1].p) - np.array([*goal.xyz[:2], 0.0])
        _cone(self.prog, [goal.radius - SAME_PLACE, mean[0], mean[1]], "goal")
        self.prog.AddQuadraticCost(self.options.goal * (mean[0] ** 2 + mean[1] ** 2), True)
        if np.isfinite(goal.xyz[2]):
            _between(self.prog, mean[2] - goal.xyz[2], -GOAL_HEIGHT, GOAL_HEIGHT, "goal height")
        if goal.yaw is None:
            return
        turn = 0.5 * (last[0].heading + last[1].heading) - goal.yaw  # type: ignore[operator]
        if isinstance(turn, float):
            if abs((turn + np.pi) % (2 * np.pi) - np.pi) > GOAL_YAW_TOLERANCE:
                self.reason = f"the goal's heading {goal.yaw:g} rad is none of the headings {self.options.headings}"
            return
        _between(self.prog, turn, -GOAL_YAW_TOLERANCE, GOAL_YAW_TOLERANCE, "goal heading")

    # Costs ------------------------------------------------------------------------------------------------------

    def _add_costs(self, place: Place, old: Place | None) -> None:
        weights = self.options
        if old is not None:
            step = place.p - old.p
            self.prog.AddQuadraticCost(weights.step * sum(d * d for d in step), True)
        if place.effector < 2:
            turn = place.heading - self.last[1 - place.effector].heading  # type: ignore[operator]
            if not isinstance(turn, float):
                self.prog.AddQuadraticCost(weights.turn * turn * turn, True)
        if not isinstance(place.skipped, float):
            count = weights.contact if place.effector < 2 else -weights.free_palm
            self.prog.AddLinearCost(count * (1.0 - place.skipped))

    # Answers ----------------------------------------------------------------------------------------------------

    def forbid(self, choices: dict[int, int]) -> None:
        """Bars an assignment: contact number -> surface; at least one of them must change.

        Raises:
            ValueError: empty, or a surface that none of the contact's regions lies on (nothing would be barred).
        """
        terms = []
        for i, surface in choices.items():
            place = self.places[i]
            terms.append(sum(b for r, b in zip(place.regions, place.choice, strict=True) if r.surface == surface))
        if not terms or any(isinstance(t, int) for t in terms):
            raise ValueError(f"cannot bar {choices}: a contact has no region on its surface")
        self.prog.AddLinearConstraint(sum(terms) <= len(terms) - 1)

    def stances(self, x: np.ndarray) -> tuple[Stance, ...]:
        """The stances of an answer x (n,); contacts that stay where they are, are none."""
        index = self.prog.FindDecisionVariableIndices
        found = [self.query.start]
        for place in self.places:
            contact, held = place.contact(x, index), found[-1].contacts[place.effector]
            if contact is None and (place.effector < 2 or held is None):
                continue
            if contact is not None and held is not None and contact.surface == held.surface:
                moved = np.linalg.norm(contact.p_WC - held.p_WC)
                if moved < SAME_PLACE and abs(contact.heading - held.heading) < SAME_PLACE:
                    continue
            found.append(found[-1].replace(place.effector, contact))
        return tuple(found)

    def solve(
        self,
        settings: MixedIntegerSettings | None = None,
        on_incumbent: Callable[[Progress, tuple[Stance, ...]], None] | None = None,
        stop: Callable[[], bool] | None = None,
        *,
        data: MixedIntegerData | None = None,
    ) -> ContactEstimate:
        """The contact sequence, or why there is none.

        Args:
            settings: solver and limits.
            on_incumbent: called with every better sequence while the solver runs.
            stop: polled; True ends the solve as its time limit does.
            data: the program's numbers, where the caller has them and adds something to them.
        """
        if self.reason:
            return ContactEstimate(False, (), np.inf, False, self.reason, None)

        def tell(progress: Progress, x: np.ndarray | None) -> None:
            if x is not None and on_incumbent is not None:
                on_incumbent(progress, self.stances(x))

        record = solve_mixed_integer(data or self.prog, settings, on_progress=tell, stop=stop)
        limited = record.status == "time limit"
        if record.x is None:
            return ContactEstimate(False, (), np.inf, limited, record.message, record)
        return ContactEstimate(True, self.stances(record.x), record.cost, limited, "", record)


def _cone(prog: MathematicalProgram, rows: list[Any], name: str) -> None:
    """rows[0] >= |rows[1:]|."""
    expressions = np.array([Expression(r) if not isinstance(r, Expression) else r for r in rows])
    prog.AddLorentzConeConstraint(expressions).evaluator().set_description(name)


def _between(prog: MathematicalProgram, value: Any, low: Any, high: Any, name: str) -> None:
    """low <= value <= high, all of them linear expressions or numbers."""
    for expression in (value - low, high - value):
        prog.AddLinearConstraint(expression, 0.0, np.inf).evaluator().set_description(name)
