"""The balance benchmark asks both sides the same questions."""

import numpy as np
import pytest

from drakeplan.bench.balance import CONES, CONTACTS, MU, Query, Region, _case, agreement_with_highs
from drakeplan.bench.table import BenchOptions
from optimization.balance.friction import cone_generators


@pytest.mark.parametrize("n", CONTACTS)
def test_random_stances_of_the_benchmark_agree_with_highs(n):
    wrong, near, asked = agreement_with_highs(n, 10, BenchOptions())
    assert (wrong, asked) == (0, 10)
    assert near <= 1


@pytest.mark.parametrize("cone", CONES)
def test_pyramids_of_the_peer_are_our_cones_in_its_frame(cone):
    """hpp: edges at 45 deg + k 360/edges deg from its first tangent, all on the true cone."""
    case = _case(np.random.default_rng(0), 2, cone, "escher")
    angle = np.pi / 4 + 2 * np.pi * np.arange(CONES[cone]) / CONES[cone]
    theirs = np.stack([MU * np.sin(angle), MU * np.cos(angle), np.ones(CONES[cone])], axis=1)
    ours = cone_generators(cone, MU)
    assert all(np.linalg.norm(ours - ray, axis=1).min() < 1e-12 for ray in theirs)
    assert np.allclose(np.linalg.det(case.arrays.R_WC), 1.0)
    assert np.allclose(case.normals[::4], case.arrays.R_WC[:, :, 2])


def test_a_region_and_single_queries_give_the_same_verdicts():
    answers = []
    for way in (Query(), Region()):
        case = _case(np.random.default_rng(3), 3, "inner", "escher")
        way.prepare(case)
        answers.append([bool(way.ask(com)) for com in case.com])
    assert answers[0] == answers[1]
    assert 0 < sum(answers[0]) < len(answers[0])
