"""Draws the guiding path that a plan was made along: a colour for each motion mode, thick where stored plans were adapted."""

# pydrake's stubs take the first parameter of ndarray for its type, and reject every array.
# pyright: reportArgumentType=false

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from pydrake.geometry import Meshcat, Rgba

from drakeplan.plan.plan import Plan
from drakeplan.playback import terrain_mesh

MODE_COLOURS = {
    "feet": Rgba(0.20, 0.42, 0.86),
    "left_palm": Rgba(0.0, 0.72, 0.82),
    "right_palm": Rgba(0.84, 0.10, 0.74),
    "all": Rgba(0.55, 0.20, 0.75),
    "any": Rgba(0.92, 0.92, 0.95),
}
MODE_WORDS = {"feet": "feet", "left_palm": "feet, left palm", "right_palm": "feet, right palm", "all": "feet, both palms",
              "any": "any palms"}  # fmt: skip
METHOD_WORDS = {"search": "searched", "adapt": "adapted, thick"}
RADIUS = {"search": 0.012, "adapt": 0.024}  # [m]
LIFT = 0.06  # [m] over the ground


@dataclass(frozen=True, eq=False)
class GuideSegment:
    """A stretch of the guiding path.

    Attributes:
        mode: key of `MODE_COLOURS`.
        method: key of `METHOD_WORDS`.
        way: (n, 3) points on the ground [m].
    """

    mode: str
    method: str
    way: np.ndarray

    @property
    def words(self) -> str:
        """What the legend calls it."""
        return f"guiding path: {MODE_WORDS[self.mode]} ({METHOD_WORDS[self.method]})"


def guide_of(plan: Plan) -> list[GuideSegment]:
    """The segments that a plan's provenance tells of; those that are not as they should be are left out."""
    found, told = [], plan.provenance.get("guide")
    for entry in told if isinstance(told, list) else []:
        try:
            mode, method, way = str(entry["mode"]), str(entry["method"]), np.array(entry["way"], float)
        except (TypeError, ValueError, KeyError):
            continue
        shaped = way.ndim == 2 and way.shape[1:] == (3,) and len(way) > 1 and bool(np.isfinite(way).all())
        if shaped and mode in MODE_COLOURS and method in METHOD_WORDS:
            found.append(GuideSegment(mode, method, way))
    return found


def draw_guide(meshcat: Meshcat, plan: Plan, root: str) -> None:
    """Draws the segments, if the plan has any.

    Args:
        meshcat: to draw in.
        plan: whose guiding path it is.
        root: folder of meshcat's scene graph.
    """
    for k, segment in enumerate(guide_of(plan)):
        moved = np.linalg.norm(np.diff(segment.way, axis=0), axis=1) > 1e-4
        path = segment.way[np.concatenate([[True], moved])] + [0.0, 0.0, LIFT]
        if len(path) > 1:
            vertices, faces = terrain_mesh.tube(path, radius=RADIUS[segment.method])
            colour = MODE_COLOURS[segment.mode]
            meshcat.SetTriangleMesh(f"{root}/guide/{k}", vertices.T, faces.T.astype(np.int32), colour)
