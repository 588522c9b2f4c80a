"""Which convex region each planned contact takes: the binary part that both mixed-integer contact programs share.

One binary b per contact and candidate region, one of them 1. The region's edges and plane hold by big-M where b is 1,

    A_r p <= b_r + M_r (1 - b),      M_r: the most that any point of the contact's other candidates violates the row,

and the heading lies in the region's interval, with sine and cosine on the chord of that interval (Deits & Tedrake 2014
sec. IV-B), written without big-M through one share of the heading per interval.
"""

# pydrake's stubs read "float64[m, 1]" as a shape and refuse every array.
# pyright: reportArgumentType=false, reportCallIssue=false, reportAttributeAccessIssue=false

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import shapely
from pydrake.solvers import MathematicalProgram

from scenes.contact import Contact
from scenes.footholds.foothold_regions import FootholdRegion


@dataclass(frozen=True, eq=False)
class Place:
    """One contact of the program, or one that is held from the start.

    Attributes:
        effector: index into `EFFECTORS`.
        regions: candidates, in the order of `choice`.
        p: (3,) contact point [m]: variables, or numbers where it is given.
        heading: [rad], variable or number.
        cosine, sine: of the heading, on the chords; variable or number.
        choice: (R,) binary variables; empty where the contact is given.
        skipped: expression that is 1 where the contact is not made (a palm stays free, a foot stays), else 0.
        given: the contact that is held from the start.
    """

    effector: int
    regions: tuple[FootholdRegion, ...]
    p: np.ndarray
    heading: Any
    cosine: Any
    sine: Any
    choice: np.ndarray
    skipped: Any
    given: Contact | None = None

    def on(self, surface: int) -> Any:
        """Expression (or number) that is 1 where the contact lies on this surface, else 0."""
        if self.given is not None:
            return 1.0 if self.given.surface == surface else 0.0
        return sum((b for r, b in zip(self.regions, self.choice, strict=True) if r.surface == surface), start=0.0)

    def contact(self, x: np.ndarray, index: object) -> Contact | None:
        """The contact at the answer x (n,); None where it is skipped.

        Args:
            x: (n,) values of the program's variables.
            index: the program's `FindDecisionVariableIndices`.
        """
        if self.given is not None:
            return self.given
        chosen = x[index(self.choice)] > 0.5 if len(self.choice) else np.zeros(0, bool)  # type: ignore[operator]
        if not chosen.any():
            return None
        region = self.regions[int(np.argmax(chosen))]
        heading = float(x[index([self.heading])][0]) if not isinstance(self.heading, float) else self.heading  # type: ignore[operator]
        return region.contact(x[index(self.p)], float(np.clip(heading, *region.heading)))  # type: ignore[operator]


def given_place(contact: Contact, effector: int) -> Place:
    """A contact that is held from the start.

    Args:
        contact: the contact.
        effector: index of its end effector.
    """
    c, s = float(np.cos(contact.heading)), float(np.sin(contact.heading))
    return Place(effector, (), contact.p_WC, float(contact.heading), c, s, np.zeros(0, object), 0.0, contact)


def add_place(
    prog: MathematicalProgram,
    name: str,
    regions: Sequence[FootholdRegion],
    *,
    stay: Contact | None = None,
    optional: bool = False,
) -> Place:
    """Adds one contact's variables and the constraints that put it into one of the regions.

    Args:
        prog: the program that they are added to.
        name: of the contact, for variables and constraints.
        regions: candidates, not empty.
        stay: where the end effector is when the contact is skipped, which is allowed then.
        optional: whether the contact may be skipped (a palm that stays free); its point then lies anywhere among the candidates.
    """
    p = prog.NewContinuousVariables(3, f"p {name}")
    choice = prog.NewBinaryVariables(len(regions), f"choice {name}")
    shares = choice
    points = np.concatenate([r.vertices for r in regions])
    skipped: Any = 0.0
    if stay is not None or optional:
        free = prog.NewBinaryVariables(1, f"skipped {name}")
        skipped, shares = free[0], np.append(choice, free)
    if stay is not None:
        points = np.vstack([points, stay.p_WC])
    prog.AddLinearEqualityConstraint(np.ones((1, len(shares))), [1.0], shares).evaluator().set_description(
        f"one surface {name}"
    )
    low, high = points.min(axis=0), points.max(axis=0)
    prog.AddBoundingBoxConstraint(low, high, p).evaluator().set_description(f"extent {name}")
    for region, b in zip(regions, choice, strict=True):
        A = np.vstack([region.A, region.normal, -region.normal])
        limit = np.append(region.b, [region.offset, -region.offset])
        _add_big_m(prog, f"on surface {region.surface} {name}", A, limit, points, p, b)
    if stay is not None:
        A, limit = np.vstack([np.eye(3), -np.eye(3)]), np.append(stay.p_WC, -stay.p_WC)
        _add_big_m(prog, f"stays {name}", A, limit, points, p, skipped)
    heading, cosine, sine = _add_heading(prog, name, regions, choice, skipped, stay)
    return Place(regions[0].effector, tuple(regions), p, heading, cosine, sine, choice, skipped)


def _add_big_m(
    prog: MathematicalProgram, name: str, A: np.ndarray, limit: np.ndarray, points: np.ndarray, p: np.ndarray, b: Any
) -> None:
    """A p <= limit where b is 1; no more than the points (K, 3) can violate it where b is 0."""
    M = (points @ A.T).max(axis=0) - limit
    needed = M > 1e-9
    if needed.any():
        rows = np.hstack([A[needed], M[needed, None]])
        upper = limit[needed] + M[needed]
        prog.AddLinearConstraint(
            rows, np.full(len(upper), -np.inf), upper, np.append(p, b)
        ).evaluator().set_description(name)


def _add_heading(
    prog: MathematicalProgram,
    name: str,
    regions: Sequence[FootholdRegion],
    choice: np.ndarray,
    skipped: Any,
    stay: Contact | None,
) -> tuple[Any, Any, Any]:
    """Heading, cosine and sine: numbers where only one heading is possible, else variables on chords."""
    intervals = sorted({r.heading for r in regions})
    rest = stay.heading if stay is not None else None
    if len(intervals) == 1 and intervals[0][0] == intervals[0][1] and rest in (None, intervals[0][0]):
        only = float(intervals[0][0])
        return only, float(np.cos(only)), float(np.sin(only))
    heading, cosine, sine = prog.NewContinuousVariables(3, f"heading {name}")
    shares = prog.NewContinuousVariables(len(intervals), f"heading share {name}")
    chord_c: Any = 0.0
    chord_s: Any = 0.0
    total: Any = 0.0
    for (low, high), share in zip(intervals, shares, strict=True):
        weight = sum(b for r, b in zip(regions, choice, strict=True) if r.heading == (low, high))
        prog.AddLinearConstraint(share >= low * weight)
        prog.AddLinearConstraint(share <= high * weight)
        width = high - low
        slope_c = (np.cos(high) - np.cos(low)) / width if width > 0 else 0.0
        slope_s = (np.sin(high) - np.sin(low)) / width if width > 0 else 0.0
        chord_c = chord_c + slope_c * share + (np.cos(low) - slope_c * low) * weight
        chord_s = chord_s + slope_s * share + (np.sin(low) - slope_s * low) * weight
        total = total + share
    angle = rest if rest is not None else intervals[0][0]
    for variable, expression, at_rest in (
        (heading, total, angle),
        (cosine, chord_c, np.cos(angle)),
        (sine, chord_s, np.sin(angle)),
    ):
        prog.AddLinearEqualityConstraint(variable == expression + float(at_rest) * skipped)
    return heading, cosine, sine


def within(regions: Sequence[FootholdRegion], point: np.ndarray, distance: float) -> list[FootholdRegion]:
    """The regions that have a point within this horizontal distance [m] of a point (3,).

    Args:
        regions: to choose from.
        point: (3,) in W [m].
        distance: greatest horizontal distance [m].
    """
    at = shapely.Point(point[:2])
    return [r for r in regions if shapely.MultiPoint(r.vertices[:, :2]).convex_hull.distance(at) <= distance]


def reachable(
    before: Sequence[FootholdRegion], regions: Sequence[FootholdRegion], distance: float, rise: float
) -> list[FootholdRegion]:
    """The regions with a point within a horizontal distance and a height [m] of a point of any region before.

    Args:
        before: regions that the step may start from.
        regions: to choose from.
        distance: greatest horizontal distance [m].
        rise: greatest difference of height [m].
    """
    if not before:
        return []
    outlines = [shapely.MultiPoint(r.vertices[:, :2]).convex_hull for r in before]
    tree = shapely.STRtree(outlines)
    low, high = (np.array([f(r.vertices[:, 2]) for r in before]) for f in (np.min, np.max))
    found = []
    for region in regions:
        near = tree.query(shapely.MultiPoint(region.vertices[:, :2]).convex_hull, "dwithin", distance)
        bottom, top = region.vertices[:, 2].min(), region.vertices[:, 2].max()
        if ((low[near] <= top + rise) & (high[near] >= bottom - rise)).any():
            found.append(region)
    return found
