"""A campaign that knows no dynamics: it draws numbers, sorts them, and misbehaves where it is told to."""

from __future__ import annotations

import ctypes
import os
import sys
import time
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import pyarrow as pa

SCHEMA = pa.schema(
    [
        pa.field("scene", pa.int64(), nullable=False),
        pa.field("kind", pa.string(), nullable=False),
        pa.field("numbers", pa.list_(pa.float64(), 3), nullable=False),
        pa.field("mean", pa.float64()),
    ]
)


@dataclass(frozen=True)
class Toy:
    """Each task draws a few rows; numbers of tasks that misbehave map to how."""

    version: int = 1
    scale: float = 1.0
    pause: float = 0.0
    mischief: dict[int, str] = field(default_factory=dict)
    schema: pa.Schema = SCHEMA
    name: str = "toy"
    count_by: Sequence[str] = ("kind",)

    @property
    def parameters(self) -> dict[str, object]:
        return {"scale": self.scale}

    def rows(self, seed: np.random.SeedSequence, task: int) -> list[dict[str, object]]:
        rng = np.random.default_rng(seed)
        time.sleep(self.pause * rng.uniform())
        rows = []
        for _ in range(int(rng.integers(1, 6))):
            numbers = np.sort(rng.normal(size=3)) * self.scale
            positive = bool(numbers[1] > 0)
            rows.append(
                {
                    "scene": task,
                    "kind": "high" if positive else "low",
                    "numbers": numbers,
                    "mean": float(numbers.mean()) if positive else None,
                }
            )
        return self._misbehave(self.mischief.get(task, ""), rows)

    def _misbehave(self, how: str, rows: list[dict[str, object]]) -> list[dict[str, object]]:
        if how == "raise":
            raise ArithmeticError("no answer\nto this")
        if how == "crash":
            ctypes.string_at(0)
        if how == "exit":
            os._exit(3)
        if how == "hang":
            while True:
                time.sleep(0.01)
        if how == "eat":
            np.ones(1 << 34)
        if how == "nan":
            rows[0]["numbers"] = np.full(3, np.nan)
        if how == "forget":
            del rows[0]["kind"]
        if how == "invent":
            rows[0]["colour"] = "red"
        if how == "null":
            rows[0]["kind"] = None
        return rows


def main(folder: str, tasks: int, pause: float) -> None:
    """Collects, resuming what is there; for tests that kill this process."""
    from drakeplan.campaigns.engine import CollectOptions, collect
    from drakeplan.campaigns.workers import LocalWorkers

    campaign = Toy(pause=pause)
    with LocalWorkers(campaign, 2) as workers:
        collect(campaign, Path(folder), CollectOptions(tasks, 7, 4), workers, resume=True)


if __name__ == "__main__":
    main(sys.argv[1], int(sys.argv[2]), float(sys.argv[3]))
