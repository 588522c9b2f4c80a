"""Many inputs in a process of their own, watched: one that hangs is killed, one that dies is noted, and the rest goes on."""

from __future__ import annotations

import json
import os
import resource
import select
import subprocess
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

from judge import FAULT, Outcome, answer, judge

HERE = Path(__file__).resolve().parent
START = 900.0  # [s] until the first input is begun: imports, and kernels that compile
HANGS = 60.0  # [s] after which an input counts as hung; the limits on processor time are much lower
HEADROOM = 4 * 2**30  # bytes of address space beyond what the process has after its start


@dataclass
class Summary:
    """What became of a campaign.

    Attributes:
        verdicts: how many of each.
        faults: index -> what was wrong.
        seconds: of processor time for each input, its start left out.
        refusals: how often each refusal was given, numbers and names left out.
    """

    verdicts: Counter = field(default_factory=Counter)
    faults: dict[int, str] = field(default_factory=dict)
    seconds: list[float] = field(default_factory=list)
    refusals: Counter = field(default_factory=Counter)

    def line(self) -> str:
        """Counts and times."""
        ordered = sorted(self.seconds) or [0.0]
        counts = ", ".join(f"{count} {verdict}" for verdict, count in sorted(self.verdicts.items()))
        times = f"{1e3 * ordered[len(ordered) // 2]:.1f} ms each (median), {ordered[-1]:.2f} s at most, {sum(ordered):.0f} s in all"
        return f"{len(self.seconds)} inputs: {counts}; {times}"


def campaign(kind: str, seed: int, first: int, count: int, folder: Path, *, until: float = float("inf")) -> Summary:
    """Judges the inputs `first` to `first + count - 1`.

    Args:
        kind: of `judge.KINDS`.
        seed: of the inputs.
        first: index of the first.
        count: how many.
        folder: takes the inputs that were answered wrongly.
        until: time by `time.monotonic` at which it stops early.
    """
    summary = Summary()
    following, last = first, first + count
    while following < last and time.monotonic() < until:
        following = _one_worker(kind, seed, following, last, folder, until, summary)
    return summary


def _one_worker(kind: str, seed: int, first: int, last: int, folder: Path, until: float, summary: Summary) -> int:
    """Runs one worker until it ends in one way or the other; returns the index to go on with."""
    words = [sys.executable, str(HERE), "--worker", kind, str(seed), str(first), str(last), str(folder)]
    with tempfile.TemporaryDirectory() as home, tempfile.TemporaryFile() as noise:
        environment = {**os.environ, "XDG_CACHE_HOME": home, "FUZZ_CACHE": home} if kind == "robots" else None
        process = subprocess.Popen(words, stdout=subprocess.PIPE, stderr=noise, env=environment)
        current, ended = first, "hung"
        try:
            for event in _events(process, until):
                if "verdict" in event:
                    outcome = Outcome(event["verdict"], event["said"], event["seconds"])
                    _note(summary, event["index"], outcome)
                current = event["index"] + ("verdict" in event)
            if time.monotonic() >= until:
                return last
            if process.poll() is not None or _ends_soon(process):
                ended = f"died with exit status {process.returncode}"
        finally:
            process.kill()
            process.wait()
        if current < last:
            noise.seek(0)
            words_left = noise.read().decode("utf-8", "replace")[-1500:]
            _note(summary, current, Outcome(FAULT, f"the process {ended}: {words_left}", 0.0))
        return current + 1


def _ends_soon(process: subprocess.Popen) -> bool:
    try:
        process.wait(timeout=2.0)
    except subprocess.TimeoutExpired:
        return False
    return True


def _events(process: subprocess.Popen, until: float) -> Iterator[dict]:
    """What the worker tells; ends when it ends, says nothing for too long, or time is up."""
    assert process.stdout is not None
    pending, patience = b"", START
    while True:
        wait = min(patience, until - time.monotonic())
        if wait <= 0 or not select.select([process.stdout], [], [], wait)[0]:
            return
        new = os.read(process.stdout.fileno(), 1 << 16)
        if not new:
            return
        *lines, pending = (pending + new).split(b"\n")
        for line in lines:
            yield json.loads(line)
        patience = HANGS


def _note(summary: Summary, index: int, outcome: Outcome) -> None:
    summary.verdicts[outcome.verdict] += 1
    summary.seconds.append(outcome.seconds)
    if outcome.verdict == FAULT:
        summary.faults[index] = outcome.said
    else:
        summary.refusals[_kind_of(outcome.said)] += 1


def _kind_of(said: str) -> str:
    """A refusal without its file: what stands after the last folder."""
    return said.rpartition("/")[2].partition(": ")[2][:60]


def work(kind: str, seed: int, first: int, last: int, folder: Path) -> None:
    """The worker: reads good inputs, so that all is loaded and compiled, then judges and tells."""
    from good_inputs import good_inputs

    for path in good_inputs(kind, folder / "good"):
        answer(kind, path)
    pages = int(Path("/proc/self/statm").read_text(encoding="ascii").split()[0])
    limit = pages * resource.getpagesize() + HEADROOM
    resource.setrlimit(resource.RLIMIT_AS, (limit, limit))
    out = os.fdopen(os.dup(1), "w", encoding="ascii")
    for index in range(first, last):
        print(json.dumps({"index": index}), file=out, flush=True)
        outcome = judge(kind, seed, index, folder)
        print(json.dumps({"index": index, **outcome.__dict__}), file=out, flush=True)
