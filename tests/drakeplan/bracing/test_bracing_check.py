"""The robot tips on its wheels alone and a palm holds it; the compiled test of balance and a linear program say the same."""

from __future__ import annotations

import numpy as np
import pytest
from palms_on_wall import PalmsOnWall

import drakeplan.bracing.bracing_check as bracing_check
import scenes.library.braced_ramp as scene
from drakeplan.bracing.braced_planner import _rests
from drakeplan.bracing.bracer import Bracer
from drakeplan.bracing.bracing_check import BracingCheck
from drakeplan.bracing.wall_frame import to_world
from optimization.balance.static_equilibrium import is_balanced
from scenes.library.braced_ramp import PITCH, ROLL, BracedRamp, braced_ramp
from scenes.robots.bracer.make_bracer import TRACK, WHEEL_WIDTH, WHEELBASE

CLEAR = 1e-6  # [m] farther from the border than the rounding of either program


@pytest.fixture
def palms(bracer: Bracer) -> PalmsOnWall:
    return PalmsOnWall(braced_ramp(0), bracer)


def less_steep(share: float, monkeypatch: pytest.MonkeyPatch) -> BracedRamp:
    """The ramp with this share of its roll."""
    monkeypatch.setattr(scene, "ROLL", share * ROLL)
    return braced_ramp(0)


def com_on(ramp: BracedRamp, bracer: Bracer, x: float = 0.0) -> np.ndarray:
    X_WB = ramp.base(x)
    return X_WB[:3, :3] @ bracer.com + X_WB[:3, 3]


def test_wheels_alone_tip_however_rough_the_ramp_and_hold_where_it_is_half_as_steep(
    bracer: Bracer, monkeypatch: pytest.MonkeyPatch
) -> None:
    for friction in (scene.FRICTION_OF_WHEELS, 5.0):
        monkeypatch.setattr(bracing_check, "FRICTION_OF_WHEELS", friction)
        for share, expected in ((1.0, False), (0.5, True)):
            with monkeypatch.context() as part:
                ramp = less_steep(share, part)
            arrays, com = PalmsOnWall(ramp, bracer).check.supports(None, 0.4), com_on(ramp, bracer, 0.4)
            assert is_balanced(*arrays, com[:2]) == _rests(arrays, com) == expected


@pytest.mark.parametrize("share", [0.3, 0.7, 0.9, 1.0, 1.1])
def test_rough_wheels_hold_the_robot_as_long_as_the_com_is_over_what_they_stand_on(
    bracer: Bracer, monkeypatch: pytest.MonkeyPatch, share: float
) -> None:
    """Closed form: what the wheels stand on is a rectangle of the ramp, seen from above a parallelogram."""
    monkeypatch.setattr(bracing_check, "FRICTION_OF_WHEELS", 5.0)
    ramp = less_steep(share, monkeypatch)
    check, down = PalmsOnWall(ramp, bracer).check, ramp.ramp.T @ np.array([0.0, 0.0, -1.0])
    half = np.array([WHEELBASE / 2 + bracing_check.WHEEL[0], TRACK / 2 + WHEEL_WIDTH / 2])
    for aside in np.random.default_rng(0).uniform(-0.2, 0.2, (20, 3)):
        com_B = bracer.com + aside
        below = com_B - com_B[2] / down[2] * down  # where a plumb line from the CoM meets the ramp
        room = float((half - np.abs(below[:2])).min())
        assert abs(room) > CLEAR
        X_WB = ramp.base(0.0)
        assert is_balanced(*check.supports(None), (X_WB[:3, :3] @ com_B)[:2]) == (room > 0.0)


def test_with_either_palm_on_the_wall_the_robot_does_not_tip(palms: PalmsOnWall) -> None:
    for palm in (0, 1):
        assert palms.check.why_not_balanced(palms.at(palm, 0.4, 1.0)) == ""


def test_the_compiled_test_of_balance_and_the_linear_program_agree(palms: PalmsOnWall) -> None:
    rng, held = np.random.default_rng(2), 0
    numbers = [n for palm in (0, 1) for n in palms.draw(palm, 15, rng)]
    for number in numbers:
        arrays, X_WB = palms.check.supports(number), palms.check.base(number)
        for _ in range(6):
            com = X_WB[:3, 3] + rng.uniform([-0.5, -0.5, 0.1], [0.5, 1.1, 0.7])
            said = is_balanced(*arrays, com[:2])
            assert said == _rests(arrays, com), (number, com)
            held += said
    assert 0.15 < held / (6 * len(numbers)) < 0.85


def test_arms_that_may_press_harder_hold_the_robot_everywhere_that_weaker_ones_do(
    palms: PalmsOnWall, bracer: Bracer, monkeypatch: pytest.MonkeyPatch
) -> None:
    numbers = palms.draw(0, 30, np.random.default_rng(4))
    before, counts = np.zeros(len(numbers), bool), []
    for limit in (0.0, 0.01, 0.02, 0.03, 0.05, 0.3, 1.0):
        monkeypatch.setattr(bracing_check, "PALM_LIMIT", limit)
        fresh = BracingCheck(palms.check.pool, braced_ramp(0), bracer)
        held = np.array([fresh.why_not_balanced(n) == "" for n in numbers])
        assert (held >= before).all()
        before = held
        counts.append(int(held.sum()))
    assert counts[0] == 0, "an arm that must not press is none"
    assert counts[-1] == len(numbers)


def test_a_margin_of_the_com_is_asked_for_to_every_side(palms: PalmsOnWall, monkeypatch: pytest.MonkeyPatch) -> None:
    number = palms.at(0, 0.4, 1.0)
    arrays = palms.check.supports(number)
    com = com_on(braced_ramp(0), palms.check._bracer, palms.check.base(number)[0, 3])
    for margin in (0.05, 0.4, 0.8):
        monkeypatch.setattr(bracing_check, "MARGIN", margin)
        sides = [is_balanced(*arrays, com[:2] + margin * np.array(s)) for s in ((1, 0), (-1, 0), (0, 1), (0, -1))]
        fresh = BracingCheck(palms.check.pool, braced_ramp(0), palms.check._bracer)
        assert (fresh.why_not_balanced(number) == "") == all(sides)
    assert not all(sides), "a CoM so far off the wheels is held by no palm"


def test_the_base_stands_on_the_ramp_with_its_shoulders_beside_the_standing_palm(
    palms: PalmsOnWall, bracer: Bracer
) -> None:
    for number in palms.draw(1, 20, np.random.default_rng(6)):
        X_WB = palms.check.base(number)
        wheels = palms.check.supports(number).p_WC[:4]
        np.testing.assert_allclose(wheels, bracer.wheels @ X_WB[:3, :3].T + X_WB[:3, 3], atol=1e-12)
        np.testing.assert_allclose(wheels[:, 2], wheels[:, 0] * np.tan(PITCH) - wheels[:, 1] * np.tan(ROLL), atol=1e-12)
        middle = X_WB[:3, :3] @ bracer.shoulders().mean(axis=0) + X_WB[:3, 3]
        # the ramp's rise leans the upright torso back by a little
        assert abs(middle[0] - to_world(palms.check.pool.p[number])[0]) < 0.06


def test_wheels_and_palm_press_on_what_they_stand_on(palms: PalmsOnWall) -> None:
    number = palms.at(0, 0.4, 1.0)
    arrays = palms.check.supports(number)
    np.testing.assert_allclose(arrays.R_WC[:4, :, 2], [braced_ramp(0).ramp[:, 2]] * 4, atol=1e-12)
    surface = next(s for s in braced_ramp(0).wall.surfaces if s.name == "before_the_window")
    np.testing.assert_allclose(arrays.R_WC[4, :, 2], surface.normal, atol=1e-9)
    assert abs((arrays.p_WC[4] - surface.centroid) @ surface.normal) < 1e-9
    assert arrays.force_limit.tolist() == [1.0] * 4 + [bracing_check.PALM_LIMIT]


def test_a_step_there_is_as_good_as_the_step_back(palms: PalmsOnWall) -> None:
    rng, said = np.random.default_rng(8), []
    for _ in range(150):
        x, z = rng.uniform(0.0, 0.6), rng.uniform(0.7, 1.2)
        standing = palms.at(0, x, z)
        before, after = (palms.at(1, x + rng.uniform(0.0, 1.6), z + rng.uniform(-0.2, 0.2)) for _ in range(2))
        if min(standing, before, after) < 0 or before == after:
            continue
        there = palms.check.transition((standing, before, -1, -1), (standing, after, -1, -1))
        back = palms.check.transition((standing, after, -1, -1), (standing, before, -1, -1))
        assert there == back
        reach = all(palms.check.reaches(standing, right, standing) for right in (before, after))
        assert there == ("" if reach else "reach")
        said.append(there)
        for right in (before, after):
            if palms.check.reaches(standing, right, standing):
                assert palms.check.stance((standing, right, -1, -1)) == ""
    assert palms.check.asked == 2 * len(said)
    assert 5 < said.count("") < len(said) - 5


def test_palms_apart_by_more_than_both_arms_are_refused_for_reach_and_weak_arms_for_balance(
    palms: PalmsOnWall, bracer: Bracer, monkeypatch: pytest.MonkeyPatch
) -> None:
    near, far, ahead = palms.at(0, 0.1, 1.0), palms.at(1, 2.9, 1.0), palms.at(1, 0.4, 1.0)
    assert palms.check.stance((near, far, -1, -1)) == "reach"
    assert palms.check.transition((near, ahead, -1, -1), (near, far, -1, -1)) == "reach"
    monkeypatch.setattr(bracing_check, "PALM_LIMIT", 0.0)
    weak = BracingCheck(palms.check.pool, braced_ramp(0), bracer)
    assert weak.transition((near, ahead, -1, -1), (near, far, -1, -1)) == "balance"
