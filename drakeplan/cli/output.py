"""What commands print for programs, and while they read."""

from __future__ import annotations

import contextlib
import json
import math
import os
import sys
import time
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from scenes.scene import Scene

LARGE = 5e6  # [bytes] a file that takes more than a second or two to read


def print_json(value: Mapping[str, object]) -> None:
    """One JSON object; numbers that are not finite, which JSON lacks, become null."""
    print(json.dumps(_finite(value), indent=2, allow_nan=False, default=_plain))


def read_scene_aloud(source: str, seed: int) -> Scene:
    """`load_scene`, which for a large file first says on standard error that it is being read.

    Args:
        source: of the scene.
        seed: of the named scenes that draw something.
    """
    from scenes.files.scene_source import load_scene

    with contextlib.suppress(OSError, ValueError):
        size = Path(source).stat().st_size
        if size > LARGE:
            print(f"reading {source}, {size / 1e6:.0f} MB", file=sys.stderr, flush=True)
    return load_scene(source, seed=seed)


def _finite(value: object) -> object:
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    if isinstance(value, Mapping):
        return {str(key): _finite(item) for key, item in value.items()}
    if isinstance(value, Sequence) and not isinstance(value, str | bytes):
        return [_finite(item) for item in value]
    return value


def _plain(value: object) -> object:
    """NumPy's numbers and arrays, and paths."""
    if hasattr(value, "tolist"):
        return _finite(value.tolist())  # type: ignore[attr-defined]
    return str(value)


def seconds_since_process_start() -> float:
    """Age of this process, interpreter start-up included (Linux; elsewhere what `perf_counter` says)."""
    try:
        ticks = int(Path("/proc/self/stat").read_text().rpartition(")")[2].split()[19])
        return time.clock_gettime(time.CLOCK_BOOTTIME) - ticks / os.sysconf("SC_CLK_TCK")
    except (OSError, ValueError, IndexError, AttributeError):
        return time.perf_counter()
