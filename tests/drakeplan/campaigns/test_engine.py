"""A campaign gives the same files whoever runs it, however often it is killed, and whatever single tasks do."""

from __future__ import annotations

import dataclasses
import errno
import fcntl
import json
import os
import random
import signal
import subprocess
import sys
import threading
import time
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from toy_campaign import SCHEMA, Toy

from drakeplan.campaigns.campaign import BadRowsError, Campaign, Task, rows_table, run_task
from drakeplan.campaigns.engine import CampaignProgress, CollectOptions, collect
from drakeplan.campaigns.workers import LocalWorkers, Outcome, without_ctrl_c
from learning.shard_file import read_shard, shard_paths
from scenes.input_error import InputError

TOY = Path(__file__).with_name("toy_campaign.py")


class HereWorkers:
    """Runs tasks in this process, newest first, so that shards end in no order."""

    num_workers = 3

    def __init__(self, campaign: Campaign) -> None:
        self.campaign, self.waiting = campaign, []

    def submit(self, task: Task) -> None:
        self.waiting.append(task)

    def next_outcome(self, timeout: float) -> Outcome:
        task = self.waiting.pop()
        return Outcome(task, run_task(self.campaign, task))

    def close(self) -> None:
        pass


def files(folder: Path) -> dict[str, bytes]:
    """Everything but the lock and the code that was used, which may change while this test runs."""
    found = {p.name: p.read_bytes() for p in sorted(folder.iterdir()) if p.name not in (".lock", "sessions.jsonl")}
    if "card.json" in found:
        found["card.json"] = json.dumps(json.loads(found["card.json"]) | {"code": None}).encode()
    return found


def reference(folder: Path, tasks: int, campaign: Toy | None = None) -> dict[str, bytes]:
    """The files of an uninterrupted campaign."""
    campaign = campaign or Toy()
    collect(campaign, folder, CollectOptions(tasks, 7, 4), HereWorkers(campaign))
    return files(folder)


# ---- the data


def test_rows_are_those_of_the_function_called_by_hand(tmp_path: Path) -> None:
    card = collect(Toy(), tmp_path, CollectOptions(10, 7, 4), HereWorkers(Toy()))
    expected = [
        row
        for n in range(10)
        for row in Toy().rows(np.random.SeedSequence(7, spawn_key=(n // 4, n % 4)), n)
    ]  # fmt: skip
    table = pa.concat_tables([read_shard(path)[1] for path in shard_paths(tmp_path).values()])
    assert card.rows == len(expected) == len(table)
    for column in SCHEMA.names:
        got = table[column].to_pylist()
        assert got == [list(row[column]) if column == "numbers" else row[column] for row in expected]
    assert sum(entry["rows"] for entry in card.counts) == card.rows
    assert {entry["kind"] for entry in card.counts} == {"high", "low"}


def test_processes_write_the_same_bytes_as_one_loop(tmp_path: Path) -> None:
    expected = reference(tmp_path / "a", 18)
    with LocalWorkers(Toy(), 2) as workers:
        collect(Toy(), tmp_path / "b", CollectOptions(18, 7, 4), workers)
    assert files(tmp_path / "b") == expected


def test_another_seed_gives_other_rows(tmp_path: Path) -> None:
    ours = collect(Toy(), tmp_path / "a", CollectOptions(4, 7, 4), HereWorkers(Toy()))
    theirs = collect(Toy(), tmp_path / "b", CollectOptions(4, 8, 4), HereWorkers(Toy()))
    assert ours.sha256 != theirs.sha256


def test_the_card_names_seeds_counts_hashes_and_code_and_no_times(tmp_path: Path) -> None:
    collect(Toy(), tmp_path, CollectOptions(5, 7, 4), HereWorkers(Toy()))
    card = json.loads((tmp_path / "card.json").read_text())
    assert (card["campaign"], card["version"], card["seed"], card["tasks"]) == ("toy", 1, 7, 5)
    assert [s["file"] for s in card["shards"]] == ["shard-000000.parquet", "shard-000001.parquet"]
    assert all(len(s["sha256"]) == 64 for s in card["shards"])
    (code,) = card["code"]
    assert {"drakeplan", "sources_sha256", "drake", "pyarrow"} <= code.keys()


def test_data_made_by_two_versions_of_the_code_say_so(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    told: list[CampaignProgress] = []
    for code in ("old", "old", "new"):
        monkeypatch.setattr("drakeplan.campaigns.engine.session_facts", lambda code=code: {"drakeplan": code})
        tasks = 4 if code == "old" else 8
        options = CollectOptions(tasks, 7, 4)
        card = collect(Toy(), tmp_path, options, HereWorkers(Toy()), resume=True, listener=told.append)
        assert any("the code has changed" in p.message for p in told) == (code == "new")
    assert card.code == ({"drakeplan": "old"}, {"drakeplan": "new"})


@pytest.mark.parametrize(
    ("change", "complaint"),
    [
        ({"kind": None}, "column kind is null"),
        ({"numbers": [1.0, np.nan, 2.0]}, "column numbers holds a number that is not finite"),
        ({"mean": np.inf}, "column mean holds a number that is not finite"),
        ({"numbers": [1.0, 2.0]}, "column numbers:"),
        ({"scene": "first"}, "column scene:"),
        ({"colour": "red"}, "column colour is not in the schema"),
    ],
)
def test_rows_that_do_not_fit_the_schema_are_refused(change: dict[str, object], complaint: str) -> None:
    row = {"scene": 0, "kind": "low", "numbers": [1.0, 2.0, 3.0], "mean": None}
    assert rows_table(SCHEMA, [row]).num_rows == 1
    with pytest.raises(BadRowsError, match=complaint):
        rows_table(SCHEMA, [row, row | change])


# ---- stopping and going on


@pytest.mark.slow
def test_killed_at_random_moments_and_resumed_the_data_are_bit_identical(tmp_path: Path) -> None:
    campaign, tasks = Toy(pause=0.05), 60
    expected = reference(tmp_path / "whole", tasks)
    folder = tmp_path / "killed"
    command = [sys.executable, str(TOY), str(folder), str(tasks), str(campaign.pause)]
    rng, kills = random.Random(3), 0
    for _ in range(4):
        process = subprocess.Popen(command, start_new_session=True, stderr=subprocess.DEVNULL)
        wanted = len(shard_paths(folder)) + 1 if folder.is_dir() else 1
        deadline = time.monotonic() + 60
        while process.poll() is None and time.monotonic() < deadline:
            if folder.is_dir() and len(shard_paths(folder)) >= wanted:
                break
            time.sleep(0.005)
        time.sleep(rng.uniform(0.0, 0.2))
        if process.poll() is not None:
            break
        process.send_signal(signal.SIGKILL)  # the parent alone: workers must notice by themselves
        process.wait()
        kills += 1
        names = {p.name for p in folder.iterdir()}
        assert names <= set(expected) | {".lock", "sessions.jsonl"}, "something half-written was left"
        assert all(path.read_bytes() == expected[path.name] for path in shard_paths(folder).values())
    assert kills >= 2
    subprocess.run(command, check=True, timeout=120)
    assert files(folder) == expected


@pytest.mark.skipif(not Path("/proc/self/stat").exists(), reason="reads /proc")
def test_workers_die_with_the_process_that_is_killed(tmp_path: Path) -> None:
    process = subprocess.Popen([sys.executable, str(TOY), str(tmp_path), "100000", "0.01"])
    deadline = time.monotonic() + 30
    while not shard_paths(tmp_path) and time.monotonic() < deadline:
        time.sleep(0.05)
    children = [int(p.name) for p in Path("/proc").glob("[0-9]*") if _parent(int(p.name)) == process.pid]
    assert len(children) >= 2
    process.kill()
    process.wait()
    deadline = time.monotonic() + 20
    while any(map(_alive, children)) and time.monotonic() < deadline:
        time.sleep(0.05)
    assert not [pid for pid in children if _alive(pid)]


def _alive(pid: int) -> bool:
    return (_stat(pid) or ["Z"])[0] != "Z"


def _parent(pid: int) -> int:
    return int((_stat(pid) or ["Z", "-1"])[1])


def _stat(pid: int) -> list[str]:
    """State, parent and so on of a process; empty where there is none."""
    try:
        return Path(f"/proc/{pid}/stat").read_text().rsplit(")", 1)[1].split()
    except (FileNotFoundError, ProcessLookupError):
        return []


def test_more_tasks_can_be_asked_for_later(tmp_path: Path) -> None:
    expected = reference(tmp_path / "whole", 14)
    collect(Toy(), tmp_path / "grown", CollectOptions(6, 7, 4), HereWorkers(Toy()))
    collect(Toy(), tmp_path / "grown", CollectOptions(14, 7, 4), HereWorkers(Toy()), resume=True)
    assert files(tmp_path / "grown") == expected
    with pytest.raises(InputError, match="holds more than 6 tasks already"):
        collect(Toy(), tmp_path / "grown", CollectOptions(6, 7, 4), HereWorkers(Toy()), resume=True)


def test_a_finished_campaign_runs_nothing_when_it_is_resumed(tmp_path: Path) -> None:
    expected = reference(tmp_path, 8)
    idle = HereWorkers(Toy())
    idle.submit = lambda task: pytest.fail("a task ran again")
    collect(Toy(), tmp_path, CollectOptions(8, 7, 4), idle, resume=True)
    assert files(tmp_path) == expected


@pytest.mark.parametrize("damage", ["truncated", "garbage", "missing"])
def test_a_damaged_shard_is_made_again(damage: str, tmp_path: Path) -> None:
    expected = reference(tmp_path, 12)
    path = tmp_path / "shard-000001.parquet"
    if damage == "missing":
        path.unlink()
    else:
        path.write_bytes(path.read_bytes()[:-40] if damage == "truncated" else b"PAR1" * 100)
    told: list[CampaignProgress] = []
    collect(Toy(), tmp_path, CollectOptions(12, 7, 4), HereWorkers(Toy()), resume=True, listener=told.append)
    assert files(tmp_path) == expected
    assert any("made again" in p.message for p in told) == (damage != "missing")


WIDER_SCHEMA = SCHEMA.append(pa.field("more", pa.int8()))


@dataclasses.dataclass(frozen=True)
class Wider(Toy):
    schema: pa.Schema = WIDER_SCHEMA


@pytest.mark.parametrize(
    ("campaign", "seed", "complaint"),
    [
        (Toy(version=2), 7, "cannot be resumed, it was made with version 1, expected 2"),
        (Toy(), 8, "made with seed 7, expected 8"),
        (Toy(scale=2.0), 7, "made with scale 1.0, expected 2.0"),
        (Toy(name="toad"), 7, "made with campaign 'toy', expected 'toad'"),
        (Wider(), 7, "made with another schema"),
    ],
)
def test_a_campaign_is_not_resumed_as_another(campaign: Toy, seed: int, complaint: str, tmp_path: Path) -> None:
    expected = reference(tmp_path, 4)
    with pytest.raises(InputError, match=complaint) as error:
        collect(campaign, tmp_path, CollectOptions(8, seed, 4), HereWorkers(campaign), resume=True)
    assert "\n" not in str(error.value)
    assert files(tmp_path) == expected


def test_a_folder_that_holds_data_is_not_touched_without_resume(tmp_path: Path) -> None:
    expected = reference(tmp_path, 4)
    with pytest.raises(InputError, match="go on with --resume"):
        collect(Toy(), tmp_path, CollectOptions(4, 7, 4), HereWorkers(Toy()))
    (tmp_path / "campaign.json").unlink()
    with pytest.raises(InputError, match="holds shards without campaign"):
        collect(Toy(), tmp_path, CollectOptions(4, 7, 4), HereWorkers(Toy()), resume=True)
    del expected["campaign.json"]
    assert files(tmp_path) == expected


def test_a_shard_from_another_campaign_is_not_taken_for_ours(tmp_path: Path) -> None:
    reference(tmp_path / "theirs", 4, Toy(scale=3.0))
    reference(tmp_path / "ours", 4)
    os.replace(tmp_path / "theirs" / "shard-000000.parquet", tmp_path / "ours" / "shard-000000.parquet")
    with pytest.raises(InputError, match="comes from another campaign"):
        collect(Toy(), tmp_path / "ours", CollectOptions(8, 7, 4), HereWorkers(Toy()), resume=True)


def test_two_processes_do_not_collect_into_one_folder(tmp_path: Path) -> None:
    with (tmp_path / ".lock").open("w") as file:
        fcntl.flock(file, fcntl.LOCK_EX)
        with pytest.raises(InputError, match="another process is collecting"):
            collect(Toy(), tmp_path, CollectOptions(4, 7, 4), HereWorkers(Toy()))


def test_a_full_disk_stops_in_one_line_and_leaves_whole_shards(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:  # fmt: skip
    expected = reference(tmp_path / "whole", 16)
    folder = tmp_path / "full"
    collect(Toy(), folder, CollectOptions(4, 7, 4), HereWorkers(Toy()))
    fsync = os.fsync

    def full(descriptor: int) -> None:
        if os.fstat(descriptor).st_size > 1000:  # a shard, not a line in the list of sessions
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        fsync(descriptor)

    with monkeypatch.context() as patch:
        patch.setattr(os, "fsync", full)
        with pytest.raises(InputError, match=r"No space left on device\).*--resume goes on") as error:
            collect(Toy(), folder, CollectOptions(16, 7, 4), HereWorkers(Toy()), resume=True)
    assert "\n" not in str(error.value)
    left = files(folder)
    assert left.keys() == {"campaign.json", "card.json", "shard-000000.parquet"}
    assert left["shard-000000.parquet"] == expected["shard-000000.parquet"]
    collect(Toy(), folder, CollectOptions(16, 7, 4), HereWorkers(Toy()), resume=True)
    assert files(folder) == expected


# ---- tasks that misbehave


@pytest.mark.slow
def test_tasks_that_crash_hang_or_lie_are_quarantined_and_cost_nobody_else_anything(tmp_path: Path) -> None:
    expected = reference(tmp_path / "well", 24)
    mischief = {1: "raise", 2: "crash", 4: "hang", 7: "exit", 9: "eat", 12: "nan", 14: "forget", 21: "crash"}
    campaign, folder = Toy(mischief=mischief), tmp_path / "ill"
    told: list[CampaignProgress] = []
    with LocalWorkers(campaign, 2, task_timeout=1.5) as workers:
        card = collect(campaign, folder, CollectOptions(24, 7, 4), workers, listener=told.append)
    reasons = {q["task"]: q["reason"] for q in card.quarantined}
    assert reasons.keys() == mischief.keys()
    assert reasons[1] == "ArithmeticError: no answer to this"
    assert reasons[2] == "its process died (exit code -11)"
    assert reasons[4] == "no answer within 1.5 s"
    assert reasons[7] == "its process died (exit code 3)"
    assert reasons[9].startswith("MemoryError")
    assert reasons[12] == "BadRowsError: column numbers holds a number that is not finite"
    assert [q["spawn_key"] for q in card.quarantined if q["task"] == 9] == [[2, 1]]
    assert told[-1].failed == len(mischief) and told[-1].tasks == 24
    for path in shard_paths(folder).values():
        table = read_shard(path)[1]
        well = pq.read_table(pa.BufferReader(expected[path.name]))
        kept = well.filter(pa.array([s not in mischief for s in well["scene"].to_pylist()]))
        assert table.to_pylist() == kept.to_pylist()


def test_where_no_task_succeeds_the_campaign_is_given_up(tmp_path: Path) -> None:
    campaign = Toy(mischief=dict.fromkeys(range(1000), "raise"))
    with (
        LocalWorkers(campaign, 1) as workers,
        pytest.raises(InputError, match="no task succeeds; the last: ArithmeticError: no answer"),
    ):
        collect(campaign, tmp_path, CollectOptions(1000, 7, 4), workers)
    assert len(shard_paths(tmp_path)) <= 2  # of 250


def test_a_script_that_workers_cannot_load_is_told_so_and_no_task_is_blamed(tmp_path: Path) -> None:
    code = f"import sys; sys.path.insert(0, {str(TOY.parent)!r}); import toy_campaign as t; t.main({str(tmp_path / 'x')!r}, 9, 0.0)"
    done = subprocess.run([sys.executable, "-"], input=code, capture_output=True, text=True, timeout=60, check=False)
    assert done.stderr.splitlines()[-1].startswith("scenes.input_error.InputError: workers cannot start")
    assert not shard_paths(tmp_path / "x")


def test_progress_counts_to_the_end_and_estimates_what_remains(tmp_path: Path) -> None:
    told: list[CampaignProgress] = []
    card = collect(Toy(), tmp_path, CollectOptions(10, 7, 4), HereWorkers(Toy()), listener=told.append)
    assert [p.tasks for p in told] == list(range(11))
    assert told[-1].rows == card.rows and told[-1].remaining == 0.0
    assert all(p.all_tasks == 10 and p.failed == 0 for p in told)
    assert told[0].remaining is None and all(p.remaining is not None and p.rate > 0 for p in told[1:])


def test_libraries_in_workers_use_one_thread(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("OMP_NUM_THREADS", "8")
    with LocalWorkers(Toy(), 1):
        assert os.environ["OMP_NUM_THREADS"] == os.environ["OPENBLAS_NUM_THREADS"] == "1"
    assert os.environ["OMP_NUM_THREADS"] == "8"


@pytest.mark.parametrize(("name", "value"), [("tasks", 0), ("seed", -1), ("tasks_per_shard", 0)])
def test_options_that_make_no_sense_are_refused(name: str, value: int) -> None:
    with pytest.raises(InputError, match=f"{name}: expected"):
        CollectOptions(**({"tasks": 1} | {name: value}))


def test_ctrl_c_waits_until_the_processes_have_started_whichever_thread_receives_it() -> None:
    before = signal.signal(
        signal.SIGINT, signal.default_int_handler
    )  # a shell starts what runs behind it deaf to Ctrl-C
    began, ended, release = threading.Event(), [], threading.Event()
    other = threading.Thread(target=lambda: (began.set(), release.wait()), daemon=True)
    other.start()  # does not block the signal, so that the kernel delivers it there
    began.wait()

    def start_something() -> None:
        with without_ctrl_c():
            os.kill(os.getpid(), signal.SIGINT)
            time.sleep(0.05)
            ended.append("started")

    try:
        with pytest.raises(KeyboardInterrupt):
            start_something()
    finally:
        signal.signal(signal.SIGINT, before)
    release.set()
    assert ended == ["started"]
