"""The help of every command, as sections of one page; the parsers run in this process."""

from __future__ import annotations

import contextlib
import io
import os
import re
import textwrap
from collections.abc import Iterator

from drakeplan.cli import COMMANDS, main

COLUMNS = 88  # what fits beside the navigation
FRAME = " -─│╭╮╰╯"  # around lists of options


def sections() -> str:
    """One section for each command."""
    return "\n\n".join(
        f"## drakeplan {name} {{ #{name} }}\n\n{what[0].upper()}{what[1:]}.\n\n```text\n{help_of(name)}\n```"
        for name, what in COMMANDS.items()
    )


def help_of(command: str) -> str:
    """What `drakeplan COMMAND --help` prints, in lines of `COLUMNS` and without the frames around lists."""
    shown = io.StringIO()
    with _environment(COLUMNS=str(COLUMNS), NO_COLOR="1", TERM="dumb"), contextlib.redirect_stdout(shown):
        status = main([command, "--help"])
    if status:
        raise RuntimeError(f"drakeplan {command} --help ended with {status}")
    lines = []
    for line in shown.getvalue().rstrip().splitlines():
        text = line.strip(FRAME)
        if text in ("positional arguments", "options"):
            lines += ["", f"{text}:"]
        elif text or not line:
            lines += _wrapped(line.rstrip(FRAME))
    return re.sub(r"\n{3,}", "\n\n", "\n".join(lines)).strip()


def _wrapped(line: str) -> list[str]:
    """The line cut where it is too long; its later parts begin where its text does, beyond a name and two blanks."""
    start = re.match(r"\s+(\S+\s\s+)?|", line)
    indent = " " * (start.end() if start else 0)
    wrap = textwrap.TextWrapper(COLUMNS + 4, subsequent_indent=indent, break_long_words=False, break_on_hyphens=False)
    return wrap.wrap(line) or [""]


@contextlib.contextmanager
def _environment(**values: str) -> Iterator[None]:
    """These environment variables, for a while."""
    before = {key: os.environ.get(key) for key in values}
    os.environ.update(values)
    try:
        yield
    finally:
        for key, value in before.items():
            if value is None:
                os.environ.pop(key, None)
            else:
                os.environ[key] = value
