"""`python -m drakeplan.verifier PLAN.h5 [--json]`."""

from __future__ import annotations

import json
import sys
from collections.abc import Sequence

from .plan_file import UnreadablePlan
from .verification import verify


def main(arguments: Sequence[str]) -> int:
    """Prints the report, as one JSON object with `--json`; returns 0 if the plan holds, 1 if not, 2 if it is unreadable."""
    try:
        report = verify(arguments[0])
    except UnreadablePlan as error:
        print(error, file=sys.stderr)
        return 2
    print(json.dumps(report.as_dict()) if "--json" in arguments else report.table())
    return 0 if report.holds else 1


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
