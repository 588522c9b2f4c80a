"""The table and the archive say the same, the one with a head and the other by name, bit by bit."""

import csv
import io
import json
import zipfile
from dataclasses import replace

import numpy as np
import pytest

from drakeplan.export.samples import sample_motion
from drakeplan.export.source import json_text

OFFSET = np.array([431250.0, 5411000.0, 12.0])  # [m] of `map_plan`


def read_table(path):
    """(lines of the head, name -> column)."""
    lines = path.read_text(encoding="utf-8").splitlines()
    head = [line for line in lines if line.startswith("#")]
    rows = list(csv.DictReader(lines[len(head) :]))
    return head, {name: np.array([float(row[name]) for row in rows]) for name in rows[0]}


def columns(table, stem, axes="xyz"):
    return np.stack([table[f"{stem}{k}"] for k in axes], axis=1)


def test_the_table_holds_the_motion_bit_by_bit(strolling_plan, write, tmp_path):
    write(strolling_plan, "csv", "plan.csv")
    _, table = read_table(tmp_path / "plan.csv")
    motion, samples = strolling_plan.motion, sample_motion(strolling_plan)
    assert np.array_equal(table["t"], motion.t)
    assert np.array_equal(columns(table, "base_"), motion.q[:, 4:7])
    assert np.array_equal(columns(table, "base_q", "wxyz"), motion.q[:, :4])
    assert np.array_equal(columns(table, "base_w"), motion.v[:, :3])
    assert np.array_equal(columns(table, "base_v"), motion.v[:, 3:6])
    for j, name in enumerate(samples.joint_names):
        assert np.array_equal(table[f"q.{name}"], motion.q[:, 7 + j])
        assert np.array_equal(table[f"v.{name}"], motion.v[:, 6 + j])
    for a, name in enumerate(motion.actuator_names):
        assert np.array_equal(table[f"tau.{name}"], motion.tau[:, a])
    for e, name in enumerate(strolling_plan.effectors):
        assert np.array_equal(table[f"{name}.contact"], samples.contact[:, e] >= 0)
        assert np.array_equal(columns(table, f"{name}.f"), samples.force[:, e])


def test_the_head_names_units_frames_orders_robot_and_scene(strolling_plan, write, tmp_path):
    write(strolling_plan, "csv", "plan.csv")
    head = "\n".join(read_table(tmp_path / "plan.csv")[0])
    for word in (
        '"escher"',
        "76 kg",
        '"rubble_corridor"',
        "units: s, m, rad",
        "world W",
        "w x y z",
        "left_foot, right_foot",
    ):
        assert word in head
    assert '["waist_yaw", "left_shoulder_pitch"' in head


def test_odd_names_stay_in_their_place(strolling_plan, write, tmp_path):
    """A name with a line break or a comma neither leaves the head nor makes a column."""
    motion = strolling_plan.motion
    q = (*motion.position_names[:7], *(name.replace("waist", "wa,\n'i\"st") for name in motion.position_names[7:]))
    v = (*motion.velocity_names[:6], *(name.replace("waist", "wa,\n'i\"st") for name in motion.velocity_names[6:]))
    odd = replace(strolling_plan, scene_name="a\nb, ü", motion=replace(motion, position_names=q, velocity_names=v))
    write(odd, "csv", "odd.csv")
    write(strolling_plan, "csv", "plan.csv")
    text = (tmp_path / "odd.csv").read_text(encoding="utf-8")
    head = [line for line in text.splitlines() if line.startswith("#")]
    assert len(head) == len(read_table(tmp_path / "plan.csv")[0])
    rows = list(csv.reader(io.StringIO("".join(text.splitlines(keepends=True)[len(head) :]), newline="")))
    assert "q.wa,\n'i\"st_yaw" in rows[0]
    assert {len(row) for row in rows} == {len(rows[0])}


def test_table_and_archive_agree(stepping_plan, write, tmp_path):
    write(stepping_plan, "csv", "plan.csv")
    write(stepping_plan, "npz", "plan.npz")
    _, table = read_table(tmp_path / "plan.csv")
    with np.load(tmp_path / "plan.npz", allow_pickle=False) as archive:
        arrays = dict(archive)
    assert np.array_equal(columns(table, "com_"), arrays["com"])
    assert np.array_equal(columns(table, "angular_momentum_"), arrays["angular_momentum"])
    for e, name in enumerate(arrays["effectors"]):
        assert np.array_equal(columns(table, f"{name}.cop_"), arrays["cop"][:, e], equal_nan=True)
        assert np.array_equal(table[f"{name}.torque_n"], arrays["torque_n"][:, e])
    for j, name in enumerate(arrays["joint_names"]):
        assert np.array_equal(table[f"q.{name}"], arrays["joint_position"][:, j])
    assert "joint_torque" not in arrays  # this plan has none
    assert not any(name.startswith("tau.") for name in table)


def test_the_archive_explains_itself(strolling_plan, write, tmp_path):
    write(strolling_plan, "npz", "plan.npz")
    with np.load(tmp_path / "plan.npz", allow_pickle=False) as archive:
        header = json.loads(str(archive["header"]))
        assert set(header["arrays"]) == set(archive.files) - {"header"}
        assert header["robot"] == "escher"
        assert header["mass"] == strolling_plan.mass
    with zipfile.ZipFile(tmp_path / "plan.npz") as members:
        assert {info.date_time[0] for info in members.infolist()} == {1980}  # no time stamps


@pytest.mark.parametrize("to", ["csv", "npz"])
def test_the_offset_of_a_georeferenced_scene_is_added_again(map_plan, stepping_plan, write, tmp_path, to):
    write(map_plan, to, "map")
    local = sample_motion(stepping_plan)
    if to == "csv":
        _, table = read_table(tmp_path / "map")
        com, base, cop = columns(table, "com_"), columns(table, "base_"), columns(table, "left_foot.cop_")
    else:
        archive = np.load(tmp_path / "map", allow_pickle=False)
        com, base, cop = archive["com"], archive["base_position"], archive["cop"][:, 0]
        assert np.array_equal(archive["contact_X_WC"][:, :3, 3], stepping_plan.contacts.X_WC[:, :3, 3] + OFFSET)
    assert np.array_equal(com, local.com + OFFSET)
    assert np.array_equal(base, local.base_position + OFFSET)
    assert np.array_equal(cop, local.cop[:, 0] + OFFSET, equal_nan=True)


def test_json_has_a_key_a_line_and_comes_back():
    value = {"a": [1.5, -0.1], "b": {"c": None, "ä": "\n"}, "d": [{"e": 1}, {}], "f": {}}
    text = json_text(value)
    assert json.loads(text) == value
    assert ' "a": [1.5, -0.1],\n' in text
    with pytest.raises(ValueError, match="Out of range"):
        json_text({"a": float("nan")})
