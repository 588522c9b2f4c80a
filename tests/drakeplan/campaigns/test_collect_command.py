"""`drakeplan collect` refuses nonsense in one line, collects, goes on, and says what it has."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from drakeplan.campaigns.dynamics import DynamicsCampaign
from drakeplan.campaigns.label_walk import WalkOptions
from drakeplan.cli import main


@pytest.mark.parametrize(
    ("words", "complaint"),
    [
        ("collect", "CAMPAIGN is missing"),
        ("collect dynamic --count 1 --out x", "did you mean dynamics"),
        ("collect dynamics --out x", "--count: expected 1 or more"),
        ("collect dynamics --count 1", "--out: expected a folder"),
        ("collect dynamics --count 1 --out x --workers 0", "--workers: expected 1 or more"),
        ("collect dynamics --count 1 --out x --seed -2", "--seed: expected 0 or more"),
        ("collect dynamics --count 1 --out x --friction 0", "--friction: expected more than 0"),
        ("collect dynamics --count 1 --out x --task-timeout 0", "--task-timeout: expected more than 0"),
        ("collect dynamics --count 1 --out x --robot eschr", "did you mean escher"),
        ("collect dynamics --count 1 --out /dev/null/labels", "cannot be made a folder"),
        ("collect dynamics --count 1 --out x --cluster tcp://127.0.0.1:9", "no dask scheduler answers"),
    ],
)
def test_a_mistake_gets_one_line_and_exit_2(
    words: str, complaint: str, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    if "--cluster" in words:
        pytest.importorskip("distributed")
        monkeypatch.setattr("drakeplan.campaigns.cluster.CONNECT_TIMEOUT", 0.3)
    monkeypatch.chdir(tmp_path)
    assert main(words.split()) == 2
    said = capsys.readouterr()
    assert said.out == ""
    lines = [line for line in said.err.replace("\r", "\n").splitlines() if "env/s" not in line and line.strip()]
    assert len(lines) == 1 and complaint in lines[0]


@pytest.mark.slow
def test_it_collects_goes_on_and_describes_what_it_has(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    few = DynamicsCampaign(walk=WalkOptions(quota=1, max_states=6))
    monkeypatch.setattr("drakeplan.cli.collect._campaign", lambda arguments: few)
    out = str(tmp_path / "labels")
    assert main(["collect", "dynamics", "--count", "1", "--out", out, "--workers", "1"]) == 0
    said = capsys.readouterr()
    assert "labels of 1 environments" in said.out and "feet only: move a foot" in said.out
    assert "1/1" in said.err  # the bar
    assert main(["collect", "dynamics", "--count", "2", "--out", out]) == 2
    assert "--resume" in capsys.readouterr().err
    assert main(["collect", "dynamics", "--count", "2", "--out", out, "--resume", "--seed", "1"]) == 2
    assert "made with seed 0, expected 1" in capsys.readouterr().err
    assert main(["collect", "dynamics", "--count", "2", "--out", out, "--resume", "--json"]) == 0
    card = json.loads(capsys.readouterr().out)
    assert card["status"] == "collected" and card["tasks"] == 2
    assert {k: v for k, v in json.loads((tmp_path / "labels" / "card.json").read_text()).items()} == {
        k: v for k, v in card.items() if k not in ("status", "folder")
    }


@pytest.mark.slow
def test_ctrl_c_stops_it_at_once_and_says_how_to_go_on(tmp_path: Path) -> None:
    command = [sys.executable, "-m", "drakeplan", "collect", "dynamics", "--count", "500", "--out", str(tmp_path / "x")]
    process = subprocess.Popen(command, stderr=subprocess.PIPE, stdout=subprocess.PIPE, start_new_session=True)
    deadline = time.monotonic() + 60
    while not (tmp_path / "x" / "sessions.jsonl").exists() and time.monotonic() < deadline:
        time.sleep(0.1)
    os.killpg(process.pid, signal.SIGINT)
    _, said = process.communicate(timeout=120)  # workers may be loading kernels
    assert process.returncode == 130
    assert "--resume goes on" in said.decode()
    assert "Traceback" not in said.decode()
