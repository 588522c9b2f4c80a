"""A program that took new data is the program that would have been built for them."""

from dataclasses import replace

import numpy as np
import pytest

from optimization.centroidal.contact_schedule import ContactSchedule
from optimization.centroidal.options import CentroidalOptions
from optimization.centroidal.problem import CentroidalProblem, structure
from optimization.centroidal.program import CentroidalProgram
from optimization.convex.quadratic_program import ProgramReader
from scenes.contact import Contact, contact_pose
from scenes.effector import EFFECTORS

HALF = np.array([[0.11, 0.05], [0.11, 0.05], [0.05, 0.05], [0.05, 0.05]])


def problem(seed, tracked=False, palm=True):
    """A step over stones with a palm on a wall; all numbers are drawn, the structure is the same."""
    rng = np.random.default_rng(seed)
    u = rng.uniform

    def contact(e, point, normal):
        normal = np.asarray(normal) / np.linalg.norm(normal)
        pose = contact_pose(EFFECTORS[e], np.array(point), normal, u(-0.2, 0.2))
        return Contact(EFFECTORS[e], 0, pose, u(0.4, 0.7))

    left = contact(0, [0, 0.1, u(-0.05, 0.05)], [*u(-0.2, 0.2, 2), 1])
    right = contact(1, [u(-0.1, 0.1), -0.1, 0], [*u(-0.2, 0.2, 2), 1])
    landed = contact(1, [u(0.1, 0.4), -0.12, u(-0.1, 0.1)], [*u(-0.2, 0.2, 2), 1])
    hand = contact(2, [u(0.2, 0.4), 0.5, 1.2], [u(-0.2, 0.2), -1, 0]) if palm else None
    rows = [(left, right, hand, None)] * 4 + [(left, None, hand, None)] * 4 + [(left, landed, hand, None)]
    schedule = ContactSchedule.from_rows(rows, u(0.15, 0.22, 9))
    com = np.array([u(-0.05, 0.05), u(-0.02, 0.02), u(0.85, 0.95)])
    more = {}
    if tracked:
        reference = com + np.linspace(0, 1, 10)[:, None] * [0.1, 0.03, -0.02]
        more = {"com_reference": reference, "com_box": np.full((10, 3), u(0.1, 0.2)),
                "angular_momentum_reference": u(-1, 1, (10, 3))}  # fmt: skip
    mass = u(60, 90)
    return CentroidalProblem(schedule, mass, HALF * u(0.9, 1.1), com, mass * u(-0.2, 0.2, 3), u(-1, 1, 3), **more)


@pytest.mark.parametrize("tracked", [False, True])
@pytest.mark.parametrize(
    ("cone", "solver"), [("inner", "piqp"), ("square", "clarabel"), ("second_order", "clarabel"), ("diamond", "auto")]
)
def test_an_updated_program_answers_as_one_that_was_built_anew(tracked, cone, solver):
    options = CentroidalOptions(cone=cone, solver=solver, rest_at_end=False)
    program = CentroidalProgram(problem(0, tracked), options)
    program.solve()
    for seed in (1, 2):
        data = problem(seed, tracked)
        program.update(data)
        again, fresh = program.solve(), CentroidalProgram(data, options).solve()
        assert fresh.feasible, fresh.reason
        assert again.feasible
        assert len(again.records) == len(fresh.records)
        assert again.cost == pytest.approx(fresh.cost, rel=1e-6)
        assert np.allclose(again.trajectory.com, fresh.trajectory.com, atol=1e-5)


def test_every_number_of_the_convex_program_is_updated():
    options = CentroidalOptions()
    program = CentroidalProgram(problem(0, tracked=True), options)
    program.update(problem(1, tracked=True))
    fresh = CentroidalProgram(problem(1, tracked=True), options)
    one, other = (ProgramReader(p.prog).read() for p in (program, fresh))
    assert np.allclose(one.q, other.q, atol=1e-12)
    assert abs(one.P - other.P).max() < 1e-12
    for a, b in ((one.equalities, other.equalities), (one.inequalities, other.inequalities)):
        assert abs(a.A - b.A).max() < 1e-12
        assert np.allclose(a.upper, b.upper, atol=1e-12)
        assert np.array_equal(a.lower, b.lower) or np.allclose(a.lower, b.lower, atol=1e-12)
    assert np.allclose(one.lower, other.lower)
    assert np.allclose(one.upper, other.upper)


def test_data_of_another_structure_are_refused():
    program = CentroidalProgram(problem(0))
    for other in (problem(1, palm=False), problem(1, tracked=True)):
        assert structure(other) != structure(program.problem)
        with pytest.raises(ValueError, match="same times"):
            program.update(other)
    shorter = problem(1)
    schedule = shorter.schedule
    cut = ContactSchedule(schedule.contacts[:3], np.minimum(schedule.active, 2)[:-1], schedule.dt[:-1])
    with pytest.raises(ValueError, match="same times"):
        program.update(replace(shorter, schedule=cut))


def test_a_cost_added_from_outside_stays_after_an_update():
    data = problem(1)
    program = CentroidalProgram(problem(0))
    plain = CentroidalProgram(data).solve()
    program.prog.AddQuadraticErrorCost(np.array([[1e3]]), np.array([0.05]), program.com[4, 1:2])
    program.update(data)
    pulled = program.solve()
    target = data.initial_com[1] + 0.05
    assert abs(pulled.trajectory.com[5, 1] - target) < abs(plain.trajectory.com[5, 1] - target)
