"""`drakeplan train capture`: from answered questions to the networks that planning against pushes asks."""

from __future__ import annotations

import sys
import time
from dataclasses import replace
from pathlib import Path


def run_capture(
    data: str, out: str, robot_name: str, packages: tuple[str, ...], seed: int, epochs: int | None, as_json: bool
) -> int:
    """Trains every kind of networks, writes weights and cards, and prints their table on held-out tasks.

    Args:
        data: folder of shards that `drakeplan collect capture` wrote.
        out: where weights and cards go.
        robot_name: robot of the labels.
        packages: folders of package:// addresses in the robot's model.
        seed: of the split, the initial weights and the order of the rows.
        epochs: passes over the data; None: as many as each kind needs.
        as_json: one JSON object on standard output.

    Raises:
        InputError: no such data, data of another robot, too few of them, or a folder that cannot be written.
    """
    from learning.capture_networks import KINDS
    from learning.training.capture import CaptureLabels, held_out_text, train_capture, usual_options
    from scenes.input_error import InputError
    from scenes.robots.addresses import read_packages
    from scenes.robots.robot import load_robot

    began = time.monotonic()

    def tell(name: str, epoch: int, of: int, loss: float, check: float) -> None:
        if epoch % -(-of // 4) == 0 or epoch == of:
            line = f"[{time.monotonic() - began:6.1f} s] {name} epoch {epoch} of {of}: loss {loss:.4f}, held out {check:.4f}"
            print(line, file=sys.stderr, flush=True)

    robot = load_robot(robot_name, read_packages(packages))
    labels = CaptureLabels.read(Path(data), robot)
    trained = []
    for kind in KINDS:
        options = usual_options(kind, seed)
        if epochs is not None:
            options = replace(options, epochs=epochs)
        try:
            trained.append(train_capture(labels, robot, Path(out), kind, options, tell))
        except OSError as error:
            raise InputError(f"--out {out}: cannot be written ({error.strerror or error})") from None
    if as_json:
        from dataclasses import asdict

        from drakeplan.cli.output import print_json

        kinds = {one.networks.kind: [asdict(fit) for fit in one.fits] for one in trained}
        print_json({"weights": str(Path(out).resolve()), "held_out": kinds})
        return 0
    for one in trained:
        print(held_out_text(one, every=True))
        print()
    print(f"wrote weights and cards of {len(trained)} kinds to {out}")
    return 0
