"""Links of a page to files of the repository, which lie elsewhere or not at all in the site."""

from __future__ import annotations

import posixpath
import re
from dataclasses import dataclass, field
from pathlib import Path, PurePosixPath

ROOT = Path(__file__).resolve().parents[2]
LINK = re.compile(r"(?<=\]\()([^)\s#]+)(#[^)\s]*)?(?=\))")
MOST_BYTES = 1 << 20  # of a file that is copied into the site


@dataclass
class Rewritten:
    """A page whose links work in the site.

    Attributes:
        text: the page.
        copies: name in the site -> file of the repository that the page links to and that is no page.
    """

    text: str
    copies: dict[str, Path] = field(default_factory=dict)


def rewrite(markdown: str, page: str, source: str, pages: dict[str, str]) -> Rewritten:
    """Lets relative links that leave docs lead to the pages made of their targets, or to copies.

    Links that lead nowhere stay as they are: a strict build refuses them.

    Args:
        markdown: the page.
        page: its name in the site, `decisions/README.md`.
        source: the file that it is read from, `docs/decisions/README.md`.
        pages: documents at the top of the repository -> their pages.
    """
    rewritten = Rewritten("")
    pages = {**pages, "README.md": "index.md"}

    def replaced(match: re.Match[str]) -> str:
        target, anchor = match.group(1), match.group(2) or ""
        there = posixpath.normpath(posixpath.join(posixpath.dirname(source), target))
        if ":" in target or there.startswith("..") or not (ROOT / there).is_file():
            return match.group()
        if there in pages:
            name = pages[there]
        elif there.startswith("docs/"):
            name = there.removeprefix("docs/")
        elif there.startswith("tutorials/") and there.endswith(".ipynb"):
            name = f"tutorials/{PurePosixPath(there).stem}.md"
        elif (ROOT / there).stat().st_size <= MOST_BYTES:
            name = f"files/{there}"
            rewritten.copies[name] = ROOT / there
        else:
            return match.group()
        return posixpath.relpath(name, posixpath.dirname(page) or ".") + anchor

    parts = re.split(r"(^```.*?^```)", markdown, flags=re.DOTALL | re.MULTILINE)
    rewritten.text = "".join(part if part.startswith("```") else LINK.sub(replaced, part) for part in parts)
    return rewritten
