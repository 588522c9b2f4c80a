"""The card of a data set: the facts that identify it and allow to make it again, without the data."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from functools import cache
from importlib.metadata import PackageNotFoundError, version
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import pyarrow.parquet as pq

from drakeplan.campaigns.campaign import Campaign
from drakeplan.campaigns.label_folder import CARD_FILE, LabelFolder
from scenes.files.whole_file import write_whole

FLOORS = ("scenes", "optimization", "learning", "drakeplan")
LIBRARIES = ("drake", "numpy", "scipy", "numba", "piqp", "pyarrow")


@dataclass(frozen=True)
class Card:
    """What a data set is. No times: equal data sets have equal cards.

    Attributes:
        campaign, version, seed, parameters: of the campaign.
        fingerprint: of its identity, as in every shard.
        tasks: how many.
        rows: how many.
        counts: rows by the values of the campaign's `count_by` columns, one entry a combination.
        quarantined: tasks without rows: number, spawn_key of their seed, and why.
        shards: file name, rows and SHA-256 of each.
        sha256: over the shards' hashes; equal for equal data.
        code: versions that made it, in order of first use.
    """

    campaign: str
    version: int
    seed: int
    parameters: Mapping[str, Any]
    fingerprint: str
    tasks: int
    rows: int
    counts: tuple[Mapping[str, Any], ...]
    quarantined: tuple[Mapping[str, Any], ...]
    shards: tuple[Mapping[str, Any], ...]
    sha256: str
    code: tuple[Mapping[str, Any], ...]


def make_card(campaign: Campaign, folder: LabelFolder, tasks: int) -> Card:
    """Describes the data in a folder and writes `card.json` beside it.

    Args:
        campaign: the source of the rows; its `count_by` columns are counted.
        folder: with all its shards.
        tasks: number of tasks in the campaign.
    """
    shards, quarantined, rows = [], [], 0
    counts: dict[tuple[Any, ...], int] = {}
    for path, header in folder.headers().items():
        file = pq.ParquetFile(path)
        table, count = file.read(columns=list(campaign.count_by), use_threads=False), file.metadata.num_rows
        for key in zip(*(table[name].to_pylist() for name in campaign.count_by), strict=True):
            counts[key] = counts.get(key, 0) + 1
        shards.append({"file": path.name, "rows": count, "sha256": hashlib.sha256(path.read_bytes()).hexdigest()})
        rows += count
        first = header.shard * folder.identity.tasks_per_shard
        quarantined += [
            {"task": first + q.index, "spawn_key": [header.shard, q.index], "reason": q.reason}
            for q in header.quarantined
        ]
    identity = folder.identity
    card = Card(
        campaign=identity.campaign,
        version=identity.version,
        seed=identity.seed,
        parameters=identity.parameters,
        fingerprint=identity.fingerprint,
        tasks=tasks,
        rows=rows,
        counts=tuple(
            {**dict(zip(campaign.count_by, key, strict=True)), "rows": count}
            for key, count in sorted(counts.items(), key=lambda item: tuple(map(str, item[0])))
        ),
        quarantined=tuple(quarantined),
        shards=tuple(shards),
        sha256=hashlib.sha256("".join(s["sha256"] for s in shards).encode()).hexdigest(),
        code=tuple({json.dumps(s, sort_keys=True): s for s in folder.sessions()}.values()),
    )
    write_whole(folder.path / CARD_FILE, (json.dumps(asdict(card), indent=1) + "\n").encode())
    return card


@cache
def session_facts() -> dict[str, Any]:
    """The code that is running: versions, and a hash over the sources of the four packages."""
    digest = hashlib.sha256()
    for floor in FLOORS:
        spec = find_spec(floor)
        root = Path(spec.origin).parent if spec is not None and spec.origin else None
        for path in sorted(root.rglob("*.py")) if root is not None else ():
            digest.update(str(path.relative_to(root.parent)).encode() + b"\0" + path.read_bytes())  # type: ignore[union-attr]
    return {
        "drakeplan": _version("drakeplan"),
        "sources_sha256": digest.hexdigest(),
        **{n: _version(n) for n in LIBRARIES},
    }


def _version(package: str) -> str | None:
    try:
        return version(package)
    except PackageNotFoundError:
        return None
