"""Bodies beside each other whose shapes overlap by design, so that no posture keeps them apart."""

# pydrake's stubs read "float64[3, 1]" as a shape and refuse every array.
# pyright: reportArgumentType=false, reportAttributeAccessIssue=false

from __future__ import annotations

from collections import Counter

import numpy as np
from pydrake.geometry import PenetrationAsPointPair, SceneGraphInspector
from pydrake.multibody.plant import MultibodyPlant

from drakeplan.robot_setup.link_tree import LinkTree

SAMPLES = 200  # postures about the nominal one
SPREAD = 0.25  # of each joint's range
OFTEN = (
    0.05  # share of the postures in which neighbours overlap: joint limits keep real ones apart, convex shapes do not
)
ALWAYS = 0.9  # the same for bodies farther apart in the chain
NEIGHBOURS = 2  # joints between bodies whose shapes are drawn over the joint


def always_touching(tree: LinkTree, q: np.ndarray, *, seed: int = 0) -> list[tuple[str, str]]:
    """Pairs of bodies to leave out of collisions, in alphabetical order.

    Args:
        tree: of the robot, with no pair left out but those that a joint connects.
        q: (nq,) the nominal posture.
        seed: of the postures.
    """
    rng = np.random.default_rng(seed)
    plant, context = tree.plant, tree.context
    low, high = plant.GetPositionLowerLimits()[7:], plant.GetPositionUpperLimits()[7:]
    width = np.minimum(high - low, 2 * np.pi)
    owner = {body: name for name, link in tree.links.items() for body in link.bodies}
    counts: Counter[tuple[str, str]] = Counter()
    for _ in range(SAMPLES):
        sample = q.copy()
        sample[7:] = np.clip(q[7:] + SPREAD * width * rng.uniform(-1, 1, len(width)), low, high)
        with tree.posture(sample):
            query = plant.get_geometry_query_input_port().Eval(context)
            inspector = query.inspector()
            counts.update({_bodies(plant, inspector, p) for p in query.ComputePointPairPenetration()})
    return sorted(
        (a, b)
        for (a, b), count in counts.items()
        if count > SAMPLES * (OFTEN if _joints_between(tree, owner[a], owner[b]) <= NEIGHBOURS else ALWAYS)
    )


def _bodies(plant: MultibodyPlant, inspector: SceneGraphInspector, pair: PenetrationAsPointPair) -> tuple[str, str]:
    a, b = sorted(plant.GetBodyFromFrameId(inspector.GetFrameId(g)).name() for g in (pair.id_A, pair.id_B))
    return a, b


def _joints_between(tree: LinkTree, a: str, b: str) -> int:
    way_a, way_b = tree.way(a), tree.way(b)
    shared = sum(x == y for x, y in zip(way_a, way_b, strict=False))
    return len(way_a) + len(way_b) - 2 * shared
