"""Which bodies come near each other in which configurations, and the rows that keep them apart."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from optimization.inverse_kinematics.frame_task import DistanceRows
from optimization.multibody.kinematics import Kinematics
from optimization.multibody.robot_shapes import read_shapes
from optimization.multibody.self_distance import near_itself
from optimization.multibody.terrain_distance import near_terrain
from scenes.robots.nominal_distances import nominal_distances
from scenes.robots.plant import RobotPlant
from scenes.terrain.packed_terrain import PackedTerrain, polygon_names
from scenes.terrain.terrain import Terrain

KEEP = 30.0  # weight of a distance [1/m]
TERRAIN = -1  # the "link" of everything that stands still


@dataclass(frozen=True, eq=False)
class Encounters:
    """R pairs of geometries that are near each other, sorted by frame.

    Attributes:
        frame: (R,) index of the configuration.
        distance: (R,) signed [m]; negative is penetration.
        link: (R, 2) links of the kinematic tree, `TERRAIN` for what stands still.
        point: (R, 2, 3) the witness points in those links' frames, in W for the terrain [m].
        normal: (R, 3) unit vector in W from the second body to the first.
        effector: (R,) the end effector whose foot or hand meets the terrain, -1 for every other pair.
        bodies: (R,) names of the two bodies.
    """

    frame: np.ndarray
    distance: np.ndarray
    link: np.ndarray
    point: np.ndarray
    normal: np.ndarray
    effector: np.ndarray
    bodies: tuple[tuple[str, str], ...]

    def __len__(self) -> int:
        return len(self.frame)

    def where(self, keep: np.ndarray) -> Encounters:
        """Those that the mask (R,) keeps."""
        return self._picked(np.flatnonzero(keep))

    def joined(self, other: Encounters) -> Encounters:
        """Both, sorted by frame."""
        both = Encounters(
            np.concatenate([self.frame, other.frame]),
            np.concatenate([self.distance, other.distance]),
            np.concatenate([self.link, other.link]),
            np.concatenate([self.point, other.point]),
            np.concatenate([self.normal, other.normal]),
            np.concatenate([self.effector, other.effector]),
            self.bodies + other.bodies,
        )
        return both._picked(np.argsort(both.frame, kind="stable"))

    def _picked(self, order: np.ndarray) -> Encounters:
        return Encounters(
            self.frame[order],
            self.distance[order],
            self.link[order],
            self.point[order],
            self.normal[order],
            self.effector[order],
            tuple(self.bodies[i] for i in order),
        )

    @property
    def with_terrain(self) -> np.ndarray:
        """(R,) bool, True where one of the two stands still."""
        return (self.link == TERRAIN).any(axis=1)

    def rows(self, num_frames: int, wanted: np.ndarray, weight: np.ndarray | float = KEEP) -> DistanceRows:
        """Rows that ask each pair to keep a distance in its frame.

        Args:
            num_frames: number of frames of the motion.
            wanted: (R,) distance that each pair should keep [m].
            weight: (R,) or scalar weight of each row [1/m].
        """
        start = np.searchsorted(self.frame, np.arange(num_frames + 1)).astype(np.int64)
        return DistanceRows(
            start,
            np.ascontiguousarray(self.link),
            np.ascontiguousarray(self.point),
            np.ascontiguousarray(self.normal),
            np.ascontiguousarray(wanted, dtype=float),
            np.array(np.broadcast_to(weight, len(self)), dtype=float),
        )


class ProximityMonitor:
    """Finds the pairs of bodies that come near each other; what it costs depends on the terrain near the robot alone.

    Distances are those of our own kernels; whether a finished motion collides is asked of Drake, by the verifier.

    Attributes:
        packed: the terrain, None for nothing but the robot.
    """

    def __init__(
        self,
        robot_plant: RobotPlant,
        kinematics: Kinematics,
        packed: PackedTerrain | None = None,
        terrain: Terrain | None = None,
    ) -> None:
        """Reads the robot's collision shapes.

        Args:
            robot_plant: of the robot.
            kinematics: of the same robot; witness points are expressed in its links' frames.
            packed: the terrain, None for nothing but the robot.
            terrain: the same, for the names of its parts.
        """
        self._tree, self.packed = kinematics.tree, packed
        self._shapes, self._names = read_shapes(robot_plant, kinematics)
        self._polygon_names = polygon_names(terrain) if terrain is not None else ()
        thicker: dict[str, float] = {}
        for name, more in zip(self._names, self._shapes.thicker.tolist(), strict=True):
            thicker[name] = max(more, thicker.get(name, 0.0))
        self._nominal = nominal_distances(robot_plant.robot).less(thicker)

    def near(self, q: np.ndarray, frames: Iterable[int], distance: float) -> Encounters:
        """Every pair closer than a distance in the given frames.

        Args:
            q: (T, nq) positions, Drake's order.
            frames: indices into q, ascending.
            distance: pairs nearer than this are returned [m].
        """
        rows = np.array(list(frames), dtype=np.int64)
        postures = np.asarray(q, float)[rows]
        met = near_itself(self._tree, self._shapes, postures, distance)
        link, name = self._shapes.link, self._names
        among = Encounters(
            rows[met.row],
            met.distance,
            link[met.shape],
            met.point,
            met.normal,
            np.full(len(met.row), -1),
            tuple((name[a], name[b]) for a, b in met.shape.tolist()),
        )
        if self.packed is None:
            return among
        hit = near_terrain(self._tree, self._shapes, self.packed, postures, distance)
        ground = Encounters(
            rows[hit.row],
            hit.distance,
            np.column_stack([link[hit.shape], np.full(len(hit.row), TERRAIN)]),
            hit.point,
            hit.normal,
            self._shapes.effector[hit.shape],
            tuple(
                (name[s], self._polygon_name(k)) for s, k in zip(hit.shape.tolist(), hit.polygon.tolist(), strict=True)
            ),
        )
        return among.joined(ground)

    def _polygon_name(self, k: int) -> str:
        return self._polygon_names[k] if k < len(self._polygon_names) else f"polygon {k}"

    def at_most_nominal(self, met: Encounters, wanted: np.ndarray, closest: float = np.inf) -> np.ndarray:
        """(R,) distances wanted of these pairs, no greater than the nominal posture has between the robot's own bodies [m].

        Args:
            met: R pairs of geometries.
            wanted: (R,) distances [m].
            closest: what is enough for bodies that are built to pass each other closely [m].
        """
        return np.where(met.with_terrain, wanted, self._nominal.at_most(met.bodies, wanted, closest))
