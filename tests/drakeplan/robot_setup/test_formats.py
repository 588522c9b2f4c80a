"""An SDF and an MJCF model are described as a URDF is."""

from __future__ import annotations

import numpy as np
import pytest

from drakeplan.robot_setup.describe import describe_robot
from drakeplan.robot_setup.description import Description
from drakeplan.robot_setup.model_source import find_model_source
from drakeplan.robot_setup.robot_file import write_robot_file
from scenes.robots.nominal_stance import check_nominal_stance
from scenes.robots.robot import Robot, load_robot

HALF = (0.1, 0.045)  # [m] half length and half width of the soles
CENTRE = (0.02, 0.0, -0.06)  # [m] of the sole in the foot

LEG = (  # part, its origin in the part above, axis, lower and upper limit, mass, box and its centre
    ("hip_roll", (0.0, 0.09, -0.05), (1, 0, 0), -0.6, 0.6, 1.5, None, (0, 0, 0)),
    ("hip_yaw", (0.0, 0.0, 0.0), (0, 0, 1), -0.8, 0.8, 1.5, None, (0, 0, 0)),
    ("thigh", (0.0, 0.0, 0.0), (0, 1, 0), -1.9, 0.8, 4.0, (0.08, 0.08, 0.24), (0, 0, -0.18)),
    ("shin", (0.0, 0.0, -0.36), (0, 1, 0), 0.0, 2.2, 2.5, (0.07, 0.07, 0.22), (0, 0, -0.18)),
    ("ankle", (0.0, 0.0, -0.36), (0, 1, 0), -1.2, 0.9, 0.4, None, (0, 0, 0)),
    ("foot", (0.0, 0.0, 0.0), (1, 0, 0), -0.5, 0.5, 1.0, (2 * HALF[0], 2 * HALF[1], 0.03), (0.02, 0, -0.045)),
)
TRUNK = ("trunk", 25.0, (0.16, 0.24, 0.5), (0.0, 0.0, 0.25))
HIP_HEIGHT = 0.36 + 0.36 + 0.06  # [m] over the sole with straight knees


def words(values: tuple[float, ...]) -> str:
    return " ".join(f"{v:g}" for v in values)


def sdf() -> str:
    """Every link's pose is given in the model, every joint's axis in its child, as in files of Gazebo."""

    def link(name: str, at: np.ndarray, mass: float, box: tuple | None, centre: tuple) -> str:
        shape = f"<geometry><box><size>{words(box)}</size></box></geometry>" if box else ""
        pose = f"<pose>{words(centre)} 0 0 0</pose>"
        return (
            f'<link name="{name}"><pose>{words(tuple(at))} 0 0 0</pose><inertial>{pose}<mass>{mass}</mass><inertia><ixx>0.02</ixx>'
            "<iyy>0.02</iyy><izz>0.02</izz></inertia></inertial>"
            + (f'<collision name="c">{pose}{shape}</collision>' if box else "")
            + "</link>"
        )

    up = np.array([0.0, 0.0, HIP_HEIGHT + 0.05])
    parts = [link(TRUNK[0], up, *TRUNK[1:])]
    for side, y in (("left", 1.0), ("right", -1.0)):
        above, at = TRUNK[0], up
        for part, origin, axis, low, high, mass, box, centre in LEG:
            at = at + np.array(origin) * [1, y, 1]
            name = f"{side}_{part}"
            parts.append(link(name, at, mass, box, centre))
            parts.append(
                f'<joint name="{name}_joint" type="revolute"><parent>{above}</parent><child>{name}</child><axis><xyz>{words(axis)}'
                f"</xyz><limit><lower>{low}</lower><upper>{high}</upper><effort>90</effort><velocity>9</velocity></limit></axis></joint>"
            )
            above = name
    return f'<?xml version="1.0"?><sdf version="1.9"><model name="walker">{"".join(parts)}</model></sdf>'


def mjcf() -> str:
    """Bodies in bodies, angles in degrees, a motor for each joint, as in files of MuJoCo."""

    def leg(side: str, y: float, k: int = 0) -> str:
        if k == len(LEG):
            return ""
        part, origin, axis, low, high, mass, box, centre = LEG[k]
        place = words(tuple(np.array(origin) * [1, y, 1]))
        shape = (
            f'<geom type="box" size="{words(tuple(0.5 * np.array(box)))}" pos="{words(centre)}" mass="{mass}"/>'
            if box
            else ""
        )
        inertia = "" if box else f'<inertial pos="0 0 0" mass="{mass}" diaginertia="0.02 0.02 0.02"/>'
        limits = f"{np.degrees(low):.4f} {np.degrees(high):.4f}"
        return (
            f'<body name="{side}_{part}" pos="{place}">{inertia}<joint name="{side}_{part}_joint" axis="{words(axis)}" '
            f'range="{limits}"/>{shape}{leg(side, y, k + 1)}</body>'
        )

    name, mass, box, centre = TRUNK
    motors = "".join(
        f'<motor joint="{s}_{part[0]}_joint" ctrlrange="-90 90"/>' for s in ("left", "right") for part in LEG
    )
    return (
        f'<mujoco model="walker"><compiler angle="degree" autolimits="true"/><worldbody><body name="{name}" pos="0 0 1"><freejoint/>'
        f'<geom type="box" size="{words(tuple(0.5 * np.array(box)))}" pos="{words(centre)}" mass="{mass}"/>'
        f"{leg('left', 1.0)}{leg('right', -1.0)}</body></worldbody><actuator>{motors}</actuator></mujoco>"
    )


MODELS = {"walker.sdf": sdf, "walker.xml": mjcf}


@pytest.fixture(scope="module")
def walkers(tmp_path_factory) -> dict[str, tuple[Description, Robot]]:
    walkers = {}
    for file, text in MODELS.items():
        folder = tmp_path_factory.mktemp("formats")
        (folder / file).write_text(text())
        found = describe_robot(find_model_source(str(folder / file), {}), "walker")
        write_robot_file(found, folder / "walker.yaml")
        walkers[file] = found, load_robot(folder / "walker.yaml")
    return walkers


@pytest.mark.parametrize("file", MODELS)
def test_its_parts_are_found(walkers, file: str) -> None:
    found, robot = walkers[file]
    assert found.base == "trunk" and found.limbs.feet == ("left_foot", "right_foot") and found.limbs.hands is None
    assert robot.mass == pytest.approx(25.0 + 2 * sum(part[5] for part in LEG), rel=1e-6)
    assert robot.palms == ()
    np.testing.assert_allclose(robot.half_extents[:2], [HALF, HALF], atol=1e-3)
    for sole in found.soles:
        np.testing.assert_allclose(sole.X_BE[:3, 3], CENTRE, atol=1e-3)


@pytest.mark.parametrize("file", MODELS)
def test_it_stands_and_its_leg_is_as_long_as_its_links(walkers, file: str) -> None:
    _, robot = walkers[file]
    check_nominal_stance(robot)
    assert robot.leg_reach[1] == pytest.approx(np.hypot(HIP_HEIGHT, CENTRE[0]), rel=0.03)
    np.testing.assert_allclose(robot.hip[1], 0.09, atol=2e-3)
    assert robot.foot_separation[1] == pytest.approx(0.18, abs=2e-3)
    assert {n.removesuffix("_joint").partition("_")[2] for n in robot.nominal} >= {"thigh", "shin", "ankle"}


def test_both_formats_are_the_same_robot(walkers) -> None:
    (a, _), (b, _) = walkers.values()
    assert a.standing.angles == pytest.approx(b.standing.angles, abs=2e-3)
    for key in ("hip", "leg_reach", "com_height", "torso_size", "foot_separation"):
        np.testing.assert_allclose(getattr(a.figures, key), getattr(b.figures, key), atol=2e-3)
