"""The balance benchmark asks both sides the same questions."""

import subprocess
import sys
from importlib.util import find_spec

import numpy as np
import pytest

from drakeplan.bench.balance import (
    CONES,
    CONTACTS,
    INSTALL,
    MU,
    PEER,
    Query,
    Region,
    _case,
    agreement_with_highs,
    child_environment,
)
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


ASK_BOTH = """
import importlib, numpy as np
from drakeplan.bench.balance import PEER, PeerWay, Query, _case
peer, verdicts = importlib.import_module(PEER), []
for contacts in (2, 3, 4):
    case = _case(np.random.default_rng(contacts), contacts, "inner", "escher")
    ours, theirs = Query(), PeerWay(peer, 8, "DLP", "CLP", False)
    for way in (ours, theirs):
        way.prepare(case)
    verdicts += [(bool(ours.ask(com)), bool(theirs.ask(com))) for com in case.com]
assert set(verdicts) == {(True, True), (False, False)}, verdicts
"""


@pytest.mark.skipif(find_spec(PEER) is None, reason=INSTALL)
def test_where_the_peer_is_installed_its_libraries_are_found_and_it_answers_as_we_do():
    done = subprocess.run(
        [sys.executable, "-c", ASK_BOTH], env=child_environment(), capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
