"""Contacts are pressed gently at their first and last moments, where another foot carries."""

from __future__ import annotations

import numpy as np

from optimization.balance.reserve import ALL, Reserve
from optimization.centroidal.contact_schedule import ContactSchedule
from optimization.centroidal.force_limits import force_limits
from optimization.centroidal.options import CentroidalOptions
from scenes.contact import Contact, contact_pose

UP = np.array([0.0, 0.0, 1.0])


def contact(effector: str, x: float, y: float, normal: np.ndarray = UP) -> Contact:
    return Contact(effector, 0, contact_pose(effector, np.array([x, y, 0.0]), normal, 0.0), 0.5)


def test_a_foot_that_leaves_and_comes_down_is_light_beside_the_one_that_stays() -> None:
    left, right, ahead = (
        contact("left_foot", 0.0, 0.1),
        contact("right_foot", 0.0, -0.1),
        contact("left_foot", 0.2, 0.1),
    )
    rows = [(left, right, None, None)] * 3 + [(None, right, None, None)] * 2 + [(ahead, right, None, None)] * 3
    options = CentroidalOptions(reserve=Reserve(brief=0.1))
    limits = force_limits(ContactSchedule.from_rows(rows, 0.2), options)
    usual = np.array(options.force_limit)
    light = np.zeros(limits.shape, bool)
    light[[2, 5], 0] = True
    assert np.array_equal(limits, np.where(light, 0.1, usual))
    without = force_limits(ContactSchedule.from_rows(rows, 0.2), CentroidalOptions(reserve=ALL))
    assert np.array_equal(without, np.tile(usual, (len(rows), 1)))


def test_a_palm_is_light_while_a_foot_stays_and_a_foot_alone_never_is() -> None:
    left, right = contact("left_foot", 0.0, 0.1), contact("right_foot", 0.0, -0.1)
    palm = contact("left_palm", 0.2, 0.6, np.array([0.0, -1.0, 0.0]))
    options = CentroidalOptions(reserve=Reserve(brief=0.1))
    touching = [(left, right, None, None), (left, right, palm, None), (left, right, palm, None)]
    limits = force_limits(ContactSchedule.from_rows(touching, 0.2), options)
    assert limits[:, 2].tolist() == [options.force_limit[2], 0.1, options.force_limit[2]]
    hop = [(left, None, None, None), (None, right, None, None)]  # nobody else carries
    assert np.array_equal(
        force_limits(ContactSchedule.from_rows(hop, 0.2), options), np.tile(options.force_limit, (2, 1))
    )
