"""Support polygons on the soles."""

from __future__ import annotations

import dataclasses

import numpy as np
from pydrake.geometry import Meshcat

from drakeplan.plan.plan import Plan
from drakeplan.playback.still import ROOT, _prism, draw_still
from scenes.files.scene_file import scene_from_yaml

HEEL = np.array([[-0.03, 0.05], [-0.11, 0.05], [-0.11, -0.05]])


def test_a_prism_is_closed_and_holds_the_polygons_area_times_its_height() -> None:
    vertices, faces = _prism(HEEL, 0.01)
    edges = np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]])
    assert {tuple(e) for e in edges} == {tuple(e[::-1]) for e in edges}
    a, b, c = vertices[faces].transpose(1, 0, 2)
    volume = np.einsum("ij,ij->i", a, np.cross(b, c)).sum() / 6  # positive where faces look outwards
    assert np.isclose(volume, 0.5 * 0.08 * 0.1 * 0.01)


def test_a_contact_on_part_of_its_sole_shows_what_carries(strolling_plan: Plan) -> None:
    support = strolling_plan.contacts.support.copy()
    support[0, :3], support[0, 3] = HEEL, np.nan
    plan = dataclasses.replace(strolling_plan, contacts=dataclasses.replace(strolling_plan.contacts, support=support))
    meshcat = Meshcat()
    draw_still(meshcat, plan, scene_from_yaml(plan.scene_yaml, source="plan"))
    name = plan.effectors[plan.contacts.effector[0]]
    assert meshcat.HasPath(f"{ROOT}/contacts/{name}/0/support")
    assert not meshcat.HasPath(f"{ROOT}/contacts/{name}/1/support")
