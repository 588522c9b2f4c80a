"""`drakeplan train`: from labels to the weights of a surrogate."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import tyro

from scenes.input_error import InputError, unknown_name

if TYPE_CHECKING:
    from learning.training.recipe import Progress, Trained

ABOUT = """Trains surrogates: stand-ins that answer in microseconds what a program answers in milliseconds.

SURROGATE is `dynamics`: feasibility, objective, final CoM and velocity of a contact transition (Lin et al. 2019).
The data come from `drakeplan collect`. Scenes are held out whole; the table is of scenes that were not trained on.

A training that was killed goes on from its last epoch when the same command is given again, and the same data, options
and seed give the same bytes on a CPU.

examples:
  drakeplan train dynamics --data labels --out weights
  drakeplan train dynamics --data labels --out weights --kind documented --json"""

SURROGATES = ("dynamics",)
QUIET = 0.5  # [s] between lines on a terminal


@dataclass(frozen=True)
class Arguments:
    """Words after `drakeplan train`."""

    surrogate: Annotated[str, tyro.conf.Positional, tyro.conf.arg(metavar="SURROGATE")]
    """which one: dynamics"""
    data: Annotated[str, tyro.conf.arg(metavar="DIR")] = ""
    """folder of shards that `drakeplan collect` wrote"""
    out: Annotated[str, tyro.conf.arg(metavar="DIR")] = ""
    """where weights, card, curves and report go"""
    robot: Annotated[str, tyro.conf.arg(metavar="NAME")] = "escher"
    """whose dynamics the labels are"""
    kind: Literal["shared", "documented"] = "shared"
    """one network for all categories, or a classifier and a regressor for each as documented"""
    width: int | None = None
    """units of a hidden layer (default: 192; documented 256)"""
    depth: int | None = None
    """hidden layers (default: 3)"""
    epochs: int | None = None
    """passes over the data (default: 50; documented 100)"""
    members: int | None = None
    """networks whose answers are averaged (shared only) (default: 2)"""
    recall: float = 0.95
    """least share of feasible transitions that the threshold lets through"""
    seed: int = 0
    """of the split, the initial weights and the order of the rows"""
    json: bool = False
    """one JSON object on standard output"""


def run(arguments: Arguments) -> int:
    """Trains, writes and prints the table of the held-out scenes."""
    if arguments.surrogate not in SURROGATES:
        raise unknown_name("surrogate", arguments.surrogate, SURROGATES)
    for name in ("data", "out"):
        if not getattr(arguments, name):
            raise InputError(f"drakeplan train: --{name} is missing; see drakeplan train --help")
    if find_spec("torch") is None:
        raise InputError("drakeplan train needs torch: pip install 'drakeplan[train]'")
    from learning.labelled_transitions import read_labels
    from learning.training.options import recommended
    from scenes.robot import load_robot

    given = {name: getattr(arguments, name) for name in ("width", "depth", "epochs", "members")}
    given = {name: value for name, value in given.items() if value is not None}
    options = replace(recommended(arguments.kind), recall=arguments.recall, seed=arguments.seed, **given)
    robot = load_robot(arguments.robot)
    labels = read_labels(Path(arguments.data), robot.name)
    from learning.training.recipe import train_dynamics

    try:
        trained = train_dynamics(labels, robot, Path(arguments.out), options, _printer())
    except OSError as error:
        raise InputError(f"--out {arguments.out}: cannot be written ({error.strerror or error})") from None
    _draw_curves(Path(arguments.out))
    _show(trained, arguments.json)
    return 0


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
            file=sys.stderr, flush=True,
        )  # fmt: skip

    return tell


def _show(trained: Trained, as_json: bool) -> None:
    if as_json:
        from drakeplan.cli.output import print_json

        print_json({"weights": str(trained.path.resolve()), **trained.report.facts()})
        return
    print(trained.report.text())
    print(f"wrote {trained.path}")


def _draw_curves(folder: Path) -> None:
    """Training and validation loss of every network, and the reliability curve, as one picture."""
    import csv
    import json

    import matplotlib as mpl

    mpl.use("Agg")
    import matplotlib.pyplot as plt

    figure, (left, right) = plt.subplots(1, 2, figsize=(11, 4.5))
    with (folder / "curves.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    for name in dict.fromkeys(row["network"] for row in rows):
        mine = [row for row in rows if row["network"] == name]
        epochs = [int(row["epoch"]) for row in mine]
        (line,) = left.plot(epochs, [float(row["training_loss"]) for row in mine], label=name)
        left.plot(epochs, [float(row["validation_loss"]) for row in mine], "--", color=line.get_color())
    left.set(xlabel="epoch", ylabel="loss (dashed: scenes held out)", yscale="log")
    left.legend(fontsize=6, ncol=2)
    curve = json.loads((folder / "report.json").read_text(encoding="utf-8"))["reliability"]
    right.plot([0, 1], [0, 1], color="0.8")
    right.plot(curve["predicted"], curve["observed"], "o-")
    right.set(xlabel="predicted probability of being feasible", ylabel="observed share", xlim=(0, 1), ylim=(0, 1))
    figure.tight_layout()
    figure.savefig(folder / "curves.png", dpi=120)
    plt.close(figure)
