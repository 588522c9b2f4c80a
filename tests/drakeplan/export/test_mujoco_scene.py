"""The MJCF: MuJoCo's robot is Drake's, and the terrain is where the plan's contacts are."""

import importlib.metadata
import subprocess
import sys
from dataclasses import replace

import numpy as np
import pytest
from lxml import etree

from drakeplan.plan.body_poses import body_poses
from scenes.robots.plant import build_plant
from scenes.robots.robot import load_robot

mujoco = pytest.importorskip("mujoco", reason="pip install 'drakeplan[export]'")

SAME_PLACE = 1e-6  # [m] nine digits of each body's pose, along a limb
SAME_ENERGY = 1e-6  # relative, for the same reason
TOUCH = 1e-4  # [m]


def installed(distribution):
    try:
        importlib.metadata.distribution(distribution)
    except importlib.metadata.PackageNotFoundError:
        return False
    return True


@pytest.fixture(scope="module")
def stepping_model(stepping_plan, tmp_path_factory):
    """(folder, MuJoCo's model, its data) of the plan along a wall."""
    from drakeplan.export import export_plan

    folder = tmp_path_factory.mktemp("ü b")
    export_plan(stepping_plan, "mujoco", folder / "plan.xml")
    model = mujoco.MjModel.from_xml_path(str(folder / "plan.xml"))
    return folder, model, mujoco.MjData(model)


def check_robot(plan, model, data):
    """Joints, mass, poses of every body and kinetic energy are those of Drake's plant at every keyframe."""
    robot = load_robot(plan.robot)
    plant = build_plant(robot).plant
    context = plant.CreateDefaultContext()
    rng = np.random.default_rng(0)
    assert model.njnt - 1 == plant.num_positions() - 7
    assert model.nu == plant.num_actuators()
    assert mujoco.mj_getTotalmass(model) == pytest.approx(plan.mass, abs=1e-6)
    names = [model.body(k).name for k in range(1, model.nbody)]
    for key in range(model.nkey):
        mujoco.mj_resetDataKeyframe(model, data, key)
        frame = int(np.argmin(np.abs(plan.motion.t - model.key_time[key])))
        q = plan.motion.q[frame]
        v = rng.normal(size=plant.num_velocities())
        plant.SetPositions(context, q)
        plant.SetVelocities(context, v)
        local = plant.EvalBodyPoseInWorld(context, plant.GetBodyByName(robot.base_body)).rotation().matrix().T @ v[:3]
        data.qvel[:] = [*v[3:6], *local, *v[6:]]
        mujoco.mj_forward(model, data)
        for name, X_WB in body_poses(robot, q[None], names).items():
            assert np.abs(data.body(name).xpos - X_WB[0, :3, 3]).max() < SAME_PLACE, name
            assert np.abs(data.body(name).xmat.reshape(3, 3) - X_WB[0, :3, :3]).max() < SAME_PLACE, name
        mujoco.mj_energyVel(model, data)
        assert data.energy[1] == pytest.approx(plant.CalcKineticEnergy(context), rel=SAME_ENERGY)


def test_escher_in_mujoco_is_escher_in_drake(stepping_plan, stepping_model):
    _, model, data = stepping_model
    check_robot(stepping_plan, model, data)


@pytest.mark.skipif(not installed("example-robot-data"), reason="pip install 'drakeplan[robots]'")
def test_g1_in_mujoco_is_g1_in_drake(wriggling_plan, write):
    plan = wriggling_plan(load_robot("g1"))
    files = write(plan, "mujoco", "g1.xml").files
    model = mujoco.MjModel.from_xml_path(str(files[0]))
    check_robot(plan, model, mujoco.MjData(model))
    assert sum(path.suffix == ".obj" for path in files) > 20  # it looks like itself


def test_every_stance_has_a_keyframe_in_which_soles_and_palms_are_at_their_contacts(stepping_plan, stepping_model):
    _, model, data = stepping_model
    plan, seen = stepping_plan, []
    for key in range(model.nkey):
        mujoco.mj_resetDataKeyframe(model, data, key)
        mujoco.mj_forward(model, data)
        phase = min(int(np.searchsorted(plan.phases.start, model.key_time[key] + 1e-6)) - 1, len(plan.phases) - 1)
        seen.append(plan.phases.contact[phase].tolist())
        for name, contact in zip(plan.effectors, plan.phases.contact[phase], strict=True):
            if contact >= 0:
                X_WC = plan.contacts.X_WC[contact]
                assert np.linalg.norm(data.site(name).xpos - X_WC[:3, 3]) < TOUCH
                assert np.abs(data.site(name).xmat.reshape(3, 3) - X_WC[:3, :3]).max() < TOUCH
    assert all(stance.tolist() in seen for stance in plan.stances)


def test_a_ray_onto_each_contact_hits_the_terrain_there(stepping_plan, stepping_model):
    """From above onto the ground, from aside onto the wall, with the robot out of the way."""
    _, model, data = stepping_model
    data.qpos[:3] = [0.0, 0.0, 20.0]
    mujoco.mj_forward(model, data)
    for X_WC in stepping_plan.contacts.X_WC:
        normal, geom = X_WC[:3, 2], np.zeros(1, dtype=np.int32)
        reach = mujoco.mj_ray(model, data, X_WC[:3, 3] + 0.3 * normal, -normal, None, 1, -1, geom)
        assert reach == pytest.approx(0.3, abs=TOUCH)
        assert model.geom_bodyid[geom[0]] == 0
        assert model.geom_contype[geom[0]]  # what is hit can be touched


def test_friction_is_the_terrains(stepping_plan, stepping_model):
    folder, model, _ = stepping_model
    for name, mu in (("ground", 0.5), ("wall", 0.6)):
        (geom,) = (k for k in range(model.ngeom) if (model.geom(k).name or "").endswith(f" {name}"))
        assert model.geom_friction[geom, 0] == mu
        assert model.geom_priority[geom] > model.geom_priority[model.ngeom - 1]
    assert "pillar" in (folder / "plan.xml").read_text(encoding="utf-8")


def test_a_mesh_is_shown_as_it_is_and_touched_as_convex_solids(stepping_plan, write):
    """A wedge: a roof's slope is hit where it is, and its body is one solid."""
    corners = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0], [0, 0.5, 1], [1, 0.5, 1]], float)
    a, b, c, d, e, f = corners + np.array([0.0, 2.0, 0.0])
    faces = [(a, d, c), (a, c, b), (a, b, f), (a, f, e), (b, c, f), (c, d, e), (c, e, f), (d, a, e)]
    plan = replace(stepping_plan, triangles=np.concatenate([stepping_plan.triangles, np.array(faces)]))
    model = mujoco.MjModel.from_xml_path(str(write(plan, "mujoco", "wedge.xml").files[0]))
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    shown = [k for k in range(model.ngeom) if model.geom(k).name == "terrain_0"]
    solid = [k for k in range(model.ngeom) if "meshes/" in (model.geom(k).name or "")]
    assert len(shown) == len(solid) == 1
    assert not model.geom_contype[shown[0]]
    assert model.geom_contype[solid[0]]
    for x, y, z in ((0.5, 2.25, 0.5), (0.2, 2.6, 0.8)):
        for geom in (*shown, *solid):
            down, point = np.array([0.0, 0.0, -1.0]), np.array([x, y, 3.0])
            assert mujoco.mj_rayMesh(model, data, geom, point, down) == pytest.approx(3.0 - z, abs=TOUCH)


def test_servos_push_as_hard_as_the_motors(stepping_plan, stepping_model):
    _, model, _ = stepping_model
    plant = build_plant(load_robot("escher")).plant
    for index in plant.GetJointActuatorIndices():
        motor = plant.get_joint_actuator(index)
        assert np.allclose(model.actuator(motor.name()).forcerange, [-motor.effort_limit(), motor.effort_limit()])
        assert np.allclose(model.joint(motor.name()).range, [
            motor.joint().position_lower_limits()[0], motor.joint().position_upper_limits()[0],
        ])  # fmt: skip


def test_pairs_that_the_model_lets_pass_through_each_other_are_excluded(stepping_model):
    folder, _, _ = stepping_model
    urdf = etree.parse(str(load_robot("escher").model))
    group = next(urdf.iter("{http://drake.mit.edu}collision_filter_group"))
    members = {m.get("link") for m in group.findall("{http://drake.mit.edu}member")}
    excluded = {
        frozenset((e.get("body1"), e.get("body2"))) for e in etree.parse(str(folder / "plan.xml")).iter("exclude")
    }
    assert members
    assert any(pair & members for pair in excluded)


def test_the_player_agrees_with_the_plan_without_a_window(stepping_model):
    folder, _, _ = stepping_model
    done = subprocess.run(
        [sys.executable, str(folder / "plan_play.py"), "--headless"],
        capture_output=True,
        text=True,
        timeout=60,
        cwd="/",
    )
    assert done.returncode == 0, done.stderr
    lines = dict(line.split(None, 1) for line in done.stdout.splitlines() if not line.startswith("soles"))
    assert lines["model"].startswith("27 joints, 76.000 kg")
    assert lines["motion"].startswith("491 frames, 9.80 s, 10 keyframes")
    assert "soles, palms    0.0" in done.stdout
