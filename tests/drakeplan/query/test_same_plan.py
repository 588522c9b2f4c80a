"""One small plan, held to what it was when it was recorded: code that moves must not change what it computes.

Contacts, stances and phases come from closed forms and are the same on every machine. Momenta, forces and the motion come
from solvers whose last bits depend on processor and library versions: where these are as recorded the bits must be
too, elsewhere the numbers within a tolerance.

A change that means to change plans records them again, and says so: `python tests/drakeplan/query/test_same_plan.py`.
"""

from __future__ import annotations

import hashlib
import json
import os
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

import llvmlite.binding
import numpy as np

from drakeplan.plan.plan import Plan
from drakeplan.query.options import PlanOptions
from drakeplan.query.planning import plan_scene
from scenes.files.scene_source import load_scene
from scenes.robots.robot import load_robot

RECORD = Path(__file__).with_suffix(".json")
DIGITS = 7  # of closed forms [m, rad], far above their rounding errors
SUMMARY_TOLERANCE = 1e-3  # [m, kg m/s, N / (M g), rad]: what solvers may leave open
SAMPLES = 9  # of each trajectory


def small_plan() -> Plan:
    """Two steps on level ground."""
    result = plan_scene(
        load_scene("flat"), load_robot("escher"), PlanOptions(seed=0, goal=(0.5, 0.0), expansions=60, deadline=300.0)
    )
    assert result.status == "complete", result.reason
    assert result.plan is not None
    return result.plan


def platform() -> dict[str, str]:
    """What the last bits of a solver depend on."""
    facts = {"processor": llvmlite.binding.get_host_cpu_name(), "blas": os.environ.get("OPENBLAS_CORETYPE", "")}
    for package in ("drake", "numpy", "scipy", "numba", "piqp"):
        try:
            facts[package] = version(package)
        except PackageNotFoundError:
            facts[package] = "-"
    return facts


def closed_form(plan: Plan) -> str:
    """Digest of the data that no solver has touched."""
    arrays = [plan.contacts.X_WC, plan.contacts.effector, plan.contacts.surface, plan.contacts.friction, plan.stances]
    assert plan.phases is not None
    arrays += [plan.phases.start, plan.phases.end, plan.phases.contact]
    return digest([np.round(np.asarray(a, float), DIGITS) + 0.0 for a in arrays])  # + 0.0: no negative zeros


def solved(plan: Plan) -> dict[str, np.ndarray]:
    """The data that solvers made."""
    assert plan.centroidal is not None
    assert plan.motion is not None
    c, m = plan.centroidal, plan.motion
    forces = c.force_W / (plan.mass * 9.81)
    return {"t": c.t, "com": c.com, "l": c.linear_momentum, "k": c.angular_momentum, "f": forces, "q": m.q, "v": m.v}


def digest(arrays: list[np.ndarray]) -> str:
    """SHA-256 of the arrays' shapes and bytes."""
    found = hashlib.sha256()
    for array in arrays:
        found.update(str(array.shape).encode())
        found.update(np.ascontiguousarray(array).tobytes())
    return found.hexdigest()


def summary(array: np.ndarray) -> list[list[float]]:
    """A few rows of a trajectory."""
    rows = np.linspace(0, len(array) - 1, SAMPLES).astype(int)
    return np.round(array.reshape(len(array), -1)[rows], 6).tolist()


def record(plan: Plan) -> dict[str, object]:
    """What is kept of the plan."""
    parts = solved(plan)
    return {
        "platform": platform(),
        "closed_form": closed_form(plan),
        "solved": {name: digest([array]) for name, array in parts.items()},
        "summary": {name: summary(array) for name, array in parts.items() if name not in ("f", "v")},
    }


def test_the_small_plan_is_the_one_that_was_recorded() -> None:
    kept, now = json.loads(RECORD.read_text()), record(small_plan())
    assert now["closed_form"] == kept["closed_form"]
    if kept["platform"] == now["platform"]:
        assert now["solved"] == kept["solved"]
    assert isinstance(now["summary"], dict)
    for name, rows in kept["summary"].items():
        np.testing.assert_allclose(now["summary"][name], rows, atol=SUMMARY_TOLERANCE, err_msg=name)


if __name__ == "__main__":
    RECORD.write_text(json.dumps(record(small_plan()), indent=1) + "\n")
