"""The tutorials as pages: with outputs where `make docs NOTEBOOKS=1` has run them, else without."""

from __future__ import annotations

import re
from functools import cache
from pathlib import Path

import nbformat
from latex2mathml.converter import convert
from nbconvert import MarkdownExporter

ROOT = Path(__file__).resolve().parents[2]
NOTEBOOKS = sorted((ROOT / "tutorials").glob("*.ipynb"))
EXECUTED = ROOT / "build" / "notebooks"
STRIPPED = """!!! note
    Shown without its outputs. `make docs NOTEBOOKS=1` runs the notebooks and shows them;
    [how to run one yourself](../how-to/notebooks.md)."""
MATHS = re.compile(r"\$\$(.+?)\$\$|\$([^$\n]+)\$", flags=re.DOTALL)
INDENTED = re.compile(r"(?m)(?:^ {4}.*\n(?:[ \t]*\n)*)+")
STALE = (
    "!!! note\n    These outputs are of an earlier version of the notebook. `make docs NOTEBOOKS=1` makes them anew."
)


def page_of(path: Path) -> str:
    """Name of a notebook's page in the site."""
    return f"tutorials/{path.stem}.md"


def files_of(path: Path) -> dict[str, str | bytes]:
    """Name in the site -> content: the page, the notebook to download, and the pictures of its outputs.

    Args:
        path: of the notebook.
    """
    executed = EXECUTED / path.name
    notebook = nbformat.read(executed if executed.exists() else path, as_version=4)
    sources = _sources(notebook)
    for cell in notebook.cells:
        if cell.cell_type == "markdown":
            cell.source = MATHS.sub(_mathml, cell.source)
        else:  # progress goes to standard error
            cell.outputs = [output for output in cell.get("outputs", []) if output.get("name") != "stderr"]
    body, resources = MarkdownExporter().from_notebook_node(notebook)
    pictures = resources["outputs"]
    for name in pictures:
        body = body.replace(f"({name})", f"({path.stem}_files/{name})")
    title, _, rest = body.lstrip().partition("\n")
    note = STRIPPED if not executed.exists() else STALE if sources != _sources_of(path) else ""
    head = f"{title}\n\n[Download the notebook]({path.name}){{ .md-button download }}\n\n{note}\n"
    files: dict[str, str | bytes] = {
        page_of(path): head + _boxed_outputs(rest),
        f"tutorials/{path.name}": path.read_bytes(),
    }
    return files | {f"tutorials/{path.stem}_files/{name}": picture for name, picture in pictures.items()}


def table() -> str:
    """The list of the README: each notebook and what it teaches."""
    rows = re.findall(r"^\| \[([^\]]+)\]\(tutorials/([^)]+)\) \| (.+) \|$", _readme(), flags=re.MULTILINE)
    lines = [f"| [{title}]({Path(name).stem}.md) | {what} |" for title, name, what in rows]
    return "\n".join(["| tutorial | what you learn |", "|---|---|", *lines])


@cache
def _readme() -> str:
    return (ROOT / "README.md").read_text(encoding="utf-8")


def _sources_of(path: Path) -> list[str]:
    return _sources(nbformat.read(path, as_version=4))


def _sources(notebook: nbformat.NotebookNode) -> list[str]:
    return [cell.source for cell in notebook.cells]


def _boxed_outputs(markdown: str) -> str:
    """Outputs of text, which nbconvert indents by four outside the blocks of code, as blocks of their own kind."""
    parts = re.split(r"(^```.*?^```)", markdown, flags=re.DOTALL | re.MULTILINE)
    return "".join(part if part.startswith("```") else INDENTED.sub(_boxed, part) for part in parts)


def _boxed(match: re.Match[str]) -> str:
    if not match.group().strip():
        return "\n"
    return "```{ .text .output }\n" + re.sub(r"(?m)^ {4}", "", match.group()).rstrip() + "\n```\n\n"


def _mathml(match: re.Match[str]) -> str:
    """A formula as browsers draw it by themselves, without a script."""
    block, inline = match.groups()
    if block:
        return convert(" ".join(block.split()), display="block")
    return f"<span>{convert(inline)}</span>"  # a line may begin with it
