"""One shard of a label campaign: a Parquet file that says which campaign, seed and tasks its rows come from.

The bytes depend on nothing but the rows and the header: no times, no machine. A folder of shards is a data set.
"""

from __future__ import annotations

import hashlib
import json
import re
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from scenes.input_error import InputError

FORMAT, FORMAT_VERSION = "drakeplan-labels", 1
HEADER_KEY = b"drakeplan"  # of the header in the Parquet file's metadata
_NAME = re.compile(r"shard-(\d{6})\.parquet")


@dataclass(frozen=True)
class CampaignIdentity:
    """All that decides what the rows of a campaign are; two campaigns with equal identities have equal rows.

    Attributes:
        campaign: its name.
        version: raised by its author whenever equal seeds would give other rows.
        seed: of all its random numbers.
        tasks_per_shard: tasks that a full shard holds.
        parameters: everything else that its tasks depend on, as JSON values.
        schema: names and types of the columns, one line each.
    """

    campaign: str
    version: int
    seed: int
    tasks_per_shard: int
    parameters: Mapping[str, object]
    schema: tuple[str, ...]

    @property
    def fingerprint(self) -> str:
        """SHA-256 over all of it."""
        return hashlib.sha256(json.dumps(asdict(self), sort_keys=True).encode()).hexdigest()

    def difference(self, other: CampaignIdentity) -> str:
        """The first thing in which two identities differ, for a message; "" where they are equal."""
        for name in ("campaign", "version", "seed", "tasks_per_shard"):
            ours, theirs = getattr(self, name), getattr(other, name)
            if ours != theirs:
                return f"{name} {theirs!r}, expected {ours!r}"
        for name in sorted({*self.parameters, *other.parameters}):
            ours, theirs = self.parameters.get(name), other.parameters.get(name)
            if json.dumps(ours) != json.dumps(theirs):
                return f"{name} {theirs!r}, expected {ours!r}"
        if self.schema == other.schema:
            return ""
        changed = sorted(set(self.schema) ^ set(other.schema))
        return f"another schema ({changed[0] if changed else 'the order of its columns'})"


@dataclass(frozen=True)
class Quarantined:
    """A task that gave no rows.

    Attributes:
        index: of the task in its shard; with the campaign's seed and the shard's number it is the task's seed.
        reason: one line.
    """

    index: int
    reason: str


@dataclass(frozen=True)
class ShardHeader:
    """Where the rows of one shard come from.

    Attributes:
        fingerprint: of the campaign's identity.
        shard: its number, from 0.
        tasks: how many tasks it holds, quarantined ones among them.
        quarantined: those that gave no rows, in order.
    """

    fingerprint: str
    shard: int
    tasks: int
    quarantined: tuple[Quarantined, ...] = field(default=())


def schema_lines(schema: pa.Schema) -> tuple[str, ...]:
    """One line a column: name, type and whether it may be null; Parquet calls the items of a list elements."""
    return tuple(
        f"{f.name}: {f.type}{'' if f.nullable else ' not null'}".replace("<element:", "<item:") for f in schema
    )


def shard_name(shard: int) -> str:
    """File name of the shard of this number."""
    return f"shard-{shard:06d}.parquet"


def shard_paths(folder: Path) -> dict[int, Path]:
    """The shards in a folder by number, in order."""
    found = ((_NAME.fullmatch(p.name), p) for p in Path(folder).iterdir())
    return dict(sorted((int(match[1]), path) for match, path in found if match))


def encode_shard(table: pa.Table, header: ShardHeader) -> bytes:
    """The bytes of the file: the same for the same rows and header, whoever writes them.

    Args:
        table: the rows.
        header: where they come from.
    """
    described = table.replace_schema_metadata(
        {HEADER_KEY: json.dumps({"format": FORMAT, "format_version": FORMAT_VERSION, **asdict(header)}, sort_keys=True)}
    )
    sink = pa.BufferOutputStream()
    pq.write_table(described, sink, compression="zstd", store_schema=True, write_statistics=False)
    return sink.getvalue().to_pybytes()


def read_shard(path: Path) -> tuple[ShardHeader, pa.Table]:
    """Header and rows.

    Raises:
        InputError: unreadable, truncated, or not a shard of this format.
    """
    try:
        table = pq.ParquetFile(path).read(use_threads=False)
    except (OSError, pa.ArrowException) as error:
        raise InputError(f"{path}: expected a readable shard of labels ({_first_line(error)})") from None
    return _header(path, table.schema.metadata), table


def read_header(path: Path) -> ShardHeader:
    """The header alone; raises as `read_shard` where even the file's end is damaged."""
    try:
        metadata = pq.read_schema(path).metadata
    except (OSError, pa.ArrowException) as error:
        raise InputError(f"{path}: expected a readable shard of labels ({_first_line(error)})") from None
    return _header(path, metadata)


def not_finite(table: pa.Table) -> str:
    """Name of the first column with a NaN or an infinite number, "" where there is none; nulls are allowed."""
    for name in table.column_names:
        values = table[name].combine_chunks()
        while pa.types.is_fixed_size_list(values.type) or pa.types.is_list(values.type):
            values = values.flatten()
        if pa.types.is_floating(values.type) and not np.isfinite(values.drop_null().to_numpy()).all():
            return name
    return ""


def _header(path: Path, metadata: Mapping[bytes, bytes] | None) -> ShardHeader:
    try:
        facts = json.loads((metadata or {})[HEADER_KEY])
        known = facts["format"] == FORMAT and facts["format_version"] == FORMAT_VERSION
        quarantined = tuple(Quarantined(int(q["index"]), str(q["reason"])) for q in facts["quarantined"])
        header = ShardHeader(str(facts["fingerprint"]), int(facts["shard"]), int(facts["tasks"]), quarantined)
    except (KeyError, TypeError, ValueError):
        raise InputError(f"{path}: expected a shard of labels, this Parquet file has no such header") from None
    if not known:
        raise InputError(f"{path}: expected {FORMAT} version {FORMAT_VERSION}, got version {facts['format_version']}")
    return header


def _first_line(error: Exception) -> str:
    return (str(error).splitlines() or [type(error).__name__])[0]
