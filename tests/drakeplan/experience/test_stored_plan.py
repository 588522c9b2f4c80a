"""Stored plans: a frame of their own, a file that gives them back, and damaged files that are refused in one line."""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Mapping
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from made_up_plans import made_up_outline, made_up_plan
from safetensors.numpy import load, save
from scipy.spatial.transform import Rotation

from drakeplan.experience.key_motion import KeyMotion, key_motion
from drakeplan.experience.plan_distance import PlanBatch, distances
from drakeplan.experience.stored_plan import (
    ABOUT,
    FORMAT,
    MAX_BYTES,
    VERSION,
    Outline,
    StoredPlan,
    plan_pose,
    read_stored_plan,
    store_plan,
)
from drakeplan.plan.plan import Plan
from scenes.effector import EFFECTORS, LEFT_PALM, RIGHT_PALM
from scenes.input_error import InputError

ATOL = 1e-12  # rounding of a few products of rotations and of metres
SINGLE = 1e-6  # configurations are kept as 4-byte floats
angles, shifts = st.floats(-np.pi, np.pi), st.floats(-5.0, 5.0)
poses = st.builds(lambda x, y, z, yaw: plan_pose(np.array([x, y, z]), yaw), shifts, shifts, shifts, angles)
walks = st.builds(
    made_up_plan,
    st.integers(2, 9),
    st.floats(0.15, 0.4),
    noise=st.floats(0.0, 0.04),
    seed=st.integers(0, 1000),
    palms=st.permutations([LEFT_PALM, RIGHT_PALM]).flatmap(lambda p: st.sampled_from([p[:0], p[:1], p])),
    turn=st.floats(0.0, 0.2),
    rise=st.floats(-0.1, 0.1),
)


@pytest.fixture(scope="module")
def stored(strolling_plan: Plan) -> StoredPlan:
    return store_plan(strolling_plan)


def written(plan: StoredPlan, folder: Path) -> Path:
    file = folder / "plan.safetensors"
    file.write_bytes(plan.as_bytes())
    return file


def moved_plan(plan: Plan, X: np.ndarray) -> Plan:
    """The whole plan, contacts and motion, moved as one rigid body."""
    contacts = dataclasses.replace(plan.contacts, X_WC=X @ plan.contacts.X_WC)
    q = plan.motion.q.copy()
    base = Rotation.from_matrix(X[:3, :3]) * Rotation.from_quat(q[:, :4], scalar_first=True)
    q[:, :4] = base.as_quat(scalar_first=True)
    q[:, 4:7] = q[:, 4:7] @ X[:3, :3].T + X[:3, 3]
    return dataclasses.replace(plan, contacts=contacts, motion=dataclasses.replace(plan.motion, q=q))


def base_poses(q: np.ndarray) -> np.ndarray:
    """(N, 4, 4) poses of the floating base."""
    X = np.tile(np.eye(4), (len(q), 1, 1))
    X[:, :3, :3] = Rotation.from_quat(q[:, :4], scalar_first=True).as_matrix()
    X[:, :3, 3] = q[:, 4:7]
    return X


def contact_poses(motion: KeyMotion) -> np.ndarray:
    return np.array([c.X_WC for c in motion.contacts])


# ---- files


@settings(max_examples=20)
@given(walks)
def test_a_file_gives_the_plan_back(tmp_path_factory: pytest.TempPathFactory, plan: StoredPlan) -> None:
    read = read_stored_plan(written(plan, tmp_path_factory.mktemp("plan")))
    for name in ("position", "quaternion", "effector", "first", "distance"):
        np.testing.assert_array_equal(getattr(read.outline, name), getattr(plan.outline, name))
    for name in ("stances", "phases", "phase"):
        np.testing.assert_array_equal(getattr(read, name), getattr(plan, name))
    for name in ("t", "q", "share"):
        np.testing.assert_allclose(getattr(read, name), getattr(plan, name), atol=SINGLE, rtol=SINGLE)
    np.testing.assert_allclose(np.linalg.norm(read.q[:, :4], axis=1), 1.0, atol=ATOL)
    assert (read.name, read.mode, read.facts) == (plan.name, plan.mode, plan.facts)
    assert (read.robot, read.robot_model_sha256) == (plan.robot, plan.robot_model_sha256)


@given(walks)
def test_an_outline_survives_the_index(plan: StoredPlan) -> None:
    back = Outline.from_bytes(plan.outline.as_bytes())
    for field in dataclasses.fields(Outline):
        np.testing.assert_array_equal(getattr(back, field.name), getattr(plan.outline, field.name))


def test_equal_plans_give_equal_bytes() -> None:
    assert len({made_up_plan(seed=3).as_bytes() for _ in range(30)}) == 1


def test_a_file_of_a_whole_crossing_is_small(stored: StoredPlan) -> None:
    assert len(stored.as_bytes()) < 20_000


def test_the_name_is_one_of_the_contacts_alone() -> None:
    plan = made_up_plan(noise=0.02)
    assert dataclasses.replace(plan, q=plan.q + 0.1, facts={}).name == plan.name
    assert made_up_plan(noise=0.02, seed=1).name != plan.name
    assert len(plan.name) == 16
    assert set(plan.name) <= set("0123456789abcdef")


@pytest.mark.parametrize(
    ("palms", "mode"),
    [((), "feet"), ((LEFT_PALM,), "left_palm"), ((RIGHT_PALM,), "right_palm"), ((LEFT_PALM, RIGHT_PALM), "all")],
)
def test_the_mode_says_which_palms_are_used(palms: tuple[int, ...], mode: str) -> None:
    assert made_up_plan(palms=palms).mode == mode


# ---- the frame of a plan


def test_first_feet_are_about_the_origin_and_the_last_ones_straight_ahead(stored: StoredPlan) -> None:
    means = stored.key_motion().feet_means()
    np.testing.assert_allclose(means[0], 0.0, atol=ATOL)
    assert means[-1, 0] > 1.0
    assert means[-1, 1] == pytest.approx(0.0, abs=ATOL)
    assert stored.outline.length == pytest.approx(means[-1, 0])


def test_up_stays_up(stored: StoredPlan, strolling_plan: Plan) -> None:
    normals = contact_poses(stored.key_motion())[:, 2, 2]
    np.testing.assert_allclose(normals, strolling_plan.contacts.X_WC[:, 2, 2], atol=ATOL)


def test_a_plan_laid_back_has_its_old_contacts_and_configurations(stored: StoredPlan, strolling_plan: Plan) -> None:
    motion = key_motion(strolling_plan)
    feet = motion.feet_means()
    ahead = feet[-1] - feet[0]
    back = stored.key_motion().placed(plan_pose(feet[0], np.arctan2(ahead[1], ahead[0])))
    np.testing.assert_allclose(contact_poses(back), strolling_plan.contacts.X_WC, atol=ATOL)
    np.testing.assert_allclose(base_poses(back.q), base_poses(motion.q), atol=ATOL)
    np.testing.assert_array_equal(back.q[:, 7:], motion.q[:, 7:])
    for mine, before in zip(back.contacts, motion.contacts, strict=True):
        assert mine.effector == before.effector
        turn = (mine.heading - before.heading + np.pi) % (2 * np.pi) - np.pi
        assert turn == pytest.approx(0.0, abs=1e-9) or not mine.effector.endswith("_foot")  # a palm's points up


@settings(max_examples=8)
@given(poses)
def test_where_in_the_world_a_plan_was_made_does_not_matter(strolling_plan: Plan, X: np.ndarray) -> None:
    here, there = store_plan(strolling_plan).outline, store_plan(moved_plan(strolling_plan, X)).outline
    np.testing.assert_allclose(there.position, here.position, atol=ATOL * 10)
    same = np.abs((there.quaternion * here.quaternion).sum(axis=1))  # a quaternion and its negative are one turn
    np.testing.assert_allclose(same, 1.0, atol=ATOL)
    np.testing.assert_allclose(there.distance, here.distance, atol=ATOL * 10)
    np.testing.assert_array_equal(there.first, here.first)
    assert distances(here, PlanBatch.of([there]))[0] == pytest.approx(0.0, abs=1e-9)


def test_distances_and_first_appearances_are_those_of_the_stances(strolling_plan: Plan, stored: StoredPlan) -> None:
    outline = stored.outline
    by_hand = made_up_outline(outline.position, outline.effector, stored.stances.tolist(), outline.quaternion)
    np.testing.assert_array_equal(outline.first, by_hand.first)
    points, table = strolling_plan.contacts.X_WC[:, :3, 3], strolling_plan.stances
    begin = (points[table[0, 0], :2] + points[table[0, 1], :2]) / 2
    for row, distance in zip(table, outline.distance, strict=True):
        middle = (points[row[0], :2] + points[row[1], :2]) / 2
        assert distance == pytest.approx(np.hypot(*(middle - begin)))


def test_a_plan_that_leads_nowhere_is_refused(strolling_plan: Plan) -> None:
    poses = strolling_plan.contacts.X_WC.copy()
    poses[:, :3, 3] *= 0.1
    contacts = dataclasses.replace(strolling_plan.contacts, X_WC=poses)
    with pytest.raises(InputError, match=r"expected a plan of 0\.3 m or more, this one leads 0\.\d\d m"):
        store_plan(dataclasses.replace(strolling_plan, contacts=contacts))


def test_contacts_alone_cannot_be_stored(strolling_plan: Plan) -> None:
    with pytest.raises(InputError, match="expected a complete plan"):
        store_plan(dataclasses.replace(strolling_plan, phases=None, centroidal=None, motion=None))


# ---- key motions that are moved


@given(walks, poses, poses)
def test_moving_twice_is_moving_once(plan: StoredPlan, X: np.ndarray, Y: np.ndarray) -> None:
    motion = plan.key_motion()
    twice, once = motion.placed(X).placed(Y), motion.placed(Y @ X)
    np.testing.assert_allclose(contact_poses(twice), contact_poses(once), atol=ATOL * 10)
    np.testing.assert_allclose(base_poses(twice.q), base_poses(once.q), atol=ATOL * 10)


@given(walks, poses)
def test_moving_back_and_not_moving_change_nothing(plan: StoredPlan, X: np.ndarray) -> None:
    motion = plan.key_motion()
    for same in (motion.placed(np.eye(4)), motion.placed(X).placed(np.linalg.inv(X))):
        np.testing.assert_allclose(contact_poses(same), contact_poses(motion), atol=ATOL * 10)
        np.testing.assert_allclose(base_poses(same.q), base_poses(motion.q), atol=ATOL * 10)


@given(walks, poses)
def test_contacts_and_base_move_as_one_body(plan: StoredPlan, X: np.ndarray) -> None:
    motion = plan.key_motion()
    moved = motion.placed(X)
    np.testing.assert_allclose(contact_poses(moved), X @ contact_poses(motion), atol=ATOL * 10)
    np.testing.assert_allclose(base_poses(moved.q), X @ base_poses(motion.q), atol=ATOL * 10)
    np.testing.assert_array_equal(moved.q[:, 7:], motion.q[:, 7:])
    seen_before, seen_after = (  # every contact as the base sees it
        np.linalg.inv(base_poses(m.q))[:, None] @ contact_poses(m) for m in (motion, moved)
    )
    np.testing.assert_allclose(seen_after, seen_before, atol=ATOL * 100)


# ---- key motions that are cut


@settings(max_examples=30)
@given(walks)
def test_a_cut_motion_ends_in_its_stance_and_keeps_the_order(plan: StoredPlan) -> None:
    motion = plan.key_motion()
    for k in range(1, len(motion.stances)):
        cut = motion.until(k)
        np.testing.assert_array_equal(cut.stances, motion.stances[: k + 1])
        np.testing.assert_array_equal(cut.phases[-1], motion.stances[k])
        np.testing.assert_array_equal(cut.phases, motion.phases[: len(cut.phases)])
        assert len(cut.contacts) == 1 + cut.stances.max()
        assert cut.phases.max() < len(cut.contacts)
        assert set(range(len(cut.contacts))) == set(cut.stances.ravel()) - {-1}
        assert cut.contacts == motion.contacts[: len(cut.contacts)]
        assert len(cut.t) == len(cut.q) == len(cut.phase) == len(cut.share)
        assert cut.phase.max() == len(cut.phases) - 1
        np.testing.assert_array_equal(cut.t, motion.t[: len(cut.t)])
        np.testing.assert_array_equal(cut.q, motion.q[: len(cut.t)])


def test_longer_cuts_have_more_and_the_longest_is_the_motion(stored: StoredPlan) -> None:
    motion = stored.key_motion()
    lengths = [len(motion.until(k).t) for k in range(1, len(motion.stances))]
    assert (np.diff(lengths) > 0).all()
    assert motion.until(len(motion.stances) - 1) is motion


def test_a_plan_with_statics_is_cut_where_its_stance_begins_to_carry(stepping_plan: Plan) -> None:
    motion = key_motion(stepping_plan)
    for k in range(1, len(motion.stances)):
        cut = motion.until(k)
        np.testing.assert_array_equal(cut.phases[-1], motion.stances[k])
        assert cut.t[-1] <= motion.t[-1]


@given(st.lists(st.floats(0.0, 4.0), min_size=1, max_size=12))
def test_ends_are_running_records(ahead: list[float]) -> None:
    points = [[x, side, 0.0] for x in (0.0, *ahead) for side in (0.1, -0.1)]
    stances = [[2 * k, 2 * k + 1, -1, -1] for k in range(len(ahead) + 1)]
    outline = made_up_outline(points, [0, 1] * len(stances), stances)
    x = [0.0, *ahead]
    records = [k for k in range(len(x)) if all(x[k] >= x[j] - 1e-6 for j in range(k))]
    assert outline.ends().tolist() == records
    assert outline.length == pytest.approx(max(x))


# ---- damaged files


def refused(data: bytes, folder: Path) -> str:
    """The one line in which these bytes are refused."""
    file = folder / "damaged.safetensors"
    file.write_bytes(data)
    with pytest.raises(InputError) as error:
        read_stored_plan(file)
    line = str(error.value)
    assert str(file) in line
    assert "\n" not in line
    return line


def changed(plan: StoredPlan, about: Mapping[str, object] | None = None, **arrays: np.ndarray | None) -> bytes:
    """The plan's file with other arrays or another description; an array that is None is missing."""
    data = {**load(plan.as_bytes()), **arrays}
    told: dict[str, object] = {
        "format": FORMAT,
        "version": VERSION,
        "robot": "r",
        "robot_model_sha256": "0",
        "facts": {},
    }
    told = {key: value for key, value in {**told, **(about or {})}.items() if value != "missing"}
    text = json.dumps(told)
    if isinstance(told.get("facts"), str):  # as it stands, be it JSON or not
        text = text.replace(json.dumps(told["facts"]), str(told["facts"]))
    return save({name: np.ascontiguousarray(a) for name, a in data.items() if a is not None}, {ABOUT: text})


def test_a_file_cut_anywhere_is_refused(tmp_path: Path) -> None:
    whole = made_up_plan(4, palms=(LEFT_PALM,)).as_bytes()
    for length in range(0, len(whole), 10):
        refused(whole[:length], tmp_path)


@settings(max_examples=50)
@given(st.binary(max_size=200))
def test_random_bytes_are_refused(tmp_path_factory: pytest.TempPathFactory, data: bytes) -> None:
    refused(data, tmp_path_factory.mktemp("noise"))


@settings(max_examples=100)
@given(st.integers(0, 10**6), st.integers(1, 255))
def test_a_changed_byte_makes_another_plan_or_none(
    tmp_path_factory: pytest.TempPathFactory, place: int, change: int
) -> None:
    data = bytearray(made_up_plan(3, nq=9).as_bytes())
    data[place % len(data)] ^= change
    file = tmp_path_factory.mktemp("changed") / "plan.safetensors"
    file.write_bytes(data)
    try:
        plan = read_stored_plan(file)
    except InputError as error:
        assert "\n" not in str(error)  # noqa: PT017  (either outcome is right)
    else:
        assert np.isfinite(plan.q).all()


@pytest.mark.parametrize(
    "about",
    [{"format": "drakeplan-plan"}, {"version": 2}, {"version": "1"}, {"format": None}],
)
def test_another_format_or_version_is_named(tmp_path: Path, about: dict[str, object]) -> None:
    line = refused(changed(made_up_plan(), about), tmp_path)
    assert f"expected {FORMAT} version {VERSION}, got " in line
    assert "damaged stored plan" not in line


@pytest.mark.parametrize("facts", ["", "[", "5", "[1]", '"text"', "null", "missing", "[" * 10**5])
def test_facts_that_are_none_are_refused(tmp_path: Path, facts: str) -> None:
    refused(changed(made_up_plan(), {"facts": facts}), tmp_path)


@pytest.mark.parametrize(
    "name", ["position", "quaternion", "effector", "stances", "phases", "t", "q", "phase", "share"]
)
def test_a_missing_or_empty_table_is_refused(tmp_path: Path, name: str) -> None:
    plan = made_up_plan()
    refused(changed(plan, **{name: None}), tmp_path)
    table = load(plan.as_bytes())[name]
    refused(changed(plan, **{name: table[:0]}), tmp_path)
    if name != "stances":  # a stance less is another plan
        refused(changed(plan, **{name: table[:-1]}), tmp_path)
    refused(changed(plan, **{name: table.reshape(-1)[:1].reshape(())}), tmp_path)


@pytest.mark.parametrize("name", ["position", "quaternion", "t", "q", "share"])
@pytest.mark.parametrize("value", [np.nan, np.inf])
def test_a_number_that_is_none_is_refused(tmp_path: Path, name: str, value: float) -> None:
    table = load(made_up_plan().as_bytes())[name].copy()
    table.flat[-1] = value
    refused(changed(made_up_plan(), **{name: table}), tmp_path)


@pytest.mark.parametrize(("name", "value"), [("stances", 99), ("phases", 99), ("phase", 99), ("effector", 4)])
def test_an_index_that_names_nothing_is_refused(tmp_path: Path, name: str, value: int) -> None:
    table = load(made_up_plan().as_bytes())[name].copy()
    for wrong in (value, -2):
        table.flat[-1] = wrong
        refused(changed(made_up_plan(), **{name: table}), tmp_path)


def test_a_stance_without_a_foot_is_refused(tmp_path: Path) -> None:
    table = load(made_up_plan().as_bytes())["stances"].copy()
    table[2, 1] = -1
    refused(changed(made_up_plan(), stances=table), tmp_path)


def test_a_right_foot_in_the_place_of_the_left_one_is_refused(tmp_path: Path) -> None:
    table = load(made_up_plan().as_bytes())["stances"].copy()
    table[0] = table[0][[1, 0, 2, 3]]
    refused(changed(made_up_plan(), stances=table), tmp_path)


def test_time_that_stands_still_is_refused(tmp_path: Path) -> None:
    t = load(made_up_plan().as_bytes())["t"].copy()
    t[3] = t[2]
    refused(changed(made_up_plan(), t=t), tmp_path)


def test_contact_points_in_the_plane_are_refused(tmp_path: Path) -> None:
    refused(changed(made_up_plan(), position=made_up_plan().outline.position[:, :2]), tmp_path)


@pytest.mark.filterwarnings("ignore:invalid value")
@pytest.mark.parametrize("name", ["quaternion", "q"])
def test_a_turn_of_no_length_is_refused(tmp_path: Path, name: str) -> None:
    table = load(made_up_plan().as_bytes())[name].copy()
    table[-1, :4] = 0.0
    refused(changed(made_up_plan(), **{name: table}), tmp_path)


def test_a_file_that_is_not_there_is_said_to_be_missing(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="no such stored plan"):
        read_stored_plan(tmp_path / "none.safetensors")
    with pytest.raises(InputError):
        read_stored_plan(tmp_path)


def test_a_file_far_too_large_is_not_read(tmp_path: Path) -> None:
    assert "at most" in refused(bytes(MAX_BYTES + 1), tmp_path)


def test_every_contact_is_of_a_known_end_effector(stored: StoredPlan) -> None:
    assert [c.effector for c in stored.key_motion().contacts] == [EFFECTORS[e] for e in stored.outline.effector]
