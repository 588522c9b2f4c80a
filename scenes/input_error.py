"""The one exception that means "the user's input is wrong", never "the program is"."""

from __future__ import annotations

import difflib
from collections.abc import Iterable

LONGEST = 1200  # letters of a message; names and keys in it come from files and may be of any length


class InputError(ValueError):
    """Bad input from outside: its text is one line that names the source, the key and what was expected.

    The command line prints it and exits with 2. Characters that would steer a terminal are shown as their codes.
    """

    def __init__(self, message: str) -> None:
        text = "".join(c if c.isprintable() else ascii(c)[1:-1] for c in " ".join(message.split()))
        if len(text) > LONGEST:
            text = f"{text[: LONGEST // 2]} ... {text[-LONGEST // 2 :]}"
        super().__init__(text)


def unknown_name(kind: str, name: str, known: Iterable[str]) -> InputError:
    """An `InputError` for a name that is not among `known`, with the nearest ones.

    Args:
        kind: what the name should name, for the message.
        name: as the user wrote it.
        known: the names there are.
    """
    names = sorted(known)
    near = difflib.get_close_matches(name, names, n=3, cutoff=0.4) or names
    return InputError(f"unknown {kind} {name!r}: did you mean {', '.join(near)}?")
