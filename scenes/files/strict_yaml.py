"""Reads untrusted YAML: plain data, no duplicate keys, limited expansion of aliases, numbers as in YAML 1.2.

PyYAML's parser hands out events without recursion, and this file builds the data from them. Composing or constructing
with PyYAML itself would keep the last of two equal keys, crash the interpreter on 100000 nested brackets, and read
`1e-3` as text, `010` as 8 and `1:30` as 90.
"""

from __future__ import annotations

import re
from dataclasses import dataclass, field
from pathlib import Path

import yaml

from scenes.input_error import InputError

MAX_BYTES = 32 * 2**20
MAX_DEPTH = 40
MAX_NODES = 2_000_000  # scalars, lists and mappings after aliases are followed; 14000 surfaces need 300 000

_INT = re.compile(r"[-+]?[0-9]+")
_FLOAT = re.compile(r"[-+]?(?:\.[0-9]+|[0-9]+(?:\.[0-9]*)?)(?:[eE][-+]?[0-9]+)?")
_WORDS = {
    **dict.fromkeys(("", "~", "null", "Null", "NULL"), None),
    **dict.fromkeys(("true", "True", "TRUE"), True),
    **dict.fromkeys(("false", "False", "FALSE"), False),
    **dict.fromkeys((".inf", ".Inf", ".INF", "+.inf", "+.Inf", "+.INF"), float("inf")),
    **dict.fromkeys(("-.inf", "-.Inf", "-.INF"), float("-inf")),
    **dict.fromkeys((".nan", ".NaN", ".NAN"), float("nan")),
}


def read_text(path: Path) -> str:
    """The text of a file of at most `MAX_BYTES`.

    Raises:
        InputError: it does not exist, is no plain file, cannot be read, is too large, or is not UTF-8.
    """
    try:
        if not path.is_file():
            raise InputError(f"{path}: {'is not a plain file' if path.exists() else 'no such file'}")
        with path.open("rb") as file:
            data = file.read(MAX_BYTES + 1)
    except OSError as error:
        raise InputError(f"{path}: cannot be read ({error.strerror})") from None
    if len(data) > MAX_BYTES:
        raise InputError(f"{path}: larger than {MAX_BYTES >> 20} MiB, the most that a scene file may be")
    try:
        return data.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise InputError(f"{path}: expected UTF-8 text, byte {error.start} is not") from None


def load_yaml(text: str, source: str) -> object:
    """The data in one YAML document: None, bool, int, float, str, lists and dicts with text keys.

    Args:
        text: the document.
        source: what to call it in errors.

    Raises:
        InputError: not YAML, more than one document, tags, keys that repeat or are no text, too deep or too large.
    """
    builder = _Builder(source)
    try:
        for event in yaml.parse(text, Loader=yaml.CSafeLoader):
            builder.take(event)
    except yaml.MarkedYAMLError as error:
        mark = error.problem_mark or error.context_mark
        where = f"line {mark.line + 1}: " if mark else ""
        raise InputError(f"{source}: {where}not YAML ({error.problem or error.context})") from None
    except yaml.YAMLError as error:
        raise InputError(f"{source}: not YAML ({error})") from None
    return builder.document


def key_path(path: list[str | int] | tuple[str | int, ...]) -> str:
    """Keys and indices as one reads them: surfaces[3].vertices."""
    text = "".join(f"[{key}]" if isinstance(key, int) else f".{key}" for key in path)
    return text.removeprefix(".")


@dataclass
class _Open:
    """A list or mapping whose end has not come yet."""

    value: list | dict
    anchor: str | None
    nodes_before: int
    key: str | None = None


@dataclass
class _Builder:
    source: str
    document: object = None
    documents: int = 0
    nodes: int = 0
    open: list[_Open] = field(default_factory=list)
    anchors: dict[str, tuple[object, int]] = field(default_factory=dict)

    def take(self, event: yaml.Event) -> None:
        if isinstance(event, yaml.ScalarEvent):
            self._check_tag(event)
            self._count(1, event)
            value = event.value if event.style or event.tag else _plain(event.value)
            self._add(value, event, anchor=event.anchor, nodes=1)
        elif isinstance(event, yaml.SequenceStartEvent | yaml.MappingStartEvent):
            self._check_tag(event)
            if len(self.open) >= MAX_DEPTH:
                raise self._error(event, f"nested deeper than {MAX_DEPTH} levels")
            self._count(1, event)
            value = [] if isinstance(event, yaml.SequenceStartEvent) else {}
            self.open.append(_Open(value, event.anchor, self.nodes - 1))
        elif isinstance(event, yaml.SequenceEndEvent | yaml.MappingEndEvent):
            done = self.open.pop()
            self._add(done.value, event, anchor=done.anchor, nodes=self.nodes - done.nodes_before)
        elif isinstance(event, yaml.AliasEvent):
            if event.anchor not in self.anchors:
                raise self._error(event, f"alias *{event.anchor} refers to a node that contains it or comes later")
            value, nodes = self.anchors[event.anchor]
            self._count(nodes, event)
            self._add(value, event, anchor=None, nodes=nodes)
        elif isinstance(event, yaml.DocumentStartEvent):
            self.documents += 1
            if self.documents > 1:
                raise self._error(event, "expected one document, a second begins")

    def _add(self, value: object, event: yaml.Event, *, anchor: str | None, nodes: int) -> None:
        if anchor is not None:
            self.anchors[anchor] = (value, nodes)
        if not self.open:
            self.document = value
            return
        parent = self.open[-1]
        if isinstance(parent.value, list):
            parent.value.append(value)
        elif parent.key is None:
            if not isinstance(value, str):
                raise self._error(event, f"expected a key, got {value!r}"[:120])
            if value in parent.value:
                raise self._error(event, f"the key {value!r} appears twice")
            parent.key = value
        else:
            parent.value[parent.key] = value
            parent.key = None

    def _check_tag(self, event: yaml.ScalarEvent | yaml.CollectionStartEvent) -> None:
        if event.tag not in (None, "!"):
            raise self._error(event, f"tags like {event.tag!r} are not allowed")

    def _count(self, nodes: int, event: yaml.Event) -> None:
        self.nodes += nodes
        if self.nodes > MAX_NODES:
            raise self._error(event, f"holds more than {MAX_NODES} values once its aliases are followed")

    def _error(self, event: yaml.Event, problem: str) -> InputError:
        path: list[str | int] = []
        for level in self.open:
            if isinstance(level.value, list):
                path.append(len(level.value))
            elif level.key is not None:
                path.append(level.key)
        where = f"{key_path(path[:6])}: " if path else ""
        return InputError(f"{self.source}: {where}{problem} (line {event.start_mark.line + 1})")


def _plain(text: str) -> object:
    """An unquoted scalar by YAML 1.2's core schema, without its octal and hexadecimal integers."""
    if _FLOAT.fullmatch(text):
        # A thousand digits are no coordinate, and int() refuses very long ones by an exception of its own.
        return int(text) if len(text) < 300 and _INT.fullmatch(text) else float(text)
    return _WORDS.get(text, text)
