"""What the documents say is there: paths, links and commands; and they say it in plain words."""

from __future__ import annotations

import ast
import re
from functools import cache
from pathlib import Path

import nbformat
import pytest

from drakeplan.bench import BENCHES
from drakeplan.cli import COMMANDS, main

ROOT = Path(__file__).resolve().parents[1]
DOCUMENTS = [
    *(ROOT / name for name in ("README.md", "ARCHITECTURE.md", "CONTRIBUTING.md")),
    *sorted(path for path in (ROOT / "docs").rglob("*.md") if path.name != "benchmarks.md"),
]
NOTEBOOKS = sorted((ROOT / "tutorials").glob("*.ipynb"))
PACKAGES = ("scenes", "optimization", "learning", "drakeplan")
FOLDERS = (*PACKAGES, "tests", "tutorials", "docs", ".ci")
SUFFIXES = (".py", ".md", ".ipynb", ".toml", ".yaml", ".cff")
FORBIDDEN_FILES = {
    "utils.py",
    "helpers.py",
    "common.py",
    "base.py",
}  # CONTRIBUTING names them because they must not exist
PRIVATE = (  # phrases that only their author understands
    "who balances",
    "dived through",
    "word counts",
    "gives and holds",
    "kinder rule",
    "empty of meaning",
    "believes its solver",
)


@cache
def read(path: Path) -> str:
    """The text of a document; of a notebook, that of its markdown cells."""
    if path.suffix != ".ipynb":
        return path.read_text(encoding="utf-8")
    cells = nbformat.read(path, as_version=4).cells
    return "\n\n".join(cell.source for cell in cells if cell.cell_type == "markdown")


def one_line(text: str) -> str:
    """Lower case, with single spaces for line breaks, so that a phrase is found wherever its lines end."""
    return " ".join(text.lower().split())


def missing_paths(text: str) -> list[str]:
    """Paths in backticks that look like a file or folder of the repository and are none."""
    missing = []
    for token in re.findall(r"`([^`\s]+)`", text):
        is_path = token.startswith(tuple(f"{folder}/" for folder in FOLDERS))
        is_name = "/" not in token and token.endswith(SUFFIXES) and token not in FORBIDDEN_FILES
        found = (ROOT / token).exists() if is_path else not is_name or any(ROOT.glob(token)) or token in known_names()
        if not found:
            missing.append(token)
    return missing


@cache
def known_names() -> frozenset[str]:
    """Names of all files and folders in FOLDERS."""
    return frozenset(path.name for folder in FOLDERS for path in (ROOT / folder).rglob("*"))


def broken_links(text: str, folder: Path) -> list[str]:
    """Relative links of Markdown whose target does not exist."""
    targets = [target.split("#")[0] for target in re.findall(r"\]\(([^)\s]+)\)", text)]
    return [t for t in targets if t and not re.match(r"[a-z]+:", t) and not (folder / t).exists()]


def unknown_commands(text: str) -> list[str]:
    """Commands and benchmarks in code that drakeplan does not have; NAME and the like stand for any."""
    code = " ".join(re.findall(r"```.*?```|`[^`]+`", text, flags=re.DOTALL))
    commands = [
        name for name in re.findall(r"\bdrakeplan ([a-z](?:[a-z_0-9-]*[a-z0-9])?)", code) if name not in COMMANDS
    ]
    benches = [name for name in re.findall(r"\bdrakeplan bench ([a-z][a-z_0-9]*)", text) if name not in BENCHES]
    return commands + benches


def equations_without_source(text: str) -> list[str]:
    """Equation numbers that no author and year precede, as in `Lin 2020 eq. 3.2` or `Lin 2020 sec. 3.3, eq. 3.2`."""
    text = " ".join(text.split())
    named = r"\b[12]\d\d\d,? (?:sec\. [\d.]+,? )?$"
    return [m.group() for m in re.finditer(r"\beqs?\. ?\(?\d[\d.]*", text) if not re.search(named, text[: m.start()])]


@pytest.mark.parametrize("path", DOCUMENTS, ids=lambda p: str(p.relative_to(ROOT)))
def test_every_path_in_a_document_exists(path: Path) -> None:
    assert not missing_paths(read(path))


@pytest.mark.parametrize("path", [*DOCUMENTS, *NOTEBOOKS], ids=lambda p: str(p.relative_to(ROOT)))
def test_every_relative_link_resolves(path: Path) -> None:
    assert not broken_links(read(path), path.parent)


@pytest.mark.parametrize("path", [*DOCUMENTS, *NOTEBOOKS], ids=lambda p: str(p.relative_to(ROOT)))
def test_every_command_and_benchmark_exists(path: Path) -> None:
    assert not unknown_commands(read(path))


@pytest.mark.parametrize("path", [*DOCUMENTS, *NOTEBOOKS], ids=lambda p: str(p.relative_to(ROOT)))
def test_an_equation_number_has_its_author_and_year(path: Path) -> None:
    assert not equations_without_source(read(path))


@pytest.mark.parametrize("path", [*DOCUMENTS, *NOTEBOOKS], ids=lambda p: str(p.relative_to(ROOT)))
def test_documents_are_free_of_private_phrases(path: Path) -> None:
    text = one_line(read(path))
    assert not [phrase for phrase in (*PRIVATE, "the documents") if phrase in text]


def test_every_decision_is_in_the_index_and_says_what_holds_now() -> None:
    index = read(ROOT / "docs" / "decisions" / "README.md")
    for path in DOCUMENTS:
        if path.parent.name == "decisions" and path.name != "README.md":
            assert f"]({path.name})" in index, f"{path.name} is not in the index"
            assert "**Holds now**" in read(path), f"{path.name} does not say what holds now"


@pytest.mark.parametrize("command", ["", *COMMANDS])
def test_help_is_free_of_private_phrases(command: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main([command, "--help"] if command else ["--help"]) == 0
    shown = capsys.readouterr().out
    text = one_line(re.sub(r"[│╭╮╰╯─]", " ", shown))  # without the frames, which may divide a phrase
    assert "drakeplan" in text
    assert not [phrase for phrase in PRIVATE if phrase in text]


@cache
def strings() -> list[tuple[str, str]]:
    """(file:line, text on one line) of every string literal of the packages, docstrings included."""
    found = []
    for package in PACKAGES:
        for path in sorted((ROOT / package).rglob("*.py")):
            for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
                if isinstance(node, ast.Constant) and isinstance(node.value, str):
                    found.append((f"{path.relative_to(ROOT)}:{node.lineno}", one_line(node.value)))
    return found


@pytest.mark.parametrize("phrase", PRIVATE)
def test_messages_and_docstrings_are_free_of_private_phrases(phrase: str) -> None:
    assert len(strings()) > 5000
    assert not [place for place, text in strings() if phrase in text]


def test_the_checks_find_what_is_wrong() -> None:
    wrong = """See `scenes/no_such_room/file.py`, `no_such_file.py` and [this](no_such_page.md); run `drakeplan bench no_such`
    or `drakeplan no_such_command`; costs by eq. 3.2."""
    assert missing_paths(wrong) == ["scenes/no_such_room/file.py", "no_such_file.py"]
    assert broken_links(wrong, ROOT) == ["no_such_page.md"]
    assert unknown_commands(wrong) == ["no_such_command", "no_such"]
    assert equations_without_source(wrong) == ["eq. 3.2."]


def test_the_checks_accept_what_is_right() -> None:
    right = """`scenes/terrain`, `README.md` and [this](README.md#install); `drakeplan bench first` and `drakeplan bench NAME`;
    Lin 2020 eq. 3.2; Lin 2020 sec. 3.3, eq. 3.1; `utils.py`, `X_WC`, `plan.h5`, https://drake.mit.edu"""
    assert not missing_paths(right)
    assert not broken_links(right, ROOT)
    assert not unknown_commands(right)
    assert not equations_without_source(right)
