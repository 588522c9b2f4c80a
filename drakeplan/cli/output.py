"""What commands print on standard output for programs."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence


def print_json(value: Mapping[str, object]) -> None:
    """One JSON object; numbers that are not finite, which JSON lacks, become null."""
    print(json.dumps(_finite(value), indent=2, allow_nan=False, default=_plain))


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
