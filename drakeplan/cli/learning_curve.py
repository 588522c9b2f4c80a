"""`drakeplan train dynamics --learning-curve`: the same training on an eighth, a quarter, half and all of the scenes."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

from scenes.input_error import InputError

if TYPE_CHECKING:
    from learning.labelled_transitions import LabelledTransitions
    from learning.training.options import TrainingOptions
    from learning.training.recipe import Progress
    from scenes.robots.robot import Robot

FILE = "learning_curve.json"


def run_learning_curve(
    labels: LabelledTransitions,
    robot: Robot,
    out: Path,
    options: TrainingOptions,
    tell: Callable[[Progress], None],
    as_json: bool,
) -> int:
    """Trains on each share of the scenes, writes data and picture, prints the table and returns the exit status.

    Args:
        labels: all transitions with their labels.
        robot: whose transitions they are.
        out: folder for weights, data and picture.
        options: of each training.
        tell: receives progress.
        as_json: whether to print JSON instead of the table.
    """
    from drakeplan.cli.output import print_json
    from drakeplan.cli.training_pictures import draw_learning_curve
    from learning.training.learning_curve import learning_curve

    try:
        curve = learning_curve(labels, robot, out, options, lambda share, progress: tell(progress))
        (out / FILE).write_text(json.dumps(curve.facts(), indent=1) + "\n", encoding="utf-8")
        picture = draw_learning_curve(curve, out)
    except OSError as error:
        raise InputError(f"--out {out}: cannot be written ({error.strerror or error})") from None
    if as_json:
        print_json(curve.facts())
        return 0
    print(curve.text())
    print(f"wrote {out / FILE} and {picture}")
    return 0
