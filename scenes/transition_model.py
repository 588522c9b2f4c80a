"""Where an end effector may go next: foot steps seen from the standing foot, palm rays seen from the shoulder."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from importlib.resources import files
from pathlib import Path

import numpy as np
import yaml

from scenes.input_error import InputError, unknown_name

DATA = files("scenes") / "data"
_STEPS = Path(str(DATA / "foot_transition_models.yaml"))


@dataclass(frozen=True, eq=False)
class TransitionModel:
    """The discrete set of next placements that the search tries.

    Attributes:
        name: of the foot model.
        steps: (M, 3) of the left foot seen from the standing right foot's plan-view frame: x forward [m],
            y to the left [m], yaw to the left [rad]; the right foot mirrors y and yaw.
        rays: (K, 3) unit vectors from the left shoulder in the torso's heading frame; the right mirrors y.
    """

    name: str
    steps: np.ndarray
    rays: np.ndarray

    @staticmethod
    def read(steps_file: Path, name: str, rays_file: Path | None = None) -> TransitionModel:
        """A model of one's own from files of the form of those in scenes/data.

        Args:
            steps_file: YAML, foot placements [m, m, deg] by name of the model.
            name: of the model.
            rays_file: YAML, directions in which palms are looked for; None for those of the package.

        Raises:
            InputError: unreadable, unknown name or rows that are not [x, y, yaw].
        """
        return TransitionModel._from(_load(Path(steps_file)), steps_file, name, rays_file)

    @staticmethod
    def _from(models: dict, steps_file: Path, name: str, rays_file: Path | None = None) -> TransitionModel:
        if name not in models:
            raise unknown_name("transition model", name, models)
        rows = np.array(models[name], dtype=float)
        if rows.ndim != 2 or rows.shape[1] != 3 or not np.isfinite(rows).all():
            raise InputError(f"{steps_file}: {name}: expected rows of finite [x, y, yaw], x and y in m, yaw in deg")
        steps = np.column_stack([rows[:, :2], np.deg2rad(rows[:, 2])])
        return TransitionModel(name, steps, _rays(_load(rays_file or Path(str(DATA / "palm_rays.yaml")))))

    def mirrored(self, left: bool) -> tuple[np.ndarray, np.ndarray]:
        """(steps, rays) for the left or the right side."""
        sign = 1.0 if left else -1.0
        return self.steps * [1.0, sign, sign], self.rays * [1.0, sign, 1.0]


@cache
def transition_model(name: str = "experiments") -> TransitionModel:
    """A model that comes with the package: planning (57 steps), training (38), experiments (60), long_stride, leap_stride."""
    return TransitionModel._from(_packaged(), _STEPS, name)


@cache
def _packaged() -> dict:
    return _load(_STEPS)  # 40 ms


def _load(path: Path) -> dict:
    try:
        data = yaml.safe_load(path.read_text(encoding="utf-8"))
    except (OSError, UnicodeDecodeError, yaml.YAMLError) as error:
        raise InputError(f"{path}: expected a readable YAML file of transition models ({error})") from error
    if not isinstance(data, dict):
        raise InputError(f"{path}: expected named lists of [x, y, yaw] rows")
    return data


def _rays(data: dict) -> np.ndarray:
    azimuth, elevation = np.meshgrid(np.deg2rad(data["azimuth"]), np.deg2rad(data["elevation"]), indexing="ij")
    azimuth, elevation = azimuth.ravel(), elevation.ravel()
    flat = np.cos(elevation)
    return np.column_stack([flat * np.cos(azimuth), flat * np.sin(azimuth), np.sin(elevation)])
