"""What a user may choose about a centroidal program: weights, limits, timing, cone and solver."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np

from optimization.balance.friction import DEFAULT_CONE, FrictionCone
from optimization.balance.reserve import ALL, Reserve
from scenes.effector import EFFECTORS
from scenes.input_error import InputError
from scenes.robots.robot import Robot

REFERENCE_STEP = 0.2  # [s]: the documents sum their cost over knots of 0.2 s; other steps are weighted by dt / 0.2

# Units of the program: m, s, M g; moments in M g ARM and angular momenta in M g ARM s, so that columns are of one size.
ARM = 0.05  # [m]
COST_SCALE = 1e-3  # the documents' cost of a transition is 100 to 1000
LEAST_PRESSURE_LOAD = 0.01  # [M g]: in the cost, a centre of pressure is that of a contact loaded with at least this
PENALTY = 300.0  # L1 weight [scaled cost per unit] of breaking a limit on angular momentum or reach
UP = np.array([0.0, 0.0, 1.0])
PerAxis = float | tuple[float, float, float]


@dataclass(frozen=True)
class CentroidalWeights:
    """Weights of the objective, as in Lin 2020 sec. 6.7: momenta and torques in SI, forces in units of M g.

    Those on momenta and their rates are one number or one for each world axis.

    Attributes:
        linear_momentum: on |l|^2 [kg m/s].
        linear_momentum_rate: on |ldot|^2 [N].
        angular_momentum: on |k - k_ref|^2 [N m s].
        angular_momentum_rate: on |kdot - kdot_ref|^2 [N m].
        force: on |f|^2 of each contact [M g].
        torque: on the squared normal torque at each centre of pressure [N m].
        lateral_force: on the squared tangential force of each contact (Lin 2020 eq. 6.4) [M g].
        pressure_centre: on the squared centre of pressure over the patch's lengths (Lin 2020 eq. 6.5) [-].
        com_tracking: on |com - com_reference|^2 [m], used where a reference is given.
        final_linear_momentum, final_angular_momentum: in place of those on |l|^2 and |k - k_ref|^2 at the last knot, and
            final_com: in place of `com_tracking` there; None where they are the same as everywhere. For one knot.
        per_knot: whether all are for one knot whatever its length, and not for REFERENCE_STEP (Ponton et al. 2018).
    """

    linear_momentum: PerAxis = 0.2
    linear_momentum_rate: PerAxis = 0.01
    angular_momentum: PerAxis = 1.0
    angular_momentum_rate: PerAxis = 0.3
    force: float = 0.01
    torque: float = 1.0
    lateral_force: float = 10.0
    pressure_centre: float = 1.0
    com_tracking: float = 1000.0
    final_linear_momentum: PerAxis | None = None
    final_angular_momentum: PerAxis | None = None
    final_com: PerAxis | None = None
    per_knot: bool = False

    def __post_init__(self) -> None:
        for name in self.__dataclass_fields__:
            value = getattr(self, name)
            values = value if isinstance(value, tuple) else (value,)
            if value is not None and not all(math.isfinite(number) and number >= 0 for number in values):
                raise InputError(f"centroidal weights: {name} must be a finite number >= 0, got {value}")
            if len(values) not in (1, 3):
                raise InputError(f"centroidal weights: {name} must be one number or three, got {value}")


@dataclass(frozen=True)
class CentroidalOptions:
    """Limits, timing, cone and solver of a centroidal program. The defaults suit a humanoid of 76 kg and 1.7 m.

    Momentum limits matter: where k and kdot are only penalised, angular dynamics never decide feasibility, since the
    body could always be spun up. 30 N m s is about the most that arms and trunk of such a body can store, 60 N m what
    its hips and waist can keep up for a knot.

    Attributes:
        cone: friction cone, `optimization.balance.friction.FrictionCone`. `second_order` is exact with solver "clarabel"; with
            PIQP it is the regular 16-gon inscribed in it, which gives 98 % of the friction at worst.
        dt: length of an interval between knots [s].
        shift_time: time in which the CoM shifts before each transition [s].
        swing_time: time in which an end effector moves [s].
        weights: the objective.
        angular_momentum_limit: greatest |k| per world axis [N m s].
        angular_momentum_rate_limit: greatest |kdot| per world axis [N m].
        com_height: least, nominal and greatest height of the CoM over the mean of the feet in contact [m].
        com_reach: (E,) greatest distance from the CoM to a contact, per end effector [m].
        force_limit: (E,) greatest normal force, per end effector [M g].
        final_half_width: half widths of the box, around the mean of the last feet and the nominal height, in which the
            CoM must end [m]; None where the end is free.
        rest_at_end: whether l = 0 and k = 0 at the last two knots, so that the last forces hold the robot at rest.
        solver: "auto" (PIQP where it is installed and the cone is linear, else Clarabel), "piqp" or "clarabel".
        max_iterations: most convex programs solved in one `solve`.
        tolerance: relative decrease of the cost at which the iteration ends.
        time_limit: seconds after which no further convex program is started.
        explain: whether a problem without an answer is asked which constraint stands in the way; it costs a linear
            program.
        reserve: what is left unused of friction and supports.
    """

    cone: FrictionCone = DEFAULT_CONE
    dt: float = 0.2
    shift_time: float = 1.0
    swing_time: float = 1.0
    weights: CentroidalWeights = field(default_factory=CentroidalWeights)
    angular_momentum_limit: tuple[float, float, float] = (30.0, 30.0, 30.0)
    angular_momentum_rate_limit: tuple[float, float, float] = (60.0, 60.0, 60.0)
    com_height: tuple[float, float, float] = (0.6, 0.9, 1.1)
    com_reach: tuple[float, float, float, float] = (1.15, 1.15, 0.95, 0.95)
    force_limit: tuple[float, float, float, float] = (2.0, 2.0, 0.5, 0.5)
    final_half_width: tuple[float, float, float] | None = (0.12, 0.12, 0.12)
    rest_at_end: bool = True
    solver: str = "auto"
    max_iterations: int = 20
    tolerance: float = 1e-3
    time_limit: float = 30.0
    explain: bool = True
    reserve: Reserve = ALL

    @classmethod
    def for_robot(cls, robot: Robot, cone: FrictionCone, reserve: Reserve = ALL) -> CentroidalOptions:
        """The defaults with a robot's limits.

        Args:
            robot: gives height, reach and force limits.
            cone: friction cone.
            reserve: what is left unused.
        """
        return cls(
            cone=cone,
            reserve=reserve,
            com_height=robot.com_height,
            com_reach=tuple(robot.com_reach.tolist()),
            force_limit=tuple(robot.force_limit.tolist()),
        )

    def __post_init__(self) -> None:
        object.__setattr__(self, "cone", FrictionCone(self.cone))  # a name is taken too
        for name in ("dt", "shift_time", "swing_time", "tolerance", "time_limit"):
            value = getattr(self, name)
            if not (math.isfinite(value) and value > 0):
                raise InputError(f"centroidal options: {name} must be a finite number > 0, got {value}")
        for name, length in (
            ("angular_momentum_limit", 3),
            ("angular_momentum_rate_limit", 3),
            ("com_reach", len(EFFECTORS)),
            ("force_limit", len(EFFECTORS)),
        ):
            if len(getattr(self, name)) != length:
                raise InputError(f"centroidal options: {name} must have {length} entries, got {getattr(self, name)}")
            if not all(value > 0 for value in getattr(self, name)):
                raise InputError(f"centroidal options: every entry of {name} must be > 0, got {getattr(self, name)}")
        low, nominal, high = self.com_height
        if not (math.isfinite(nominal) and low <= nominal <= high):
            raise InputError(
                f"centroidal options: com_height must ascend (least, nominal, greatest), got {self.com_height}"
            )
        if self.final_half_width is not None and not all(half >= 0 for half in self.final_half_width):
            raise InputError(f"centroidal options: final_half_width must not be negative, got {self.final_half_width}")
        if self.max_iterations < 1:
            raise InputError(f"centroidal options: max_iterations must be at least 1, got {self.max_iterations}")
