"""Published centroidal problems with reference solutions, as our problems, and judged by the reference's own rules.

The file momentumopt_demo01.json (numbers of a demo of momentumopt, Ponton et al. 2018) is not part of drakeplan. Its
conventions: knot i = 0..N-1 is our knot i + 1 and its force our force_W[i]; weights hold for each knot, momenta at the
last knot have weights of their own; friction, pressure centre and normal torque of a contact are bounded one by one;
a contact's reach is measured to its centre of pressure.
"""

# pydrake's stubs read "float64[m, 1]" as a shape and refuse every array.
# pyright: reportArgumentType=false, reportCallIssue=false, reportAttributeAccessIssue=false

from __future__ import annotations

import json
import math
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from pydrake.solvers import LorentzConeConstraint
from scipy.spatial.transform import Rotation

from optimization.balance.friction import FrictionCone
from optimization.centroidal.contact_schedule import ContactSchedule
from optimization.centroidal.options import ARM, CentroidalOptions, CentroidalWeights
from optimization.centroidal.problem import CentroidalProblem
from optimization.centroidal.program import CentroidalProgram
from optimization.centroidal.trajectory import CentroidalTrajectory
from scenes.contact import Contact
from scenes.effector import EFFECTORS
from scenes.gravity import GRAVITY
from scenes.input_error import InputError

WHOLE = 1e-6  # of a knot: quotients of decimal numbers end this near below whole ones
LETTERS = ("lf", "rf", "lh", "rh")  # the file's names of our end effectors, in our order
CONES = {"LinearCone": FrictionCone.DIAMOND, "SocCone": FrictionCone.SECOND_ORDER}
FREE = (math.inf, math.inf, math.inf)
TOLERANCE = 1e-6


@dataclass(frozen=True, eq=False)
class Variant:
    """One way in which the reference solved the case.

    Attributes:
        name: in the file.
        problem, options: in the terms of drakeplan; reach is missing in them (see `build`).
        goal: (3,) where the CoM should end [m].
        reach: (E,) greatest distance from the CoM plus `offset` to a centre of pressure [m].
        offset: (E, 3) of legs and arms from the CoM, in W [m].
        cop_range: (E, 4) least and greatest x, least and greatest y of the centre of pressure [m].
        torque_range: (2,) least and greatest normal torque [N m].
        least_height: of the CoM [m].
        reference: com [m], linear [kg m/s] and angular momentum [N m s] at knots 1..N-1, each (N-1, 3).
        reference_dt: (N-1,) the reference's intervals where it chose them, else None [s].
        dt_range: (2,) least and greatest interval where they are free, else None [s].
        time_weight: on the squared change of each interval [1/s^2].
        fixed_horizon: whether free intervals keep their sum.
    """

    name: str
    problem: CentroidalProblem
    options: CentroidalOptions
    goal: np.ndarray
    reach: np.ndarray
    offset: np.ndarray
    cop_range: np.ndarray
    torque_range: np.ndarray
    least_height: float
    reference: tuple[np.ndarray, np.ndarray, np.ndarray]
    reference_dt: np.ndarray | None
    dt_range: tuple[float, float] | None
    time_weight: float
    fixed_horizon: bool

    def build(self, problem: CentroidalProblem, options: CentroidalOptions) -> CentroidalProgram:
        """The program with the reference's reach: |com + offset - p - R cop| <= reach + ARM s, a cone in com, z and s.

        Args:
            problem: of this variant, perhaps with another timing.
            options: of the centroidal program.
        """
        program = CentroidalProgram(problem, options)
        p_WC, R_WC, _ = problem.schedule.poses()
        interval, effector = np.nonzero(problem.schedule.active >= 0)
        for j, (n, e) in enumerate(zip(interval, effector, strict=True)):
            held = problem.schedule.active[n, e]
            A = np.zeros((4, 6))
            A[0, 5] = ARM
            A[1:, :3] = np.eye(3)
            A[1:, 3:5] = -R_WC[held][:, :2] * 2 * problem.half_extent[e]  # z is the pressure centre over the lengths
            cone = LorentzConeConstraint(
                A, np.array([self.reach[e], *(problem.initial_com + self.offset[e] - p_WC[held])])
            )
            cone.set_description("reach to the pressure centre")
            program.prog.AddConstraint(cone, np.concatenate([program.com[n], program.z[j, :2], program.s[n]]))
        return program

    def objective(
        self,
        dt: np.ndarray,
        com: np.ndarray,
        linear: np.ndarray,
        angular: np.ndarray,
        force: np.ndarray | None = None,
        torque: np.ndarray | None = None,
    ) -> float:
        """The reference's objective; a lower bound on it where forces and torques are not known.

        Args:
            dt: (N-1,) intervals [s].
            com, linear, angular: (N-1, 3) at knots 1..N-1.
            force: (N-1, E, 3) [N].
            torque: (N-1, E) [N m].
        """
        w, weight = self.options.weights, self.problem.mass * GRAVITY
        total = np.sum(np.multiply(w.final_com, (com[-1] - self.goal) ** 2))
        for value, running, final, rate in (
            (linear, w.linear_momentum, w.final_linear_momentum, w.linear_momentum_rate),
            (angular, w.angular_momentum, w.final_angular_momentum, w.angular_momentum_rate),
        ):
            slope = np.diff(value, axis=0, prepend=np.zeros((1, 3))) / dt[:, None]
            total += np.sum(np.multiply(running, value[:-1] ** 2)) + np.sum(np.multiply(final, value[-1] ** 2))
            total += np.sum(np.multiply(rate, slope**2))
        if force is not None:
            total += w.force * np.sum((force / weight) ** 2)
        if torque is not None:
            total += w.torque * np.sum(torque**2)
        return float(total + self.time_weight * np.sum((dt - self.problem.schedule.dt) ** 2))

    def cost(self, t: CentroidalTrajectory) -> float:
        """The reference's objective of one of our trajectories, forces and torques included."""
        dt = np.diff(t.t)
        return self.objective(
            dt, t.com[1:], t.linear_momentum[1:], t.angular_momentum[1:], t.force_W[:-1], t.torque_n[:-1]
        )

    def violations(self, t: CentroidalTrajectory) -> dict[str, float]:
        """By how much a trajectory breaks each of the reference's rules, recomputed from what it says of itself.

        Dynamics in M g, M g m; friction in M g; centre of pressure, reach and height in m; torque in N m.
        """
        schedule, weight = self.problem.schedule, self.problem.mass * GRAVITY
        dt = np.diff(t.t)[:, None]
        rates = [np.diff(x, axis=0) / dt for x in (t.com, t.linear_momentum, t.angular_momentum)]
        total, moment = np.tile([0.0, 0.0, -weight], (len(dt), 1)), np.zeros((len(dt), 3))
        worst: dict[str, float] = dict.fromkeys(
            ("dynamics", "friction", "pressure centre", "torque", "reach", "height"), 0.0
        )
        for n, e in zip(*np.nonzero(schedule.active >= 0), strict=True):
            contact = schedule.contacts[schedule.active[n, e]]
            force, cop, R = t.force_W[n, e], t.cop_C[n, e], contact.R_WC
            arm = contact.p_WC + R[:, :2] @ cop - t.com[n + 1]
            total[n] += force
            moment[n] += np.cross(arm, force) + R[:, 2] * t.torque_n[n, e]
            fx, fy, fz = R.T @ force / weight
            side = math.hypot(fx, fy) if self.options.cone == "second_order" else (abs(fx) + abs(fy)) / math.sqrt(2)
            low, high = self.cop_range[e, ::2], self.cop_range[e, 1::2]
            for rule, amount in (
                ("friction", max(side - contact.friction * fz, -fz)),
                ("pressure centre", float(np.max(np.maximum(low - cop, cop - high)))),
                ("torque", max(self.torque_range[0] - t.torque_n[n, e], t.torque_n[n, e] - self.torque_range[1])),
                ("reach", float(np.linalg.norm(arm - self.offset[e])) - self.reach[e]),
            ):
                worst[rule] = max(worst[rule], float(amount))
        idle = np.where((schedule.active < 0)[..., None], t.force_W[:-1], 0.0)
        gaps = rates[0] - t.linear_momentum[1:] / self.problem.mass, (rates[1] - total) / weight
        gaps = (*gaps, (rates[2] - moment) / weight, idle / weight)
        worst["dynamics"] = max(float(np.abs(gap).max()) for gap in gaps)
        worst["height"] = max(0.0, self.least_height - float(t.com[1:, 2].min()))
        return worst


def read_case(path: Path) -> list[Variant]:
    """The variants in a file.

    Raises:
        InputError: the file is missing or not of the expected form.
    """
    try:
        data = json.loads(path.read_text(encoding="utf-8"))
        return [_variant(name, entry) for name, entry in data["variants"].items()]
    except OSError as error:
        raise InputError(f"{path}: cannot be read ({error.strerror})") from error
    except UnicodeDecodeError as error:  # whose own text quotes the whole file
        raise InputError(f"{path}: expected a centroidal case with variants, this is no text") from error
    except (ValueError, KeyError, TypeError, AttributeError, IndexError) as error:
        raise InputError(f"{path}: expected a centroidal case with variants ({error!r})") from error


def _variant(name: str, data: dict) -> Variant:
    planner, initial = data["planner_variables"], data["initial"]
    schedule = _schedule(data["contact_plan"], planner)
    com = np.array(initial["com"], float)
    goal = com + np.array(planner["com_displacement"], float)
    least_height = data["contact_plan"]["effcnt_rf"][0][4] + planner["min_rel_height"]
    smooth = np.linspace(0.0, 1.0, schedule.num_knots)[:, None]
    course = com + (3 * smooth**2 - 2 * smooth**3) * (goal - com)
    box = np.full(course.shape, np.inf)
    box[:, 2] = course[:, 2] - least_height  # its upper side is above what legs reach
    ranges = np.array([planner[f"cop_range_{letters}"] for letters in LETTERS], float)
    problem = CentroidalProblem(
        schedule=schedule,
        mass=planner["robot_mass"],
        half_extent=np.maximum(ranges[:, 1::2], 0.0),
        initial_com=com,
        initial_linear_momentum=np.array(initial["lmom"], float),
        initial_angular_momentum=np.array(initial["amom"], float),
        com_reference=course,
        com_box=box,
    )
    if not np.allclose(ranges[:, 1::2], -ranges[:, ::2]) or planner["gravity"] != GRAVITY:
        raise ValueError("pressure centres off the contact's middle and another gravity are not supported")
    rf, lf, rh, lh = planner["max_eef_lengths"]
    offset = np.array([planner.get(f"eff_offset_{letters}", (0.0, 0.0, 0.0)) for letters in LETTERS], float)
    hands = data["contact_plan"]["effcnt_rh"] or data["contact_plan"]["effcnt_lh"]
    if hands and any(planner[f"w_{name}_arm"] != planner[f"w_{name}_leg"] for name in ("frc", "trq")):
        raise ValueError("weights of arms that differ from those of legs are not supported")
    reference = tuple(np.array(data["reference"][key], float) for key in ("com", "lmom", "amom"))
    if any(part.shape != (schedule.num_knots - 1, 3) or not np.isfinite(part).all() for part in reference):
        raise ValueError(f"the reference of {name} does not have three finite numbers for each knot")
    return Variant(
        name=name,
        problem=problem,
        options=_options(planner),
        goal=goal,
        reach=np.array([lf, rf, lh, rh], float),
        offset=offset,
        cop_range=ranges,
        torque_range=np.array(planner["torque_range"], float),
        least_height=float(least_height),
        reference=(reference[0], reference[1], reference[2]),
        reference_dt=np.array(data["derived_dt"], float) if "derived_dt" in data else None,
        dt_range=tuple(planner["time_range"]) if "time_range" in planner else None,
        time_weight=float(planner.get("w_time", 0.0)) if "time_range" in planner else 0.0,
        fixed_horizon=bool(planner.get("is_time_horizon_fixed", False)),
    )


def _schedule(plan: dict, planner: dict) -> ContactSchedule:
    step = planner["time_step"]
    times = step * (1 + np.arange(int(np.floor(planner["time_horizon"] / step + WHOLE)))) + 1e-9  # of their knots
    contacts: list[Contact] = []
    active = np.full((len(times), len(EFFECTORS)), -1)
    for e, letters in enumerate(LETTERS):
        for start, end, x, y, z, qw, qx, qy, qz, *_ in plan[f"effcnt_{letters}"]:
            active[(start <= times) & (times < end), e] = len(contacts)
            X_WC = np.eye(4)
            X_WC[:3, :3] = Rotation.from_quat([qx, qy, qz, qw]).as_matrix()
            X_WC[:3, 3] = x, y, z
            contacts.append(Contact(EFFECTORS[e], 0, X_WC, planner["friction_coeff"], 0.0))
    return ContactSchedule(tuple(contacts), active, np.full(len(times), step))


def _options(planner: dict) -> CentroidalOptions:
    def axes(name: str) -> tuple[float, float, float]:
        x, y, z = planner[name]
        return x, y, z

    low, high = axes("w_frc_leg")[0], max(axes("w_frc_leg"))
    if low != high or planner["friction_cone"] not in CONES:
        raise ValueError("weights on forces that differ by axis and cones but LinearCone and SocCone are not supported")
    weights = CentroidalWeights(
        linear_momentum=axes("w_lmom"),
        linear_momentum_rate=axes("w_lmomd"),
        angular_momentum=axes("w_amom"),
        angular_momentum_rate=axes("w_amomd"),
        force=low,
        torque=planner["w_trq_leg"],
        lateral_force=0.0,
        pressure_centre=0.0,
        com_tracking=0.0,
        final_linear_momentum=axes("w_lmom_final"),
        final_angular_momentum=axes("w_amom_final"),
        final_com=axes("w_com"),
        per_knot=True,
    )
    return CentroidalOptions(
        cone=CONES[planner["friction_cone"]],
        weights=weights,
        angular_momentum_limit=FREE,
        angular_momentum_rate_limit=FREE,
        com_height=(-math.inf, 0.0, math.inf),
        com_reach=(math.inf,) * 4,
        force_limit=(math.inf,) * 4,
        final_half_width=None,
        rest_at_end=False,
        solver="clarabel",
        tolerance=TOLERANCE,
    )
