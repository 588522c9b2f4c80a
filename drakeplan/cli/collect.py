"""`drakeplan collect`: the place of label campaigns, which come with learned dynamics."""

from __future__ import annotations

from dataclasses import dataclass

from scenes.input_error import InputError

ABOUT = "Gathers training data for surrogates. It comes with learned dynamics in a later version and does nothing yet."


@dataclass(frozen=True)
class Arguments:
    """Words after `drakeplan collect`."""

    json: bool = False
    """one JSON object on standard output"""


def run(arguments: Arguments) -> int:
    """Says that there is nothing to run yet."""
    raise InputError("drakeplan collect comes with learned dynamics in a later version; here it does nothing")
