"""What stands in the way: named where the change that removes it, and it alone, opens a way."""

from __future__ import annotations

import json
import re
from dataclasses import replace

import numpy as np
import pytest

from drakeplan.contact_planning.contact_plan import DynamicsName, PlannerOptions
from drakeplan.context import QueryContext
from drakeplan.query.obstacle import Obstacle, find_obstacle, proved_obstacle
from drakeplan.query.options import PlanOptions
from drakeplan.query.planning import plan_scene
from drakeplan.query.relaxations import needed_friction, relaxations
from optimization.inverse_kinematics.whole_body_ik import WholeBodyIK
from scenes.pose import pose_matrix
from scenes.robots.robot import load_robot
from scenes.scene import Goal, Scene, Start
from scenes.terrain.surface import Surface
from scenes.terrain.terrain import Box, Terrain
from scenes.transition_model import transition_model

ESCHER = load_robot("escher")
IK = WholeBodyIK(ESCHER)
AMPLE = 20.0  # [s] the budgets of expansions are what ends a search here
LOWEST = 1.65 - (0.953 - 0.5)  # [m] top of escher's torso box when its CoM is as low as it goes
FEET = PlannerOptions(use_palms=False)
FIXED = PlannerOptions(use_palms=False, footholds="fixed")


def slab(name: str, x: tuple[float, float], y: tuple[float, float] = (-0.6, 0.6), friction: float = 0.7) -> Surface:
    corners = [[x[0], y[0], 0.0], [x[1], y[0], 0.0], [x[1], y[1], 0.0], [x[0], y[1], 0.0]]
    return Surface(name, np.array(corners), friction)


def context(surfaces: list[Surface], goal: float, obstacles: tuple[Box, ...] = (), z: float = 0.0) -> QueryContext:
    scene = Scene("test", Terrain(tuple(surfaces), obstacles), Start((0.0, 0.0, 0.0)), Goal((goal, 0.0, z)))
    return QueryContext(scene, ESCHER, IK, full_soles=True)


def obstacle(of: QueryContext, options: PlannerOptions = FEET) -> Obstacle:
    found = find_obstacle(of, options, AMPLE)
    assert json.loads(json.dumps(found.as_dict()))["kind"] == found.kind
    return found


@pytest.mark.parametrize(("steps", "gap"), [*((FIXED, gap) for gap in (0.35, 0.4, 0.45)), (FEET, 0.45), (FEET, 0.5)])
def test_a_gap_names_the_steps_that_cross_it(steps: PlannerOptions, gap: float) -> None:
    enough, reach = "long_stride", {"fixed": 0.4, "snapped": 0.5}[steps.footholds]
    on = context([slab("here", (-0.8, 0.5)), slab("there", (0.5 + gap, 2.2 + gap))], 1.2 + gap)
    found = obstacle(on, steps)
    assert (found.kind, found.obstacle, found.remedy) == ("stride", "there", f"--transition-model {enough}")
    assert found.limit["reach_m"] == reach
    assert found.limit["stride_m"] >= gap + 2 * ESCHER.effectors[0].half_extent[0] > reach
    assert found.place is not None and 0.3 < found.place[0] < 0.7 + gap
    assert found.tested[f"steps of {enough}"] == "found"
    assert list(found.tested.values()).count("found") == 1


def test_a_gap_that_no_steps_cross_names_none() -> None:
    found = obstacle(context([slab("here", (-0.8, 0.5)), slab("there", (2.5, 4.0))], 3.2))
    assert (found.kind, found.remedy) == ("unknown", "")
    assert "found" not in found.tested.values()
    assert "steps of leap_stride" in found.text


@pytest.mark.parametrize("height", [0.8, 1.1])
def test_a_beam_names_its_height_and_the_robots(height: float) -> None:
    beam = Box("beam", np.array([0.6, 3.0, 0.3]), pose_matrix((0.9, 0.0, height + 0.15), (0.0, 0.0, 0.0)))
    aside = Box("aside", np.array([0.2, 0.2, 0.2]), pose_matrix((0.9, 3.0, 0.1), (0.0, 0.0, 0.0)))
    found = obstacle(context([slab("floor", (-0.8, 2.6))], 1.8, (aside, beam)), FEET)
    assert (found.kind, found.obstacle) == ("collision", "box 'beam'")
    assert found.limit["clearance_m"] == pytest.approx(height)
    assert found.limit["needed_m"] == pytest.approx(LOWEST)
    assert found.tested["no box 'beam'"] == "found"


def beam(height: float, depth: float = 0.6, half_width: float = 1.0) -> Box:
    return Box("beam", np.array([depth, 2 * half_width, 0.3]), pose_matrix((1.1, 0.0, height + 0.15), (0.0, 0.0, 0.0)))


@pytest.mark.parametrize("height", [0.5, 0.9, 1.1, 1.19])
@pytest.mark.parametrize("full_soles", [True, False])
def test_a_beam_lower_than_the_lowest_torso_is_proved_and_said_at_once(height: float, full_soles: bool) -> None:
    low = replace(context([slab("floor", (-0.8, 3.0))], 2.2, (beam(height),)), full_soles=full_soles)
    found = proved_obstacle(low, FEET)
    assert found is not None
    assert (found.kind, found.obstacle) == ("collision", "box 'beam'")
    assert found.limit["clearance_m"] == pytest.approx(height)
    assert found.text == (
        f"box 'beam' leaves {height:.2f} m over the floor, the robot needs {LOWEST:.2f} m lowered as far as it can, "
        "and no way leads round it"
    )


@pytest.mark.parametrize("height", [1.21, 1.3, 1.6, 2.5])
def test_no_beam_is_proved_under_which_the_lowest_torso_passes(height: float) -> None:
    assert proved_obstacle(context([slab("floor", (-0.8, 3.0))], 2.2, (beam(height),)), FEET) is None


def test_no_beam_is_proved_that_a_way_leads_round_or_a_stride_under() -> None:
    wide = context([slab("floor", (-0.8, 3.0), (-0.6, 2.0))], 2.2, (beam(1.0),))
    thin = context([slab("floor", (-0.8, 3.0))], 2.2, (beam(1.0, depth=0.1),))
    aside = context([slab("floor", (-0.8, 3.0)), slab("aside", (-0.8, 3.0), (0.6, 2.0))], 2.2, (beam(1.0),))
    behind = context([slab("floor", (-0.8, 3.0))], 0.3, (beam(1.0),))
    assert [proved_obstacle(c, FEET) for c in (wide, thin, aside, behind)] == [None] * 4


def test_a_low_surface_is_a_ceiling_too_and_one_on_stairs_is_measured_from_their_treads() -> None:
    sheet = Surface("sheet", np.array([[0.7, -1, 1.0], [1.6, -1, 1.0], [1.6, 1, 1.0], [0.7, 1, 1.0]]))
    found = proved_obstacle(context([slab("floor", (-0.8, 3.0)), sheet], 2.2), FEET)
    assert found is not None
    assert found.obstacle == "surface 'sheet'"
    treads = [slab("floor", (-0.8, 0.4))]
    for k in range(4):
        x = 0.4 + 0.3 * k
        treads.append(slab(f"tread {k}", (x, x + 0.3)))
        treads[-1] = Surface(f"tread {k}", treads[-1].vertices + np.array([0, 0, 0.1 * (k + 1)]))
    top = Surface("top", slab("top", (1.6, 3.0)).vertices + np.array([0, 0, 0.5]))
    over = Box("over", np.array([0.6, 2.0, 0.3]), pose_matrix((2.0, 0.0, 0.5 + 1.0 + 0.15), (0, 0, 0)))
    found = proved_obstacle(context([*treads, top], 2.6, (over,), z=0.5), FEET)
    assert found is not None
    assert found.obstacle == "box 'over'"
    assert found.limit["clearance_m"] == pytest.approx(1.0, abs=0.3)  # over the ground near it


@pytest.mark.parametrize("degrees", [35.0, 40.0])
def test_a_slope_names_the_friction_that_it_needs(degrees: float) -> None:
    rise = np.tan(np.deg2rad(degrees))
    up = Surface(
        "ramp", np.array([[0.4, -0.6, 0], [1.3, -0.6, 0.9 * rise], [1.3, 0.6, 0.9 * rise], [0.4, 0.6, 0]]), 0.5
    )
    top = Surface("top", slab("", (1.3, 2.8)).vertices + np.array([0.0, 0.0, 0.9 * rise]))
    found = obstacle(context([slab("floor", (-0.8, 0.4)), up, top], 1.9, z=0.9 * rise))
    assert needed_friction(up.normal) == pytest.approx(rise)
    assert (found.kind, found.obstacle) == ("friction", "ramp")
    assert found.limit["needed"] == pytest.approx(rise)
    assert f"slope 'ramp' of {degrees:.0f} deg needs friction {rise:.2f}, has 0.5" in found.text


def test_friction_that_holds_a_foot_is_no_rung() -> None:
    on = context([slab("floor", (-0.8, 2.6))], 1.0)
    assert "friction" not in [rung.kind for rung in relaxations(on, FEET)]
    longest = PlannerOptions(model=transition_model("leap_stride"))
    assert "stride" not in [rung.kind for rung in relaxations(on, longest)]
    assert [rung.kind for rung in relaxations(on, FEET)] == ["search", "stride", "stride", "sole"]
    tried = PlannerOptions(use_palms=False, longer=transition_model("long_stride"))
    assert [rung.remedy for rung in relaxations(on, tried) if rung.kind == "stride"] == [
        "--transition-model leap_stride"
    ]


def test_stones_of_a_sole_are_called_small() -> None:
    stones = [
        slab(f"s{k}", (0.55 + 0.35 * k - 0.1095, 0.55 + 0.35 * k + 0.1095), (y - 0.05, y + 0.05))
        for k in range(3)
        for y in [0.12 * (-1) ** k]
    ]
    found = obstacle(context([slab("here", (-0.8, 0.4)), *stones, slab("there", (1.45, 2.8))], 1.9), FEET)
    assert found.kind == "sole"
    assert found.obstacle in {"s0", "s1", "s2"}
    assert "is 21.9 x 10 cm, a sole 22 x 10 cm" in found.text


def test_what_feet_alone_do_is_said_with_the_option_for_it() -> None:
    found = obstacle(context([slab("floor", (-0.8, 2.0))], 0.6), PlannerOptions(dynamics="learned"))
    assert (found.kind, found.remedy) == ("search", "--no-palms --dynamics quasi-static")


def test_a_query_carries_what_stands_in_its_way_as_a_sentence_and_as_data() -> None:
    scene = context([slab("here", (-0.8, 0.5)), slab("there", (1.02, 2.6))], 1.7).scene
    options = PlanOptions(
        dynamics="quasi-static", use_palms=False, full_soles=True, footholds="fixed", expansions=20, deadline=120.0
    )
    result = plan_scene(scene, ESCHER, options)
    assert result.status == "none" and "goal unreachable" in result.reason
    # Which of the two is found first depends on what the machine does in a second.
    assert re.search(r"the way is open: --transition-model (long|leap)_stride$", result.reason)
    data = result.report["obstacle"]
    assert isinstance(data, dict) and data["kind"] == "stride"
    assert result.report["reason"] == result.reason


def climb(degrees: float, length: float, friction: float, *, across: Surface | None = None) -> QueryContext:
    """A slope that is so long in the plan view between two floors, and one more surface."""
    rise = length * np.tan(np.deg2rad(degrees))
    up = Surface(
        "ramp",
        np.array([[0.4, -0.6, 0], [0.4 + length, -0.6, rise], [0.4 + length, 0.6, rise], [0.4, 0.6, 0]]),
        friction,
    )
    top = Surface("top", slab("", (0.4 + length, 2.4 + length)).vertices + np.array([0.0, 0.0, rise]))
    more = [] if across is None else [across]
    return context([slab("floor", (-0.8, 0.4)), up, top, *more], 1.2 + length, z=rise)


@pytest.mark.parametrize(
    ("degrees", "length", "friction", "dynamics", "closed"),
    [
        (35.0, 0.9, 0.5, "quasi-static", True),
        (35.0, 0.9, 0.5, "learned", False),  # short enough to be run over
        (35.0, 1.9, 0.5, "learned", True),
        (40.0, 1.9, 0.5, "exact", True),
        (30.0, 1.9, 0.5, "learned", False),  # momentum may do it
        (35.0, 1.9, 0.71, "quasi-static", False),
        (35.0, 0.3, 0.5, "quasi-static", False),  # stepped over
    ],
)
def test_friction_closes_a_slope_before_any_search_only_where_that_is_proved(
    degrees: float, length: float, friction: float, dynamics: DynamicsName, closed: bool
) -> None:
    found = proved_obstacle(climb(degrees, length, friction), PlannerOptions(dynamics=dynamics))
    assert (found is not None) == closed
    if found is not None:
        needed = np.tan(np.deg2rad(degrees))
        assert (found.kind, found.obstacle) == ("friction", "ramp")
        assert f"slope 'ramp' of {degrees:.0f} deg needs friction {needed:.2f}, has {friction:g}" in found.text


def test_no_proof_where_a_way_round_or_a_wall_for_palms_is_left() -> None:
    rough = climb(35.0, 1.9, 0.5).scene.terrain.surfaces[1].vertices + np.array([0.0, 1.25, 0.0])
    options = PlannerOptions(dynamics="quasi-static")
    assert proved_obstacle(climb(35.0, 1.9, 0.5, across=Surface("rough", rough, 1.0)), options) is None
    wall = Surface("wall", np.array([[0.0, 0.7, 0.0], [3.0, 0.7, 0.0], [3.0, 0.7, 2.0], [0.0, 0.7, 2.0]]), 0.5)
    assert any(wall.allows(palm) for palm in ("left_palm", "right_palm"))
    walled = climb(35.0, 1.9, 0.5, across=wall)
    assert proved_obstacle(walled, options) is None
    feet = PlannerOptions(dynamics="quasi-static", use_palms=False)
    assert proved_obstacle(walled, feet) is not None


def test_a_query_over_too_steep_a_slope_ends_before_its_search() -> None:
    result = plan_scene(climb(35.0, 1.9, 0.5).scene, ESCHER, PlanOptions(deadline=60.0))
    assert result.status == "none"
    assert result.report["expansions"] == 0
    assert "goal unreachable: slope 'ramp' of 35 deg needs friction 0.70, has 0.5" in result.reason
    data = result.report["obstacle"]
    assert isinstance(data, dict) and data["limit"]["needed"] == pytest.approx(np.tan(np.deg2rad(35.0)))
