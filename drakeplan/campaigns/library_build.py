"""Builds a library: plans of random environments by a campaign, then added one after the other in the campaign's order."""

from __future__ import annotations

import dataclasses
import tempfile
from collections import Counter
from pathlib import Path

from drakeplan.campaigns.card import Card
from drakeplan.experience.library import Library
from drakeplan.experience.stored_plan import read_stored_plan
from learning.shard_file import read_shard, shard_paths


@dataclasses.dataclass(frozen=True)
class BuildReport:
    """What building added.

    Attributes:
        environments: planned in.
        plans: verified plans that came of them.
        added: to the library in this run.
        alike: left out since a stored plan is nearly the same, those of earlier runs among them.
        spare: left out since there are enough of their motion mode.
        modes: plans in the library by motion mode.
    """

    environments: int
    plans: int
    added: int
    alike: int
    spare: int
    modes: dict[str, int]


def add_campaign(library: Library, folder: str | Path, card: Card, most: int | None = None) -> BuildReport:
    """Adds all plans of a campaign to a library, and notes in its manifest how they were made.

    Args:
        library: that can be written.
        folder: of the campaign `drakeplan.campaigns.stored_plans`.
        card: of that campaign.
        most: plans of each motion mode at most; None for all.
    """
    added = alike = spare = 0
    modes = Counter(entry.mode for entry in library.entries())
    with tempfile.TemporaryDirectory() as place:
        for path in shard_paths(Path(folder)).values():
            _, table = read_shard(path)
            for content in table["plan"].to_pylist():
                file = Path(place) / "plan.safetensors"
                file.write_bytes(content)
                plan = read_stored_plan(file)
                if most is not None and modes[plan.mode] >= most:
                    spare += 1
                    continue
                addition = library.add(plan)
                added += addition.added
                alike += not addition.added
                modes[plan.mode] += addition.added
    facts = {"campaign": card.campaign, "seed": card.seed, "environments": card.tasks, "plans": card.rows,
             "sha256": card.sha256, "parameters": dict(card.parameters), "most": most, "code": list(card.code)}  # fmt: skip
    library.note(facts)
    return BuildReport(card.tasks, card.rows, added, alike, spare, dict(modes))
