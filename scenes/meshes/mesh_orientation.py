"""Faces turned outward: inside-out bodies, faces that disagree with their neighbours, ground sheets drawn face down."""

from __future__ import annotations

import copy
from functools import cached_property

import numpy as np
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components

from scenes.terrain.polygon import area_vectors

DOUBLED = 0.95  # share of a body's area that has to stand twice for its faces to be both sides of a sheet
WELD = 5  # decimals of a metre to which corners are the same corner


class Bodies:
    """Which triangles hang together at their corners, and the box around each such body.

    Attributes:
        triangles: (K, 3, 3) what the bodies are made of [m].
        corner: (K, 3) number of each triangle's corners; equal where they coincide.
        body: (K,) number of each triangle's body.
        count: how many bodies there are.
    """

    def __init__(self, triangles: np.ndarray) -> None:
        self.triangles = triangles
        numbers = row_numbers(np.round(triangles.reshape(-1, 3) * 10.0**WELD).astype(np.int64))
        self.corner = numbers.reshape(-1, 3)
        faces = len(triangles)
        size = faces + int(numbers.max()) + 1
        face = np.repeat(np.arange(faces), 3)
        links = coo_matrix((np.ones(3 * faces), (face, faces + numbers.ravel())), shape=(size, size))
        _, labels = connected_components(links, directed=False)
        _, self.body = np.unique(labels[:faces], return_inverse=True)
        self.count = int(self.body.max()) + 1

    def turned(self, turn: np.ndarray) -> Bodies:
        """The same bodies, the triangles marked in `turn` (K,) wound the other way."""
        if not turn.any():
            return self
        other = copy.copy(self)
        other.__dict__.pop("_edges", None)
        other.triangles = np.where(turn[:, None, None], self.triangles[:, ::-1], self.triangles)
        other.corner = np.where(turn[:, None], self.corner[:, ::-1], self.corner)
        return other

    @cached_property
    def low(self) -> np.ndarray:
        """(count, 3) lowest corner of the box around each body [m]."""
        order, starts = self._by_body
        return np.minimum.reduceat(np.minimum.reduce([self.triangles[:, k] for k in range(3)])[order], starts)

    @cached_property
    def high(self) -> np.ndarray:
        """(count, 3) greatest corner of the box around each body [m]."""
        order, starts = self._by_body
        return np.maximum.reduceat(np.maximum.reduce([self.triangles[:, k] for k in range(3)])[order], starts)

    @cached_property
    def _by_body(self) -> tuple[np.ndarray, np.ndarray]:
        order = np.argsort(self.body, kind="stable")
        return order, np.searchsorted(self.body[order], np.arange(self.count))

    def near(self, low: np.ndarray, high: np.ndarray) -> np.ndarray:
        """(K,) bool, the triangles of the bodies whose boxes meet the box from low to high (3,) [m].

        Args:
            low: (3,) lowest corner of the box [m].
            high: (3,) greatest corner of the box [m].
        """
        return np.all((self.low <= high) & (self.high >= low), axis=1)[self.body]

    def edges(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """(3 K,) edge number of each side of each triangle; then per edge its faces and how often forward less back."""
        return self._edges

    @cached_property
    def _edges(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        ends = np.stack([self.corner, np.roll(self.corner, -1, axis=1)], axis=2).reshape(-1, 2)
        edge = row_numbers(np.sort(ends, axis=1))
        return edge, np.bincount(edge), np.bincount(edge, weights=np.where(ends[:, 0] < ends[:, 1], 1, -1))

    def without(self, edge: np.ndarray, bad: np.ndarray) -> np.ndarray:
        """(count,) bool, the bodies none of whose edges is marked in `bad`.

        Args:
            edge: (3 K,) edge number of each side of each triangle, as `edges` gives them.
            bad: (edges,) bool.
        """
        clean = np.ones(self.count, bool)
        clean[np.repeat(self.body, 3)[bad[edge]]] = False
        return clean

    def closed(self) -> np.ndarray:
        """(count,) bool, bodies of which every edge is walked as often one way as the other."""
        edge, _, forward = self.edges()
        return self.without(edge, forward != 0)


def row_numbers(rows: np.ndarray) -> np.ndarray:
    """(N,) numbers of the rows of a (N, D) array of integers, equal where rows are: 0, 1, ... in the rows' order.

    Rows are packed into one integer each, column by column: sorting those is ten times faster than sorting rows.
    """
    key = np.zeros(len(rows), np.int64)
    spread = 1
    for column in rows.T:
        low = int(column.min(initial=0))
        width = int(column.max(initial=0)) - low + 1
        if spread * width >= 2**62:
            _, key = np.unique(key, return_inverse=True)
            spread = int(key.max(initial=0)) + 1
        if spread * width >= 2**62:
            _, column = np.unique(column, return_inverse=True)
            low, width = 0, int(column.max(initial=0)) + 1
        key = key * width + (column - low)
        spread *= width
    return np.unique(key, return_inverse=True)[1].ravel()


def single_faces(bodies: Bodies) -> tuple[Bodies, tuple[str, ...]]:
    """The bodies without the triangles that are the other side of one, and what was taken away.

    Programs export both sides of each face, turned against each other. Only bodies that consist of such pairs lose half of
    their faces: two blocks that touch share a face the same way, and both are solid. A sheet that is left is drawn face up.
    """
    sides = row_numbers(np.sort(bodies.corner, axis=1))
    paired = np.bincount(sides)[sides] == 2
    if not paired.any():
        return bodies, ()
    area = np.linalg.norm(area_vectors(bodies.triangles), axis=1)
    whole, twice = (np.bincount(bodies.body, weights=area * w) for w in (np.ones(len(area)), paired))
    doubled = (twice > DOUBLED * whole)[bodies.body] & paired
    if not doubled.any():
        return bodies, ()
    _, first = np.unique(sides, return_index=True)
    keep = ~doubled
    keep[first] = True
    of_doubled = doubled[keep]
    single = _agree(Bodies(bodies.triangles[keep]), ~of_doubled)
    up = np.bincount(single.body, weights=area_vectors(single.triangles)[:, 2])
    turn = (~single.closed() & (up < 0) & (np.bincount(single.body, weights=of_doubled) > 0))[single.body]
    return single.turned(turn), (
        f"{int((~keep).sum())} faces had a twin turned the other way; one of each pair was kept, turned outward",
    )


def turn_outward(bodies: Bodies) -> tuple[Bodies, tuple[str, ...]]:
    """The bodies wound counter-clockwise from outside as far as the data tells, and what was turned.

    A body whose neighbouring faces disagree is made consistent. A closed body of negative volume is inside out, unless
    its box lies in another's (a cavity) or holds another's (a room). Open sheets stay as they were drawn, unless
    nothing in the mesh faces up at all: then the sheets that face down are the ground.
    """
    notes = []
    consistent = _agree(bodies)
    if consistent is not bodies:
        turned = int((np.abs(consistent.triangles - bodies.triangles).max(axis=(1, 2)) > 1e-9).sum())
        notes += [f"{turned} faces disagreed with their neighbours and were turned"] * (turned > 0)
        bodies = consistent
    inside_out = bodies.closed()
    if inside_out.any():
        inside_out &= _volumes(bodies) < -1e-12
    for k in np.flatnonzero(inside_out):
        holds = (bodies.low >= bodies.low[k] - 1e-9).all(axis=1) & (bodies.high <= bodies.high[k] + 1e-9).all(axis=1)
        held = (bodies.low <= bodies.low[k] + 1e-9).all(axis=1) & (bodies.high >= bodies.high[k] - 1e-9).all(axis=1)
        inside_out[k] = holds.sum() == 1 and held.sum() == 1
    if inside_out.any():
        bodies = bodies.turned(inside_out[bodies.body])
        notes.append(f"{int(inside_out.sum())} closed bodies were inside out and were turned")
    up = area_vectors(bodies.triangles)[:, 2]
    if (up > 1e-12).any():
        return bodies, tuple(notes)
    down = np.bincount(bodies.body, weights=up < -1e-12) > 0
    if down.any():
        bodies = bodies.turned(down[bodies.body])
        notes.append(f"{int(down.sum())} sheets faced down with nothing facing up and were turned")
    return bodies, tuple(notes)


def _volumes(bodies: Bodies) -> np.ndarray:
    """(count,) signed volume of each body [m^3]; it says something only where the body is closed."""
    centred = bodies.triangles - bodies.low[bodies.body][:, None]
    parts = np.einsum("ki,ki->k", centred[:, 0], np.cross(centred[:, 1], centred[:, 2])) / 6
    return np.bincount(bodies.body, weights=parts)


def _agree(bodies: Bodies, drawn: np.ndarray | None = None) -> Bodies:
    """The same bodies, those triangles turned that walk an edge of two faces the same way as their neighbour.

    It is done only in bodies that it closes, or in sheets without branches, where most of the area stays as it was.

    Args:
        bodies: of triangles that may disagree.
        drawn: (K,) whose winding counts; None for all.
    """
    edge, faces, forward = bodies.edges()
    if not ((faces == 2) & (forward != 0)).any():
        return bodies
    import trimesh

    triangles = bodies.triangles
    corners = np.zeros((int(bodies.corner.max()) + 1, 3))
    corners[bodies.corner.ravel()] = triangles.reshape(-1, 3)
    mesh = trimesh.Trimesh(corners, bodies.corner, process=False)
    trimesh.repair.fix_winding(mesh)
    turned = (area_vectors(np.asarray(mesh.triangles)) * area_vectors(triangles)).sum(axis=1) < 0
    area = np.linalg.norm(area_vectors(triangles), axis=1) * (1.0 if drawn is None else drawn)
    mostly = np.bincount(bodies.body, weights=area * turned) > 0.5 * np.bincount(bodies.body, weights=area)
    turned ^= mostly[bodies.body]
    trusted = bodies.turned(turned).closed() | bodies.without(edge, faces > 2)
    return bodies.turned(turned & trusted[bodies.body])
