"""What the verifier found: checks with their worst values, limits and places."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np


@dataclass(frozen=True)
class Check:
    """One demand on the plan.

    Attributes:
        name: of the check.
        ok: whether the plan meets it; never when `worst` is not a number.
        worst: the worst value found; NaN where there was nothing to look at.
        limit: greatest value that is allowed.
        unit: of both; empty for counts.
        where: the place of the worst value.
    """

    name: str
    ok: bool
    worst: float
    limit: float
    unit: str
    where: str


@dataclass(frozen=True)
class Report:
    """What the verifier found.

    Attributes:
        path: the plan file.
        checks: in the order of the verifier's sections. When the data cannot be interpreted the list ends early.
        remark: why the list ends early, empty when it does not.
    """

    path: str
    checks: tuple[Check, ...]
    remark: str = ""

    @property
    def holds(self) -> bool:
        """Whether every check was made and met."""
        return bool(self.checks) and not self.remark and all(check.ok for check in self.checks)

    @property
    def failed(self) -> tuple[str, ...]:
        """Names of the checks that the plan does not meet."""
        return tuple(check.name for check in self.checks if not check.ok)

    def check(self, name: str) -> Check:
        """The check of this name."""
        return next(check for check in self.checks if check.name == name)

    def table(self) -> str:
        """One line a check, then the verdict."""
        width = max((len(check.name) for check in self.checks), default=0)
        lines = []
        for c in self.checks:
            sign, verdict = ("<=", "ok  ") if c.ok else ("> ", "FAIL")
            line = f"{verdict}  {c.name:<{width}}  {c.worst:11.4g} {sign} {c.limit:<9.4g} {c.unit:<7} {c.where}"
            lines.append(line.rstrip())
        verdict = "the plan holds" if self.holds else f"the plan does not hold: {', '.join(self.failed)}"
        return "\n".join([*lines, *([self.remark] if self.remark else []), verdict])

    def __str__(self) -> str:
        return self.table()

    def as_dict(self) -> dict[str, object]:
        """The same as plain data for JSON; numbers that are not finite become null."""

        def number(value: float) -> float | None:
            return float(value) if math.isfinite(value) else None

        checks = [
            {"name": c.name, "ok": c.ok, "worst": number(c.worst), "limit": number(c.limit), "unit": c.unit}
            | {"where": c.where}
            for c in self.checks
        ]
        failed = list(self.failed)
        return {"path": self.path, "holds": self.holds, "failed": failed, "remark": self.remark, "checks": checks}


Place = Callable[[tuple[int, ...]], str]


@dataclass
class Sheet:
    """Collects checks."""

    checks: list[Check] = field(default_factory=list)

    def add(self, name: str, values: object, limit: float, unit: str, where: Place | str, *, empty: str = "") -> bool:
        """Adds a check that no entry of `values` exceeds `limit`; returns whether it is met.

        Args:
            name: of the check.
            values: array of any shape.
            limit: greatest value allowed.
            unit: of both.
            where: the place, or a function from the index of the worst entry to its place.
            empty: the place to report where it is correct that there are no entries; without it no entries is a failure.
        """
        array = np.atleast_1d(np.asarray(values, dtype=float))
        if not array.size:
            self.checks.append(Check(name, bool(empty), 0.0 if empty else np.nan, limit, unit, empty or "no data"))
            return bool(empty)
        # A NaN is worse than any number, and argmax finds it first.
        index = np.unravel_index(int(np.argmax(array)), array.shape)
        worst = float(array[index])
        ok = bool(worst <= limit)
        nowhere = ok and worst == limit == 0 and not isinstance(where, str)  # nothing was counted, so nothing is worst
        place = where if isinstance(where, str) else "" if nowhere else where(tuple(int(i) for i in index))
        self.checks.append(Check(name, ok, worst, limit, unit, place))
        return ok


def which_end(index: int) -> str:
    return ("at the start", "at the end")[index]
