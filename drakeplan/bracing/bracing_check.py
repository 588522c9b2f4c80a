"""Whether `bracer` can move a palm: the other one and the wheels hold it, and both arms reach (Lin 2020 sec. 5.10).

The base stands where its torso is beside the standing palm. While the other palm is off the wall the wheels and the standing palm
carry the robot; that is asked once, since the base does not move meanwhile (end-point balance, sec. 5.7). Both palms then stay in place
while the base drives on to where the next palm will stand.
"""

from __future__ import annotations

import numpy as np

from drakeplan.bracing.bracer import Bracer
from drakeplan.bracing.wall_frame import R_WG, SQUARE, to_world
from drakeplan.contact_planning.contact_pool import ContactPool, Held
from optimization.balance.friction import DEFAULT_CONE, cone_generators
from optimization.balance.static_equilibrium import ContactArrays, is_balanced
from scenes.library.braced_ramp import FRICTION_OF_WHEELS, BracedRamp
from scenes.robots.bracer.make_bracer import TORSO_AT, WHEEL_WIDTH

WHEEL = (0.02, 0.5 * WHEEL_WIDTH)  # [m] half length and half width of what a wheel stands on
PALM_LIMIT = 0.3  # of the weight that an arm may press with
MARGIN = 0.01  # [m] that the CoM keeps from tipping, to either side


class BracingCheck:
    """Checks steps of palms on one wall beside one ramp; has the methods that `ContactDomain` asks of a check.

    Attributes:
        pool: contacts in frame G by number.
        asked: steps that were checked.
    """

    def __init__(self, pool: ContactPool, ramp: BracedRamp, bracer: Bracer) -> None:
        """Prepares the check.

        Args:
            pool: contacts in frame G by number.
            ramp: that the base stands on.
            bracer: the robot.
        """
        self.pool, self.asked = pool, 0
        self._ramp, self._bracer = ramp, bracer
        self._known: dict[int, str] = {}
        self._into = ramp.ramp.T @ np.array([0.0, 1.0, 0.0])
        self._wheels = [(p, ramp.ramp, FRICTION_OF_WHEELS, WHEEL, 1.0) for p in bracer.wheels]

    def stands_alone(self, number: int) -> bool:
        """Whether a palm may be the only one: that is a question of the wheels too, and asked with each step."""
        return True

    def can_lift(self, held: Held, mover: int) -> str:
        """Nothing but palms is ever lifted, and that is asked with each step.

        Args:
            held: contact numbers of left and right palm first.
            mover: 0 left, 1 right.
        """
        return ""

    def stance(self, held: Held) -> str:
        """Why the robot cannot hold both palms with its torso beside either: "", "reach"."""
        left, right = held[:2]
        both = [self.reaches(left, right, standing) for standing in (left, right)]
        return "" if any(both) else "reach"

    def transition(self, before: Held, after: Held) -> str:
        """Why a palm cannot step: "", "balance" or "reach".

        Args:
            before: contact numbers of left and right palm first.
            after: the same, with one of them changed.
        """
        self.asked += 1
        mover = 0 if before[0] != after[0] else 1
        standing = before[1 - mover]
        if self.why_not_balanced(standing):
            return "balance"
        feasible = all(self.reaches(held[0], held[1], standing) for held in (before, after))
        return "" if feasible else "reach"

    def reaches(self, left: int, right: int, standing: int) -> bool:
        """Whether both arms may reach with the torso beside a standing palm.

        Args:
            left: contact of the left palm.
            right: contact of the right palm.
            standing: contact of the palm that the base is aligned with.
        """
        X_WB = self.base(standing)
        points = (to_world(self.pool.p[[left, right]]) - X_WB[:3, 3]) @ X_WB[:3, :3]
        return all(self._bracer.reaches(k, points[k], self._into) for k in (0, 1))

    def why_not_balanced(self, standing: int) -> str:
        """Says "balance" where wheels and this palm alone do not hold the robot, its CoM a centimetre off to any side; else ""."""
        if standing not in self._known:
            arrays, X_WB = self.supports(standing), self.base(standing)
            com = X_WB[:3, :3] @ self._bracer.com + X_WB[:3, 3]
            aside = MARGIN * np.array([[0.0, 1.0], [0.0, -1.0], [1.0, 0.0], [-1.0, 0.0]])
            held = all(is_balanced(*arrays, com[:2] + shift) for shift in aside)
            self._known[standing] = "" if held else "balance"
        return self._known[standing]

    def base(self, standing: int) -> np.ndarray:
        """(4, 4) pose of the base with its torso beside a palm [m]."""
        return self._ramp.base(float(self.pool.p[standing, 0]) - TORSO_AT[0])

    def supports(self, standing: int | None, x: float = 0.0) -> ContactArrays:
        """The contacts that carry the robot: four wheels, and a palm where one is given; the base at x [m] where none is.

        Args:
            standing: contact of the palm.
            x: of the base.
        """
        X_WB = self._ramp.base(x) if standing is None else self.base(standing)
        rows = [(X_WB[:3, :3] @ p + X_WB[:3, 3], R, mu, half, most) for p, R, mu, half, most in self._wheels]
        if standing is not None:
            palm = to_world(self.pool.p[standing]), R_WG @ self.pool.R[standing]
            rows.append((*palm, float(self.pool.friction(standing)), (SQUARE, SQUARE), PALM_LIMIT))
        corners = np.array(
            [[[u * h[0], v * h[1]] for u, v in ((1, 1), (-1, 1), (-1, -1), (1, -1))] for *_, h, _ in rows]
        )
        return ContactArrays(
            np.array([row[0] for row in rows]),
            np.array([row[1] for row in rows]),
            corners,
            np.array([cone_generators(DEFAULT_CONE, row[2]) for row in rows]),
            np.array([row[4] for row in rows]),
        )
