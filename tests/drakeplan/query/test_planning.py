"""Whole queries: every named scene end to end, the reasons for having no plan, and repeatability."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import h5py
import numpy as np
import pytest

from drakeplan.contact_planning.search_planner import SearchPlanner
from drakeplan.context import QueryContext
from drakeplan.plan.plan_file import write_plan
from drakeplan.query.options import PlanOptions
from drakeplan.query.planning import plan_scene
from drakeplan.query.result import PlanResult
from drakeplan.search.ana_star import Limits
from optimization.inverse_kinematics.whole_body_ik import WholeBodyIK
from scenes.contact import Contact, contact_pose
from scenes.files.scene_source import load_scene
from scenes.input_error import InputError
from scenes.robots.robot import load_robot
from scenes.scene import Goal, Scene, Start
from scenes.terrain.surface import Surface
from scenes.terrain.terrain import Box, Terrain

ESCHER = load_robot("escher")


def floor(name: str, x: tuple[float, float], y: tuple[float, float] = (-1, 1), friction: float = 0.5) -> Surface:
    corners = [[x[0], y[0], 0], [x[1], y[0], 0], [x[1], y[1], 0], [x[0], y[1], 0]]
    return Surface(name, np.array(corners, float), friction)


def plan(scene: Scene, **options) -> PlanResult:
    return plan_scene(scene, ESCHER, PlanOptions(**{"improve": 0.0, "deadline": 300.0, **options}))


def on(terrain: Terrain, goal=(2.0, 0.0, 0.0)) -> Scene:
    return Scene("test", terrain, Start((0.0, 0.0, 0.0)), Goal(goal))


@pytest.mark.slow
@pytest.mark.parametrize("name", ["flat", "stairs", "narrow_flat", "rubble_field", "rubble_corridor", "wide_gap"])
def test_a_named_scene_is_crossed_and_the_verifier_holds(name: str) -> None:
    result = plan(load_scene(name, seed=1), seed=1)
    assert result.status == "complete", result.reason
    assert result.verification is not None and result.verification.holds
    assert result.plan is not None and result.plan.status == "complete"


@pytest.mark.slow
def test_the_slab_is_crossed_with_a_palm_and_not_without() -> None:
    scene = load_scene("tilted_slab")
    with_palm = plan(scene)
    assert with_palm.status == "complete", with_palm.reason
    assert with_palm.report["palms_used"] > 0
    feet_alone = plan(scene, use_palms=False, expansions=3000, dynamics="quasi-static")
    assert feet_alone.status == "none"


@pytest.mark.slow
def test_a_packaged_robot_walks_with_what_its_nominal_posture_leaves_its_arms() -> None:
    try:
        robot = load_robot("jvrc1")
    except InputError as error:
        pytest.skip(str(error))
    result = plan_scene(load_scene("flat"), robot, PlanOptions(improve=0.0))
    assert result.status == "complete", result.reason
    assert any("no learned dynamics" in note for note in result.notes)


@pytest.mark.slow
def test_a_mesh_is_crossed() -> None:
    pytest.importorskip("trimesh")
    try:
        scene = load_scene("hpp/stairs")
    except InputError as error:
        pytest.skip(str(error))
    result = plan(scene, start=(-0.6, 0.8), goal=(2.2, 0.8))
    assert result.status == "complete", result.reason


@pytest.mark.parametrize("cone", ["inner", "square", "second_order", "diamond"])
def test_the_steep_slope_has_a_quasi_static_crossing_only_under_a_cone_that_exceeds_coulombs(cone: str) -> None:
    """tan 30 deg = 0.577 exceeds the friction of 0.5; the diamond claims up to 0.707 across its corners."""
    planner = SearchPlanner(QueryContext(load_scene("steep_slope"), ESCHER, WholeBodyIK(ESCHER), cone))
    found = next(planner.plans(Limits(expansions=300)), None)
    assert (found is not None) == (cone == "diamond"), planner.why_not()
    if found is None:
        assert planner.domain.rejections["friction"] > 0


def test_a_goal_on_an_island_is_proved_unreachable() -> None:
    result = plan(on(Terrain((floor("here", (-1, 1)), floor("island", (3, 5)))), (4.0, 0.0, 0.0)))
    assert result.status == "none"
    assert "goal unreachable" in result.reason


def test_a_solid_wall_across_the_way_is_proved_to_be_one() -> None:
    X_WO = np.eye(4)
    X_WO[:3, 3] = [1.0, 0.0, 1.0]
    wall = Box("wall", np.array([0.2, 9.0, 2.0]), X_WO)
    result = plan(on(Terrain((floor("floor", (-1, 4)),), (wall,))))
    assert result.status == "none"
    assert "goal unreachable: box 'wall' is between" in result.reason


def test_a_wall_of_one_plate_proves_nothing_and_the_search_says_so() -> None:
    corners = [[1.0, -4.0, 0.0], [1.0, -4.0, 2.0], [1.0, 4.0, 2.0], [1.0, 4.0, 0.0]]
    sheet = Surface("sheet", np.array(corners), effectors=frozenset())
    result = plan(on(Terrain((floor("floor", (-1, 3)), sheet))), expansions=30, dynamics="quasi-static")
    assert result.status == "none"
    assert "unreachable" not in result.reason
    assert "after 30 expansions; the grid knows no way" in result.reason


@pytest.mark.slow
def test_a_room_is_crossed_on_its_floor_and_not_on_its_roof() -> None:
    roof = Surface("roof", floor("", (-1, 2)).vertices + np.array([0.0, 0.0, 2.4]))
    result = plan(Scene("room", Terrain((floor("floor", (-1, 2)), roof))), start=(0.0, 0.0), goal=(0.5, 0.0))
    assert result.status == "complete", result.reason
    assert np.all(result.plan.contacts.X_WC[:, 2, 3] == 0.0)
    assert len(result.notes) == 2 and all("0.00 and 2.40 m: took 0.00" in note for note in result.notes)


@pytest.mark.slow
def test_a_goal_up_a_few_steps_is_reached_at_its_height() -> None:
    treads = [
        Surface(f"tread {k}", floor("", (0.1 + 0.3 * k, 0.4 + 0.3 * k)).vertices + np.array([0, 0, 0.2 * k]))
        for k in (1, 2)
    ]
    top = Surface("top", floor("", (1.0, 2.2)).vertices + np.array([0.0, 0.0, 0.6]))
    scene = on(Terrain((floor("floor", (-1.0, 0.4)), *treads, top)), (1.5, 0.0, 0.6))
    result = plan(scene)
    assert result.status == "complete", result.reason
    last = result.plan.stances[-1, :2]
    assert np.all(result.plan.contacts.X_WC[last, 2, 3] == 0.6)


def test_a_start_on_ice_that_tilts_is_infeasible_and_says_why() -> None:
    corners = [[-1, -1, -0.3], [1, -1, -0.3], [1, 1, 0.3], [-1, 1, 0.3]]  # rises by 0.3 m a metre to the left
    tilted = Surface("ice", np.array(corners, float), friction=0.05)
    result = plan(on(Terrain((tilted, floor("goal", (1.0, 4.0)))), (2.5, 0.0, 0.0)))
    assert result.status == "none"
    assert result.reason.startswith("start infeasible")
    assert "balance" in result.reason


@pytest.mark.parametrize("key", ["start", "goal"])
def test_a_place_off_the_terrain_is_bad_input_that_shows_the_extent(key: str) -> None:
    with pytest.raises(InputError, match="terrain spans"):
        plan(on(Terrain((floor("floor", (-1, 3)),))), **{key: (50.0, 0.0)})


def test_a_given_start_stance_is_kept() -> None:
    poses = {"left_foot": (0.1, 0.12), "right_foot": (0.0, -0.1)}
    normal = np.array([0, 0, 1.0])
    stance = tuple(Contact(e, 0, contact_pose(e, np.array([*xy, 0]), normal, 0.0), 0.5) for e, xy in poses.items())
    scene = on(Terrain((floor("floor", (-1, 3)),)), (0.6, 0.0, 0.0))
    result = plan(dataclasses.replace(scene, start=Start((0.05, 0.01, 0.0), 0.0, stance)))
    assert result.plan is not None, result.reason
    assert result.plan.stance(0).contacts[:2] == stance


def test_unknown_planners_and_numbers_that_are_none_are_refused() -> None:
    scene = load_scene("flat")
    wrong = {"planner": "mip", "dynamics": "magic", "deadline": float("nan"), "friction": -1.0}
    for name, value in wrong.items():
        with pytest.raises(InputError, match=name):
            plan(scene, **{name: value})


def test_the_same_seed_and_budget_give_the_same_plan_bit_for_bit(tmp_path: Path) -> None:
    files = []
    for k in range(2):
        result = plan_scene(load_scene("rubble_field", seed=3), ESCHER, PlanOptions(seed=3, expansions=60))
        assert result.plan is not None, result.reason
        write_plan(result.plan, tmp_path / f"{k}.h5")
        files.append(h5py.File(tmp_path / f"{k}.h5"))
    names: list[str] = []
    files[0].visititems(lambda name, item: names.append(name) if isinstance(item, h5py.Dataset) else None)
    assert len(names) > 15
    for name in names:
        np.testing.assert_array_equal(files[0][name][()], files[1][name][()], err_msg=name)


@pytest.mark.slow
def test_a_wall_that_the_feet_do_not_need_is_not_touched() -> None:
    wall = Surface("wall", np.array([[-0.5, 0.6, 0.0], [3.0, 0.6, 0.0], [3.0, 0.6, 2.0], [-0.5, 0.6, 2.0]]))
    assert wall.allows("left_palm") or wall.allows("right_palm")
    result = plan(on(Terrain((floor("floor", (-1.0, 2.0)), wall)), goal=(0.6, 0.0, 0.0)))
    assert result.status == "complete", result.reason
    assert result.report["palms_used"] == 0
