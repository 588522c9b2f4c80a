"""Command-line words to a frozen dataclass by tyro, every mistake explained in one line.

tyro parses, converts and writes the help; its error boxes span many lines, so what can be wrong is looked at first.
"""

from __future__ import annotations

import contextlib
import difflib
import io
import math
import types
from collections.abc import Sequence
from dataclasses import MISSING, dataclass, fields
from typing import Annotated, Any, Literal, TypeVar, Union, get_args, get_origin, get_type_hints

import tyro

from scenes.input_error import InputError

Parsed = TypeVar("Parsed")
Numbers = tuple[float, ...]  # the type of an option that takes several numbers
Triples = tuple[tuple[float, float, float], ...]
Names = tuple[str, ...]  # the type of a last positional that takes all words that are left
Packages = Annotated[
    tuple[str, ...], tyro.conf.UseAppendAction, tyro.conf.arg(metavar="NAME=DIR", help_behavior_hint="")
]
POSITIONAL = get_args(tyro.conf.Positional[str])[1]  # what marks a field as one


@dataclass(frozen=True)
class _Word:
    """One option or positional argument of a command.

    Attributes:
        name: as the user writes it: `--seed`, or the placeholder of a positional.
        type: bool, int, float, str or `Numbers`.
        choices: the values that are allowed, empty for any.
        required: whether it must be there (positionals only).
    """

    name: str
    type: Any
    choices: tuple[str, ...]
    required: bool


def parse(kind: type[Parsed], prog: str, tokens: Sequence[str], *, about: str) -> Parsed:
    """The command's arguments.

    Args:
        kind: frozen dataclass; annotated with `tyro.conf.Positional` where a word has no `--name`.
        prog: what the user typed before them, for messages and help.
        tokens: what the user typed.
        about: description and examples shown by `--help`.

    Raises:
        InputError: the first mistake in them.
        SystemExit: 0 after `--help`.
    """
    if not {"-h", "--help"} & set(tokens):
        tokens = _checked(kind, prog, tokens)
    complaint = io.StringIO()
    try:
        with contextlib.redirect_stderr(complaint):
            return tyro.cli(
                kind, prog=prog, args=list(tokens), description=about, config=(tyro.conf.FlagCreatePairsOff,)
            )
    except SystemExit as stop:
        if not stop.code:
            raise
        raise InputError(f"{prog}: {_one_line(complaint.getvalue())}") from None


def _checked(kind: type, prog: str, tokens: Sequence[str]) -> list[str]:
    """The same words in an order that cannot be misread: positionals, then options, those with many numbers last.

    Raises:
        InputError: unknown, missing or superfluous words, values that are no numbers or no choices.
    """
    options, places = _words(kind)
    free, ordered, last = [], [], []
    words = _split_equals(tokens)
    while words:
        token = words.pop(0)
        if not _is_option(token):
            free.append(token)
            continue
        option = options.get(token.replace("_", "-"))
        if option is None:
            raise InputError(f"{prog}: unknown option {token}: {_nearest(token, list(options))}")
        values = _take_values(prog, option, words)
        (last if option.type == Numbers else ordered).extend([option.name, *values])
    if len(free) > len(places) and not (places and places[-1].type == Names):
        raise InputError(f"{prog}: unexpected argument {free[len(places)]!r}")
    for place in places[len(free) :]:
        if place.required:
            raise InputError(f"{prog}: {place.name} is missing; see {prog} --help")
    for place, value in zip(places, free, strict=False):
        _check_choice(prog, place, value)
    return [*free, *ordered, *last]


def _take_values(prog: str, option: _Word, words: list[str]) -> list[str]:
    """Takes the option's values off the front of `words`."""
    if option.type is bool:
        return []
    if option.type == Numbers:
        values = []
        while words and len(values) < 3 and _number(words[0]) is not None:
            values.append(words.pop(0))
        if len(values) < 2:
            got = " ".join([*values, *words[:1]]) or "nothing"
            raise InputError(f"{prog}: {option.name}: expected two or three numbers, X Y [YAW], got {got}")
    elif option.type == Triples:
        values = []
        while words and _number(words[0]) is not None:
            values.append(words.pop(0))
        if not values or len(values) % 3:
            got = " ".join([*values, *words[:1]]) or "nothing"
            raise InputError(
                f"{prog}: {option.name}: expected three numbers X Y Z, or three for each of several, got {got}"
            )
    else:
        if not words or _is_option(words[0]):
            raise InputError(f"{prog}: {option.name}: a value is missing after it")
        values = [words.pop(0)]
    for value in values:
        _check_number(prog, option, value)
        _check_choice(prog, option, value)
    return values


def _check_number(prog: str, option: _Word, value: str) -> None:
    if option.type is int:
        if not value.lstrip("+-").isdecimal():
            raise InputError(f"{prog}: {option.name}: expected a whole number, got {value!r}")
    elif option.type in (float, Numbers, Triples):
        number = _number(value)
        if number is None or not math.isfinite(number):
            raise InputError(f"{prog}: {option.name}: expected a finite number, got {value!r}")


def _check_choice(prog: str, word: _Word, value: str) -> None:
    if word.choices and value not in word.choices:
        raise InputError(f"{prog}: {word.name}: unknown {value!r}: {_nearest(value, list(word.choices))}")


def _words(kind: type) -> tuple[dict[str, _Word], list[_Word]]:
    """Options by name, and positionals in order."""
    options, places = {}, []
    hints = get_type_hints(kind, include_extras=True)
    for field in fields(kind):
        marks = get_args(hints[field.name])[1:] if get_origin(hints[field.name]) is Annotated else ()
        type_, choices = _bare_type(hints[field.name])
        metavar = next((m.metavar for m in marks if getattr(m, "metavar", None)), field.name.upper())
        if any(mark is POSITIONAL for mark in marks):
            places.append(_Word(metavar, type_, choices, field.default is MISSING))
        else:
            name = "--" + field.name.replace("_", "-")
            options[name] = _Word(name, type_, choices, False)
    return options, places


def _bare_type(hint: Any) -> tuple[Any, tuple[str, ...]]:
    """The hint without Annotated, Optional and Literal; and what Literal allows."""
    if get_origin(hint) is Annotated:
        return _bare_type(get_args(hint)[0])
    if get_origin(hint) in (Union, types.UnionType):
        (inner,) = (a for a in get_args(hint) if a is not type(None))
        return _bare_type(inner)
    if get_origin(hint) is Literal:
        return str, get_args(hint)
    return hint, ()


def _split_equals(tokens: Sequence[str]) -> list[str]:
    """`--seed=3` becomes two words."""
    words = []
    for token in tokens:
        words += token.split("=", 1) if _is_option(token) and "=" in token else [token]
    return words


def _is_option(token: str) -> bool:
    return token.startswith("-") and len(token) > 1 and _number(token) is None


def _number(token: str) -> float | None:
    try:
        return float(token)
    except ValueError:
        return None


def _nearest(word: str, known: list[str]) -> str:
    near = difflib.get_close_matches(word, known, n=2, cutoff=0.5)
    return f"did you mean {' or '.join(near)}?" if near else f"expected one of {', '.join(known)}"


def _one_line(box: str) -> str:
    """What a box of tyro says, without its frame, its title and its footer."""
    said = []
    for line in box.splitlines()[1:]:
        text = line.strip("│╭╮╰╯ ")
        if text.startswith("─"):
            break
        said.append(text)
    return " ".join(" ".join(said).split()) or "arguments that make no sense; see --help"
