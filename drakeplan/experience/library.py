"""A library of plans on disk: one file each, and an index that retrieval reads.

    DIR/library.json       format, version, robot, thresholds, and how it was made
    DIR/plans/NAME.safetensors
    DIR/index.sqlite       a row for each plan: mode, length, cluster, contacts

The files are the truth. A file is written whole before its row, rows are added in one transaction, and files without a row
get one when the library is opened to be written: any number of processes may add plans at any time, and a process that is
killed loses none.

Plans whose contacts are within `d_min` of a stored one are not added (Lin 2020 sec. 4.4, algorithm 2). A plan joins the cluster
whose representative is nearest among those in which no plan is farther from it than `d_max`; where there is none it begins a
cluster. So no pair in a cluster is ever farther apart than `d_max`, which is what the documented loop over K comes to, and a new
plan costs its distances from the others alone. The representative has the least sum of squared distances (sec. 4.4.2).
"""

from __future__ import annotations

import contextlib
import json
import os
import sqlite3
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from drakeplan.experience.plan_distance import PlanBatch, distances
from drakeplan.experience.stored_plan import MODES, SUFFIX, Outline, StoredPlan, read_stored_plan
from scenes.files.whole_file import write_whole
from scenes.input_error import InputError
from scenes.robots.robot import Robot

FORMAT, VERSION = "drakeplan-library", 1
MANIFEST, PLANS, INDEX = "library.json", "plans", "index.sqlite"
NEAREST, FARTHEST = 0.1, 0.5  # [m] d_min and d_max (Lin 2020 sec. 4.6)
PATIENCE = 60.0  # [s] to wait for another process that writes
TABLE = """CREATE TABLE IF NOT EXISTS plan (
    number INTEGER PRIMARY KEY AUTOINCREMENT, name TEXT UNIQUE NOT NULL, mode TEXT NOT NULL, length REAL NOT NULL,
    stances INTEGER NOT NULL, cluster INTEGER NOT NULL, squares REAL NOT NULL, outline BLOB NOT NULL)"""


@dataclass(frozen=True, eq=False)
class Entry:
    """A row of the index.

    Attributes:
        number: in the order of addition, from 1.
        name: of the plan.
        mode: its motion mode.
        length: how far it leads [m].
        cluster: of plans of this mode.
        squares: sum of its squared distances from the others in its cluster [m^2].
        outline: its contacts.
    """

    number: int
    name: str
    mode: str
    length: float
    cluster: int
    squares: float
    outline: Outline


@dataclass(frozen=True)
class Addition:
    """What became of a plan that was to be added.

    Attributes:
        added: whether it is new to the library.
        name: of the plan; of the nearest one where it was not added.
        distance: from the nearest plan of its mode [m]; infinite for the first.
        cluster: that it joined; -1 where it was not added.
    """

    added: bool
    name: str
    distance: float
    cluster: int


class Library:
    """Stored plans of one robot.

    Attributes:
        path: of the folder.
        robot: name of the robot.
        robot_model_sha256: hash of its model file.
        facts: how it was made, from its manifest.
        notes: files that are damaged and were left out, one line each.
    """

    def __init__(self, path: str | Path, robot: Robot | None = None) -> None:
        """Opens a library.

        Args:
            path: the folder.
            robot: who shall use it; None for whoever it belongs to.

        Raises:
            InputError: no such library, another version, or that of another robot.
        """
        self.path, self.notes = Path(path), []
        self._read_manifest()
        if robot is not None and robot.model_sha256 != self.robot_model_sha256:
            raise InputError(
                f"{path}: a library of robot {self.robot!r} with another model: plans of {robot.name!r} need one of "
                "their own, drakeplan library build --robot makes it"
            )
        self._writable = os.access(self.path, os.W_OK) and os.access(self.path / PLANS, os.W_OK)
        self._index = self._open_index()

    @staticmethod
    def is_at(path: str | Path) -> bool:
        """Whether a library is there."""
        try:
            return (Path(path) / MANIFEST).exists()
        except OSError:  # a name that no file can have
            return False

    @staticmethod
    def create(path: str | Path, robot: Robot, facts: dict[str, object] | None = None) -> Library:
        """Makes an empty library in a folder that is new or empty; opens the one that is there.

        Args:
            path: the folder.
            robot: whose plans it will hold.
            facts: how it is made, for the manifest of a new one.
        """
        path = Path(path)
        if not Library.is_at(path):
            try:
                (path / PLANS).mkdir(parents=True, exist_ok=True)
            except OSError as error:
                raise InputError(f"{path}: cannot be made a folder ({error.strerror or error})") from None
            _write_manifest(path, robot.name, robot.model_sha256, facts or {})
        return Library(path, robot)

    def __len__(self) -> int:
        return int(self._index.execute("SELECT count(*) FROM plan").fetchone()[0])

    def __enter__(self) -> Library:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Closes the index."""
        self._index.close()

    def entries(self, mode: str | None = None) -> list[Entry]:
        """The rows of the index, in the order of addition.

        Args:
            mode: of `MODES`; None for all.
        """
        where, what = ("WHERE mode = ?", (mode,)) if mode else ("", ())
        rows = self._index.execute(
            f"SELECT number, name, mode, length, cluster, squares, outline FROM plan {where} ORDER BY number", what
        ).fetchall()
        return [
            Entry(number, name, kind, length, cluster, squares, Outline.from_bytes(outline))
            for number, name, kind, length, cluster, squares, outline in rows
        ]

    def plan(self, name: str) -> StoredPlan:
        """The plan of this name.

        Raises:
            InputError: its file is missing or damaged.
        """
        return read_stored_plan(self._file(name))

    def add(self, plan: StoredPlan) -> Addition:
        """Adds a plan, unless one is stored that is nearly the same.

        Args:
            plan: of this library's robot.

        Raises:
            InputError: another robot's plan, or a library that cannot be written.
        """
        if plan.robot_model_sha256 != self.robot_model_sha256:
            raise InputError(f"{self.path}: a library of robot {self.robot!r}, this plan is one of {plan.robot!r}")
        if not self._writable:
            raise InputError(f"{self.path}: cannot be written: copy the library, or name another with --library")
        known = self._nearest(plan)
        if known is not None and known.distance < self._d_min:
            return known
        file, there = self._file(plan.name), self._file(plan.name).exists()
        write_whole(file, plan.as_bytes())
        addition = self._enter(plan)
        if not (
            addition.added or there or addition.name == plan.name
        ):  # another process added one that is nearly the same
            file.unlink(missing_ok=True)
        return addition

    def note(self, facts: dict[str, object]) -> None:
        """Writes in the manifest how the plans were made.

        Args:
            facts: must fit JSON.
        """
        self.facts = {**self.facts, **facts}
        _write_manifest(self.path, self.robot, self.robot_model_sha256, self.facts, (self._d_min, self._d_max))

    # Index -----------------------------------------------------------------------------------------------------------

    def _enter(self, plan: StoredPlan) -> Addition:
        """Adds the row of a plan whose file is there, in one transaction."""
        with self._transaction():
            entries = self.entries(plan.mode)
            away = distances(plan.outline, PlanBatch.of([e.outline for e in entries]))
            if len(entries) and away.min() < self._d_min:
                k = int(np.argmin(away))
                return Addition(False, entries[k].name, float(away[k]), -1)
            cluster, members = _cluster_of(entries, away, self._d_max)
            squares = float((away[members] ** 2).sum())
            for k in members:
                self._index.execute(
                    "UPDATE plan SET squares = squares + ? WHERE number = ?", (float(away[k] ** 2), entries[k].number)
                )
            outline = plan.outline
            self._index.execute(
                "INSERT INTO plan (name, mode, length, stances, cluster, squares, outline) VALUES (?, ?, ?, ?, ?, ?, ?)",
                (plan.name, plan.mode, outline.length, len(outline.distance), cluster, squares, outline.as_bytes()),
            )
            return Addition(True, plan.name, float(away.min()) if len(away) else float("inf"), cluster)

    def _nearest(self, plan: StoredPlan) -> Addition | None:
        entries = self.entries(plan.mode)
        if not entries:
            return None
        away = distances(plan.outline, PlanBatch.of([e.outline for e in entries]))
        k = int(np.argmin(away))
        return Addition(False, entries[k].name, float(away[k]), -1)

    @contextlib.contextmanager
    def _transaction(self) -> Iterator[None]:
        try:
            self._index.execute("BEGIN IMMEDIATE")
        except sqlite3.OperationalError as error:
            raise InputError(
                f"{self.path / INDEX}: another process has been writing for {PATIENCE:g} s ({error})"
            ) from None
        try:
            yield
        except BaseException:
            self._index.execute("ROLLBACK")
            raise
        self._index.execute("COMMIT")

    def _open_index(self) -> sqlite3.Connection:
        """The index; what is missing in it is added, in memory where the folder cannot be written."""
        file = self.path / INDEX
        try:
            if self._writable:
                index = sqlite3.connect(file, timeout=PATIENCE, isolation_level=None)
                index.execute(TABLE)
            else:
                index = sqlite3.connect(":memory:", isolation_level=None)
                if file.exists():
                    with contextlib.closing(
                        sqlite3.connect(f"{file.resolve().as_uri()}?immutable=1", uri=True)
                    ) as kept:
                        kept.backup(index)
                index.execute(TABLE)
            known = {name for (name,) in index.execute("SELECT name FROM plan")}
        except sqlite3.DatabaseError as error:
            raise InputError(
                f"{file}: damaged index ({error}): delete it, and it is made again from the plans"
            ) from None
        self._index = index
        there = {path.name.removesuffix(SUFFIX) for path in (self.path / PLANS).glob(f"*{SUFFIX}")}
        for name in sorted(known - there):
            self.notes.append(f"{self._file(name)}: no such file, though the index names it: left out")
            self._forget(name)
        for name in sorted(there - known):
            self._adopt(name)
        return index

    def _adopt(self, name: str) -> None:
        """Gives a file that has no row one; says why where it cannot."""
        try:
            plan = read_stored_plan(self._file(name))
        except InputError as error:
            self.notes.append(f"{error}: left out")
            return
        if plan.robot_model_sha256 != self.robot_model_sha256:
            self.notes.append(f"{self._file(name)}: a plan of another robot ({plan.robot}): left out")
        elif plan.name != name:
            self.notes.append(f"{self._file(name)}: its contacts ask for the name {plan.name}: left out")
        else:
            self._enter(plan)

    def _forget(self, name: str) -> None:
        """Takes a row out, and its distances out of the sums of its cluster."""
        with self._transaction():
            gone = next((entry for entry in self.entries() if entry.name == name), None)
            if gone is None:  # another process was faster
                return
            self._index.execute("DELETE FROM plan WHERE name = ?", (name,))
            rest = [entry for entry in self.entries(gone.mode) if entry.cluster == gone.cluster]
            batch = PlanBatch.of([entry.outline for entry in rest])
            for entry in rest:
                squares = float((distances(entry.outline, batch) ** 2).sum())
                self._index.execute("UPDATE plan SET squares = ? WHERE number = ?", (squares, entry.number))

    def _file(self, name: str) -> Path:
        return self.path / PLANS / f"{name}{SUFFIX}"

    def _read_manifest(self) -> None:
        file = self.path / MANIFEST
        try:
            about = json.loads(file.read_text(encoding="utf-8"))
            found = about["format"], about["version"]
        except FileNotFoundError:
            raise InputError(f"{self.path}: no library there: {MANIFEST} is missing") from None
        except (OSError, ValueError, KeyError, TypeError, RecursionError) as error:
            raise InputError(f"{file}: expected the description of a library ({error})") from None
        if found != (FORMAT, VERSION):
            raise InputError(f"{file}: expected {FORMAT} version {VERSION}, got {found[0]} version {found[1]}")
        try:
            self.robot, self.robot_model_sha256 = str(about["robot"]), str(about["robot_model_sha256"])
            self._d_min, self._d_max = float(about["d_min"]), float(about["d_max"])
            self.facts: dict[str, object] = dict(about["facts"])
        except (ValueError, KeyError, TypeError) as error:
            raise InputError(f"{file}: expected the description of a library ({error})") from None


def _write_manifest(
    path: Path,
    robot: str,
    robot_model_sha256: str,
    facts: dict[str, object],
    thresholds: tuple[float, float] = (NEAREST, FARTHEST),
) -> None:
    about = {
        "format": FORMAT,
        "version": VERSION,
        "robot": robot,
        "robot_model_sha256": robot_model_sha256,
        "d_min": thresholds[0],
        "d_max": thresholds[1],
        "facts": facts,
    }
    write_whole(path / MANIFEST, (json.dumps(about, indent=2) + "\n").encode())


def _cluster_of(entries: list[Entry], away: np.ndarray, d_max: float) -> tuple[int, list[int]]:
    """The cluster that a plan joins, and its members by index.

    Args:
        entries: all plans of its mode.
        away: (M,) their distances from it [m].
        d_max: greatest distance within a cluster [m].
    """
    members: dict[int, list[int]] = {}
    for k, entry in enumerate(entries):
        members.setdefault(entry.cluster, []).append(k)
    near = {c: own for c, own in members.items() if away[own].max() <= d_max}
    if not near:
        return 1 + max(members, default=-1), []

    def from_representative(cluster: int) -> tuple[float, int]:
        return float(away[min(near[cluster], key=lambda k: (entries[k].squares, k))]), cluster

    best = min(near, key=from_representative)
    return best, near[best]


def clusters(entries: list[Entry]) -> list[list[int]]:
    """The members of each cluster by index, its representative first: the plan of least squared distances."""
    members: dict[int, list[int]] = {}
    for k, entry in enumerate(entries):
        members.setdefault(entry.cluster, []).append(k)
    found = []
    for own in members.values():
        representative = min(own, key=lambda k: (entries[k].squares, k))
        found.append([representative, *(k for k in own if k != representative)])
    return found


__all__ = ["MODES", "Addition", "Entry", "Library", "clusters"]
