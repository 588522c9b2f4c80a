"""What holds for all formats: the same bytes again, nothing half-written, one line for what cannot be."""

from __future__ import annotations

import ast
import dataclasses
import importlib.util
import os
import re
import sys
from pathlib import Path

import numpy as np
import pytest

from drakeplan import export
from drakeplan.export import FORMATS, export_plan
from drakeplan.export.formats import find_format, load_exporter
from scenes.input_error import InputError

ROOT = Path(__file__).resolve().parents[3]
HERE = [
    pytest.param(name, marks=pytest.mark.skipif(
        any(importlib.util.find_spec(p) is None for p in found.packages), reason=export.formats.INSTALL
    ))
    for name, found in FORMATS.items()
]  # fmt: skip


@pytest.mark.parametrize("name", HERE)
def test_the_same_plan_gives_the_same_bytes(name, feet_plan, tmp_path):
    """Also for a robot whose plan has two end effectors."""
    made = []
    for folder in (tmp_path / "a", tmp_path / "b"):
        folder.mkdir()
        done = export_plan(feet_plan, name, folder / "ein Plan.x")
        assert {p.relative_to(folder) for p in folder.rglob("*") if p.is_file()} == {
            p.relative_to(folder) for p in done.files
        }
        made.append({p.relative_to(folder): p.read_bytes() for p in done.files})
    assert made[0] == made[1]
    assert all(made[0].values())
    again = export_plan(feet_plan, name, tmp_path / "a" / "ein Plan.x")  # over what is there
    assert {p.relative_to(tmp_path / "a"): p.read_bytes() for p in again.files} == made[0]


@pytest.mark.parametrize("name", sorted(set(FORMATS) - {"contacts"}))
def test_a_plan_of_contacts_only_has_no_motion_to_export(name, contacts_plan, tmp_path, monkeypatch):
    monkeypatch.setattr("drakeplan.export.formats._is_installed", lambda _: True)
    with pytest.raises(InputError, match="a plan of contacts only"):
        export_plan(contacts_plan, name, tmp_path / "x")
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("package", FORMATS["mcap"].packages)
def test_a_missing_package_is_named_with_what_to_install(package, stepping_plan, tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, package, None)
    with pytest.raises(
        InputError, match=re.escape(f"{package}, which is not installed: pip install 'drakeplan[export]'")
    ):
        export_plan(stepping_plan, "mcap", tmp_path / "x")


def test_an_unknown_format_is_named_with_the_nearest():
    with pytest.raises(InputError, match="unknown format 'tracing': did you mean tracking"):
        find_format("tracing")


@pytest.mark.parametrize("name", HERE)
def test_every_format_has_an_exporter(name):
    assert callable(load_exporter(find_format(name)).export)


def test_a_robot_that_is_not_here_is_asked_for(stepping_plan, tmp_path):
    stranger = dataclasses.replace(stepping_plan, robot="nobody", robot_model_sha256="0" * 64)
    with pytest.raises(InputError, match="add --robot FILE"):
        export_plan(stranger, "mujoco", tmp_path / "x.xml")
    assert export_plan(stranger, "csv", tmp_path / "x.csv").facts["rows"] == 491  # a table needs no robot


def test_a_folder_that_cannot_be_made_is_bad_input_and_nothing_is_left(stepping_plan, tmp_path):
    (tmp_path / "plan_data").write_text("in the way")
    with pytest.raises(InputError, match="plan_data"):
        export_plan(stepping_plan, "crocoddyl", tmp_path / "plan.py")
    assert [p.name for p in tmp_path.iterdir()] == ["plan_data"]


def test_what_was_written_before_a_failure_is_taken_back(stepping_plan, tmp_path, monkeypatch):
    from scenes.files import whole_file

    write = whole_file.write_whole

    def full(path, content):
        if Path(path).suffix == ".urdf":
            raise InputError(f"{path}: cannot be written (No space left on device)")
        write(path, content)

    monkeypatch.setattr(whole_file, "write_whole", full)
    with pytest.raises(InputError, match="No space left"):
        export_plan(stepping_plan, "crocoddyl", tmp_path / "plan.py")
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("name", ["n" * 250, "\udcff.xml", "a\nb.xml"])
def test_names_that_what_goes_with_it_cannot_have_are_bad_input(name, feet_plan, tmp_path):
    with pytest.raises(InputError, match=r"too long|printable name"):
        export_plan(feet_plan, "mujoco", tmp_path / name)
    assert not list(tmp_path.iterdir())


@pytest.mark.skipif(os.geteuid() == 0, reason="root may write anywhere")
def test_a_folder_that_can_only_be_read_is_bad_input(stepping_plan, tmp_path):
    tmp_path.chmod(0o500)
    with pytest.raises(InputError, match="no permission"):
        export_plan(stepping_plan, "csv", tmp_path / "x.csv")


@pytest.mark.parametrize("rate", [0, -1, 1001])
def test_a_rate_that_cannot_be_is_refused(rate, stepping_plan, tmp_path):
    with pytest.raises(InputError, match="rate: expected 1 to 1000"):
        export_plan(stepping_plan, "tracking", tmp_path / "x", rate=rate)


def test_a_changed_model_is_refused(stepping_plan, tmp_path):
    """The joints' names in the plan are others than in the model that is found."""
    motion = stepping_plan.motion
    names = [tuple(n.replace("waist", "hip") for n in ns) for ns in (motion.position_names, motion.velocity_names)]
    changed = dataclasses.replace(motion, position_names=names[0], velocity_names=names[1])
    with pytest.raises(InputError, match="other joints than the plan"):
        export_plan(dataclasses.replace(stepping_plan, motion=changed), "mujoco", tmp_path / "x.xml")


DOCUMENT = (ROOT / "docs" / "export.md").read_text(encoding="utf-8")
SNIPPETS = dict(re.findall(r"^## (\w+)\n.*?```python\n(.*?)```", DOCUMENT, flags=re.DOTALL | re.MULTILINE))
FILES = {"csv": "plan.csv", "npz": "plan.npz", "tracking": "tracking.csv", "contacts": "contacts.json", "ros": "plan.yaml",
         "mujoco": "plan.xml", "crocoddyl": "solve.py", "mcap": "plan.mcap"}  # fmt: skip


def test_the_document_has_a_way_to_read_every_format():
    assert set(SNIPPETS) == set(FORMATS)
    work = {name: [s for s in ast.parse(code).body if not isinstance(s, ast.Import)] for name, code in SNIPPETS.items()}
    assert all(len(statements) <= 4 for statements in work.values())


@pytest.mark.filterwarnings("ignore::ResourceWarning")  # three lines leave the file to the interpreter
@pytest.mark.parametrize("name", HERE)
def test_what_the_document_says_of_reading_works(name, feet_plan, tmp_path, monkeypatch):
    if name == "mujoco":
        pytest.importorskip("mujoco", reason=export.formats.INSTALL)
    export_plan(feet_plan, name, tmp_path / FILES[name])
    monkeypatch.chdir(tmp_path)
    found: dict[str, object] = {}
    exec(compile(SNIPPETS[name], f"docs/export.md {name}", "exec"), found)
    weight = 9.81 * feet_plan.mass
    checks = {
        "csv": lambda: len(found["height"]) == len(feet_plan.motion),
        "npz": lambda: np.abs(found["weight"] - weight).max() < 1e-6,
        "tracking": lambda: set(found["joints"]) >= {"waist_yaw", "left_knee"},
        "contacts": lambda: found["stances"] == [["left_foot", "right_foot"]],
        "ros": lambda: np.allclose(found["seconds"], feet_plan.motion.t),
        "mujoco": lambda: found["data"].qpos[2] > 0.5,
        "crocoddyl": lambda: found["held"][0].tolist() == ["left_foot", "right_foot"],
        "mcap": lambda: len(list(found["messages"])) == len(feet_plan.motion),
    }
    assert checks[name]()
