"""Trains the networks of capture on a campaign's labels and measures them on tasks that were held out (Lin 2020 sec. 7.6, 7.8.1)."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from learning.calibration import fit_platt, reliability_curve
from learning.capture_features import ANGLES, SPIN, documented_features, features
from learning.capture_labels import CAMPAIGN, SCHEMA, VERSION
from learning.capture_networks import CaptureKind, CaptureNetworks, fit_range, weights_name
from learning.capture_view import NUM_MOTIONS, STAY, CaptureViews
from learning.dataset import TEST, TRAIN, VALIDATION, read_dataset, split_by_scene
from learning.network import Mlp
from learning.training.lesson import Lesson, with_turned_angles
from learning.training.options import TrainingOptions
from learning.training.teacher import teach
from learning.weights import write_weights
from optimization.capture.sampling import CAPTURE_MOTIONS
from scenes.input_error import InputError
from scenes.robots.robot import Robot

CHECKPOINTS = "checkpoints"
PUBLISHED = ((97.4, 98.3, 97.8), (98.0, 98.0, 98.0), (95.9, 94.3, 95.2), (92.2, 90.3, 91.3))  # Lin 2020 fig. 7.6 [%]
LEAST = 200  # training rows of a motion
Tell = Callable[[str, int, int, float, float], None]  # network, epoch, epochs, training loss, validation loss


def usual_options(kind: CaptureKind, seed: int = 0) -> TrainingOptions:
    """Sizes and rates of one kind; of "documented" those that Lin 2020 fig. 7.3 gives, the others as in ch. VI.

    Args:
        kind: of networks.
        seed: of the split, the initial weights and the order of the rows.
    """
    if kind == "documented":
        return TrainingOptions(kind="documented", width=256, depth=3, epochs=100, rate=5e-5, dropout=0.1, seed=seed)
    return TrainingOptions(kind="shared", width=32, depth=3, epochs=60, members=3, jitter=0.15, seed=seed)


@dataclass(frozen=True, eq=False)
class CaptureLabels:
    """n questions and their answers.

    Attributes:
        views: the questions.
        captured: (n,) bool.
        walked: (n,) bool, whether the state is one that a planner met.
        scene: (n,) number of the task.
        friction: least of all rows [-].
        source: what the data are.
    """

    views: CaptureViews
    captured: np.ndarray
    walked: np.ndarray
    scene: np.ndarray
    friction: float
    source: Mapping[str, Any]

    @staticmethod
    def read(folder: Path, robot: Robot) -> CaptureLabels:
        """The rows that a capture campaign wrote.

        Args:
            folder: of the campaign.
            robot: that the labels have to be of.

        Raises:
            InputError: as `learning.dataset.read_dataset`, or labels of another robot.
        """
        data = read_dataset(folder, campaign=CAMPAIGN, version=VERSION, schema=SCHEMA)
        parameters = data.source["parameters"]
        assert isinstance(parameters, dict)
        if parameters.get("robot_model_sha256") != robot.model_sha256:
            raise InputError(
                f"{folder}: labels of robot {parameters.get('robot')!r}, expected {robot.name!r} as it is now"
            )
        n, array = len(data), data.array
        views = CaptureViews(
            array("motion").astype(np.int64), array("foot_R").reshape(n, 3, 3), array("p_new"),
            array("R_new").reshape(n, 3, 3), array("com"), array("velocity"), array("spin"),
        )  # fmt: skip
        walked, friction = array("source") == "walk", float(array("friction").min())
        scene = array("scene").astype(np.int64)
        return CaptureLabels(views, array("captured").astype(bool), walked, scene, friction, dict(data.source))


@dataclass(frozen=True)
class MotionFit:
    """How well one capture motion is predicted in tasks that were held out; shares in [0, 1].

    Attributes:
        motion: of `CAPTURE_MOTIONS`.
        about: which rows: "all", "random", "walk", "no spin".
        train: rows it was trained on.
        test: rows held out.
        captured: share of captured ones among them.
        precision: share of captured among those that are predicted so, at probability 1/2.
        recall: share of the captured that is found.
        accuracy: share of right answers.
        balanced: mean of the shares of right answers among captured and among others.
        calibration: expected calibration error.
        sure: share of the rows whose probability is above 0.9.
        sure_wrong: share of those that are not captured: the price of a false "captured".
        spread_right, spread_wrong: mean disagreement of the members where the answer is right and where it is wrong.
        far: share of rows outside the training data.
    """

    motion: str
    about: str
    train: int
    test: int
    captured: float
    precision: float
    recall: float
    accuracy: float
    balanced: float
    calibration: float
    sure: float
    sure_wrong: float
    spread_right: float
    spread_wrong: float
    far: float


@dataclass(frozen=True, eq=False)
class TrainedCapture:
    """Networks of one kind and how well they do.

    Attributes:
        networks: as they were written.
        fits: of each motion.
        path: of the weights.
    """

    networks: CaptureNetworks
    fits: tuple[MotionFit, ...]
    path: Path


def train_capture(
    labels: CaptureLabels, robot: Robot, out: Path, kind: CaptureKind, options: TrainingOptions, tell: Tell
) -> TrainedCapture:
    """Trains one kind, calibrates, measures, and writes weights and card to `out`.

    A run that was killed is taken up from its last epoch, and writes the same bytes.

    Args:
        labels: questions and answers.
        robot: whose they are.
        out: folder, made where it is missing.
        kind: of networks.
        options: their size and how they learn.
        tell: called after each epoch.

    Raises:
        InputError: too few labels of a motion, or too few tasks to hold any out.
    """
    part = split_by_scene(labels.scene, options.seed)
    _check(labels, part)
    x = features(labels.views)
    if kind != "spin":
        x[:, SPIN] = 0.0
    members = []
    for motion in range(NUM_MOTIONS):
        taught: list[Mlp] = []
        for k in range(options.members):
            lesson = _lesson(labels, part, x, kind, motion, k)

            def told(name: str, epoch: int, loss: float, check: float) -> None:
                tell(f"{kind} {name}", epoch, options.epochs, loss, check)

            taught.append(teach(lesson, replace(options, seed=options.seed + k), out / CHECKPOINTS / kind, told).mlp)
        members.append(tuple(taught))
    low, high = fit_range(x[part == TRAIN], labels.views.motion[part == TRAIN])
    card: dict[str, Any] = {
        "about": "learned zero- and one-step capture of a robot that stands on one foot (Lin 2020 sec. 7.6)",
        "kind": kind,
        "robot": robot.name,
        "robot_model_sha256": robot.model_sha256,
        "friction": labels.friction,
        "motions": list(CAPTURE_MOTIONS),
        "training": asdict(options),
        "data": dict(labels.source),
    }
    one, none = np.ones(NUM_MOTIONS, np.float32), np.zeros(NUM_MOTIONS, np.float32)
    raw = CaptureNetworks(
        kind, tuple(members), one, none, low.astype(np.float32), high.astype(np.float32), labels.friction, card
    )
    networks = calibrated(raw, labels, part)
    fits = measured(networks, labels, part)
    card |= {"measured": [asdict(fit) for fit in fits]}
    path = write_weights(out, weights_name(kind), networks.tensors(), card)
    return TrainedCapture(networks, fits, path)


def calibrated(networks: CaptureNetworks, labels: CaptureLabels, part: np.ndarray) -> CaptureNetworks:
    """The networks with scale and offset that make the mean of the members' probabilities true on the validation tasks.

    Args:
        networks: as trained.
        labels: questions and answers.
        part: (n,) of each row.
    """
    scale, offset = networks.scale.copy(), networks.offset.copy()
    for motion in range(NUM_MOTIONS):
        rows = np.flatnonzero((part == VALIDATION) & (labels.views.motion == motion))
        p = np.clip(networks.predict(labels.views.take(rows)).probability, 1e-6, 1.0 - 1e-6)
        scale[motion], offset[motion] = fit_platt(np.log(p / (1.0 - p)), labels.captured[rows])
    return replace(networks, scale=scale, offset=offset)


def measured(
    networks: CaptureNetworks, labels: CaptureLabels, part: np.ndarray, tested: int = TEST
) -> tuple[MotionFit, ...]:
    """How well each motion is predicted on the tasks that were held out: all rows, and parts of them.

    Args:
        networks: calibrated.
        labels: questions and answers.
        part: (n,) of each row.
        tested: the part that is looked at.
    """
    fits = []
    still = (np.abs(labels.views.spin) < 1e-12).all(axis=1)
    kinds = {"all": np.ones(len(part), bool), "random": ~labels.walked, "walk": labels.walked, "no spin": still}
    for motion, name in enumerate(CAPTURE_MOTIONS):
        mine = labels.views.motion == motion
        for about, chosen in kinds.items():
            rows = np.flatnonzero((part == tested) & mine & chosen)
            if len(rows):
                train = int(((part == TRAIN) & mine & chosen).sum())
                fits.append(_fit(networks, labels, rows, name, about, train))
    return tuple(fits)


def _fit(
    networks: CaptureNetworks, labels: CaptureLabels, rows: np.ndarray, name: str, about: str, train: int
) -> MotionFit:
    says, truth = networks.predict(labels.views.take(rows)), labels.captured[rows]
    yes, right = says.probability >= 0.5, (says.probability >= 0.5) == truth
    sure = says.probability > 0.9
    halves = [right[truth == answer].mean() for answer in (True, False) if (truth == answer).any()]
    return MotionFit(
        motion=name,
        about=about,
        train=train,
        test=len(rows),
        captured=float(truth.mean()),
        precision=_mean(truth[yes]),
        recall=_mean(yes[truth]),
        accuracy=float(right.mean()),
        balanced=float(np.mean(halves)),
        calibration=reliability_curve(says.probability, truth).expected_error,
        sure=float(sure.mean()),
        sure_wrong=_mean(~truth[sure]),
        spread_right=_mean(says.spread[right]),
        spread_wrong=_mean(says.spread[~right]),
        far=float(says.far.mean()),
    )


def _mean(values: np.ndarray) -> float:
    return float(values.mean()) if len(values) else 0.0


def _check(labels: CaptureLabels, part: np.ndarray) -> None:
    for motion, name in enumerate(CAPTURE_MOTIONS):
        rows = (labels.views.motion == motion) & (part == TRAIN)
        if rows.sum() < LEAST or not 0 < labels.captured[rows].sum() < rows.sum():
            raise InputError(
                f"training data: {int(rows.sum())} labels of {name!r}, expected {LEAST} of both answers: collect more"
            )
    for wanted, name in ((VALIDATION, "calibrate on"), (TEST, "test on")):
        if not (part == wanted).any():
            raise InputError(f"training data: too few tasks, none is left to {name}; collect 20 at least")


def _lesson(labels: CaptureLabels, part: np.ndarray, x: np.ndarray, kind: str, motion: int, member: int) -> Lesson:
    """What one network is taught."""
    train, check = (np.flatnonzero((part == p) & (labels.views.motion == motion)) for p in (TRAIN, VALIDATION))
    seen, checked, truth = x[train], x[check], labels.captured[train]
    if kind == "documented":
        angles = np.array(ANGLES[: 3 if motion == STAY else 6])
        seen, origin = with_turned_angles(documented_features(labels.views.take(train)), angles)
        checked, truth = documented_features(labels.views.take(check)), truth[origin]
    nothing = np.zeros((len(seen), 0), np.float32)
    return Lesson(
        f"{CAPTURE_MOTIONS[motion]}{member}", seen, truth, nothing, checked, labels.captured[check],
        np.zeros((len(checked), 0), np.float32), classifies=True, skip=kind != "documented",
    )  # fmt: skip


def held_out_text(trained: TrainedCapture, every: bool = False) -> str:
    """A table of the held-out tasks, with the published figures beside.

    Args:
        trained: networks and how well they do.
        every: the parts of the rows too, not all of them together alone.
    """
    head = (
        f"{trained.networks.kind:<15}{'rows':<9}{'train':>7}{'test':>7}{'yes %':>7}{'prec.':>7}{'rec.':>7}{'acc.':>7}{'ECE':>7}"
        f"{'>0.9':>7}{'wrong':>7}{'spread':>14}   Lin 2020 fig. 7.6"
    )
    lines = [head]
    for fit in trained.fits:
        if not every and fit.about != "all":
            continue
        published = "{:.1f} {:.1f} {:.1f}".format(*PUBLISHED[CAPTURE_MOTIONS.index(fit.motion)])
        lines.append(
            f"{fit.motion:<15}{fit.about:<9}{fit.train:>7}{fit.test:>7}{100 * fit.captured:>7.1f}{100 * fit.precision:>7.1f}"
            f"{100 * fit.recall:>7.1f}{100 * fit.accuracy:>7.1f}{100 * fit.calibration:>7.1f}{100 * fit.sure:>7.1f}"
            f"{100 * fit.sure_wrong:>7.1f}{fit.spread_right:>7.3f}{fit.spread_wrong:>7.3f}   {published}"
        )
    return "\n".join(lines)
