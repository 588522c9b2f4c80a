"""Weights on disk: a safetensors file with the arrays and a JSON card that says what they are.

The card names the features, the robot and the data, and holds the SHA-256 of the weights. Whatever does not fit
together is refused in one line; nothing in either file is ever executed.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from safetensors import SafetensorError
from safetensors.numpy import load, save

from scenes.files.whole_file import write_whole
from scenes.input_error import InputError

FORMAT, FORMAT_VERSION = "drakeplan-surrogate", 1
PRETRAINED = Path(__file__).parent / "pretrained"  # one folder a robot


class WeightsError(InputError):
    """A weight file or its card is missing, damaged, or belongs to something else."""


class NoWeightsError(WeightsError):
    """There are no weights for this robot at all: the exact program has to answer."""


class OtherRobotError(WeightsError):
    """The weights are whole, but were trained for a robot of other mass, patches or reaches."""


def write_weights(folder: Path, name: str, tensors: Mapping[str, np.ndarray], card: Mapping[str, Any]) -> Path:
    """Writes `<name>.safetensors` and `<name>.json`, each whole or not at all; the same arrays give the same bytes.

    Args:
        folder: is made where it is missing.
        name: of both files.
        tensors: float32 arrays by name.
        card: JSON values; format, version, name, shapes and hash are added.

    Returns:
        The path of the weights.

    Raises:
        InputError: a file cannot be written.
    """
    arrays = {key: np.ascontiguousarray(tensors[key], np.float32) for key in sorted(tensors)}
    data = save(arrays)
    shapes = {key: list(array.shape) for key, array in arrays.items()}
    facts = {"format": FORMAT, "version": FORMAT_VERSION, "name": name, **card}
    facts |= {"sha256": hashlib.sha256(data).hexdigest(), "shapes": shapes}
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / f"{name}.safetensors"
    write_whole(path, data)
    write_whole(folder / f"{name}.json", (json.dumps(facts, indent=1, allow_nan=False) + "\n").encode())
    return path


def read_weights(folder: Path, name: str) -> tuple[dict[str, np.ndarray], dict[str, Any]]:
    """Arrays and card.

    Args:
        folder: where both files are.
        name: of both files.

    Raises:
        NoWeightsError: neither file exists.
        WeightsError: one is missing, truncated, foreign, of another version, does not fit the other, or holds NaN.
    """
    path, card_path = folder / f"{name}.safetensors", folder / f"{name}.json"
    if not path.is_file() and not card_path.is_file():
        raise NoWeightsError(f"{path}: there are no such weights")
    card = _read_card(card_path)
    try:
        data = path.read_bytes()
    except OSError:
        raise WeightsError(f"{path}: missing, though its card {card_path.name} is there") from None
    if hashlib.sha256(data).hexdigest() != card["sha256"]:
        raise WeightsError(f"{path}: SHA-256 differs from its card's: truncated, changed or of another training")
    try:
        tensors = load(data)
    except SafetensorError as error:
        raise WeightsError(f"{path}: expected safetensors ({error})") from None
    shapes = {key: list(array.shape) for key, array in tensors.items()}
    if shapes != card["shapes"]:
        wrong = sorted(key for key in {*shapes, *card["shapes"]} if shapes.get(key) != card["shapes"].get(key))[0]
        raise WeightsError(f"{path}: {wrong} has shape {shapes.get(wrong)}, its card says {card['shapes'].get(wrong)}")
    for key, array in tensors.items():
        if array.dtype != np.float32 or not np.isfinite(array).all():
            raise WeightsError(f"{path}: {key} must hold finite float32 numbers")
    return tensors, card


def _read_card(path: Path) -> dict[str, Any]:
    try:
        card = json.loads(path.read_text(encoding="utf-8"))
    except OSError:
        raise WeightsError(f"{path}: missing, though its weights are there") from None
    except ValueError:
        raise WeightsError(f"{path}: expected a JSON card") from None
    if not isinstance(card, dict) or card.get("format") != FORMAT:
        raise WeightsError(f"{path}: expected a card of format {FORMAT}")
    if card.get("version") != FORMAT_VERSION:
        raise WeightsError(f"{path}: expected version {FORMAT_VERSION}, got {card.get('version')}")
    if not isinstance(card.get("sha256"), str) or not isinstance(card.get("shapes"), dict):
        raise WeightsError(f"{path}: expected the keys sha256 and shapes")
    return card
