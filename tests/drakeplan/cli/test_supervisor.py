"""A watched command ends when it should, also where Python cannot stop it."""

from __future__ import annotations

import ctypes
import json
import os
import signal
import threading
import time
from collections.abc import Callable
from pathlib import Path

import pytest

from drakeplan.cli import supervisor
from drakeplan.cli.supervisor import ABORTED, DEFECT, GRACE, NO_PLAN, supervise

PROMPT = 0.5  # [s] beyond the grace, for a machine that is busy


def deaf() -> None:
    """A call into C that no signal handler of Python can leave."""
    signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})  # so that no signal ends the sleep early
    ctypes.PyDLL(None).sleep(60)  # with the interpreter's lock, as solvers hold it


def send(number: int, *delays: float) -> None:
    """Sends this process a signal after each delay, from another thread."""

    def later() -> None:
        for delay in delays:
            time.sleep(delay)
            os.kill(os.getpid(), number)

    threading.Thread(target=later, daemon=True).start()


def timed(work: Callable[[], int], **options: bool) -> tuple[int, float]:
    began = time.monotonic()
    status = supervise(work, **{"as_json": False, **options})
    return status, time.monotonic() - began


@pytest.mark.parametrize("status", [0, 2, 3, 70])
def test_the_exit_status_of_the_work_is_handed_on(status: int) -> None:
    assert timed(lambda: status)[0] == status


def test_a_deadline_ends_what_python_cannot_stop(capsys: pytest.CaptureFixture[str]) -> None:
    def work() -> int:
        assert supervisor.wire is not None
        supervisor.wire.tell(left=0.3, stage="motion", report={"cost": 1.5})
        deaf()
        return 0

    status, took = timed(work, as_json=True)
    assert status == NO_PLAN and took < 0.3 + GRACE + PROMPT
    said = capsys.readouterr()
    report = json.loads(said.out)
    assert report["status"] == "none" and report["cost"] == 1.5 and "deadline" in report["reason"]
    assert "motion" in said.err


def test_time_that_kernels_compile_does_not_count() -> None:
    def work() -> int:
        assert supervisor.wire is not None
        supervisor.wire.tell(left=0.3)
        supervisor.wire.tell(compiling=True)
        time.sleep(0.3 + GRACE + 0.5)
        supervisor.wire.tell(compiling=False)
        deaf()
        return 0

    status, took = timed(work)
    assert status == NO_PLAN
    assert 2 * (0.3 + GRACE) + 0.5 - 0.1 < took < 2 * (0.3 + GRACE) + 0.5 + PROMPT


def test_one_interrupt_lets_the_work_answer(capsys: pytest.CaptureFixture[str]) -> None:
    def work() -> int:
        try:
            time.sleep(30)
        except KeyboardInterrupt:
            return 3
        return 0

    send(signal.SIGINT, 0.3)
    status, took = timed(work)
    assert status == 3 and took < 0.3 + GRACE + PROMPT and not capsys.readouterr().out


def test_one_interrupt_ends_what_does_not_answer_within_half_a_second() -> None:
    send(signal.SIGINT, 0.3)
    status, took = timed(lambda: deaf() or 0)
    assert status == NO_PLAN and took < 0.3 + GRACE + PROMPT


def test_two_interrupts_end_it_at_once() -> None:
    send(signal.SIGINT, 0.3, 0.1)
    status, took = timed(lambda: deaf() or 0)
    assert status == ABORTED and took < 0.4 + PROMPT


def test_an_answer_that_is_being_written_is_not_cut_off() -> None:
    def work() -> int:
        assert supervisor.wire is not None
        supervisor.wire.tell(left=0.0, answering=True)
        time.sleep(GRACE + 0.5)
        return 0

    assert timed(work)[0] == 0


def test_contacts_put_aside_become_the_file_when_the_work_is_killed(tmp_path: Path) -> None:
    aside, wanted = tmp_path / "plan.h5.partial", tmp_path / "plan.h5"
    aside.write_bytes(b"contacts")

    def work() -> int:
        assert supervisor.wire is not None
        supervisor.wire.tell(left=0.0, kept=[str(aside), str(wanted)])
        deaf()
        return 0

    assert timed(work)[0] == NO_PLAN
    assert wanted.read_bytes() == b"contacts" and not aside.exists()


def test_what_the_work_started_ends_with_it(tmp_path: Path) -> None:
    number = tmp_path / "pid"

    def work() -> int:
        assert supervisor.wire is not None
        grandchild = os.fork()
        if grandchild == 0:
            time.sleep(60)
            os._exit(0)
        number.write_text(str(grandchild))
        supervisor.wire.tell(left=0.0)
        deaf()
        return 0

    assert timed(work)[0] == NO_PLAN
    ended = time.monotonic() + 2.0
    stat = Path(f"/proc/{number.read_text()}/stat")
    while stat.exists() and stat.read_text().rpartition(")")[2].split()[0] != "Z" and time.monotonic() < ended:
        time.sleep(0.02)
    assert not stat.exists() or stat.read_text().rpartition(")")[2].split()[0] == "Z"


def test_a_crash_in_a_library_is_a_defect_and_says_which_signal(capsys: pytest.CaptureFixture[str]) -> None:
    status, _ = timed(lambda: os.kill(os.getpid(), signal.SIGKILL) or 0)
    assert status == DEFECT and "signal 9" in capsys.readouterr().err
