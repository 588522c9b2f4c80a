"""Contact states on small terrains: legal moves, the documented edge cost, and a heuristic that never overestimates."""

from __future__ import annotations

import heapq
import itertools

import numpy as np
import pytest

from drakeplan.contact_planning.contact_domain import TORSO_SWAY, ContactDomain, PlannerWeights, State
from drakeplan.contact_planning.contact_plan import PlannerOptions
from drakeplan.contact_planning.contact_pool import CELL as POOL_CELL
from drakeplan.contact_planning.contact_pool import ContactPool
from drakeplan.search.ana_star import AnaStar, Limits
from scenes.files.scene_source import load_scene
from scenes.footholds.start_stance import check_goal, start_stance
from scenes.pose import rpy_rotation
from scenes.robots.robot import load_robot
from scenes.scene import Goal, Scene, Start
from scenes.terrain.packed_terrain import PackedTerrain, pack_terrain
from scenes.terrain.surface import Surface
from scenes.terrain.terrain import Terrain
from scenes.transition_model import TransitionModel, transition_model

ROBOT = load_robot("escher")


class EverythingStands:
    """Stands in for the posture check where only geometry is under test."""

    def __init__(self, packed: PackedTerrain) -> None:
        self.pool = ContactPool(packed)

    def stands_alone(self, number: int) -> bool:
        return True

    def can_lift(self, held: tuple[int, ...], mover: int) -> str:
        return ""

    def transition(self, before: tuple[int, ...], after: tuple[int, ...]) -> str:
        return ""


def domain_on(terrain: Terrain, goal: Goal, model: TransitionModel, heuristic="grid", palms=True, longer=None):
    scene = Scene("test", terrain, Start((0.0, 0.0, 0.0)), goal)
    packed = pack_terrain(terrain)
    check = EverythingStands(packed)
    stance = start_stance(scene, packed, ROBOT)
    check_goal(scene, packed, ROBOT)
    options = PlannerOptions(heuristic=heuristic, use_palms=palms, model=model, longer=longer)
    domain = ContactDomain(packed, ROBOT, goal, check, options, PlannerWeights())
    domain.full_soles = True
    numbers = [-1 if c is None else check.pool.add_contact(c) for c in stance.contacts]
    return domain, (numbers[0], numbers[1], numbers[2], numbers[3], -1)


def rectangle(name, corners) -> Surface:
    return Surface(name, np.array(corners, float))


FLOOR = rectangle("floor", [[-1, -0.6, 0], [3, -0.6, 0], [3, 0.6, 0], [-1, 0.6, 0]])
WALL = rectangle("wall", [[-1, 0.65, 0.8], [-1, 0.65, 1.8], [3, 0.65, 1.8], [3, 0.65, 0.8]])
WALL = WALL if WALL.normal[1] < 0 else WALL.flipped()
SMALL = TransitionModel("small", np.array([[0.0, 0.2, 0], [0.2, 0.2, 0], [0.3, 0.25, 0]]), np.array([[0.0, 1.0, 0.0]]))


def walk(domain: ContactDomain, start: State, steps: int, seed: int) -> list[State]:
    rng, states = np.random.default_rng(seed), [start]
    for _ in range(steps):
        following, _ = domain.successors(states[-1])
        assert following, "the walk has nowhere to go"
        states.append(following[int(rng.integers(len(following)))])
    return states


@pytest.mark.parametrize("seed", range(5))
def test_a_move_changes_one_end_effector_and_never_the_last_one_again(seed: int) -> None:
    domain, start = domain_on(Terrain((FLOOR, WALL)), Goal((2, 0, 0)), transition_model())
    for before, after in itertools.pairwise(walk(domain, start, 30, seed)):
        changed = [e for e in range(4) if before[e] != after[e]]
        assert changed == [after[4]]
        assert after[4] != before[4]
        assert after[0] >= 0 and after[1] >= 0


def test_palms_are_made_moved_and_broken() -> None:
    domain, start = domain_on(Terrain((FLOOR, WALL)), Goal((2, 0, 0)), transition_model())
    kinds = set()
    for seed in range(20):
        for before, after in itertools.pairwise(walk(domain, start, 30, seed)):
            if after[4] >= 2:
                kinds.add((before[after[4]] >= 0, after[after[4]] >= 0))
    assert kinds == {(False, True), (True, True), (True, False)}


def test_the_edge_cost_is_equation_3_2() -> None:
    domain, start = domain_on(Terrain((FLOOR, WALL)), Goal((2, 0, 0)), transition_model())
    pool, weights = domain.pool, domain.weights
    for state in walk(domain, start, 12, 3):
        following, costs = domain.successors(state)
        for after, cost in zip(following, costs, strict=True):
            e = after[4]
            made_or_broken = state[e] < 0 or after[e] < 0
            d_e = 0.0 if made_or_broken else np.linalg.norm(pool.p[after[e]] - pool.p[state[e]])
            turn = np.mean(pool.yaw[list(after[:2])]) - np.mean(pool.yaw[list(state[:2])])
            assert cost == pytest.approx(d_e + weights.turn * abs(turn) + weights.step, abs=1e-12)


def test_steps_stay_within_the_robot_s_translation() -> None:
    domain, start = domain_on(Terrain((FLOOR,)), Goal((2, 0, 0)), transition_model("long_stride"))
    for state in walk(domain, start, 20, 0):
        for after in domain.successors(state)[0]:
            moved = domain.pool.p[after[after[4]]] - domain.pool.p[state[after[4]]]
            assert np.linalg.norm(moved) <= ROBOT.max_foot_translation + 1e-12


def cost_to_go(domain: ContactDomain, start: State) -> tuple[float, dict[State, float]]:
    """The slow, obvious twin: every reachable state, then Dijkstra backwards from the goals."""
    back: dict[State, list[tuple[State, float]]] = {start: []}
    queue = [start]
    while queue:
        state = queue.pop()
        for after, cost in zip(*domain.successors(state), strict=True):
            if after not in back:
                back[after] = []
                queue.append(after)
            back[after].append((state, float(cost)))
    to_go = {s: (0.0 if domain.is_goal(s) else np.inf) for s in back}
    heap = [(0.0, s) for s in back if domain.is_goal(s)]
    while heap:
        d, state = heapq.heappop(heap)
        if d > to_go[state]:
            continue
        for before, cost in back[state]:
            if d + cost < to_go[before]:
                to_go[before] = d + cost
                heapq.heappush(heap, (d + cost, before))
    return to_go[start], to_go


def small_world(heuristic: str, palms: bool):
    floor = rectangle("floor", [[-0.3, -0.4, 0], [1.3, -0.4, 0], [1.3, 0.4, 0], [-0.3, 0.4, 0]])
    return domain_on(Terrain((floor, WALL) if palms else (floor,)), Goal((0.75, 0, 0), 0.1), SMALL, heuristic, palms)


@pytest.mark.parametrize("palms", [False, True])
def test_the_admissible_heuristic_never_exceeds_the_true_cost_to_go(palms: bool) -> None:
    domain, start = small_world("admissible", palms)
    optimum, to_go = cost_to_go(domain, start)
    states = list(to_go)
    assert np.isfinite(optimum)
    assert len(states) > 100
    assert (domain.heuristic(states) <= np.array([to_go[s] for s in states]) + 1e-9).all()


@pytest.mark.parametrize("palms", [False, True])
def test_every_bound_that_the_search_reports_holds(palms: bool) -> None:
    domain, start = small_world("admissible", palms)
    optimum, _ = cost_to_go(domain, start)
    found = list(AnaStar(domain, start, epsilon=0.1, seed=1).run())
    assert found[-1].cost == pytest.approx(optimum)
    for incumbent in found:
        assert incumbent.cost <= incumbent.bound * optimum * (1 + 1e-9)


def test_a_held_palm_stays_within_reach_of_its_shoulder_over_the_feet() -> None:
    """The shoulder stands over the mean of the feet (Lin 2020 eq. 3.1), and the torso may sway."""
    domain, start = domain_on(Terrain((FLOOR, WALL)), Goal((2, 0, 0)), transition_model())
    held = 0
    for seed in range(10):
        for state in walk(domain, start, 40, seed):
            for side in (0, 1):
                if state[2 + side] >= 0:
                    held += 1
                    feet = list(state[:2])
                    offset = rpy_rotation([0.0, 0.0, domain.pool.yaw[feet].mean()]) @ (
                        ROBOT.shoulder * [1, 1 - 2 * side, 1]
                    )
                    shoulder = domain.pool.p[feet].mean(axis=0) + offset
                    distance = np.linalg.norm(domain.pool.p[state[2 + side]] - shoulder)
                    assert distance <= ROBOT.arm_reach[1] + TORSO_SWAY + 1e-9
    assert held > 100


def random_surfaces(footholds: str, seed: int = 0):
    scene = load_scene("random_surfaces", seed=seed)
    packed = pack_terrain(scene.terrain)
    check = EverythingStands(packed)
    options = PlannerOptions(footholds=footholds, dynamics="exact")
    domain = ContactDomain(packed, ROBOT, check_goal(scene, packed, ROBOT), check, options, PlannerWeights())
    domain.full_soles = True
    numbers = [-1 if c is None else check.pool.add_contact(c) for c in start_stance(scene, packed, ROBOT).contacts]
    return domain, (*numbers, -1), options


def test_snapped_steps_stay_within_what_the_transition_model_and_the_robot_allow() -> None:
    domain, start, options = random_surfaces("snapped")
    pool, limits, seen = domain.pool, options.step_limits(ROBOT, options.model), 0
    half_length, half_width = ROBOT.effectors[0].half_extent
    cell = np.sqrt(3) * POOL_CELL  # contacts nearer than this may share a number
    for seed in range(4):
        for before, after in itertools.pairwise(walk(domain, start, 12, seed)):
            mover = after[4]
            if mover > 1:
                continue
            new, stand = after[mover], after[1 - mover]
            assert np.linalg.norm(pool.p[new] - pool.p[before[mover]]) <= domain.max_travel + 1e-9
            c, s = np.cos(pool.yaw[stand]), np.sin(pool.yaw[stand])
            x, y = np.array([[c, s], [-s, c]]) @ (pool.p[new] - pool.p[stand])[:2]
            sign = 1.0 if mover == 0 else -1.0
            turn = sign * ((pool.yaw[new] - pool.yaw[stand] + np.pi) % (2 * np.pi) - np.pi)
            slack = np.deg2rad(5.1)
            assert limits.x[0] - cell <= x <= limits.x[1] + cell
            assert limits.yaw[0] - slack <= turn <= limits.yaw[1] + slack
            inner = sign * y - half_length * abs(np.sin(turn)) - half_width * np.cos(turn)
            assert inner >= limits.inner - cell - half_length * np.sin(slack)
            assert sign * y <= limits.outer + cell
            seen += 1
    assert seen > 20


def test_snapped_steps_cross_ground_where_fixed_ones_find_nothing() -> None:
    crossed = {"snapped": 0, "fixed": 0}
    for footholds in crossed:
        for seed in (1, 3, 4):
            domain, start, _ = random_surfaces(footholds, seed)
            search = AnaStar(domain, start, limits=Limits(expansions=600), alike=domain.alike, patience=1.0)
            crossed[footholds] += next(search.run(), None) is not None
    assert crossed["snapped"] == 3
    assert crossed["fixed"] < 3


def test_no_move_is_offered_twice() -> None:
    domain, start, _ = random_surfaces("snapped")
    for seed in range(3):
        for state in walk(domain, start, 8, seed):
            following, _ = domain.successors(state)
            assert len(set(following)) == len(following)


def test_step_reach_bounds_every_step() -> None:
    for footholds in ("snapped", "fixed"):
        domain, start, options = random_surfaces(footholds)
        reach = options.step_reach(ROBOT)
        for state in walk(domain, start, 10, 0):
            for after in domain.successors(state)[0]:
                if after[4] < 2:
                    apart = domain.pool.p[after[0], :2] - domain.pool.p[after[1], :2]
                    assert np.hypot(*apart) <= reach + np.sqrt(3) * POOL_CELL


def gap_of(width: float) -> Terrain:
    far = [[0.4 + width, -0.6, 0], [2.4, -0.6, 0], [2.4, 0.6, 0], [0.4 + width, 0.6, 0]]
    return Terrain(
        (rectangle("near", [[-0.6, -0.6, 0], [0.4, -0.6, 0], [0.4, 0.6, 0], [-0.6, 0.6, 0]]), rectangle("far", far))
    )


def test_a_gap_wider_than_the_usual_steps_is_crossed_with_longer_ones() -> None:
    usual, longer = transition_model(), transition_model("long_stride")
    crossed = {}
    for name, second in (("usual", None), ("longer", longer)):
        domain, start = domain_on(gap_of(0.4), Goal((1.6, 0, 0)), usual, palms=False, longer=second)
        search = AnaStar(domain, start, limits=Limits(expansions=150), alike=domain.alike, patience=1.0)
        crossed[name] = next(search.run(), None)
    assert crossed["usual"] is None
    path = crossed["longer"].path
    assert len(path) < 12
    p = domain.pool.p
    strides = [np.hypot(*(p[s[0]] - p[s[1]])[:2]) for s in path]
    assert max(strides) >= 0.4 + 2 * ROBOT.effectors[0].half_extent[0] - 0.02


def test_longer_steps_are_not_offered_where_usual_ones_lead_on() -> None:
    usual, longer = transition_model(), transition_model("long_stride")
    one, start = domain_on(Terrain((FLOOR,)), Goal((2.5, 0, 0)), usual, palms=False, longer=longer)
    two, same = domain_on(Terrain((FLOOR,)), Goal((2.5, 0, 0)), usual, palms=False)
    for _ in range(6):
        ahead, costs = one.successors(start)
        again, same_costs = two.successors(same)
        assert list(ahead) == list(again)
        assert np.array_equal(costs, same_costs)
        best = int(np.argmin(one.heuristic(ahead)))
        start, same = ahead[best], again[best]
