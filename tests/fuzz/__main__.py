"""Reads inputs that are nearly right, and reports those that are not answered well.

    python tests/fuzz                             10 minutes, all kinds
    python tests/fuzz robots --seed 7 --seconds 3600 --out wrong
    python tests/fuzz meshes --seed 7 --only 1234 --out wrong

The last one makes one input again, keeps it and prints the answer.
"""

from __future__ import annotations

import argparse
import os
import sys
import tempfile
import time
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT))

from fuzz_campaign import campaign, work  # noqa: E402
from judge import FAULT, KINDS, judge  # noqa: E402


def main() -> int:
    if sys.argv[1:2] == ["--worker"]:
        kind, seed, first, last, folder = sys.argv[2:]
        work(kind, int(seed), int(first), int(last), Path(folder))
        return 0
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("kind", nargs="?", choices=[*KINDS, "all"], default="all")
    parser.add_argument("--seed", type=int, default=0, help="of the inputs")
    parser.add_argument("--first", type=int, default=0, help="index of the first input")
    parser.add_argument("--count", type=int, default=10**9, help="inputs of each kind")
    parser.add_argument("--seconds", type=float, default=600.0, help="for all kinds together")
    parser.add_argument("--only", type=int, help="make and read this one input")
    parser.add_argument(
        "--out", type=Path, default=Path("out/fuzz"), help="folder for inputs that were answered wrongly"
    )
    options = parser.parse_args()
    kinds = list(KINDS) if options.kind == "all" else [options.kind]
    out = options.out.resolve()
    if options.only is not None:
        return _one(kinds[0], options.seed, options.only, out)
    faults = 0
    for kind in kinds:
        until = time.monotonic() + options.seconds / len(kinds)
        summary = campaign(kind, options.seed, options.first, options.count, out, until=until)
        print(f"{kind}: {summary.line()}")
        for said, count in summary.refusals.most_common(12):
            print(f"  {count:6d}  {said or '(read)'}")
        for index, said in summary.faults.items():
            print(f"  fault {index}: {said.strip().splitlines()[-1][:300]}")
        faults += len(summary.faults)
    return 1 if faults else 0


def _one(kind: str, seed: int, index: int, out: Path) -> int:
    with tempfile.TemporaryDirectory() as home:
        if kind == "robots":
            os.environ |= {"XDG_CACHE_HOME": home, "FUZZ_CACHE": home}
        outcome = judge(kind, seed, index, out)
    print(f"{kind} {seed} {index}: {outcome.verdict} in {outcome.seconds:.3f} s\n{outcome.said}")
    return outcome.verdict == FAULT


if __name__ == "__main__":
    sys.exit(main())
