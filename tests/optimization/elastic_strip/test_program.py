"""One step of the left foot over three plates, deformed to plates that moved: against Drake, closed forms and invariants."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from pydrake.solvers import ClarabelSolver

from optimization.balance.balance_regions import balance_region
from optimization.balance.reference_program import StaticEquilibriumProgram
from optimization.elastic_strip.check import GOOD_BALANCE, GOOD_CLEARANCE, GOOD_CONTACT
from optimization.elastic_strip.problem import BALANCE, CONTACT, Gathering, StripEstimate, StripOptions, StripProblem
from optimization.elastic_strip.program import ElasticStrip
from optimization.inverse_kinematics.whole_body_ik import IkOptions, WholeBodyIK
from optimization.multibody.kinematics import difference
from scenes.contact import Contact, contact_pose
from scenes.footholds.contact_regions import ContactRegions, cover_terrain
from scenes.input_error import InputError
from scenes.library.plates import rectangle, tilted_plate
from scenes.robots.plant import build_plant
from scenes.robots.robot import load_robot
from scenes.terrain.packed_terrain import pack_terrain
from scenes.terrain.terrain import Terrain, terrain_from

ROBOT = load_robot("escher")
STEP = 0.25  # [m]
INNER = 3  # configurations between two critical ones
BESIDE = (0.0, 0.12)  # x and y of the left foot at first; the right foot mirrors y [m]


@cache
def body() -> WholeBodyIK:
    return WholeBodyIK(ROBOT)


def plates(*moves: tuple[float, float, float, float, float]) -> Terrain:
    """Plates under the left foot, the right foot, and where the left foot lands, moved by (x, y, z, roll, pitch)."""
    x, y = BESIDE
    centres = ((x, y), (x, -y), (x + STEP, y))
    moves = moves or ((0.0,) * 5,) * 3
    return terrain_from([
        tilted_plate(f"plate_{k}", (cx + m[0], cy + m[1], m[2]), rectangle(0.24, 0.2), m[3], m[4])
        for k, ((cx, cy), m) in enumerate(zip(centres, moves, strict=True))
    ])  # fmt: skip


def contacts_on(terrain: Terrain) -> tuple[Contact, ...]:
    """Where the planned contacts are, projected straight onto the plates: left, right, left again."""
    x, y = BESIDE
    found = []
    for k, (cx, cy) in enumerate(((x, y), (x, -y), (x + STEP, y))):
        surface = terrain.surfaces[k]
        n = surface.normal
        z = surface.centroid[2] - (n[:2] @ (np.array([cx, cy]) - surface.centroid[:2])) / n[2]
        effector = "right_foot" if k == 1 else "left_foot"
        found.append(Contact(effector, k, contact_pose(effector, np.array([cx, cy, z]), n, 0.0), surface.friction))
    return tuple(found)


@cache
def planned() -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """(q, held, support, share) of a step on level plates: standing, foot about to lift, in the air, about to land."""
    contacts = contacts_on(plates())
    ik, keys = body(), []
    both, right = balance_region(contacts[:2], ROBOT), balance_region(contacts[1:2], ROBOT)
    for left, region in ((0, both), (0, right), (2, right), (2, balance_region(contacts[1:], ROBOT))):
        X_WE = np.tile(np.eye(4), (4, 1, 1))
        X_WE[0], X_WE[1] = contacts[left].X_WC, contacts[1].X_WC
        seed = keys[-1] if keys else None
        answer = ik.solve(X_WE, np.array([True, True, False, False]), region, seed, options=IkOptions(com_margin=0.02))
        assert answer.ok
        keys.append(answer.q)
    q, held, support, share = [], [], [], []
    lifted = (([0, 1], [0, 1]), ([-1, 1], [-1, 1]), ([2, 1], [2, 1]))
    ends = (([0, 1], [0, 1]), ([0, 1], [-1, 1]), ([2, 1], [-1, 1]), ([2, 1], [2, 1]))
    for p in range(3):
        d = np.empty(len(keys[0]) - 1)
        difference(keys[p], keys[p + 1], d)
        for i in range(INNER + 1):
            s = i / (INNER + 1)
            q.append(ik.kinematics.integrate(keys[p], d, s))
            which = ends[p] if i == 0 else lifted[p]
            held.append(which[0])
            support.append(which[1])
            share.append(s)
    q.append(keys[3])
    held.append(ends[3][0])
    support.append(ends[3][1])
    share.append(0.0)
    wide = (np.column_stack([np.array(a), np.full((len(a), 2), -1)]) for a in (held, support))
    return np.array(q), *wide, np.array(share)


def regions_of(contact: Contact, terrain: Terrain) -> ContactRegions:
    spec = ROBOT.effectors[0 if contact.effector == "left_foot" else 1]
    return cover_terrain(pack_terrain(terrain), spec, heading=0.0, turn=0.06, surfaces=[contact.surface])


def problem_on(terrain: Terrain, **changes: object) -> StripProblem:
    q, held, support, share = planned()
    num = len(q)
    phase = np.minimum(np.arange(num) // (INNER + 1), 2)
    swing = np.full((num, 4, 2), -1)
    swing[(phase == 1) & (held[:, 0] < 0), 0] = 0, 2
    contacts = contacts_on(terrain)
    regions = tuple(regions_of(c, terrain) for c in contacts)
    projected = tuple(
        replace(c, X_WC=r.project(c.X_WC, r.nearest(c.X_WC)[0])) for c, r in zip(contacts, regions, strict=True)
    )
    whole = StripProblem(
        t=0.25 * np.arange(num), q=q, phase=phase, contacts=projected, planned=contacts_on(plates()), regions=regions,
        held=held, support=support, swing=swing, share=share,
    )  # fmt: skip
    return replace(whole, **changes)


def strip_on(terrain: Terrain, problem: StripProblem, options: StripOptions | None = None) -> ElasticStrip:
    model = body()
    return ElasticStrip(ROBOT, model.kinematics, model.model.capsules, pack_terrain(terrain), problem,
                        options or StripOptions(turn=0.06, time_limit=60.0))  # fmt: skip


MOVED = ((0.03, 0.02, -0.04, 0.12, -0.1), (-0.02, 0.03, 0.05, -0.1, 0.15), (0.04, -0.03, 0.03, 0.15, 0.1))


@cache
def deformed() -> tuple[Terrain, StripProblem, StripEstimate]:
    terrain = plates(*MOVED)
    problem = problem_on(terrain)
    return terrain, problem, strip_on(terrain, problem).solve()


# ---- what comes out


def test_a_strip_on_plates_that_did_not_move_stays_where_it_is() -> None:
    terrain = plates()
    problem = problem_on(terrain)
    estimate = strip_on(terrain, problem).solve()
    assert estimate.feasible, estimate.reason
    critical = [0, INNER + 1, 2 * (INNER + 1), 3 * (INNER + 1)]
    assert np.abs(estimate.q[critical, 4:] - problem.q[critical, 4:]).max() < 0.03
    for before, after in zip(problem.contacts, estimate.contacts, strict=True):
        np.testing.assert_allclose(after.X_WC, before.X_WC, atol=5e-3)


def test_when_all_plates_sink_alike_the_body_sinks_and_no_joint_moves() -> None:
    sunk = -0.05
    terrain = plates(*((0.0, 0.0, sunk, 0.0, 0.0),) * 3)
    still, moved = (strip_on(t, problem_on(t)).solve() for t in (plates(), terrain))
    assert moved.feasible, moved.reason
    # The memory of where the strip was holds it back by little, and the springs do not see a common shift at all.
    np.testing.assert_allclose(moved.q[:, 6] - still.q[:, 6], sunk, atol=4e-3)
    assert np.abs(moved.q[:, 7:] - still.q[:, 7:]).max() < 0.04


def test_drake_finds_every_foot_on_its_contact_and_no_body_in_the_terrain() -> None:
    terrain, problem, estimate = deformed()
    assert estimate.feasible, estimate.reason
    built = build_plant(ROBOT, terrain)
    context = built.new_context()
    plant_context = built.plant.GetMyMutableContextFromRoot(context)
    query_context = built.scene_graph.GetMyContextFromRoot(context)
    soles = built.effector_geometry[0] | built.effector_geometry[1]
    for n, q in enumerate(estimate.q):
        built.plant.SetPositions(plant_context, q)
        for e in range(2):
            c = problem.held[n, e]
            if c >= 0:
                X_WE = built.plant.EvalBodyPoseInWorld(plant_context, built.effector_bodies[e]).GetAsMatrix4()
                assert np.linalg.norm(X_WE[:3, 3] - estimate.contacts[c].p_WC) < GOOD_CONTACT
                assert np.linalg.norm(X_WE[:3, :3] - estimate.contacts[c].R_WC) < 0.02
        pairs = built.scene_graph.get_query_output_port().Eval(query_context).ComputePointPairPenetration()
        depths = [p.depth for p in pairs if not {p.id_A, p.id_B} & soles]
        assert max(depths, default=0.0) < GOOD_CLEARANCE


def test_every_contact_comes_out_in_its_regions_and_its_patch_on_the_plate() -> None:
    terrain, problem, estimate = deformed()
    for contact, regions in zip(estimate.contacts, problem.regions, strict=True):
        assert regions.nearest(contact.X_WC)[1] < 1e-9
        surface = terrain.surfaces[contact.surface]
        hx, hy = ROBOT.half_extents[0]
        flat = np.array([[hx, hy, 0], [-hx, hy, 0], [-hx, -hy, 0], [hx, -hy, 0]])
        points = contact.p_WC + flat @ contact.R_WC.T
        edges = np.roll(surface.vertices, -1, axis=0) - surface.vertices
        inward = np.cross(surface.normal, edges / np.linalg.norm(edges, axis=1, keepdims=True))
        assert ((points[:, None] - surface.vertices) * inward).sum(axis=2).min() > 0.0
        np.testing.assert_allclose(contact.X_WC, contact_pose(contact.effector, contact.p_WC, surface.normal,
                                                              contact.heading), atol=1e-6)  # fmt: skip


def test_a_linear_program_finds_forces_that_balance_every_configuration() -> None:
    _, problem, estimate = deformed()
    for n, q in enumerate(estimate.q):
        carrying = [estimate.contacts[c] for c in problem.support[n] if c >= 0]
        com = body().kinematics.com(q)[:2]
        program = StaticEquilibriumProgram(carrying, ROBOT, "inner")
        middle = np.mean([c.p_WC[:2] for c in carrying], axis=0)
        nearer = com + GOOD_BALANCE * (middle - com) / max(np.linalg.norm(middle - com), GOOD_BALANCE)
        assert program.is_balanced(nearer)


def test_limits_are_never_left_and_the_strip_is_smoother_than_its_contacts_jump() -> None:
    _, problem, estimate = deformed()
    tree = body().kinematics.tree
    joints = estimate.q[:, 7:]
    assert ((joints >= tree.lower) & (joints <= tree.upper)).all()
    u = estimate.q[:, 4:] - problem.q[:, 4:]
    assert np.abs(u).max() > 0.03
    assert np.abs(np.diff(u, axis=0)).max() < 0.3 * np.abs(u).max()


def test_the_gathering_of_two_feet_keeps_to_its_circle() -> None:
    terrain = plates()
    place = (0.0, 0.03)
    drawn = problem_on(terrain, gatherings=(Gathering("start region", (0, 1), place, 0.008),))
    free = problem_on(terrain)
    means = [np.mean([c.p_WC[:2] for c in strip_on(terrain, p).solve().contacts[:2]], axis=0) for p in (free, drawn)]
    assert np.linalg.norm(means[0] - place) > 0.02
    assert np.linalg.norm(means[1] - place) < 0.009


# ---- the program


def test_two_solvers_agree_on_the_first_step() -> None:
    terrain = plates(*MOVED)
    answers = []
    for solver in ("piqp", "clarabel"):
        options = StripOptions(turn=0.06, max_iterations=1, time_limit=60.0, solver=solver)
        answers.append(strip_on(terrain, problem_on(terrain), options).solve())
    np.testing.assert_allclose(answers[0].q, answers[1].q, atol=2e-3)


def test_the_answer_of_a_program_is_an_optimum_of_it_by_drake() -> None:
    terrain = plates(*MOVED)
    strip = strip_on(terrain, problem_on(terrain), StripOptions(turn=0.06, max_iterations=1, time_limit=60.0))
    cost = strip.solve().iterations[0].cost
    assert ClarabelSolver().Solve(strip.prog).get_optimal_cost() == pytest.approx(cost, rel=1e-3)


def test_more_tension_makes_neighbours_move_alike() -> None:
    terrain = plates(*MOVED)
    rough = []
    for tension in (0.03, 3.0):
        problem = problem_on(terrain)
        estimate = strip_on(terrain, problem, StripOptions(turn=0.06, tension=tension, time_limit=60.0)).solve()
        rough.append(float((np.diff(estimate.q[:, 7:] - problem.q[:, 7:], axis=0) ** 2).sum()))
    assert rough[1] < 0.7 * rough[0]


# ---- where it breaks


def test_a_plate_out_of_reach_breaks_the_strip_at_its_contact_and_the_best_so_far_comes_back() -> None:
    terrain = plates((0.0,) * 5, (0.0,) * 5, (0.0, 0.0, 1.5, 0.0, 0.0))
    estimate = strip_on(terrain, problem_on(terrain)).solve()
    assert not estimate.feasible
    assert "left_foot, contact 2: contact off" in estimate.reason
    missed = [f for f in estimate.faults if f.task == CONTACT]
    assert {2} <= {f.contact for f in missed}
    assert {f.about for f in missed if f.contact == 2} == {"left_foot"}
    assert np.isfinite(estimate.q).all()
    assert estimate.faults[0].value / estimate.faults[0].limit == max(f.value / f.limit for f in estimate.faults)


def test_a_plate_too_steep_to_stand_on_alone_breaks_the_balance_of_its_phase() -> None:
    terrain = plates((0.0,) * 5, (0.0, 0.0, 0.0, 0.55, 0.0), (0.0,) * 5)
    estimate = strip_on(terrain, problem_on(terrain)).solve()
    fault = next(f for f in estimate.faults if f.task == BALANCE)
    assert not estimate.feasible
    assert fault.phase in (1, 2)
    assert "centre of mass" in str(fault)


def test_no_time_gives_the_planned_strip_back_marked() -> None:
    terrain = plates(*MOVED)
    problem = problem_on(terrain)
    estimate = strip_on(terrain, problem, StripOptions(time_limit=0.0)).solve()
    assert (estimate.ended_by, estimate.feasible, len(estimate.iterations)) == ("time", False, 0)
    np.testing.assert_array_equal(estimate.q, problem.q)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"q": np.full((13, 40), np.nan)}, "q holds a number that is not finite"),
        ({"share": np.zeros(5)}, "share has shape"),
        ({"t": np.zeros(13)}, "t must ascend"),
        ({"held": np.full((13, 4), 9)}, "held names a contact that does not exist"),
        ({"regions": ()}, "expected regions"),
    ],
)
def test_data_that_cannot_be_is_refused(changes: dict[str, object], message: str) -> None:
    with pytest.raises(InputError, match=message):
        problem_on(plates(), **changes)


def test_a_contact_without_region_is_named() -> None:
    nothing = ContactRegions(np.zeros(0, np.int64), np.zeros((0, 4, 4)), np.zeros(0))
    regions = problem_on(plates()).regions
    with pytest.raises(InputError, match=r"contact 2 \(left_foot\) has no region"):
        problem_on(plates(), regions=(*regions[:2], nothing))


@pytest.mark.parametrize("options", [{"trust": 0.0}, {"margin": -1.0}, {"tension": np.nan}, {"max_iterations": 0}])
def test_options_that_cannot_be_are_refused(options: dict[str, float]) -> None:
    with pytest.raises(InputError, match="elastic strip: "):
        StripOptions(**options)
