"""A plan that holds, deformed to a terrain that moved: two steps along a wall with a palm on it, made without the planner."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import numpy as np
import pytest

from drakeplan.experience.deformation import DeformOptions, DeformResult, deform
from drakeplan.experience.key_motion import PER_PHASE, key_motion
from drakeplan.experience.strip_setup import (
    Sampling,
    contact_choices,
    goal_gathering,
    make_problem,
    settle,
    start_gathering,
)
from drakeplan.plan.plan import Plan
from drakeplan.plan.plan_file import write_plan
from drakeplan.verifier import verify
from optimization.balance.friction import FrictionCone
from scenes.contact import Contact, contact_pose
from scenes.effector import EFFECTORS
from scenes.files.scene_file import scene_from_yaml
from scenes.input_error import InputError
from scenes.library.plates import level_plate
from scenes.pose import rpy_rotation
from scenes.robots.robot import load_robot
from scenes.scene import Scene
from scenes.terrain.moved_terrain import move_surfaces
from scenes.terrain.packed_terrain import pack_terrain
from scenes.terrain.surface import Surface
from scenes.terrain.terrain import terrain_from

SAMPLING = Sampling(furthest=0.35, turn=0.06)


def scene_of(plan: Plan) -> Scene:
    return scene_from_yaml(plan.scene_yaml, "the plan", mesh_triangles=plan.triangles)


def with_surfaces(scene: Scene, **moved: np.ndarray) -> Scene:
    """The scene with the named surfaces at other vertices."""
    surfaces = tuple(
        dataclasses.replace(s, vertices=moved[s.name]) if s.name in moved else s for s in scene.terrain.surfaces
    )
    return dataclasses.replace(scene, terrain=dataclasses.replace(scene.terrain, surfaces=surfaces))


def tilted(surface: Surface, shift: tuple[float, float, float], rpy: tuple[float, float, float]) -> np.ndarray:
    return (surface.vertices - surface.centroid) @ rpy_rotation(rpy).T + surface.centroid + np.array(shift)


@pytest.fixture(scope="module")
def moved(stepping_plan: Plan) -> Scene:
    """The ground tips by 6 deg and sinks, the wall leans out and comes nearer."""
    scene = scene_of(stepping_plan)
    ground, wall = scene.terrain.surfaces
    return with_surfaces(
        scene, ground=tilted(ground, (0.0, 0.0, -0.05), (0.06, -0.08, 0.0)),
        wall=tilted(wall, (0.0, 0.05, 0.03), (0.08, 0.0, 0.05)),
    )  # fmt: skip


@pytest.fixture(scope="module")
def result(stepping_plan: Plan, moved: Scene) -> DeformResult:
    return deform(stepping_plan, moved)


def test_the_verifier_accepts_the_deformed_plan_as_a_file(result: DeformResult, tmp_path: Path) -> None:
    assert result.status == "complete", result.reason
    write_plan(result.plan, tmp_path / "deformed.h5")
    report = verify(tmp_path / "deformed.h5")
    assert report.holds, report.table()


def test_the_verifier_refuses_the_old_plan_on_the_moved_scene(
    result: DeformResult, stepping_plan: Plan, tmp_path: Path
) -> None:
    stale = dataclasses.replace(stepping_plan, scene_yaml=result.plan.scene_yaml)
    write_plan(stale, tmp_path / "stale.h5")
    assert not verify(tmp_path / "stale.h5").holds


def test_contacts_keep_their_order_and_go_to_the_nearest_place(
    result: DeformResult, stepping_plan: Plan, moved: Scene
) -> None:
    np.testing.assert_array_equal(result.plan.stances, stepping_plan.stances)
    np.testing.assert_array_equal(result.plan.contacts.surface, stepping_plan.contacts.surface)
    before, after = (p.contacts.X_WC[:, :3, 3] for p in (stepping_plan, result.plan))
    for old, new, s in zip(before, after, result.plan.contacts.surface, strict=True):
        surface = moved.terrain.surfaces[s]
        straight = abs((old - surface.centroid) @ surface.normal)
        assert np.linalg.norm(new - old) >= straight - 1e-9
        assert np.linalg.norm(new - old) < straight + 0.06


def test_a_plan_deformed_to_its_own_scene_hardly_moves(stepping_plan: Plan) -> None:
    result = deform(stepping_plan, scene_of(stepping_plan), DeformOptions(motion=False))
    assert result.status == "contacts", result.reason
    assert result.reason == "no motion was asked for"
    assert result.report["moved_most"] < 0.03
    assert result.plan.status == "contacts"


def test_a_path_does_as_well_as_a_plan(stepping_plan: Plan, moved: Scene, tmp_path: Path) -> None:
    write_plan(stepping_plan, tmp_path / "plan.h5")
    options = DeformOptions(motion=False)
    by_path, by_plan = (deform(p, moved, options) for p in (tmp_path / "plan.h5", stepping_plan))
    np.testing.assert_array_equal(by_path.plan.contacts.X_WC, by_plan.plan.contacts.X_WC)


# ---- what the strip is made of


def test_at_phase_boundaries_everything_is_in_place_and_what_is_shared_carries(stepping_plan: Plan) -> None:
    scene = scene_of(stepping_plan)
    contacts = tuple(stepping_plan.contact(c) for c in range(len(stepping_plan.contacts)))
    packed, robot = pack_terrain(scene.terrain), load_robot("escher")
    chosen = [settle(c, contact_choices(c, robot, packed, SAMPLING, None), packed, c.surface) for c in contacts]
    motion = key_motion(stepping_plan)
    gatherings = (*start_gathering(motion, scene), *goal_gathering(motion, scene.goal))
    problem = make_problem(motion, chosen, gatherings)
    table = stepping_plan.phases.contact
    assert (np.bincount(problem.phase) <= PER_PHASE + 1).all()
    for n, p in enumerate(problem.phase):
        carried = problem.support[n][problem.support[n] >= 0]
        assert set(carried) <= set(problem.held[n]) & set(table[p])
        if problem.share[n] == 0.0 and 0 < n < len(problem.t) - 1:
            assert set(carried) == set(table[p]) & set(table[p - 1]) - {-1}
            assert set(problem.held[n]) - {-1} == (set(table[p]) | set(table[p - 1])) - {-1}
    for e in range(len(EFFECTORS)):
        for n in np.flatnonzero(problem.swing[:, e].min(axis=1) >= 0):
            before, after = (contacts[c].p_WC for c in problem.swing[n, e])
            assert problem.held[n, e] < 0
            assert np.linalg.norm(after - before) > 0.05
    assert [g.name for g in problem.gatherings] == ["start region", "goal region"]


def test_a_foot_that_swings_leaves_the_other_alone_with_the_weight_unless_a_palm_helps(stepping_plan: Plan) -> None:
    alone = key_motion(stepping_plan).carries_alone()
    for c, is_alone in enumerate(alone):
        phases = [set(row) - {-1} for row in stepping_plan.phases.contact]
        assert is_alone == ({c} in phases)


def test_a_contact_settles_on_the_surface_that_is_named() -> None:
    packed = pack_terrain(
        terrain_from([level_plate("low", (-1, 1), (-1, 1)), level_plate("high", (-1, 1), (0.2, 1), z=0.1)])
    )
    contact = Contact("left_foot", 0, contact_pose("left_foot", np.zeros(3), np.array([0.0, 0.0, 1.0]), 0.0), 0.5)
    regions = contact_choices(contact, load_robot("escher"), packed, SAMPLING, FrictionCone.INNER)
    near, _ = settle(contact, regions, packed, 0)
    far, own = settle(contact, regions, packed, 1)
    assert (near.surface, far.surface, set(own.surface)) == (0, 1, {1})
    assert far.p_WC[2] == pytest.approx(0.1)
    assert far.p_WC[1] >= 0.25


# ---- where it cannot be done


def test_a_wall_that_is_gone_leaves_the_palm_nowhere_to_go(stepping_plan: Plan) -> None:
    scene = scene_of(stepping_plan)
    away = with_surfaces(scene, wall=scene.terrain.surfaces[1].vertices + np.array([0.0, 5.0, 0.0]))
    result = deform(stepping_plan, away)
    assert result.status == "none"
    assert "left_palm): no contact region within 0.5 m" in result.reason


def test_ground_too_steep_to_stand_on_alone_is_said_to_be(stepping_plan: Plan) -> None:
    scene = scene_of(stepping_plan)
    steep = with_surfaces(scene, ground=tilted(scene.terrain.surfaces[0], (0, 0, 0), (0.0, 0.6, 0.0)))
    result = deform(stepping_plan, steep, DeformOptions(furthest=1.0))
    assert result.status == "none"
    assert "foot): no contact region flat enough to stand on alone" in result.reason


def test_a_wall_within_reach_of_regions_but_not_of_the_arm_breaks_the_strip_there(stepping_plan: Plan) -> None:
    scene = scene_of(stepping_plan)
    far = with_surfaces(scene, wall=scene.terrain.surfaces[1].vertices + np.array([0.0, 0.75, 0.0]))
    result = deform(stepping_plan, far, DeformOptions(furthest=1.2, motion=False))
    assert result.status == "strip"
    assert result.plan is None
    assert not result.strip.feasible
    assert any("palm" in str(f) for f in result.strip.faults)
    assert any(f.phase >= 0 for f in result.strip.faults)
    assert np.isfinite(result.strip.q).all()


def test_contacts_alone_cannot_be_deformed(stepping_plan: Plan, moved: Scene) -> None:
    contacts = dataclasses.replace(stepping_plan, phases=None, centroidal=None, motion=None)
    with pytest.raises(InputError, match="expected a complete plan, the one of 'along_a_wall' has no motion"):
        deform(contacts, moved)


def test_a_scene_with_other_surfaces_is_refused(stepping_plan: Plan, moved: Scene) -> None:
    terrain = moved.terrain
    fewer = dataclasses.replace(terrain, surfaces=terrain.surfaces[:1], surfaces_of_meshes=())
    with pytest.raises(InputError, match="expected the 2 of the plan, the scene has 1"):
        deform(stepping_plan, dataclasses.replace(moved, terrain=fewer))
    renamed = (terrain.surfaces[0], dataclasses.replace(terrain.surfaces[1], name="fence"))
    other = dataclasses.replace(terrain, surfaces=renamed)
    with pytest.raises(InputError, match="expected 'wall' as in the plan, the scene has 'fence'"):
        deform(stepping_plan, dataclasses.replace(moved, terrain=other))


def test_another_robot_is_refused(stepping_plan: Plan, moved: Scene) -> None:
    with pytest.raises(InputError, match="made for a model of escher"):
        deform(dataclasses.replace(stepping_plan, robot_model_sha256="0" * 64), moved)


@pytest.mark.parametrize(
    "options", [{"per_phase": 0}, {"per_phase": 11}, {"furthest": np.nan}, {"deadline": 0.0}, {"repairs": -1}]
)
def test_options_that_cannot_be_are_refused(options: dict[str, float]) -> None:
    with pytest.raises(InputError, match=f"deform: {next(iter(options))}"):
        DeformOptions(**options)


def test_a_moved_scene_with_nan_never_comes_to_be(stepping_plan: Plan) -> None:
    scene = scene_of(stepping_plan)
    with pytest.raises(InputError, match="must be finite numbers"):
        with_surfaces(scene, ground=np.full((4, 3), np.nan))
    with pytest.raises(InputError, match="shift must be finite"):
        move_surfaces(scene.terrain, np.random.default_rng(0), shift=np.nan)
