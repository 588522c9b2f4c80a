"""Progress: one line on a terminal, few lines in a file."""

from __future__ import annotations

import io

import pytest

from drakeplan import progress as module
from drakeplan.progress import ProgressEvent, ProgressPrinter


class Terminal(io.StringIO):
    def isatty(self) -> bool:
        return True


def falling_costs(printer: ProgressPrinter, count: int = 60) -> None:
    for k in range(count):
        printer(ProgressEvent("search", cost=100.0 - k, expansions=k))


def test_a_terminal_shows_one_line_that_is_written_over() -> None:
    stream = Terminal()
    with ProgressPrinter(stream) as printer:
        falling_costs(printer)
        printer(ProgressEvent("motion", "8.0 s at 50 Hz"))
    shown = stream.getvalue()
    assert shown.count("\n") == 1 and shown.endswith("\n")
    assert shown.count("\r") == 61
    assert "8.0 s at 50 Hz" in shown.rpartition("\r")[2]


def test_a_line_is_cut_to_the_terminals_width(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("COLUMNS", "40")
    stream = Terminal()
    with ProgressPrinter(stream) as printer:
        printer(ProgressEvent("search", "x" * 200))
    line = stream.getvalue().strip().removesuffix(module.CLEAR_TO_END)
    assert len(line) == 39


def test_a_file_gets_a_line_for_each_stage_and_message_but_not_for_each_cost() -> None:
    stream = io.StringIO()
    with ProgressPrinter(stream) as printer:
        falling_costs(printer)
        printer(ProgressEvent("verify", "", 40.0))
        printer(ProgressEvent("search", "verification failed: goal; searching again"))
    lines = stream.getvalue().splitlines()
    assert len(lines) == 3
    assert "verification failed: goal" in lines[2]
    assert "\r" not in stream.getvalue()


def test_a_lower_cost_is_told_again_after_a_while(monkeypatch: pytest.MonkeyPatch) -> None:
    clock = iter([0.0, 1.0, 2.0, 3.5])
    monkeypatch.setattr(module.time, "monotonic", lambda: next(clock))
    stream = io.StringIO()
    printer = ProgressPrinter(stream)
    for cost in (9.0, 8.0, 7.0):
        printer(ProgressEvent("search", cost=cost))
    told = [line for line in stream.getvalue().splitlines() if "cost" in line]
    assert ["cost 9.000" in told[0], "cost 7.000" in told[1]] == [True, True] and len(told) == 2
