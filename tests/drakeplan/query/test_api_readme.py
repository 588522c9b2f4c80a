"""The lines of Python in the README run as they stand."""

from __future__ import annotations

import warnings
from pathlib import Path

import pytest

from drakeplan.plan.plan_file import read_plan

README = Path(__file__).resolve().parents[3] / "README.md"
MOST = 15  # lines of code, as their heading says


@pytest.mark.slow
def test_the_fifteen_lines_plan_verify_and_write(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    text = README.read_text(encoding="utf-8")
    code = text.partition("## Fifteen lines")[2].partition("```python\n")[2].partition("```")[0]
    assert 5 < len([line for line in code.splitlines() if line.strip()]) <= MOST
    monkeypatch.chdir(tmp_path)
    with warnings.catch_warnings():
        warnings.simplefilter("error", DeprecationWarning)
        exec(compile(code, str(README), "exec"), {"__name__": "__main__"})
    out = capsys.readouterr().out
    assert out.startswith("complete") and "the plan holds" in out
    assert read_plan("plan.h5").status == "complete"
    assert (tmp_path / "plan.html").stat().st_size > 1000
