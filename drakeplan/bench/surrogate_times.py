"""What a prediction costs: on expansions that searches really made, and on made-up ones of one size.

A search hands over every child of a state at once, some twenty to sixty. Times are from the poses of a batch (made up: from
contact numbers) to answers in W: category, features, networks, calibration and distance from the training data, on one thread.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, field, fields
from importlib.util import find_spec

import numpy as np

from drakeplan.bench.peers.onnx_model import onnx_model
from drakeplan.bench.table import BenchOptions, BenchTable
from drakeplan.contact_planning.contact_plan import PlannerOptions
from drakeplan.contact_planning.search_planner import SearchPlanner, SearchSettings
from drakeplan.context import QueryContext
from drakeplan.search.ana_star import Limits
from learning.network import Mlp, SharedNetwork
from learning.palm_networks import PalmNetworks
from learning.relative_features import relative_features
from learning.surrogate import DynamicsSurrogate, TransitionPrediction
from learning.transition_batch import TransitionBatch
from learning.transition_features import canonicalise
from optimization.inverse_kinematics.whole_body_ik import WholeBodyIK
from scenes.contact import contact_rotation
from scenes.effector import EFFECTORS
from scenes.files.scene_source import load_scene
from scenes.robots.robot import load_robot

SCENES, SEEDS = ("rubble_field", "rubble_corridor"), 4
SIZES = (20, 40, 80)  # children of one expansion
REPEATS = 30
NOMINAL = ((0.0, 0.1, 0.0), (0.0, -0.1, 0.0), (0.2, 0.6, 1.2), (0.2, -0.6, 1.2))  # [m] contact points
NORMALS = ((0.0, 0.0, 1.0), (0.0, 0.0, 1.0), (0.0, -1.0, 0.0), (0.0, 1.0, 0.0))


@dataclass(frozen=True, eq=False)
class Recording(DynamicsSurrogate):
    """A surrogate that records its inputs."""

    batches: list[TransitionBatch] = field(default_factory=list)

    def predict(self, batch: TransitionBatch) -> TransitionPrediction:
        """As the surrogate answers."""
        self.batches.append(batch)
        return super().predict(batch)

    @classmethod
    def of(cls, surrogate: DynamicsSurrogate) -> Recording:
        """The same surrogate, with nothing kept yet."""
        return cls(**{f.name: getattr(surrogate, f.name) for f in fields(surrogate)})


def times(options: BenchOptions, surrogate: DynamicsSurrogate) -> BenchTable:
    """Microseconds a transition, median and least of repeated passes over all batches.

    Args:
        options: seeds and robot.
        surrogate: to be timed.
    """
    rows = []
    for scene in SCENES:
        batches = real_batches(options, surrogate, scene)
        if batches:
            rows.append((scene, *_sizes(batches), *_spent(lambda b=batches: _each(surrogate, b), batches)))
            rows += [
                (f"{scene}: {who}", *_sizes(batches), *cells) for who, cells in _networks_alone(surrogate, batches)
            ]
    for categories in (1, 3):
        for n in SIZES:
            batch, arguments = expansion(n, categories)

            def whole(arguments: tuple = arguments) -> None:
                surrogate.predict(TransitionBatch.of_children(*arguments))

            name = f"made up, {categories} categor{'y' if categories == 1 else 'ies'}, from contact numbers"
            rows.append((name, 1, float(n), *_spent(whole, [batch], 10 * REPEATS)))
    notes = (
        f"batches of a scene: every expansion of the searches for the first sequence, seeds 0 to {min(options.seeds, SEEDS) - 1};"
        f" median and least of {REPEATS} passes over all of them; sum of leasts: every batch at its quickest.",
        "networks alone: without category, features, calibration and distance. NumPy: its BLAS, on as many threads as it"
        " takes (OPENBLAS_NUM_THREADS=1 holds it back); the others use one.",
    )
    columns = ("batches", "number", "mean size", "us a transition: median", "least", "sum of leasts")
    return BenchTable(
        "surrogate_times",
        "Time of a learned prediction",
        columns,
        tuple(rows),
        notes,
        bench="surrogate",
        most_seeds=SEEDS,
    )


def real_batches(options: BenchOptions, surrogate: DynamicsSurrogate, scene: str) -> list[TransitionBatch]:
    """The batches of transitions that searches for a first contact sequence evaluate, one for each expansion.

    Args:
        options: seeds and robot.
        surrogate: evaluates them.
        scene: its name.
    """
    robot = load_robot(options.robot)
    ik, recording = WholeBodyIK(robot), Recording.of(surrogate)
    for seed in range(min(options.seeds, SEEDS)):
        context = QueryContext(load_scene(scene, seed=seed), robot, ik)
        asked = PlannerOptions(seed=seed, dynamics="learned")
        planner = SearchPlanner(context, asked, SearchSettings(surrogate=recording))
        next(iter(planner.plans(Limits(deadline=10.0))), None)
    return recording.batches


def expansion(n: int, num_categories: int, seed: int = 0) -> tuple[TransitionBatch, tuple]:
    """Children of a stance with both feet and the left palm, each with one moved contact.

    Args:
        n: number of children.
        num_categories: 1: the left foot moves; 2: the right foot too; 3: the left palm too.
        seed: of the random poses.

    Returns:
        The batch, and the arguments of `TransitionBatch.of_children` that make it.
    """
    rng = np.random.default_rng(seed)
    movers = np.arange(n) % num_categories
    effectors = np.concatenate([np.arange(4), movers])
    p = np.array(NOMINAL)[effectors] + rng.uniform(-0.15, 0.15, (n + 4, 3))
    normals = np.array(NORMALS)[effectors] + rng.uniform(-0.2, 0.2, (n + 4, 3))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    R = np.array([contact_rotation(EFFECTORS[e], v, 0.1) for e, v in zip(effectors, normals, strict=True)])
    before = np.array([0, 1, 2, -1])
    after = np.tile(before, (n, 1))
    after[np.arange(n), movers] = 4 + np.arange(n)
    arguments = (p, R, before, after, np.array([0.0, 0.0, 0.9]), np.array([0.1, 0.0, 0.0]), np.full(n + 4, 0.5))
    return TransitionBatch.of_children(*arguments), arguments


def by_numpy(members: tuple[Mlp, ...], x: np.ndarray) -> np.ndarray:
    """(n, outputs) the mean of networks as NumPy computes it.

    Args:
        members: networks of one shape.
        x: (n, inputs) their inputs.
    """
    total = np.zeros((len(x), members[0].shape[-1]), np.float32)
    for mlp in members:
        y = x
        for k, (W, b) in enumerate(zip(mlp.weights, mlp.biases, strict=True)):
            y = y @ W + b
            if k < len(mlp.weights) - 1:
                np.maximum(y, 0.0, out=y)
        total += y if mlp.skip is None else y + x @ mlp.skip
    return total / len(members)


def _networks_alone(
    surrogate: DynamicsSurrogate, batches: list[TransitionBatch]
) -> list[tuple[str, tuple[float, ...]]]:
    """The same matrices on the same inputs by this project, by NumPy, and by onnxruntime where that is installed."""
    network = surrogate.network
    shared = network.networks[0] if isinstance(network, PalmNetworks) else network
    if not isinstance(shared, SharedNetwork):
        return []
    features = [relative_features(canonicalise(batch, shared.frame)) for batch in batches]
    ways: dict[str, Callable[[np.ndarray], object]] = {
        "networks alone": shared.mean_of_members,
        "networks alone, NumPy": lambda x: by_numpy(shared.members, x),
    }
    if find_spec("onnxruntime") is not None:
        import onnxruntime

        one = onnxruntime.SessionOptions()
        one.intra_op_num_threads = one.inter_op_num_threads = 1
        session = onnxruntime.InferenceSession(onnx_model(shared.members), one, providers=["CPUExecutionProvider"])
        ways[f"networks alone, onnxruntime {onnxruntime.__version__}"] = lambda x: session.run(None, {"x": x})[0]

    def each(way: Callable[[np.ndarray], object]) -> list[float]:
        spent = []
        for x in features:
            began = time.perf_counter()
            way(x)
            spent.append(time.perf_counter() - began)
        return spent

    return [(name, _spent(lambda way=way: each(way), batches)) for name, way in ways.items()]


def _each(surrogate: DynamicsSurrogate, batches: list[TransitionBatch]) -> list[float]:
    spent = []
    for batch in batches:
        began = time.perf_counter()
        surrogate.predict(batch)
        spent.append(time.perf_counter() - began)
    return spent


def _sizes(batches: list[TransitionBatch]) -> tuple[int, float]:
    return len(batches), float(np.mean([len(batch) for batch in batches]))


def _spent(
    run: Callable[[], list[float] | None], batches: list[TransitionBatch], repeats: int = REPEATS
) -> tuple[float, float, float]:
    """Median and least time of a pass, and the sum of the least times of its batches [us a transition]."""
    run()
    passes, parts = [], []
    for _ in range(repeats):
        began = time.perf_counter()
        part = run()
        passes.append(time.perf_counter() - began)
        parts.append([passes[-1]] if part is None else part)
    total = sum(len(batch) for batch in batches)
    least = np.min(parts, axis=0).sum()
    return tuple(1e6 * t / total for t in (float(np.median(passes)), min(passes), float(least)))  # type: ignore[return-value]
