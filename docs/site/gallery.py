"""Cards of the gallery, and the page that the start page plays. `docs/make_gallery.py` makes what they show."""

from __future__ import annotations

import html
import json
import sys
from pathlib import Path

DOCS = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(DOCS))
from gallery_crossings import CROSSINGS, FIRST, Crossing  # noqa: E402


def cards() -> str:
    """One card for each crossing: its picture, which opens the page where there is one, what it shows, its command."""
    made = sum(_page(c).is_file() for c in CROSSINGS)
    hint = (
        ""
        if made == len(CROSSINGS)
        else f"""!!! note
    {made} of {len(CROSSINGS)} pages are in this copy of the site. `make gallery` makes the others, a few seconds each; then run
    `make docs` again.
"""
    )
    return hint + '\n<div class="gallery">\n' + "\n".join(map(_card, CROSSINGS)) + "\n</div>"


def _card(crossing: Crossing) -> str:
    picture = (
        f'<img src="{crossing.name}.webp" alt="{html.escape(crossing.title)}" loading="lazy" width="640" height="360">'
    )
    if _page(crossing).is_file():
        picture = f'<a href="{crossing.name}.html" title="play">{picture}</a>'
    return f"""<figure>{picture}
<figcaption><b>{html.escape(crossing.title)}</b> {html.escape(crossing.about)} {_facts(crossing)}
<code>{html.escape(crossing.command)}</code></figcaption></figure>"""


def _facts(crossing: Crossing) -> str:
    """How long the motion is, from the list that comes with the pictures."""
    known = json.loads((DOCS / "gallery" / "facts.json").read_text(encoding="utf-8")).get(crossing.name)
    if known is None:
        return ""
    palms = f", {known['palms']} with a palm" if known["palms"] else ""
    return f"{known['stances']} stances, {known['contacts']} contacts{palms}; {known['duration']:.0f} s of motion."


def first_page() -> str:
    """The played page of the start page, or the still picture where it has not been made."""
    if not _page(FIRST).is_file():
        return "![A humanoid leans on a wall while it crosses tilted stones](picture.png)"
    return f'<iframe class="played" src="gallery/{FIRST.name}.html#bare" title="the plan, playing" loading="lazy"></iframe>'


def _page(crossing: Crossing) -> Path:
    return DOCS / "gallery" / f"{crossing.name}.html"
