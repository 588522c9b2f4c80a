"""Makes one input that is nearly right, lets it through the door that users take, and says how it was answered.

Right answers are: it is read, or an `InputError` of one printable line that names the file. Anything else is a fault: another
exception, words on standard output or error, more time or memory than a small file can need, files left behind.
"""

from __future__ import annotations

import contextlib
import os
import resource
import shutil
import sys
import tempfile
import time
import traceback
import warnings
from collections.abc import Iterator
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from random import Random

from scenes.input_error import InputError

KINDS = {"scenes": "scene_mutants", "meshes": "mesh_mutants", "robots": "robot_mutants", "commands": "command_lines"}
LONGEST = 1500  # letters of a refusal
MOST_MEMORY = 400.0  # [MB] that one small file may need
READ, REFUSED, FAULT = "read", "refused", "fault"


@dataclass(frozen=True)
class Outcome:
    """How an input was answered.

    Attributes:
        verdict: READ, REFUSED or FAULT.
        said: the refusal, or what was wrong.
        seconds: of processor time.
    """

    verdict: str
    said: str
    seconds: float


def judge(kind: str, seed: int, index: int, folder: Path) -> Outcome:
    """Makes and reads one input; its files stay in a folder of their own if there was a fault.

    Args:
        kind: of `KINDS`.
        seed: of the campaign.
        index: of the input; kind, seed and index decide what it is.
        folder: takes the input's folder.
    """
    where = folder / f"{kind}_{seed}_{index}"
    shutil.rmtree(where, ignore_errors=True)
    where.mkdir(parents=True)
    module = import_module(KINDS[kind])
    path = module.make(Random(f"{kind} {seed} {index}"), where)
    outcome = answer(kind, path)
    if outcome.verdict == FAULT:
        (where / "fault.txt").write_text(f"{outcome.said}\n", encoding="utf-8", errors="backslashreplace")
    else:
        shutil.rmtree(where, ignore_errors=True)
    return outcome


def answer(kind: str, path: Path) -> Outcome:
    """How a file is answered; what takes too long gets a second try, since kernels may have been compiled in the first.

    Args:
        kind: of `KINDS`.
        path: of the input.
    """
    outcome = _answer(kind, path)
    limit = import_module(KINDS[kind]).SECONDS
    if outcome.seconds > limit and outcome.verdict != FAULT:
        outcome = _answer(kind, path)
        if outcome.seconds > limit and outcome.verdict != FAULT:
            outcome = Outcome(
                FAULT, f"took {outcome.seconds:.1f} s, at most {limit:.0f} s are allowed", outcome.seconds
            )
    return outcome


def _answer(kind: str, path: Path) -> Outcome:
    read = import_module(KINDS[kind]).read
    before, began = _peak_memory(), time.process_time()
    verdict, said = READ, ""
    with _listening() as heard, warnings.catch_warnings(record=True) as warned:
        warnings.simplefilter("always")
        try:
            read(path)
        except InputError as error:
            verdict, said = REFUSED, str(error)
        except (Exception, SystemExit):
            verdict, said = FAULT, traceback.format_exc()
    seconds = time.process_time() - began
    fault = ""
    if verdict == REFUSED:
        fault = _not_one_line(said, path, names_file=getattr(import_module(KINDS[kind]), "NAMES_FILE", True))
    if heard and not all(line.startswith("WARNING:drake:") for line in heard[0].splitlines()):
        fault = f"said besides: {heard[0]}"  # Drake's warnings are for users, a line each
    for warning in warned:
        if not issubclass(warning.category, DeprecationWarning):
            fault = f"warned: {warning.filename}:{warning.lineno}: {warning.category.__name__}: {warning.message}"
    if _peak_memory() - before > MOST_MEMORY:
        fault = f"took {_peak_memory() - before:.0f} MB"
    if fault and verdict != FAULT:
        verdict, said = FAULT, f"{fault} ({said})"
    return Outcome(verdict, said, seconds)


def _not_one_line(said: str, path: Path, *, names_file: bool) -> str:
    if not said.isprintable():
        return "a refusal that is not one printable line"
    if len(said) > LONGEST:
        return f"a refusal of {len(said)} letters"
    if names_file and str(path.parent) not in said and f"scene {path.stem}" not in said and not _names_scene(said):
        return "a refusal that does not name the file"
    return ""


def _names_scene(said: str) -> bool:
    """Refusals of a start or goal name the scene by the name that it has in its file."""
    return said.startswith("scene ") and (": start" in said or ": goal" in said)


def _peak_memory() -> float:
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024.0


@contextlib.contextmanager
def _listening() -> Iterator[list[str]]:
    """Inside, standard output and error go into a list, also what C++ writes."""
    heard: list[str] = []
    sys.stdout.flush()
    sys.stderr.flush()
    kept = [os.dup(1), os.dup(2)]
    with tempfile.TemporaryFile() as file:
        os.dup2(file.fileno(), 1)
        os.dup2(file.fileno(), 2)
        try:
            yield heard
        finally:
            sys.stdout.flush()
            sys.stderr.flush()
            os.dup2(kept[0], 1)
            os.dup2(kept[1], 2)
            for descriptor in kept:
                os.close(descriptor)
            file.seek(0)
            words = file.read().decode("utf-8", "replace").strip()
            if words:
                heard.append(words[-2000:])
