"""Contact phases: they pass through the plan's contacts, and their wrenches carry the robot."""

import json
from itertools import pairwise

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

GRAVITY = np.array([0.0, 0.0, -9.81])  # [m/s^2]
OFFSET = np.array([431250.0, 5411000.0, 12.0])  # [m] of `map_plan`


@pytest.fixture
def sequence(stepping_plan, write, tmp_path):
    write(stepping_plan, "contacts", "contacts.json")
    return json.loads((tmp_path / "contacts.json").read_text(encoding="utf-8"))


def test_phases_follow_each_other_and_name_what_is_in_contact(sequence, stepping_plan):
    phases = sequence["contact_phases"]
    assert len(phases) == len(stepping_plan.phases)
    for before, after in pairwise(phases):
        assert before["timeFinal"] == after["timeInitial"]
        for name in ("c", "dc", "L"):
            assert before[f"{name}_final"] == after[f"{name}_init"]
    for phase, row in zip(phases, stepping_plan.phases.contact, strict=True):
        held = [stepping_plan.effectors[e] for e in np.flatnonzero(row >= 0)]
        assert phase["effectors_in_contact"] == held == list(phase["contact_patches"]) == list(phase["contact_forces"])


def test_patches_are_the_contacts_of_the_plan(sequence, stepping_plan):
    for phase, row in zip(sequence["contact_phases"], stepping_plan.phases.contact, strict=True):
        for name, patch in phase["contact_patches"].items():
            contact = int(row[stepping_plan.effectors.index(name)])
            X_WC = stepping_plan.contacts.X_WC[contact]
            assert np.array_equal(patch["placement"]["translation"], X_WC[:3, 3])
            assert np.array_equal(patch["placement"]["rotation"], X_WC[:3, :3])
            turned = Rotation.from_quat(patch["placement"]["quaternion"]).as_matrix()
            assert np.allclose(turned, X_WC[:3, :3], atol=1e-12)
            assert patch["friction"] == patch["contact_model"]["mu"] == stepping_plan.contacts.friction[contact]
            points = np.array(patch["contact_model"]["contact_points_positions"])
            assert np.array_equal(np.abs(points[:, :2]).max(axis=0), patch["contact_model"]["half_extent"])
            assert not points[:, 2].any()


def test_wrenches_change_the_momenta_as_newton_and_euler_say(sequence, stepping_plan):
    """From each sample to the next; moments are taken about where the centre of mass is then, as the plan has it."""
    worst = 0.0
    for phase in sequence["contact_phases"]:
        t, com = np.array(phase["c_t"]["t"]), np.array(phase["c_t"]["value"])
        dc, L = np.array(phase["dc_t"]["value"]), np.array(phase["L_t"]["value"])
        for n, dt in enumerate(np.diff(t)):
            force, moment = stepping_plan.mass * GRAVITY, np.zeros(3)
            for name, acting in phase["contact_forces"].items():
                place = phase["contact_patches"][name]["placement"]
                R_WC, p_WC = np.array(place["rotation"]), np.array(place["translation"])
                f_W, m_W = R_WC @ acting["wrench_C"][n][:3], R_WC @ acting["wrench_C"][n][3:]
                assert np.allclose(f_W, acting["force_W"][n], atol=1e-9)
                force = force + f_W
                moment += m_W + np.cross(p_WC - com[n + 1], f_W)
            worst = max(worst, *np.abs(stepping_plan.mass * (dc[n + 1] - dc[n]) / dt - force))
            worst = max(worst, *np.abs((L[n + 1] - L[n]) / dt - moment))
    assert worst < 1e-6  # [N], [N m]


def test_a_plan_of_contacts_only_has_a_phase_for_each_stance(contacts_plan, write, tmp_path):
    write(contacts_plan, "contacts", "contacts.json")
    phases = json.loads((tmp_path / "contacts.json").read_text(encoding="utf-8"))["contact_phases"]
    assert len(phases) == len(contacts_plan.stances)
    for phase, row in zip(phases, contacts_plan.stances, strict=True):
        assert phase["timeInitial"] is phase["timeFinal"] is None
        assert "c_t" not in phase
        assert len(phase["contact_patches"]) == (row >= 0).sum()


def test_the_offset_of_a_georeferenced_scene_is_added_again(map_plan, sequence, write, tmp_path):
    write(map_plan, "contacts", "map.json")
    moved = json.loads((tmp_path / "map.json").read_text(encoding="utf-8"))
    assert moved["origin_offset"] == OFFSET.tolist()
    for there, here in zip(moved["contact_phases"], sequence["contact_phases"], strict=True):
        assert np.array_equal(there["c_init"], np.array(here["c_init"]) + OFFSET)
        assert there["dc_init"] == here["dc_init"]
        for name, patch in there["contact_patches"].items():
            before = here["contact_patches"][name]["placement"]["translation"]
            assert np.array_equal(patch["placement"]["translation"], np.array(before) + OFFSET)
        assert there["contact_forces"] == here["contact_forces"]
