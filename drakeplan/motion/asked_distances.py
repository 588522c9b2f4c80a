"""How far apart bodies shall be in each frame: no farther than where the robot stands at rest, or than its key postures."""

from __future__ import annotations

import numpy as np

from drakeplan.motion.proximity import Encounters, ProximityMonitor

LEAST = 0.006  # [m] what key postures that are nearer leave to ask for


class AskedDistances:
    """Distances that are asked of pairs of bodies in the frames of a motion.

    A forearm may have to pass a wall at 7 mm to reach a contact. Key postures know: they are solved for this distance, with
    the contacts held. To ask the frames between them for more would bend them for nothing.

    Attributes:
        apart: distance where nothing speaks for less [m].
    """

    def __init__(self, monitor: ProximityMonitor, room: np.ndarray, t: np.ndarray, apart: float) -> None:
        """Asks for the same distance everywhere, but for end effectors near their contacts.

        Args:
            monitor: knows the distances of the nominal posture.
            room: (T, E) share of the distance that each end effector is asked for, 0 where it is in contact.
            t: (T,) of the frames [s].
            apart: distance where nothing speaks for less [m].
        """
        self.apart = apart
        self._monitor, self._room, self._t = monitor, room, t
        self._interval = np.zeros(len(t), np.int64)
        self._reached: dict[tuple[int, tuple[str, str]], float] = {}

    def learn(self, t: np.ndarray, q: np.ndarray) -> None:
        """Takes the distances that key postures have; frames between two of them are asked for the lesser one.

        Args:
            t: (K,) of the key postures, ascending [s].
            q: (K, nq) the key postures.
        """
        self._interval = np.clip(np.searchsorted(t, self._t, side="right") - 1, 0, max(len(t) - 2, 0))
        self._reached = {}
        met = self._monitor.near(q, range(len(t)), self.apart)
        for key, bodies, distance in zip(met.frame.tolist(), met.bodies, met.distance.tolist(), strict=True):
            for interval in (key - 1, key):
                known = self._reached.get((interval, bodies), np.inf)
                self._reached[interval, bodies] = min(known, max(distance, LEAST))

    def asked(self, met: Encounters) -> np.ndarray:
        """(R,) distance asked of each pair [m]: none of what stands on its contact, less where it takes off."""
        wanted = np.full(len(met), self.apart)
        sole = met.effector >= 0
        room = self._room[met.frame[sole], met.effector[sole]]
        wanted[sole] = np.where(room > 0.0, room * self.apart, -np.inf)
        return wanted

    def wanted(self, met: Encounters) -> np.ndarray:
        """(R,) distance that each pair should keep [m], no greater than its own in the nominal and in key postures."""
        pairs = zip(self._interval[met.frame].tolist(), met.bodies, strict=True)
        reached = np.array([self._reached.get(pair, np.inf) for pair in pairs], dtype=float)
        return self._monitor.at_most_nominal(met, np.minimum(self.asked(met), reached))

    def near(self, met: Encounters, near: float) -> np.ndarray:
        """(R,) bool, pairs that are nearer than `near` [m], where nothing speaks for less, and than they should be."""
        return met.distance < np.minimum(self.asked(met) - self.apart + near, self.wanted(met))
