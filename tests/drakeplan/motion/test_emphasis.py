"""Weights grow about a problem, for its kind alone."""

from __future__ import annotations

import numpy as np

from drakeplan.motion.check import Problem
from drakeplan.motion.emphasis import FIRMER, NEAR, Emphasis


def test_weights_grow_about_a_problem_for_its_kind_alone():
    t = np.arange(0.0, 4.0, 0.02)
    emphasis = Emphasis(t)
    held = Problem("held", 1, 2.0, 0.006, 0.004, "left_foot", (1.9, 2.1))
    jerk = Problem("jerk", 0, 0.5, 0.5, 0.36, "left_elbow", (0.5, 0.5))
    for times in (1, 2):
        where = emphasis.stress([held, jerk])
        near_held, near_jerk = (t > 1.9 - NEAR) & (t < 2.1 + NEAR), np.abs(t - 0.5) < NEAR
        assert np.array_equal(where, near_held | near_jerk)
        assert np.array_equal(emphasis.hold, np.where(near_held, FIRMER**times, 1.0))
        assert np.array_equal(emphasis.calm, np.where(near_jerk, FIRMER**times, 1.0))
        assert (emphasis.com == 1.0).all()
        assert (emphasis.apart == 1.0).all()
