"""Changes to good input: of YAML trees by what they mean, of any file by its bytes."""

from __future__ import annotations

import contextlib
import copy
import json
import math
from collections.abc import Callable
from dataclasses import dataclass
from random import Random

NUMBERS = (
    math.nan, math.inf, -math.inf, 1e308, -1e308, 5e-324, -0.0, 0, 0.0, -1, 1, 2, 1e-12, 1e-9, 1e-6, 1e-3, -1e-3, 0.04, 10.0, 200.0,
    1e5, -1e5, 100000.1, 1e9, 1e17, 2**31, 2**63, 2**64, 10**400, math.pi, math.pi / 2,
)  # fmt: skip
TEXTS = (
    "", " ", "0", "nan", "null", "x" * 300, "x" * 20_000, "a\nb", "a\tb", "\x00", "\x1b[31mred", "ü\u202e\u2028", "\U0001f9bf",
    "../up.stl",
    "../../etc/passwd", "/etc/passwd", ".", "..", "a/../../b", "C:\\x.stl", "package://", "package://nobody/x.stl", "package://../x",
    "package://hpp_environments/../../x", "file:///etc/passwd", "https://example.org/x.stl", "ground", "left_foot", "escher",
    "mesh:box/0", "{}", "[]", "%s%n", "$HOME", "~",
)  # fmt: skip


@dataclass(frozen=True)
class Raw:
    """Text that stands in a YAML file as it is."""

    text: str


@dataclass(frozen=True)
class Twice:
    """A value whose key appears twice."""

    value: object


RAWS = tuple(
    Raw(text)
    for text in (
        "", "~", "010", "0x10", "1:30", "1e3", "1_000", ".5", "+1", "2026-01-01", "yes", "<<", "*nobody", "&a 1", "&a [*a]",
        "&a {b: *a}",
        "!!float 1", "!!python/object/apply:os.getcwd []", "!!set {a, b}", "!!binary aGVsbG8=", "!x 1", "[" * 60 + "]" * 60,
        "[" * 2000 + "]" * 2000, "[1, 2", "{a: 1", "'open", "- 1", "? a", "a: b: c", "[&a [1, 1], *a, *a, *a]", "|\n block",
        "# comment",
        "9" * 400, "1e999", "-.inf", ".NaN", "0.1.2", "@", "`", "%YAML 1.1", "---", "...", "\u2028", "\x07",
        "[&a [1,1,1,1,1,1,1,1,1,1], &b [*a,*a,*a,*a,*a,*a,*a,*a], &c [*b,*b,*b,*b,*b,*b,*b,*b], &d [*c,*c,*c,*c,*c,*c], [*d,*d,*d]]",
    )
)  # fmt: skip


def to_yaml(value: object) -> str:
    """A tree as YAML in flow style, numbers as YAML 1.2 writes them."""
    if isinstance(value, Raw):
        return value.text
    if isinstance(value, dict):
        entries = []
        for key, item in value.items():
            twice = isinstance(item, Twice)
            entries += [f"{json.dumps(str(key))}: {to_yaml(item.value if twice else item)}"] * (1 + twice)
        return "{" + ", ".join(entries) + "}"
    if isinstance(value, list | tuple):
        return "[" + ", ".join(to_yaml(item) for item in value) + "]"
    if isinstance(value, float) and not math.isfinite(value):
        return ".nan" if math.isnan(value) else ".inf" if value > 0 else "-.inf"
    return json.dumps(value, ensure_ascii=False) if not isinstance(value, Twice) else to_yaml(value.value)


def to_document(tree: dict[str, object]) -> str:
    """A tree as a YAML file, one line for each key at the top."""
    lines = []
    for key, item in tree.items():
        twice = isinstance(item, Twice)
        lines += [f"{json.dumps(str(key))}: {to_yaml(item.value if twice else item)}"] * (1 + twice)
    return "\n".join(lines) + "\n"


def nodes_of(tree: object) -> list[tuple[dict | list, str | int]]:
    """Every place in a tree as its parent and key; parents before their children."""
    found: list[tuple[dict | list, str | int]] = []
    waiting = [tree]
    while waiting:
        node = waiting.pop()
        keys = list(node) if isinstance(node, dict) else range(len(node)) if isinstance(node, list) else ()
        for key in keys:
            found.append((node, key))
            waiting.append(node[key])
    return found


def odd_value(rng: Random) -> object:
    """Something that seldom belongs where it is put."""
    kind = rng.randrange(8)
    if kind < 3:
        return rng.choice(NUMBERS)
    if kind == 3:
        return rng.choice(TEXTS)
    if kind == 4:
        return rng.choice(RAWS)
    return rng.choice(
        ([], {}, None, True, False, [[]], [1, 2], [1, 2, 3], [0, 0, 0], [None] * 3, {"a": 1}, ["left_foot"])
    )


def nudged(rng: Random, value: float) -> float:
    """A number near another, at any scale: what rounding, units and signs do to it."""
    kind = rng.randrange(6)
    if kind == 0:
        return -value
    if kind == 1:
        return value * rng.choice((1e-3, 1e3, 0.5, 2.0, 1e-6, 57.29577951308232))
    if kind == 2:
        return float(round(value))
    return value + rng.choice((-1, 1)) * 10.0 ** rng.uniform(-16, 3)


def changed_name(rng: Random, name: str) -> str:
    """A key with a slip of the pen."""
    k = rng.randrange(max(len(name), 1))
    return rng.choice(
        (
            name[:k] + name[k + 1 :],
            name[:k] + name[k : k + 1] * 2 + name[k + 1 :],
            name.upper(),
            name + " ",
            name + "s",
            *TEXTS[:12],
        )
    )


def mutate_tree(rng: Random, tree: dict[str, object], own: tuple[Callable[[Random, dict], None], ...] = ()) -> dict:
    """A copy of a tree with one to four changes.

    Args:
        rng: draws them.
        tree: mappings, lists, numbers and texts; stays as it is.
        own: further changes, that know what the tree means; each changes its argument in place.
    """
    tree = copy.deepcopy(tree)
    for _ in range(rng.choice((1, 1, 1, 1, 2, 2, 3))):
        if own and rng.random() < 0.5:
            with contextlib.suppress(
                LookupError, TypeError, ValueError, AttributeError, OverflowError
            ):  # an earlier change took away what it needs
                rng.choice(own)(rng, tree)
            continue
        _change_one_place(rng, tree)
    return tree


def _change_one_place(rng: Random, tree: dict[str, object]) -> None:
    places = nodes_of(tree)
    if not places:
        return
    parent, key = rng.choice(places)
    value, kind = parent[key], rng.randrange(10)
    if isinstance(value, int | float) and not isinstance(value, bool) and abs(value) < 1e300 and rng.random() < 0.5:
        parent[key] = nudged(rng, float(value))
    elif kind <= 2 or (kind <= 5 and not isinstance(value, int | float | list)):
        parent[key] = odd_value(rng)
    elif kind <= 5 and isinstance(value, list):
        parent[key] = _changed_list(rng, value)
    elif kind <= 5:
        parent[key] = rng.choice(NUMBERS)
    elif kind == 6:
        del parent[key]
    elif kind == 7 and isinstance(parent, dict):
        parent[changed_name(rng, str(key))] = parent.pop(key)
    elif kind == 8:
        other, name = rng.choice(places)
        if name in (range(len(other)) if isinstance(other, list) else other):
            parent[key] = copy.deepcopy(other[name])
    elif isinstance(parent, dict):
        parent[key] = Twice(value)
    else:
        parent.insert(key, copy.deepcopy(value))


def _changed_list(rng: Random, value: list) -> list:
    kind = rng.randrange(7)
    if kind == 0:
        return rng.sample(value, len(value))
    if kind == 1:
        return value[::-1]
    if kind == 2:
        return value[: rng.randrange(len(value) + 1)]
    if kind == 3:
        return value + value
    if kind == 4:
        return [*value, odd_value(rng)]
    if kind == 5:
        return value * rng.choice((3, 40, 300)) if len(value) < 10 else value
    return [value]


def mutate_bytes(rng: Random, data: bytes) -> bytes:
    """A copy of a file with one to four changes of its bytes."""
    for _ in range(rng.choice((1, 1, 2, 4))):
        a = rng.randrange(len(data) + 1)
        b = min(len(data), a + rng.choice((1, 1, 2, 4, 16, 100, 1000)))
        kind = rng.randrange(9)
        if kind == 0:
            data = data[:a]
        elif kind == 1:
            data = data[:a] + data[b:]
        elif kind == 2:
            data = data[:b] + data[a:b] * rng.choice((1, 2, 20)) + data[b:]
        elif kind == 3:
            data = data[:a] + rng.randbytes(b - a) + data[b:]
        elif kind == 4:
            data = data[:a] + bytes([rng.choice(b"\x00\xff\n\r\t :,[]{}()<>&\"'#-0129eE.xX/\\%")]) + data[a + 1 :]
        elif kind == 5:
            data = (
                data[:a]
                + rng.choice((b"\x00", b"\xff\xfe", b"\xc3\x28", b"\r\n", b"\t", b"nan", b"inf", b"-1", b"1e999"))
                + data[a:]
            )
        elif kind == 6:
            data = data.replace(
                rng.choice((b"0", b"1", b" ", b"\n", b".", b"-", b"e")),
                rng.choice((b"", b"9", b"\n", b"-", b"\x00")),
                3,
            )
        elif kind == 7:
            data = recoded(rng, data)
        else:
            c = rng.randrange(len(data) + 1)
            data = data[:c] + data[a:b] + data[c:]
    return data


def recoded(rng: Random, data: bytes) -> bytes:
    """The same text in another encoding or with other line ends."""
    try:
        text = data.decode()
    except UnicodeDecodeError:
        return data[::-1] if rng.random() < 0.2 else data
    return rng.choice(
        (
            lambda: text.encode("utf-16"),
            lambda: text.encode("utf-32"),
            lambda: b"\xef\xbb\xbf" + data,
            lambda: text.replace("\n", "\r\n").encode(),
            lambda: text.replace("\n", "\r").encode(),
            lambda: ("ä" + text).encode("latin-1", "replace"),
            lambda: text.upper().encode(),
            lambda: data + data,
        )
    )()
