"""Contact planning that maximises the probability of arriving under pushes (Lin 2020 sec. 7.7).

States are those of `com_domain`: contacts of the feet, CoM and its velocity. Palms are not walked on; they may catch the robot.

    edge cost  (Lin 2020 eq. 7.3)   d + w_s + w_cap c_cap,    c_cap = -log P_success(transition)   (eq. 7.7)
    heuristic  (Lin 2020 eq. 7.8)   D + w_s D / d_max

P_success of a transition is that no push fells the robot during it. One push at most happens within each part of the time, delta_i
with P(delta_i):

    P_success = prod_t (1 - sum_i P(delta_i) (1 - P_reject_i))

"swing" asks at n_t = 4 moments of the swing (eq. 7.4), "worst-case" at the first alone, for the whole swing (eq. 7.5). Where the
odds are ours, both ask in double support too, which takes more of the time than the swing: two feet hold the robot as far as they
hold the linear inverted pendulum, and either may be lifted for a step.

The document's transitions end before the next foot lifts; ours end when the foot has landed, so that the CoM at a moment of the
swing lies between two states, on the cubic through both ends (Hermite): 2 to 3 cm and 0.03 to 0.06 m/s off the program's
trajectory in the mean, where the straight line of eq. 7.4 is off by 3 cm and 0.09 to 0.16 m/s (measured once).
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import numpy as np
from scipy.interpolate import CubicHermiteSpline
from shapely.geometry.base import BaseGeometry

from drakeplan.contact_planning.com_costs import DynamicWeights
from drakeplan.contact_planning.com_domain import ComDomain
from drakeplan.contact_planning.contact_domain import ContactDomain
from drakeplan.contact_planning.contact_plan import CaptureName
from drakeplan.contact_planning.dynamic_domain import State
from drakeplan.contact_planning.dynamics_evaluator import DynamicsEvaluator
from drakeplan.robustness.capture_odds import CaptureOdds
from drakeplan.timing.step_timing import Timing
from learning.lift_off import LiftOff
from learning.transition_batch import TransitionBatch
from optimization.capture.inverted_pendulum import depths_inside, support_polygon
from scenes.disturbance import Disturbance, pushes_along
from scenes.gravity import GRAVITY
from scenes.robots.robot import Robot
from scenes.stance import Stance

WEIGHTS = DynamicWeights(distance=1.0, step=3.0, dynamics=0.0)  # Lin 2020 sec. 7.8
CAPTURE_WEIGHT = 1000.0  # w_cap
MOMENTS = {"swing": 4, "worst-case": 1}  # n_t; of four: 0, 0.1, 0.2, 0.3 s after the foot has lifted
DOUBLE = {"swing": (0.15, 0.65), "worst-case": (0.65,)}  # moments of double support, in its durations
LEAST_SUCCESS = 1e-6
LEAST_RISK = 0.1  # quantile of the risks of the steps from the start that the heuristic expects of every step
SURELY = 0.01  # with less than this chance of a fall nothing more is asked
DEPTH, BLUR = (
    -0.02,
    0.01,
)  # [m] depth of the capture point in the support at which half are held, and how sharply that ends


class RobustDomain(ComDomain):
    """A `ComDomain` whose edges cost what pushes may do during them.

    Attributes:
        odds: answers whether pushed states are captured.
        expects_risk: whether the heuristic counts the risk of good steps for all that is left, where no place is sheltered.
            It leads straight to the goal on long ways under wind, but it is a guess that may cut off what is better.
        hurried: whether risk is asked at the moments of "worst-case", whatever was chosen.
    """

    def __init__(
        self,
        contacts: ContactDomain,
        evaluator: DynamicsEvaluator,
        odds: CaptureOdds,
        disturbances: Sequence[Disturbance],
        robot: Robot,
        timing: Timing,
        capture: CaptureName,
        lift: LiftOff | None = None,
        weight: float = CAPTURE_WEIGHT,
    ) -> None:
        """Wraps a contact domain.

        Args:
            contacts: states without the CoM, feet alone.
            evaluator: judges the dynamics of an expansion's transitions.
            odds: answers whether pushed states are captured.
            disturbances: of the scene.
            robot: that walks.
            timing: of every transition.
            capture: "swing" or "worst-case".
            lift: tells the CoM where a foot lifts; None: that is guessed from both ends of a transition.
            weight: w_cap of the edge cost; 0 is the baseline of Lin 2020 sec. 7.8.
        """
        super().__init__(contacts, evaluator, WEIGHTS)
        self.odds, self._disturbances, self._robot = odds, tuple(disturbances), robot
        self._timing, self._capture, self._lift, self._weight = timing, capture, lift, weight
        self.expects_risk = self.hurried = False
        self._least: float | None = None  # c_cap of a good step from the start
        self._support: dict[tuple[int, int], BaseGeometry] = {}

    def successors(self, state: State) -> tuple[Sequence[State], np.ndarray]:
        """The next states and what reaching them costs (Lin 2020 eq. 7.3)."""
        states, costs = super().successors(state)
        if not states or not self._weight:
            return states, costs
        risk = -np.log(self.success(state, states))
        if self._least is None:
            everywhere = all(d.box_size is None for d in self._disturbances)
            self._least = float(np.quantile(risk, LEAST_RISK)) if everywhere else 0.0
        return states, costs + self._weight * risk

    def heuristic(self, states: Sequence[State]) -> np.ndarray:
        """(n,) estimated cost to go (Lin 2020 eq. 7.8); where `expects_risk`, with the risk of as many good steps."""
        estimate = super().heuristic(states)
        if not self.expects_risk or not self._least:
            return estimate
        distance = self.contacts.distance_to_go([state[:5] for state in states])
        return estimate + self._weight * self._least * distance / (0.5 * self.contacts.max_travel)

    def success(self, state: State, states: Sequence[State]) -> np.ndarray:
        """(n,) P_success of the transitions from one state to each of several (Lin 2020 eq. 7.4, 7.5).

        Args:
            state: before them.
            states: n states after them.
        """
        capture = "worst-case" if self.hurried else self._capture
        shift, swing, moments = self._timing.shift, self._timing.swing, MOMENTS[capture]
        way = self._way(state, states)
        stands = np.array([child[1 - child[4]] for child in states])
        success = np.ones(len(states))
        for foot in np.unique(stands).tolist():
            mine = np.flatnonzero(stands == foot)
            com, velocity = way.at(shift + swing * np.arange(moments) / moments, mine)
            calm = self._calm(com, velocity, swing / moments, (foot,))
            success[mine] *= calm.reshape(len(mine), -1).prod(axis=1)
        if self.odds.model == "motions":
            shares = DOUBLE[capture]
            com, velocity = way.at(shift * np.array(shares), np.arange(len(states)))
            calm = self._calm(com, velocity, shift / len(shares), state[:2])
            success *= calm.reshape(len(states), -1).prod(axis=1)
        return success

    def _way(self, state: State, states: Sequence[State]) -> _Ways:
        """What the CoM does in the transitions from one state to each of several."""
        r, v = self.com_state(state)
        ends = [self.com_state(child) for child in states]
        end = np.array([r for r, _ in ends]), np.array([v for _, v in ends])
        pool, shift = self.contacts.pool, self._timing.shift
        # the programs' last interval, in which the new contact counts
        whole = shift + self._timing.swing + (self._timing.step or 0.0)
        start = np.broadcast_to(r, end[0].shape), np.broadcast_to(v, end[0].shape)
        if self._lift is None:
            return _Ways(start, end, None, shift, whole)
        before, after = np.array(state[:4]), np.array([child[:4] for child in states])
        batch = TransitionBatch.of_children(pool.p, pool.R, before, after, r, v, pool.frictions)
        return _Ways(start, end, self._lift.predict(batch), shift, whole)

    def success_of(self, path: Sequence[State]) -> float:
        """Product of P_success over the transitions of a path (Lin 2020 eq. 7.6), as the search sees it."""
        return float(np.prod([self.success(before, [after])[0] for before, after in pairwise(path)]))

    def cost_of(self, path: Sequence[State]) -> float:
        """Sum of the edge costs of a path, its risk asked at the chosen moments."""
        steps = sum(float(self.costs.step_costs(before, [after])[0]) for before, after in pairwise(path))
        return steps - self._weight * float(np.log(self.success_of(path)))

    def _calm(self, com: np.ndarray, velocity: np.ndarray, duration: float, feet: tuple[int, ...]) -> np.ndarray:
        """(m,) probability that no push within this time fells the robot, from m states over one foot or both."""
        here = pushes_along(self._disturbances, com)
        rows = np.repeat(np.arange(len(com)), [len(pushes.impulses) for pushes in here])
        if not len(rows):
            return np.ones(len(com))
        impulse = np.concatenate([pushes.impulses for pushes in here])
        probability = np.concatenate([pushes.within(duration) for pushes in here])
        pushed, fails = velocity[rows] + impulse / self._robot.mass, np.ones(len(rows))
        if len(feet) == 2:
            fails *= 1.0 - self._held_by_both(com[rows], pushed, feet)
        open_ = np.flatnonzero(fails > SURELY)  # the others stand already
        for foot in feet:
            fails[open_] *= 1.0 - self.odds.rejection(foot, com[rows[open_]], pushed[open_])
        falls = np.bincount(rows, weights=probability * fails, minlength=len(com))
        return np.maximum(1.0 - falls, LEAST_SUCCESS)

    def _held_by_both(self, com: np.ndarray, velocity: np.ndarray, feet: tuple[int, ...]) -> np.ndarray:
        """(m,) how likely both feet hold a pushed state: as far as its capture point lies inside their support.

        The program captured 8 of 8 with the point up to 2 cm outside, and 1 of 8 up to 5 cm (`drakeplan bench capture`).
        """
        key = feet[0], feet[1]
        if key not in self._support:
            pool = self.contacts.pool
            stance = Stance((pool.contact(feet[0]), pool.contact(feet[1]), None, None))
            self._support[key] = support_polygon(stance, self._robot)
        height = com[:, 2] - self.contacts.pool.p[list(feet), 2].mean()
        point = com[:, :2] + velocity[:, :2] * np.sqrt(np.maximum(height, 0.1) / GRAVITY)[:, None]
        depth = depths_inside(self._support[key], point)
        return 1.0 / (1.0 + np.exp(np.clip((DEPTH - depth) / BLUR, -50.0, 50.0)))


CoM = tuple[np.ndarray, np.ndarray]  # (n, 3) positions [m] and (n, 3) velocities [m/s]


class _Ways:
    """What the CoM does in n transitions: cubics from start to lift and from lift to end, or from start to end."""

    def __init__(self, start: CoM, end: CoM, lift: CoM | None, lifts_at: float, whole: float) -> None:
        """Joins the states, lift being at `lifts_at` of `whole` [s]; None where it is not known."""
        self._start, self._end, self._lift = start, end, lift
        self._lifts_at, self._whole = lifts_at, whole

    def at(self, t: np.ndarray, rows: np.ndarray) -> CoM:
        """(m k, 3) positions and velocities of m transitions at k times, those of one transition after each other.

        Args:
            t: (k,) [s], all before lift or all from there on.
            rows: (m,) numbers of the transitions.
        """
        if self._lift is None:
            return _cubic(self._start, self._end, self._whole, t, rows)
        if t[-1] < self._lifts_at:
            return _cubic(self._start, self._lift, self._lifts_at, t, rows)
        return _cubic(self._lift, self._end, self._whole - self._lifts_at, np.asarray(t) - self._lifts_at, rows)


def _cubic(start: CoM, end: CoM, duration: float, t: np.ndarray, rows: np.ndarray) -> CoM:
    """Cubic Hermite splines: positions and velocities of the chosen rows at times t, all in the same duration [s]."""
    (r0, v0), (r1, v1) = ((r[rows], v[rows]) for r, v in (start, end))
    spline = CubicHermiteSpline([0.0, duration], np.stack([r0, r1]), np.stack([v0, v1]))
    r, v = (np.moveaxis(spline(t, order), 0, 1).reshape(-1, 3) for order in (0, 1))
    return r, v
