"""The public interface as a stranger uses it; a test has it checked by pyright, strictly, and nothing runs it."""

# pyright: strict

from __future__ import annotations

from pathlib import Path

import numpy as np

import drakeplan


def told(event: drakeplan.ProgressEvent) -> None:
    print(event.stage, event.message, event.cost, event.left)


def plan_by_name() -> drakeplan.Plan | None:
    result = drakeplan.plan_scene("stairs", "escher", drakeplan.PlanOptions(seed=3, expansions=200), progress=told)
    drakeplan.plan_scene("stairs")
    drakeplan.plan_scene(Path("stones.yaml"), Path("my_robot.yaml"), progress=False)
    drakeplan.plan_scene(drakeplan.load_scene("flat", seed=1), drakeplan.load_robot("escher"), progress=None)
    events: list[drakeplan.ProgressEvent] = []
    drakeplan.plan_scene("flat", options=drakeplan.PlanOptions(avoid=("stone_1",)), progress=events.append)
    status: str = result.status
    print(status, result.reason, result.notes, result.report["total_s"])
    return result.plan


def look_at(plan: drakeplan.Plan) -> float:
    print(plan.t[-1], plan.q.shape, plan.v.shape, plan.tau.shape, plan.com.mean(axis=0), plan.forces[0])
    names: tuple[str, ...] = plan.joint_names + plan.actuator_names
    state: drakeplan.PlanState = plan.at(0.5 * plan.duration)
    for contact in state.contacts.held:
        print(names, contact.effector, contact.p_WC, state.linear_momentum, state.angular_momentum)
    X_WB = plan.frames("pelvis", "left_foot")["pelvis"]
    return float(X_WB[-1, 0, 3] + np.linalg.norm(state.com) + state.v[0] + state.q[0] + state.forces.sum())


def change(plan: drakeplan.Plan, path: Path) -> drakeplan.PlanResult:
    X_WC = plan.contacts.X_WC[3].copy()
    X_WC[0, 3] += 0.05
    moved = plan.with_contact(3, X_WC)
    report: drakeplan.Report = drakeplan.verify(moved)
    print(report.holds, report.failed, [(check.name, check.worst, check.limit) for check in report.checks])
    drakeplan.write_plan(moved, path)
    print(drakeplan.verify(path).table(), drakeplan.verify(str(path), robot="escher").holds)
    return drakeplan.plan_motion(moved.scene(), None, moved.contact_sequence())


def own_contacts() -> drakeplan.PlanResult:
    scene = drakeplan.load_scene("flat")
    left = drakeplan.make_contact(scene, "left_foot", (0.0, 0.1, 0.0))
    right = drakeplan.make_contact(scene, "right_foot", [0.0, -0.1], yaw=0.1, robot="escher")
    step = drakeplan.make_contact(scene, "left_foot", np.array([0.25, 0.1, 0.0]))
    stances = [{"left_foot": left, "right_foot": right}, {"left_foot": step, "right_foot": right}]
    drakeplan.plan_motion(scene, "escher", [drakeplan.Stance((left, right, None, None)), stances[1]])
    return drakeplan.plan_motion(scene, "escher", stances, drakeplan.PlanOptions(timing=drakeplan.Timing(0.8, 0.8)))


def many() -> list[drakeplan.Plan]:
    options = [drakeplan.PlanOptions(seed=seed) for seed in range(4)]
    results = drakeplan.plan_many(["rubble_field"] * 4, "escher", options, workers=2, progress=told)
    results += drakeplan.plan_many([drakeplan.load_scene("flat"), Path("stones.yaml")])
    return [result.plan for result in results if result.plan is not None]
