"""Teaches one network: AdamW, a cosine, and a checkpoint after every epoch that a killed run is taken up from."""

from __future__ import annotations

import json
import zlib
from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

import numpy as np
import torch
from safetensors import SafetensorError, safe_open
from safetensors.numpy import save

from learning.network import Mlp
from learning.training.lesson import Lesson, fold_scaling
from learning.training.options import TrainingOptions
from scenes.files.whole_file import write_whole

Tell = Callable[[str, int, float, float], None]  # network, epoch, training loss, validation loss
_HUBER = 0.1  # in standard deviations of the output: beyond it errors count linearly, as they are reported
_NEAR_BOUND = 1e-3  # [m] a final CoM this near to its bound lies on it
_ADAM = ("step", "exp_avg", "exp_avg_sq")


@dataclass(frozen=True)
class Taught:
    """A network and how it came about.

    Attributes:
        mlp: on features as they are, answering in SI units.
        curve: (training loss, validation loss) of each epoch.
    """

    mlp: Mlp
    curve: tuple[tuple[float, float], ...]


class _Net(torch.nn.Module):
    def __init__(self, lesson: Lesson, options: TrainingOptions) -> None:
        super().__init__()
        generator = torch.Generator().manual_seed(_seed(lesson, options))
        widths = [lesson.x.shape[1], *([options.width] * options.depth), lesson.num_outputs]
        self.weights, self.biases = torch.nn.ParameterList(), torch.nn.ParameterList()
        for k, (m, n) in enumerate(pairwise(widths)):
            gain = 2.0 if k < options.depth else 1.0  # He et al. 2015; the last layer is linear
            self.weights.append(torch.nn.Parameter(torch.randn(m, n, generator=generator) * (gain / m) ** 0.5))
            self.biases.append(torch.nn.Parameter(torch.zeros(n)))
        self.skip = None
        if lesson.skip:  # begin with the linear fit, and learn what it leaves
            self.skip = torch.nn.Parameter(torch.from_numpy(lesson.linear_fit()))
            with torch.no_grad():
                self.weights[-1].zero_()

    def forward(self, x: torch.Tensor, dropout: float = 0.0, chance: torch.Generator | None = None) -> torch.Tensor:
        y = x
        for k, (W, b) in enumerate(zip(self.weights, self.biases, strict=True)):
            y = torch.addmm(b, y, W)
            if k < len(self.weights) - 1:
                y = torch.relu(y)
                if dropout:  # what is left counts more, so that nothing changes when none is left out
                    y = y * (torch.rand(y.shape, generator=chance) >= dropout) / (1.0 - dropout)
        return y if self.skip is None else y + x @ self.skip


def teach(lesson: Lesson, options: TrainingOptions, folder: Path, tell: Tell) -> Taught:
    """Trains to the last epoch, from the checkpoint in `folder` where there is one of the same lesson and options.

    Args:
        lesson: scaled inputs and outputs, and the shape of the network.
        options: of networks and training.
        folder: of the checkpoints.
        tell: called after each epoch with name, epoch, loss and validation loss.
    """
    torch.set_num_threads(1)  # sums in one order: the same bytes every time
    torch.use_deterministic_algorithms(True)
    net = _Net(lesson, options)
    optimiser = torch.optim.AdamW(net.parameters(), lr=options.rate, weight_decay=options.decay, foreach=True)
    path = folder / f"{lesson.name}.checkpoint"
    fingerprint = lesson.fingerprint(options)
    curve = _take_up(path, fingerprint, net, optimiser)
    loss, jitter = _Loss(lesson, options), options.jitter if options.kind != "documented" else 0.0
    x = torch.from_numpy(loss.scale_inputs(lesson.x))
    x_check = torch.from_numpy(loss.scale_inputs(lesson.x_validation))
    y = loss.answers(lesson.feasible, lesson.y, lesson.worth)
    y_check = loss.answers(lesson.feasible_validation, lesson.y_validation, lesson.worth_validation)
    for epoch in range(len(curve), options.epochs):
        noise = torch.Generator().manual_seed(_seed(lesson, options) + epoch + 1)
        order = np.random.default_rng([_seed(lesson, options), epoch]).permutation(len(x))
        total, steps = 0.0, -(-len(x) // options.batch)
        for step, rows in enumerate(np.array_split(order, steps)):
            progress = (epoch + step / steps) / options.epochs
            for group in optimiser.param_groups:
                group["lr"] = options.rate * 0.5 * (1.0 + np.cos(np.pi * progress))
            batch = torch.from_numpy(rows)
            seen = x[batch]
            if jitter:
                seen = seen + jitter * torch.randn(seen.shape, generator=noise)
            value = loss(net(seen, options.dropout, noise), *(a[batch] for a in y))
            optimiser.zero_grad(set_to_none=True)
            value.backward()
            optimiser.step()
            total += float(value.detach()) * len(rows)
        with torch.no_grad():
            check = float(loss(net(x_check), *y_check)) if len(x_check) else float("nan")
        curve.append((total / len(x), check))
        _keep(path, fingerprint, net, optimiser, curve)
        tell(lesson.name, epoch + 1, *curve[-1])
    return Taught(fold_scaling(lesson, _plain(net)), tuple(curve))


class _Loss:
    """Log loss of feasibility, and Huber loss of the scaled outputs (documented: squared) over feasible rows."""

    def __init__(self, lesson: Lesson, options: TrainingOptions) -> None:
        self._lesson, self._documented = lesson, options.kind == "documented"
        self._mean, self._spread = lesson.input_scaling()
        self._centre, self._scale = lesson.output_scaling()
        self._logit_weight = options.logit_weight
        # ReLU of the objective itself, in scaled units: it may not fall below where zero lies.
        self._zero = float(-self._centre[0] / self._scale[0]) if lesson.positive_first else 0.0

        low, high = ((bound - self._centre) / self._scale for bound in lesson.bounds())
        near = _NEAR_BOUND / self._scale
        self._low, self._high = (torch.from_numpy(b.astype(np.float32)) for b in (low + near, high - near))

    def scale_inputs(self, x: np.ndarray) -> np.ndarray:
        return ((x - self._mean) / self._spread).astype(np.float32)

    def answers(self, feasible: np.ndarray, y: np.ndarray, worth: np.ndarray | None) -> tuple[torch.Tensor, ...]:
        """Feasibility, its product with the rows' worth, and scaled outputs."""
        scaled = ((y - self._centre) / self._scale).astype(np.float32)
        yes = feasible.astype(np.float32)
        weight = yes if worth is None else yes * worth
        return torch.from_numpy(yes), torch.from_numpy(weight), torch.from_numpy(scaled)

    def __call__(
        self, out: torch.Tensor, feasible: torch.Tensor, weight: torch.Tensor, y: torch.Tensor
    ) -> torch.Tensor:
        value = torch.zeros(())
        first = int(self._lesson.classifies)
        if first:
            value = torch.nn.functional.binary_cross_entropy_with_logits(out[:, 0], feasible) * self._logit_weight
        if y.shape[1] == 0:
            return value
        regressed = out[:, first:]
        if self._lesson.positive_first:
            objective = torch.clamp(regressed[:, :1], min=self._zero)
            # A unit that answers zero for everything would never learn: a hundredth of the slope leads it back.
            objective = objective + 0.01 * (regressed[:, :1] - objective)
            regressed = torch.cat([objective, regressed[:, 1:]], dim=1)
        if self._lesson.bounded:
            regressed = torch.where(y <= self._low, torch.maximum(regressed, y), regressed)
            regressed = torch.where(y >= self._high, torch.minimum(regressed, y), regressed)
        error = regressed - y
        if self._documented:
            per_row = (error**2).mean(dim=1)
        else:
            huber = torch.nn.functional.huber_loss(regressed, y, reduction="none", delta=_HUBER)
            per_row = huber.mean(dim=1) / _HUBER
        return value + (per_row * weight).sum() / weight.sum().clamp(min=1.0)


def _plain(net: _Net) -> Mlp:
    skip = None if net.skip is None else net.skip.detach().numpy().copy()
    weights = tuple(W.detach().numpy().copy() for W in net.weights)
    return Mlp(weights, tuple(b.detach().numpy().copy() for b in net.biases), skip)


def _seed(lesson: Lesson, options: TrainingOptions) -> int:
    """Differs from network to network, and does not depend on Python's salted hashes."""
    return zlib.crc32(f"{lesson.name}/{options.seed}".encode())


def _keep(path: Path, fingerprint: str, net: _Net, optimiser: torch.optim.AdamW, curve: list) -> None:
    tensors = {}
    for k, parameter in enumerate(net.parameters()):
        tensors[f"{k}.value"] = parameter.detach().numpy()
        for name in _ADAM:
            tensors[f"{k}.{name}"] = optimiser.state[parameter][name].numpy()
    path.parent.mkdir(parents=True, exist_ok=True)
    facts = {"fingerprint": fingerprint, "curve": json.dumps(curve)}
    write_whole(path, save(tensors, metadata=facts))


def _take_up(path: Path, fingerprint: str, net: _Net, optimiser: torch.optim.AdamW) -> list[tuple[float, float]]:
    """Fills in what a checkpoint holds and returns its curve; a checkpoint of anything else is passed over."""
    try:
        with safe_open(path, framework="numpy") as file:
            facts = file.metadata() or {}
            if facts.get("fingerprint") != fingerprint:
                return []
            tensors = {key: file.get_tensor(key) for key in file.keys()}  # noqa: SIM118 (not a mapping)
            curve = [(float(a), float(b)) for a, b in json.loads(facts["curve"])]
    except (OSError, SafetensorError):
        return []
    for k, parameter in enumerate(net.parameters()):
        with torch.no_grad():
            parameter.copy_(torch.from_numpy(tensors[f"{k}.value"].copy()))
        optimiser.state[parameter] = {name: torch.from_numpy(tensors[f"{k}.{name}"].copy()) for name in _ADAM}
    return curve
