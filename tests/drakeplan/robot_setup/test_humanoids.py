"""The same robot in many spellings is one robot, and it stands."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
import shapely
from humanoids import ARM, AXES, FEET, FOOT_HALF, NAMINGS, ROOTS, SOLE_CENTRE, SPHERE, Humanoid, cut_outline, variant
from hypothesis import Phase, given, settings
from hypothesis import strategies as st

from drakeplan.robot_setup.describe import describe_robot
from drakeplan.robot_setup.model_source import find_model_source
from scenes.robots.nominal_stance import check_nominal_stance
from scenes.robots.plant import build_plant, nominal_posture

LEGS = ("hip_yaw", "hip_roll", "hip_pitch", "knee", "ankle_pitch", "ankle_roll")
LENGTHS = (
    "shoulder",
    "hip",
    "arm_reach",
    "leg_reach",
    "com_height",
    "com_reach",
    "torso_centre",
    "torso_size",
    "foot_separation",
)
SAME = 2e-3  # [m, rad] between spellings: the file's figures are rounded to 1 mm, its angles to 1 mrad
LEVEL, TILT = 1e-3, 3e-3  # [m], [rad] of soles that stand
MIRRORED = 2e-3  # [m] between a link and the mirror image of the other side's
USUAL = Humanoid()
SPELLINGS = [
    variant(naming="l_hip", root="world fixed"),
    variant(naming="hip_L", axes="y up"),
    variant(naming="LHip", axes="x up", root="massless"),
    variant(naming="LEFT_HIP", axes="backwards", root="world floating"),
    variant(naming="hip_left", feet_by_name=True, drawn_only=True),
    variant(axes="left"),
    variant(axes="y up, z ahead"),
]
SHAPES = [
    variant(arm_joints=0),
    variant(arm_joints=4, waist=False),
    variant(arm_joints=7, fingers=3, mimic=True),
    variant(arm_joints=5, toes=True, naming="LeftHip"),
    variant(foot="four spheres", head=False),
    variant(foot="cut corners", axes="backwards"),
    variant(offsets=True),
    variant(continuous=True),
    variant(scale=0.4),
    variant(scale=1.3, naming="leg_left_hip"),
]


def joints(humanoid: Humanoid) -> dict[str, str]:
    """Name of each joint of the limbs -> what it is called in the usual humanoid."""
    parts = [f"{p}_joint" for p in (*LEGS, *ARM)]
    return {humanoid.sided(s, p): USUAL.sided(s, p) for s in ("left", "right") for p in parts}


# ---- one robot, many spellings


@pytest.mark.parametrize("humanoid", SPELLINGS, ids=str)
def test_the_description_does_not_depend_on_how_a_model_is_written(described, humanoid) -> None:
    mine, usual = described(humanoid), described(USUAL)
    for key in LENGTHS:
        np.testing.assert_allclose(
            getattr(mine.description.figures, key), getattr(usual.description.figures, key), atol=SAME, err_msg=key
        )
    assert mine.robot.mass == pytest.approx(usual.robot.mass)
    translated = {joints(humanoid)[k]: v for k, v in mine.robot.nominal.items()}
    assert set(translated) == set(usual.robot.nominal)
    for joint, angle in usual.robot.nominal.items():
        assert translated[joint] == pytest.approx(angle, abs=SAME), joint
    np.testing.assert_allclose(nominal_posture(mine.robot)[4:7], nominal_posture(usual.robot)[4:7], atol=SAME)
    np.testing.assert_allclose(abs(nominal_posture(mine.robot)[0]), 1.0, atol=1e-6)  # the base faces ahead


def test_feet_that_are_named_stand_on_the_ground_whatever_axis_is_up(described) -> None:
    model = described(SPELLINGS[1]).file.parent / "toy.urdf"
    links = {"left_foot": "foot_L", "right_foot": "foot_R"}
    named = describe_robot(find_model_source(str(model), {}), "toy", links)
    assert named.standing.angles == described(SPELLINGS[1]).description.standing.angles
    assert named.limbs.origin["left_foot"] == "named by you"


@pytest.mark.parametrize("scale", [0.4, 1.3])
def test_lengths_grow_with_the_model(described, scale) -> None:
    shape = {s.scale: s for s in SHAPES}[scale]
    mine, usual = (described(h).description.figures for h in (shape, USUAL))
    for key in ("arm_reach", "leg_reach", "com_height", "torso_size", "com_reach"):
        np.testing.assert_allclose(
            getattr(mine, key), scale * np.array(getattr(usual, key)), rtol=0.03, atol=5e-3, err_msg=key
        )
    for key in ("hip", "shoulder"):  # how far they are behind the soles depends on the arms
        np.testing.assert_allclose(getattr(mine, key)[1:], scale * np.array(getattr(usual, key))[1:], atol=5e-3)
    assert mine.foot_separation[1] == pytest.approx(scale * usual.foot_separation[1], abs=2e-3)
    for key in ("max_foot_translation", "max_step_height"):  # rounded to 5 cm and 1 cm
        assert getattr(mine, key) == pytest.approx(scale * getattr(usual, key), abs=0.05)


# ---- soles


@pytest.mark.parametrize("humanoid", [USUAL, *SPELLINGS[1:4], *SHAPES[3:4], *SHAPES[8:]], ids=str)
def test_the_sole_of_a_box_is_the_bottom_of_the_box(described, humanoid) -> None:
    found = described(humanoid)
    R_MF = AXES[humanoid.axes].T
    for sole in found.description.soles:
        np.testing.assert_allclose(sole.half_extent, humanoid.scale * np.array(FOOT_HALF), atol=1e-3)
        np.testing.assert_allclose(sole.X_BE[:3, 3], R_MF @ (humanoid.scale * SOLE_CENTRE), atol=1e-3)
        np.testing.assert_allclose(sole.X_BE[:3, :3], R_MF, atol=3e-3)
        assert sole.overhang == (0.0, 0.0, 0.0)
    np.testing.assert_allclose(
        found.robot.half_extents[:2], np.tile(humanoid.scale * np.array(FOOT_HALF), (2, 1)), atol=1e-3
    )


def test_four_spheres_carry_the_rectangle_between_them(described) -> None:
    sole = described(SHAPES[4]).description.soles[0]
    between = np.array(FOOT_HALF) - SPHERE
    assert (sole.half_extent >= between - 1e-3).all() and (sole.half_extent <= between + SPHERE).all()
    np.testing.assert_allclose(sole.X_BE[:3, 3], SOLE_CENTRE, atol=1e-3)


def test_a_sole_with_cut_corners_carries_a_rectangle_inside_it_and_hangs_over_beyond(described) -> None:
    sole = described(SHAPES[5]).description.soles[0]
    outline = shapely.Polygon(cut_outline())
    rectangle = shapely.box(*-np.array(sole.half_extent), *sole.half_extent)
    assert outline.buffer(1.5e-3).contains(rectangle)
    widths = np.linspace(0.0, FOOT_HALF[0], 400)  # the slow twin: half lengths, each with the greatest half width there
    best = max(4 * x * min(FOOT_HALF[1], FOOT_HALF[0] + FOOT_HALF[1] - 0.03 - x) for x in widths)
    assert rectangle.area > 0.95 * best
    np.testing.assert_allclose(np.array(sole.overhang[:2]) + sole.half_extent[0], FOOT_HALF[0], atol=1.5e-3)


# ---- standing


def stands(found) -> None:
    """What holds for every robot that was described."""
    robot, h = found.robot, found.humanoid
    check_nominal_stance(robot)
    robot_plant, q = build_plant(robot), nominal_posture(robot)
    plant = robot_plant.plant
    context = plant.CreateDefaultContext()
    plant.SetPositions(context, q)
    assert (q[7:] >= plant.GetPositionLowerLimits()[7:] - 1e-9).all()
    assert (q[7:] <= plant.GetPositionUpperLimits()[7:] + 1e-9).all()
    outlines = []
    for body, half in zip(robot_plant.effector_bodies[:2], robot.half_extents[:2], strict=True):
        X_WE = plant.EvalBodyPoseInWorld(context, body).GetAsMatrix4()
        assert abs(X_WE[2, 3]) < LEVEL
        assert np.hypot(X_WE[0, 2], X_WE[1, 2]) < TILT
        corners = np.array([[1, 1], [-1, 1], [-1, -1], [1, -1]]) * half
        outlines.append(shapely.Polygon(X_WE[:2, 3] + corners @ X_WE[:2, :2].T))
    com = plant.CalcCenterOfMassPositionInWorld(context)
    assert shapely.union_all(outlines).convex_hull.contains(shapely.Point(com[:2]))
    assert abs(com[0]) < 0.5 * robot.half_extents[0, 0]  # well inside, for it is to step from there
    np.testing.assert_allclose(com[2], robot.com_height[1], atol=2e-3)
    for part in ("thigh", "shin", *(("upper_arm", "forearm") if h.arm_joints else ())):
        left, right = (
            plant.EvalBodyPoseInWorld(context, plant.GetBodyByName(h.sided(s, part))).translation()
            for s in ("left", "right")
        )
        np.testing.assert_allclose(left * [1, -1, 1], right, atol=MIRRORED, err_msg=part)
    knee, hip, ankle = (
        plant.EvalBodyPoseInWorld(context, plant.GetBodyByName(h.sided("left", p))).translation()
        for p in ("shin", "thigh", "ankle")
    )
    assert knee[0] > 0.5 * (hip[0] + ankle[0])  # knees bend forward
    assert robot.leg_reach[0] < hip[2] < robot.leg_reach[1]
    assert bool(robot.palms) == bool(h.arm_joints)


@pytest.mark.parametrize("humanoid", [USUAL, *SHAPES], ids=str)
def test_the_nominal_posture_stands(described, humanoid) -> None:
    stands(described(humanoid))


def test_a_fist_of_boxes_carries_its_palm(described) -> None:
    stands(described(variant(arm_joints=5, fingers=2)))


@pytest.mark.slow
@settings(max_examples=9, phases=[Phase.generate])  # to shrink what fails would take minutes
@given(
    st.builds(
        Humanoid,
        naming=st.sampled_from(list(NAMINGS)),
        axes=st.sampled_from(["ahead", "backwards", "y up", "x up"]),
        root=st.sampled_from(ROOTS),
        arm_joints=st.sampled_from([0, 4, 5, 6, 7]),
        waist=st.booleans(),
        head=st.booleans(),
        fingers=st.integers(0, 3),
        toes=st.booleans(),
        foot=st.sampled_from(FEET),
        feet_by_name=st.booleans(),
        offsets=st.booleans(),
        continuous=st.booleans(),
        mimic=st.booleans(),
        drawn_only=st.booleans(),
        scale=st.floats(0.4, 1.3),
    )
)
def test_any_of_them_stands(described: Callable, humanoid: Humanoid) -> None:
    stands(described(humanoid))
