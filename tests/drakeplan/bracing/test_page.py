"""The page of a braced plan shows its key postures one after the other, with base and joints between them."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

from drakeplan.bracing.braced_planner import BracedPlan, plan_braced
from drakeplan.bracing.bracer import Bracer
from drakeplan.bracing.page import DRIVE, FRAMES, STEP, _frames, write_braced_page
from scenes.library.braced_ramp import braced_ramp


@pytest.fixture(scope="module")
def plan(bracer: Bracer) -> BracedPlan:
    found = plan_braced(braced_ramp(0), bracer, "traversability", deadline=300.0)
    assert found is not None
    return found


def test_every_key_posture_has_its_time_and_time_never_stands_still(plan: BracedPlan) -> None:
    frames = _frames(plan)
    times = np.array([t for t, _, _ in frames])
    assert (np.diff(times) > 0.0).all()
    assert times[-1] == pytest.approx(plan.steps * STEP + (plan.steps - 1) * DRIVE)
    keys = frames[::FRAMES]
    assert len(keys) == 2 * plan.steps
    for k, (_, X_WB, q) in enumerate(keys):
        np.testing.assert_array_equal(q, plan.postures[k // 2, k % 2])
        np.testing.assert_allclose(X_WB.GetAsMatrix4(), plan.base[k // 2], atol=1e-12)


def test_while_a_palm_steps_the_base_stands_and_while_the_base_drives_it_goes_straight(plan: BracedPlan) -> None:
    frames = _frames(plan)
    for k in range(2 * plan.steps - 1):
        part = np.array([X.translation() for _, X, _ in frames[k * FRAMES : (k + 1) * FRAMES + 1]])
        moves = np.diff(part, axis=0)
        np.testing.assert_allclose(moves, moves[:1].repeat(FRAMES, axis=0), atol=1e-12)
        if k % 2 == 0:
            np.testing.assert_allclose(moves, 0.0, atol=1e-12)


def test_the_page_needs_nothing_beside_it(plan: BracedPlan, tmp_path: Path) -> None:
    path = tmp_path / "braced.html"
    write_braced_page(plan, braced_ramp(0), path)
    page = path.read_text(encoding="utf-8")
    assert page.lstrip().lower().startswith("<!doctype html>")
    assert not re.search(r"<(script|link)[^>]+(src|href)=\"?https?://", page)
