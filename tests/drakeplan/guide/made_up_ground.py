"""Small grounds whose answers are known: stones that do not touch, floors, walls, mirror images and moved ones."""

from __future__ import annotations

import numpy as np

from drakeplan.context import QueryContext
from drakeplan.guide.ground_view import documented_steps
from drakeplan.guide.torso_graph import TorsoGraph
from drakeplan.guide.traversability_map import guide_graph
from optimization.inverse_kinematics.whole_body_ik import WholeBodyIK
from scenes.library.plates import level_plate, rectangle, tilted_plate, wall_plate
from scenes.robots.robot import load_robot
from scenes.scene import Goal, Scene, Start
from scenes.terrain.surface import Surface
from scenes.terrain.terrain import Box, Terrain, terrain_from

ESCHER = load_robot("escher")
MODEL, STEPS = documented_steps(ESCHER)


def stones(seed: int, walls: bool = True) -> Terrain:
    """Tilted stones about the origin, some missing, over a floor that feet do not reach, and a wall on either side."""
    rng = np.random.default_rng(seed)
    surfaces = [
        tilted_plate(f"stone_{i}_{j}", (0.6 * i, 0.6 * j, float(rng.uniform(-0.05, 0.05))), rectangle(0.57, 0.57),
                     *(float(a) for a in rng.uniform(-0.12, 0.12, 3)))
        for i in range(-2, 3) for j in range(-1, 2) if rng.uniform() < 0.8
    ]  # fmt: skip
    if walls:
        surfaces += [
            wall_plate("left", (-0.9, 0.7), 0.75, (1.0, 1.55)),
            wall_plate("right", (-0.6, 1.0), -0.7, (1, 1.7)),
        ]
    return terrain_from([*surfaces, level_plate("below", (-1.9, 1.9), (-1.4, 1.4), -0.5)])


def mirrored(terrain: Terrain) -> Terrain:
    """The mirror image, left for right."""
    return terrain_from([Surface(s.name, (s.vertices * [1, -1, 1])[::-1], s.friction) for s in terrain.surfaces])


def moved(terrain: Terrain, R: np.ndarray, p: np.ndarray) -> Terrain:
    """The same terrain elsewhere."""
    return terrain_from([Surface(s.name, s.vertices @ R.T + p, s.friction) for s in terrain.surfaces])


def box(name: str, low: tuple[float, float, float], high: tuple[float, float, float]) -> Box:
    """A box along the axes between two corners [m]."""
    X_WO = np.eye(4)
    X_WO[:3, 3] = 0.5 * (np.array(low) + high)
    return Box(name, np.array(high, float) - low, X_WO)


def scene_on(terrain: Terrain, goal: tuple[float, float], start: tuple[float, float] = (0.0, 0.0)) -> Scene:
    """A scene on the floor z = 0."""
    return Scene("made_up", terrain, Start((*start, 0.0)), Goal((*goal, 0.0), 0.2))


def floor(x: tuple[float, float], y: tuple[float, float], *boxes: Box) -> Terrain:
    """A level floor at z = 0, and boxes on it."""
    return Terrain((level_plate("floor", x, y),), boxes)


def graph_of(scene: Scene, ik: WholeBodyIK) -> tuple[TorsoGraph, int]:
    """The torso's graph and the node of the start."""
    context = QueryContext(scene, ESCHER, ik)
    found = guide_graph(context, STEPS.translations, context.start)
    assert found is not None
    return found


def plain_edges(graph: TorsoGraph) -> list[tuple[int, int, int, int, float]]:
    """(tail, head, step, translation, length [m]) of all edges, from the graph's arrays and nothing else."""
    there: dict[tuple[int, int, int], list[int]] = {}
    for n, key in enumerate(map(tuple, graph.place.tolist())):
        there.setdefault(key, []).append(n)
    cells: dict[tuple[int, int], list[float]] = {}
    for (i, j, _), nodes in there.items():
        cells.setdefault((i, j), []).extend(graph.z[n] for n in nodes)

    def nearest(key: tuple[int, int, int], z: float) -> int:
        near = [n for n in there.get(key, ()) if abs(graph.z[n] - z) <= graph.step]
        return min(near, key=lambda n: abs(graph.z[n] - z), default=-1)

    edges, most = [], graph.offset.shape[1]
    for n, (i, j, t) in enumerate(graph.place.tolist()):
        for e in range(most):
            u, v = graph.offset[t, e].tolist()
            other = nearest((i + u, j + v, t), graph.z[n]) if graph.translation[t, e] >= 0 else -1
            way = cells.get((i + u // 2, j + v // 2), ())
            if other >= 0 and (max(abs(u), abs(v)) == 1 or any(abs(z - graph.z[n]) <= graph.step for z in way)):
                edges.append((n, other, e, int(graph.translation[t, e]), graph.cell * float(np.hypot(u, v))))
        for e, turn in ((most, 1), (most + 1, -1)):
            other = nearest((i, j, (t + turn) % 12), graph.z[n])
            if other >= 0:
                edges.append((n, other, e, graph.stay, graph.turn_length))
    return edges
