"""`drakeplan train traversability`: from counted footsteps to regressors of how hard ground is."""

from __future__ import annotations

import sys
import time
from pathlib import Path


def run_traversability(
    data: str, out: str, robot_name: str, packages: tuple[str, ...], seed: int, as_json: bool
) -> int:
    """Trains every kind of regressor, writes weights and cards, and prints their table on held-out environments.

    Args:
        data: folder of shards that `drakeplan collect traversability` wrote.
        out: where weights and cards go.
        robot_name: robot of the labels.
        packages: folders of package:// addresses in the robot's model.
        seed: of the split, of rows that are drawn and of initial weights.
        as_json: one JSON object on standard output.

    Raises:
        InputError: no such data, data of another robot, too few of them, or a folder that cannot be written.
    """
    from learning.training.footstep_counts import FootstepLabels, held_out_text, train_footstep_counts
    from scenes.input_error import InputError
    from scenes.robots.addresses import read_packages
    from scenes.robots.robot import load_robot

    began = time.monotonic()

    def tell(line: str) -> None:
        print(f"[{time.monotonic() - began:6.1f} s] {line}", file=sys.stderr, flush=True)

    if robot_name == "bracer":
        from drakeplan.bracing.bracer import Bracer
        from drakeplan.bracing.wall_frame import robot_on_wall

        robot = robot_on_wall(Bracer().mass)
    else:
        robot = load_robot(robot_name, read_packages(packages))
    labels = FootstepLabels.read(Path(data), robot)
    try:
        found = train_footstep_counts(labels, robot, Path(out), seed, tell)
    except OSError as error:
        raise InputError(f"--out {out}: cannot be written ({error.strerror or error})") from None
    if as_json:
        from drakeplan.cli.output import print_json

        print_json({"weights": str(Path(out).resolve()), "held_out": [one.facts() for one in found]})
        return 0
    print(held_out_text(found))
    print(f"wrote weights and cards of {len(found)} regressors to {out}")
    return 0
