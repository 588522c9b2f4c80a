"""`drakeplan train`: from labels to the weights of a surrogate."""

from __future__ import annotations

import os
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import tyro

from drakeplan.cli.arguments import Packages
from scenes.input_error import InputError, unknown_name

if TYPE_CHECKING:
    from learning.training.recipe import Progress, Trained

ABOUT = """Trains surrogates: networks that predict in microseconds what a program computes in milliseconds.

SURROGATE is one of
  dynamics        feasibility, objective, final CoM and velocity of a contact transition (Lin et al. 2019); needs torch
  capture         whether a pushed robot comes to rest (Lin 2020 ch. VII): three kinds of networks; needs torch
  traversability  how many footsteps lead on from a torso pose (Lin & Berenson 2017): a network, and the four
                  regressors of that paper
The data come from `drakeplan collect`. Whole scenes are held out; the table reports errors on scenes that were not used in training.

A training of dynamics that was killed goes on from its last epoch when the same command is given again, and the same data,
options and seed give the same bytes on a CPU. Traversability takes 10 s; of the options it knows --data, --out, --robot,
--package, --seed and --json. Capture takes minutes, and knows --epochs too.

examples:
  drakeplan train dynamics --data labels --out weights
  drakeplan train dynamics --data labels --out weights --kind documented --json
  drakeplan train dynamics --data labels --out curve --learning-curve --epochs 10
  drakeplan train dynamics --data walking --out weights --kind shared
  drakeplan train dynamics --data labels --robot my_robot --kind shared
  drakeplan train capture --data captures --out weights
  drakeplan train traversability --data footsteps --out weights"""

SURROGATES = ("dynamics", "capture", "traversability")
QUIET = 0.5  # [s] between lines on a terminal


@dataclass(frozen=True)
class Arguments:
    """Arguments of `drakeplan train`."""

    surrogate: Annotated[str, tyro.conf.Positional, tyro.conf.arg(metavar="SURROGATE")]
    """which one: dynamics, capture or traversability"""
    data: Annotated[str, tyro.conf.arg(metavar="DIR")] = ""
    """folder of shards that `drakeplan collect` wrote"""
    out: Annotated[str, tyro.conf.arg(metavar="DIR")] = ""
    """where weights, card, curves and report go (dynamics of a robot that you added: by default beside its robot file, where
    `plan` finds them)"""
    robot: Annotated[str, tyro.conf.arg(metavar="NAME")] = "escher"
    """robot of the labels"""
    package: Packages = ()
    """folder of package://NAME addresses in the robot's model; may be given several times"""
    kind: Literal["palms", "shared", "documented"] = "palms"
    """a network for each number of palms held, one for all (for few labels), or two for each category as in Lin et al. 2019"""
    width: int | None = None
    """units of a hidden layer (default: 384; shared 192, documented 256)"""
    depth: int | None = None
    """hidden layers (default: 3)"""
    epochs: int | None = None
    """passes over the data (default: 100; shared 50)"""
    members: int | None = None
    """networks whose answers are averaged, not for documented (default: 1; shared 2)"""
    recall: float = 0.95
    """lowest recall of feasible transitions at the threshold"""
    seed: int = 0
    """of the split, the initial weights and the order of the rows"""
    learning_curve: bool = False
    """train on an eighth, a quarter, half and all of the scenes instead, and print the expected gain of more labels"""
    json: bool = False
    """one JSON object on standard output"""


def run(arguments: Arguments) -> int:
    """Trains, writes and prints the table of the held-out scenes."""
    if arguments.surrogate not in SURROGATES:
        raise unknown_name("surrogate", arguments.surrogate, SURROGATES)
    arguments = _with_own_folder(arguments)
    for name in ("data", "out"):
        if not getattr(arguments, name):
            raise InputError(f"drakeplan train: --{name} is missing; see drakeplan train --help")
    out = Path(arguments.out)
    if not os.access(next(folder for folder in (out, *out.absolute().parents) if folder.exists()), os.W_OK):
        raise InputError(f"--out {arguments.out}: cannot be written")
    if arguments.surrogate == "traversability":
        from drakeplan.cli.train_traversability import run_traversability

        packages, seed = tuple(arguments.package), arguments.seed
        return run_traversability(arguments.data, arguments.out, arguments.robot, packages, seed, arguments.json)
    if find_spec("torch") is None:
        raise InputError("drakeplan train needs torch: pip install 'drakeplan[train]'")
    if arguments.surrogate == "capture":
        from drakeplan.cli.train_capture import run_capture

        packages, seed = tuple(arguments.package), arguments.seed
        return run_capture(
            arguments.data, arguments.out, arguments.robot, packages, seed, arguments.epochs, arguments.json
        )
    from learning.labelled_transitions import read_labels
    from learning.training.options import recommended
    from scenes.robots.addresses import read_packages
    from scenes.robots.robot import load_robot

    given = {name: getattr(arguments, name) for name in ("width", "depth", "epochs", "members")}
    given = {name: value for name, value in given.items() if value is not None}
    options = replace(recommended(arguments.kind), recall=arguments.recall, seed=arguments.seed, **given)
    robot = load_robot(arguments.robot, read_packages(arguments.package))
    labels = read_labels(Path(arguments.data), robot.name)
    if arguments.learning_curve:
        from drakeplan.cli.learning_curve import run_learning_curve

        return run_learning_curve(labels, robot, Path(arguments.out), options, _printer(), arguments.json)
    from learning.training.recipe import train_dynamics

    try:
        trained = train_dynamics(labels, robot, Path(arguments.out), options, _printer())
    except OSError as error:
        raise InputError(f"--out {arguments.out}: cannot be written ({error.strerror or error})") from None
    from drakeplan.cli.training_pictures import draw_training

    draw_training(Path(arguments.out))
    _show(trained, arguments.json)
    return 0


def _with_own_folder(arguments: Arguments) -> Arguments:
    """The arguments; where a user's robot learns its dynamics and no folder is named, the one where `plan` looks for them."""
    from learning.surrogate import own_weights_folder
    from scenes.robots.addresses import read_packages
    from scenes.robots.robot import load_robot

    if arguments.out or arguments.surrogate != "dynamics" or arguments.learning_curve:
        return arguments
    folder = own_weights_folder(load_robot(arguments.robot, read_packages(arguments.package)))
    return arguments if folder is None else replace(arguments, out=str(folder))


def _printer() -> Callable[[Progress], None]:
    """Lines on standard error: at every tenth of a network, and in between where they do not come too fast."""
    said = start = time.monotonic()

    def tell(progress: Progress) -> None:
        nonlocal said
        now = time.monotonic()
        last = progress.epoch == progress.epochs
        if not last and (
            now - said < QUIET or (not sys.stderr.isatty() and progress.epoch % -(-progress.epochs // 10))
        ):
            return
        said = now
        print(
            f"[{now - start:6.1f} s] {progress.network} ({progress.number} of {progress.networks}) epoch {progress.epoch}"
            f" of {progress.epochs}: loss {progress.loss:.4f}, held out {progress.validation:.4f}",
            file=sys.stderr,
            flush=True,
        )

    return tell


def _show(trained: Trained, as_json: bool) -> None:
    if as_json:
        from drakeplan.cli.output import print_json

        print_json({"weights": str(trained.path.resolve()), **trained.report.facts()})
        return
    print(trained.report.text())
    print(f"wrote {trained.path}")
