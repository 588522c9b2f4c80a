"""A plan played in physics: reference, controller and whole runs that arrive or fall for a reason that is said."""

from __future__ import annotations

import dataclasses
import json
from pathlib import Path

import numpy as np
import pytest
from pydrake.multibody.parsing import Parser
from pydrake.multibody.plant import MultibodyPlant
from scipy.spatial.transform import Rotation

from drakeplan.cli import main
from drakeplan.execution import ExecutionOptions, ExecutionReport, Physics, play_plan
from drakeplan.execution.controller import Gains, Hold, V, WholeBodyController, _between
from drakeplan.execution.played import played_plan
from drakeplan.execution.reference import EVERY, PlanReference
from drakeplan.execution.world import World
from drakeplan.plan.plan import Plan
from drakeplan.plan.plan_file import write_plan
from drakeplan.query.options import PlanOptions
from drakeplan.query.planning import plan_scene
from optimization.convex import piqp_adapter
from scenes.files.scene_source import load_scene
from scenes.gravity import GRAVITY
from scenes.robots.robot import load_robot

ROBOT = load_robot("escher")
MODEL = str(ROBOT.model)


def robot_alone() -> MultibodyPlant:
    plant = MultibodyPlant(0.0)
    Parser(plant).AddModels(Path(MODEL))
    plant.Finalize()
    return plant


@pytest.fixture(scope="module")
def walk() -> Plan:
    """Two short steps on level ground."""
    result = plan_scene(load_scene("flat"), ROBOT, PlanOptions(goal=(0.3, 0.0), improve=0.0, use_palms=False))
    assert result.status == "complete", result.reason
    return result.plan


@pytest.fixture(scope="module")
def played(walk: Plan) -> ExecutionReport:
    return play_plan(walk, MODEL)


@pytest.fixture(scope="module")
def reference(walk: Plan) -> PlanReference:
    return PlanReference(walk, robot_alone())


def test_the_reference_passes_through_the_plan_and_moves_as_it_does(walk: Plan, reference: PlanReference) -> None:
    motion, plant = walk.motion, robot_alone()
    context = plant.CreateDefaultContext()
    for k in (0, len(motion.t) // 3, len(motion.t) - 1):
        sample = reference.at(float(motion.t[k]))
        assert np.abs(sample.q - motion.q[k]).max() < 1e-9
        assert np.abs(sample.v - motion.v[k]).max() < 0.1  # stored velocities are differences
    for k in range(0, len(motion.t), 7):
        plant.SetPositions(context, motion.q[k])
        com = plant.CalcCenterOfMassPositionInWorld(context)
        assert np.abs(reference.at(float(motion.t[k])).com - com).max() < (1e-9 if k % EVERY == 0 else 5e-4)
    for s in (0.31, 2.5):
        before, sample, after = (reference.at(s + h) for h in (-1e-4, 0.0, 1e-4))
        assert np.abs(0.5 * (after.com - before.com) / 1e-4 - sample.com_v).max() < 1e-6
        assert np.abs(0.5 * (after.com_v - before.com_v) / 1e-4 - sample.com_a).max() < 1e-4
    assert np.array_equal(reference.at(-1.0).q, reference.at(0.0).q)
    assert np.array_equal(reference.at(reference.duration + 1.0).q, reference.at(reference.duration).q)


def test_an_end_effectors_course_has_the_velocity_of_its_poses(reference: PlanReference) -> None:
    for s in np.linspace(0.3, reference.duration - 0.3, 9):
        course, step = reference.course(0, s), 1e-5
        ahead, behind = reference.course(0, s + step), reference.course(0, s - step)
        assert np.abs((ahead.p - behind.p) / (2 * step) - course.v).max() < 1e-4
        turn = Rotation.from_matrix(ahead.R @ behind.R.T).as_rotvec() / (2 * step)
        assert np.abs(turn - course.w).max() < 1e-3


def test_planned_wrenches_of_all_contacts_carry_the_weight_at_rest(walk: Plan, reference: PlanReference) -> None:
    held = walk.phases.contact[0]
    force = sum(
        walk.contacts.X_WC[c, :3, :3] @ reference.wrench(e, int(c), 0.0)[3:] for e, c in enumerate(held) if c >= 0
    )
    assert force[2] == pytest.approx(walk.mass * GRAVITY, rel=0.02)


@pytest.mark.parametrize("angle", [1e-10, 1e-3, 1.0, 3.0])
def test_the_turn_between_two_rotations_is_the_one_that_was_made(angle: float) -> None:
    axis = np.array([0.36, -0.48, 0.8])
    R = Rotation.from_rotvec([0.3, -1.0, 0.2]).as_matrix()
    turned = Rotation.from_rotvec(angle * axis).as_matrix() @ R
    assert np.abs(_between(turned, R) - angle * axis).max() < 1e-12


def test_a_standing_robot_is_given_the_torques_that_hold_it(walk: Plan, reference: PlanReference) -> None:
    """The accelerations that these torques and the weight bring about on fixed feet are none."""
    plant = robot_alone()
    controller = WholeBodyController(plant, walk.effectors, walk.mass)
    first = reference.at(0.0)
    controller.look(first.q, np.zeros(plant.num_velocities()))
    tasks = [
        Hold(walk.contacts.corners(int(c)), 0.5, reference.wrench(e, int(c), 0.0), 2000.0) if c >= 0 else None
        for e, c in enumerate(walk.phases.contact[0])
    ]
    u = controller.torques(first, 0.0, tasks)
    assert controller.failures == 0
    assert controller.share_of_limit() < 1.0
    context = plant.CreateDefaultContext()
    plant.SetPositions(context, first.q)
    # What the feet have to give: from the base's six rows. With it and the torques the joints' rows have to balance.
    tau = plant.MakeActuationMatrix() @ u + plant.CalcGravityGeneralizedForces(context)
    world = plant.world_frame()
    frames = [plant.GetFrameByName(name) for name in walk.effectors[:2]]
    J = np.vstack([plant.CalcJacobianSpatialVelocity(context, V, f, np.zeros(3), world, world) for f in frames])
    wrench, *_ = np.linalg.lstsq(J.T, -tau, rcond=None)
    left = tau + J.T @ wrench
    assert np.abs(left).max() < 0.5  # [N m] of up to 100


def test_drakes_combination_of_frictions_gives_the_terrains(walk: Plan) -> None:
    world = World(walk, MODEL, Physics(friction=0.37))
    plant, inspector = world.plant, world._graph.model_inspector()
    ground = plant.GetCollisionGeometriesForBody(plant.world_body())[0]
    sole = plant.GetCollisionGeometriesForBody(plant.GetFrameByName("left_foot").body())[-1]
    properties = (inspector.GetProximityProperties(g) for g in (ground, sole))
    m, n = (p.GetProperty("material", "coulomb_friction").static_friction() for p in properties)
    assert 2 * m * n / (m + n) == pytest.approx(0.37, rel=1e-5)


def test_a_walk_arrives_and_stays_near_its_plan(played: ExecutionReport) -> None:
    assert played.reached, played.reason
    assert played.fell_at_s is None
    assert played.com_error_m < 0.02
    assert max(played.slips_m.values()) < 0.02
    assert played.programs_failed == 0
    assert not played.collisions
    assert "stands at the goal" in played.text()


@pytest.mark.slow
def test_a_light_robot_whose_soles_are_welded_to_its_ankles_walks_too() -> None:
    """35 kg; its ankle links reach the ground, and barely damped contacts made it chatter."""
    g1 = load_robot("g1")
    result = plan_scene(load_scene("flat"), g1, PlanOptions(goal=(0.3, 0.0), improve=0.0, use_palms=False))
    assert result.status == "complete", result.reason
    report = play_plan(result.plan, str(g1.model))
    assert report.reached, report.reason
    assert report.com_error_m < 0.02
    assert not any("world" in pair for pair in report.collisions)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "seed", "palms", "goal"), [("random_surfaces", 1, None, (0.8, 0.0)), ("rubble_corridor", 3, 1, (1.0, 0.0))]
)
def test_plans_on_polygons_and_with_a_palm_on_a_wall_arrive(
    name: str, seed: int, palms: int | None, goal: tuple[float, float]
) -> None:
    options = PlanOptions(seed=seed, expansions=150, deadline=300.0, goal=goal)
    scene = load_scene(name, seed=seed)
    result = plan_scene(scene, ROBOT, options)
    assert result.status == "complete", result.reason
    assert palms is None or result.report["palms_used"] == palms
    tilts = [np.degrees(scene.terrain.surfaces[k].tilt) for k in set(result.plan.contacts.surface.tolist())]
    assert sum(10.0 < tilt < 30.0 for tilt in tilts) >= 2  # tilted polygons carry feet
    report = play_plan(result.plan, MODEL)
    assert report.reached, report.text()
    assert report.com_error_m < 0.05
    assert report.programs_failed == 0


def test_the_played_motion_takes_the_place_of_the_planned_one(walk: Plan, played: ExecutionReport) -> None:
    shown = played_plan(walk, played)
    assert np.array_equal(shown.motion.t, walk.motion.t)
    assert 1e-5 < np.abs(shown.motion.q[:, 7:] - walk.motion.q[:, 7:]).max() < 0.2
    assert np.abs(np.linalg.norm(shown.motion.q[:, :4], axis=1) - 1.0).max() < 1e-12


def test_on_ice_it_falls_and_says_that_a_foot_slipped(walk: Plan) -> None:
    reports = [play_plan(walk, MODEL, ExecutionOptions(physics=Physics(friction=0.01), noise=1.0)) for _ in range(2)]
    assert not reports[0].reached
    assert "slipped" in reports[0].reason
    assert reports[0].as_dict() | {"real_time_factor": 0} == reports[1].as_dict() | {"real_time_factor": 0}


def test_a_push_that_nobody_withstands_is_a_fall_soon_after_it(walk: Plan) -> None:
    report = play_plan(walk, MODEL, ExecutionOptions(push=(0.5, (0.0, 2.0, 0.0))))
    assert not report.reached
    assert 0.5 < report.fell_at_s < 2.0


@pytest.mark.slow
def test_a_push_away_from_the_swinging_foot_is_met_with_angular_momentum(walk: Plan) -> None:
    """0.2 m/s moves the capture point by 6 cm, beyond a sole of 5: with the pressure alone nothing can be done."""
    phases = walk.phases
    swing = next(
        k for k in range(len(phases.end)) if phases.contact[k, 0] < 0 <= phases.contact[k, 1]
    )  # on the right foot
    push = (0.5 * float(phases.start[swing] + phases.end[swing]), (0.0, -0.2, 0.0))
    assert play_plan(walk, MODEL, ExecutionOptions(push=push)).reached
    calm = Gains(alarm=(1.0, 2.0))  # [m] off: never
    assert not play_plan(walk, MODEL, ExecutionOptions(push=push, gains=calm)).reached


def test_off_balance_the_weights_change_by_degrees() -> None:
    usual = Gains()
    assert usual.when_off_balance(0.0) is usual
    middle, far = usual.when_off_balance(0.5 * sum(usual.alarm)), usual.when_off_balance(1.0)
    assert usual.w_com < middle.w_com < far.w_com == usual.alarmed[0] * usual.w_com
    assert usual.w_base > middle.w_base > far.w_base == pytest.approx(usual.alarmed[1] * usual.w_base)
    assert usual.share < middle.share < far.share == 1.0
    assert far.w_spin == 0.0


def test_the_command_says_what_came_of_it(walk: Plan, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    write_plan(walk, tmp_path / "plan.h5")
    page = tmp_path / "page.html"
    command = [
        "simulate",
        str(tmp_path / "plan.h5"),
        "--push",
        "0",
        "2",
        "0",
        "--at",
        "0.3",
        "--html",
        str(page),
        "--json",
    ]
    assert main(command) == 1
    report = json.loads(capsys.readouterr().out)
    assert report["reached"] is False
    assert {"fell_at_s", "reason", "slips", "real_time_factor"} <= set(report)
    assert page.stat().st_size > 100_000


@pytest.mark.parametrize(
    ("more", "said"),
    [
        (["--friction", "0"], "--friction"),
        (["--push", "0", "nan", "0"], "--push"),
        (["--push", "0", "1"], "--push"),
        (["--noise", "-1"], "--noise"),
        (["--at", "-2"], "--at"),
    ],
)
def test_numbers_that_cannot_be_are_named(more: list[str], said: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["simulate", "plan.h5", *more]) == 2
    assert said in capsys.readouterr().err


def test_without_its_solver_the_command_says_what_to_install(walk: Plan, tmp_path: Path, capsys, monkeypatch) -> None:
    write_plan(walk, tmp_path / "plan.h5")
    monkeypatch.setattr(piqp_adapter, "available", lambda: False)
    assert main(["simulate", str(tmp_path / "plan.h5")]) == 2
    assert "pip install 'drakeplan[fast]'" in capsys.readouterr().err


def test_a_plan_of_contacts_alone_cannot_be_played(walk: Plan, tmp_path: Path, capsys) -> None:
    write_plan(dataclasses.replace(walk, phases=None, centroidal=None, motion=None), tmp_path / "plan.h5")
    assert main(["simulate", str(tmp_path / "plan.h5")]) == 2
    assert "no motion to play" in capsys.readouterr().err
