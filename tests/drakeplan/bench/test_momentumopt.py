"""The centroidal program under momentumopt's conventions: a linear least-squares twin, and the published case."""

from __future__ import annotations

import copy
import json
import os
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from drakeplan.bench import momentumopt
from drakeplan.bench.momentumopt import COLUMNS, compare, judge
from drakeplan.bench.peers.momentumopt_case import read_case
from drakeplan.bench.table import BenchOptions
from scenes.input_error import InputError

CASES = os.environ.get("DRAKEPLAN_CASES")
N, DT, MASS, RISE = 12, 0.1, 60.0, 0.03
LMOM, LMOMD, FINAL, COM, FORCE = 0.02, 0.01, 3.0, 8000.0, 0.0  # of the z axis
VERDICT, OBJECTIVE, REFERENCE = (COLUMNS.index(name) for name in ("verdict", "objective", "reference"))


def rise_by_least_squares() -> tuple[np.ndarray, float]:
    """Heights above the start and the objective of a point mass that two level feet lift, from one lstsq.

    With u[j] the net force in [t_j, t_j+1): l[i] = dt sum_{j<=i} u[j] and z[i] = dt/m sum_{k<=i} l[k].
    """
    momentum = DT * np.tril(np.ones((N, N)))
    height = DT / MASS * np.tril(np.ones((N, N))) @ momentum
    weight = np.full(N, LMOM)
    weight[-1] = FINAL
    A = np.vstack([np.sqrt(weight)[:, None] * momentum, np.sqrt(LMOMD) * np.eye(N), np.sqrt(COM) * height[-1:]])
    b = np.zeros(len(A))
    b[-1] = np.sqrt(COM) * RISE
    u = np.linalg.lstsq(A, b, rcond=None)[0]
    return height @ u, float(np.sum((A @ u - b) ** 2))


@pytest.fixture
def twin() -> dict:
    """The least-squares problem in the file's format; weights on x and y would spoil it if axes were mixed up."""
    z, _ = rise_by_least_squares()
    com = np.stack([np.zeros(N), np.zeros(N), -0.1 + z], axis=1)
    lmom = np.zeros((N, 3))
    lmom[:, 2] = MASS / DT * np.diff(z, prepend=0.0)
    foot = [0.0, 99.0, 0.0, 0.1, -0.9, 1.0, 0.0, 0.0, 0.0, 1.0, -1.0]
    other = [*foot[:3], -0.1, *foot[4:]]
    planner = {
        "heuristic": "SoftConstraint", "time_step": DT, "time_horizon": N * DT, "gravity": 9.81, "robot_mass": MASS,
        "friction_coeff": 0.8, "friction_cone": "LinearCone", "torque_range": [-200.0, 200.0],
        "com_displacement": [0.0, 0.0, RISE], "max_eef_lengths": [0.9, 0.9, 0.6, 0.6], "min_rel_height": 0.1,
        "w_trq_leg": 1.0, "w_com": [1.0, 1.0, COM], "w_amom": [0.5, 0.5, 0.5], "w_lmom": [50.0, 60.0, LMOM],
        "w_amomd": [0.1, 0.4, 0.1], "w_lmomd": [70.0, 80.0, LMOMD], "w_amom_final": [10.0, 10.0, 10.0],
        "w_lmom_final": [90.0, 90.0, FINAL], "w_frc_leg": [FORCE] * 3,
        **{f"cop_range_{who}": [-0.1, 0.1, -0.05, 0.05] for who in ("rf", "lf", "rh", "lh")},
        **{f"eff_offset_{who}": [0.0, 0.0, 0.0] for who in ("rf", "lf")},
    }  # fmt: skip
    plan = {"effcnt_lf": [foot], "effcnt_rf": [other], "effcnt_rh": [], "effcnt_lh": []}
    initial = {"com": [0.0, 0.0, -0.1], "lmom": [0.0] * 3, "amom": [0.0] * 3}
    reference = {"com": com.tolist(), "lmom": lmom.tolist(), "amom": np.zeros((N, 3)).tolist()}
    entry = {"initial": initial, "contact_plan": plan, "planner_variables": planner, "reference": reference}
    return {"variants": {"twin": entry}}


def rows_of(data: dict, folder: Path) -> list[tuple]:
    path = folder / "case.json"
    path.write_text(json.dumps(data), encoding="utf-8")
    return list(momentumopt.run(BenchOptions(case=path)).rows)


def test_a_lift_by_two_level_feet_is_the_least_squares_lift(twin: dict, tmp_path: Path) -> None:
    (row,) = rows_of(twin, tmp_path)
    _, objective = rise_by_least_squares()
    assert row[VERDICT] == "within"
    assert row[REFERENCE] == pytest.approx(objective, rel=1e-9)
    assert row[OBJECTIVE] == pytest.approx(objective, rel=1e-4)


def test_a_reference_that_could_be_better_is_beaten(twin: dict, tmp_path: Path) -> None:
    reference = twin["variants"]["twin"]["reference"]
    reference["lmom"][N // 2][2] += 1.0
    (row,) = rows_of(twin, tmp_path)
    assert row[VERDICT] == "lower"
    assert row[OBJECTIVE] < row[REFERENCE]


def test_a_reference_that_cheats_is_not_called_beaten(twin: dict, tmp_path: Path) -> None:
    reference = twin["variants"]["twin"]["reference"]
    reference["lmom"] = np.zeros((N, 3)).tolist()  # it arrives without ever moving
    (row,) = rows_of(twin, tmp_path)
    assert row[VERDICT] == "higher"


@pytest.mark.parametrize(
    ("spoil", "rule"),
    [
        (lambda t: replace(t, force_W=t.force_W * 1.001), "dynamics"),
        (lambda t: replace(t, com=t.com + np.array([0.0, 0.0, 0.2])), "reach"),
        (lambda t: replace(t, cop_C=t.cop_C + np.array([0.0, 0.2])), "pressure centre"),
        (lambda t: replace(t, torque_n=t.torque_n + 300.0), "torque"),
        (lambda t: replace(t, force_W=t.force_W * [3.0, 1.0, -1.0]), "friction"),
    ],
)
def test_each_rule_is_checked(spoil, rule: str, twin: dict, tmp_path: Path) -> None:
    path = tmp_path / "case.json"
    path.write_text(json.dumps(twin), encoding="utf-8")
    (variant,) = read_case(path)
    t = variant.build(variant.problem, variant.options).solve().trajectory
    assert t is not None
    assert max(variant.violations(t).values()) < momentumopt.HOLDS
    spoiled = spoil(t)
    assert variant.violations(spoiled)[rule] > 1e-4
    assert judge(variant, "given", variant.problem.schedule.dt, spoiled, 1, 0.0)[VERDICT] == "breaks a rule"


def test_reach_is_measured_to_the_pressure_centre(twin: dict, tmp_path: Path) -> None:
    """Legs too short for the contact points by 4 mm are long enough from the inner edges of the soles."""
    planner = twin["variants"]["twin"]["planner_variables"]
    height = -0.1 + rise_by_least_squares()[0].max() + 0.9
    inner, middle = np.hypot(height, 0.05), np.hypot(height, 0.1)
    planner["max_eef_lengths"][:2] = [middle - 0.004, middle - 0.004]
    assert inner < middle - 0.004
    (row,) = rows_of(twin, tmp_path)
    assert row[VERDICT] == "within"


@pytest.mark.parametrize(
    "spoil",
    [
        lambda v: v.pop("initial"),
        lambda v: v["planner_variables"].update(friction_cone="Cube"),
        lambda v: v["planner_variables"].update(robot_mass=-1.0),
        lambda v: v["planner_variables"].update(cop_range_lf=[-0.1, 0.2, -0.05, 0.05]),
        lambda v: v["reference"].update(com=[[0.0, 0.0, 0.0]]),
        lambda v: v["initial"].update(com=[float("nan"), 0.0, 0.0]),
    ],
)
def test_a_broken_case_is_named(spoil, twin: dict, tmp_path: Path) -> None:
    data = copy.deepcopy(twin)
    spoil(data["variants"]["twin"])
    with pytest.raises(InputError, match=r"case\.json"):
        rows_of(data, tmp_path)


def test_free_intervals_beat_the_best_fixed_ones(twin: dict, tmp_path: Path) -> None:
    entry = twin["variants"]["twin"]
    entry["planner_variables"].update(time_range=[0.05, 0.2], w_time=10.0)
    entry["derived_dt"] = [DT] * N
    fixed, free = rows_of(twin, tmp_path)
    assert fixed[VERDICT] == "within"
    assert free[VERDICT] in ("within", "lower")
    assert free[OBJECTIVE] < 0.95 * fixed[OBJECTIVE]


def test_a_horizon_that_is_fixed_stays(twin: dict, tmp_path: Path) -> None:
    entry = twin["variants"]["twin"]
    entry["planner_variables"].update(time_range=[0.05, 0.2], w_time=10.0, is_time_horizon_fixed=True)
    entry["derived_dt"] = [DT] * N
    path = tmp_path / "case.json"
    path.write_text(json.dumps(twin), encoding="utf-8")
    (variant,) = read_case(path)
    assert variant.fixed_horizon
    fixed, bound = rows_of(twin, tmp_path)
    entry["planner_variables"]["is_time_horizon_fixed"] = False
    _, free = rows_of(twin, tmp_path)
    assert free[OBJECTIVE] < bound[OBJECTIVE] <= fixed[OBJECTIVE] * (1 + 1e-6)


@pytest.mark.parametrize(("horizon", "knots"), [(1.2, 12), (1.26, 12), (1.29, 12), (1.3, 13)])
def test_a_horizon_has_the_knots_that_fit_into_it(horizon: float, knots: int, twin: dict, tmp_path: Path) -> None:
    entry = twin["variants"]["twin"]
    entry["planner_variables"]["time_horizon"] = horizon
    entry["reference"] = {key: np.zeros((knots, 3)).tolist() for key in ("com", "lmom", "amom")}
    path = tmp_path / "case.json"
    path.write_text(json.dumps(twin), encoding="utf-8")
    assert len(read_case(path)[0].problem.schedule.dt) == knots


def test_hands_carry_as_feet_do_and_reach_from_their_offset(twin: dict, tmp_path: Path) -> None:
    """Two hands in the places of the feet give the same lift, as far as arms reach from the shoulders."""
    (on_feet,) = rows_of(twin, tmp_path)
    entry = twin["variants"]["twin"]
    plan, planner = entry["contact_plan"], entry["planner_variables"]
    plan["effcnt_lh"], plan["effcnt_rh"] = plan["effcnt_lf"], plan["effcnt_rf"]
    plan["effcnt_lf"], plan["effcnt_rf"] = [], [[98.0, 99.0, *plan["effcnt_rf"][0][2:]]]  # a foot that comes too late
    planner.update(w_frc_arm=planner["w_frc_leg"], w_trq_arm=planner["w_trq_leg"])
    planner.update(eff_offset_lh=[0.0, 0.0, -0.4], eff_offset_rh=[0.0, 0.0, -0.4])
    (on_hands,) = rows_of(twin, tmp_path)
    assert on_hands[VERDICT] == on_feet[VERDICT] == "within"
    assert on_hands[OBJECTIVE] == pytest.approx(on_feet[OBJECTIVE], rel=1e-4)
    planner.update(eff_offset_lh=[0.0, 0.0, 0.0], eff_offset_rh=[0.0, 0.0, 0.0])
    (too_far,) = rows_of(twin, tmp_path)
    assert too_far[VERDICT] in ("no answer", "breaks a rule", "higher")
    planner["w_trq_arm"] = 7.0
    with pytest.raises(InputError, match="weights of arms"):
        rows_of(twin, tmp_path)


def test_without_a_case_the_table_says_so(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("DRAKEPLAN_CASES", raising=False)
    table = momentumopt.run(BenchOptions())
    assert not table.rows
    assert "skipped" in table.title


@pytest.mark.slow
@pytest.mark.skipif(not CASES, reason="DRAKEPLAN_CASES names no folder with momentumopt_demo01.json")
def test_every_published_variant_is_matched_or_beaten() -> None:
    variants = read_case(Path(CASES or "") / momentumopt.FILE)
    assert variants
    for variant in variants:
        for row in compare(variant):
            assert row[VERDICT] in ("within", "lower"), row
