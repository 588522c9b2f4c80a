"""Plan files come back as they were written, whole or not at all, and what is not one says so in a line."""

from __future__ import annotations

import dataclasses
import errno
import os
import random
import signal
import time
from collections.abc import Callable
from pathlib import Path

import h5py
import numpy as np
import pytest

from drakeplan.plan.plan import Plan, PlanContacts, PlanPhases, tabulate_stances
from drakeplan.plan.plan_file import DATASETS, inspect_plan, read_plan, write_plan
from scenes.files.whole_file import require_writable
from scenes.input_error import InputError


@pytest.fixture
def plan_path(strolling_plan: Plan, tmp_path: Path) -> Path:
    path = tmp_path / "plan.h5"
    write_plan(strolling_plan, path)
    return path


def without_motion(plan: Plan) -> Plan:
    return dataclasses.replace(plan, phases=None, centroidal=None, motion=None)


def arrays(record: object) -> dict[str, object]:
    """Every field of a plan by its path, whatever its kind."""
    found = {}
    for field in dataclasses.fields(record):
        value = getattr(record, field.name)
        if dataclasses.is_dataclass(value):
            found |= {f"{field.name}.{name}": inner for name, inner in arrays(value).items()}
        else:
            found[field.name] = value
    return found


@pytest.mark.parametrize("complete", [True, False])
def test_a_plan_comes_back_bit_by_bit(strolling_plan: Plan, tmp_path: Path, complete: bool) -> None:
    plan = strolling_plan if complete else without_motion(strolling_plan)
    write_plan(plan, tmp_path / "plan.h5")
    back = read_plan(tmp_path / "plan.h5")
    assert back.status == ("complete" if complete else "contacts")
    before, after = arrays(plan), arrays(back)
    assert before.keys() == after.keys()
    for name, value in before.items():
        np.testing.assert_array_equal(after[name], value, err_msg=name)


def test_the_same_plan_gives_the_same_bytes_later(strolling_plan: Plan, tmp_path: Path) -> None:
    write_plan(strolling_plan, tmp_path / "first.h5")
    time.sleep(1.1)  # HDF5 stamps whole seconds
    write_plan(strolling_plan, tmp_path / "second.h5")
    assert (tmp_path / "first.h5").read_bytes() == (tmp_path / "second.h5").read_bytes()


def test_every_dataset_says_its_unit_and_frame(plan_path: Path) -> None:
    with h5py.File(plan_path) as file:
        names: list[str] = []
        file.visititems(lambda name, item: names.append(name) if isinstance(item, h5py.Dataset) else None)
        assert sorted(names) == sorted(name for name in DATASETS if not name.startswith("robustness/"))
        for name in names:
            assert {"unit", "frame"} <= set(file[name].attrs), name
        assert file["centroidal/force_W"].attrs["unit"] == "N"


def test_a_plan_without_motion_has_no_groups_for_it(strolling_plan: Plan, tmp_path: Path) -> None:
    write_plan(without_motion(strolling_plan), tmp_path / "plan.h5")
    with h5py.File(tmp_path / "plan.h5") as file:
        assert file.attrs["status"] == "contacts"
        assert not {"phases", "centroidal", "motion"} & set(file)


def test_inspection_needs_no_robot(strolling_plan: Plan, tmp_path: Path) -> None:
    gone = dataclasses.replace(strolling_plan, robot_model="/no/such/model.urdf")
    write_plan(gone, tmp_path / "plan.h5")
    summary = inspect_plan(tmp_path / "plan.h5")
    assert (summary.robot, summary.scene) == ("escher", strolling_plan.scene_name)
    assert summary.stances == len(strolling_plan.stances)
    assert summary.palms_used == 2
    assert summary.duration == pytest.approx(strolling_plan.motion.t[-1])
    assert "complete plan of escher" in str(summary)


def test_stances_of_a_plan_are_those_that_were_tabulated(strolling_plan: Plan) -> None:
    stances = [strolling_plan.stance(k) for k in range(len(strolling_plan.stances))]
    table, indices = tabulate_stances(stances)
    np.testing.assert_array_equal(indices, strolling_plan.stances)
    np.testing.assert_array_equal(table.X_WC, strolling_plan.contacts.X_WC)


def test_a_contact_made_again_at_the_same_place_is_another_one(strolling_plan: Plan) -> None:
    both = strolling_plan.stance(0)
    one = both.replace(0, None)
    _, indices = tabulate_stances([both, both, one, both])
    np.testing.assert_array_equal(indices[:, 0], [0, 0, -1, 2])
    np.testing.assert_array_equal(indices[:, 1], [1, 1, 1, 1])


def test_a_plan_refuses_data_that_cannot_be(strolling_plan: Plan) -> None:
    nan = strolling_plan.contacts.X_WC.copy()
    nan[0, 0, 3] = np.nan
    with pytest.raises(ValueError, match="contacts/X_WC holds a number that is not finite"):
        dataclasses.replace(strolling_plan.contacts, X_WC=nan)
    with pytest.raises(ValueError, match="stances/contact holds an index that names no contact"):
        dataclasses.replace(strolling_plan, stances=strolling_plan.stances + 1000)
    with pytest.raises(ValueError, match="phases/end has 2 rows, phases/start 1"):
        PlanPhases([0.0], [1.0, 2.0], np.zeros((1, 4), int))
    with pytest.raises(ValueError, match="contacts/effector must hold integers"):
        PlanContacts(np.eye(4)[None], [0.5], [0], [0.5])
    with pytest.raises(ValueError, match="come together"):
        dataclasses.replace(strolling_plan, motion=None)
    with pytest.raises(ValueError, match="mass"):
        dataclasses.replace(strolling_plan, mass=np.nan)


def test_arrays_of_a_plan_cannot_be_written_to(strolling_plan: Plan) -> None:
    with pytest.raises(ValueError, match="read-only"):
        strolling_plan.contacts.friction[0] = 1.0


def test_killed_at_any_moment_a_writer_leaves_the_old_file_the_new_one_or_none(
    strolling_plan: Plan, tmp_path: Path
) -> None:
    plans = [strolling_plan, without_motion(strolling_plan)]
    path = tmp_path / "plan.h5"
    rng = random.Random(0)
    began = time.perf_counter()
    write_plan(strolling_plan, path)
    once = time.perf_counter() - began
    survived = 0
    for attempt in range(20):
        if attempt % 2:
            path.unlink(missing_ok=True)
        child = os.fork()
        if not child:
            while True:
                for plan in plans:
                    write_plan(plan, path)
        time.sleep(rng.uniform(0.0, 4.0) * once)
        os.kill(child, signal.SIGKILL)
        os.waitpid(child, 0)
        if path.exists():
            survived += 1
            assert read_plan(path).status in ("complete", "contacts")
    assert survived, "every writer was killed before its first plan: this test saw nothing"
    if hasattr(os, "O_TMPFILE"):  # elsewhere a kill may leave a hidden temporary file
        strays = [p for p in tmp_path.iterdir() if p != path]
        assert len(strays) <= 1, "only the moment between naming and renaming may leave a file"


def test_without_nameless_files_a_plan_is_written_all_the_same(
    strolling_plan: Plan, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delattr(os, "O_TMPFILE")
    write_plan(strolling_plan, tmp_path / "plan.h5")
    assert read_plan(tmp_path / "plan.h5").status == "complete"
    assert list(tmp_path.iterdir()) == [tmp_path / "plan.h5"]


def test_a_full_disk_leaves_the_old_plan(
    strolling_plan: Plan, plan_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def full(descriptor: int) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")

    before = plan_path.read_bytes()
    monkeypatch.setattr(os, "fsync", full)
    with pytest.raises(InputError, match="No space left on device"):
        write_plan(without_motion(strolling_plan), plan_path)
    assert plan_path.read_bytes() == before
    assert list(plan_path.parent.iterdir()) == [plan_path]


def test_a_plan_that_cannot_be_written_leaves_the_old_one(strolling_plan: Plan, plan_path: Path) -> None:
    before = plan_path.read_bytes()
    endless = dataclasses.replace(strolling_plan, provenance={"command": "x" * 100_000})
    with pytest.raises(InputError, match="provenance is longer"):
        write_plan(endless, plan_path)
    assert plan_path.read_bytes() == before
    assert list(plan_path.parent.iterdir()) == [plan_path]


@pytest.mark.parametrize("where", ["no/such/folder/plan.h5", ".", "file/plan.h5"])
def test_an_unwritable_output_is_said_before_anything_is_done(tmp_path: Path, where: str) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(InputError, match="cannot be written") as caught:
        require_writable(tmp_path / where)
    assert "\n" not in str(caught.value)


def test_a_device_is_not_replaced_by_a_plan(strolling_plan: Plan) -> None:
    with pytest.raises(InputError, match="not a plain file"):
        write_plan(strolling_plan, "/dev/null")


def change(name: str, value: object) -> Callable[[h5py.File], None]:
    """Puts another dataset in the place of one."""

    def apply(file: h5py.File) -> None:
        del file[name]
        file[name] = value

    return apply


def nan_in(name: str) -> Callable[[h5py.File], None]:
    def apply(file: h5py.File) -> None:
        file[name][(0,) * file[name].ndim] = np.nan

    return apply


SPOILED: dict[str, tuple[Callable[[h5py.File], object], str]] = {
    "no format": (lambda f: f.attrs.__delitem__("format"), "no attribute format"),
    "another format": (lambda f: f.attrs.__setitem__("format", "weather"), "format is 'weather'"),
    "a later version": (lambda f: f.attrs.__setitem__("version", 3), "reads versions 1 to 2, the file has 3"),
    "unknown status": (lambda f: f.attrs.__setitem__("status", "fine"), "status: expected"),
    "mass is text": (lambda f: f.attrs.__setitem__("mass", "heavy"), "attribute mass: expected a number"),
    "mass is NaN": (lambda f: f.attrs.__setitem__("mass", np.nan), "attribute mass: expected a number"),
    "provenance is no JSON": (lambda f: f.attrs.__setitem__("provenance", "{"), "provenance: expected JSON"),
    "a dataset is missing": (lambda f: f.__delitem__("centroidal/com"), "centroidal/com: the dataset is missing"),
    "a group is missing": (lambda f: f.__delitem__("motion"), "motion/t: the dataset is missing"),
    "a dataset is a group": (
        lambda f: (f.__delitem__("phases/start"), f.create_group("phases/start")),
        "phases/start: the dataset is missing",
    ),
    "misshapen": (change("contacts/X_WC", np.zeros((3, 3))), "contacts/X_WC must be any x 4 x 4"),
    "too short": (change("motion/t", np.zeros(3)), "motion/q has"),
    "an index too far": (change("stances/contact", np.full((2, 4), 999)), "names no contact"),
    "indices are real": (change("stances/contact", np.zeros((2, 4))), "expected integers"),
    "NaN in a dataset": (nan_in("motion/q"), "motion/q holds a number that is not finite"),
    "other effectors": (change("effectors", ["a", "b", "c", "d"]), "effectors: expected"),
    "scene is a number": (change("scene/yaml", 3.0), "scene/yaml: expected text"),
    "no joint names": (lambda f: f["motion"].attrs.__delitem__("position_names"), "attribute position_names"),
    "groups it should not have": (lambda f: f.attrs.__setitem__("status", "contacts"), "there is a group phases"),
}


@pytest.mark.parametrize("name", SPOILED)
def test_a_spoiled_file_is_refused_in_one_line_that_names_what_is_wrong(plan_path: Path, name: str) -> None:
    spoil, expected = SPOILED[name]
    with h5py.File(plan_path, "r+") as file:
        spoil(file)
    with pytest.raises(InputError) as caught:
        read_plan(plan_path)
    assert expected in str(caught.value)
    assert str(plan_path) in str(caught.value)
    assert "\n" not in str(caught.value)


def test_truncated_foreign_and_missing_files_are_refused(plan_path: Path, tmp_path: Path) -> None:
    whole = plan_path.read_bytes()
    for share in (0.1, 0.5, 0.99):
        plan_path.write_bytes(whole[: int(share * len(whole))])
        with pytest.raises(InputError, match="truncated"):
            read_plan(plan_path)
    (tmp_path / "notes.txt").write_text("walk there")
    with pytest.raises(InputError, match="not an HDF5 file"):
        read_plan(tmp_path / "notes.txt")
    with h5py.File(tmp_path / "other.h5", "w") as file:
        file["x"] = 1
    with pytest.raises(InputError, match="not a plan file"):
        read_plan(tmp_path / "other.h5")
    with pytest.raises(InputError, match="no such plan file"):
        read_plan(tmp_path / "nowhere.h5")
    with pytest.raises(InputError, match="this is not a file"):
        read_plan(tmp_path)


def test_an_oversized_file_is_refused_without_reading_it(tmp_path: Path) -> None:
    with (tmp_path / "huge.h5").open("wb") as file:
        file.truncate(3 << 30)  # sparse: takes no space
    with pytest.raises(InputError, match="a plan file has at most"):
        read_plan(tmp_path / "huge.h5")


@pytest.mark.parametrize("seed", range(4))
def test_flipped_bytes_give_a_plan_or_a_line_but_never_another_error(plan_path: Path, seed: int) -> None:
    rng = np.random.default_rng(seed)
    whole = np.frombuffer(plan_path.read_bytes(), np.uint8)
    refusals = []
    for _ in range(20):
        damaged = whole.copy()
        damaged[rng.integers(0, min(len(whole), 20_000), 8)] ^= rng.integers(1, 256, 8, dtype=np.uint8)
        plan_path.write_bytes(damaged.tobytes())
        try:
            plan = read_plan(plan_path)
        except InputError as error:
            refusals.append(str(error))
        else:
            assert np.isfinite(plan.contacts.X_WC).all()
    assert refusals
    assert all(str(plan_path) in line and "\n" not in line for line in refusals)
