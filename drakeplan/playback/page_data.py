"""What the script of a page needs to know of a plan: when contacts change, what holds, how hard forces and joints are used."""

from __future__ import annotations

import base64

import numpy as np

from drakeplan.plan.plan import Plan
from drakeplan.playback.contact_timeline import contact_timeline, has_motion
from drakeplan.playback.frame_times import frame_times
from drakeplan.playback.friction_used import friction_used
from drakeplan.playback.torque_shares import torque_shares
from scenes.robots.robot import Robot

MOST = 255  # [%] that a byte holds
DIGITS = 6  # of times; enough for microseconds


def page_data(plan: Plan, robot: Robot) -> dict[str, object]:
    """What `page.js` reads, ready for JSON; times are seconds since the motion began, shares are bytes in percent (base64).

    Args:
        plan: complete or of contacts alone.
        robot: the plan's.
    """
    timeline = contact_timeline(plan)
    held = [np.flatnonzero(row >= 0).tolist() for row in timeline.contact]
    data: dict[str, object] = {
        "duration": round(timeline.duration, DIGITS),
        "timed": timeline.timed,
        "changes": timeline.changes.round(DIGITS).tolist(),
        "stances": len(plan.stances),
        "effectors": list(plan.effectors),
        "phases": {"t": timeline.start.round(DIGITS).tolist(), "stance": (timeline.stance + 1).tolist(), "held": held},
        "forces": None,
        "torques": None,
    }
    if has_motion(plan):
        assert plan.centroidal is not None
        assert plan.motion is not None
        used = friction_used(plan)
        knots = (plan.centroidal.t - plan.centroidal.t[0]).round(DIGITS).tolist()
        data["forces"] = {"t": knots, "used": [percent_bytes(column) for column in used.T]}
        frames = frame_times(plan.duration)
        torques = torque_shares(plan.motion, robot, frames.t)
        if torques is not None:
            shares = percent_bytes(torques.share)
            data["torques"] = {"rate": frames.rate, "names": list(torques.names), "share": shares}
    return data


def percent_bytes(share: np.ndarray) -> str:
    """Shares as whole percents, one byte each, in rows, in base64; at most `MOST`."""
    percent = np.clip(np.nan_to_num(100.0 * share, posinf=MOST), 0, MOST)
    return base64.b64encode(np.round(percent).astype(np.uint8).tobytes()).decode()
