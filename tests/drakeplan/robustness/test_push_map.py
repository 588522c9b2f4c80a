"""The picture of the ground: footholds in the order of the plan, each with the greatest push that is survived on it."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest
from matplotlib import image

from drakeplan.plan.plan import Plan
from drakeplan.robustness import push_map
from drakeplan.robustness.moments import moments_of
from drakeplan.robustness.push_map import draw_push_map, footholds_of
from learning.capture_networks import CapturePrediction
from learning.weights import NoWeightsError
from scenes.input_error import InputError
from scenes.robots.robot import load_robot

ROBOT = load_robot("escher")
VELOCITY = slice(3, 6)  # of the features


@dataclass
class Slow:
    """Networks that capture whatever is slower than this [m/s]."""

    limit: float
    kind: str = "ensemble"
    friction: float = 0.0

    def answer(self, motion: int, x: np.ndarray, inputs: np.ndarray | None = None) -> CapturePrediction:
        slow = np.linalg.norm(x[:, VELOCITY], axis=1) < self.limit
        return CapturePrediction(slow.astype(float), np.zeros(len(x)), np.zeros(len(x), bool))


def gliding(plan: Plan, velocity: np.ndarray) -> Plan:
    """The plan with this velocity of the CoM at every knot."""
    assert plan.centroidal is not None
    momentum = np.tile(ROBOT.mass * velocity, (len(plan.centroidal.t), 1))
    return dataclasses.replace(plan, centroidal=dataclasses.replace(plan.centroidal, linear_momentum=momentum))


def directions() -> np.ndarray:
    angle = np.deg2rad(22.5) * np.arange(16)
    return np.column_stack([np.cos(angle), np.sin(angle), 0 * angle])


def test_footholds_come_in_the_order_in_which_the_plan_stands_on_them(stepping_plan: Plan) -> None:
    order = []
    for moment in moments_of(stepping_plan):
        feet = [c for c in moment.stance.contacts[:2] if c is not None]
        if len(feet) == 1 and (not order or order[-1] != feet[0]):
            order.append(feet[0])
    found = footholds_of(stepping_plan, ROBOT)
    assert [f.contact for f in found] == order
    assert [f.contact.effector for f in found] == ["right_foot", "left_foot"]
    for foothold in found:
        assert foothold.greatest.shape == (16,)
        assert ((foothold.greatest >= 0.0) & (foothold.greatest <= 1.0)).all()
        assert foothold.weakest == foothold.greatest.min()


@pytest.mark.parametrize("limit", [0.0, 0.42, 5.0])
def test_at_rest_pushes_are_survived_up_to_what_networks_capture_in_every_direction(
    stepping_plan: Plan, limit: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(push_map, "load_capture", lambda robot: Slow(limit))
    expected = min(0.05 * np.floor(limit / 0.05), 1.0)
    for foothold in footholds_of(gliding(stepping_plan, np.zeros(3)), ROBOT):
        np.testing.assert_allclose(foothold.greatest, expected)


def test_a_robot_on_its_way_survives_less_along_it_and_more_against_it(
    stepping_plan: Plan, monkeypatch: pytest.MonkeyPatch
) -> None:
    """|v + s d| < limit for all of 0.05, 0.10, ... up to s."""
    monkeypatch.setattr(push_map, "load_capture", lambda robot: Slow(0.42))
    velocity = np.array([0.2, 0.1, 0.0])
    twin = []
    for way in directions():
        s = 0.0
        while np.linalg.norm(velocity + (s + 0.05) * way) < 0.42:
            s += 0.05
        twin.append(s)
    for foothold in footholds_of(gliding(stepping_plan, velocity), ROBOT):
        np.testing.assert_allclose(foothold.greatest, twin, atol=1e-9)


def test_the_worst_moment_on_a_foothold_decides(stepping_plan: Plan, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(push_map, "load_capture", lambda robot: Slow(0.42))
    plan = gliding(stepping_plan, np.zeros(3))
    assert plan.centroidal is not None
    momentum = plan.centroidal.linear_momentum.copy()
    first = next(k for k, m in enumerate(moments_of(plan)) if m.swing)
    momentum[first + 3] = ROBOT.mass * np.array([0.5, 0.0, 0.0])
    plan = dataclasses.replace(plan, centroidal=dataclasses.replace(plan.centroidal, linear_momentum=momentum))
    there, later = footholds_of(plan, ROBOT)
    assert there.weakest == 0.0
    np.testing.assert_allclose(later.greatest, 0.4)


def test_the_picture_is_a_png_that_is_not_blank(stepping_plan: Plan, tmp_path: Path) -> None:
    path = tmp_path / "ground.of.any.name"
    draw_push_map(stepping_plan, ROBOT, path)
    assert path.read_bytes().startswith(b"\x89PNG")
    pixels = image.imread(path, format="png")
    assert pixels.shape[0] > 300 and pixels.shape[1] > 900
    assert len(np.unique((255 * pixels[..., :3]).astype(int).reshape(-1, 3), axis=0)) > 50
    assert 0.01 < (pixels[..., :3].min(axis=2) < 0.8).mean() < 0.9


def test_what_a_foothold_survives_is_seen(stepping_plan: Plan, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """More blue where more is survived."""
    blue = []
    for limit in (0.0, 0.3, 0.9):
        monkeypatch.setattr(push_map, "load_capture", lambda robot, limit=limit: Slow(limit))
        draw_push_map(stepping_plan, ROBOT, tmp_path / "map.png")
        r, _, b = np.moveaxis(image.imread(tmp_path / "map.png")[..., :3], 2, 0)
        blue.append(int((b - r > 0.15).sum()))
    assert blue[0] < blue[1] < blue[2]


def test_a_plan_that_lifts_no_foot_has_a_picture_without_footholds(stepping_plan: Plan, tmp_path: Path) -> None:
    assert stepping_plan.phases is not None
    held = stepping_plan.phases.contact.copy()
    held[:] = held[0]
    plan = dataclasses.replace(stepping_plan, phases=dataclasses.replace(stepping_plan.phases, contact=held))
    assert footholds_of(plan, ROBOT) == []
    draw_push_map(plan, ROBOT, tmp_path / "map.png")
    assert (tmp_path / "map.png").stat().st_size > 1000


def test_contacts_only_and_a_robot_without_networks_are_refused(
    stepping_plan: Plan, monkeypatch: pytest.MonkeyPatch
) -> None:
    with pytest.raises(InputError, match="contacts only"):
        footholds_of(dataclasses.replace(stepping_plan, phases=None, centroidal=None, motion=None), ROBOT)

    def none(robot: object) -> None:
        raise NoWeightsError("no learned capture")

    monkeypatch.setattr(push_map, "load_capture", none)
    with pytest.raises(NoWeightsError):
        footholds_of(stepping_plan, ROBOT)
