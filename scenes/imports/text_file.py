"""Text and tables of numbers out of files of any system: Windows line ends, byte order marks, decimal commas."""

from __future__ import annotations

import codecs
import re
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from scenes.input_error import InputError

MAX_BYTES = 512 * 2**20  # a million points in text are 30 to 60 MB
COMMENTS = ("#", "//", "%")
LABEL = "name"  # a column of words
_NUMBER = re.compile(r"[-+]?(\d+\.?\d*|\.\d+)([eEdD][-+]?\d+)?|[-+]?(nan|inf|infinity)", re.IGNORECASE)


@dataclass(frozen=True, eq=False)
class Table:
    """Numbers in rows and columns.

    Attributes:
        rows: (N, C) the numbers.
        names: of the columns in lower case, empty without a line that names them.
        blocks: (N,) number of the block that a row is in; blank lines divide blocks.
        labels: (N,) what stands in the column `name`, empty without one.
    """

    rows: np.ndarray
    names: tuple[str, ...]
    blocks: np.ndarray
    labels: tuple[str, ...] = ()


def read_bytes(path: Path) -> bytes:
    """All of a file.

    Raises:
        InputError: no such file, no plain file, unreadable, empty or too large.
    """
    try:
        if not path.is_file():
            raise InputError(f"{path}: {'is not a plain file' if path.exists() else 'no such file'}")
        with path.open("rb") as file:
            data = file.read(MAX_BYTES + 1)
    except InputError:
        raise
    except (OSError, ValueError) as error:  # also names that no file can have
        raise InputError(f"{path}: cannot be read ({getattr(error, 'strerror', None) or error})") from None
    if len(data) > MAX_BYTES:
        raise InputError(f"{path}: larger than {MAX_BYTES >> 20} MiB, the most that is imported; crop or thin it")
    if not data.strip():
        raise InputError(f"{path}: the file is empty")
    return data


def decoded(data: bytes, path: Path) -> str:
    """The text in some bytes, with plain line ends; comments may be in any encoding, and no number depends on them.

    Args:
        data: the file.
        path: for errors.

    Raises:
        InputError: they are no text.
    """
    if data.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)):
        text = data.decode("utf-16", "replace")
    else:
        text = data.decode("utf-8-sig", "replace")
    if "\0" in text:
        raise InputError(f"{path}: expected text, this is a binary file of no known format")
    return text.replace("\r\n", "\n").replace("\r", "\n")


def table_of(text: str, path: Path) -> Table:
    """The numbers of a text: columns divided by blanks, commas, semicolons or tabs, comments and one heading left out.

    Args:
        text: with plain line ends.
        path: for errors.

    Raises:
        InputError: a line that is no row of numbers, or rows of different length.
    """
    lines = text.split("\n")
    names: tuple[str, ...] = ()
    first = next((k for k, line in enumerate(lines) if line.strip() and not line.lstrip().startswith(COMMENTS)), None)
    if first is None:
        raise InputError(f"{path}: holds no numbers")
    head = lines[first]
    commas = ";" in head and "." not in head and re.search(r"\d,\d", head) is not None  # 1,5;2,0;0,3
    words = _words(head, commas)
    if words and not all(map(_NUMBER.fullmatch, words)):
        names = tuple(word.strip("\"'").lower() for word in words)
        first += 1
    elif len(words) == 1 and words[0].isdecimal():  # a .pts file begins with how many points there are
        first += 1
    numbered = [
        (k, line)
        for k, line in enumerate(lines[first:], first + 1)
        if line and not line.isspace() and not line.lstrip().startswith(COMMENTS)
    ]
    if not numbered:
        raise InputError(f"{path}: holds no numbers")
    body = [" ".join(_words(line, commas)) if commas else line.translate(_BLANKS) for _, line in numbered]
    labels: tuple[str, ...] = ()
    if LABEL in names:
        at = names.index(LABEL)
        words = [re.split(r"[,;\t]", line) for _, line in numbered]
        labels = tuple(row[at].strip().strip("\"'") if at < len(row) else "" for row in words)
        names = names[:at] + names[at + 1 :]
        body = [" ".join(row[:at] + row[at + 1 :]) for row in words]
    rows = _numbers(body, [k for k, _ in numbered], path)
    blank = np.cumsum([line.isspace() or not line for line in lines])
    at = np.array([k for k, _ in numbered]) - 1
    _, blocks = np.unique(blank[at], return_inverse=True)
    return Table(rows, names, blocks, labels)


_BLANKS = str.maketrans({",": " ", ";": " ", "\t": " "})


def _words(line: str, commas: bool) -> list[str]:
    if commas:
        return line.replace(",", ".").replace(";", " ").split()
    return line.translate(_BLANKS).split()


def _numbers(body: list[str], line_of: list[int], path: Path) -> np.ndarray:
    try:
        return np.loadtxt(body, ndmin=2, comments=None)
    except ValueError:
        pass
    width = len(body[0].split())
    for line, number in zip(body, line_of, strict=True):
        words = line.split()
        wrong = next((word for word in words if not _NUMBER.fullmatch(word)), None)
        if wrong is not None:
            raise InputError(f"{path}: line {number}: expected numbers, got {wrong[:40]!r}")
        if len(words) != width:
            raise InputError(f"{path}: line {number}: expected {width} numbers like the lines before, got {len(words)}")
    raise InputError(f"{path}: not a table of numbers")
