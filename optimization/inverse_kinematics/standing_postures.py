"""Ways to stand: upright first, then with arms that hang or are held before the chest, then lower and lower.

Under a ceiling or beside a wall the nominal posture is in the way. Each of these postures holds the soles where the nominal
one has them, with the CoM over the same point, lower by a drop, and the body clear of itself:

    drop      0, DROP, 2 DROP, ...   up to what the robot's least CoM height leaves
    arms      as in the nominal posture, hanging, before the chest

What a place asks for is looked up in that order: the first posture whose trunk, head and arms are free there.
"""

from __future__ import annotations

import copy
from collections.abc import Sequence
from functools import cached_property, lru_cache

import numpy as np

from optimization.inverse_kinematics.frame_task import LEVER, TrackingTargets
from optimization.inverse_kinematics.posture_tracking import track_postures
from optimization.inverse_kinematics.whole_body_ik import WholeBodyIK
from optimization.multibody.inside_solids import inside_solids
from optimization.multibody.kinematics import limb_links
from optimization.multibody.terrain_clearance import penetration
from scenes.effector import LEFT_PALM
from scenes.terrain.packed_terrain import PackedTerrain

Way = tuple[int, int]
NOMINAL: Way = (0, 0)
AS_NOMINAL, HANG, BEFORE_CHEST = PREFERRED = (0, 1, 2)  # what arms do
DROP = 0.05  # [m] from one height to the next
SITTING = 0.2  # [m] lowered further, the thighs come up to where arms hang: the other order is preferred
CLEAR = 0.03  # [m] that trunk, head and arms keep from the terrain
NEARLY = 0.015  # [m] of that which the trunk may lack before the robot lowers itself
HOLD, COM, UPRIGHT, POSTURE, PALM = 300.0, 30.0, 0.6, 0.1, 2.0  # weights of soles, CoM, base, joints, palms
SLACK = 0.05  # [rad] of every joint's range left unused
HANGING = (0.0, 0.06, -0.95)  # a hanging palm from its shoulder: forward and outward [m], up [arm lengths]
AT_CHEST = (0.26, -0.13, -0.28)  # a palm before the chest from its shoulder: forward, outward, up [m]


class StandingPostures:
    """The ways in which one robot stands, computed where they are first needed.

    A way to stand is a pair: how many times `DROP` the robot is lowered, and what its arms do.

    Attributes:
        ik: its inverse kinematics.
        drops: how many heights there are.
    """

    def __init__(self, ik: WholeBodyIK) -> None:
        """Prepares them for a robot.

        Args:
            ik: its inverse kinematics.
        """
        self.ik = ik
        tree, capsules, robot = ik.model.tree, ik.model.capsules, ik.robot
        legs, arms = ({link for e in pair for link in limb_links(tree, e)} for pair in ((0, 1), robot.palms))
        link = ik.kinematics.bodies[robot.torso_body][0]
        while link > 0:  # the torso and what carries it is no arm's
            arms.discard(link)
            link = int(tree.parent[link])
        self._upper = ~np.isin(capsules.link, list(legs))
        self._trunk = self._upper & ~np.isin(capsules.link, list(arms))
        self._wide = capsules._replace(radius=capsules.radius + CLEAR, reach=capsules.reach + CLEAR)
        self.drops = 1 + int((robot.com_height[1] - robot.com_height[0]) / DROP + 1e-6)

    @cached_property
    def postures(self) -> dict[Way, np.ndarray]:
        """(nq,) each posture over the origin, heading along x; those that the robot cannot take are left out."""
        ways, wanted = self._targets()
        nominal = self.ik.model.q_nominal
        found = track_postures(self.ik.model.tree, wanted, np.tile(nominal, (len(ways), 1)), max_iterations=60)
        feet = np.array([True, True, False, False])
        postures = {NOMINAL: nominal}
        for k, (way, q) in enumerate(zip(ways, found.q, strict=True)):
            own = copy.copy(self.ik)  # stays near the posture that was found, not near the nominal one
            own.model = self.ik.model._replace(q_nominal=q)
            answer = own.solve(wanted.X_WE[k], feet, None, q, com_target=wanted.com[k])
            if answer.ok:
                postures[way] = answer.q
        return postures

    def over(self, way: Way, place: np.ndarray, heading: float) -> np.ndarray:
        """(nq,) a posture moved to a place and heading.

        Args:
            way: to stand.
            place: (3,) mean of the feet in W [m].
            heading: about W's z [rad].
        """
        q = self.ik.model.q_nominal if way == NOMINAL else self.postures[way]  # others are made where one is needed
        return standing_over(q, place, heading)

    def is_free(self, packed: PackedTerrain, q: np.ndarray) -> bool:
        """Whether trunk, head and arms keep `CLEAR` from the terrain.

        Args:
            packed: the terrain.
            q: (nq,) posture.
        """
        return self._depth(packed, q, self._upper) < 0.0

    def is_inside(self, packed: PackedTerrain, q: np.ndarray) -> bool:
        """Whether a part of trunk, head or arms is inside a solid.

        Args:
            packed: the terrain.
            q: (nq,) posture.
        """
        return bool(inside_solids(self.ik.model.tree, self.ik.model.capsules, self._upper, packed, q))

    def way_at(self, packed: PackedTerrain, places: Sequence[tuple[np.ndarray, float]]) -> Way:
        """The first way to stand that is free at all places, or the one that is least in the terrain.

        The robot is lowered only where that helps the trunk, and no further than needed; then arms are chosen.

        Args:
            packed: the terrain.
            places: (3,) points in W over which the CoM is, at the height of the soles [m], each with a heading [rad].
        """
        if all(self.is_free(packed, self.over(NOMINAL, *place)) for place in places):
            return NOMINAL
        drop = max(self._drop_at(packed, *place) for place in places)
        ways = [way for way in self.postures if way[0] == drop]
        worst = [max(self._depth(packed, self.over(way, *place), self._upper) for place in places) for way in ways]
        return next((way for way, depth in zip(ways, worst, strict=True) if depth < 0.0), ways[int(np.argmin(worst))])

    def _drop_at(self, packed: PackedTerrain, place: np.ndarray, heading: float) -> int:
        """The least drop with which the trunk is free at a place, or no deeper in the terrain than lower."""
        depths: dict[int, float] = {}
        for way in self.postures:
            if way[0] in depths:
                continue
            depths[way[0]] = self._depth(packed, self.over(way, place, heading), self._trunk)
            if depths[way[0]] <= NEARLY:
                return way[0]
        least = min(depths.values())
        return next(drop for drop, depth in depths.items() if depth <= least + NEARLY)

    def _depth(self, packed: PackedTerrain, q: np.ndarray, counted: np.ndarray) -> float:
        """How much some shapes lack of being `CLEAR` of the terrain [m]; negative where nothing, inf inside a solid."""
        tree = self.ik.model.tree
        if inside_solids(tree, self.ik.model.capsules, counted, packed, q):
            return np.inf
        return float(penetration(tree, self._wide, counted, packed, q))

    def _targets(self) -> tuple[list[Way], TrackingTargets]:
        """Soles, CoM and palms of all ways to stand but the nominal one."""
        ik, robot = self.ik, self.ik.robot
        tree, nominal = ik.model.tree, ik.model.q_nominal
        X_WE, com = ik.kinematics.effector_poses(nominal), ik.kinematics.com(nominal)
        ways = [(0, arms) for arms in PREFERRED[1:]] if robot.palms else []
        for drop in range(1, self.drops):
            preferred = PREFERRED if drop * DROP <= SITTING else PREFERRED[::-1]
            ways += [(drop, arms) for arms in (preferred if robot.palms else PREFERRED[:1])]
        X, place = np.tile(X_WE, (len(ways), 1, 1, 1)), np.zeros((len(ways), len(X_WE)))
        goal, place[:, :2] = np.tile(com, (len(ways), 1)), HOLD
        for k, (drop, arms) in enumerate(ways):
            goal[k, 2] -= drop * DROP
            for e in robot.palms if arms != AS_NOMINAL else ():
                away = (
                    np.array(AT_CHEST) if arms == BEFORE_CHEST else np.array(HANGING) * [1.0, 1.0, robot.arm_reach[1]]
                )
                side = 1.0 if e == LEFT_PALM else -1.0
                X[k, e, :3, 3] = (robot.shoulder + away) * [1.0, side, 1.0] - [0.0, 0.0, drop * DROP]
                place[k, e] = PALM
        turn = np.where(place == HOLD, LEVER * HOLD, 0.0)
        weight = np.concatenate([np.full(3, UPRIGHT), np.zeros(3), np.full(len(tree.lower), POSTURE)])
        reference = np.tile(nominal, (len(ways), 1))
        limits = tree.lower + SLACK, tree.upper - SLACK
        return ways, TrackingTargets(X, place, turn, goal, np.full((len(ways), 3), COM), reference, weight, *limits)


@lru_cache(maxsize=8)
def standing_postures(ik: WholeBodyIK) -> StandingPostures:
    """The ways to stand of the robot of these inverse kinematics, computed once."""
    return StandingPostures(ik)


def standing_over(q_nominal: np.ndarray, feet_mean: np.ndarray, heading: float) -> np.ndarray:
    """(nq,) a posture over the origin moved to a position and heading.

    Args:
        q_nominal: (nq,) the posture, Drake's order, at the origin with heading zero.
        feet_mean: (3,) mean of the feet in W [m].
        heading: about W's z [rad].
    """
    q = np.array(q_nominal)
    w0, x0, y0, z0 = q_nominal[:4]
    c, s = np.cos(heading / 2), np.sin(heading / 2)
    q[:4] = [c * w0 - s * z0, c * x0 - s * y0, c * y0 + s * x0, c * z0 + s * w0]
    x, y = q_nominal[4:6]
    c, s = np.cos(heading), np.sin(heading)
    q[4:7] = feet_mean + np.array([c * x - s * y, s * x + c * y, q_nominal[6]])
    return q
