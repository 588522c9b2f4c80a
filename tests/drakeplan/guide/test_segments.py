"""Segments of a guiding path: the best cut of all cuts, easy and hard stretches, changes of mode."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from drakeplan.guide.guiding_path import GuidingPath
from drakeplan.guide.segments import HARD, SHORTEST, Segment, cut, method_of, segments

SAME = 1e-9  # values of cuts that differ by less are equal

hardnesses = st.lists(st.integers(0, 20).map(lambda k: k / 20), min_size=1, max_size=14)


def value(hardness: list[float], starts: list[int], threshold: float) -> float:
    """What Lin 2020 eq. 5.9 gives for a cut."""
    ends = [*starts[1:], len(hardness)]
    return sum(abs(sum(h - threshold for h in hardness[a:b])) for a, b in zip(starts, ends, strict=True))


def all_cuts(n: int, shortest: int) -> list[list[int]]:
    """All partitions of n steps into segments that are long enough: every subset of the n - 1 joints is looked at."""
    found = []
    for chosen in itertools.product((False, True), repeat=n - 1):
        starts = [0, *(k + 1 for k, here in enumerate(chosen) if here)]
        if min(np.diff([*starts, n])) >= shortest:
            found.append(starts)
    return found


@settings(max_examples=60)
@given(hardness=hardnesses, threshold=st.sampled_from([0.3, 0.5, 0.05]), shortest=st.integers(1, 5))
def test_the_cut_is_the_best_of_all_and_of_equals_one_with_fewest_segments(
    hardness: list[float], threshold: float, shortest: int
) -> None:
    starts = cut(hardness, threshold, shortest)
    n = len(hardness)
    if n < 2 * shortest:
        assert starts == [0]
        return
    every = [(value(hardness, other, threshold), other) for other in all_cuts(n, shortest)]
    best = max(worth for worth, _ in every)
    assert min(np.diff([*starts, n])) >= shortest
    assert value(hardness, starts, threshold) == pytest.approx(best, abs=SAME)
    assert len(starts) == min(len(other) for worth, other in every if worth > best - SAME)


@given(hardness=hardnesses)
def test_a_piece_shorter_than_two_segments_stays_whole(hardness: list[float]) -> None:
    assert cut(hardness[: 2 * SHORTEST - 1]) == [0]


def test_an_easy_stretch_and_a_hard_one_are_parted_where_they_meet() -> None:
    for easy, hard in ((5, 5), (9, 6), (20, 30)):
        assert cut([0.0] * easy + [1.0] * hard) == [0, easy]
        assert cut([1.0] * hard + [0.0] * easy) == [0, hard]
    assert cut([0.0] * 40) == [0] and cut([1.0] * 40) == [0]


def test_a_hard_stretch_too_short_for_a_segment_takes_steps_from_beside_it() -> None:
    starts = cut([0.0] * 10 + [1.0] * 2 + [0.0] * 10)
    assert min(np.diff([*starts, 22])) >= SHORTEST


def path_of(modes: list[int], hardness: list[float]) -> GuidingPath:
    poses = np.zeros((len(modes) + 1, 4))
    poses[:, 0] = 0.1 * np.arange(len(poses))
    return GuidingPath(poses, np.array(modes, int), np.array(hardness, float), 1.0)


@given(st.lists(st.tuples(st.integers(0, 3), st.integers(1, 14)), min_size=1, max_size=5), st.integers(0, 99))
def test_segments_follow_one_another_and_have_one_mode_each(runs: list[tuple[int, int]], seed: int) -> None:
    modes = [mode for mode, length in runs for _ in range(length)]
    hardness = np.random.default_rng(seed).uniform(size=len(modes)).tolist()
    path = path_of(modes, hardness)
    for adapt in (True, False):
        found = segments(path, adapt=adapt)
        assert [s.first for s in found] == [0, *(s.end for s in found[:-1])] and found[-1].end == len(path)
        assert all(set(modes[s.first : s.end]) == {s.mode} and len(s) == s.end - s.first for s in found)
        changes = {k for k in range(1, len(modes)) if modes[k] != modes[k - 1]}
        assert changes <= {s.first for s in found}
        if not adapt:
            assert {s.first for s in found} == changes | {0} and {s.method for s in found} == {"search"}


def test_the_mean_or_the_greatest_hardness_says_whether_a_stored_plan_is_adapted() -> None:
    path = path_of([0] * 6, [0.0] * 5 + [0.9])
    assert segments(path, "max") == [Segment(0, 6, 0, "adapt")]
    assert segments(path, "mean") == [Segment(0, 6, 0, "search")]
    assert method_of(np.full(3, HARD), "max") == "search", "as hard as the threshold is not hard yet"
    assert method_of(np.full(3, HARD + 1e-6), "mean") == "adapt"


@pytest.mark.parametrize("adapt", [True, False])
def test_a_path_that_ends_where_it_begins_has_no_segments(adapt: bool) -> None:
    assert segments(path_of([], []), adapt=adapt) == []
