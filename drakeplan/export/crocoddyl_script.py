"""Solves a whole-body optimal control problem from a plan with Crocoddyl's FDDP, and says how far its CoM goes from the plan's.

`drakeplan export PLAN.h5 --to crocoddyl` writes this file beside a folder with the plan's arrays (plan.npz) and the robot's
kinematics and inertias (robot.urdf). It needs crocoddyl and pinocchio, not drakeplan:
pip install crocoddyl 'pin==4.0.0' (the wheels of crocoddyl 3.2.1 were built for pinocchio 4.0 and crash with 4.1).

    python FILE.py                        solve the whole plan
    python FILE.py --dt 0.05 --end 3      the first three seconds, at 0.05 s
    python FILE.py --out solution.npz     keep the solution

The problem, for each interval of time: contacts of the plan's phase are rigid (six constraints each) and their wrenches stay
in the wrench cone of patch and friction by a barrier; the CoM follows the plan's, the posture and the free end effectors stay
near the plan's, torques near those that hold the plan's posture. The plan is the first guess.
"""

# pyright: reportMissingImports=false, reportAttributeAccessIssue=false

from __future__ import annotations

import argparse
import sys
from dataclasses import dataclass
from pathlib import Path

import numpy as np

try:
    import pinocchio as pin  # isort: skip  (crocoddyl needs it loaded first)
    import crocoddyl
except ImportError:
    sys.exit("crocoddyl and pinocchio are not installed: pip install crocoddyl 'pin==4.0.0'")

DATA = Path(__file__).with_name(Path(__file__).stem + "_data")
WITHIN = 0.01  # [m] of the plan's CoM
HOLD = (25.0, 10.0)  # [1/s^2, 1/s] by which a contact returns to its place (Baumgarte)
SAME_TIME = 1e-9  # [s]
WEIGHTS = {"com": 1e5, "posture": 1.0, "velocity": 1.0, "swing": 1e3, "torque": 1e-4, "cone": 1e-2, "end": 10.0}


@dataclass
class Plan:
    """The arrays of plan.npz; their units are in `header` there."""

    arrays: dict[str, np.ndarray]

    def __getattr__(self, name: str) -> np.ndarray:
        try:
            return self.arrays[name]
        except KeyError:
            raise AttributeError(name) from None

    def at(self, name: str, t: float) -> np.ndarray:
        """Values of an array over the motion at a time, linear between samples.

        Args:
            name: of the array, one row for each sample.
            t: time of the plan [s].
        """
        values = self.arrays[name]
        return np.array([np.interp(t, self.t, column) for column in values.T])

    def held(self, t: float) -> np.ndarray:
        """(E,) contacts of the phase at a time, -1 where an end effector is free."""
        phase = int(np.searchsorted(self.phase_start, t + SAME_TIME, side="right")) - 1
        return self.phase_contact[max(phase, 0)]


class Problem:
    """The robot, and one action model for each interval.

    Attributes:
        plan: what is followed.
        times: (N + 1,) ends of the intervals [s].
        shooting: crocoddyl's problem.
        guess: the plan's states.
    """

    def __init__(self, plan: Plan, times: np.ndarray) -> None:
        """Builds the problem.

        Args:
            plan: what is followed.
            times: (N + 1,) ends of the intervals [s].
        """
        self.plan, self.times = plan, times
        self.model = pin.buildModelFromUrdf(str(DATA / "robot.urdf"), pin.JointModelFreeFlyer())
        self.frames = [self.model.getFrameId(str(name)) for name in plan.effectors]
        self.supports = [self._support(c) for c in range(len(plan.contact_effector))]
        self.data = self.model.createData()
        self.state = crocoddyl.StateMultibody(self.model)
        self.actuation = crocoddyl.ActuationModelFloatingBase(self.state)
        self.guess = [self.state_at(t) for t in times]
        steps = np.diff(times)
        running = [self._interval(k, float(dt)) for k, dt in enumerate(steps)]
        self.shooting = crocoddyl.ShootingProblem(self.guess[0], running, self._interval(len(steps), 0.0))

    def state_at(self, t: float) -> np.ndarray:
        """(nq + nv,) the plan's state in Pinocchio's order: base position, quaternion x y z w, joints; velocities local."""
        plan, q, v = self.plan, pin.neutral(self.model), np.zeros(self.model.nv)
        w, x, y, z = plan.at("base_quaternion", t)
        xyzw = np.array([x, y, z, w]) / np.linalg.norm([x, y, z, w])
        R_WB = pin.Quaternion(xyzw).matrix()
        q[:3], q[3:7] = plan.at("base_position", t), xyzw
        v[:3], v[3:6] = R_WB.T @ plan.at("base_linear_velocity", t), R_WB.T @ plan.at("base_angular_velocity", t)
        angles, speeds = plan.at("joint_position", t), plan.at("joint_velocity", t)
        for name, angle, speed in zip(plan.joint_names, angles, speeds, strict=True):
            joint = self.model.joints[self.model.getJointId(str(name))]
            q[joint.idx_q], v[joint.idx_v] = angle, speed
        return np.concatenate([q, v])

    def _support(self, contact: int) -> int:
        """A frame on the robot in the middle of what of the patch rests on something."""
        foot = self.model.frames[self.frames[self.plan.contact_effector[contact]]]
        X_JS = foot.placement * self._middle(contact)
        return self.model.addFrame(pin.Frame(f"contact {contact}", foot.parentJoint, X_JS, pin.FrameType.OP_FRAME))

    def _middle(self, contact: int) -> pin.SE3:
        """Pose of the middle of a contact's support in the contact's frame."""
        return pin.SE3(np.eye(3), np.array([*self.plan.support_middle[contact], 0.0]))

    def com(self, x: np.ndarray) -> np.ndarray:
        """(3,) centre of mass of a state [m]."""
        return pin.centerOfMass(self.model, self.data, x[: self.model.nq])

    def _interval(self, k: int, dt: float) -> crocoddyl.IntegratedActionModelEuler:
        """The action model of one interval; dt = 0 for the end, which has costs only."""
        t, at_end = self.times[k], dt == 0.0
        held = self.plan.held(min(t, self.times[-1] - 2 * SAME_TIME) if at_end else t)
        nu = self.actuation.nu
        contacts = crocoddyl.ContactModelMultiple(self.state, nu)
        costs = crocoddyl.CostModelSum(self.state, nu)
        x = self.guess[k]
        pin.framesForwardKinematics(self.model, self.data, x[: self.model.nq])
        for e, contact in enumerate(held):
            name, frame = str(self.plan.effectors[e]), self.frames[e]
            if contact >= 0:
                X_WS = pin.SE3(self.plan.contact_X_WC[contact]) * self._middle(int(contact))
                support = self.supports[contact]
                rigid = crocoddyl.ContactModel6D(self.state, support, X_WS, pin.LOCAL, nu, np.array(HOLD))
                contacts.addContact(name, rigid)
                if not at_end:
                    self._add_cone(costs, name, int(contact))
            elif self.plan.half_extent[e].min() > 0.0:
                X_WF = self.data.oMf[frame].copy()
                swing = crocoddyl.ResidualModelFramePlacement(self.state, frame, X_WF, nu)
                costs.addCost(f"{name} swing", crocoddyl.CostModelResidual(self.state, swing), WEIGHTS["swing"])
        scale = WEIGHTS["end"] if at_end else 1.0
        follow = crocoddyl.ResidualModelCoMPosition(self.state, self.plan.at("com", t), nu)
        costs.addCost("com", crocoddyl.CostModelResidual(self.state, follow), scale * WEIGHTS["com"])
        nv = self.state.nv
        weights = np.repeat([WEIGHTS["posture"], WEIGHTS["velocity"]], nv)
        weights[:3] = 0.0  # where the base is follows from the CoM
        near = crocoddyl.CostModelResidual(
            self.state,
            crocoddyl.ActivationModelWeightedQuad(weights),
            crocoddyl.ResidualModelState(self.state, x, nu),
        )
        costs.addCost("posture", near, scale)
        if not at_end:
            small = crocoddyl.CostModelResidual(self.state, crocoddyl.ResidualModelControl(self.state, nu))
            costs.addCost("torque", small, WEIGHTS["torque"])
        dynamics = crocoddyl.DifferentialActionModelContactFwdDynamics(
            self.state, self.actuation, contacts, costs, 0.0, True
        )
        return crocoddyl.IntegratedActionModelEuler(dynamics, dt)

    def _add_cone(self, costs: crocoddyl.CostModelSum, name: str, contact: int) -> None:
        """The contact's wrench: inside the friction pyramid, centre of pressure inside the support, yaw torque."""
        nu, mu = self.actuation.nu, float(self.plan.contact_friction[contact])
        size = self.plan.support_size[contact]
        cone = crocoddyl.WrenchCone(np.eye(3), mu, size, 4, True, 0.0, np.inf)
        inside = crocoddyl.ActivationModelQuadraticBarrier(crocoddyl.ActivationBounds(cone.lb, cone.ub))
        wrench = crocoddyl.ResidualModelContactWrenchCone(self.state, self.supports[contact], cone, nu, True)
        costs.addCost(f"{name} cone", crocoddyl.CostModelResidual(self.state, inside, wrench), WEIGHTS["cone"])


def read_plan() -> Plan:
    """The plan's arrays."""
    with np.load(DATA / "plan.npz", allow_pickle=False) as file:
        return Plan(dict(file))


def solve(problem: Problem, iterations: int, verbose: bool) -> crocoddyl.SolverFDDP:
    """Runs FDDP from the plan.

    Args:
        problem: what to solve.
        iterations: at most.
        verbose: whether every iteration prints a line.
    """
    solver = crocoddyl.SolverFDDP(problem.shooting)
    if verbose:
        solver.setCallbacks([crocoddyl.CallbackVerbose()])
    solver.th_stop = 1e-3
    resting = [np.concatenate([x[: problem.model.nq], np.zeros(problem.model.nv)]) for x in problem.guess[:-1]]
    solver.solve(problem.guess, problem.shooting.quasiStatic(resting), iterations, False, 1e-6)
    return solver


def main(words: list[str] | None = None) -> int:
    """Solves, prints, and returns 0 when the solver converged within `WITHIN` of the plan's CoM."""
    parser = argparse.ArgumentParser(description="Solves a plan's optimal control problem with Crocoddyl.")
    parser.add_argument("--dt", type=float, default=0.02, help="interval [s]")
    parser.add_argument("--start", type=float, default=None, help="time of the plan to begin at [s]")
    parser.add_argument("--end", type=float, default=None, help="time of the plan to end at [s]")
    parser.add_argument("--iterations", type=int, default=100, help="at most")
    parser.add_argument("--out", default=None, help="write the solution (.npz: t, x, u)")
    parser.add_argument("--quiet", action="store_true", help="no line for every iteration")
    words_ = parser.parse_args(words)
    plan = read_plan()
    start = plan.t[0] if words_.start is None else max(words_.start, plan.t[0])
    end = plan.t[-1] if words_.end is None else min(words_.end, plan.t[-1])
    if not 0.0 < words_.dt <= 0.1 or not start < end:
        parser.error("expected 0 < dt <= 0.1 and a start before the end, within the plan")
    times = np.linspace(start, end, max(round((end - start) / words_.dt), 1) + 1)
    problem = Problem(plan, times)
    solver = solve(problem, words_.iterations, not words_.quiet)
    away = [np.linalg.norm(problem.com(x) - plan.at("com", t)) for x, t in zip(solver.xs, times, strict=True)]
    worst = int(np.argmax(away))
    print(f"robot           {problem.model.nv} degrees of freedom, {pin.computeTotalMass(problem.model):.3f} kg")
    print(f"problem         {len(times) - 1} intervals from {start:g} s to {end:g} s")
    print(f"converged       {bool(solver.isFeasible and solver.stop < solver.th_stop)}")
    print(f"iterations      {solver.iter}, cost {solver.cost:.6g}, stopping criterion {solver.stop:.3g}")
    print(f"CoM deviation   {1e3 * away[worst]:.3f} mm at most, at {times[worst]:.2f} s")
    if words_.out is not None:
        np.savez(words_.out, t=times, x=np.array(list(solver.xs)), u=np.array(list(solver.us)))
    return 0 if solver.isFeasible and solver.stop < solver.th_stop and away[worst] < WITHIN else 1


if __name__ == "__main__":
    sys.exit(main())
