"""A library of plans: what it leaves out, how it groups the rest, and that nothing which happens to its files loses a plan."""

from __future__ import annotations

import dataclasses
import json
import os
import shutil
import signal
import sqlite3
import subprocess
import sys
import time
from collections.abc import Iterable
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from made_up_plans import made_up_plan

import drakeplan.experience.library as library_module
from drakeplan.experience.library import FARTHEST, INDEX, MANIFEST, NEAREST, PLANS, Entry, Library, clusters
from drakeplan.experience.plan_distance import PlanBatch, distances
from drakeplan.experience.stored_plan import MODES, SUFFIX, StoredPlan, store_plan
from drakeplan.plan.plan import Plan
from scenes.effector import LEFT_PALM, RIGHT_PALM
from scenes.input_error import InputError
from scenes.robots.robot import Robot, load_robot

HERE = str(Path(__file__).parent)
ATOL = 1e-9  # rounding of a sum of some dozen squares [m^2]
ROBOT = load_robot("escher")


def walk(
    steps: int = 6, stride: float = 0.25, noise: float = 0.0, seed: int = 0, palms: tuple[int, ...] = ()
) -> StoredPlan:
    """A plan of the robot."""
    return made_up_plan(steps, stride, noise=noise, seed=seed, palms=palms, model=ROBOT.model_sha256)


def different(count: int, first: int = 0) -> list[StoredPlan]:
    """Walks of which each leads further than the one before by more than what makes two plans the same."""
    return [walk(6, 0.2 + 0.025 * k) for k in range(first, first + count)]


def apart(a: StoredPlan | Entry, b: StoredPlan | Entry) -> float:
    return float(distances(a.outline, PlanBatch.of([b.outline]))[0])


def groups_of(library: Library) -> list[list[Entry]]:
    """The plans of each cluster of each mode."""
    entries = library.entries()
    keys = dict.fromkeys((e.mode, e.cluster) for e in entries)
    return [[e for e in entries if (e.mode, e.cluster) == key] for key in keys]


def require_sound(library: Library) -> None:
    """What holds of every library: no two plans nearly the same, no cluster too wide, and sums that are right."""
    for group in groups_of(library):
        far = np.array([[apart(a, b) for b in group] for a in group])
        assert far.max() <= FARTHEST
        np.testing.assert_allclose([e.squares for e in group], (far**2).sum(axis=1), atol=ATOL)
    for mode in MODES:
        entries = library.entries(mode)
        near = [apart(a, b) for k, a in enumerate(entries) for b in entries[:k]]
        assert min(near, default=np.inf) >= NEAREST
    for e in library.entries():
        plan = library.plan(e.name)
        assert (plan.name, plan.mode) == (e.name, e.mode)
        assert plan.outline.length == e.length


def names(plans: Iterable[StoredPlan | Entry]) -> set[str]:
    return {plan.name for plan in plans}


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """A library of four plans."""
    with Library.create(tmp_path / "library", ROBOT) as library:
        for plan in different(4):
            assert library.add(plan).added
    return tmp_path / "library"


# ---- what is added


def test_a_new_library_is_empty(tmp_path: Path) -> None:
    library = Library.create(tmp_path / "new", ROBOT, {"scenes": 3})
    assert len(library) == 0
    assert library.entries() == library.entries("feet") == clusters([]) == library.notes == []
    assert (library.robot, library.facts) == ("escher", {"scenes": 3})
    first = library.add(walk())
    assert (first.added, first.distance, first.cluster) == (True, np.inf, 0)
    assert len(Library(tmp_path / "new")) == 1


def test_a_plan_nearly_the_same_is_left_out(folder: Path) -> None:
    library, plan = Library(folder), walk(6, 0.205)
    nearest = min(library.entries(), key=lambda e: apart(plan, e))
    assert 0.0 < apart(plan, nearest) < NEAREST
    addition = library.add(plan)
    assert (addition.added, addition.name, addition.cluster) == (False, nearest.name, -1)
    assert addition.distance == apart(plan, nearest)
    assert len(library) == len(list((folder / PLANS).iterdir())) == 4


def test_plans_of_different_modes_never_are_the_same(tmp_path: Path) -> None:
    library = Library.create(tmp_path / "modes", ROBOT)
    for palms in ((), (LEFT_PALM,), (RIGHT_PALM,), (LEFT_PALM, RIGHT_PALM)):
        assert library.add(walk(palms=palms)).distance == np.inf
    assert [len(library.entries(mode)) for mode in MODES] == [1, 1, 1, 1]
    assert {e.cluster for e in library.entries()} == {0}


def test_what_is_added_is_what_comes_back(tmp_path: Path, strolling_plan: Plan) -> None:
    stored, library = store_plan(strolling_plan), Library.create(tmp_path / "one", ROBOT)
    assert library.add(stored).added
    assert library.plan(stored.name).facts == stored.facts
    (entry,) = library.entries()
    for field in dataclasses.fields(entry.outline):
        np.testing.assert_array_equal(getattr(entry.outline, field.name), getattr(stored.outline, field.name))
    require_sound(library)


@settings(max_examples=12)
@given(
    st.lists(
        st.tuples(st.integers(2, 7), st.floats(0.15, 0.4), st.integers(0, 99), st.booleans()), min_size=2, max_size=12
    )
)
def test_clusters_are_narrow_and_their_sums_right_after_any_additions(
    tmp_path_factory: pytest.TempPathFactory, walks: list[tuple[int, float, int, bool]]
) -> None:
    library, kept = Library.create(tmp_path_factory.mktemp("any") / "library", ROBOT), []
    members: dict[tuple[str, int], list[StoredPlan]] = {}  # the rule of joining, the slow way
    for steps, stride, seed, palm in walks:
        plan = walk(steps, stride, 0.03, seed, (LEFT_PALM,) if palm else ())
        near = [known for known in kept if apart(plan, known) < NEAREST]
        addition = library.add(plan)
        assert addition.added == (not near)
        if near:
            assert addition.name in names(near)
            continue
        kept.append(plan)
        open_to = {
            key: max(group, key=lambda g: -sum(apart(g, other) ** 2 for other in group))
            for key, group in members.items()
            if key[0] == plan.mode and max(apart(plan, g) for g in group) <= FARTHEST
        }
        if open_to:
            assert (
                apart(plan, open_to[plan.mode, addition.cluster])
                <= min(apart(plan, r) for r in open_to.values()) + ATOL
            )
        else:
            assert (plan.mode, addition.cluster) not in members
        members.setdefault((plan.mode, addition.cluster), []).append(plan)
    require_sound(library)
    assert [e.name for e in library.entries()] == [plan.name for plan in kept]


def test_the_representative_has_the_least_squares(tmp_path: Path) -> None:
    library = Library.create(tmp_path / "three", ROBOT)
    for k in (0, 2, 1):  # the middle one is nearest to both others
        library.add(walk(5, 0.2 + 0.025 * k))
    assert clusters(library.entries()) == [[2, 0, 1]]


def test_every_plan_is_in_one_cluster(tmp_path: Path) -> None:
    library = Library.create(tmp_path / "many", ROBOT)
    for plan in different(10):
        library.add(plan)
    groups = clusters(library.entries())
    assert len(groups) > 1
    assert sorted(k for group in groups for k in group) == list(range(len(library)))


# ---- files and index


def test_a_file_without_a_row_is_adopted(folder: Path) -> None:
    plan = walk(9, 0.3)
    (folder / PLANS / f"{plan.name}{SUFFIX}").write_bytes(plan.as_bytes())
    library = Library(folder)
    assert plan.name in names(library.entries())
    assert len(library) == 5
    assert library.notes == []
    require_sound(library)


def test_a_deleted_index_is_made_again(folder: Path) -> None:
    before = names(Library(folder).entries())
    (folder / INDEX).unlink()
    library = Library(folder)
    assert names(library.entries()) == before
    require_sound(library)


def test_a_damaged_index_is_refused_in_one_line(folder: Path) -> None:
    (folder / INDEX).write_bytes(b"no index" * 1000)
    with pytest.raises(InputError, match=r"damaged index .* delete it, and it is made again from the plans"):
        Library(folder)


def test_a_row_without_a_file_is_noted_and_dropped(folder: Path) -> None:
    gone = different(4)[1]
    (folder / PLANS / f"{gone.name}{SUFFIX}").unlink()
    library = Library(folder)
    assert [gone.name in note for note in library.notes] == [True]
    assert names(library.entries()) == names(different(4)) - {gone.name}
    assert Library(folder).notes == []


def test_the_sums_are_right_after_a_plan_is_gone(folder: Path) -> None:
    (folder / PLANS / f"{different(4)[1].name}{SUFFIX}").unlink()
    require_sound(Library(folder))


def test_a_damaged_file_is_noted_and_the_others_are_usable(folder: Path) -> None:
    (folder / PLANS / f"{'0' * 16}{SUFFIX}").write_bytes(walk(9, 0.3).as_bytes()[:-1])
    library = Library(folder)
    assert ["0" * 16 in note and "damaged" in note and "\n" not in note for note in library.notes] == [True]
    assert len(library) == 4
    require_sound(library)
    assert library.add(walk(9, 0.3)).added


def test_a_file_damaged_after_it_was_added_is_refused_in_one_line(folder: Path) -> None:
    bad, *good = different(4)
    (folder / PLANS / f"{bad.name}{SUFFIX}").write_bytes(b"")
    library = Library(folder)
    with pytest.raises(InputError, match=bad.name):
        library.plan(bad.name)
    assert [library.plan(plan.name).name for plan in good] == [plan.name for plan in good]


def test_a_plan_under_another_file_name_is_left_out_and_its_name_is_said(folder: Path) -> None:
    plan = walk(9, 0.3)
    (folder / PLANS / f"mine{SUFFIX}").write_bytes(plan.as_bytes())
    for _ in range(2):
        with Library(folder) as library:
            assert len(library) == 4
            for entry in library.entries():
                library.plan(entry.name)
            assert [plan.name in note for note in library.notes] == [True]


def test_two_files_of_one_plan_are_one_plan(folder: Path) -> None:
    for k, file in enumerate(sorted((folder / PLANS).iterdir())):
        shutil.copy(file, file.with_name(f"copy_{k}{SUFFIX}"))
    for _ in range(2):
        library = Library(folder)
        assert names(library.entries()) == names(different(4))
        require_sound(library)
        library.close()


def test_other_files_beside_the_plans_do_not_matter(folder: Path) -> None:
    (folder / PLANS / "notes.txt").write_text("nothing")
    (folder / PLANS / f".x{SUFFIX}.0a1b2c3d.tmp").write_bytes(b"half a fi")
    library = Library(folder)
    assert len(library) == 4
    assert library.notes == []


# ---- whose library


def other_robot() -> Robot:
    return dataclasses.replace(ROBOT, name="other", model_sha256="1" * 64)


def test_another_robot_is_refused(folder: Path) -> None:
    with pytest.raises(InputError, match="a library of robot 'escher' with another model: plans of 'other' need one"):
        Library(folder, other_robot())
    with pytest.raises(InputError, match="a library of robot 'escher'"):
        Library.create(folder, other_robot())
    assert len(Library(folder, ROBOT)) == 4


def test_a_plan_of_another_robot_is_refused(folder: Path) -> None:
    library = Library(folder)
    with pytest.raises(InputError, match="a library of robot 'escher', this plan is one of"):
        library.add(made_up_plan(9, 0.3))
    assert len(library) == 4


def test_a_file_of_another_robots_plan_is_noted_and_left_out(folder: Path) -> None:
    plan = made_up_plan(9, 0.3)
    (folder / PLANS / f"{plan.name}{SUFFIX}").write_bytes(plan.as_bytes())
    library = Library(folder)
    assert len(library) == 4
    assert [plan.name in note for note in library.notes] == [True]


@pytest.mark.parametrize("change", [{"version": 2}, {"format": "drakeplan-plan"}, {"version": 2, "d_min": "none"}])
def test_another_version_or_format_is_named(folder: Path, change: dict[str, object]) -> None:
    manifest = json.loads((folder / MANIFEST).read_text())
    (folder / MANIFEST).write_text(json.dumps({**manifest, **change}))
    with pytest.raises(InputError, match="expected drakeplan-library version 1, got drakeplan-"):
        Library(folder)


@pytest.mark.parametrize(
    "text", ["", "{}", "[]", "5", '{"format": "drakeplan-library", "version": 1}', "\udc80", "[" * 10**5]
)
def test_a_manifest_that_is_none_is_refused(folder: Path, text: str) -> None:
    (folder / MANIFEST).write_bytes(text.encode("utf-8", "surrogateescape"))
    with pytest.raises(InputError, match="expected the description of a library"):
        Library(folder)


def test_where_no_library_is_that_is_said(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=f"no library there: {MANIFEST} is missing"):
        Library(tmp_path)
    (tmp_path / "file").write_text("")
    with pytest.raises(InputError):
        Library(tmp_path / "file")
    with pytest.raises(InputError, match="cannot be made a folder"):
        Library.create(tmp_path / "file", ROBOT)


def test_facts_are_added_and_the_rest_of_the_manifest_stays(folder: Path) -> None:
    manifest = {**json.loads((folder / MANIFEST).read_text()), "d_min": 0.02, "facts": {"a": 1}}
    (folder / MANIFEST).write_text(json.dumps(manifest))
    Library(folder).note({"b": 2})
    assert json.loads((folder / MANIFEST).read_text()) == {**manifest, "facts": {"a": 1, "b": 2}}


# ---- a folder that cannot be written


def read_only(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(os, "access", lambda path, mode, **_: not mode & os.W_OK)


@pytest.mark.parametrize("indexed", [True, False])
def test_a_library_that_cannot_be_written_is_usable(
    folder: Path, monkeypatch: pytest.MonkeyPatch, indexed: bool
) -> None:
    if not indexed:
        (folder / INDEX).unlink()
    unknown = walk(9, 0.3)
    (folder / PLANS / f"{unknown.name}{SUFFIX}").write_bytes(unknown.as_bytes())
    read_only(monkeypatch)
    files = {path: path.read_bytes() for path in folder.rglob("*") if path.is_file()}
    library = Library(folder, ROBOT)
    assert names(library.entries()) == names([*different(4), unknown])
    require_sound(library)
    with pytest.raises(InputError, match="cannot be written: copy the library, or name another with --library"):
        library.add(walk(3, 0.4))
    with pytest.raises(InputError, match="cannot be written"):
        library.note({"a": 1})
    assert len(library) == 5
    assert {path: path.read_bytes() for path in folder.rglob("*") if path.is_file()} == files


# ---- several processes


def start(code: str, *arguments: str) -> subprocess.Popen[str]:
    """A Python process that knows the plans and functions of this file's helper."""
    lines = (
        f"import os, signal, sys, time; sys.path.insert(0, {HERE!r})\n"
        "from made_up_plans import made_up_plan\n"
        "import drakeplan.experience.library as module\n"
        "from drakeplan.experience.library import Library\n"
        f"walk = lambda k: made_up_plan(6, 0.2 + 0.025 * k, model={ROBOT.model_sha256!r})\n"
        f"{code}"
    )
    return subprocess.Popen([sys.executable, "-c", lines, *arguments], stdout=subprocess.PIPE, text=True)


ADD_AT_ONCE = """
folder, first = sys.argv[1], int(sys.argv[2])
plans = [walk(k) for k in range(first, first + 8)]
library = Library(folder)
print("ready", flush=True)
while not os.path.exists(folder + "/go"):
    time.sleep(0.001)
print(*[library.add(plan).added for plan in plans])
"""


def test_processes_that_add_at_once_lose_none_and_store_none_twice(tmp_path: Path) -> None:
    folder = tmp_path / "shared"
    Library.create(folder, ROBOT).close()
    both = [start(ADD_AT_ONCE, str(folder), first) for first in ("0", "4")]  # plans 4 to 7 are added by both
    for process in both:
        assert process.stdout is not None
        assert process.stdout.readline() == "ready\n"
    (folder / "go").touch()
    said = [process.communicate(timeout=60)[0] for process in both]
    assert [process.returncode for process in both] == [0, 0]
    assert sum(line.count("True") for line in said) == 12
    library = Library(folder)
    assert library.notes == []
    assert names(library.entries()) == names(different(12))
    assert sorted(file.name for file in (folder / PLANS).iterdir()) == sorted(
        f"{n}{SUFFIX}" for n in names(different(12))
    )
    require_sound(library)


def test_a_library_opened_between_file_and_row_takes_nothing_away(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Whoever opens a library adopts the file that another process has just written and is about to enter."""
    write, plan = library_module.write_whole, walk(9, 0.3)

    def write_and_be_overtaken(path: Path, content: bytes) -> None:
        write(path, content)
        Library(folder).close()

    library = Library(folder)
    monkeypatch.setattr(library_module, "write_whole", write_and_be_overtaken)
    library.add(plan)
    monkeypatch.undo()
    again = Library(folder)
    assert again.notes == []
    assert again.plan(plan.name).name == plan.name


DIE = """
folder, when = sys.argv[1:]
library, write = Library(folder), module.write_whole
die = lambda *_: os.kill(os.getpid(), signal.SIGKILL)
library.add(walk(4))
if when == "before the file":
    module.write_whole = die
elif when == "before the row":
    module.write_whole = lambda path, content: (write(path, content), die())
elif when == "before the row is committed":
    library._index.set_trace_callback(lambda statement: statement.startswith("COMMIT") and die())
elif when == "while the others are updated":
    library._index.set_trace_callback(lambda statement: statement.startswith("UPDATE") and die())
library.add(walk(5))
"""


@pytest.mark.parametrize(
    ("when", "kept"),
    [
        ("before the file", 5),
        ("before the row", 6),
        ("before the row is committed", 6),
        ("while the others are updated", 6),
    ],
)
def test_a_process_killed_while_it_adds_leaves_every_whole_plan(folder: Path, when: str, kept: int) -> None:
    process = start(DIE, str(folder), when)
    process.communicate(timeout=60)
    assert process.returncode == -signal.SIGKILL
    files = {file.name.removesuffix(SUFFIX) for file in (folder / PLANS).glob(f"*{SUFFIX}")}
    library = Library(folder)
    assert library.notes == []
    assert names(library.entries()) == files == names(different(kept))
    require_sound(library)


ADD_FOR_EVER = """
library = Library(sys.argv[1])
print("ready", flush=True)
for k in range(4, 1000):
    library.add(walk(k))
"""


def test_a_process_killed_at_any_moment_leaves_every_whole_plan(folder: Path) -> None:
    process = start(ADD_FOR_EVER, str(folder))
    assert process.stdout is not None
    assert process.stdout.readline() == "ready\n"
    time.sleep(0.05)
    process.kill()
    process.communicate(timeout=60)
    files = {file.name.removesuffix(SUFFIX) for file in (folder / PLANS).glob(f"*{SUFFIX}")}
    library = Library(folder)
    assert library.notes == []
    assert names(library.entries()) == files
    require_sound(library)


def test_a_library_that_another_process_holds_is_waited_for(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(library_module, "PATIENCE", 0.05)
    library, holder = Library(folder), sqlite3.connect(folder / INDEX, isolation_level=None)
    holder.execute("BEGIN IMMEDIATE")
    with pytest.raises(InputError, match=r"another process has been writing for 0\.05 s"):
        library.add(walk(9, 0.3))
    assert len(library) == 4  # reading goes on
    holder.execute("ROLLBACK")
    holder.close()
    again = Library(folder)  # the file is there and gets its row
    assert walk(9, 0.3).name in names(again.entries())
