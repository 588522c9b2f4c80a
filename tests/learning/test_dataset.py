"""A data set is read whole or refused in one line, and scenes are held out whole."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pyarrow as pa
import pytest

from learning.dataset import TEST, TRAIN, VALIDATION, Dataset, read_dataset, split_by_scene
from learning.shard_file import ShardHeader, encode_shard, read_header, read_shard, shard_name
from scenes.input_error import InputError

SCHEMA = pa.schema(
    [
        pa.field("scene", pa.int64(), nullable=False),
        pa.field("category", pa.int8(), nullable=False),
        pa.field("point", pa.list_(pa.float64(), 3), nullable=False),
        pa.field("cost", pa.float64()),
        pa.field("end", pa.list_(pa.float64(), 3)),
    ]
)


def rows(first: int, count: int = 6) -> pa.Table:
    """Rows that say where they come from; every third has no outcome."""
    numbers = range(first, first + count)
    columns = [
        [n // 4 for n in numbers],
        [n % 3 for n in numbers],
        [[n, n + 0.5, -n] for n in numbers],
        [None if n % 3 == 2 else 2.0 * n for n in numbers],
        [None if n % 3 == 2 else [n, 0.0, 1.0] for n in numbers],
    ]
    return pa.Table.from_arrays([pa.array(c, f.type) for c, f in zip(columns, SCHEMA, strict=True)], schema=SCHEMA)


def write(folder: Path, *tables: pa.Table, fingerprints: str = "a", facts: dict[str, object] | None = None) -> Path:
    known = {"format": "drakeplan-labels", "format_version": 1, "campaign": "toy", "version": 2, "seed": 3}
    (folder / "campaign.json").write_text(json.dumps(known | {"parameters": {}} | (facts or {})))
    for k, table in enumerate(tables):
        header = ShardHeader(fingerprints[k % len(fingerprints)], k, 2)
        (folder / shard_name(k)).write_bytes(encode_shard(table, header))
    return folder


def read(folder: Path) -> Dataset:
    return read_dataset(folder, campaign="toy", version=2, schema=SCHEMA)


def test_rows_come_back_in_order_with_null_as_nan(tmp_path: Path) -> None:
    data = read(write(tmp_path, rows(0), rows(6), rows(12, 1)))
    n = np.arange(13)
    np.testing.assert_array_equal(data.array("scene"), n // 4)
    np.testing.assert_array_equal(data.array("point"), np.stack([n, n + 0.5, -n], axis=1))
    np.testing.assert_array_equal(data.array("cost"), np.where(n % 3 == 2, np.nan, 2.0 * n))
    np.testing.assert_array_equal(np.isnan(data.array("end")).all(axis=1), n % 3 == 2)
    assert data.source["shards"] == 3 and data.source["rows"] == len(data) == 13


def test_a_category_is_the_rows_that_have_it_and_categories_are_everything(tmp_path: Path) -> None:
    data = read(write(tmp_path, rows(0), rows(6)))
    views = [data.view("category", k) for k in range(3)]
    assert sum(map(len, views)) == len(data)
    for k, view in enumerate(views):
        assert (view.array("category") == k).all() and len(view) == 4
    assert len(data.view("category", 9)) == 0
    np.testing.assert_array_equal(
        data.take(data.array("category") == 1).array("point"), data.view("category", 1).array("point")
    )


def test_no_scene_is_on_both_sides_and_none_moves_when_data_grow(tmp_path: Path) -> None:
    scene = np.repeat(np.arange(1500), 3)
    part = split_by_scene(scene, seed=0)
    for side in (TRAIN, VALIDATION, TEST):
        others = set(scene[part != side])
        assert not others & set(scene[part == side])
    np.testing.assert_allclose([np.mean(part == p) for p in (TRAIN, VALIDATION, TEST)], [0.8, 0.1, 0.1], atol=0.03)
    np.testing.assert_array_equal(split_by_scene(scene[:300], seed=0), part[:300])
    order = np.random.default_rng(0).permutation(len(scene))
    np.testing.assert_array_equal(split_by_scene(scene[order], seed=0), part[order])
    data = read(write(tmp_path, rows(0), rows(6)))
    np.testing.assert_array_equal(data.split(5, test=0.5), split_by_scene(data.array("scene"), 5, 0.1, 0.5))


def test_equal_rows_make_equal_files_and_the_hash_sees_every_change(tmp_path: Path) -> None:
    header = ShardHeader("a", 0, 2)
    assert encode_shard(rows(0), header) == encode_shard(pa.concat_tables([rows(0, 2), rows(2, 4)]), header)
    assert encode_shard(rows(0), header) != encode_shard(rows(1), header)
    first = read(write(tmp_path, rows(0))).source["sha256"]
    assert read(write(tmp_path, rows(1))).source["sha256"] != first


def test_the_header_is_read_with_and_without_the_rows(tmp_path: Path) -> None:
    write(tmp_path, rows(0), rows(6))
    path = tmp_path / shard_name(1)
    header, table = read_shard(path)
    assert header == read_header(path) == ShardHeader("a", 1, 2)
    assert table.num_rows == 6


def nan_rows() -> pa.Table:
    point = pa.array([[0.0, np.nan, 0.0]] * 6, SCHEMA.field("point").type)
    return rows(0).set_column(2, SCHEMA.field("point"), point)


@pytest.mark.parametrize(
    ("tables", "facts", "complaint"),
    [
        ((), {}, "no shards of labels"),
        ((rows(0),), {"version": 1}, "expected campaign toy version 2, got toy 1"),
        ((rows(0),), {"campaign": "toad"}, "expected campaign toy version 2, got toad 2"),
        ((rows(0),), {"format_version": 9}, "expected drakeplan-labels version 1, got version 9"),
        ((rows(0),), {"parameters": None}, "expected the description of a campaign"),
        ((rows(0), rows(6).drop(["cost"])), {}, "shard-000001.parquet: expected the columns .* 'cost: double'"),
        ((rows(0), rows(6).append_column("more", pa.array([1] * 6))), {}, "'more: int64'"),
        ((rows(0), rows(6).cast(SCHEMA.set(1, pa.field("category", pa.int16(), nullable=False)))), {}, "category"),
        ((rows(0), nan_rows()), {}, "shard-000001.parquet: column point holds a number that is not finite"),
    ],
)
def test_what_does_not_fit_is_refused_in_one_line(
    tables: tuple[pa.Table, ...], facts: dict[str, object], complaint: str, tmp_path: Path
) -> None:
    write(tmp_path, *tables, facts=facts)
    with pytest.raises(InputError, match=complaint) as error:
        read(tmp_path)
    assert "\n" not in str(error.value)


def test_shards_of_two_campaigns_are_not_mixed(tmp_path: Path) -> None:
    write(tmp_path, rows(0), rows(6), fingerprints="ab")
    with pytest.raises(InputError, match="comes from another campaign than shard-000000"):
        read(tmp_path)


@pytest.mark.parametrize("content", [b"", b"not parquet at all", None])
def test_damaged_files_are_named(content: bytes | None, tmp_path: Path) -> None:
    write(tmp_path, rows(0), rows(6))
    path = tmp_path / shard_name(1)
    path.write_bytes(path.read_bytes()[:-30] if content is None else content)
    with pytest.raises(InputError, match=r"shard-000001.parquet: expected a readable shard") as error:
        read(tmp_path)
    assert "\n" not in str(error.value)


def test_parquet_files_of_others_are_refused(tmp_path: Path) -> None:
    import pyarrow.parquet as pq

    write(tmp_path, rows(0))
    pq.write_table(rows(6), tmp_path / shard_name(1))
    with pytest.raises(InputError, match="has no such header"):
        read(tmp_path)


def test_missing_folders_and_columns_are_named(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="expected a folder of labels"):
        read(tmp_path / "nowhere")
    data = read(write(tmp_path, rows(0)))
    with pytest.raises(InputError, match="no column 'colour', expected one of scene, category"):
        data.view("colour", 1)
