"""How far a robot's own bodies are from each other as it stands, and so how far apart they may be asked to stay.

Some bodies stand a few millimetres apart by design: an elbow beside its wrist, two thighs. No posture can keep more
between them than the nominal one has.
"""

# pydrake's stubs read "float64[m, 1]" as a shape and refuse every array.
# pyright: reportArgumentType=false, reportAttributeAccessIssue=false

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from scenes.robots.plant import RobotPlant, build_plant, nominal_posture
from scenes.robots.robot import Robot

WITHIN = 0.08  # [m] pairs further apart than this are never asked for what they do not have
SHARE = 0.9  # of its nominal distance that a pair may be asked to keep
BY_DESIGN = 0.04  # [m] bodies nearer than this in the nominal posture are built to pass each other closely
SLACK = 1e-3  # [m] less than their nominal distance that bodies which touch may be asked to keep


@dataclass(frozen=True)
class NominalDistances:
    """Pairs of bodies that are near each other in the nominal posture.

    Attributes:
        distance: signed distance [m] by the names of both bodies in alphabetical order.
    """

    distance: dict[tuple[str, str], float]

    def limit(self, bodies: tuple[str, str], closest: float = np.inf) -> float:
        """The greatest distance that two bodies of the robot may be asked to keep [m], infinite for most pairs.

        Args:
            bodies: their names.
            closest: what is enough for bodies that are built to pass each other closely [m].
        """
        nominal = self.distance.get(ordered(bodies))
        if nominal is None:
            return np.inf
        return min(SHARE * nominal, nominal - SLACK, closest if nominal < BY_DESIGN else np.inf)

    def less(self, thicker: Mapping[str, float]) -> NominalDistances:
        """What is left of them between bodies that are drawn too large.

        Args:
            thicker: by how much, by the body's name [m].
        """
        return NominalDistances(
            {(a, b): d - thicker.get(a, 0.0) - thicker.get(b, 0.0) for (a, b), d in self.distance.items()}
        )

    def at_most(self, pairs: Sequence[tuple[str, str]], asked: np.ndarray, closest: float = np.inf) -> np.ndarray:
        """(R,) the distances asked of these pairs, none greater than its limit [m].

        Args:
            pairs: (R,) names of the two bodies.
            asked: (R,) distances [m].
            closest: what is enough for bodies that are built to pass each other closely [m].
        """
        limits = np.array([self.limit(bodies, closest) for bodies in pairs], dtype=float)
        return np.minimum(asked, limits) if len(limits) else asked


@lru_cache(maxsize=8)
def nominal_distances(robot: Robot) -> NominalDistances:
    """Measured once for each robot."""
    robot_plant = build_plant(robot)
    return NominalDistances(measure_distances(robot_plant, nominal_posture(robot)))


def measure_distances(robot_plant: RobotPlant, q: np.ndarray) -> dict[tuple[str, str], float]:
    """Least signed distance of each pair of the robot's bodies nearer than `WITHIN` [m]; filtered pairs are left out.

    Args:
        robot_plant: of the robot alone.
        q: (nq,) the posture, in Drake's order.
    """
    context = robot_plant.new_context()
    plant_context = robot_plant.plant.GetMyContextFromRoot(context)
    robot_plant.plant.SetPositions(plant_context, q)
    query = robot_plant.plant.get_geometry_query_input_port().Eval(plant_context)
    found: dict[tuple[str, str], float] = {}
    for pair in query.ComputeSignedDistancePairwiseClosestPoints(WITHIN):
        bodies = ordered((robot_plant.body_of(pair.id_A), robot_plant.body_of(pair.id_B)))
        found[bodies] = min(float(pair.distance), found.get(bodies, np.inf))
    return found


def ordered(bodies: tuple[str, str]) -> tuple[str, str]:
    """Two names in alphabetical order."""
    a, b = bodies
    return (a, b) if a <= b else (b, a)
