"""The simulated motion in place of the planned one, for the playback."""

from __future__ import annotations

import dataclasses

import numpy as np

from drakeplan.execution.report import ExecutionReport
from drakeplan.plan.plan import Plan


def played_plan(plan: Plan, report: ExecutionReport) -> Plan:
    """The plan with the configurations of a run at its own times; after a fall the last one stays.

    Args:
        plan: that was played.
        report: of the run.
    """
    assert plan.motion is not None
    # Plan time stands still while a touch is waited for: the last state of such a time is the one that is shown.
    last = np.append(np.diff(report.plan_time) > 0.0, True)
    s, q = report.plan_time[last], report.q[last]
    frames = np.stack([np.interp(plan.motion.t, s, column) for column in q.T], axis=1)
    frames[:, :4] /= np.linalg.norm(frames[:, :4], axis=1, keepdims=True)
    motion = dataclasses.replace(plan.motion, q=frames, v=np.zeros_like(plan.motion.v), tau=None, actuator_names=())
    return dataclasses.replace(plan, motion=motion)
