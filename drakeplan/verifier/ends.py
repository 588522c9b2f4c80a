"""Whether the plan starts and ends where the scene says."""

from __future__ import annotations

import numpy as np

from .geometry import angle_between
from .limits import (
    EFFECTORS,
    GOAL_HEIGHT,
    GOAL_YAW,
    START_DISTANCE,
    START_EXACT,
    START_EXACT_ANGLE,
    START_HEIGHT,
    START_YAW,
)
from .plan_file import PlanFile, UnreadablePlan
from .report import Sheet
from .scene import Scene, pose, triple


def check_ends(sheet: Sheet, plan: PlanFile, scene: Scene) -> None:
    """First and last stance against the scene's start and goal.

    Raises:
        UnreadablePlan: the scene has no start or goal, or one of the wrong form.

    Args:
        sheet: takes the checks.
        plan: the plan file.
        scene: the plan's scene.
    """
    stances = plan["stances/contact"]
    try:
        if scene.start.get("stance"):
            _check_start_stance(sheet, plan, scene, scene.start["stance"])
        else:
            xyz, yaw = triple(scene.start["xyz"]), float(scene.start.get("yaw") or 0.0)
            mean, heading = _feet(plan, stances[0])
            sheet.add("start", np.linalg.norm(mean[:2] - xyz[:2]), START_DISTANCE, "m", _spot(mean))
            sheet.add("start height", abs(mean[2] - xyz[2]), START_HEIGHT, "m", _spot(mean))
            sheet.add("start heading", abs(_wrap(heading - yaw)), START_YAW, "rad", f"heading {heading:.3f}")
        xyz, radius = triple(scene.goal["xyz"]), float(scene.goal.get("radius", 0.2))
        mean, heading = _feet(plan, stances[-1])
        sheet.add("goal", np.linalg.norm(mean[:2] - xyz[:2]), radius + 1e-9, "m", _spot(mean))
        sheet.add("goal height", abs(mean[2] - xyz[2]), GOAL_HEIGHT + 1e-9, "m", _spot(mean))
        if scene.goal.get("yaw") is not None:
            off = abs(_wrap(heading - float(scene.goal["yaw"])))
            sheet.add("goal heading", off, GOAL_YAW + 1e-9, "rad", f"heading {heading:.3f}")
    except (KeyError, TypeError, ValueError, AttributeError) as error:
        raise UnreadablePlan(f"scene/yaml: start or goal is missing or wrong ({error})") from None


def _check_start_stance(sheet: Sheet, plan: PlanFile, scene: Scene, wanted: dict) -> None:
    """The first stance is the one that the scene gives, contact by contact."""
    distance, angle = [], []
    for e, name in enumerate(EFFECTORS):
        entry, c = wanted.get(name), plan["stances/contact"][0, e]
        if entry is None or c < 0:
            distance.append(0.0 if entry is None and c < 0 else np.inf)
            angle.append(0.0)
            continue
        X, X_WC = pose(entry), plan["contacts/X_WC"][c]
        same = scene.surface(str(entry["surface"])) == plan["contacts/surface"][c]
        distance.append(np.linalg.norm(X[:3, 3] - X_WC[:3, 3]) if same else np.inf)
        angle.append(angle_between(X[None, :3, :3], X_WC[:3, :3])[0])
    sheet.add("start", distance, START_EXACT, "m", lambda i: EFFECTORS[i[0]])
    sheet.add("start heading", angle, START_EXACT_ANGLE, "rad", lambda i: EFFECTORS[i[0]])


def _feet(plan: PlanFile, stance: np.ndarray) -> tuple[np.ndarray, float]:
    """(3,) mean of the feet in W [m] and their mean heading [rad]; NaN without feet."""
    X = plan["contacts/X_WC"][[c for c in stance[:2] if c >= 0]]
    if not len(X):
        return np.full(3, np.nan), np.nan
    # A foot's x is its heading projected on a tilted surface; undo that along the normal.
    forward = X[:, :2, 0] - X[:, 2:3, 0] / X[:, 2:3, 2] * X[:, :2, 2]
    forward = (forward / np.linalg.norm(forward, axis=1, keepdims=True)).sum(axis=0)
    return X[:, :3, 3].mean(axis=0), float(np.arctan2(forward[1], forward[0]))


def _spot(point: np.ndarray) -> str:
    return f"mean of the feet at x {point[0]:.3f}, y {point[1]:.3f}, z {point[2]:.3f}"


def _wrap(angle: float) -> float:
    return (angle + np.pi) % (2 * np.pi) - np.pi
