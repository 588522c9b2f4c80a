"""Labels come from the disk as they were written, and scenes are never torn apart."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pyarrow as pa
import pytest

from learning.labelled_transitions import (
    TEST,
    TRAIN,
    VALIDATION,
    learning_set,
    read_labels,
    split_by_scene,
)
from learning.shard_file import shard_name
from learning.transition_labels import SCHEMA
from scenes.input_error import InputError


def test_labels_come_back_from_shards_as_they_were(toy_labels, as_table, write_folder, tmp_path) -> None:
    labels = toy_labels(40)
    write_folder(tmp_path, [as_table(labels.take(np.arange(25))), as_table(labels.take(np.arange(25, 40)))])
    again = read_labels(tmp_path, "escher")
    for name in ("held", "p", "R", "mover", "makes", "p_new", "R_new", "com", "velocity", "friction"):
        np.testing.assert_array_equal(getattr(again.batch, name), getattr(labels.batch, name))
    yes = labels.feasible
    assert yes.any() and not yes.all()
    np.testing.assert_array_equal(again.feasible, yes)
    for name in ("cost", "com", "velocity"):
        np.testing.assert_array_equal(getattr(again, name)[yes], getattr(labels, name)[yes])
    np.testing.assert_array_equal(again.scene, labels.scene)
    assert again.source["seed"] == 3 and again.source["rows"] == 40


def test_what_is_no_such_data_set_is_refused(toy_labels, as_table, write_folder, tmp_path) -> None:
    table = as_table(toy_labels(10))
    with pytest.raises(InputError, match="expected a folder"):
        read_labels(tmp_path / "nowhere", "escher")
    with pytest.raises(InputError, match="no shards"):
        read_labels(tmp_path, "escher")
    write_folder(tmp_path, [table, table], fingerprints="ab")
    with pytest.raises(InputError, match="another campaign"):
        read_labels(tmp_path, "escher")
    write_folder(tmp_path, [table, table.drop(["iterations"])])
    with pytest.raises(InputError, match="iterations"):
        read_labels(tmp_path, "escher")
    velocity = pa.array([[np.nan, 0.0, 0.0]] * 10, SCHEMA.field("velocity").type)
    write_folder(tmp_path, [table, table.set_column(table.schema.get_field_index("velocity"), "velocity", velocity)])
    with pytest.raises(InputError, match="velocity"):
        read_labels(tmp_path, "escher")
    write_folder(tmp_path, [table, table], robot="jvrc1")
    with pytest.raises(InputError, match="robot 'jvrc1', expected 'escher'"):
        read_labels(tmp_path, "escher")
    write_folder(tmp_path, [table, table])
    path = tmp_path / shard_name(1)
    path.write_bytes(path.read_bytes()[:-50])
    with pytest.raises(InputError, match="readable shard"):
        read_labels(tmp_path, "escher")
    (tmp_path / "campaign.json").unlink()
    path.unlink()
    with pytest.raises(InputError, match="description of a campaign"):
        read_labels(tmp_path, "escher")


def test_a_scene_is_held_out_whole_and_stays_where_it_is_when_data_grow() -> None:
    scene = np.repeat(np.arange(2000), 3)
    part = split_by_scene(scene, seed=0)
    assert all(len(set(part[scene == s])) == 1 for s in range(0, 2000, 97))
    np.testing.assert_allclose([np.mean(part == p) for p in (TRAIN, VALIDATION, TEST)], [0.8, 0.1, 0.1], atol=0.03)
    np.testing.assert_array_equal(split_by_scene(scene[:600], seed=0), part[:600])
    assert (split_by_scene(scene, seed=1) != part).any()


def test_outcomes_are_learned_in_the_frame_of_the_feet(toy_labels) -> None:
    """The toy's final CoM lies 0.95 m over the feet after, whichever way the world is turned or mirrored."""
    data = learning_set(toy_labels(300))
    height = data.com[data.feasible, 2] - data.representatives.feet_after[data.feasible, 2]
    np.testing.assert_allclose(height, 0.95, atol=1e-9)
    np.testing.assert_allclose(
        data.velocity[data.feasible], 0.5 * data.representatives.velocity[data.feasible], atol=1e-9
    )
    assert sum(len(data.rows(part)) for part in (TRAIN, VALIDATION, TEST)) == 300
    assert data.counts(TRAIN).sum() == len(data.rows(TRAIN))


def test_transitions_of_no_category_are_left_out(toy_labels) -> None:
    labels = toy_labels(50)
    held = labels.batch.held.copy()
    held[:5, 0] = False
    data = learning_set(replace(labels, batch=replace(labels.batch, held=held)))
    assert len(data.feasible) == 45
