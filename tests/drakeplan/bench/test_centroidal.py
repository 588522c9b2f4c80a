"""The centroidal benchmark: honest draws, and peers that agree with the program though they share no code with it."""

from itertools import pairwise

import numpy as np
import pytest

from drakeplan.bench.centroidal import agreement, draw, gap_walk, label, sequence_options, sequence_problem, slope_walk
from drakeplan.bench.peers import differential_dynamic, interior_point
from drakeplan.bench.peers.interior_point import InteriorPoint
from drakeplan.bench.random_transitions import CATEGORIES
from drakeplan.bench.table import BenchOptions
from optimization.centroidal.program import CentroidalProgram
from optimization.centroidal.transition_dynamics import TransitionDynamics, transition_options
from scenes.robots.robot import load_robot
from scenes.stance import changed_effector

ROBOT = load_robot("escher")
needs_casadi = pytest.mark.skipif(not interior_point.available(), reason=interior_point.INSTALL)
needs_crocoddyl = pytest.mark.skipif(not differential_dynamic.available(), reason=differential_dynamic.INSTALL)


@pytest.mark.parametrize("category", CATEGORIES)
def test_draws_repeat_hold_the_palms_of_their_category_and_have_both_verdicts(category):
    drawn = draw(ROBOT, category, 20)
    for one, other in zip(drawn, draw(ROBOT, category, 20), strict=True):
        assert one.before == other.before
        assert np.array_equal(one.com, other.com)
        assert sum(c is not None for c in one.before.contacts[2:]) == CATEGORIES[category]
        changed_effector(one.before, one.after)
    feasible = np.mean([e.feasible for e in label(ROBOT, drawn, transition_options(ROBOT)).estimates])
    assert 0.2 < feasible < 0.95


@needs_casadi
@pytest.mark.parametrize(
    ("category", "count"),
    [("feet", 3), *(pytest.param(c, 8, marks=pytest.mark.slow) for c in CATEGORIES)],
)
def test_ipopt_gives_the_same_verdicts_and_costs(category, count):
    drawn = draw(ROBOT, category, count)
    found = label(ROBOT, drawn, transition_options(ROBOT))
    (share, p5, p95, unmended), lines = agreement(ROBOT, category, drawn, found, BenchOptions())
    assert share == 1.0, lines
    assert unmended == 0.0
    assert 0.97 < p5 <= p95 < 1.01  # where local optima differ ours may be the better one


@needs_casadi
def test_the_peer_finds_our_trajectories_dynamics_exact_and_corrupted_ones_not():
    t = draw(ROBOT, "one palm", 12)
    dynamics = TransitionDynamics(ROBOT)
    checked = 0
    for each in t:
        ours = dynamics.estimate(each.before, each.after, each.com, each.linear_momentum)
        if not ours.feasible:
            continue
        problem = dynamics.problem(each.before, each.after, each.com, each.linear_momentum)
        peer = InteriorPoint(problem, dynamics.options)
        x = peer.from_trajectory(problem, ours.trajectory)
        cost, _ = peer.judge(problem, x)
        assert cost == pytest.approx(ours.cost, rel=1e-6)  # spreading over corners leaves wrenches and costs alone
        equal = peer.lower == peer.upper
        g = peer.rows(problem, x)
        assert np.abs(g[equal]).max() < 1e-9
        x[3] += 0.01
        assert np.abs(peer.rows(problem, x)[equal]).max() > 5e-3
        checked += 1
        if checked == 2:
            return
    raise AssertionError("no feasible draw")


@pytest.mark.parametrize("stances", [gap_walk(), slope_walk(31)])
def test_the_sequences_alternate_feet_and_have_their_number_of_contacts(stances):
    contacts = {c for s in stances for c in s.held}
    assert len(contacts) in (10, 31)
    moved = [changed_effector(a, b) for a, b in pairwise(stances)]
    assert all(a != b for a, b in pairwise(moved))


@needs_casadi
@needs_crocoddyl
def test_crocoddyl_and_ipopt_arrive_at_our_cost_on_a_walk():
    options = sequence_options(ROBOT, "inner", "auto")
    problem = sequence_problem(ROBOT, slope_walk(3, length=0.2), options)
    ours = CentroidalProgram(problem, options).solve()
    assert ours.feasible, ours.reason
    peer = InteriorPoint(problem, options)
    exact = peer.solve(problem, peer.guess(problem))
    assert exact.feasible
    assert ours.cost == pytest.approx(exact.cost, rel=1e-3)
    dynamic = differential_dynamic.solve(problem, options)
    cost, violation = peer.judge(problem, dynamic.x)
    assert dynamic.cost == pytest.approx(cost, rel=1e-9)  # both write the objective the same way
    assert violation < 1e-3
    assert dynamic.cost == pytest.approx(ours.cost, rel=1e-2)
