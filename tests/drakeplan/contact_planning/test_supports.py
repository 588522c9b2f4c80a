"""Contacts on part of a sole in the search: numbers, who gets one, and what is asked of them."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from drakeplan.contact_planning.com_domain import ComDomain
from drakeplan.contact_planning.contact_domain import NEAR_WHOLE, ContactDomain, PlannerWeights
from drakeplan.contact_planning.contact_plan import PlannerOptions
from drakeplan.contact_planning.contact_pool import ContactPool, Rest
from scenes.contact import Contact, patch_corners, support_corners
from scenes.robots.robot import load_robot
from scenes.scene import Goal
from scenes.terrain.packed_terrain import PackedTerrain, pack_terrain
from scenes.terrain.surface import Surface
from scenes.terrain.terrain import Terrain
from scenes.transition_model import transition_model

ROBOT = load_robot("escher")
HALF = np.array(ROBOT.effectors[0].half_extent)
HEEL = np.array([[0.0, 0.05], [-0.11, 0.05], [-0.11, -0.05]])
UPRIGHT, AHEAD = np.eye(3)[None], np.zeros(1)


def slab(name: str, x: tuple[float, float], friction: float = 0.5) -> Surface:
    return Surface(name, np.array([[x[0], -1, 0], [x[1], -1, 0], [x[1], 1, 0], [x[0], 1, 0]], float), friction)


@pytest.fixture
def pool() -> ContactPool:
    return ContactPool(pack_terrain(Terrain((slab("floor", (-1, 1)),))))


def add(pool: ContactPool, x: float, rest: Rest | None) -> int:
    at = np.array([[x, 0.1, 0.0]])
    return int(pool.add(0, at, UPRIGHT, AHEAD, np.zeros(1, int), [rest])[0])


def test_a_contact_on_part_of_a_sole_is_another_than_one_on_the_whole_sole_at_the_same_place(pool: ContactPool) -> None:
    whole, part = add(pool, 0.0, None), add(pool, 0.0, Rest(HEEL, 0.3))
    assert whole != part == add(pool, 0.001, Rest(HEEL, 0.3))
    assert pool.contact(whole).support is None
    assert np.array_equal(pool.contact(part).support, HEEL)
    assert (pool.friction(whole), pool.friction(part), pool.contact(part).friction) == (0.5, 0.3, 0.3)
    assert pool.on_part.tolist() == [False, True]


def test_corners_of_numbers_are_those_of_their_contacts(pool: ContactPool) -> None:
    numbers = [add(pool, 0.0, None), add(pool, 0.3, Rest(HEEL, 0.5)), add(pool, 0.6, Rest(None, 0.4))]
    contacts = [pool.contact(n) for n in numbers]
    assert np.array_equal(pool.corners(numbers, ROBOT.half_extents), support_corners(contacts, ROBOT.half_extents))
    assert np.array_equal(pool.corners(numbers[:1], ROBOT.half_extents), patch_corners(HALF)[None])
    again = ContactPool(pool._packed)
    assert [again.contact(again.add_contact(c)) for c in contacts] == contacts


class EverythingStands:
    """Stands in for the posture check, and remembers what it was asked."""

    def __init__(self, packed: PackedTerrain) -> None:
        self.pool, self.asked = ContactPool(packed), 0

    def stands_alone(self, number: int) -> bool:
        return True

    def transition(self, before: tuple[int, ...], after: tuple[int, ...]) -> str:
        self.asked += 1
        return "balance"

    def swing(self, before: tuple[int, ...], after: tuple[int, ...]) -> str:
        return ""

    def at_com(self, held: tuple[int, ...], com: np.ndarray) -> str:
        return ""


def domain_on(*surfaces: Surface) -> tuple[ContactDomain, tuple[int, ...]]:
    packed = pack_terrain(Terrain(surfaces))
    options = PlannerOptions(use_palms=False, model=transition_model("experiments"))
    domain = ContactDomain(packed, ROBOT, Goal((2.0, 0, 0)), EverythingStands(packed), options, PlannerWeights())
    feet = [
        Contact(e, 0, np.eye(4) + 0.1 * s * np.eye(4, k=2) * [0, 0, 0, 1], 0.5)
        for e, s in (("left_foot", 1), ("right_foot", -1))
    ]
    return domain, (*(domain.pool.add_contact(c) for c in feet), -1, -1, -1)


@pytest.mark.parametrize("full_soles", [False, True])
def test_toes_reach_over_a_gap_only_where_soles_may_rest_in_part(full_soles: bool) -> None:
    """The far bank takes toes alone at the longest step; no whole foothold is near there."""
    longest = float(transition_model("experiments").steps[:, 0].max())
    domain, start = domain_on(slab("near", (-1, HALF[0])), slab("far", (longest + 0.03, 3)))
    domain.full_soles = full_soles
    states, _ = domain.successors(start)
    ahead = [n for s in states for n in s[:2] if domain.pool.p[n, 0] > HALF[0]]
    assert bool(ahead) != full_soles
    assert all(n in domain.pool.supports for n in ahead)


def test_where_whole_soles_fit_none_rests_in_part() -> None:
    domain, start = domain_on(slab("floor", (-1, 0.5)), slab("beyond", (3, 4)))
    domain.successors(start)
    wholes = domain.pool.p[~domain.pool.on_part]
    for n in domain.pool.supports:
        assert np.linalg.norm(wholes[:, :2] - domain.pool.p[n, :2], axis=1).min() > NEAR_WHOLE - 0.1


def test_a_step_on_part_of_a_sole_has_to_balance_at_rest_too() -> None:
    domain, start = domain_on(slab("floor", (-1, 1)))
    com = ComDomain(domain, SimpleNamespace(asked={}))
    whole, part = (add(domain.pool, 0.3, rest) for rest in (None, Rest(HEEL, 0.5)))
    before = com.start(start[:4], np.array([0, 0, 0.9]))
    after = [(n, start[1], -1, -1, 0, before[5]) for n in (whole, part)]
    assert com.confirm(before, after[0])
    assert domain.check.asked == 0
    assert not com.confirm(before, after[1])
    assert domain.check.asked == 1
    assert not com.confirm(after[1], after[0])  # it leaves from there
