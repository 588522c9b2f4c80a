"""The capture benchmark: what its tables and its picture say of the answers."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from drakeplan.bench import capture, capture_rose
from drakeplan.bench.table import BenchOptions
from optimization.capture.checker import CaptureChecker
from optimization.capture.sampling import CAPTURE_MOTIONS
from scenes.robots.robot import load_robot


@pytest.fixture(scope="module")
def checker() -> CaptureChecker:
    return CaptureChecker(load_robot("escher"))


def test_the_tables_count_every_question_once(
    checker: CaptureChecker, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    drawn: list[Path] = []
    monkeypatch.setattr(capture, "draw_rose", lambda checker, tell: drawn.append(tmp_path))
    acceptance, pendulum = capture.run(BenchOptions(seeds=2))
    assert [row[0] for row in acceptance.rows] == [*CAPTURE_MOTIONS, "all"]
    assert [row[1] for row in acceptance.rows] == [2, 2, 2, 2, 8]
    assert acceptance.rows[-1][2] == sum(row[2] for row in acceptance.rows[:-1])  # type: ignore[misc]
    for row in (*acceptance.rows, *pendulum.rows):
        assert len(row) == len((acceptance if row in acceptance.rows else pendulum).columns)
    for row in pendulum.rows:
        cells = [str(cell).split(" of ") for cell in row[2:9]]
        assert sum(int(total) for _, total in cells) == row[1] == 4
    assert "0 accepted beyond the allowance" in " ".join(pendulum.notes)
    assert len(drawn) == 1


@pytest.mark.parametrize(
    ("reason", "block"),
    [
        ("standing, 0.10 s: angular momentum rate limit exceeded by 3 N m", "angular momentum rate limit"),
        ("swing of left_foot, 0.20 s: speed of right_knee at 1.10 of its limit", "speed"),
        ("after contact of left_foot, 0.20 s: CoM of motion and forces differ by 12 mm rms", "CoM"),
        ("start: CoM off by 0.3 m: no posture", "CoM"),
        ("standing, 1.00 s: friction cone of left_foot cannot be met at knot 10 (1.00 s)", "friction cone"),
        ("standing, 1.00 s: motion comes nowhere near the forces: contact of left_foot off by 9 mm", "motion"),
    ],
)
def test_reasons_are_counted_by_their_block(reason: str, block: str) -> None:
    assert capture.block_of(reason) == block


def test_the_picture_of_pushes_is_the_same_on_both_sides(
    checker: CaptureChecker, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setattr(capture_rose, "DIRECTIONS", 4)
    monkeypatch.setattr(capture_rose, "SPEEDS", np.array([0.15, 0.8]))
    verdict = capture_rose.draw_rose(checker, lambda line: None, tmp_path / "rose.png")
    mirrored = verdict[[0, 3, 2, 1]]
    np.testing.assert_array_equal(verdict, mirrored)
    assert (verdict[:, 0] == 0).all()  # a gentle push needs no step
    assert (verdict[:, 1] > 0).all()  # a strong one does
    assert (verdict[:, 1] == 1).any()
    assert (tmp_path / "rose.png").stat().st_size > 10_000


def test_footholds_lie_on_their_own_side_and_within_reach(checker: CaptureChecker) -> None:
    base = capture_rose.standing(checker.robot)
    for angle in np.linspace(0, 2 * np.pi, 12, endpoint=False):
        pushed = base.pushed(60.0 * np.array([np.cos(angle), np.sin(angle), 0.0]))
        footholds = list(capture_rose.footholds(pushed, checker.robot))
        assert footholds
        for foothold in footholds:
            left = foothold.effector == "left_foot"
            other = base.stance.contacts[1 if left else 0]
            assert other is not None
            apart = (foothold.p_WC - other.p_WC)[1] * (1.0 if left else -1.0)
            assert checker.robot.foot_separation[0] - 1e-9 <= apart <= capture_rose.WIDEST + 1e-9
