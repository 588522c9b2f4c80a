"""The wall for ground: frame G, in which the contact planner sees the wall as terrain and the palms as feet.

    x_G = x_W     y_G = z_W     z_G = -y_W        origin on the wall plane y = WALL_Y

Lin 2020 sec. 5.10: "We transform the ground to be the wall, and the mobile manipulator is viewed as walking on the wall."
"""

from __future__ import annotations

import hashlib
from pathlib import Path

import numpy as np

from scenes.effector import EFFECTORS
from scenes.library.braced_ramp import WALL_Y
from scenes.robots.bracer import make_bracer
from scenes.robots.bracer.make_bracer import PALM_RADIUS
from scenes.robots.robot import EffectorSpec, Robot
from scenes.terrain.surface import Surface
from scenes.terrain.terrain import Box, Terrain
from scenes.transition_model import TransitionModel

R_WG = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]])
P_WG = np.array([0.0, WALL_Y, 0.0])  # [m]
# [m] half edge of a square inside the round palm: what carries, as in the document
SQUARE = 0.99 * PALM_RADIUS / np.sqrt(2.0)
# [m] of the new palm ahead of and above the standing one, ibid.
STEPS = ((0.1, 0.2, 0.3, 0.4), (-0.2, -0.1, 0.0, 0.1, 0.2))
STEP_HEIGHT = 0.15  # [m] out of the wall between two contacts
MODEL = "bracer"
MODEL_FILE = Path(make_bracer.__file__).with_name("bracer.urdf")


def to_world(p_G: np.ndarray) -> np.ndarray:
    """(..., 3) points of G in W [m]."""
    return p_G @ R_WG.T + P_WG


def to_wall(p_W: np.ndarray) -> np.ndarray:
    """(..., 3) points of W in G [m]."""
    return (p_W - P_WG) @ R_WG


def wall_as_ground(terrain: Terrain) -> Terrain:
    """A wall's terrain, of surfaces and boxes, in frame G."""
    surfaces = tuple(Surface(s.name, to_wall(s.vertices), s.friction) for s in terrain.surfaces)
    boxes = []
    for box in terrain.obstacles:
        assert isinstance(box, Box), "only boxes stand before a wall"
        X_GO = np.eye(4)
        X_GO[:3, :3], X_GO[:3, 3] = R_WG.T @ box.X_WO[:3, :3], to_wall(box.X_WO[:3, 3])
        boxes.append(Box(box.name, box.size, X_GO))
    return Terrain(surfaces, tuple(boxes))


def transition_model_of_palms() -> TransitionModel:
    """The 20 steps of a palm on the wall; its heading stays 0, since palms are round."""
    ahead, above = (a.ravel() for a in np.meshgrid(*STEPS, indexing="ij"))
    return TransitionModel(MODEL, np.column_stack([ahead, above, np.zeros(len(ahead))]), np.zeros((0, 3)))


def robot_on_wall(mass: float) -> Robot:
    """What the contact planner needs to know, in frame G: two feet that are palms, and nothing that could be in the way.

    A palm takes the square about its disc of a surface; only the square inside it counts as support.

    Args:
        mass: of the robot [kg].
    """
    palm, none = (PALM_RADIUS, PALM_RADIUS), (0.0, 0.0)
    sizes = dict(zip(EFFECTORS, (palm, palm, none, none), strict=True))
    far = 10.0  # [m] legs of this length refuse nothing: reach is the arms', `drakeplan.bracing.bracing_check`
    return Robot(
        name="bracer",
        model=MODEL_FILE,
        model_sha256=hashlib.sha256(MODEL_FILE.read_bytes()).hexdigest(),
        mass=mass,
        effectors=tuple(EffectorSpec(name, name, size) for name, size in sizes.items()),
        base_body="base",
        torso_body="torso",
        nominal={},
        shoulder=np.zeros(3),
        hip=np.array([0.0, 0.1, 0.0]),
        arm_reach=(0.0, 0.0),
        leg_reach=(0.0, far),
        com_height=(0.1, 0.1, 0.1),
        torso_box_centre=np.array([0.0, 0.0, 1.0]),
        torso_box_size=np.full(3, 0.02),
        max_foot_translation=max(STEPS[0]) * 2.0,
        max_palm_translation=0.0,
        max_step_height=STEP_HEIGHT,
        foot_separation=(0.0, 0.2),
        force_limit=np.full(4, 1.0),
        com_reach=np.full(4, far),
    )
