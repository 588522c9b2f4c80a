"""Whether a part of the robot is wholly inside a solid, where no face is near enough to be touched."""

from __future__ import annotations

import numpy as np
from numba import njit

from optimization.multibody.body_capsules import BodyCapsules
from optimization.multibody.kinematic_tree import KinematicTree, forward
from optimization.multibody.terrain_clearance import place
from scenes.terrain.packed_terrain import PackedTerrain
from scenes.terrain.solids import in_solid


@njit(cache=True)
def inside_solids(
    tree: KinematicTree, capsules: BodyCapsules, counted: np.ndarray, packed: PackedTerrain, q: np.ndarray
) -> bool:
    """Whether the centre of a counted shape is inside a box or a closed body of a mesh.

    Args:
        tree: of the robot.
        capsules: its shape.
        counted: (S,) bool, which shapes of `capsules` count.
        packed: the terrain.
        q: (nq,) posture.
    """
    num_links = tree.parent.shape[0]
    R, p, c = np.empty((num_links, 3, 3)), np.empty((num_links, 3)), np.empty(3)
    forward(tree, q, R, p)
    for s in range(capsules.link.shape[0]):
        if counted[s]:
            link = capsules.link[s]
            place(R[link], p[link], capsules.p_LC[s], c)
            if in_solid(packed, c[0], c[1], c[2]):
                return True
    return False
