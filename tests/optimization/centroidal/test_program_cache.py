"""Programs kept by structure: what is handed out answers its own problem, and the least recently used goes first."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from optimization.centroidal.contact_schedule import ContactSchedule
from optimization.centroidal.options import CentroidalOptions
from optimization.centroidal.problem import CentroidalProblem
from optimization.centroidal.program_cache import ProgramCache
from scenes.contact import Contact, contact_pose

HALF = np.array([[0.11, 0.065], [0.11, 0.065], [0.05, 0.05], [0.05, 0.05]])


def standing(intervals: int, shift: float = 0.0) -> CentroidalProblem:
    """Standing on both feet for a number of intervals, with the CoM a little to the side [m] at the start."""
    feet = [
        Contact(name, 0, contact_pose(name, [0, y, 0], np.array([0.0, 0.0, 1.0]), 0.0), 0.5)
        for name, y in (("left_foot", 0.1), ("right_foot", -0.1))
    ]
    schedule = ContactSchedule.from_rows([(*feet, None, None)] * intervals, 0.2)
    return CentroidalProblem(schedule, 76.0, HALF, np.array([0.0, shift, 0.9]))


def test_a_problem_of_a_known_structure_gets_the_same_program_with_its_own_numbers():
    cache = ProgramCache(CentroidalOptions())
    first = cache.program(standing(5))
    assert first.solve().trajectory.com[0, 1] == 0.0
    again = cache.program(standing(5, shift=0.02))
    assert again is first
    assert again.solve().trajectory.com[0, 1] == 0.02
    assert cache.program(standing(6)) is not first


def test_beyond_the_bound_the_least_recently_used_program_is_dropped():
    cache = ProgramCache(replace(CentroidalOptions(), explain=False), most=2)
    a, b = cache.program(standing(3)), cache.program(standing(4))
    assert cache.program(standing(3)) is a  # now b is the one used longest ago
    cache.program(standing(5))
    assert cache.program(standing(3)) is a
    assert cache.program(standing(4)) is not b
