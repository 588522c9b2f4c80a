"""Maps of traversability costs and distances by them: near ways only, in metres of level ground, harder is farther."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from made_up_ground import ESCHER, STEPS, box, floor, scene_on

import drakeplan.guide.traversability_map as maps
from drakeplan.contact_planning.contact_plan import PlannerOptions
from drakeplan.contact_planning.search_planner import SearchPlanner
from drakeplan.context import QueryContext
from drakeplan.experience import stored_plan
from drakeplan.guide.promising_paths import nodes_near
from drakeplan.guide.torso_graph import StepWeights, costs_to_go, torso_poses
from drakeplan.guide.traversability_grid import FOOT_PER_TORSO, HARDNESS, TraversabilityGrid, traversability_grid
from drakeplan.guide.traversability_map import NEAR, TURN, TraversabilityMap, nearest_node, traversability_map
from learning import traversability_labels
from learning.footstep_counts import PoseFeatures
from learning.traversability import Traversability
from learning.weights import NoWeightsError
from scenes.library import rubble_corridor
from scenes.library.plates import wall_plate
from scenes.scene import Scene
from scenes.terrain.terrain import Terrain

GOAL = (2.5, 0.0)
PER_METRE, STEP = 4.0, 3.0


class Known:
    """A regressor whose answers are known: so many useful footsteps as there are score, or the same everywhere."""

    def __init__(self, everywhere: float | None = None) -> None:
        self.everywhere, self.seen = everywhere, []

    def counts(self, mode: int, seen: PoseFeatures) -> np.ndarray:
        self.seen.append((mode, seen))
        if self.everywhere is not None:
            return np.full_like(seen.feet, self.everywhere)
        return 0.01 * seen.feet + 0.1 * seen.palms.sum(axis=1, keepdims=True) * mode


def use(monkeypatch: pytest.MonkeyPatch, regressor: Known, kind: str = "network", footholds: str = "fixed") -> Known:
    made = Traversability(kind, regressor, {"translations": STEPS.translations.tolist(), "footholds": footholds})
    monkeypatch.setattr(maps, "load_traversability", lambda robot, model, kind: made)
    return regressor


def walled_floor() -> Scene:
    ground = floor((-0.5, 3.0), (-0.7, 0.7))
    return scene_on(Terrain((*ground.surfaces, wall_plate("w", (-0.5, 3.0), 0.75, (1.0, 1.6)))), GOAL)


def map_of(scene: Scene, ik, modes: tuple[int, ...] = (0,)) -> TraversabilityMap:
    known = traversability_map(QueryContext(scene, ESCHER, ik), modes)
    assert known is not None
    return known


def test_steps_near_a_way_have_the_cost_of_their_footsteps_and_all_others_count_as_hopeless(ik, monkeypatch) -> None:
    regressor = use(monkeypatch, Known())
    known = map_of(walled_floor(), ik, (0, 1))
    assert [mode for mode, _ in regressor.seen] == [0, 1]
    near = nodes_near(known.graph, list(known.paths), NEAR, TURN)
    np.testing.assert_array_equal(np.flatnonzero(known.row < known.cost.shape[1] - 1), near)
    np.testing.assert_array_equal(np.sort(known.row[near]), np.arange(len(near)))
    assert (known.cost[:, -1] == 1.0).all() and (known.cost[2:] == 1.0).all(), "not looked at, or not asked for"
    for mode, seen in regressor.seen:
        np.testing.assert_allclose(known.cost[mode, known.row[near]], np.exp(-Known().counts(mode, seen)), rtol=1e-6)
    assert known.cost.shape[2] == len(STEPS.translations) and ((known.cost >= 0) & (known.cost <= 1)).all()


def test_regressors_of_exact_features_see_exact_features(ik, monkeypatch) -> None:
    for kind, whole in (("ecc-nearest", True), ("acc-nearest", False)):
        regressor = use(monkeypatch, Known(), kind)
        map_of(walled_floor(), ik, (0, 1))
        feet = regressor.seen[0][1].feet
        assert (feet == np.round(feet)).all() == whole and feet.max() > 0


def test_regressors_of_feet_that_move_see_the_scores_of_where_they_move_to(ik, monkeypatch) -> None:
    fixed, snapped = (
        use(monkeypatch, Known(), footholds=how) and map_of(walled_floor(), ik) for how in ("fixed", "snapped")
    )
    assert (snapped.cost[0] <= fixed.cost[0] + 1e-6).all() and (snapped.cost[0] < fixed.cost[0] - 0.01).any()


def test_palms_are_not_looked_for_where_no_mode_has_any(ik, monkeypatch) -> None:
    regressor = use(monkeypatch, Known())
    map_of(walled_floor(), ik, (0,))
    assert not regressor.seen[0][1].palms.any()
    map_of(walled_floor(), ik, (0, 1))
    assert regressor.seen[-1][1].palms.any()


def test_the_map_begins_at_the_node_nearest_to_the_feet(ik, monkeypatch) -> None:
    use(monkeypatch, Known())
    known = map_of(walled_floor(), ik)
    (pose,) = torso_poses(known.graph, np.array([known.start]))
    assert np.abs(pose[:2]).max() <= 0.5 * known.graph.cell + 1e-9 and pose[3] == 0.0
    assert nearest_node(known.graph, pose[:3], 0.0) == known.start
    turned = nearest_node(known.graph, pose[:3], -0.5 * np.pi)
    np.testing.assert_allclose(torso_poses(known.graph, np.array([turned]))[0], [*pose[:3], 1.5 * np.pi])


def test_where_the_grid_knows_no_way_there_is_no_map_and_no_distance(ik) -> None:
    shut = box("wall", (1.0, -1.0, 0.0), (1.1, 1.0, 2.0))
    context = QueryContext(scene_on(floor((-0.5, 3.0), (-0.7, 0.7), shut), GOAL), ESCHER, ik)
    assert traversability_map(context, (0,)) is None
    grid = traversability_grid(context, False, PER_METRE, STEP, "network")
    assert grid.map is None and np.isinf(grid.distance(*np.zeros((4, 3)))).all()


def test_a_robot_without_weights_is_said_to_have_none(ik) -> None:
    other = dataclasses.replace(ESCHER, name="other")
    with pytest.raises(NoWeightsError, match="robot 'other' has no such traversability weights"):
        traversability_map(QueryContext(walled_floor(), other, ik), (0,))


# ---- distances


def grid_of(scene: Scene, ik, kind: str = "network", use_palms: bool = True) -> TraversabilityGrid:
    return traversability_grid(QueryContext(scene, ESCHER, ik), use_palms, PER_METRE, STEP, kind)


def ask(grid: TraversabilityGrid, x: float, y: float, yaw: float = 0.0, z: float = 0.0) -> float:
    return float(grid.distance(*(np.array([a]) for a in (x, y, z, yaw)))[0])


def test_on_easy_level_ground_the_distance_is_that_of_the_feet_with_their_steps(ik, monkeypatch) -> None:
    use(monkeypatch, Known(50.0))
    grid = grid_of(walled_floor(), ik)
    stride = grid.map.graph.cell * np.hypot(*grid.map.graph.offset[0].T).max()
    for x in (0.0, 0.6, 1.2):
        far = GOAL[0] - 0.2 - x
        least, most = (
            FOOT_PER_TORSO * d + STEP * n for d, n in ((far - 0.1, (far - 0.1) / stride), (far + 0.3, far / stride + 1))
        )
        assert least <= PER_METRE * ask(grid, x, 0.0) <= most
    assert ask(grid, *GOAL) == 0.0


def test_ground_on_which_every_step_fails_is_as_far_as_more_steps_cost(ik, monkeypatch) -> None:
    use(monkeypatch, Known(0.0))
    hopeless = grid_of(walled_floor(), ik)
    use(monkeypatch, Known(50.0))
    easy = grid_of(walled_floor(), ik)
    x = np.linspace(-0.2, 2.0, 12)
    poses = x, 0.1 * np.cos(5 * x), 0 * x, 0.3 * np.sin(7 * x)
    graph = easy.map.graph
    dearer = costs_to_go(
        graph, StepWeights(FOOT_PER_TORSO, STEP + HARDNESS), easy.map.row, 0.0 * easy.map.cost, np.array([0])
    )
    assert (hopeless.distance(*poses) >= easy.distance(*poses)).all()
    at = easy.map.start
    pose = torso_poses(graph, np.array([at]))[0]
    assert ask(hopeless, *pose[:2], pose[3]) == pytest.approx(dearer[at] / PER_METRE, rel=1e-5)


def test_between_cells_it_is_interpolated_at_the_nearest_heading(ik, monkeypatch) -> None:
    use(monkeypatch, Known())
    grid = grid_of(walled_floor(), ik)
    graph, modes = grid.map.graph, np.arange(4)
    weights = StepWeights(FOOT_PER_TORSO, STEP, HARDNESS)
    to_go = costs_to_go(graph, weights, grid.map.row, grid.map.cost, modes) / PER_METRE
    at = {key: to_go[n] for n, key in enumerate(map(tuple, graph.place.tolist()))}
    rng = np.random.default_rng(0)
    for _ in range(100):
        x, y, yaw = rng.uniform([-0.2, -0.3, -np.pi], [2.2, 0.3, np.pi])
        u, v = (np.array([x, y]) - graph.origin) / graph.cell - 0.5
        i, j, t = int(np.floor(u)), int(np.floor(v)), round(yaw / (np.pi / 6)) % 12
        corners = [
            ((1 - abs(u - i - a)) * (1 - abs(v - j - b)), at[i + a, j + b, t])
            for a in (0, 1) for b in (0, 1) if (i + a, j + b, t) in at
        ]  # fmt: skip
        expected = sum(w * d for w, d in corners) / sum(w for w, _ in corners)
        assert ask(grid, x, y, yaw) == pytest.approx(expected, abs=1e-6)
    assert ask(grid, 50.0, 0.0) == np.inf and ask(grid, 0.0, 0.0, z=1.0) == np.inf


def test_with_palms_a_step_counts_in_its_best_mode(ik, monkeypatch) -> None:
    class BetterWithPalms(Known):
        def counts(self, mode: int, seen: PoseFeatures) -> np.ndarray:
            return np.full_like(seen.feet, 3.0 if mode else 0.1)

    use(monkeypatch, BetterWithPalms())
    with_palms, without = (grid_of(walled_floor(), ik, use_palms=palms) for palms in (True, False))
    assert ask(with_palms, 0.0, 0.0) < ask(without, 0.0, 0.0) - 0.5
    use(monkeypatch, Known(0.1))
    assert ask(without, 0.0, 0.0) == pytest.approx(ask(grid_of(walled_floor(), ik), 0.0, 0.0), rel=1e-6)


@pytest.mark.parametrize("kind", ["network", "acc-svr", "ecc-nearest"])
def test_weights_that_come_with_the_robot_make_rubble_no_nearer_than_easy_ground(ik, monkeypatch, kind: str) -> None:
    scene = rubble_corridor.named(0)
    learned = grid_of(scene, ik, kind)
    use(monkeypatch, Known(50.0))
    easy = grid_of(scene, ik)
    assert ((learned.map.cost >= 0.0) & (learned.map.cost <= 1.0)).all()
    assert ask(easy, 0.025, 0.0) <= ask(learned, 0.025, 0.0) < np.inf


def test_the_search_takes_it_for_its_heuristic_and_makes_it_once_a_query(ik) -> None:
    context = QueryContext(walled_floor(), ESCHER, ik)
    options = PlannerOptions(heuristic="traversability")
    SearchPlanner(context, options)
    grids = {key: made for key, made in context.made.items() if isinstance(made, TraversabilityGrid)}
    assert len(grids) == 1
    SearchPlanner(context, options)
    assert grids == {key: made for key, made in context.made.items() if isinstance(made, TraversabilityGrid)}
    SearchPlanner(context, dataclasses.replace(options, use_palms=False))
    assert sum(isinstance(made, TraversabilityGrid) for made in context.made.values()) == 2


def test_learned_modes_and_those_of_plans_have_the_same_numbers() -> None:
    assert traversability_labels.MODES == stored_plan.MODES
