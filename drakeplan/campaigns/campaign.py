"""What a campaign is: a schema and a pure function of a seed to rows. The engine knows no more of it than this."""

from __future__ import annotations

import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
import pyarrow as pa

from learning.shard_file import CampaignIdentity, not_finite, schema_lines

Row = Mapping[str, Any]


class Campaign(Protocol):
    """A source of rows. It must pickle, since workers get a copy with every task.

    Attributes:
        name: letters and dashes.
        version: raise it whenever equal seeds would give other rows.
    """

    @property
    def name(self) -> str: ...

    @property
    def version(self) -> int: ...

    @property
    def schema(self) -> pa.Schema:
        """Columns of a row; a column that may be null says so."""
        ...

    @property
    def parameters(self) -> Mapping[str, Any]:
        """Everything that `rows` depends on besides the seed, as JSON values."""
        ...

    @property
    def count_by(self) -> Sequence[str]:
        """Columns whose combinations of values the card counts."""
        ...

    def rows(self, seed: np.random.SeedSequence, task: int) -> Sequence[Row]:
        """The rows of one task.

        Args:
            seed: of all random numbers of this task; nothing else may be drawn, no clock read, no earlier task recalled.
            task: its number in the campaign, from 0, to label rows with.
        """
        ...


@dataclass(frozen=True)
class Task:
    """One unit of work.

    Attributes:
        shard: the shard that its rows go to.
        index: its place there, from 0.
        number: its number in the campaign.
        seed: the campaign's.
    """

    shard: int
    index: int
    number: int
    seed: int

    def seed_sequence(self) -> np.random.SeedSequence:
        """The seed of this task alone."""
        return np.random.SeedSequence(self.seed, spawn_key=(self.shard, self.index))


class BadRowsError(ValueError):
    """A campaign returned rows that do not fit its own schema."""


def identity(campaign: Campaign, seed: int, tasks_per_shard: int) -> CampaignIdentity:
    """The campaign's name, version, seed and parameters, which determine its rows.

    Args:
        campaign: the source of rows.
        seed: of all random numbers.
        tasks_per_shard: tasks in one file.
    """
    lines = schema_lines(campaign.schema)
    return CampaignIdentity(campaign.name, campaign.version, seed, tasks_per_shard, dict(campaign.parameters), lines)


def run_task(campaign: Campaign, task: Task) -> pa.Table:
    """The rows of one task as a table, checked; runs inside a worker.

    Args:
        campaign: the source of rows.
        task: which of its tasks.

    Raises:
        BadRowsError: a column is missing, unknown, of the wrong type, null where it may not be, or not finite.
    """
    return rows_table(campaign.schema, campaign.rows(task.seed_sequence(), task.number))


def rows_table(schema: pa.Schema, rows: Sequence[Row]) -> pa.Table:
    """The rows as a table of this schema; raises as `run_task`.

    Args:
        schema: columns of the table.
        rows: one mapping from column to value each.
    """
    columns: dict[str, list[Any]] = {name: [] for name in schema.names}
    for row in rows:
        if row.keys() != columns.keys():
            wrong = sorted(set(row) ^ set(columns))
            raise BadRowsError(f"column {wrong[0]} is {'not in the schema' if wrong[0] in row else 'missing'}")
        for name, values in columns.items():
            values.append(row[name])
    arrays = []
    for column in schema:
        try:
            array = pa.array(columns[column.name], column.type)
        except (pa.ArrowException, TypeError, ValueError, OverflowError) as error:
            raise BadRowsError(f"column {column.name}: {error}") from None
        if array.null_count and not column.nullable:
            raise BadRowsError(f"column {column.name} is null")
        arrays.append(array)
    table = pa.Table.from_arrays(arrays, schema=schema)
    if wrong := not_finite(table):
        raise BadRowsError(f"column {wrong} holds a number that is not finite")
    return table


def limit_memory(size: int) -> None:
    """Lets this process hold no more private memory than this [bytes]; more raises MemoryError (not on Windows)."""
    if sys.platform != "win32":
        import resource

        _, hard = resource.getrlimit(resource.RLIMIT_DATA)
        resource.setrlimit(resource.RLIMIT_DATA, (size if hard < 0 else min(size, hard), hard))
