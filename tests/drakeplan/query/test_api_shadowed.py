"""A file or folder beside a user's script that has the name of one of our packages is named, with what to do."""

from __future__ import annotations

import subprocess
import sys
import time
from pathlib import Path

import pytest

from drakeplan.shadowed import BESIDE, refuse_shadows

MOST = 0.005  # [s] that the look may take


def run(script: Path) -> subprocess.CompletedProcess[str]:
    return subprocess.run([sys.executable, str(script)], capture_output=True, text=True, timeout=60, check=False)


def test_a_file_and_a_folder_are_named_in_one_line_and_renamed_they_do_no_harm(tmp_path: Path) -> None:
    folder = tmp_path / "Übung 1"
    folder.mkdir()
    script = folder / "run.py"
    script.write_text("import drakeplan\nprint(drakeplan.PlanOptions().seed)\n")
    own = folder / "optimization.py"
    own.write_text("GAIN = 1\n")
    done = run(script)
    assert done.returncode == 1
    last = done.stderr.strip().splitlines()[-1]
    assert last.startswith(f"ImportError: drakeplan: {own} shadows its package 'optimization': rename that file")
    own.rename(folder / "my_optimization.py")
    own_package = folder / "scenes"
    own_package.mkdir()
    (own_package / "__init__.py").touch()
    script.write_text("import scenes\nimport drakeplan\n")  # even where it has been imported before
    last = run(script).stderr.strip().splitlines()[-1]
    assert last.startswith(f"ImportError: drakeplan: {own_package} shadows its package 'scenes': rename that folder")
    (own_package / "__init__.py").unlink()
    own_package.rename(folder / "my_scenes")
    script.write_text("import drakeplan\nprint(drakeplan.InputError.__name__)\n")
    done = run(script)
    assert (done.returncode, done.stdout, done.stderr) == (0, "InputError\n", "")


def test_the_look_costs_less_than_five_milliseconds(monkeypatch: pytest.MonkeyPatch) -> None:
    for name in BESIDE:  # as at the first import
        monkeypatch.delitem(sys.modules, name, raising=False)
    took = []
    for _ in range(20):
        began = time.perf_counter()
        refuse_shadows()
        took.append(time.perf_counter() - began)
    assert min(took) < MOST
    assert not set(BESIDE) & set(sys.modules)  # nothing was imported
