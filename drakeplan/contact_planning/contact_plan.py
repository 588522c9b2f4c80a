"""Options and results of any contact planner."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Literal

import numpy as np

from drakeplan.timing.step_timing import Timing
from scenes.footholds.snap import StepLimits, step_limits
from scenes.robots.robot import Robot
from scenes.stance import Stance, changed_effector
from scenes.transition_model import TransitionModel, transition_model

DynamicsName = Literal["quasi-static", "exact", "learned"]
HeuristicName = Literal["grid", "traversability", "euclidean", "admissible"]
FootholdsName = Literal["snapped", "fixed"]
GuideName = Literal["mean", "max", "segments"]
CaptureName = Literal["none", "swing", "worst-case"]
OddsName = Literal["motions", "poses", "off"]
FitName = Literal["quick", "strip", "strip_ends"]
BEYOND = 0.1  # [m] how much farther than the steps of the transition model a snapped foot may be set


@dataclass(frozen=True)
class PlannerOptions:
    """Options that a query passes to any planner; a planner ignores those that it does not need.

    Attributes:
        seed: of every random choice.
        use_palms: whether palms may be used at all.
        lean_on: the only palms to use, indices into `EFFECTORS`; without them a foot's step costs more, with quasi-static
            dynamics. None of them: all palms, where they serve.
        heuristic: "grid" (Lin 2020 eq. 6.7), "traversability" (Lin & Berenson 2017 eq. 11), "euclidean" (Lin 2020 eq. 3.3) or
            "admissible" (gives a bound).
        estimator: of traversability, one of `learning.traversability.KINDS`; "" for the network that fits the footholds.
        guide: of a guided plan: whether the "mean" or the "max" of a segment's hardness says whether it is searched or adapted,
            or whether all "segments" are searched.
        dynamics: what a transition must be: balanced at its critical configurations ("quasi-static"), feasible for the
            centroidal program ("exact"), or for the networks that learned it ("learned").
        timing: of every transition.
        model: the next contacts to choose from.
        longer: longer steps, tried only where those of the model lead no farther.
        footholds: whether a step or a palm ray that finds no foothold moves to the nearest one ("snapped"), or is lost
            ("fixed", as in Lin 2020).
        capture: whether edges cost what pushes may do during them, and at which moments of a swing: "swing" at four of them
            (Lin 2020 eq. 7.4), "worst-case" at the first (eq. 7.5).
        odds: how several capture poses add up: every capture motion counts once ("motions", with networks that say how sure
            they are), every pose counts ("poses", with the networks of Lin 2020 fig. 7.3), or not at all ("off", its baseline).
        catch_palms: whether palms may then catch the robot.
        library: folder of stored plans for planners that adapt some; "" for the one that comes with the robot.
        fit: how stored plans are fitted to the terrain: by an elastic strip that keeps balance ("strip", Lin 2020 sec. 4.5.3)
            or whose contacts are checked for it afterwards ("strip_ends", sec. 5.8.2), or contact by contact first and
            by the balanced strip where that fails ("quick").
    """

    seed: int = 0
    use_palms: bool = True
    lean_on: tuple[int, ...] = ()
    heuristic: HeuristicName = "grid"
    estimator: str = ""
    guide: GuideName = "mean"
    dynamics: DynamicsName = "quasi-static"
    timing: Timing = field(default_factory=Timing)
    model: TransitionModel = field(default_factory=transition_model)
    longer: TransitionModel | None = None
    footholds: FootholdsName = "snapped"
    capture: CaptureName = "none"
    odds: OddsName = "motions"
    catch_palms: bool = True
    library: str = ""
    fit: FitName = "quick"

    @property
    def chosen_estimator(self) -> str:
        """The estimator, or the network that was trained for these footholds."""
        return self.estimator or ("network" if self.footholds == "snapped" else "network-fixed")

    @property
    def longest_stride(self) -> float:
        """How far forward of the standing foot a foot may be set [m]."""
        models = [model for model in (self.model, self.longer) if model is not None]
        longest = max(float(model.steps[:, 0].max()) for model in models)
        return longest + (BEYOND if self.footholds == "snapped" else 0.0)

    def longest_travel(self, robot: Robot) -> float:
        """How far a foot moves in one transition at most [m]."""
        models = [model for model in (self.model, self.longer) if model is not None]
        return max(robot.max_foot_translation, *(float(np.abs(model.steps[:, 0]).max()) for model in models))

    def step_limits(self, robot: Robot, model: TransitionModel) -> StepLimits:
        """Bounds of the steps that a foot may make: snapped ones may go a little beyond those of a model.

        Args:
            robot: whose sole it is.
            model: one of these options.
        """
        beyond = BEYOND if self.footholds == "snapped" else 0.0
        return step_limits(model.steps, robot.effectors[0].half_extent, beyond)

    def step_reach(self, robot: Robot) -> float:
        """How far apart a step sets the feet at most, in the plan view [m]."""
        models = [model for model in (self.model, self.longer) if model is not None]
        if self.footholds == "fixed":
            return max(float(np.hypot(*model.steps[:, :2].T).max()) for model in models)
        limits = [self.step_limits(robot, model) for model in models]
        return max(float(np.hypot(max(np.abs(of.x)), of.outer)) for of in limits)


@dataclass(frozen=True)
class ContactPlan:
    """A contact sequence that passed inverse kinematics and balance at both critical configurations of each step.

    Attributes:
        stances: from start to goal, consecutive ones differ in one end effector.
        states: the planner's own names for them; only the planner reads them.
        cost: sum of the edge costs (Lin 2020 eq. 3.2).
        bound: at most this many times the optimum; None where there is no guarantee.
        expansions: nodes expanded, or programs solved, until it was found.
        elapsed: seconds since planning began (terrain packed, grid, search; not loading).
        predicted_com: (n, 3) CoM at each stance as the planner saw it [m]; None without dynamics.
        predicted_effort: sum of the transitions' dynamics objectives as the planner saw them; None without dynamics.
        origin: stored plans that it was adapted from, in order.
        guide: segments of the guiding path that it was planned along, as JSON values: mode, method, stances, way [m].
        predicted_success: probability of no fall under the scene's pushes, as the planner saw it; None where it did not ask.
    """

    stances: tuple[Stance, ...]
    states: tuple[tuple[int, ...], ...]
    cost: float
    bound: float | None
    expansions: int
    elapsed: float
    predicted_com: np.ndarray | None = None
    predicted_effort: float | None = None
    origin: tuple[str, ...] = ()
    guide: tuple[Mapping[str, object], ...] = ()
    predicted_success: float | None = None

    @property
    def palms_used(self) -> int:
        """Transitions that make or move a palm contact."""
        movers = [changed_effector(a, b) for a, b in zip(self.stances, self.stances[1:], strict=False)]
        return sum(e >= 2 and b.contacts[e] is not None for e, b in zip(movers, self.stances[1:], strict=True))


@dataclass(frozen=True)
class PlannerCounts:
    """What the last run of `ContactPlanner.plans` did.

    Attributes:
        expansions: nodes expanded, or programs solved.
        ended_by: "deadline", "cancelled", "expansions", "improve", "bound" or "exhausted"; "" before it ended.
        transitions_judged: transitions whose dynamics were evaluated in all runs, by "learned" and "exact".
    """

    expansions: int = 0
    ended_by: str = ""
    transitions_judged: Mapping[str, int] = field(default_factory=dict)
