"""What carries a sole, as the verifier finds it by itself; and plan files from before there were supports."""

from __future__ import annotations

import dataclasses
import shutil
from pathlib import Path

import h5py
import numpy as np
import pytest

from drakeplan.plan.plan import Plan, PlanContacts
from drakeplan.plan.plan_file import read_plan, write_plan
from drakeplan.verifier import verify
from drakeplan.verifier.geometry import patch
from drakeplan.verifier.wrenches import CONES, TRUE_CONE, corner_wrenches, distance_to_cones, wrench_distance

HALF = np.array([0.11, 0.05])
WHOLE = patch(HALF)
FRONT = np.array([[0.11, 0.05], [0.0, 0.05], [0.0, -0.05], [0.11, -0.05]])
BRIDGE = np.array([[0.09, 0.05], [-0.08, 0.05], [-0.08, -0.05], [0.09, -0.05]])
TILT = np.deg2rad(8.0)


def standing(plan: Plan, path: Path, plates: str, support: np.ndarray | None, X_WC: np.ndarray | None = None):
    """The report on both feet of the plan, the left one with this support, on other ground; they stand at y = +-0.1."""
    text = plan.scene_yaml
    ground = next(line for line in text.splitlines(keepends=True) if "name: ground" in line)
    table, rows = plan.contacts, np.full((2, 8, 2), np.nan)
    for k, corners in enumerate((WHOLE if support is None else support, WHOLE)):
        rows[k, : len(corners)] = corners
    X = table.X_WC[:2].copy()
    if X_WC is not None:
        X[0] = X_WC
    feet = PlanContacts(X, table.effector[:2], table.surface[:2], table.friction[:2], rows)
    right = "  - {name: right, vertices: [[-1, -1, 0], [1, -1, 0], [1, 0, 0], [-1, 0, 0]]}\n"
    on = dataclasses.replace(
        plan,
        scene_yaml=text.replace(ground, plates + right),
        contacts=feet,
        stances=plan.stances[:1],
        phases=None,
        centroidal=None,
        motion=None,
    )
    on = dataclasses.replace(on, contacts=dataclasses.replace(on.contacts, surface=[0, plates.count("name:")]))
    write_plan(on, path / "plan.h5")
    report = verify(path / "plan.h5")
    return {check.name for check in report.checks if not check.ok}


def plate(name: str, x: tuple[float, float], z: float | tuple[float, float] = 0.0, more: str = "") -> str:
    """Ground under the left foot from x to x, at a height or from one to another."""
    low, high = z if isinstance(z, tuple) else (z, z)
    corners = f"[[{x[0]}, 0, {low}], [{x[1]}, 0, {high}], [{x[1]}, 0.5, {high}], [{x[0]}, 0.5, {low}]]"
    return f"  - {{name: {name}, vertices: {corners}{more}}}\n"


OTHER = {"complete", "start", "start height", "start heading", "goal", "goal heading"}


@pytest.mark.parametrize(
    ("plates", "support", "failed"),
    [
        (plate("left", (0, 1)), FRONT, set()),  # over an edge, the front half rests
        (plate("left", (0, 1)), None, {"support on terrain"}),  # and the plan says all of it
        (plate("left", (0.004, 1)), FRONT, {"support on terrain"}),
        (plate("left", (0.002, 1)), FRONT, set()),
        (plate("left", (-0.08, -0.04)) + plate("bar", (0.05, 0.09)), BRIDGE, set()),
        (plate("left", (-0.08, -0.04)) + plate("bar", (0.05, 0.09), 0.002), BRIDGE, set()),
        (plate("left", (-0.08, -0.04)) + plate("bar", (0.05, 0.09), -0.004), BRIDGE, {"support on terrain"}),
        (plate("left", (-0.08, -0.04)) + plate("bar", (0.05, 0.09)) + plate("high", (-0.01, 0.01), 0.005), BRIDGE,
         {"patch uncovered"}),
        (plate("left", (-0.08, -0.04)) + plate("bar", (0.05, 0.09), more=", contact: [right_foot]"), BRIDGE,
         {"support on terrain"}),
        (plate("left", (-0.08, -0.04)) + plate("bar", (0.05, 0.09), more=", friction: 0.3"), BRIDGE,
         {"contact friction"}),
        (plate("left", (-0.08, -0.04)) + plate("bar", (0.05, 0.09), (-0.001, 0.0025)), BRIDGE, set()),  # 5 deg, on its edge
        (plate("left", (-1, 1)), BRIDGE, set()),  # less than there is
        (plate("left", (-1, 1)), 0.09 * FRONT, {"support size"}),
    ],
)  # fmt: skip
def test_a_support_is_what_the_terrain_gives(
    stepping_plan: Plan, tmp_path: Path, plates: str, support: np.ndarray | None, failed: set[str]
) -> None:
    assert standing(stepping_plan, tmp_path, plates, support) - OTHER == failed


def test_a_sole_on_two_edges_has_a_normal_of_its_own(stepping_plan: Plan, tmp_path: Path) -> None:
    """Two bars of different height; the sole leans on the far edge of the one and the near edge of the other."""
    X = stepping_plan.contacts.X_WC[0].copy()
    X[:3, :3] = [[np.cos(TILT), 0, -np.sin(TILT)], [0, 1, 0], [np.sin(TILT), 0, np.cos(TILT)]]
    rise = 0.08 * np.sin(TILT)
    bars = plate("left", (-0.3, -0.08 * np.cos(TILT)), -rise) + plate("bar", (0.08 * np.cos(TILT), 0.3), rise)
    support = np.array([[0.08, 0.05], [-0.08, 0.05], [-0.08, -0.05], [0.08, -0.05]])
    assert standing(stepping_plan, tmp_path, bars, support, X) - OTHER == {
        "patch uncovered"
    }  # the heel pierces a wide bar
    bars = plate("left", (-0.082, -0.08 * np.cos(TILT)), -rise) + plate("bar", (0.08 * np.cos(TILT), 0.082), rise)
    assert standing(stepping_plan, tmp_path, bars, support, X) - OTHER == set()
    flat = plate("left", (-1, 1))
    assert "contact normal" in standing(stepping_plan, tmp_path, flat, support, X)


def test_files_of_version_1_are_read_as_whole_patches(good: Path, tmp_path: Path) -> None:
    path = Path(shutil.copy(good, tmp_path / "old.h5"))
    with h5py.File(path, "r+") as file:
        del file["contacts/support"]
        file.attrs["version"] = 1
    assert verify(path).holds
    old, new = read_plan(path), read_plan(good)
    assert np.array_equal(old.contacts.support, new.contacts.support)
    assert old.contact_sequence() == new.contact_sequence()


@pytest.mark.parametrize("cone", sorted(CONES))
@pytest.mark.parametrize("seed", range(20))
def test_what_the_corners_of_a_support_push_is_admissible_and_pressure_beyond_them_is_not(cone: str, seed: int) -> None:
    rng = np.random.default_rng(seed)
    angle = np.sort(rng.uniform(0, 2 * np.pi, rng.integers(3, 9)))
    support = 0.05 * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    rays = CONES[cone].rays(0.5)
    block = corner_wrenches(np.eye(4), support, rays, np.zeros(3))
    wrench = block @ rng.random(block.shape[1])
    cop = np.array([-wrench[4], wrench[3]]) / wrench[2]
    torque = wrench[5] - (cop[0] * wrench[1] - cop[1] * wrench[0])
    inside = wrench_distance(CONES[cone], wrench[None, :3], cop[None], np.array([torque]), [support], np.array([0.5]))
    assert inside[0] < 1e-8
    middle = 0.5 * (support[0] + support[1])
    out = np.array([support[1, 1] - support[0, 1], support[0, 0] - support[1, 0]])
    beyond = middle + 0.003 * out / np.linalg.norm(out)
    up = np.array([[0.0, 0.0, 1.0]])
    far = wrench_distance(TRUE_CONE, up, beyond[None], np.zeros(1), [support], np.array([0.5]))
    assert far[0] == pytest.approx(distance_to_cones([corner_wrenches(np.eye(4), support, TRUE_CONE.rays(0.5), np.zeros(3))],
                                                     np.array([[0, 0, 1.0, beyond[1], -beyond[0], 0]]))[0])  # fmt: skip
    assert far[0] > 0.002
