"""What more labels would buy: the same training on shares of the training scenes, measured on the same test scenes.

Every share takes as many steps as the whole (fewer scenes, more epochs), so that what differs are the labels alone. Errors
fall about like a power of the number of labels (Hestness et al. 2017), which a straight line through their logarithms shows.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from learning.fit_report import CategoryFit, FitReport
from learning.labelled_transitions import TRAIN, LabelledTransitions, split_by_scene
from learning.training.options import TrainingOptions
from learning.training.recipe import Progress, train_dynamics
from learning.transition_features import CATEGORIES
from scenes.input_error import InputError
from scenes.robots.robot import Robot

SHARES = (0.125, 0.25, 0.5, 1.0)
MORE = (2.0, 4.0)  # times the labels, for which errors are foretold
_ERRORS = (  # name, unit that it is printed in, and how large that is
    ("one less balanced accuracy", "%", 0.01), ("final CoM", "mm", 1e-3), ("CoM velocity", "mm/s", 1e-3),
    ("objective, median", "%", 0.01),
)  # fmt: skip


@dataclass(frozen=True)
class PowerLaw:
    """error = scale rows^-exponent; NaN where there are fewer than two positive errors to fit."""

    scale: float
    exponent: float

    def at(self, rows: float) -> float:
        """The error that it foretells for this many rows."""
        return self.scale * rows**-self.exponent


@dataclass(frozen=True, eq=False)
class LearningCurve:
    """Reports of the same training on growing shares of the scenes.

    Attributes:
        shares: of the training scenes, ascending.
        scenes: how many those are.
        reports: of the test scenes, which are the same for all.
    """

    shares: tuple[float, ...]
    scenes: tuple[int, ...]
    reports: tuple[FitReport, ...]

    def errors(self, category: int = -1) -> tuple[np.ndarray, np.ndarray]:
        """(shares,) rows trained on and (shares, 4) errors as `_ERRORS` lists them; category -1: all."""
        fits = [_fit(report, category) for report in self.reports]
        rows = np.array([fit.train for fit in fits], float)
        return rows, np.array(
            [(1.0 - fit.balanced, fit.com_error, fit.velocity_error, fit.objective_median) for fit in fits]
        )

    def laws(self, category: int = -1) -> tuple[PowerLaw, ...]:
        """The power law of each error."""
        rows, errors = self.errors(category)
        return tuple(fit_power_law(rows, error) for error in errors.T)

    def text(self) -> str:
        """Errors against rows, then exponents and what more rows would give, in all and a category."""
        rows, errors = self.errors()
        units = np.array([scale for _, _, scale in _ERRORS])
        heads = "".join(f"{f'{name} [{unit}]':>33s}" for name, unit, _ in _ERRORS)
        lines = ["Learning curve", f"{'share':>6s} {'scenes':>7s} {'rows':>8s}{heads}"]
        for share, scenes, n, error in zip(self.shares, self.scenes, rows, errors, strict=True):
            cells = "".join(f"{value:33.2f}" for value in error / units)
            lines.append(f"{share:6.3f} {scenes:7d} {int(n):8d}{cells}")
        more = " ".join(f"x{times:g}" for times in MORE)
        lines += ["", f"Fitted error = a rows^-b: b, and the error with {more} the rows", f"{'':32s}{heads}"]
        categories = [fit.category for fit in self.reports[-1].rows]
        for category in [-1, *(c for c in categories if c >= 0)]:
            n = self.errors(category)[0][-1]
            cells = ""
            for law, unit in zip(self.laws(category), units, strict=True):
                foretold = " ".join(f"{law.at(times * n) / unit:7.2f}" for times in MORE)
                cells += f"{f'{law.exponent:6.2f}: {foretold}':>33s}"
            lines.append(f"{'all' if category < 0 else f'{category} {CATEGORIES[category]}':32s}{cells}")
        return "\n".join(lines)

    def facts(self) -> dict[str, Any]:
        """The same as JSON values; NaN becomes None."""
        found: dict[str, Any] = {"shares": list(self.shares), "scenes": list(self.scenes)}
        for category in (fit.category for fit in self.reports[-1].rows):
            rows, errors = self.errors(category)
            found["all" if category < 0 else CATEGORIES[category]] = {
                "rows": rows.astype(int).tolist(),
                **{
                    name: {
                        "error": [_json(e) for e in error],
                        "scale": _json(law.scale),
                        "exponent": _json(law.exponent),
                    }
                    for (name, _, _), error, law in zip(_ERRORS, errors.T, self.laws(category), strict=True)
                },
            }
        return found


def learning_curve(
    labels: LabelledTransitions, robot: Robot, out: Path, options: TrainingOptions, tell: Callable[[float, Progress], None],
    shares: Sequence[float] = SHARES,
) -> LearningCurve:  # fmt: skip
    """Trains on each share, in a folder of its own; a run that was killed goes on where it was.

    Args:
        labels: transitions and what the program said of them.
        robot: whose they are.
        out: gets a folder `share_<share>` for each.
        options: of the training on all scenes; smaller shares take more epochs.
        tell: called with the share after each epoch.
        shares: in (0, 1]; smaller ones are parts of larger ones.

    Raises:
        InputError: as `train_dynamics`, or a share that is none.
    """
    if not shares or any(not 0.0 < share <= 1.0 for share in shares):
        raise InputError(f"learning curve: shares must lie in (0, 1], got {tuple(shares)}")
    reports, scenes = [], []
    for share in sorted(set(shares)):

        def told(progress: Progress, share: float = share) -> None:
            tell(share, progress)

        part = labels.take(share_of_scenes(labels.scene, share, options.seed))
        epochs = round(options.epochs / share)
        trained = train_dynamics(part, robot, out / f"share_{share:g}", replace(options, epochs=epochs), told)
        reports.append(trained.report)
        scenes.append(len(np.unique(part.scene[split_by_scene(part.scene, options.seed) == TRAIN])))
    return LearningCurve(tuple(sorted(set(shares))), tuple(scenes), tuple(reports))


def share_of_scenes(scene: np.ndarray, share: float, seed: int) -> np.ndarray:
    """(n,) bool: all rows of the validation and test scenes, and those of about this share of the training scenes.

    Whether a scene is in depends on its number, the share and the seed alone, and a scene of one share is in every larger one.

    Args:
        scene: (n,) number of each row's scene.
        share: of the training scenes, in (0, 1].
        seed: of the split.
    """
    unique, index = np.unique(scene, return_inverse=True)
    draw = np.array([np.random.default_rng([seed, int(s), 1]).random() for s in unique])
    return (draw < share)[index] | (split_by_scene(scene, seed) != TRAIN)


def fit_power_law(rows: np.ndarray, error: np.ndarray) -> PowerLaw:
    """Least squares through the logarithms of the positive errors (n,) over rows (n,).

    Args:
        rows: (n,) how many rows were trained on.
        error: (n,) what was measured then.
    """
    some = np.isfinite(error) & (error > 0) & (rows > 0)
    if len(np.unique(rows[some])) < 2:
        return PowerLaw(float("nan"), float("nan"))
    slope, intercept = np.polyfit(np.log(rows[some]), np.log(error[some]), 1)
    return PowerLaw(float(np.exp(intercept)), float(-slope))


def _fit(report: FitReport, category: int) -> CategoryFit:
    return next(fit for fit in report.rows if fit.category == category)


def _json(value: float) -> float | None:
    return float(value) if np.isfinite(value) else None
