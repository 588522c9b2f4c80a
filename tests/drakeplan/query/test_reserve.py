"""A query keeps a reserve where it can, says so where it cannot, and with `simulate` counts only what physics plays."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable

import numpy as np
import pytest

import drakeplan.execution
from drakeplan.contact_planning.search_planner import SearchPlanner
from drakeplan.context import QueryContext
from drakeplan.execution import ExecutionReport
from drakeplan.plan.plan import Plan
from drakeplan.query import one_planner
from drakeplan.query.options import PlanOptions
from drakeplan.query.planning import plan_scene
from drakeplan.query.result import PlanResult
from optimization.balance.reserve import ALL, USUAL, Reserve
from optimization.convex import piqp_adapter
from optimization.inverse_kinematics.whole_body_ik import WholeBodyIK
from scenes.files.scene_source import load_scene
from scenes.input_error import InputError
from scenes.robots.robot import load_robot
from scenes.scene import Goal, Scene, Start
from scenes.terrain.surface import Surface
from scenes.terrain.terrain import Terrain

ESCHER = load_robot("escher")
SHORT = {"goal": (0.6, 0.0), "use_palms": False, "improve": 0.0, "deadline": 300.0}


def walk(**options) -> PlanResult:
    return plan_scene(load_scene("flat"), ESCHER, PlanOptions(**SHORT, expansions=60, **options))


def test_a_plan_says_what_it_keeps_and_keeps_it() -> None:
    result = walk()
    assert result.status == "complete", result.reason
    assert result.plan is not None
    assert result.plan.provenance["reserve"] == vars(USUAL)
    c = result.plan.centroidal
    assert c is not None
    half = np.array(result.plan.half_extent)
    loaded = (c.contact >= 0) & (c.force_W[..., 2] > 1.0)
    assert np.abs(c.cop_C / half)[loaded].max() <= USUAL.pressure + 1e-4  # whole soles on level ground
    assert (np.hypot(c.force_W[..., 0], c.force_W[..., 1]) <= USUAL.friction * 0.5 * c.force_W[..., 2] + 1e-4).all()


def test_where_no_plan_keeps_it_one_without_is_found_and_says_so() -> None:
    """A slope between both cones: a foot stands on it with all of the friction, not with nine tenths."""
    slope, friction = np.arctan(0.47), 0.5
    rise = float(np.tan(slope))
    ramp = Surface(
        "ramp",
        np.array(
            [[-0.6, -0.5, -0.6 * rise], [1.2, -0.5, 1.2 * rise], [1.2, 0.5, 1.2 * rise], [-0.6, 0.5, -0.6 * rise]]
        ),
        friction,
    )
    scene = Scene("ramp", Terrain((ramp,), ()), Start((0.0, 0.0, 0.0)), Goal((0.3, 0.0, 0.3 * rise)))
    result = plan_scene(scene, ESCHER, PlanOptions(**{**SHORT, "goal": None}, expansions=100))
    assert result.status == "complete", result.reason
    assert result.plan is not None
    assert result.plan.provenance["reserve"] == vars(ALL)
    assert any("no verified plan keeps a reserve" in note for note in result.notes)
    assert any("keeps a smaller reserve" in note for note in result.notes)  # tried in between
    assert "planned without a reserve of friction and supports" in result.notes


def test_an_eased_reserve_frees_the_pressure_alone_and_never_asks_for_more() -> None:
    eased = USUAL.eased()
    assert USUAL.pressure < eased.pressure < 1.0
    assert dataclasses.replace(eased, pressure=USUAL.pressure) == USUAL
    assert eased.eased() == eased
    assert ALL.eased() == ALL
    assert Reserve(pressure=0.9).eased() == Reserve(pressure=0.9)


def report(reached: bool, at: float) -> ExecutionReport:
    return ExecutionReport(
        reached=reached,
        reason="" if reached else "it sank in phase 3",
        fell_at_s=None if reached else at,
        at_plan_s=at,
        plan_s=10.0,
        simulated_s=at,
        real_time_factor=1.0,
        goal_distance_m=None,
        slips_m={"left_foot": 0.0},
        com_error_m=0.01,
        torque_share=0.5,
        saturated_share=0.0,
        late_touches=(),
        early_touches=0,
        collisions={},
        programs_failed=0,
    )  # fmt: skip


def falls(times: int, played: list[Plan]) -> Callable[..., ExecutionReport]:
    """Physics in which the first plans fall in the swing of their second transition."""

    def play(plan: Plan, model: str, **_) -> ExecutionReport:
        played.append(plan)
        return report(len(played) > times, 3.5)

    return play


def test_a_plan_that_falls_is_barred_and_another_is_found(monkeypatch: pytest.MonkeyPatch) -> None:
    played: list[Plan] = []
    monkeypatch.setattr(drakeplan.execution, "play_plan", falls(1, played))
    result = walk(simulate=True)
    assert result.status == "complete", result.reason
    assert result.plan is not None
    assert len(played) == 2
    first, second = (plan.contact_sequence() for plan in played)
    assert second[1:3] != first[1:3]  # stances 1 and 2 stand for the transition in which it fell
    assert result.plan.provenance["simulated"]["reached"] is True
    assert result.report["repairs"] == 1
    assert result.report["simulated"]["reached"] is True


def test_where_every_plan_falls_the_last_fall_is_the_reason(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(drakeplan.execution, "play_plan", falls(1000, []))
    monkeypatch.setattr(one_planner, "MAX_REPAIRS", 3)  # plans that fall before it gives up
    result = walk(simulate=True, reserve=ALL)
    assert result.status == "contacts"
    assert "played in physics it failed at 3.5 s: it sank in phase 3" in result.reason
    assert result.plan is not None and result.plan.motion is None


def test_nothing_is_played_where_nobody_asks(monkeypatch: pytest.MonkeyPatch) -> None:
    played: list[Plan] = []
    monkeypatch.setattr(drakeplan.execution, "play_plan", falls(0, played))
    assert walk().report["simulated"] is None
    assert not played


def test_playing_without_its_solver_is_refused_before_anything_is_planned(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(piqp_adapter, "available", lambda: False)
    with pytest.raises(InputError, match=r"--simulate needs PIQP: pip install 'drakeplan\[fast\]'"):
        walk(simulate=True)


@pytest.mark.parametrize("width", [0.5, 1.0])
def test_how_much_of_a_sole_is_stood_on_goes_with_the_robots_soles(width: float) -> None:
    feet = [
        dataclasses.replace(e, half_extent=(e.half_extent[0], width * e.half_extent[1])) for e in ESCHER.effectors[:2]
    ]
    robot = dataclasses.replace(ESCHER, effectors=(*feet, *ESCHER.effectors[2:]))
    planner = SearchPlanner(QueryContext(load_scene("flat"), robot, WholeBodyIK(ESCHER), reserve=USUAL))
    assert planner.domain.least_support == pytest.approx(USUAL.support * width * ESCHER.effectors[0].half_extent[1])
