"""Which bodies come near each other in which configurations, and the rows that keep them apart."""

# pydrake's stubs read "float64[3, 1]" as a shape and refuse every array.
# pyright: reportArgumentType=false

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from pydrake.geometry import GeometryId, QueryObject

from optimization.inverse_kinematics.frame_task import DistanceRows
from optimization.multibody.kinematics import Kinematics
from scenes.effector import EFFECTORS
from scenes.robots.plant import RobotPlant

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
    """Asks Drake for the pairs of bodies that come near each other."""

    def __init__(self, robot_plant: RobotPlant, kinematics: Kinematics) -> None:
        """Reads the geometries of the plant.

        Args:
            robot_plant: robot and terrain.
            kinematics: of the same robot; witness points are expressed in its links' frames.
        """
        self._plant, self._scene_graph = robot_plant.plant, robot_plant.scene_graph
        self._context = robot_plant.new_context()
        self._plant_context = self._plant.GetMyMutableContextFromRoot(self._context)
        self._query_context = self._scene_graph.GetMyContextFromRoot(self._context)
        inspector = self._scene_graph.model_inspector()
        self._row: dict[GeometryId, int] = {}
        home: list[tuple[int, np.ndarray, int, str]] = []
        for geometry in inspector.GetAllGeometryIds():
            if inspector.GetProximityProperties(geometry) is None:
                continue
            X_BG = inspector.GetPoseInFrame(geometry).GetAsMatrix4()
            body = self._plant.GetBodyFromFrameId(inspector.GetFrameId(geometry))
            link, X_LB = TERRAIN, np.eye(4)
            if geometry not in robot_plant.terrain_geometry:
                link, X_LB = kinematics.bodies[body.name()]
            effector = next((e for e in range(len(EFFECTORS)) if geometry in robot_plant.effector_geometry[e]), -1)
            name = robot_plant.body_of(geometry)
            self._row[geometry] = len(home)
            home.append((link, X_LB @ X_BG, effector, name))
        self._link = np.array([h[0] for h in home], dtype=np.int64)
        self._X_LG = np.array([h[1] for h in home]).reshape(-1, 4, 4)
        self._effector = np.array([h[2] for h in home], dtype=np.int64)
        self._name = [h[3] for h in home]

    def near(self, q: np.ndarray, frames: Iterable[int], distance: float) -> Encounters:
        """Every pair closer than a distance in the given frames.

        Args:
            q: (T, nq) positions, Drake's order.
            frames: indices into q, ascending.
            distance: pairs nearer than this are returned [m].
        """
        frame: list[int] = []
        row: list[tuple[int, int]] = []
        gap: list[float] = []
        point: list[tuple[np.ndarray, np.ndarray]] = []
        normal: list[np.ndarray] = []
        for t in frames:
            self._plant.SetPositions(self._plant_context, q[t])
            query: QueryObject = self._scene_graph.get_query_output_port().Eval(self._query_context)  # type: ignore
            for pair in query.ComputeSignedDistancePairwiseClosestPoints(distance):
                frame.append(t)
                row.append((self._row[pair.id_A], self._row[pair.id_B]))
                gap.append(pair.distance)
                point.append((pair.p_ACa, pair.p_BCb))
                normal.append(pair.nhat_BA_W)
        pairs = np.array(row, dtype=np.int64).reshape(-1, 2)
        X_LG, link = self._X_LG[pairs], self._link[pairs]
        in_geometry = np.array(point, dtype=float).reshape(-1, 2, 3)
        meets_terrain = (link == TERRAIN).any(axis=1) & (link != TERRAIN).any(axis=1)
        return Encounters(
            np.array(frame, dtype=np.int64),
            np.array(gap, dtype=float),
            link,
            np.einsum("rsab,rsb->rsa", X_LG[..., :3, :3], in_geometry) + X_LG[..., :3, 3],
            np.array(normal, dtype=float).reshape(-1, 3),
            np.where(meets_terrain, self._effector[pairs].max(axis=1), -1),
            tuple((self._name[a], self._name[b]) for a, b in pairs),
        )
