"""Support polygons: on the patches, and through the feet and palms while these are held."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from pydrake.geometry import Meshcat

from drakeplan.plan.plan import Plan
from drakeplan.playback import show_plan
from drakeplan.playback.contact_timeline import STANCE_TIME, contact_timeline
from drakeplan.playback.frame_times import FrameTimes, frame_times
from drakeplan.playback.legend import plan_legend
from drakeplan.playback.still import ROOT, _prism, draw_still
from drakeplan.playback.supports import SUPPORTS, held_keys, support_in_world
from scenes.files.scene_file import scene_from_yaml
from scenes.terrain.polygon import area_vectors

HEEL = np.array([[-0.03, 0.05], [-0.11, 0.05], [-0.11, -0.05]])


def on_the_heel(plan: Plan) -> Plan:
    """The same plan, but of the sole in row 0 of its contacts only a part carries."""
    assert plan.contacts.support is not None
    support = plan.contacts.support.copy()
    support[0, :3], support[0, 3] = HEEL, np.nan
    return dataclasses.replace(plan, contacts=dataclasses.replace(plan.contacts, support=support))


def test_a_prism_is_closed_and_holds_the_polygons_area_times_its_height() -> None:
    vertices, faces = _prism(HEEL, 0.01)
    edges = np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]])
    assert {tuple(e) for e in edges} == {tuple(e[::-1]) for e in edges}
    a, b, c = vertices[faces].transpose(1, 0, 2)
    volume = np.einsum("ij,ij->i", a, np.cross(b, c)).sum() / 6  # positive where faces look outwards
    assert np.isclose(volume, 0.5 * 0.08 * 0.1 * 0.01)


def test_a_contact_on_part_of_its_sole_shows_what_carries(strolling_plan: Plan) -> None:
    plan = on_the_heel(strolling_plan)
    meshcat = Meshcat()
    draw_still(meshcat, plan, scene_from_yaml(plan.scene_yaml, source="plan"))
    name = plan.effectors[plan.contacts.effector[0]]
    assert meshcat.HasPath(f"{ROOT}/contacts/{name}/0/support")
    assert not meshcat.HasPath(f"{ROOT}/contacts/{name}/1/support")


def test_a_support_is_in_the_plane_of_its_contact_and_has_its_corners_there(strolling_plan: Plan) -> None:
    plan = on_the_heel(strolling_plan)
    for contact in range(len(plan.contacts)):
        X_WC = plan.contacts.X_WC[contact]
        p_CS = (support_in_world(plan, contact) - X_WC[:3, 3]) @ X_WC[:3, :3]
        np.testing.assert_allclose(p_CS[:, 2], 0.0, atol=1e-9)
        if contact == 0:
            np.testing.assert_allclose(p_CS[:, :2], HEEL, atol=1e-9)
        else:
            half = plan.half_extent[plan.contacts.effector[contact]]
            np.testing.assert_allclose(np.abs(p_CS[:, :2]), np.tile(half, (4, 1)), atol=1e-9)


@pytest.mark.parametrize(("part", "area"), [(HEEL, 0.5 * 0.08 * 0.1), (None, 0.22 * 0.1)])
def test_a_support_has_the_area_of_what_carries(strolling_plan: Plan, part: np.ndarray | None, area: float) -> None:
    """A triangle on the heel; the whole sole of escher, 22 by 10 cm."""
    corners = support_in_world(strolling_plan if part is None else on_the_heel(strolling_plan), 0)
    k = np.arange(1, len(corners) - 1)
    fan = np.stack([np.broadcast_to(corners[0], (len(k), 3)), corners[k], corners[k + 1]], axis=1)
    assert np.linalg.norm(area_vectors(fan), axis=1).sum() / 2 == pytest.approx(area)


@pytest.mark.parametrize("rate", [25.0, 3.0])  # more and fewer frames than knots
def test_a_support_shows_while_its_contact_is_held(strolling_plan: Plan, rate: float) -> None:
    """Never later than the contact is made, and at most a frame earlier."""
    assert strolling_plan.centroidal is not None
    t, table = strolling_plan.centroidal.t, strolling_plan.centroidal.contact
    frames = FrameTimes(rate, np.arange(int(np.ceil(strolling_plan.duration * rate - 1e-9)) + 1) / rate)
    timeline = contact_timeline(strolling_plan)
    some_vanish = False
    for contact in range(len(strolling_plan.contacts)):
        keys = held_keys(timeline, contact, frames)
        assert min(keys) == 0
        assert max(keys) == frames.last  # else its clip would be shorter and repeat earlier
        for frame in range(frames.last):
            until = np.flatnonzero(t < (frame + 1) / rate - 1e-9)[-1]  # the last knot that this frame shows
            assert keys[max(f for f in keys if f <= frame)] == (contact in table[until])
        some_vanish |= list(keys.values())[-1] is False
    assert some_vanish


def test_without_a_motion_the_stances_follow_one_another(strolling_plan: Plan) -> None:
    plan = dataclasses.replace(strolling_plan, phases=None, centroidal=None, motion=None)
    timeline = contact_timeline(plan)
    frames = frame_times(timeline.duration)
    for contact in range(len(plan.contacts)):
        keys = held_keys(timeline, contact, frames)
        for stance, row in enumerate(plan.stances):
            middle = round((stance + 0.5) * STANCE_TIME * frames.rate)
            assert keys[max(f for f in keys if f <= middle)] == (contact in row)


def test_every_contact_has_its_support_in_one_layer(strolling_plan: Plan) -> None:
    meshcat = Meshcat()
    show_plan(strolling_plan, meshcat)
    for contact in range(len(strolling_plan.contacts)):
        assert meshcat.HasPath(f"{SUPPORTS}/{contact}")


def test_the_legend_names_supports_where_there_are_stances(strolling_plan: Plan) -> None:
    scene = scene_from_yaml(strolling_plan.scene_yaml, source="plan")
    empty = dataclasses.replace(
        strolling_plan, phases=None, centroidal=None, motion=None, stances=np.zeros((0, 4), dtype=int)
    )
    for plan, named in ((strolling_plan, True), (empty, False)):
        assert ("what carries a foot or palm" in {e.text for e in plan_legend(plan, scene).entries}) == named
