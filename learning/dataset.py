"""Data sets of label campaigns: read whole or not at all, held out by scene, looked at by category.

Knows no dynamics: what a column means is the business of whoever asks (`learning.labelled_transitions`).
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc

from learning.shard_file import FORMAT, FORMAT_VERSION, not_finite, read_shard, schema_lines, shard_paths
from scenes.input_error import InputError

CAMPAIGN_FILE = "campaign.json"
TRAIN, VALIDATION, TEST = range(3)


@dataclass(frozen=True, eq=False)
class Dataset:
    """Rows of one campaign.

    Attributes:
        table: in the order of shards and tasks.
        source: what the data are: campaign, version, seed, parameters and fingerprint, number of shards and rows, SHA-256.
    """

    table: pa.Table
    source: Mapping[str, object]

    def __len__(self) -> int:
        return self.table.num_rows

    def take(self, rows: np.ndarray) -> Dataset:
        """These rows of it, by index or mask (n,)."""
        rows = np.asarray(rows)
        if rows.dtype == bool:
            rows = np.flatnonzero(rows)
        return Dataset(self.table.take(pa.array(rows, pa.int64())), self.source)

    def view(self, column: str, value: object) -> Dataset:
        """The rows with this value in a column: one category, one kind of ground.

        Args:
            column: its name.
            value: what it holds in the rows that are kept.
        """
        self._require(column)
        return Dataset(self.table.filter(pc.field(column) == value), self.source)

    def array(self, column: str) -> np.ndarray:
        """(n,) or (n, width) values of a column; NaN where null."""
        self._require(column)
        values = self.table[column].combine_chunks()
        if not pa.types.is_fixed_size_list(values.type):
            return values.to_numpy(zero_copy_only=False)
        width, some = values.type.list_size, values.is_valid().to_numpy(zero_copy_only=False)
        flat = values.drop_null().flatten().to_numpy(zero_copy_only=False).reshape(-1, width)
        if some.all():
            return flat
        filled = np.full((len(values), width), np.nan)
        filled[some] = flat
        return filled

    def split(self, seed: int = 0, *, validation: float = 0.1, test: float = 0.1, by: str = "scene") -> np.ndarray:
        """(n,) TRAIN, VALIDATION or TEST, as `split_by_scene` has it.

        Args:
            seed: of the split.
            validation: share of the scenes, in [0, 1).
            test: share of the scenes, in [0, 1).
            by: name of the column with the scene's number.
        """
        return split_by_scene(self.array(by), seed, validation, test)

    def _require(self, column: str) -> None:
        if column not in self.table.column_names:
            raise InputError(f"data set: no column {column!r}, expected one of {', '.join(self.table.column_names)}")


def split_by_scene(scene: np.ndarray, seed: int, validation: float = 0.1, test: float = 0.1) -> np.ndarray:
    """(n,) TRAIN, VALIDATION or TEST; all rows of one scene fall in one part.

    The part of a scene depends on its number and the seed alone: more data do not move old scenes between parts.

    Args:
        scene: (n,) number of each row's scene.
        seed: of the split.
        validation: share of the scenes, in [0, 1).
        test: share of the scenes, in [0, 1).
    """
    unique, index = np.unique(scene, return_inverse=True)
    draw = np.array([np.random.default_rng([seed, int(s)]).random() for s in unique])
    part = np.where(draw < test, TEST, np.where(draw < test + validation, VALIDATION, TRAIN))
    return part[index] if len(scene) else np.zeros(0, int)


def read_dataset(folder: str | Path, *, campaign: str, version: int, schema: pa.Schema) -> Dataset:
    """All whole shards of a folder, of a campaign that is finished or still runs.

    Args:
        folder: where `drakeplan collect` wrote.
        campaign: name that is expected.
        version: of it.
        schema: columns that are expected.

    Raises:
        InputError: no such folder, no shards, another campaign or version, damaged or foreign shards, columns that
            differ, or numbers that are not finite.
    """
    folder = Path(folder)
    if not folder.is_dir():
        raise InputError(f"{folder}: expected a folder of labels")
    paths = shard_paths(folder)
    if not paths:
        raise InputError(f"{folder}: no shards of labels; make some with `drakeplan collect`")
    facts = _campaign_facts(folder / CAMPAIGN_FILE, campaign, version)
    tables, digest, fingerprint = [], hashlib.sha256(), ""
    for path in paths.values():
        header, table = read_shard(path)
        fingerprint = fingerprint or header.fingerprint
        if header.fingerprint != fingerprint:
            raise InputError(f"{path}: comes from another campaign than {next(iter(paths.values())).name}")
        if wrong := sorted(set(schema_lines(table.schema)) ^ set(schema_lines(schema))):
            raise InputError(f"{path}: expected the columns of {campaign} version {version}; differs in {wrong[0]!r}")
        if bad := not_finite(table):
            raise InputError(f"{path}: column {bad} holds a number that is not finite")
        tables.append(table.select(schema.names).replace_schema_metadata(None))
        digest.update(hashlib.sha256(path.read_bytes()).hexdigest().encode())  # as on the campaign's card
    table = pa.concat_tables(tables)
    found = {"fingerprint": fingerprint, "shards": len(tables), "rows": table.num_rows, "sha256": digest.hexdigest()}
    return Dataset(table, facts | found)


def _campaign_facts(path: Path, campaign: str, version: int) -> dict[str, object]:
    try:
        facts = json.loads(path.read_text(encoding="utf-8"))
        known = {name: facts[name] for name in ("campaign", "version", "seed", "parameters")}
        if not isinstance(known["parameters"], dict):
            raise TypeError("parameters are no mapping")
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise InputError(f"{path}: expected the description of a campaign ({error})") from None
    if (facts.get("format", FORMAT), facts.get("format_version", FORMAT_VERSION)) != (FORMAT, FORMAT_VERSION):
        raise InputError(f"{path}: expected {FORMAT} version {FORMAT_VERSION}, got version {facts['format_version']}")
    if (known["campaign"], known["version"]) != (campaign, version):
        raise InputError(
            f"{path}: expected campaign {campaign} version {version}, got {facts['campaign']} {facts['version']}"
        )
    return known
