"""Balance against hpp-centroidal-dynamics (C++) for speed, in turn in one process, and against HiGHS for the verdicts.

Both sides get the same corner points, normals, friction and friction cones: hpp's pyramids with 4 and 8 edges are the
cones `square` and `inner` in the frame that it makes of a normal. It knows no force limits, so ours are out of reach.
A short trial asks the library in every way that it offers (three linear programs, two solvers, with and without a warm
start, and the polytope projection); of those that answer as we do the fastest for each task is timed.

hpp's shared libraries must be on LD_LIBRARY_PATH before a process starts, and it writes to standard output: so the
speeds are measured in a process of their own.
"""

from __future__ import annotations

import importlib.util
import itertools
import json
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from types import ModuleType
from typing import Protocol

import numpy as np
from numba import njit
from scipy.optimize import linprog
from scipy.spatial.transform import Rotation

from drakeplan.bench.table import BenchOptions, BenchTable
from optimization.balance.friction import FrictionCone, cone_generators, corner_points
from optimization.balance.static_equilibrium import ContactArrays, com_polygon, is_balanced, polygon_margin
from scenes.contact import contact_rotation, patch_corners
from scenes.effector import EFFECTORS
from scenes.robots.robot import load_robot

PEER = "hpp_centroidal_dynamics"
INSTALL = "not installed here, so not compared: pip install hpp-centroidal-dynamics"
CONTACTS = (2, 3, 4)
CONES = {FrictionCone.SQUARE: 4, FrictionCone.INNER: 8}  # edges of hpp's pyramid
MU = 0.5
OUT_OF_REACH = 1e3  # [M g] a force limit that never binds
QUERIES = 100  # of one contact set, where there are many
ONE, MANY, MORE = "set, 1 query", f"set, {QUERIES} queries", "1 more query"
TASKS = (ONE, MANY, MORE)
REPEATS = 9
PILOT_SETS, PILOT_QUERIES = 5, 5  # trials that find the fastest way of either side
NEAR = 10.0  # times the quickest: ways whose trial took longer are not timed again
MANY_SETS = 10  # contact sets timed where each has many queries
BOUNDARY = 1e-7  # [m] HiGHS's tolerance: nearer to the boundary its verdict says nothing
ROOM = 256  # vertices


@dataclass(frozen=True)
class Case:
    """One contact set and the centres of mass that are asked about.

    Attributes:
        arrays: as our functions read it.
        points, normals: (4 n, 3) the same for hpp.
        com: (QUERIES, 3) [m].
    """

    arrays: ContactArrays
    points: np.ndarray
    normals: np.ndarray
    com: np.ndarray


def run(options: BenchOptions) -> BenchTable:
    """Speed per contact set for 2, 3 and 4 contacts, and agreement with HiGHS on 20 random stances a seed."""
    rows, speeds = [], _measure_in_child(options)
    highs = {n: agreement_with_highs(n, 20 * options.seeds, options) for n in CONTACTS}
    for s in speeds["rows"]:
        wrong, near, asked = highs[s["contacts"]]
        verdicts = f"{asked - wrong - near} of {asked - near}" if s["cone"] == "inner" and s["task"] == ONE else "-"
        rows.append(
            (s["contacts"], s["cone"], s["task"], s["ours"], s["ours_median"], s["compiled"], s["theirs"],
             s["theirs_median"], s["mode"], s["theirs"] / s["ours"], s["same"], verdicts)
        )  # fmt: skip
    columns = ("contacts", "cone", "task", "ours us", "median", "compiled us", "hpp us", "median", "hpp's way",
               "hpp / ours", "verdicts shared", "equal to HiGHS")  # fmt: skip
    near = sum(highs[n][1] for n in CONTACTS)
    notes = (
        f"us per task: mean over contact sets of the least of {REPEATS} turns (the ratio is of these), then the median"
        " turn. Both sides are called from Python; 'compiled' is ours from a numba loop.",
        "Each side by its fastest way: ours query or region, hpp's three linear programs or its projection (PP).",
        f"HiGHS: random stances with force limits; {near} within {BOUNDARY:g} m of the boundary are left out.",
        *([] if speeds["peer"] else [f"hpp-centroidal-dynamics is {INSTALL}."]),
    )
    return BenchTable("balance", "Balance of a contact set", columns, tuple(rows), notes, most_seeds=None)


def child_environment() -> dict[str, str]:
    """Environment variables of a process that measures: one thread, and the peer's libraries where it is installed."""
    spec = importlib.util.find_spec(PEER)
    environment = dict(os.environ, OMP_NUM_THREADS="1", OPENBLAS_NUM_THREADS="1")
    if spec is not None and spec.origin:
        libraries = str(Path(spec.origin).parents[2])  # <prefix>/lib/pythonX.Y/site-packages/<module>.so
        environment["LD_LIBRARY_PATH"] = os.pathsep.join(filter(None, [libraries, os.environ.get("LD_LIBRARY_PATH")]))
    return environment


def _measure_in_child(options: BenchOptions) -> dict:
    environment = child_environment()
    if importlib.util.find_spec(PEER) is None:
        options.tell(f"hpp-centroidal-dynamics is {INSTALL}")
    with tempfile.TemporaryDirectory() as folder:
        out = Path(folder) / "balance.json"
        command = [sys.executable, "-m", "drakeplan.bench.balance", str(out), str(options.seeds), options.robot]
        done = subprocess.run(command, env=environment, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, check=False)
        if done.returncode != 0 or not out.exists():
            raise RuntimeError(f"the balance benchmark failed: {done.stderr.decode(errors='replace')[-2000:]}")
        return json.loads(out.read_text(encoding="utf-8"))


# In the child --------------------------------------------------------------------------------------------------------


class Way(Protocol):
    """One way of using one of the two libraries."""

    name: str

    def prepare(self, case: Case) -> None:
        """Takes in a contact set."""
        ...

    def ask(self, com: np.ndarray) -> bool:
        """Whether the set holds a robot with this centre of mass (3,)."""
        ...


class Query:
    """drakeplan, one linear program a query."""

    name = "query"

    def prepare(self, case: Case) -> None:
        """Takes in a contact set."""
        self._arrays = case.arrays

    def ask(self, com: np.ndarray) -> bool:
        """Whether the set holds."""
        return is_balanced(*self._arrays, com[:2])


class Region:
    """drakeplan, with the whole region computed first."""

    name = "region"

    def __init__(self) -> None:
        self._polygon = np.empty((ROOM, 2))

    def prepare(self, case: Case) -> None:
        """Takes in a contact set."""
        self._count = com_polygon(*case.arrays, self._polygon)

    def ask(self, com: np.ndarray) -> bool:
        """Whether the set holds."""
        return polygon_margin(self._polygon, self._count, com[0], com[1]) >= 0.0


class PeerWay:
    """hpp-centroidal-dynamics by one of its algorithms."""

    def __init__(self, peer: ModuleType, edges: int, algorithm: str, solver: str, warm: bool) -> None:
        """Prepares one algorithm of the peer.

        Args:
            peer: the module hpp_centroidal_dynamics.
            edges: of the friction pyramid.
            algorithm: its name in the peer, without the prefix.
            solver: name of the linear-program solver in the peer, without the prefix.
            warm: whether the solver starts from the last solution.
        """
        self.name = algorithm if algorithm == "PP" else f"{algorithm} {solver}{' warm' if warm else ''}"
        self._status = peer.LP_status
        self._algorithm = getattr(peer.EquilibriumAlgorithm, f"EQUILIBRIUM_ALGORITHM_{algorithm}")
        solver_type = getattr(peer.SolverLP, f"SOLVER_LP_{solver}")
        self._equilibrium = peer.Equilibrium("bench", 50.0, edges, solver_type, warm)

    def prepare(self, case: Case) -> None:
        """Takes in a contact set; the projection is all done here."""
        self._ready = self._equilibrium.setNewContacts(case.points, case.normals, MU, self._algorithm)

    def ask(self, com: np.ndarray) -> bool:
        """Whether the set holds. Walls that face each other can be squeezed without end: then the robustness is
        unbounded, and the set holds."""
        if self.name == "PP":
            return self._ready and self._equilibrium.checkRobustEquilibrium(com)[1]
        status, robustness = self._equilibrium.computeEquilibriumRobustness(com)
        return status == self._status.LP_STATUS_UNBOUNDED or (
            status == self._status.LP_STATUS_OPTIMAL and robustness >= 0.0
        )


def measure(num_sets: int, robot: str) -> dict:
    """Times of every number of contacts, cone and task, for drakeplan and hpp in turn.

    Args:
        num_sets: contact sets of each number of contacts and cone.
        robot: its name.
    """
    peer = importlib.import_module(PEER) if importlib.util.find_spec(PEER) is not None else None
    rows = []
    for n, (cone, edges) in itertools.product(CONTACTS, CONES.items()):
        cases = [_case(np.random.default_rng([n, seed]), n, cone, robot) for seed in range(num_sets)]
        ours = [_Pilot(way, cases) for way in (Query(), Region())]
        theirs = [_Pilot(way, cases) for way in _peer_ways(peer, edges)] if peer is not None else []
        theirs = [pilot for pilot in theirs if pilot.verdicts == ours[0].verdicts]
        for task in TASKS:
            mine = min(ours, key=lambda pilot, task=task: pilot.cost(task)).way
            some = cases if task == ONE else cases[:MANY_SETS]
            rows.append(
                {"contacts": n, "cone": cone, "task": task, **_compare(mine, _leaders(theirs, task), some, task)}
            )
    return {"peer": peer is not None, "rows": rows}


def _peer_ways(peer: ModuleType, edges: int) -> Iterator[PeerWay]:
    for algorithm, solver, warm in itertools.product(("LP", "LP2", "DLP"), ("QPOASES", "CLP"), (False, True)):
        if hasattr(peer.SolverLP, f"SOLVER_LP_{solver}"):
            yield PeerWay(peer, edges, algorithm, solver, warm)
    yield PeerWay(peer, edges, "PP", "QPOASES", True)


class _Pilot:
    """A short trial that measures the time of one way and keeps its verdicts."""

    def __init__(self, way: Way, cases: Sequence[Case]) -> None:
        some = cases[:PILOT_SETS]
        self.way = way
        self.verdicts = [_verdicts(way, case, PILOT_QUERIES) for case in some]
        self._one, self._more = (_least([_time(way, some, t, PILOT_QUERIES) for _ in range(2)]) for t in (ONE, MORE))

    def cost(self, task: str) -> float:
        return {ONE: self._one, MANY: self._one + (QUERIES - 1) * self._more, MORE: self._more}[task]


def _leaders(pilots: list[_Pilot], task: str) -> list[Way]:
    """The quickest way of each algorithm, as long as its trial was near the best: a trial can be disturbed."""
    pilots = sorted(pilots, key=lambda pilot: pilot.cost(task))
    near = [pilot for pilot in pilots if pilot.cost(task) <= NEAR * pilots[0].cost(task)]
    firsts = {pilot.way.name.split()[0]: pilot.way for pilot in reversed(near)}
    return list(firsts.values())


def _verdicts(way: Way, case: Case, queries: int) -> list[bool]:
    way.prepare(case)
    return [bool(way.ask(com)) for com in case.com[:queries]]


def _time(way: Way, cases: Sequence[Case], task: str, queries: int = QUERIES) -> np.ndarray:
    """(cases,) [us] of one task for each contact set."""
    spent, count = np.empty(len(cases)), 1 if task == ONE else queries
    for i, case in enumerate(cases):
        asked = list(case.com[:count])
        if task == MORE:
            way.prepare(case)
        began = time.perf_counter()
        if task != MORE:
            way.prepare(case)
        for com in asked:
            way.ask(com)
        spent[i] = time.perf_counter() - began
    return 1e6 * spent / (count if task == MORE else 1)


def _least(turns: list[np.ndarray]) -> float:
    """Mean over the contact sets of the least time of each: whatever else the machine does only adds to a time."""
    return float(np.min(turns, axis=0).mean())


def _compare(mine: Way, others: list[Way], cases: Sequence[Case], task: str) -> dict:
    """Both sides in turn, and the compiled loop; of the others the one that proves quickest."""
    ours, theirs, compiled = [], {other.name: [] for other in others}, []
    stacked = [np.stack(field) for field in zip(*(c.arrays for c in cases), strict=True)]
    com = np.stack([c.com[:, :2] for c in cases])
    loop = {ONE: _query_loop, MANY: _region_loop, MORE: _margin_loop}[task]
    loop(*stacked, com)  # type: ignore[call-arg]
    for _ in range(REPEATS):
        ours.append(_time(mine, cases, task))
        for other in others:
            theirs[other.name].append(_time(other, cases, task))
        began = time.perf_counter()
        loop(*stacked, com)  # type: ignore[call-arg]
        compiled.append(1e6 * (time.perf_counter() - began) / len(cases) / (QUERIES if task == MORE else 1))
    result = {"ours": _least(ours), "ours_median": float(np.median(np.mean(ours, axis=1))), "compiled": min(compiled)}
    if not others:
        return result | {"theirs": np.nan, "theirs_median": np.nan, "mode": "-", "same": "-"}
    other = min(others, key=lambda way: _least(theirs[way.name]))
    turns, count = theirs[other.name], 1 if task == ONE else QUERIES
    same = np.equal([_verdicts(mine, c, count) for c in cases], [_verdicts(other, c, count) for c in cases])
    return result | {
        "theirs": _least(turns),
        "theirs_median": float(np.median(np.mean(turns, axis=1))),
        "mode": other.name,
        "same": f"{int(same.sum())} of {same.size}",
    }


@njit(cache=True)
def _query_loop(p_WC, R_WC, corners, generators, limit, com):  # noqa: ANN001, ANN202 (stacked ContactArrays)
    held = 0
    for i in range(p_WC.shape[0]):
        held += is_balanced(p_WC[i], R_WC[i], corners[i], generators[i], limit[i], com[i, 0])
    return held


@njit(cache=True)
def _region_loop(p_WC, R_WC, corners, generators, limit, com):  # noqa: ANN001, ANN202 (stacked ContactArrays)
    held, out = 0, np.empty((ROOM, 2))
    for i in range(p_WC.shape[0]):
        count = com_polygon(p_WC[i], R_WC[i], corners[i], generators[i], limit[i], out)
        for k in range(com.shape[1]):
            held += polygon_margin(out, count, com[i, k, 0], com[i, k, 1]) >= 0.0
    return held


@njit(cache=True)
def _margin_loop(p_WC, R_WC, corners, generators, limit, com):  # noqa: ANN001, ANN202 (stacked ContactArrays)
    held, out = 0, np.empty((ROOM, 2))
    count = com_polygon(p_WC[0], R_WC[0], corners[0], generators[0], limit[0], out)
    for i in range(p_WC.shape[0]):
        for k in range(com.shape[1]):
            held += polygon_margin(out, count, com[i, k, 0], com[i, k, 1]) >= 0.0
    return held


# Stances -------------------------------------------------------------------------------------------------------------


def _stance(rng: np.random.Generator, n: int) -> tuple[list[int], np.ndarray, np.ndarray]:
    """(end effectors, points (n, 3), normals (n, 3)): feet on stones tilted up to 20 deg, palms on walls beside."""
    effectors, tilt = list(range(n)), np.deg2rad(20.0)
    points = [[0.0, 0.1, 0.0], [rng.uniform(-0.35, 0.35), rng.uniform(-0.35, -0.1), rng.uniform(-0.2, 0.2)]]
    normals = [Rotation.from_euler("xy", rng.uniform(-tilt, tilt, 2)).as_matrix()[:, 2] for _ in range(2)]
    for effector in effectors[2:]:
        side = 1.0 if EFFECTORS[effector] == "left_palm" else -1.0
        points.append([rng.uniform(0.0, 0.5), side * rng.uniform(0.35, 0.7), rng.uniform(0.9, 1.4)])
        normal = np.array([rng.uniform(-0.5, 0.1), -side, rng.uniform(-0.2, 0.4)])
        normals.append(normal / np.linalg.norm(normal))
    return effectors, np.array(points), np.array(normals)


def _case(rng: np.random.Generator, n: int, cone: FrictionCone, robot: str) -> Case:
    effectors, points, normals = _stance(rng, n)
    half = load_robot(robot).half_extents[effectors]
    R_WC = np.array([_peer_frame(normal) for normal in normals])
    arrays = ContactArrays(
        points, R_WC, patch_corners(half), np.stack([cone_generators(cone, MU)] * n), np.full(n, OUT_OF_REACH)
    )
    corners = np.concatenate([p + corner_points(h) @ R.T for p, h, R in zip(points, half, R_WC, strict=True)])
    com = np.full((QUERIES, 3), 0.8)
    com[:, :2] = points[:2, :2].mean(axis=0) + rng.uniform(-0.25, 0.25, (QUERIES, 2))
    return Case(arrays, corners, np.repeat(normals, 4, axis=0), com)


def _peer_frame(normal: np.ndarray) -> np.ndarray:
    """(3, 3) the contact frame that hpp-centroidal-dynamics makes of a normal: x across the world's y axis."""
    x = np.cross(normal, [0.0, 1.0, 0.0])
    if np.linalg.norm(x) < 1e-5:
        x = np.cross(normal, [1.0, 0.0, 0.0])
    x /= np.linalg.norm(x)
    return np.stack([x, np.cross(normal, x), normal], axis=1)


# HiGHS ---------------------------------------------------------------------------------------------------------------


def agreement_with_highs(n: int, count: int, options: BenchOptions) -> tuple[int, int, int]:
    """Compares verdicts with HiGHS, with the robot's force limits and the `inner` cone.

    Args:
        n: number of contacts.
        count: number of random stances.
        options: robot and progress.

    Returns:
        Wrong verdicts, those too near the boundary to tell, and all queries.
    """
    robot, wrong, near = load_robot(options.robot), 0, 0
    out = np.empty((ROOM, 2))
    for seed in range(count):
        rng = np.random.default_rng([n, seed, 1])
        effectors, points, normals = _stance(rng, n)
        R_WC = np.array([contact_rotation(EFFECTORS[e], v, rng.uniform(-0.4, 0.4)) for e, v in
                         zip(effectors, normals, strict=True)])  # fmt: skip
        generators = np.stack([cone_generators(FrictionCone.INNER, MU)] * n)
        arrays = ContactArrays(
            points, R_WC, patch_corners(robot.half_extents[effectors]), generators, robot.force_limit[effectors]
        )
        xy = points[:2, :2].mean(axis=0) + rng.uniform(-0.25, 0.25, 2)
        if abs(polygon_margin(out, com_polygon(*arrays, out), *xy)) < BOUNDARY:
            near += 1
        elif is_balanced(*arrays, xy) != _highs_says(arrays, xy):
            wrong += 1
    options.tell(f"{n} contacts: {count - near - wrong} of {count - near} verdicts equal HiGHS's")
    return wrong, near, count


def _highs_says(arrays: ContactArrays, xy: np.ndarray) -> bool:
    columns = []
    for p, R, corners, rays in zip(*arrays[:4], strict=True):
        forces = rays @ R.T
        for arm in p + corners @ R[:, :2].T:
            columns.append(np.hstack([forces, np.cross(arm, forces)]))
    A = np.concatenate(columns).T
    per_contact = np.kron(np.eye(len(arrays.p_WC)), np.ones(A.shape[1] // len(arrays.p_WC)))
    weight = [0.0, 0.0, 1.0, xy[1], -xy[0], 0.0]
    zero = np.zeros(A.shape[1])
    answer = linprog(zero, A_eq=A, b_eq=weight, A_ub=per_contact, b_ub=arrays.force_limit, method="highs")
    return answer.status == 0


if __name__ == "__main__":
    _out, _seeds, _robot = sys.argv[1:]
    Path(_out).write_text(json.dumps(measure(2 * int(_seeds), _robot)), encoding="utf-8")
