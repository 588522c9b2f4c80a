"""Which of the two sides of a plane in a cloud is the outer one."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial import KDTree

from scenes.imports.cloud_planes import CloudPlanes

UPRIGHT = np.cos(np.deg2rad(45.0))  # planes whose normal has a smaller upward part are walls
FRONT = 0.3  # [m] in front of a wall and behind it the ground is compared
ABOUT = 0.15  # [m] and so far over and under it
FOOT = 2.0  # weight of ground at the foot of a wall over ground at its top, which may be an upper floor
PLACES = 24  # of a wall, at which it is
FLOOR_POINTS = 40_000


@dataclass(frozen=True, eq=False)
class OuterSides:
    """What tells the outer side of planes.

    Attributes:
        points: (N, 3) of the cloud [m].
        floor: (F, 3) points of its level planes [m].
        tree: of those, seen from above; None where there are none.
        normals: (N, 3) that the file gives, None without.
        viewpoint: (3,) of the sensor [m], None where it is not known.
    """

    points: np.ndarray
    floor: np.ndarray
    tree: KDTree | None
    normals: np.ndarray | None
    viewpoint: np.ndarray | None

    @staticmethod
    def of(
        points: np.ndarray, planes: CloudPlanes, normals: np.ndarray | None, viewpoint: np.ndarray | None
    ) -> OuterSides:
        """For the planes of a cloud.

        Args:
            points: (N, 3) of the cloud [m].
            planes: its planes.
            normals: (N, 3) that the file gives, None without.
            viewpoint: (3,) of the sensor [m], None where it is not known.
        """
        level = np.append(np.abs(planes.axes[:, 2, 2]) >= UPRIGHT, False)[planes.plane]
        some = np.flatnonzero(level)
        floor = points[some[:: max(1, len(some) // FLOOR_POINTS)]]
        return OuterSides(points, floor, KDTree(floor[:, :2]) if len(floor) else None, normals, viewpoint)

    def outward(self, normal: np.ndarray, own: np.ndarray) -> np.ndarray:
        """(3,) the outer one of the two normals of a plane.

        What the file says counts, then the sensor's place. Without either, level planes look up; before a wall there is
        ground at its foot, behind it there is none, or ground at its top.

        Args:
            normal: (3,) one of the two.
            own: (n,) the plane's points.
        """
        middle = self.points[own].mean(axis=0)
        hint = None
        if self.normals is not None:
            hint = self.normals[own].mean(axis=0)
        elif self.viewpoint is not None:
            hint = self.viewpoint - middle
        if hint is not None and abs(hint @ normal) > 1e-9:
            return normal if hint @ normal > 0 else -normal
        if abs(normal[2]) >= UPRIGHT:
            return normal if normal[2] > 0 else -normal
        return normal if self._ground_in_front(normal, own) >= 0 else -normal

    def _ground_in_front(self, normal: np.ndarray, own: np.ndarray) -> float:
        """More than 0 where the ground at the foot of a wall is on the side of its normal, and that at its top behind."""
        if self.tree is None:
            return 0.0
        height = self.points[own, 2]
        low, high = np.percentile(height, [2, 98])
        places = self.points[own[np.linspace(0, len(own) - 1, min(PLACES, len(own))).astype(int)]]
        score = 0.0
        for place, near in zip(places, self.tree.query_ball_point(places[:, :2], FRONT), strict=True):
            ground = self.floor[near]
            ground = ground[(ground[:, 2] > low - ABOUT) & (ground[:, 2] < high + ABOUT)]
            side = np.sign((ground[:, :2] - place[:2]) @ normal[:2])
            score += float((side * np.where(ground[:, 2] < (low + high) / 2, FOOT, -1.0)).sum())
        return score
