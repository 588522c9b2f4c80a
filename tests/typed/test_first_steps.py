"""What is used from outside has types that a strict checker accepts, and that refuse mistakes."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

HERE = Path(__file__).parent
ROOT = HERE.parents[1]
MISTAKES = """\
import drakeplan

drakeplan.plan_scen("flat")
drakeplan.plan_scene(3)
drakeplan.plan_scene("flat").plan.t
drakeplan.plan_scene("flat", "escher", drakeplan.PlanOptions(seeds=1))
drakeplan.verify(drakeplan.plan_scene("flat"))
drakeplan.plan_motion("flat", "escher", [{"left_foot": 3}])
"""


@pytest.mark.slow
def test_the_first_steps_and_the_readme_are_typed_and_each_mistake_is_found(tmp_path: Path) -> None:
    """In a folder of its own, so that no setting of this repository helps."""
    pyright = shutil.which("pyright", path=os.pathsep.join([str(Path(sys.executable).parent), os.environ["PATH"]]))
    if pyright is None:
        pytest.skip("pyright is not installed")
    shutil.copy(HERE / "first_steps.py", tmp_path)
    (tmp_path / "mistakes.py").write_text(MISTAKES)
    readme = (ROOT / "README.md").read_text(encoding="utf-8")
    (tmp_path / "readme.py").write_text(readme.partition("```python\n")[2].partition("```")[0])
    done = subprocess.run(
        [pyright, "--outputjson", "--pythonpath", sys.executable, "first_steps.py", "readme.py", "mistakes.py"],
        cwd=tmp_path,
        env={**os.environ, "PYTHONPATH": str(ROOT)},
        capture_output=True,
        text=True,
        timeout=120,
        check=False,
    )
    found = [
        (Path(d["file"]).name, d["range"]["start"]["line"] + 1, d["message"])
        for d in json.loads(done.stdout)["generalDiagnostics"]
        if d["severity"] == "error"
    ]
    assert [one for one in found if one[0] != "mistakes.py"] == []
    lines = {line for name, line, _ in found if name == "mistakes.py"}
    assert lines == {n for n, text in enumerate(MISTAKES.splitlines(), 1) if text.startswith("drakeplan.")}
