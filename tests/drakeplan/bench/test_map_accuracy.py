"""The measure of accuracy, and what it says of imported clouds: normals within a degree, edges within 2 cm at 3 mm noise."""

from __future__ import annotations

import numpy as np
import pytest

from drakeplan.bench.map_accuracy import by_distance, cloud_of, errors_of, made_up_ground
from scenes.terrain.surface import Surface


def plates(shift: float = 0.0, grow: float = 1.0) -> list[Surface]:
    ground = made_up_ground(0)
    return [
        Surface(name, plate.mean(axis=0) + (plate - plate.mean(axis=0)) * grow + [0.0, 0.0, shift])
        for name, plate in ground.plates.items()
    ]


def test_the_truth_has_no_error_and_a_wrong_one_has_its_own() -> None:
    ground = made_up_ground(0)
    exact = errors_of(plates(), ground)
    assert exact.level == (19, 19) and exact.walls == (4, 4)
    assert max(exact.angles) == pytest.approx(0.0, abs=1e-5)
    assert max(exact.edges) == pytest.approx(0.0, abs=1e-9)
    smaller = errors_of(plates(grow=0.9), ground)
    sides = [np.linalg.norm(np.diff(plate, axis=0), axis=1).max() for plate in ground.plates.values()]
    assert max(smaller.edges) == pytest.approx(0.05 * np.hypot(4.2, 2.0), rel=1e-3)
    assert np.median(smaller.edges) < 0.05 * max(sides)
    assert errors_of(plates(shift=0.05), ground).level == (0, 19)
    assert errors_of([], ground).edges == ()


def test_imported_clouds_have_normals_within_a_degree_and_edges_within_two_centimetres() -> None:
    ground = made_up_ground(1)
    errors = errors_of(by_distance(cloud_of(ground, 120_000, 0.003, 1)), ground)
    assert errors.level == (19, 19) and errors.walls == (4, 4)
    assert max(errors.angles) < 1.0
    assert np.percentile(errors.edges, 95) < 0.02
