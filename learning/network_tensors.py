"""Networks of transitions as arrays by name, as weight files hold them, and back."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from learning.network import (
    NUM_REGRESSED,
    DocumentedNetworks,
    Mlp,
    SharedNetwork,
    TransitionNetwork,
)
from learning.palm_networks import NUM_PALMS, PalmNetworks
from learning.relative_features import NUM_RELATIVE
from learning.transition_features import NUM_CATEGORIES, documented_feature_names


def network_tensors(network: TransitionNetwork) -> dict[str, np.ndarray]:
    """Every array of it by name."""
    tensors: dict[str, np.ndarray] = {}
    for prefix, mlp in _named(network):
        tensors |= mlp_tensors(prefix, mlp)
    for prefix, shared in _shared(network):
        tensors |= {f"{prefix}answer.low": shared.low, f"{prefix}answer.high": shared.high}
    return tensors


def network_from_tensors(kind: str, tensors: Mapping[str, np.ndarray]) -> TransitionNetwork:
    """The inverse of `network_tensors`, for kind "palms", "shared" or "documented".

    Args:
        kind: of the arrangement.
        tensors: float32 arrays by name.

    Raises:
        ValueError: arrays are missing, have shapes that do not fit each other or this code's features, or another kind.
    """
    if kind == "shared":
        return _read_shared("", tensors)
    if kind == "palms":
        none, one, both = (_read_shared(f"palms{palms}_", tensors) for palms in range(NUM_PALMS))
        return PalmNetworks((none, one, both))
    if kind != "documented":
        raise ValueError(f"unknown kind of network {kind!r}")
    pairs: dict[str, list[Mlp | None]] = {"classifier": [], "regressor": []}
    for category in range(NUM_CATEGORIES):
        inputs = len(documented_feature_names(category))
        for name, outputs in (("classifier", 1), ("regressor", NUM_REGRESSED)):
            there = f"{name}{category}.0.weight" in tensors
            pairs[name].append(read_mlp(f"{name}{category}", tensors, inputs, outputs) if there else None)
    return DocumentedNetworks(tuple(pairs["classifier"]), tuple(pairs["regressor"]))


def _shared(network: TransitionNetwork) -> list[tuple[str, SharedNetwork]]:
    """The shared networks that it is made of, each with the prefix of its names."""
    if isinstance(network, PalmNetworks):
        return [(f"palms{palms}_", one) for palms, one in enumerate(network.networks)]
    return [("", network)] if isinstance(network, SharedNetwork) else []


def _named(network: TransitionNetwork) -> list[tuple[str, Mlp]]:
    if isinstance(network, DocumentedNetworks):
        named = [(f"classifier{k}", mlp) for k, mlp in enumerate(network.classifiers)]
        named += [(f"regressor{k}", mlp) for k, mlp in enumerate(network.regressors)]
        return [(name, mlp) for name, mlp in named if mlp is not None]
    return [(f"{prefix}member{k}", mlp) for prefix, shared in _shared(network) for k, mlp in enumerate(shared.members)]


def _read_shared(prefix: str, tensors: Mapping[str, np.ndarray]) -> SharedNetwork:
    count = len({name.split(".")[0] for name in tensors if name.startswith(f"{prefix}member")})
    members = tuple(read_mlp(f"{prefix}member{k}", tensors, NUM_RELATIVE, 1 + NUM_REGRESSED) for k in range(count))
    if not members:
        raise ValueError(f"no member of the network {prefix.rstrip('_')}".rstrip())
    if any(member.shape != members[0].shape for member in members):
        raise ValueError(f"members have different widths: {', '.join(str(m.shape) for m in members)}")
    bounds = [tensors.get(f"{prefix}answer.{name}", np.zeros(0)) for name in ("low", "high")]
    if any(bound.shape != (NUM_REGRESSED,) for bound in bounds):
        raise ValueError(f"{prefix}answer.low and {prefix}answer.high must have {NUM_REGRESSED} numbers each")
    return SharedNetwork(members, bounds[0], bounds[1])


def mlp_tensors(prefix: str, mlp: Mlp) -> dict[str, np.ndarray]:
    """The arrays of one network by name.

    Args:
        prefix: of the names.
        mlp: the network.
    """
    tensors: dict[str, np.ndarray] = {}
    for k, (W, b) in enumerate(zip(mlp.weights, mlp.biases, strict=True)):
        tensors[f"{prefix}.{k}.weight"], tensors[f"{prefix}.{k}.bias"] = W, b
    if mlp.skip is not None:
        tensors[f"{prefix}.skip"] = mlp.skip
    return tensors


def read_mlp(prefix: str, tensors: Mapping[str, np.ndarray], inputs: int, outputs: int) -> Mlp:
    """The inverse of `mlp_tensors`.

    Args:
        prefix: of the names.
        tensors: float32 arrays by name.
        inputs, outputs: numbers that are expected.

    Raises:
        ValueError: arrays are missing or have other shapes.
    """
    weights, biases = [], []
    while f"{prefix}.{len(weights)}.weight" in tensors:
        name = f"{prefix}.{len(weights)}"
        W, b = tensors[f"{name}.weight"], tensors.get(f"{name}.bias")
        width = weights[-1].shape[1] if weights else inputs
        if W.ndim != 2 or W.shape[0] != width or b is None or b.shape != (W.shape[1],):
            raise ValueError(f"{name}.weight has shape {W.shape}, expected ({width}, outputs) and a bias as long")
        weights.append(W)
        biases.append(b)
    if not weights or weights[-1].shape[1] != outputs:
        raise ValueError(f"{prefix} has not {outputs} outputs")
    skip = tensors.get(f"{prefix}.skip")
    if skip is not None and skip.shape != (inputs, outputs):
        raise ValueError(f"{prefix}.skip has shape {skip.shape}, expected {(inputs, outputs)}")
    return Mlp(tuple(weights), tuple(biases), skip)
