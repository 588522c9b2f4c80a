"""What happens while a plan is played: slips, collisions, how far off the plan; and when and why the robot counts as fallen."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from drakeplan.plan.plan import Plan
from scenes.effector import is_foot

LOWEST, STEEPEST, FARTHEST = (
    0.5,
    np.deg2rad(50.0),
    0.35,
)  # of the height at the start; tilt of the base; CoM off the plan [m]
SLIP_LOAD = 20.0  # [N] under which a contact's motion is no slip
SLIPPED = 0.05  # [m] of slip that is named as the cause of a fall
BRUSHED = 10  # control steps of a touch that is not named
WAITED = 0.5  # [s] of waiting for a contact that is named

Poses = Sequence[tuple[np.ndarray, np.ndarray]]  # position and rotation of each end effector


class RunWatch:
    """Counts what happens in one run.

    Attributes:
        slips: (E,) greatest slip of a contact of each end effector [m].
        com_error: greatest distance of the CoM from the plan's [m].
        shares: of its limit that the greatest torque was, in each control step.
        late: how long the plan waited for each contact that came late [s].
        early: contacts that came before their phase ended.
        collisions: pairs of bodies that touched and should not, with the number of control steps.
    """

    def __init__(self, plan: Plan, height: float) -> None:
        """Begins to watch.

        Args:
            plan: that is played.
            height: of the CoM over the lower foot at the start [m].
        """
        self._plan, self._height = plan, height
        self._feet = [is_foot(name) for name in plan.effectors]
        self._anchor: list[np.ndarray | None] = [None] * len(plan.effectors)
        self.slips, self.com_error = np.zeros(len(plan.effectors)), 0.0
        self.shares: list[float] = []
        self.late: list[float] = []
        self.early = 0
        self.collisions: dict[str, int] = {}

    def count(self, poses: Poses, held: Sequence[int], force: np.ndarray, others: Sequence[str]) -> None:
        """Takes in one control step.

        Args:
            poses: of the end effectors.
            held: contact that each of them holds, -1 for none.
            force: (E, 3) on each of them in W [N].
            others: pairs of bodies that touch and should not.
        """
        for pair in set(others):
            self.collisions[pair] = self.collisions.get(pair, 0) + 1
        for e, contact in enumerate(held):
            if contact < 0 or force[e] @ self._plan.contacts.X_WC[contact, :3, 2] < SLIP_LOAD:
                continue
            p = poses[e][0]
            if self._anchor[e] is None:
                self._anchor[e] = p.copy()
            self.slips[e] = max(self.slips[e], float(np.linalg.norm(p - self._anchor[e])))

    def begin_anew(self, effector: int) -> None:
        """Slips of this end effector count from its next place on."""
        self._anchor[effector] = None

    def fall(self, com: np.ndarray, wanted: np.ndarray, poses: Poses, q: np.ndarray, phase: int) -> str:
        """Why the robot counts as fallen, "" while it does not.

        Args:
            com, wanted: (3,) CoM, and where the plan has it [m].
            poses: of the end effectors.
            q: (nq,) configuration.
            phase: of the plan, for the message.
        """
        off = float(np.linalg.norm(com - wanted))
        self.com_error = max(self.com_error, off)
        foot = min(p[2] for (p, _), is_it in zip(poses, self._feet, strict=True) if is_it)
        tilt = float(np.arccos(np.clip(1.0 - 2.0 * (q[1] ** 2 + q[2] ** 2), -1.0, 1.0)))
        if com[2] - foot < LOWEST * self._height:
            what = "it sank"
        elif tilt > STEEPEST:
            what = f"it tipped by {np.degrees(tilt):.0f} deg"
        elif off > FARTHEST:
            what = f"the CoM was {100 * off:.0f} cm from the plan"
        else:
            return ""
        return f"{what} in phase {phase}{self._cause()}"

    def _cause(self) -> str:
        """What gave way first, as far as it was seen."""
        names = self._plan.effectors
        slipped = [
            f"{names[e].replace('_', ' ')} slipped {100 * self.slips[e]:.0f} cm"
            for e in np.flatnonzero(self.slips > SLIPPED)
        ]
        touched = [f"{pair} touched" for pair, count in self.collisions.items() if count > BRUSHED]
        waited = [f"a contact came {max(self.late):.2f} s late"] if max(self.late, default=0.0) >= WAITED else []
        causes = [*slipped, *touched, *waited]
        return f" ({'; '.join(causes)})" if causes else ""
