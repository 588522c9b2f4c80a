"""Draws the figures of the concept pages from plans, scenes and programs of drakeplan (`make figures`).

    .venv/bin/python docs/make_figures.py              # all
    .venv/bin/python docs/make_figures.py stance       # one

Plans are kept in build/figures, so that a figure can be drawn again without planning.
"""

from __future__ import annotations

import sys
from collections.abc import Callable

import figures_of_contacts
import figures_of_plans

FIGURES: dict[str, Callable[[], None]] = {
    "contact": figures_of_contacts.contact,
    "stance": figures_of_contacts.stance,
    "transition": figures_of_contacts.transition,
    "support": figures_of_contacts.support,
    "friction-cone": figures_of_contacts.friction_cone,
    "segment": figures_of_plans.segment,
    "capture": figures_of_plans.capture,
    "verifier": figures_of_plans.verifier,
}

if __name__ == "__main__":
    for name in sys.argv[1:] or FIGURES:
        FIGURES[name]()
