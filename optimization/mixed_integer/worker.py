"""The process in which a mixed-integer solver runs: it may crash, hang or eat memory, and the caller lives.

Run as `python -m optimization.mixed_integer.worker`. It reads one pickled `Job` from its standard input and writes
frames to its standard output: eight bytes of length, then a pickled tuple

    ("news", seconds, cost, bound, x or None)      a new incumbent, or a better bound
    ("end", seconds, status)                        the solver's own word for how it ended
    ("error", seconds, kind, message)               an exception, by the name of its class
"""

from __future__ import annotations

import os
import pickle
import struct
import sys
import time
from dataclasses import dataclass
from importlib import import_module
from typing import Any, BinaryIO

import numpy as np

from optimization.mixed_integer.data import MixedIntegerData


@dataclass(frozen=True, eq=False)
class Job:
    """What the worker is to do.

    Attributes:
        entry: "module:function" of the solver, called as `scip_adapter.solve` is.
        data: the program.
        time_limit: seconds, which the solver should honour by itself.
        gap: relative gap at which to stop.
        first_only: stop at the first feasible answer.
    """

    entry: str
    data: MixedIntegerData
    time_limit: float
    gap: float
    first_only: bool


def write_frame(stream: BinaryIO, frame: tuple[Any, ...]) -> None:
    """Appends one frame.

    Args:
        stream: binary pipe.
        frame: values to send.
    """
    payload = pickle.dumps(frame)
    stream.write(struct.pack("<q", len(payload)) + payload)
    stream.flush()


def main() -> None:
    """Runs the job on standard input."""
    # Solvers print to standard output as they please: frames get a descriptor of their own.
    frames = os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)
    job: Job = pickle.load(sys.stdin.buffer)
    began = time.perf_counter()

    def tell(cost: float, bound: float, x: np.ndarray | None) -> None:
        write_frame(frames, ("news", time.perf_counter() - began, float(cost), float(bound), x))

    try:
        module, _, function = job.entry.partition(":")
        status = getattr(import_module(module), function)(job.data, job.time_limit, job.gap, job.first_only, tell)
        write_frame(frames, ("end", time.perf_counter() - began, str(status)))
    except Exception as error:
        write_frame(frames, ("error", time.perf_counter() - began, type(error).__name__, str(error)))


if __name__ == "__main__":
    main()
