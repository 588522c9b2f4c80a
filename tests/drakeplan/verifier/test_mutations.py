"""Single corruptions of a plan that holds, each caught by the check that should catch it; every check catches one."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from pathlib import Path

import h5py
import numpy as np
import pytest

from drakeplan.verifier import Report, verify
from drakeplan.verifier.plan_file import read_plan
from drakeplan.verifier.robot import RobotModel
from drakeplan.verifier.track import follow

Corruption = Callable[[h5py.File], None]
LEFT_FOOT, RIGHT_FOOT, PALM, LEFT_AHEAD, RIGHT_AHEAD = range(5)  # contacts of `stepping_plan`


def add(name: str, where: object, amount: object) -> Corruption:
    """Adds to a part of a dataset."""

    def corrupt(file: h5py.File) -> None:
        data = file[name][()]
        data[where] += amount
        file[name][...] = data

    return corrupt


def put(name: str, where: object, value: object) -> Corruption:
    """Overwrites a part of a dataset."""

    def corrupt(file: h5py.File) -> None:
        data = file[name][()]
        data[where] = value
        file[name][...] = data

    return corrupt


def keep(group: str, rows: Callable[[int], object]) -> Corruption:
    """Keeps some rows of every dataset of a group."""

    def corrupt(file: h5py.File) -> None:
        for name in list(file[group]):
            data = file[group][name][()]
            del file[group][name]
            file[group][name] = data[rows(len(data))]

    return corrupt


def attribute(name: str, value: object) -> Corruption:
    return lambda file: file.attrs.__setitem__(name, value)


def scene(old: str, new: str) -> Corruption:
    """Rewrites the scene's text."""

    def corrupt(file: h5py.File) -> None:
        text = file["scene/yaml"].asstr()[()]
        assert old in text, "this corruption corrupts nothing"
        file["scene/yaml"][()] = text.replace(old, new)

    return corrupt


def plate(vertices: str) -> Corruption:
    """Adds a surface to the scene."""
    return scene("obstacles:", f"  - {{name: added, vertices: {vertices}}}\nobstacles:")


def triangle_over(x: float, y: float, z: float) -> Corruption:
    def corrupt(file: h5py.File) -> None:
        triangles = file["scene/triangles"][()]
        added = np.array([[[x, y, z], [x + 0.05, y, z], [x, y + 0.05, z]]])
        del file["scene/triangles"]
        file["scene/triangles"] = np.concatenate([triangles, added])

    return corrupt


def pillar_at(x: float, y: float) -> Corruption:
    """Moves the obstacle, as box and as triangles."""

    def corrupt(file: h5py.File) -> None:
        scene("[1.5, -0.5, 0.5]", f"[{x}, {y}, 0.5]")(file)
        add("scene/triangles", ..., [x - 1.5, y + 0.5, 0.0])(file)

    return corrupt


def joint(name: str, change: float) -> Corruption:
    """Turns a joint by the same angle in every frame."""

    def corrupt(file: h5py.File) -> None:
        names = list(file["motion"].attrs["position_names"])
        column = next(i for i, n in enumerate(names) if n.endswith(f"{name}_q"))
        add("motion/q", (slice(None), column), change)(file)

    return corrupt


def oscillate(amounts: dict[str, float], omega: float, start: float, end: float) -> Corruption:
    """Moves positions to and fro, from rest to rest; the stored velocities are those of the motion that results.

    Args:
        amounts: from the end of a position's name to how far it goes [rad, m].
        omega: angular frequency, rounded to whole periods [rad/s].
        start: time at which it begins [s].
        end: time at which it ends [s].
    """

    def corrupt(file: h5py.File) -> None:
        t, w = file["motion/t"][()], 2 * np.pi * round((end - start) * omega / (2 * np.pi)) / (end - start)
        phase = w * np.where((t > start) & (t < end), t - start, 0.0)
        for name, amount in amounts.items():
            names = list(file["motion"].attrs["position_names"])
            column = next(i for i, n in enumerate(names) if n.endswith(name))
            add("motion/q", (slice(None), column), amount * (1 - np.cos(phase)) / 2)(file)
            add("motion/v", (slice(None), column - 1), amount * w / 2 * np.sin(phase))(file)

    return corrupt


def swap_phases(file: h5py.File) -> None:
    """The left foot swings before the palm is on the wall."""
    contact = file["phases/contact"][()]
    contact[[1, 3]] = contact[[3, 1]]
    file["phases/contact"][...] = contact


def push(amount: float) -> Corruption:
    """The feet push each other apart [N]: sums stay, the tangential forces do not."""

    def corrupt(file: h5py.File) -> None:
        force = file["centroidal/force_W"][()]
        force[:4, LEFT_FOOT, 1] += amount
        force[:4, RIGHT_FOOT, 1] -= amount
        file["centroidal/force_W"][...] = force

    return corrupt


def pull(file: h5py.File) -> None:
    """The left foot carries more than the robot and the right foot pulls."""
    force = file["centroidal/force_W"][()]
    force[:4, LEFT_FOOT, 2] += 600.0
    force[:4, RIGHT_FOOT, 2] -= 600.0
    file["centroidal/force_W"][...] = force


def empty_contacts(file: h5py.File) -> None:
    for group in ("contacts", "stances"):
        keep(group, lambda n: slice(0))(file)
    file["phases/contact"][...] = -1
    file["centroidal/contact"][...] = -1


def swap_corners(file: h5py.File) -> None:
    file["contacts/support"][LEFT_AHEAD] = file["contacts/support"][LEFT_AHEAD][::-1]


def both(*corruptions: Corruption) -> Corruption:
    def corrupt(file: h5py.File) -> None:
        for one in corruptions:
            one(file)

    return corrupt


frame, knot = np.s_[200], np.s_[40]
PALMS_FREE = 7.1, 9.7  # [s] while both palms are in the air
SWING = 0.52  # [rad] of the shoulders
MOTION = {
    "joint accelerations",
    *(f"{kind} momentum of model{part}" for kind in ("linear", "angular") for part in ("", ", RMS", ", median")),
}


# Smooth motions with the velocities that belong to them: no other check catches these.
def torques(file: h5py.File) -> None:
    """No torque in any joint."""
    names = RobotModel(Path(file.attrs["robot_model"])).actuator_names
    file["motion/tau"] = np.zeros((len(file["motion/t"]), len(names)))
    file["motion"].attrs["actuator_names"] = names


SMOOTH_MUTATIONS: dict[str, tuple[Corruption, set[str]]] = {
    "both shoulders swung in antiphase for a while": (
        oscillate({"left_shoulder_pitch_q": 0.9, "right_shoulder_pitch_q": -0.9}, 18.0, *PALMS_FREE),
        {"angular momentum of model, RMS"},
    ),
    "a base that shakes by 4.5 mm": (
        oscillate({"pelvis_x": 0.0045}, 110.0, 0.1, 9.7),
        {"linear momentum of model, RMS"},
    ),
    "a wrist that trembles": (oscillate({"right_wrist_roll_q": 0.65}, 32.0, 0.1, 9.7), {"joint accelerations"}),
}
MUTATIONS: dict[str, tuple[Corruption, set[str]]] = {
    # data
    "status says contacts": (attribute("status", "contacts"), {"complete"}),
    "a NaN in the positions": (put("motion/q", (frame, 9), np.nan), {"numbers finite"}),
    "an infinite force": (put("centroidal/force_W", (knot, 0, 2), np.inf), {"numbers finite"}),
    "no mass": (attribute("mass", np.nan), {"numbers finite"}),
    "no contacts": (empty_contacts, {"nothing empty"}),
    "no frames": (keep("motion", lambda n: slice(0)), {"nothing empty"}),
    "a single knot": (keep("centroidal", lambda n: slice(1)), {"nothing empty"}),
    "no phases": (keep("phases", lambda n: slice(0)), {"nothing empty"}),
    "a contact that is not there": (put("stances/contact", (1, 2), 77), {"indices in range"}),
    "time stands still": (put("motion/t", 5, 0.08), {"time runs forward"}),
    "a phase that ends before it starts": (add("phases/end", 4, -1.5), {"time runs forward"}),
    "every third knot": (keep("centroidal", lambda n: slice(None, None, 3)), {"knot spacing"}),
    "every second frame": (keep("motion", lambda n: slice(None, None, 2)), {"frame spacing"}),
    # contacts
    "a contact frame that is mirrored": (put("contacts/X_WC", (0, 1, 1), -1.0), {"contact pose"}),
    "a patch without size": (put("effectors_half_extent", 0, 0.0), {"patch size"}),
    "a support that is turned round": (swap_corners, {"support in patch"}),
    "a support that is longer than the sole": (
        put("contacts/support", (LEFT_AHEAD, 0), [0.13, 0.05]),
        {"support in patch"},
    ),
    "a support that is a strip": (
        put("contacts/support", (LEFT_AHEAD, slice(2, 4), 1), 0.035),
        {"support size", "wrench in true cone"},
    ),
    "a support under the heel alone": (
        put("contacts/support", (LEFT_AHEAD, [0, 3], 0), -0.05),
        {"wrench in true cone", "wrench in named cone"},
    ),
    "a reserve of friction that is not kept": (
        attribute("provenance", '{"reserve": {"friction": 0.01, "pressure": 1.0}}'),
        {"wrench within the reserve"},
    ),
    "a reserve of pressure that is not kept": (
        attribute("provenance", '{"reserve": {"friction": 1.0, "pressure": 0.05}}'),
        {"wrench within the reserve"},
    ),
    "an unknown surface": (put("contacts/surface", LEFT_AHEAD, 9), {"contact surface exists"}),
    "a foot on the wall": (put("contacts/surface", LEFT_AHEAD, 1), {"contact allowed", "contact normal"}),
    "the wall is for feet only": (scene("friction: 0.6", "contact: [left_foot]"), {"contact allowed"}),
    "friction raised in the file": (put("contacts/friction", PALM, 0.9), {"contact friction"}),
    "friction lowered in the scene": (scene("friction: 0.5", "friction: 0.2"), {"contact friction"}),
    "a contact lifted by 2 cm": (
        add("contacts/X_WC", (LEFT_AHEAD, 2, 3), 0.02),
        {"contact on surface", "held contacts stay"},
    ),
    "a contact tilted by 2 deg": (
        put("contacts/X_WC", (LEFT_FOOT, slice(3), slice(3)), [[0.99939, 0, 0.0349], [0, 1, 0], [-0.0349, 0, 0.99939]]),
        {"contact normal", "held contacts keep level"},
    ),
    "a contact off the edge": (
        put("contacts/X_WC", (RIGHT_AHEAD, 0, 3), 1.95),
        {"support on terrain", "held contacts stay"},
    ),
    "a surface cut back under the sole": (
        scene("[2, -1, 0], [2, 0.6, 0]", "[0.28, -1, 0], [0.28, 0.6, 0]"),
        {"support on terrain"},
    ),
    "a slab over a contact": (
        plate("[[0.1, 0, 0.04], [0.3, 0, 0.04], [0.3, 0.2, 0.04], [0.1, 0.2, 0.04]]"),
        {"patch uncovered", "sole and palm collision"},
    ),
    "a kerb along a sole": (
        plate("[[0.1, 0.14, 0.02], [0.3, 0.14, 0.02], [0.3, 0.2, 0.02], [0.1, 0.2, 0.02]]"),
        {"patch uncovered"},
    ),
    "a triangle over a contact": (triangle_over(0.0, -0.1, 0.01), {"patch uncovered"}),
    "a contact inside a box": (pillar_at(0.2, -0.1), {"patch uncovered", "terrain collision"}),
    "a larger sole": (put("effectors_half_extent", 0, [0.2, 0.1]), {"patch on robot"}),
    # stances and phases
    "a stance left out": (keep("stances", lambda n: [0, 2, 3, 4]), {"one change a stance", "phases follow stances"}),
    "a stance twice": (keep("stances", lambda n: [0, 1, 1, 2, 3, 4]), {"one change a stance"}),
    "a foot's contact held by a palm": (put("stances/contact", (0, 3), LEFT_FOOT), {"stance effectors"}),
    "an empty stance": (put("stances/contact", 2, -1), {"stance holds", "one change a stance"}),
    "a phase emptied": (
        put("phases/contact", 4, -1),
        {"phase holds", "phases follow stances", "phases agree with forces"},
    ),
    "a phase with another foot's contact": (put("phases/contact", (0, 0), RIGHT_FOOT), {"phase effectors"}),
    "a gap between phases": (add("phases/start", 3, 0.1), {"phases contiguous"}),
    "phases that end early": (add("phases/end", -1, -0.3), {"one time span"}),
    "phases in another order": (swap_phases, {"phases follow stances"}),
    "the last stance is never reached": (
        both(keep("phases", lambda n: slice(n - 1)), put("phases/end", -1, 9.8)),
        {"phases follow stances"},
    ),
    "a palm that carries while it swings": (put("centroidal/contact", (8, 2), PALM), {"phases agree with forces"}),
    "the motion starts later": (add("motion/t", ..., 0.2), {"one time span"}),
    "the forces start later": (add("centroidal/t", ..., 0.05), {"one time span", "phases agree with forces"}),
    # forces and momentum
    "a force on a foot in the air": (
        put("centroidal/force_W", (33, 0, 2), 1.0),
        {"no force without contact", "newton"},
    ),
    "the last row differs": (add("centroidal/force_W", (-1, 0, 2), 5.0), {"last row repeats"}),
    "a force scaled": (put("centroidal/force_W", (knot, 1), [0.0, 0.0, 800.0]), {"newton", "euler"}),
    "feet that push each other apart": (push(300.0), {"wrench in true cone", "wrench in named cone"}),
    "a foot that pulls": (pull, {"unilateral", "wrench in true cone"}),
    "a centre of pressure beside the sole": (
        put("centroidal/cop_C", (2, 0), [0.15, 0.0]),
        {"wrench in true cone", "wrench in named cone", "euler"},
    ),
    "a yaw torque beyond friction": (put("centroidal/torque_n", (2, 0), 60.0), {"wrench in true cone", "euler"}),
    "a heavier file": (attribute("mass", 77.0), {"mass", "newton"}),
    "the CoM jumps": (add("centroidal/com", (knot, 0), 0.01), {"com integration"}),
    "the CoM of another robot": (add("centroidal/com", (..., 0), 0.03), {"com of model", "euler"}),
    "a robot that leans over its toes": (add("centroidal/com", (..., 0), 0.3), {"balance at rest"}),
    "a robot that keeps turning": (add("centroidal/angular_momentum", ..., 1.0), {"momentum at rest"}),
    "a robot that never stops": (
        add("centroidal/linear_momentum", ..., [2.0, 0.0, 0.0]),
        {"momentum at rest", "com integration"},
    ),
    "a push that the model does not follow": (
        add("centroidal/linear_momentum", (knot, 0), 45.0),
        {"linear momentum of model", "newton"},
    ),
    "a turn that the model does not make": (
        add("centroidal/angular_momentum", (knot, 2), 18.0),
        {"angular momentum of model", "euler"},
    ),
    "spin out of nothing": (add("centroidal/angular_momentum", (knot, 2), 0.5), {"euler"}),
    # motion
    "a base that floats": (add("motion/q", (..., 6), 0.02), {"held contacts stay"}),
    "a base that floats for one frame": (add("motion/q", (frame, 6), 0.02), {"held contacts stay", "velocities"}),
    "a base that has sunk": (add("motion/q", (..., 6), -0.02), {"sole and palm collision", "held contacts stay"}),
    "a foot that turns on its spot": (joint("left_hip_yaw", 0.05), {"held contacts keep level"}),
    "a knee bent backwards": (joint("left_knee", -1.5), {"joint limits"}),
    "a joint that jumps": (add("motion/q", (frame, 12), 0.5), {"joint speeds", "velocities"}),
    "velocities of another motion": (put("motion/v", ..., 0.0), {"velocities"}),
    "a motion that does not stop": (put("motion/v", (-1, 8), 0.1), {"posture at rest"}),
    "a quaternion that is not unit": (put("motion/q", (frame, 0), 0.9), {"quaternion unit"}),
    "a quaternion of the other sign": (
        lambda file: put("motion/q", (slice(200, None), slice(4)), -file["motion/q"][200:, :4])(file),
        {"quaternion sign"},
    ),
    "an arm through the body": (joint("right_shoulder_roll", 0.6), {"self collision"}),
    "a pillar in the way": (pillar_at(0.2, 0.3), {"terrain collision"}),
    "a low ceiling": (plate("[[-1, -1, 1.3], [-1, 1, 1.3], [1, 1, 1.3], [1, -1, 1.3]]"), {"terrain collision"}),
    "feet that push each other apart beyond the hips' torque": (push(1000.0), {"joint torques", "wrench in true cone"}),
    "torques of no motion": (torques, {"stored torques"}),
    "both shoulders swung in antiphase all the time": (
        oscillate({"left_shoulder_pitch_q": SWING, "right_shoulder_pitch_q": -SWING}, 12.0, 0.1, 9.7),
        {"angular momentum of model, median"},
    ),
    **SMOOTH_MUTATIONS,
    # where it starts and ends
    "another start": (scene("start: {xyz: [0, 0, 0]", "start: {xyz: [0.2, 0, 0]"), {"start"}),
    "another heading": (scene("0], yaw: 0}\ngoal", "0], yaw: 0.2}\ngoal"), {"start heading"}),
    "another goal": (scene("xyz: [0.2, 0, 0], radius", "xyz: [0.5, 0, 0], radius"), {"goal"}),
    "a start on another floor": (scene("start: {xyz: [0, 0, 0]", "start: {xyz: [0, 0, 2.4]"), {"start height"}),
    "a goal on the floor above": (scene("xyz: [0.2, 0, 0], radius", "xyz: [0.2, 0, 2.4], radius"), {"goal height"}),
    "a goal on the floor below": (scene("xyz: [0.2, 0, 0], radius", "xyz: [0.2, 0, -0.9], radius"), {"goal height"}),
    "another heading at the goal": (scene("radius: 0.1, yaw: 0}", "radius: 0.1, yaw: 1.0}"), {"goal heading"}),
    "another first stance": (
        scene("{xyz: [0, 0, 0], yaw: 0}", "{stance: {left_foot: {surface: ground, xyz: [0, 0.11, 0]}}}"),
        {"start"},
    ),
}


@pytest.fixture(scope="module")
def verdict(good: Path) -> Report:
    return verify(good)


def test_the_plan_holds_before_anything_is_corrupted(verdict: Report) -> None:
    assert verdict.holds, verdict.table()


@pytest.mark.parametrize("name", MUTATIONS)
def test_a_corruption_is_caught_by_its_check(good: Path, tmp_path: Path, name: str) -> None:
    corrupt, expected = MUTATIONS[name]
    path = tmp_path / "bad.h5"
    shutil.copy(good, path)
    with h5py.File(path, "r+") as file:
        corrupt(file)
    report = verify(path)
    assert not report.holds
    assert expected <= set(report.failed), report.table()


@pytest.mark.parametrize("name", SMOOTH_MUTATIONS)
def test_a_smooth_corruption_is_caught_by_momenta_or_accelerations_alone(good: Path, tmp_path: Path, name: str) -> None:
    corrupt, expected = SMOOTH_MUTATIONS[name]
    path = Path(shutil.copy(good, tmp_path / "bad.h5"))
    with h5py.File(path, "r+") as file:
        corrupt(file)
    report = verify(path)
    sudden = {"velocities"} if "joint accelerations" in expected else set()  # it begins from one frame to the next
    assert expected <= set(report.failed) <= MOTION | sudden, report.table()


def test_shoulders_that_swing_in_antiphase_all_the_time_are_caught_where_they_add_2_9_to_the_angular_momentum(
    good: Path, tmp_path: Path
) -> None:
    swing = oscillate({"left_shoulder_pitch_q": SWING, "right_shoulder_pitch_q": -SWING}, 12.0, 0.1, 9.7)
    path = Path(shutil.copy(good, tmp_path / "bad.h5"))
    with h5py.File(path, "r+") as file:
        swing(file)
    before, after = read_plan(good), read_plan(path)
    robot = RobotModel(Path(before.attributes["robot_model"]))
    change = follow(robot, after, []).angular - follow(robot, before, []).angular
    assert np.linalg.norm(change, axis=1).max() == pytest.approx(2.9, abs=0.1)  # [N m s]
    assert "angular momentum of model, median" in verify(path).failed


def test_no_check_is_without_a_corruption_that_it_catches(verdict: Report) -> None:
    caught = set().union(*(expected for _, expected in MUTATIONS.values()))
    assert {check.name for check in verdict.checks} == caught
