"""What the site adds to the files in docs: pages made from the repository, the command line and the notebooks.

MkDocs calls the functions `on_...` (https://www.mkdocs.org/dev-guide/plugins/#events). Pages hold markers such as
`<!-- commands -->`, which are replaced by what is made here.
"""

from __future__ import annotations

import sys
from functools import partial
from pathlib import Path
from typing import Any

from mkdocs.structure.files import File, Files

sys.path.insert(0, str(Path(__file__).parent))
import api
import commands
import gallery
import notebooks
import repository_links

ROOT = Path(__file__).resolve().parents[2]
ROOT_PAGES = {  # page of the site -> document at the top of the repository
    "architecture.md": "ARCHITECTURE.md",
    "changelog.md": "CHANGELOG.md",
    "contributing.md": "CONTRIBUTING.md",
}
MARKERS = {
    "<!-- commands -->": commands.sections,
    "<!-- gallery -->": gallery.cards,
    "<!-- played page -->": gallery.first_page,
    "<!-- tutorials -->": notebooks.table,
    **{f"<!-- api {page} -->": partial(api.directives, page) for page in api.PAGES},
}


def on_config(config: Any) -> Any:
    """Fills in what the navigation lists by folder."""
    config.nav = [_with_folders(entry) for entry in config.nav]
    return config


def _with_folders(entry: Any) -> Any:
    """The entry with `decisions/` and `tutorials/` replaced by the lists of their pages."""
    if not isinstance(entry, dict):
        return entry
    ((title, below),) = entry.items()
    if isinstance(below, list):
        return {title: [_with_folders(inner) for inner in below]}
    if below == "decisions/":
        pages = sorted(path.name for path in (ROOT / "docs" / "decisions").glob("*.md"))
        return {title: ["decisions/README.md", *(f"decisions/{name}" for name in pages if name != "README.md")]}
    if below == "tutorials/":
        return {title: ["tutorials/index.md", *(notebooks.page_of(path) for path in notebooks.NOTEBOOKS)]}
    return entry


def on_files(files: Files, config: Any) -> Files:
    """Adds the pages that are made."""
    for page, source in ROOT_PAGES.items():
        files.append(File.generated(config, page, content=(ROOT / source).read_text(encoding="utf-8")))
    for path in notebooks.NOTEBOOKS:
        for name, content in notebooks.files_of(path).items():
            files.append(File.generated(config, name, content=content))
    return files


def on_page_markdown(markdown: str, page: Any, config: Any, files: Files) -> str:
    """Replaces markers, and links to files of the repository by links to pages or copies of them."""
    for marker, make in MARKERS.items():
        if marker in markdown:
            markdown = markdown.replace(marker, make())
    source = ROOT_PAGES.get(page.file.src_uri, f"docs/{page.file.src_uri}")
    rewritten = repository_links.rewrite(markdown, page.file.src_uri, source, {v: k for k, v in ROOT_PAGES.items()})
    for name, path in rewritten.copies.items():
        if files.get_file_from_path(name) is None:
            files.append(File.generated(config, name, content=path.read_bytes()))
    return rewritten.text
