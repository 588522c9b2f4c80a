"""The Crocoddyl problem: its data are the plan's, and solving it from the plan stays with the plan."""

import importlib.metadata
import subprocess
import sys
from dataclasses import replace

import numpy as np
import pytest
from lxml import etree

from drakeplan.export import export_plan

WITHIN = 10.0  # [mm] of the plan's centre of mass


def missing() -> str:
    """Why the script cannot run here, "" if it can."""
    try:
        versions = [importlib.metadata.version(name) for name in ("crocoddyl", "pin")]
    except importlib.metadata.PackageNotFoundError:
        return "pip install 'drakeplan[peers]'"
    if versions[0] == "3.2.1" and not versions[1].startswith("4.0."):
        return f"crocoddyl 3.2.1 was built for pinocchio 4.0, pin {versions[1]} crashes it"
    return ""


@pytest.fixture(scope="module")
def folder(stepping_plan, tmp_path_factory):
    folder = tmp_path_factory.mktemp("solve ü")
    export_plan(stepping_plan, "crocoddyl", folder / "solve.py")
    return folder


def test_its_data_are_the_plans(folder, stepping_plan):
    with np.load(folder / "solve_data" / "plan.npz", allow_pickle=False) as data:
        assert np.array_equal(data["joint_position"], stepping_plan.motion.q[:, 7:])
        assert np.array_equal(data["phase_contact"], stepping_plan.phases.contact)
        assert np.array_equal(data["contact_X_WC"], stepping_plan.contacts.X_WC)
        half = stepping_plan.half_extent[stepping_plan.contacts.effector]
        assert np.allclose(data["support_size"], 2 * half)  # whole patches
        assert np.allclose(data["support_middle"], 0.0)


def test_a_sole_that_rests_on_half_of_itself_has_its_cone_there(stepping_plan, tmp_path):
    support = np.array(stepping_plan.contacts.support)
    support[0] = [[0.0, -0.05], [0.11, -0.05], [0.11, 0.05], [0.0, 0.05]]
    half = replace(stepping_plan, contacts=replace(stepping_plan.contacts, support=support))
    export_plan(half, "crocoddyl", tmp_path / "solve.py")
    with np.load(tmp_path / "solve_data" / "plan.npz", allow_pickle=False) as data:
        assert np.allclose(data["support_middle"][0], [0.055, 0.0])
        assert np.allclose(data["support_size"][0], [0.11, 0.1])


def test_the_model_keeps_its_masses_and_joints_and_loses_its_shapes(folder, stepping_plan):
    root = etree.parse(str(folder / "solve_data" / "robot.urdf")).getroot()
    assert sum(float(m.get("value")) for m in root.iter("mass")) == pytest.approx(stepping_plan.mass, abs=1e-9)
    moving = {j.get("name") for j in root.findall("joint") if j.get("type") != "fixed"}
    with np.load(folder / "solve_data" / "plan.npz", allow_pickle=False) as data:
        assert moving == set(data["joint_names"].tolist())
    assert {e.get("name") for e in root.findall("link")} >= set(stepping_plan.effectors)
    assert not [e for e in root.iter() if e.tag in ("visual", "collision", "mesh")]


@pytest.mark.skipif(bool(missing()), reason=missing())
def test_fddp_converges_and_stays_within_a_centimetre_of_the_plan(folder, stepping_plan):
    """Feet, and a palm on a wall, as rigid contacts; the solution's forces are Crocoddyl's own."""
    words = ["--dt", "0.05", "--iterations", "40", "--quiet", "--out", str(folder / "solution.npz")]
    done = subprocess.run(
        [sys.executable, str(folder / "solve.py"), *words], capture_output=True, text=True, timeout=120, cwd="/"
    )
    assert done.returncode == 0, done.stdout + done.stderr
    said = dict(line.split(None, 1) for line in done.stdout.splitlines() if not line.startswith("CoM"))
    assert said["converged"] == "True"
    deviation = next(line for line in done.stdout.splitlines() if line.startswith("CoM deviation"))
    assert 0.0 < float(deviation.split()[2]) < WITHIN
    with np.load(folder / "solution.npz", allow_pickle=False) as solution:
        assert solution["x"].shape == (197, 34 + 33)
        assert solution["u"].shape == (196, 27)
        travelled = solution["x"][-1, 0] - solution["x"][0, 0]
        planned = stepping_plan.motion.q[-1, 4] - stepping_plan.motion.q[0, 4]
        assert abs(travelled - planned) < 0.03
