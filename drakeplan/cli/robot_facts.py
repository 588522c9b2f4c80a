"""What `--json` says of a robot."""

from __future__ import annotations

from scenes.robots.robot import Robot


def robot_facts(robot: Robot) -> dict[str, object]:
    """Its name, model, mass and end effectors."""
    return {
        "name": robot.name,
        "path": str(robot.model),
        "sha256": robot.model_sha256,
        "mass": robot.mass,
        "effectors": {e.name: {"frame": e.frame, "half_extent": list(e.half_extent)} for e in robot.effectors},
    }
