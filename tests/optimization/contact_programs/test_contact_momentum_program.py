"""Contacts with momentum: Newton, cones and levers recomputed from the answer's numbers."""

from __future__ import annotations

import numpy as np
import pytest

from optimization.balance.friction import SQUARE, excess
from optimization.contact_programs.contact_momentum_program import (
    PRODUCTS,
    ContactDynamicsOptions,
    ContactDynamicsProgram,
)
from optimization.contact_programs.contact_query import ContactQuery, FootstepOptions
from optimization.contact_programs.footstep_program import FootstepProgram
from optimization.contact_programs.step_reach import step_reach
from optimization.mixed_integer import scip_adapter
from optimization.mixed_integer.dive import dive
from optimization.mixed_integer.solver import MixedIntegerSettings, solve_mixed_integer
from scenes.files.scene_source import load_scene
from scenes.footholds.projection import set_down
from scenes.gravity import GRAVITY
from scenes.input_error import InputError
from scenes.robots.robot import load_robot
from scenes.scene import Goal
from scenes.stance import Stance
from scenes.terrain.packed_terrain import pack_terrain
from scenes.terrain.surface import Surface
from scenes.terrain.terrain import Terrain
from scenes.transition_model import transition_model

ESCHER = load_robot("escher")
SOLVER = "scip" if scip_adapter.available() else "drake"
FIRST = MixedIntegerSettings(SOLVER, time_limit=90.0, first_only=True)
COARSE = ContactDynamicsOptions(dt=1.0)
ATOL = 1e-5  # the solvers' tolerance, with the levers' factor


def query(terrain: Terrain, goal: Goal) -> ContactQuery:
    packed = pack_terrain(terrain)
    feet = [
        set_down(packed, e, 0.0, y, 0.0, ESCHER.effectors[k].half_extent)
        for k, (e, y) in enumerate((("left_foot", 0.1), ("right_foot", -0.1)))
    ]
    start = Stance((feet[0], feet[1], None, None))
    return ContactQuery(terrain, ESCHER, start, goal, step_reach(ESCHER, transition_model()))


def flat(y: float = 1.0) -> Surface:
    return Surface("floor", np.array([[-1, -1, 0], [2, -1, 0], [2, y, 0], [-1, y, 0]], float))


@pytest.fixture(scope="module")
def walk():
    q = query(Terrain((flat(),)), Goal((0.4, 0.0, 0.0), 0.2))
    program = ContactDynamicsProgram(q, FootstepOptions(4), COARSE)
    return program, solve_mixed_integer(program.data(), FIRST)


def test_the_momentum_follows_from_the_forces(walk) -> None:
    program, record = walk
    m, dt = program.momentum(record.x), COARSE.dt
    assert record.x is not None
    assert len(m.velocity) == 1 + 4 * 2 + 1  # shift and swing of each contact, and the last shift
    for n, forces in enumerate(m.force):
        total = sum((f for _, f in forces), np.zeros(3))
        a = (m.velocity[n + 1] - m.velocity[n]) / dt
        np.testing.assert_allclose(a / GRAVITY + [0, 0, 1], total, atol=ATOL)
        np.testing.assert_allclose(m.com[n + 1] - m.com[n], dt * m.velocity[n + 1], atol=ATOL)
    np.testing.assert_allclose(m.velocity[-1], 0.0, atol=ATOL)


def test_forces_stay_inside_the_cone_and_the_com_within_reach(walk) -> None:
    program, record = walk
    m = program.momentum(record.x)
    for n, forces in enumerate(m.force):
        assert len(forces) == (2 if n % 2 == 0 else 1)
        for p, f in forces:
            assert excess(SQUARE, 0.5, *f) < ATOL
            assert np.linalg.norm(m.com[n + 1] - p) <= ESCHER.com_reach[0] + ATOL
            assert m.com[n + 1][2] - p[2] >= ESCHER.com_height[0] - ATOL


def test_the_relaxed_products_bound_the_true_ones(walk) -> None:
    program, record = walk
    m, index = program.momentum(record.x), program.prog.FindDecisionVariableIndices
    assert np.abs(m.moment).max() <= COARSE.moment + ATOL
    P = {}
    for variable in program.prog.decision_variables():
        if variable.get_name().startswith("PQ"):
            P.setdefault(variable.get_name().split("(")[0], []).append(record.x[index([variable])][0])
    blocks = [np.array(v).reshape(6, 2, order="F") for v in P.values()]
    levers = [(p - m.com[n + 1], f) for n, forces in enumerate(m.force) for p, f in forces]
    assert len(blocks) == len(levers)
    for pq, (arm, f) in zip(blocks, levers, strict=True):
        for q, (j, k) in enumerate(PRODUCTS):
            assert pq[q, 0] >= (arm[j] + f[k]) ** 2 - ATOL
            assert pq[q, 1] >= (arm[j] - f[k]) ** 2 - ATOL


def test_products_at_their_bounds_are_the_cross_product() -> None:
    rng = np.random.default_rng(0)
    for _ in range(20):
        arm, f = rng.normal(size=(2, 3))
        products = [0.25 * ((arm[j] + f[k]) ** 2 - (arm[j] - f[k]) ** 2) for j, k in PRODUCTS]
        cross = [products[2 * i] - products[2 * i + 1] for i in range(3)]
        np.testing.assert_allclose(cross, np.cross(arm, f))


def test_the_contacts_alone_are_tried_first_and_their_variables_come_first() -> None:
    q = query(Terrain((flat(),)), Goal((0.4, 0.0, 0.0), 0.2))
    data = ContactDynamicsProgram(q, FootstepOptions(4), COARSE).data()
    assert data.easier is not None
    np.testing.assert_array_equal(data.binary[: data.easier.size], data.easier.binary)
    assert data.binary.sum() == data.easier.binary.sum()
    x = dive(data, 30.0)
    assert x is not None and data.worst(x)[0] < ATOL
    assert data.easier.worst(x[: data.easier.size])[0] < ATOL


def test_dynamics_never_make_the_contacts_cheaper() -> None:
    q = query(Terrain((flat(),)), Goal((0.4, 0.0, 0.0), 0.2))
    settings = MixedIntegerSettings(SOLVER, time_limit=60.0, gap=1e-3)
    plain = FootstepProgram(q, FootstepOptions(4)).solve(settings)
    with_momentum = ContactDynamicsProgram(q, FootstepOptions(4), COARSE).solve(settings)
    assert with_momentum.feasible and with_momentum.cost >= plain.cost - 1e-3


def test_a_free_palm_carries_nothing_and_a_held_one_pushes_within_its_friction_cone() -> None:
    wall = Surface("wall", np.array([[-1, 0.55, 0.8], [2, 0.55, 0.8], [2, 0.55, 1.6], [-1, 0.55, 1.6]]), 0.6)
    wall = wall if wall.normal[1] < 0 else wall.flipped()
    q = query(Terrain((flat(0.5), wall)), Goal((0.1, 0.0, 0.0), 0.2))
    for cost, held in ((-10.0, False), (10.0, True)):
        program = ContactDynamicsProgram(q, FootstepOptions(3, palms=(2,), free_palm=cost), COARSE)
        record = solve_mixed_integer(program.prog, MixedIntegerSettings(SOLVER, time_limit=60.0, gap=0.05))
        assert record.x is not None
        stances = program.steps.stances(record.x)
        assert (stances[-1].contacts[2] is not None) == held
        for forces in program.momentum(record.x).force[4:]:  # after the palm's turn
            (palm,) = (f for p, f in forces if p[2] > 0.3)
            push = palm @ wall.normal  # [M g]
            if not held:  # its point is anywhere on the wall then, its force is nothing
                assert np.abs(palm).max() < ATOL
            else:
                assert push > 0.05
                assert np.linalg.norm(palm - push * wall.normal) <= wall.friction * push + ATOL


def test_friction_forbids_what_is_too_steep_to_stand_on_at_rest() -> None:
    c, s = np.cos(0.7), np.sin(0.7)  # 40 deg, friction 0.5: no force along gravity, and the end is at rest
    slope = Surface("slope", np.array([[0.6, -1, 0], [0.6 + 2 * c, -1, 2 * s], [0.6 + 2 * c, 1, 2 * s], [0.6, 1, 0]]))
    floor = Surface("floor", np.array([[-1, -1, 0], [0.5, -1, 0], [0.5, 1, 0], [-1, 1, 0]], float))
    q = query(Terrain((floor, slope)), Goal((0.95, 0.0, 0.3), 0.1))
    program = ContactDynamicsProgram(q, FootstepOptions(6), COARSE)
    assert not program.reason
    record = solve_mixed_integer(program.prog, MixedIntegerSettings(SOLVER, time_limit=60.0, first_only=True))
    assert record.status == "infeasible"


@pytest.mark.slow
def test_the_rubble_field_has_contacts_with_momentum() -> None:
    scene = load_scene("rubble_field", seed=0)
    q = query(scene.terrain, scene.goal)
    program = ContactDynamicsProgram(q, FootstepOptions(14), COARSE)
    record = solve_mixed_integer(program.data(), FIRST)
    assert record.x is not None, record.message
    m = program.momentum(record.x)
    assert np.abs(m.moment).max() <= COARSE.moment + ATOL
    surfaces = {s.contacts[0].surface for s in program.steps.stances(record.x)}
    assert len(surfaces) >= 3


@pytest.mark.parametrize("options", [{"dt": 0.0}, {"dt": 2.0}, {"swing": np.nan}, {"moment": -1.0}])
def test_timing_that_makes_no_sense_is_refused(options: dict) -> None:
    with pytest.raises(InputError, match="contact dynamics"):
        ContactDynamicsOptions(**options)


def test_trimming_is_refused_where_time_is_fixed() -> None:
    q = query(Terrain((flat(),)), Goal((0.4, 0.0, 0.0), 0.2))
    with pytest.raises(InputError, match="trim"):
        ContactDynamicsProgram(q, FootstepOptions(4, trim=True))
