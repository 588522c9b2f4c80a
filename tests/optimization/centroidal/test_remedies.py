"""The infeasibility report against closed forms: what it says is needed is what physics needs."""

from dataclasses import replace

import numpy as np
import pytest

from optimization.centroidal.contact_schedule import ContactSchedule
from optimization.centroidal.options import CentroidalOptions
from optimization.centroidal.problem import CentroidalProblem
from optimization.centroidal.program import CentroidalProgram
from optimization.centroidal.remedies import unblock
from scenes.contact import Contact, contact_pose
from scenes.effector import EFFECTORS

MASS, G = 76.0, 9.81
HALF = np.array([[0.11, 0.05], [0.11, 0.05], [0.05, 0.05], [0.05, 0.05]])
FREE = (np.inf, np.inf, np.inf)
GRID = 1e-3  # what the report resolves of friction, reach and height
STEEP = np.deg2rad(20)


def contact(effector, point, normal=(0.0, 0.0, 1.0), mu=0.5):
    normal = np.asarray(normal, float) / np.linalg.norm(normal)
    pose = contact_pose(EFFECTORS[effector], np.array(point, float), normal, 0.0)
    return Contact(EFFECTORS[effector], 0, pose, mu, 0.0)


def feet(mu=0.5, normal=(0.0, 0.0, 1.0)):
    return contact(0, [0, 0.1, 0], normal, mu), contact(1, [0, -0.1, 0], normal, mu)


def standing(intervals=5, dt=0.1, **more):
    return ContactSchedule.from_rows([(*feet(**more), None, None)] * intervals, dt)


def problem(schedule, com=(0.0, 0.0, 0.9), **more):
    return CentroidalProblem(schedule, MASS, HALF, np.array(com, float), **more)


def options(**changes):
    return replace(CentroidalOptions(), **changes)


def needed(report, *words):
    """The value that the report asks of the number whose description holds all these words, by itself."""
    found = [
        remedy.changes[0].needed
        for remedy in report.remedies
        if len(remedy.changes) == 1 and all(word in remedy.changes[0].what for word in words)
    ]
    assert len(found) == 1, str(report)
    return found[0]


@pytest.mark.parametrize(
    ("cone", "factor"), [("inner", 1.0), ("square", np.sqrt(2)), ("second_order", 1.0), ("diamond", 1 / np.sqrt(2))]
)
def test_a_slope_needs_the_friction_at_which_the_cone_holds_the_vertical(cone, factor):
    normal = [np.sin(STEEP), 0, np.cos(STEEP)]
    row = (contact(0, [0, 0, 0], normal, 0.1), None, None, None)
    report = unblock(problem(ContactSchedule.from_rows([row] * 4, 0.1)), options(cone=cone, solver="clarabel"))
    assert not report.feasible
    assert report.blockages[0].block == "friction cone"
    assert report.blockages[0].effector == "left_foot"
    assert needed(report, "friction", "left_foot") == pytest.approx(factor * np.tan(STEEP), abs=2 * GRID)


def test_a_com_that_is_7_cm_out_of_reach_needs_7_cm():
    distance = np.hypot(0.9, 0.1)
    schedule = standing()
    course = np.tile([0.0, 0.0, 0.9], (schedule.num_knots, 1))
    data = problem(schedule, com_reference=course, com_box=np.zeros_like(course))
    report = unblock(data, options(com_reach=(distance - 0.07, distance - 0.07, 1.0, 1.0)))
    worst = report.blockages[0]
    assert worst.block == "reach"
    assert worst.amount == pytest.approx(0.07, abs=1e-3)
    assert worst.unit == "m"
    assert needed(report, "reach", "left_foot and right_foot") == pytest.approx(distance, abs=GRID + 1e-4)
    # or a CoM so much lower that the legs reach it
    lower = 0.9 - np.sqrt((distance - 0.07) ** 2 - 0.1**2)
    assert needed(report, "half width of the CoM box") == pytest.approx(lower, abs=GRID + 1e-4)


def test_a_height_that_legs_do_not_allow_is_given_up_or_the_legs_grow():
    top = 0.93
    reach = np.hypot(top, 0.1)
    report = unblock(
        problem(standing(8), com=(0.0, 0.0, 0.92)),
        options(com_height=(0.95, 0.95, 1.1), com_reach=(reach, reach, 1.0, 1.0), angular_momentum_limit=FREE),
    )
    assert not report.feasible
    assert needed(report, "least CoM height") == pytest.approx(top, abs=GRID + 1e-4)
    assert needed(report, "reach", "left_foot and right_foot") == pytest.approx(np.hypot(0.95, 0.1), abs=GRID + 1e-4)


def ledges(mu=0.8):
    """Two palms on level ledges; the CoM hangs below the middle between them."""
    return contact(2, [0, 0.2, 0], mu=mu), contact(3, [0, -0.2, 0], mu=mu)


def test_a_fall_between_two_holds_may_last_only_until_the_arms_are_too_short():
    """One interval without contact from rest: the CoM drops by g T^2 before the palms take hold."""
    distance, reach, T = 0.5, 0.9, 0.25
    below = -np.sqrt(distance**2 - 0.2**2)
    schedule = ContactSchedule.from_rows([(None,) * 4, *[(None, None, *ledges())] * 3], np.array([T, 0.1, 0.1, 0.1]))
    report = unblock(
        problem(schedule, com=(0, 0, below)),
        options(com_reach=(1.0, 1.0, reach, reach), force_limit=(9.0,) * 4, rest_at_end=False, final_half_width=None),
    )
    assert not report.feasible
    assert report.flight == ""  # one interval alone: between knots nothing is asked of the height
    room = np.sqrt(reach**2 - 0.2**2) + below  # [m] that the CoM may drop
    assert room < G * T**2
    assert needed(report, "duration of phase 0", "no contact") == pytest.approx(np.sqrt(room / G), abs=0.006)
    longer = np.hypot(G * T**2 - below, 0.2)
    assert needed(report, "reach", "left_palm and right_palm") == pytest.approx(longer, abs=2e-3)


def test_a_fall_is_stopped_by_more_force_or_in_more_time():
    """From v0 downwards to rest at the last two of N knots: v0 = (N - 1) dt (F - 1) g."""
    v0, limit, N, dt = 1.2, 1.3, 6, 0.05
    schedule = standing(N, dt)
    data = problem(schedule, com=(0, 0, 1.0), initial_linear_momentum=np.array([0, 0, -MASS * v0]))
    report = unblock(
        data,
        options(
            force_limit=(limit / 2, limit / 2, 1, 1),
            com_height=(0.2, 0.9, 1.2),
            final_half_width=None,
            angular_momentum_limit=FREE,
            angular_momentum_rate_limit=FREE,
        ),
    )
    force = 1 + v0 / ((N - 1) * dt * G)
    assert needed(report, "force limit", "left_foot and right_foot") == pytest.approx(force / 2, abs=0.006)
    assert needed(report, "duration of phase 0") == pytest.approx(v0 * N / ((N - 1) * (limit - 1) * G), abs=0.006)


def test_the_steep_stone_in_a_walk_is_named_and_its_friction_is_enough():
    normal = [np.sin(STEEP), 0, np.cos(STEEP)]
    left, right = contact(0, [0, 0.1, 0]), contact(1, [0, -0.1, 0])
    steep = contact(0, [0.2, 0.1, 0], normal, 0.12)
    ahead = contact(1, [0.3, -0.1, 0])
    rows = [(left, right)] * 4 + [(None, right)] * 4 + [(steep, right)] * 4 + [(steep, None)] * 5 + [(steep, ahead)] * 4
    schedule = ContactSchedule.from_rows([(*row, None, None) for row in rows], 0.2)
    course = np.linspace([0.0, 0.0, 0.9], [0.25, 0.0, 0.9], schedule.num_knots)
    data = problem(schedule, com_reference=course, com_box=np.full(course.shape, 0.1))
    report = unblock(data)
    worst = report.blockages[0]
    assert (worst.block, worst.effector, worst.phase, worst.contact) == ("friction cone", "left_foot", 3, 2)
    assert worst.held == ("left_foot",)
    assert (worst.start, worst.end) == pytest.approx((2.4, 3.4))
    line = str(report)
    assert "\n" not in line
    for word in ("friction cone of left_foot (contact 2)", "phase 3", "enough: ", "->"):
        assert word in line
    mu = needed(report, "friction of left_foot (contact 2)")
    assert 0.12 < mu <= np.tan(STEEP) + 2 * GRID  # less where the CoM may be slowed down in that phase

    others = [c for r in report.remedies for c in r.changes if c.kind == "friction" and "contact 2)" in c.what]
    assert others
    assert all(c.needed < mu for c in others if " and " in c.what)  # more contacts only where less is asked of each

    def stands(friction):
        contacts = tuple(replace(c, friction=friction) if c == steep else c for c in schedule.contacts)
        return CentroidalProgram(replace(data, schedule=replace(schedule, contacts=contacts))).solve().feasible

    assert stands(mu)
    assert not stands(mu - 3 * GRID)


def test_two_things_that_are_wrong_at_once_are_both_named():
    normal = [np.sin(STEEP), 0, np.cos(STEEP)]
    row = (contact(0, [0, 0, 0], normal, 0.2), None, None, None)
    report = unblock(
        problem(ContactSchedule.from_rows([row] * 4, 0.1)), options(force_limit=(0.5, 1.0, 1.0, 1.0), solver="clarabel")
    )
    (remedy,) = report.remedies
    wanted = {change.kind: change.needed for change in remedy.changes}
    assert set(wanted) == {"friction", "force"}
    assert wanted["friction"] == pytest.approx(np.tan(STEEP), abs=0.01)
    assert wanted["force"] == pytest.approx(np.cos(STEEP), abs=0.01)
    assert remedy.cost < np.inf


def test_what_is_feasible_needs_nothing():
    report = unblock(problem(standing()))
    assert report.feasible
    assert not report.blockages
    assert not report.remedies
    assert str(report) == "feasible as it is"


def test_limits_are_kept_and_told():
    data = problem(standing(mu=0.2, normal=[np.sin(STEEP), 0, np.cos(STEEP)]))
    report = unblock(data, most_solves=4)
    assert not report.complete
    assert report.solves <= 6  # a lever in hand may end its probe and its confirmation
    assert "stopped by a limit" in str(report)


def test_without_any_contact_nothing_helps():
    report = unblock(problem(ContactSchedule.from_rows([(None,) * 4] * 3, 0.1)))
    assert not report.feasible
    assert not report.remedies
    assert "no contact" in str(report)
    assert "no change that was tried is enough" in str(report)


def test_a_flight_that_is_too_long_to_survive_is_the_headline_and_a_shorter_one_is_enough():
    rows = [(*feet(), None, None)] * 4 + [(None,) * 4] * 14 + [(*feet(), None, None)] * 6
    data = problem(ContactSchedule.from_rows(rows, 0.1))
    limits = options(force_limit=(1.5, 1.5, 1.0, 1.0))
    report = unblock(data, limits)
    assert "phase 1 (0.40 to 1.80 s): without contact for 1.40 s" in str(report)
    shorter = needed(report, "duration of phase 1", "no contact")
    assert 0.3 < shorter < 1.3

    def lands(duration):
        dt = np.where(data.schedule.phases == 1, duration / 14, 0.1)
        return CentroidalProgram(replace(data, schedule=replace(data.schedule, dt=dt)), limits).solve().feasible

    assert lands(shorter)
    assert not lands(shorter + 0.02)
