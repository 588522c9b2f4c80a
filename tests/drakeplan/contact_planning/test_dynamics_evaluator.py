"""Which transitions that are far from what was learned the exact program is asked about."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from drakeplan.contact_planning.dynamics_evaluator import MOST_ASKED, LearnedDynamics

LEAST_FRICTION = 0.4  # that was learned from


def asked(friction: np.ndarray | None, far: np.ndarray) -> list[int]:
    unused: Any = None
    surrogate: Any = SimpleNamespace(friction=(LEAST_FRICTION, 0.8))
    batch: Any = SimpleNamespace(friction=friction)
    return LearnedDynamics(unused, surrogate, unused)._asked_about(batch, far).tolist()


@settings(deadline=None)
@given(st.lists(st.tuples(st.booleans(), st.booleans()), min_size=1, max_size=80))
def test_all_on_slippery_ground_and_few_others(rows: list[tuple[bool, bool]]) -> None:
    far = np.flatnonzero([is_far for is_far, _ in rows])
    slippery = np.array([slips for _, slips in rows])
    friction = np.where(slippery, 0.5 * LEAST_FRICTION, 2.0 * LEAST_FRICTION)
    chosen = asked(friction, far)
    assert sorted(set(chosen)) == chosen
    assert set(chosen) <= set(far.tolist())
    assert set(far[slippery[far]].tolist()) <= set(chosen)
    others = [k for k in chosen if not slippery[k]]
    assert len(others) == min(MOST_ASKED, int((~slippery[far]).sum()))


def test_they_are_spread_from_the_first_to_the_last() -> None:
    far = np.arange(3, 67)
    chosen = asked(None, far)
    assert (chosen[0], chosen[-1], len(chosen)) == (3, 66, MOST_ASKED)
    assert np.ptp(np.diff(chosen)) <= 1
