"""The robot `bracer` on a ramp: closed forms for the search, and Drake's inverse kinematics for what the search found."""

# pydrake's stubs take the first parameter of ndarray for its type, and reject every array.
# pyright: reportArgumentType=false, reportCallIssue=false, reportOperatorIssue=false

from __future__ import annotations

from functools import cached_property

import numpy as np
from pydrake.math import RigidTransform
from pydrake.multibody.inverse_kinematics import InverseKinematics
from pydrake.multibody.parsing import Parser
from pydrake.multibody.plant import MultibodyPlant
from pydrake.solvers import Solve

from drakeplan.bracing.wall_frame import MODEL_FILE
from scenes.robots.bracer import make_bracer as model

PALM_FRAMES = ("left_palm", "right_palm")
SHOULDER = np.array([0.0, 0.0, model.TORSO_AT[2] + model.SHOULDER[2]])  # [m] middle of both, torso upright
LONGEST = 0.98 * (model.UPPER_ARM + model.FOREARM)  # [m] from shoulder to wrist, short of a straight arm
SHORTEST = 0.25  # [m]
ALIGNED = 0.25  # [rad] that a palm may be off the wall's normal: its foam gives
PLACED = 2e-3  # [m]
GUESSES = (0.0, 0.4, -0.4)  # [rad] of torso pitch to begin with


class Bracer:
    """Kinematics and mass. Frame B of the base has its origin on the ground between the wheels, x forward, z up.

    Attributes:
        plant: Drake's, its base welded to the world: the world of the plant is B.
        mass: [kg].
        wheels: (4, 3) contact points in B [m].
    """

    def __init__(self) -> None:
        self.plant = MultibodyPlant(0.0)
        Parser(self.plant).AddModels(str(MODEL_FILE))
        self.plant.WeldFrames(self.plant.world_frame(), self.plant.GetFrameByName("base"))
        self.plant.Finalize()
        self._context = self.plant.CreateDefaultContext()
        self.mass = float(self.plant.CalcTotalMass(self._context))
        self.wheels = np.array([[x, y, 0.0] for _, x, y in model.wheels()])

    @cached_property
    def com(self) -> np.ndarray:
        """(3,) CoM in B with both palms on the wall straight beside the torso, what the search takes it for [m]."""
        reach = np.array([model.TORSO_AT[0], 0.5, SHOULDER[2] - 0.1])
        beside = np.array([0.2, 0.0, 0.0])
        q = self.posture(np.array([reach - beside, reach + beside]), np.array([0.0, 1.0, 0.0]))
        assert q is not None, "the robot reaches a wall beside it"
        return self.com_of(q)

    def com_of(self, q: np.ndarray) -> np.ndarray:
        """(3,) CoM in B of a configuration (16,) [m]."""
        self.plant.SetPositions(self._context, q)
        return np.array(self.plant.CalcCenterOfMassPositionInWorld(self._context))

    def shoulders(self) -> np.ndarray:
        """(2, 3) left and right shoulder in B with the torso turned to the left, to the wall [m]."""
        middle = np.array([model.TORSO_AT[0], 0.0, SHOULDER[2]])
        return middle + np.array([[-model.SHOULDER[1], 0.0, 0.0], [model.SHOULDER[1], 0.0, 0.0]])

    def reaches(self, palm: int, p_B: np.ndarray, into_wall: np.ndarray) -> bool:
        """Whether an arm may reach, by the distance of shoulder and wrist.

        Args:
            palm: 0 left, 1 right.
            p_B: (3,) contact point in B [m].
            into_wall: (3,) unit vector into the wall in B.
        """
        wrist = p_B - model.HAND * into_wall
        return SHORTEST <= float(np.linalg.norm(wrist - self.shoulders()[palm])) <= LONGEST

    def posture(self, palms: np.ndarray, into_wall: np.ndarray) -> np.ndarray | None:
        """(16,) a configuration with both palms in place, by Drake's inverse kinematics; None where none was found.

        Args:
            palms: (2, 3) contact points of left and right palm in B [m].
            into_wall: (3,) unit vector into the wall in B.
        """
        for pitch in GUESSES:
            ik = InverseKinematics(self.plant)
            for name, point in zip(PALM_FRAMES, palms, strict=True):
                frame = self.plant.GetFrameByName(name)
                world = self.plant.world_frame()
                ik.AddPositionConstraint(frame, np.zeros(3), world, point - PLACED, point + PLACED)
                ik.AddAngleBetweenVectorsConstraint(frame, np.array([0.0, 0.0, 1.0]), world, into_wall, 0.0, ALIGNED)
            guess = self._guess(pitch)
            ik.prog().AddQuadraticErrorCost(0.01 * np.eye(len(guess)), guess, ik.q())
            answer = Solve(ik.prog(), guess)
            q = np.array(answer.GetSolution(ik.q()))
            if self._holds(q, palms, into_wall):
                return q
        return None

    def _guess(self, pitch: float) -> np.ndarray:
        """Torso turned to the left, arms bent forward."""
        named = {"torso_yaw": np.pi / 2, "torso_pitch": pitch}
        for side in ("left", "right"):
            named |= {f"{side}_shoulder_pitch": -1.0, f"{side}_elbow": -0.9, f"{side}_wrist_pitch": 0.3}
        q = np.zeros(self.plant.num_positions())
        for name, angle in named.items():
            q[self.plant.GetJointByName(name).position_start()] = angle
        return q

    def _holds(self, q: np.ndarray, palms: np.ndarray, into_wall: np.ndarray) -> bool:
        """Whether a configuration is what was asked for, whatever the solver says."""
        low, high = self.plant.GetPositionLowerLimits(), self.plant.GetPositionUpperLimits()
        if (q < low - 1e-6).any() or (q > high + 1e-6).any():
            return False
        self.plant.SetPositions(self._context, q)
        for name, point in zip(PALM_FRAMES, palms, strict=True):
            X_BP: RigidTransform = self.plant.GetFrameByName(name).CalcPoseInWorld(self._context)
            off = np.linalg.norm(X_BP.translation() - point)
            along = float(np.dot(X_BP.rotation().matrix()[:, 2], into_wall))
            if off > 2.0 * PLACED or along < np.cos(ALIGNED + 1e-3):
                return False
        return True
