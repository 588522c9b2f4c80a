"""What a page's script is told of a plan: contact changes, stances, shares of friction and of torque."""

from __future__ import annotations

import base64
import dataclasses
import json
import re
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from drakeplan import playback
from drakeplan.plan.plan import Plan
from drakeplan.playback.friction_used import friction_used
from drakeplan.playback.page_data import page_data, percent_bytes
from drakeplan.playback.torque_shares import torque_shares
from optimization.multibody.inverse_dynamics import effort_limits
from scenes.files.scene_file import scene_from_yaml
from scenes.robots.plant import build_plant
from scenes.robots.robot import Robot, load_robot


@pytest.fixture(scope="module")
def escher() -> Robot:
    return load_robot("escher")


def with_torques(plan: Plan, tau: np.ndarray, names: tuple[str, ...]) -> Plan:
    assert plan.motion is not None
    return dataclasses.replace(plan, motion=dataclasses.replace(plan.motion, tau=tau, actuator_names=names))


def read_bytes(text: str) -> np.ndarray:
    return np.frombuffer(base64.b64decode(text), np.uint8)


def data_in(page: str) -> dict:
    found = re.findall(r'<script id="plan-data" type="application/json">(.*?)</script>', page, flags=re.DOTALL)
    assert len(found) == 1
    return json.loads(found[0])


# ---- torques


def test_shares_are_torques_by_limits_whatever_their_sign(strolling_plan: Plan, escher: Robot) -> None:
    """Half of every limit, turned round at every frame; and the limits once more by another way."""
    assert strolling_plan.motion is not None
    plant = build_plant(escher).plant
    names = strolling_plan.motion.actuator_names
    limit_of_velocity = effort_limits(plant)
    limit = np.array([limit_of_velocity[plant.GetJointActuatorByName(n).joint().velocity_start() - 6] for n in names])
    signs = (-1.0) ** np.arange(len(strolling_plan.motion))
    plan = with_torques(strolling_plan, 0.5 * signs[:, None] * limit, names)
    assert plan.motion is not None
    found = torque_shares(plan.motion, escher, np.linspace(0.0, plan.duration, 50))
    assert found is not None
    assert found.names == names
    np.testing.assert_allclose(found.share, 0.5)


def test_a_torque_acts_from_its_frame_to_the_next(strolling_plan: Plan, escher: Robot) -> None:
    assert strolling_plan.motion is not None
    names = strolling_plan.motion.actuator_names
    tau = np.zeros((len(strolling_plan.motion), len(names)))
    tau[10:20, 3] = 25.0
    motion = with_torques(strolling_plan, tau, names).motion
    assert motion is not None
    t = motion.t - motion.t[0]
    moments = np.array([t[10] - 1e-4, t[10], t[20] - 1e-4, t[20]])
    found = torque_shares(motion, escher, moments)
    assert found is not None
    np.testing.assert_allclose(found.share[:, 3] > 0, [False, True, True, False])


def test_actuators_without_a_limit_are_left_out(strolling_plan: Plan, escher: Robot) -> None:
    assert strolling_plan.motion is not None
    names = ("no such motor", strolling_plan.motion.actuator_names[0])
    motion = with_torques(strolling_plan, np.ones((len(strolling_plan.motion), 2)), names).motion
    assert motion is not None
    found = torque_shares(motion, escher, np.zeros(1))
    assert found is not None
    assert found.names == names[1:]
    alone = with_torques(strolling_plan, np.ones((len(motion), 1)), names[:1]).motion
    assert alone is not None
    assert torque_shares(alone, escher, np.zeros(1)) is None


def test_a_plan_without_torques_has_no_list_of_them(strolling_plan: Plan, escher: Robot) -> None:
    assert strolling_plan.motion is not None
    old = dataclasses.replace(
        strolling_plan, motion=dataclasses.replace(strolling_plan.motion, tau=None, actuator_names=())
    )
    assert page_data(old, escher)["torques"] is None
    assert 'class="plan-torques"' not in playback.page_html(old, escher)


# ---- numbers


@given(st.lists(st.floats(0.0, 3.0), min_size=1, max_size=60))
def test_shares_come_back_in_whole_percents(shares: list[float]) -> None:
    back = read_bytes(percent_bytes(np.array(shares)))
    np.testing.assert_allclose(back, np.minimum(100 * np.array(shares), 255), atol=0.5 + 1e-9)


def test_what_no_byte_holds_is_the_most_it_can_hold() -> None:
    assert read_bytes(percent_bytes(np.array([np.inf, 1e9, 0.0, np.nan]))).tolist() == [255, 255, 0, 0]


# ---- the page


@pytest.fixture(scope="module")
def page(strolling_plan: Plan) -> str:
    return playback.page_html(strolling_plan)


def test_the_page_tells_its_script_what_the_plan_says(page: str, strolling_plan: Plan) -> None:
    assert strolling_plan.phases is not None
    assert strolling_plan.centroidal is not None
    data = data_in(page)
    (plan,) = data["plans"]
    np.testing.assert_allclose(plan["changes"], strolling_plan.phases.start[1:], atol=1e-6)
    np.testing.assert_allclose(plan["phases"]["t"], strolling_plan.phases.start, atol=1e-6)
    assert plan["phases"]["stance"] == list(range(1, len(strolling_plan.stances) + 1))
    for held, row in zip(plan["phases"]["held"], strolling_plan.phases.contact, strict=True):
        assert held == np.flatnonzero(row >= 0).tolist()
    used = np.column_stack([read_bytes(column) for column in plan["forces"]["used"]])
    np.testing.assert_allclose(used, np.minimum(100 * friction_used(strolling_plan), 255), atol=0.51)
    np.testing.assert_allclose(plan["forces"]["t"], strolling_plan.centroidal.t, atol=1e-6)
    torques = plan["torques"]
    frames = len(read_bytes(torques["share"])) / len(torques["names"])
    assert frames == np.ceil(strolling_plan.duration * torques["rate"] - 1e-9) + 1


def test_the_same_plan_gives_the_same_page(page: str, strolling_plan: Plan) -> None:
    assert playback.page_html(strolling_plan) == page


def test_the_page_holds_every_button_and_every_colour(page: str) -> None:
    for name in ("previous", "play", "next", "slower", "faster"):
        assert page.count(f'class="{name}"') == 1
    for layer in ("follow", "supports", "forces", "torques"):
        assert f'<label class="{layer}"' in page
    assert "friction used 0" in page


def test_names_that_look_like_tags_stay_names(strolling_plan: Plan, escher: Robot) -> None:
    assert strolling_plan.motion is not None
    limited = strolling_plan.motion.actuator_names[0]
    data = page_data(strolling_plan, escher)
    evil = dataclasses.replace(strolling_plan, scene_name="</script><script>alert(1)</script>")
    html = playback.page_html(evil, escher)
    assert "<script>alert(1)" not in html
    torques = dict(data["torques"], names=["</script><script>alert(2)</script>", limited])
    pane = playback.Pane(playback.plan_legend(strolling_plan, _scene(strolling_plan)), {**data, "torques": torques})
    text = playback.finished_page("<body></body>", [pane])
    assert "<script>alert(2)" not in text
    assert data_in(text)["plans"][0]["torques"]["names"][0] == "</script><script>alert(2)</script>"


def test_a_scene_without_a_plan_has_no_controls(strolling_plan: Plan) -> None:
    page = playback.scene_page_html(_scene(strolling_plan))
    assert 'id="plan-time"' not in page
    assert 'id="plan-data"' not in page


def test_a_page_is_little_larger_for_what_its_script_needs(page: str) -> None:
    """The meshcat part weighs megabytes; script, style, colours and numbers of 6.6 s stay below 50 kB."""
    extra = page[page.index('<script id="embedded-json">') :]
    assert len(extra.encode()) < 50_000
    script = Path(playback.__file__).with_name("page.js").read_text(encoding="utf-8")
    assert script in extra


def _scene(plan: Plan):
    return scene_from_yaml(plan.scene_yaml, source="plan", mesh_triangles=plan.triangles)
