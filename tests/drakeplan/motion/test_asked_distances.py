"""What is asked of pairs of bodies between key postures."""

from __future__ import annotations

import numpy as np
import pytest

from drakeplan.motion.asked_distances import LEAST, AskedDistances
from drakeplan.motion.proximity import TERRAIN, Encounters

APART, NOMINAL = 0.02, 0.012
FOREARM, THIGHS, SOLE = ("forearm", "wall"), ("left_thigh", "right_thigh"), ("left_foot", "floor")


def met(*rows: tuple[int, tuple[str, str], float]) -> Encounters:
    frame, bodies, distance = zip(*rows, strict=True) if rows else ((), (), ())
    terrain = [TERRAIN if pair != THIGHS else 2 for pair in bodies]
    n = len(rows)
    return Encounters(
        np.array(frame, int),
        np.array(distance, float),
        np.array([[1, other] for other in terrain], int).reshape(n, 2),
        np.zeros((n, 2, 3)),
        np.zeros((n, 3)),
        np.array([0 if pair == SOLE else -1 for pair in bodies], int),
        tuple(bodies),
    )


class Monitor:
    """Key postures have these distances; thighs stand `NOMINAL` apart in the nominal posture."""

    def __init__(self, *rows: tuple[int, tuple[str, str], float]) -> None:
        self._rows = rows

    def near(self, q: np.ndarray, frames: range, distance: float) -> Encounters:
        assert len(q) == len(frames)
        return met(*(row for row in self._rows if row[2] < distance))

    def at_most_nominal(self, found: Encounters, wanted: np.ndarray) -> np.ndarray:
        return np.where(found.with_terrain, wanted, np.minimum(wanted, NOMINAL))


def asked_of(monitor: Monitor) -> AskedDistances:
    """Frames at 0, 0.5, 1 ... 2.5 s between key postures at 0, 1 and 2 s; the foot of end effector 0 stands until 1 s."""
    t = np.arange(0.0, 2.51, 0.5)
    room = np.array([[0.0], [0.0], [0.0], [0.5], [1.0], [1.0]])
    asked = AskedDistances(monitor, room, t, APART)  # type: ignore[arg-type]
    asked.learn(np.array([0.0, 1.0, 2.0]), np.zeros((3, 7)))
    return asked


def test_frames_are_asked_for_the_lesser_distance_of_the_key_postures_around_them() -> None:
    asked = asked_of(Monitor((0, FOREARM, 0.015), (1, FOREARM, 0.009), (2, FOREARM, 0.3)))
    frames = met(*((k, FOREARM, 0.0) for k in range(6)))
    np.testing.assert_allclose(asked.wanted(frames), 0.009)
    asked = asked_of(Monitor((0, FOREARM, 0.009)))
    np.testing.assert_allclose(asked.wanted(frames), [0.009, 0.009, APART, APART, APART, APART])


def test_what_key_postures_could_not_part_is_asked_for_the_least() -> None:
    asked = asked_of(Monitor((1, FOREARM, -0.03)))
    np.testing.assert_allclose(asked.wanted(met((1, FOREARM, 0.0), (3, FOREARM, 0.0))), LEAST)


def test_nothing_is_asked_for_more_than_the_nominal_posture_has() -> None:
    asked = asked_of(Monitor((1, THIGHS, 0.018)))
    np.testing.assert_allclose(asked.wanted(met((1, THIGHS, 0.0), (5, THIGHS, 0.0))), NOMINAL)


def test_what_stands_is_asked_for_nothing_and_what_takes_off_for_a_share() -> None:
    wanted = asked_of(Monitor()).wanted(met((2, SOLE, 0.0), (3, SOLE, 0.0), (4, SOLE, 0.0)))
    np.testing.assert_allclose(wanted, [-np.inf, 0.5 * APART, APART])


@pytest.mark.parametrize(("distance", "too_near"), [(0.005, True), (0.0065, False), (0.015, False)])
def test_pairs_are_moved_apart_when_nearer_than_the_threshold_and_than_asked(distance: float, too_near: bool) -> None:
    asked = asked_of(Monitor((1, FOREARM, 0.0061)))
    assert asked.near(met((1, FOREARM, distance)), 0.0063).tolist() == [too_near]
