"""Crossings that nobody makes standing still, from the scene to the verifier's word."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from drakeplan.query.options import PlanOptions
from drakeplan.query.planning import plan_scene
from drakeplan.query.result import PlanResult
from drakeplan.timing.step_timing import Timing
from scenes.library import slippery_slope, steep_slope, wider_gap
from scenes.robots.robot import load_robot
from scenes.scene import Goal, Scene, Start

ROBOT = load_robot("escher")


def crossed(scene: Scene, cone: str, timing: Timing) -> PlanResult:
    options = PlanOptions(dynamics="exact", cone=cone, timing=timing, deadline=300.0, improve=0.0)
    return plan_scene(scene, ROBOT, options)


@pytest.mark.slow
def test_a_slope_that_holds_nobody_is_planned_and_verified_under_the_true_cone() -> None:
    result = crossed(slippery_slope.named(), "second_order", Timing(0.3, 0.6))
    assert result.status == "complete", result.reason
    assert result.verification.holds
    c = result.plan.centroidal
    assert c.com[-1, 2] < c.com[0, 2] - 0.9 * slippery_slope.LENGTH * np.sin(slippery_slope.TILT)
    on_it = [all(result.plan.contacts.surface[k] == 1 for k in row if k >= 0) for row in c.contact]
    assert sum(on_it) > 20  # knots at which only the slope carries
    for n, e in zip(*np.nonzero(c.contact >= 0), strict=True):
        f = result.plan.contact(int(c.contact[n, e])).R_WC.T @ c.force_W[n, e]
        assert np.hypot(f[0], f[1]) <= 0.5 * f[2] + 1e-3  # [N]


@pytest.mark.slow
def test_a_gap_wider_than_balance_allows_is_planned_and_verified() -> None:
    edges = [s.vertices[:, 0] for s in wider_gap.named().terrain.surfaces]
    near, far = edges[0].max(), edges[1].min()
    start, goal = Start((near - 0.35, 0.0, 0.0), 0.0), Goal((far + 0.3, 0.0, 0.0), 0.2)  # the gap and little else
    result = crossed(dataclasses.replace(wider_gap.named(), start=start, goal=goal), "inner", Timing(0.6, 1.0))
    assert result.status == "complete", result.reason
    assert result.verification.holds
    c, X_WC = result.plan.centroidal, result.plan.contacts.X_WC
    held = [[X_WC[k][0, 3] for k in row if k >= 0] for row in c.contact]
    astride = [min(x) < near and max(x) > far for x in held]
    assert any(astride)
    over = np.flatnonzero((c.com[:, 0] > near) & (c.com[:, 0] < far))
    assert np.linalg.norm(c.linear_momentum[over], axis=1).min() > 0.1 * ROBOT.mass  # nobody stops there


@pytest.mark.slow
def test_the_published_slope_at_its_own_timing_needs_the_diamond_and_is_refused_by_the_verifier() -> None:
    result = crossed(steep_slope.named(length=1.5), "diamond", Timing())
    assert result.status == "contacts"
    assert "wrench in true cone" in result.reason
    assert any("diamond is up to 1.41 times larger than real friction" in note for note in result.notes)
