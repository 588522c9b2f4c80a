"""Which public name is on which page of the reference; every name of `drakeplan.__all__` is on one."""

from __future__ import annotations

import drakeplan

PAGES = {  # page -> modules whose names it has
    "planning": ("drakeplan.query", "drakeplan.timing", "drakeplan.progress"),
    "scenes": ("scenes", "drakeplan.robot_setup"),
    "plans": ("drakeplan.plan", "drakeplan.verifier", "drakeplan.playback", "drakeplan.export"),
    "experience": ("drakeplan.experience",),
    "physics": ("drakeplan.execution",),
}
BESIDE = {  # classes that the public ones refer to
    "planning": (
        "drakeplan.contact_planning.contact_plan.PlannerOptions",
        "optimization.balance.friction.FrictionCone",
    ),
    "plans": ("drakeplan.verifier.Check",),
}


def names(page: str) -> list[str]:
    """The public names of a page, functions first.

    Args:
        page: key of `PAGES`.
    """
    return sorted((name for name in drakeplan.__all__ if _page(name) == page), key=lambda n: (n[0].isupper(), n))


def directives(page: str) -> str:
    """What mkdocstrings replaces by the documentation of each name."""
    paths = [f"drakeplan.{name}" for name in names(page)] + list(BESIDE.get(page, ()))
    return "\n\n".join(f"::: {path}" for path in paths)


def _page(name: str) -> str:
    home = getattr(drakeplan, name).__module__
    for page, modules in PAGES.items():
        if home.startswith(tuple(f"{module}." for module in modules)) or home in modules:
            return page
    raise KeyError(f"drakeplan.{name} of {home}: give its module a page in docs/site/api.py")
