"""What a query needs once is made once, however many attempts it takes."""

from __future__ import annotations

from collections import Counter

import numpy as np
import pytest

from drakeplan import context as module
from drakeplan.context import QueryContext
from drakeplan.query import one_planner
from drakeplan.query.options import PlanOptions
from drakeplan.query.planning import plan_scene
from drakeplan.query.query import Query
from optimization.balance.friction import DEFAULT_CONE, FrictionCone
from optimization.inverse_kinematics.whole_body_ik import WholeBodyIK
from scenes.files.scene_source import load_scene
from scenes.input_error import InputError
from scenes.robots.robot import load_robot
from scenes.scene import Goal, Scene, Start

ROBOT = load_robot("escher")
MADE = ("pack_terrain", "build_plant", "start_stance", "check_goal")


@pytest.fixture
def made(monkeypatch: pytest.MonkeyPatch) -> Counter[str]:
    """Counts what is made of a terrain."""
    counts: Counter[str] = Counter()

    def counted(name: str):
        make = getattr(module, name)

        def count(*args, **kwargs):
            counts[name] += 1
            return make(*args, **kwargs)

        return count

    for name in MADE:
        monkeypatch.setattr(module, name, counted(name))
    return counts


@pytest.mark.slow
def test_a_second_attempt_packs_and_builds_nothing(made: Counter[str], monkeypatch: pytest.MonkeyPatch) -> None:
    run = Query.run
    attempts = []

    def fails_at_first(query: Query, deadline: float, max_repairs: int):
        result = run(query, deadline, max_repairs)
        attempts.append(query.record.dynamics)
        return result if len(attempts) > 1 else type(result)("none", "made to fail", None, result.report)

    monkeypatch.setattr(one_planner, "load_kernels", lambda *_: None)  # a small scene of its own
    monkeypatch.setattr(Query, "run", fails_at_first)
    result = plan_scene(load_scene("flat"), ROBOT, PlanOptions(goal=(0.5, 0.0), expansions=60, deadline=300.0))
    assert attempts == ["learned", "quasi-static"]
    assert result.status == "complete", result.reason
    assert any("made to fail" in note for note in result.notes)
    assert made == Counter(dict.fromkeys(MADE, 1))


def test_nothing_is_made_before_it_is_asked_for(made: Counter[str]) -> None:
    context = QueryContext(load_scene("flat"), ROBOT, WholeBodyIK(ROBOT))
    assert not made
    assert context.packed is context.packed
    assert context.start is context.start
    assert made == Counter(pack_terrain=1, start_stance=1)


def test_start_and_goal_come_down_to_the_ground_and_a_given_stance_stays() -> None:
    scene = load_scene("stairs")
    hovering = Scene(scene.name, scene.terrain, Start((0.0, 0.0, np.nan)), Goal((*scene.goal.xyz[:2], np.nan)))
    context = QueryContext(hovering, ROBOT, WholeBodyIK(ROBOT))
    placed = context.scene_on_ground
    assert placed.start.xyz[2] == pytest.approx(context.start.feet_mean()[2])
    assert np.isfinite(placed.goal.xyz).all()


def test_a_cone_is_checked_where_the_context_is_made() -> None:
    ik, scene = WholeBodyIK(ROBOT), load_scene("flat")
    assert QueryContext(scene, ROBOT, ik).cone is DEFAULT_CONE is FrictionCone.INNER
    assert QueryContext(scene, ROBOT, ik, "square").cone is FrictionCone.SQUARE
    with pytest.raises(InputError, match="second_order"):
        QueryContext(scene, ROBOT, ik, "second")
