"""What a user has of footholds without an option: gaps crossed with longer steps, and what was used is in the plan."""

from __future__ import annotations

import numpy as np
import pytest

from drakeplan.query.options import PlanOptions
from drakeplan.query.planning import plan_scene
from scenes.input_error import InputError
from scenes.robots.robot import load_robot
from scenes.scene import Goal, Scene, Start
from scenes.terrain.surface import Surface
from scenes.terrain.terrain import Terrain

ESCHER = load_robot("escher")
GAP = 0.4  # [m]; with a sole of 0.22 m a stride of 0.62 m, and the usual steps end at 0.4 m


def gap() -> Scene:
    slabs = [
        Surface(name, np.array([[x0, -0.6, 0], [x1, -0.6, 0], [x1, 0.6, 0], [x0, 0.6, 0]]), 0.7)
        for name, x0, x1 in (("near", -0.6, 0.35), ("far", 0.35 + GAP, 1.8))
    ]
    return Scene("gap", Terrain(tuple(slabs)), Start((0.0, 0.0, 0.0)), Goal((1.3, 0.0, 0.0)))


def test_a_gap_is_crossed_without_naming_longer_steps() -> None:
    result = plan_scene(gap(), ESCHER, PlanOptions(dynamics="quasi-static", expansions=60, deadline=300.0))
    assert result.status == "complete", result.reason
    assert result.plan is not None
    assert result.plan.provenance["footholds"] == "snapped"
    feet = result.plan.contacts.X_WC[result.plan.contacts.effector < 2, :3, 3]
    on = [(feet[:, 0] < 0.35).sum(), (feet[:, 0] > 0.35 + GAP).sum()]
    assert min(on) > 0 and sum(on) == len(feet)


def test_fixed_steps_do_not_cross_it() -> None:
    asked = PlanOptions(
        dynamics="quasi-static", use_palms=False, footholds="fixed", full_soles=True, expansions=20, deadline=60.0
    )
    result = plan_scene(gap(), ESCHER, asked)
    assert result.status == "none"


def test_unknown_footholds_are_refused_with_the_names_that_there_are() -> None:
    with pytest.raises(InputError, match=r"footholds.*snapped"):
        plan_scene(gap(), ESCHER, PlanOptions(footholds="loose"))  # type: ignore[arg-type]
