"""What a training is to do; no torch here, so that the command line can read its defaults."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from scenes.input_error import InputError

Kind = Literal["palms", "shared", "documented"]


@dataclass(frozen=True)
class TrainingOptions:
    """Settings of one training; equal options, data and seed give equal bytes on a CPU.

    Attributes:
        kind: "documented": Lin et al. 2019 sec. VII as it stands; "shared": one network for all categories; "palms": one
            for each number of palms held.
        width: of every hidden layer.
        depth: hidden layers.
        epochs: passes over the data.
        batch: rows of one step.
        rate: greatest learning rate of AdamW; it falls to zero along a cosine.
        decay: weight decay of AdamW.
        jitter: spread of what is added at random to the scaled inputs in every step; a smooth function bears it, and
            learns to be one (Bishop 1995). Not "documented", like the next three.
        dropout: share of the hidden units that are left out at random in every step (Lin 2020 fig. 7.3: 0.1).
        members: networks that are averaged.
        logit_weight: of the feasibility's log loss beside the regression.
        dear: objective of a transition whose outcome counts half: 1 / (1 + objective / dear). Plans are made of cheap ones.
        seed: of the split by scene, the initial weights and the order of the rows.
        recall: least share of feasible transitions that the threshold (never above 1/2) lets through, on the validation scenes.
    """

    kind: Kind = "shared"
    width: int = 256
    depth: int = 3
    epochs: int = 100
    batch: int = 256
    rate: float = 1e-3
    decay: float = 1e-2
    jitter: float = 0.2
    dropout: float = 0.0
    members: int = 1
    logit_weight: float = 1.0
    dear: float = 300.0
    seed: int = 0
    recall: float = 0.95

    def __post_init__(self) -> None:
        for name in ("width", "depth", "epochs", "batch", "members"):
            if getattr(self, name) < 1:
                raise InputError(f"training: {name} must be at least 1, got {getattr(self, name)}")
        if not 0.0 < self.recall <= 1.0:
            raise InputError(f"training: recall must lie in (0, 1], got {self.recall}")
        for name in ("rate", "logit_weight", "dear"):
            if not getattr(self, name) > 0:
                raise InputError(f"training: {name} must be positive, got {getattr(self, name)}")
        if not 0.0 <= self.dropout < 1.0:
            raise InputError(f"training: dropout must lie in [0, 1), got {self.dropout}")
        for name in ("decay", "jitter", "seed"):
            if not getattr(self, name) >= 0:
                raise InputError(f"training: {name} must not be negative, got {getattr(self, name)}")


def recommended(kind: Kind) -> TrainingOptions:
    """What `drakeplan train` does unless told otherwise; "palms" is how the weights that come with drakeplan were made."""
    if kind == "documented":
        return TrainingOptions(kind="documented", width=256, depth=3, epochs=100)
    if kind == "palms":
        return TrainingOptions(kind="palms", width=384, depth=3, epochs=100, jitter=0.05)
    return TrainingOptions(kind="shared", width=192, depth=3, epochs=50, members=2)
