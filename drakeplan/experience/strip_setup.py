"""From a motion and a terrain to the problem of an elastic strip: configurations, contacts, and where those may go."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from drakeplan.experience.key_motion import KeyMotion
from optimization.balance.balance_regions import BalancePolygons
from optimization.balance.friction import DEFAULT_CONE, FrictionCone, frame_stands_alone
from optimization.balance.static_equilibrium import polygon_margin
from optimization.elastic_strip.problem import Gathering, StripProblem
from optimization.elastic_strip.rows import linearise, make_strip_rows
from optimization.inverse_kinematics.whole_body_ik import WholeBodyIK
from scenes.contact import Contact, contact_pose, contact_rotation
from scenes.effector import is_foot
from scenes.footholds.contact_regions import ContactRegions, cover_terrain
from scenes.robots.plant import nominal_posture
from scenes.robots.robot import Robot
from scenes.scene import Goal, Scene
from scenes.terrain.packed_terrain import PackedTerrain, near, pack_terrain
from scenes.terrain.surface import Surface
from scenes.terrain.terrain import terrain_from

START_RADIUS = 0.14  # [m] that the mean of the feet may be from the start: the verifier allows 15 cm
GOAL_SLACK = 0.005  # [m] of the goal's radius left unused
FRICTION_SHARE = 0.97  # of the friction that a contact which carries alone counts on
Choice = tuple[Contact, ContactRegions]  # where a contact goes, and the circles that it may move in


@dataclass(frozen=True)
class Sampling:
    """How far contacts may be sent.

    Attributes:
        furthest: distance (Lin 2020 eq. 4.4) beyond which a region is no place for a contact [m].
        turn: how far foot contacts may turn about their normals [rad].
    """

    furthest: float
    turn: float


def warm_up(robot: Robot, ik: WholeBodyIK) -> None:
    """Loads the compiled kernels of the elastic strip, so that their compilation does not count towards a deadline.

    Args:
        robot: whose kernels are loaded.
        ik: its inverse kinematics.
    """
    plate = np.array([[-0.2, -0.2, 0.0], [0.2, -0.2, 0.0], [0.2, 0.2, 0.0], [-0.2, 0.2, 0.0]])
    ceiling = plate[::-1] + np.array([0.1, 0.0, 0.05])
    packed = pack_terrain(terrain_from([Surface("plate", plate), Surface("ceiling", ceiling)]))
    cover_terrain(packed, robot.effectors[0], heading=0.0)
    model, q = ik.model, np.array(nominal_posture(robot))[None]
    rows = make_strip_rows(1, 4, q.shape[1] - 1)
    none = np.zeros(len(model.capsules.link), np.int64)
    linearise(model.tree, model.capsules, packed, none, q, np.ones((1, 4), bool), 0.0, 0.0, rows)
    sole = Contact("left_foot", 0, np.eye(4), 0.5)
    polygon = BalancePolygons(robot, [sole], DEFAULT_CONE)(np.array([0, -1, -1, -1]))
    polygon_margin(polygon, len(polygon), 0.0, 0.0)


def contact_choices(
    contact: Contact, robot: Robot, packed: PackedTerrain, sampling: Sampling, cone: FrictionCone | None
) -> ContactRegions:
    """Circles within reach that this contact could move to, with its heading, sorted by surface.

    Args:
        contact: of the plan that is deformed.
        robot: its contact patches.
        packed: the new terrain.
        sampling: the reach and the turn allowed.
        cone: friction cone where the contact must carry the robot alone, which steep surfaces do not allow; None
            elsewhere.
    """
    spec = next(e for e in robot.effectors if e.name == contact.effector)
    x, y, reach = contact.p_WC[0], contact.p_WC[1], sampling.furthest
    around = near(packed, x - reach, y - reach, x + reach, y + reach)
    turn = sampling.turn if is_foot(contact.effector) else 0.0
    around = around[around < packed.num_surfaces]
    outside = np.maximum(np.maximum(packed.low[around] - contact.p_WC, contact.p_WC - packed.high[around]), 0.0)
    surfaces = [int(k) for k in around[np.linalg.norm(outside, axis=1) <= reach]]
    if cone is not None:
        surfaces = [k for k in surfaces if carries_alone_on(contact, packed, k, cone)]
    regions = cover_terrain(
        packed, spec, heading=contact.heading, turn=turn, surfaces=surfaces, around=contact.p_WC, reach=reach
    )
    return regions.where(regions.distance(contact.X_WC) <= sampling.furthest)


def carries_alone_on(contact: Contact, packed: PackedTerrain, surface: int, cone: FrictionCone) -> bool:
    """Whether gravity lies in the friction cone there, with some to spare: the contact may turn a little yet.

    Args:
        contact: with its heading.
        packed: the terrain.
        surface: index of the surface.
        cone: friction cone.
    """
    R_WC = contact_rotation(contact.effector, packed.normal[surface], contact.heading)
    return frame_stands_alone(cone.code, FRICTION_SHARE * float(packed.friction[surface]), R_WC)


def settle(contact: Contact, regions: ContactRegions, packed: PackedTerrain, surface: int) -> Choice:
    """The contact projected into the nearest region of a surface, and all circles of that surface.

    Args:
        contact: of the plan that is fitted.
        regions: some of them on this surface.
        packed: the new terrain.
        surface: index of the surface.
    """
    own = regions.where(regions.surface == surface)
    point = own.project(contact.X_WC, own.nearest(contact.X_WC)[0])[:3, 3]
    X_WC = contact_pose(contact.effector, point, packed.normal[surface], contact.heading)
    return Contact(contact.effector, surface, X_WC, float(packed.friction[surface]), contact.heading), own


def make_problem(
    motion: KeyMotion,
    chosen: Sequence[Choice],
    gatherings: tuple[Gathering, ...] = (),
    *,
    balanced: bool = True,
) -> StripProblem:
    """The elastic-strip problem of a motion whose contacts move to given regions.

    Args:
        motion: contacts and configurations as they are now.
        chosen: for each contact the new one and the circles in which it may move.
        gatherings: places that the means of groups of contacts must be near.
        balanced: whether the strip is asked for balance (Lin 2020 sec. 4.5.3); else its contacts are judged afterwards
            (sec. 5.8.2).
    """
    phase, table = motion.phase, motion.phases
    held, support = table[phase].copy(), table[phase].copy()
    for n in np.flatnonzero(motion.share == 0.0):
        p = phase[n]
        if n == len(phase) - 1 or p == 0:
            continue
        before, after = table[p - 1], table[p]
        held[n] = np.where(after >= 0, after, before)
        support[n] = np.where(before == after, after, -1)
    swing = np.full((*held.shape, 2), -1)
    for n, p in enumerate(phase):
        free = held[n] < 0
        if p > 0:
            swing[n, free, 0] = table[p - 1, free]
        if p + 1 < len(table):
            swing[n, free, 1] = table[p + 1, free]
    return StripProblem(
        t=motion.t,
        q=motion.q,
        phase=phase,
        contacts=tuple(contact for contact, _ in chosen),
        planned=motion.contacts,
        regions=tuple(regions for _, regions in chosen),
        held=held,
        support=support if balanced else np.full_like(support, -1),
        swing=swing,
        share=motion.share,
        gatherings=gatherings,
    )


def start_gathering(motion: KeyMotion, scene: Scene) -> tuple[Gathering, ...]:
    """The feet of the first stance near the scene's start, where that is no stance.

    Args:
        motion: whose first stance is meant.
        scene: with the start.
    """
    if scene.start is None or scene.start.stance:
        return ()
    return (Gathering("start region", _feet(motion, 0), scene.start.xyz[:2], START_RADIUS),)


def goal_gathering(motion: KeyMotion, goal: Goal | None) -> tuple[Gathering, ...]:
    """The feet of the last stance within the goal.

    Args:
        motion: whose last stance is meant.
        goal: None for none.
    """
    if goal is None:
        return ()
    return (Gathering("goal region", _feet(motion, -1), goal.xyz[:2], max(goal.radius - GOAL_SLACK, 0.0)),)


def _feet(motion: KeyMotion, stance: int) -> tuple[int, ...]:
    return tuple(int(c) for c in motion.stances[stance, :2] if c >= 0)
