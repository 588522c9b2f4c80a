"""The campaign that collects verified whole-body motions on random terrain: what people who train tracking policies read.

A task is one draw of a terrain, whose kind goes round with the task's number, and one query in it with quasi-static dynamics and a
budget of expansions. The row is the motion with its contacts and forces at a fixed rate. A task without a verified motion has a
row that says why.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
import pyarrow as pa

from drakeplan.campaigns.campaign import Row
from drakeplan.campaigns.campaign_robot import campaign_robot
from drakeplan.plan.plan import Plan
from drakeplan.query.options import PlanOptions
from drakeplan.query.planning import plan_scene
from scenes.files.scene_writer import scene_to_yaml
from scenes.input_error import InputError
from scenes.library.motion_terrains import KINDS, draw_terrain

if TYPE_CHECKING:
    from drakeplan.campaigns.card import Card

NO_CLOCK = 300.0  # [s] deadline of a query that a budget of expansions ends
EXPANSIONS = 250  # of each search
RATE = 50.0  # [Hz] of the rows' samples
WORDS = 200  # characters of a reason
TABLE = pa.list_(pa.list_(pa.float32()))


def _field(name: str, kind: pa.DataType, unit: str, nullable: bool = False) -> pa.Field:
    return pa.field(name, kind, nullable=nullable, metadata={"unit": unit})


SCHEMA = pa.schema(
    [
        _field("task", pa.int64(), "number of the task"),
        _field("scene", pa.string(), "kind of terrain"),
        _field("status", pa.string(), "complete: verified; else contacts or none"),
        _field("reason", pa.string(), "why there is no verified motion; empty where there is one"),
        _field("scene_yaml", pa.string(), "the scene as planned, a drakeplan scene file"),
        _field("duration", pa.float64(), "s"),
        _field("palms", pa.bool_(), "whether a palm is used"),
        _field("base_position", TABLE, "m, (T, 3) in W"),
        _field("base_quaternion", TABLE, "(T, 4) w x y z, of the base in W"),
        _field("joints", TABLE, "rad, (T, J) in the order of joint_names of the card's parameters"),
        _field("joint_velocities", TABLE, "rad/s, (T, J) likewise"),
        _field("com", TABLE, "m, (T, 3) in W"),
        _field("forces", TABLE, "N, (T, 12) on the robot in W: left foot, right foot, left palm, right palm"),
        _field("contacts", pa.list_(pa.list_(pa.int16())), "(T, 4) row of contact_poses that carries, -1: none"),
        _field("contact_poses", TABLE, "(C, 7) position [m] and quaternion w x y z of each contact frame in W"),
        _field("contact_effectors", pa.list_(pa.int8()), "(C,) 0 left foot, 1 right foot, 2 left palm, 3 right palm"),
    ]
)


@dataclass(frozen=True)
class MotionsCampaign:
    """Motions of one robot.

    Attributes:
        robot: its name.
        friction: of every surface.
        packages: names and folders of package:// addresses in the robot's model.
    """

    robot: str = "escher"
    friction: float = 0.5
    packages: tuple[tuple[str, str], ...] = ()

    @property
    def name(self) -> str:
        return "motions"

    @property
    def version(self) -> int:
        return 1

    @property
    def schema(self) -> pa.Schema:
        return SCHEMA

    @property
    def count_by(self) -> Sequence[str]:
        return ("scene", "status")

    @property
    def parameters(self) -> Mapping[str, Any]:
        """The robot with its model and joints, the rate, and what is asked of the search."""
        from scenes.robots.plant import build_plant

        robot = campaign_robot(self.robot, self.packages)
        plant = build_plant(robot).plant
        names = [plant.get_joint(i).name() for i in plant.GetJointIndices() if plant.get_joint(i).num_positions() == 1]
        names.sort(key=lambda name: plant.GetJointByName(name).position_start())
        return {
            "robot": robot.name,
            "robot_model_sha256": robot.model_sha256,
            "joint_names": names,
            "rate_hz": RATE,
            "friction": self.friction,
            "expansions": EXPANSIONS,
            "kinds": list(KINDS),
        }

    def rows(self, seed: np.random.SeedSequence, task: int) -> Sequence[Row]:
        """The motion of one draw, or why there is none.

        Args:
            seed: of the task's random numbers.
            task: its number in the campaign.
        """
        robot = campaign_robot(self.robot, self.packages)
        kind = KINDS[task % len(KINDS)]
        scene = draw_terrain(np.random.default_rng(seed), kind, robot.max_step_height)
        scene = dataclasses.replace(scene, name=f"{kind}_{task}")
        options = PlanOptions(
            dynamics="quasi-static", friction=self.friction, expansions=EXPANSIONS, deadline=NO_CLOCK, seed=task
        )
        try:
            result = plan_scene(scene, robot, options)
        except InputError as error:  # no ground at the start
            return [_nothing(task, kind, "none", str(error), scene_to_yaml(scene))]
        plan = result.plan
        if result.status != "complete" or plan is None or plan.motion is None:
            return [_nothing(task, kind, result.status, result.reason, scene_to_yaml(scene))]
        return [{**_nothing(task, kind, "complete", "", plan.scene_yaml), **motion_columns(plan)}]


def _nothing(task: int, kind: str, status: str, reason: str, yaml: str) -> dict[str, Any]:
    words = {"task": task, "scene": kind, "status": status, "reason": reason[:WORDS], "scene_yaml": yaml}
    tables = {field.name: [] for field in SCHEMA if pa.types.is_list(field.type)}
    return {**words, "duration": 0.0, "palms": False, **tables}


def motion_columns(plan: Plan) -> dict[str, Any]:
    """The columns of a row that a complete plan fills.

    Args:
        plan: with a motion.
    """
    from scipy.spatial.transform import Rotation

    assert plan.motion is not None
    assert plan.phases is not None
    begin, end = float(plan.motion.t[0]), float(plan.motion.t[-1])
    times = begin + np.arange(int((end - begin) * RATE + 1e-9) + 1) / RATE
    states = [plan.at(float(t - begin)) for t in times]
    q, v = np.array([s.q for s in states]), np.array([s.v for s in states])
    poses = plan.contacts.X_WC
    quaternions = Rotation.from_matrix(poses[:, :3, :3]).as_quat(scalar_first=True) if len(poses) else np.zeros((0, 4))
    phase = np.minimum(np.searchsorted(plan.phases.end, times, side="right"), len(plan.phases) - 1)
    held = plan.phases.contact[phase].astype(np.int16)
    return {
        "duration": end - begin,
        "palms": bool((plan.contacts.effector > 1).any()),
        "base_position": _table(q[:, 4:7]),
        "base_quaternion": _table(q[:, :4]),
        "joints": _table(q[:, 7:]),
        "joint_velocities": _table(v[:, 6:]),
        "com": _table(np.array([s.com for s in states])),
        "forces": _table(np.array([s.forces for s in states]).reshape(len(states), -1)),
        "contacts": held.tolist(),
        "contact_poses": _table(np.column_stack([poses[:, :3, 3], quaternions])),
        "contact_effectors": plan.contacts.effector.astype(np.int8).tolist(),
    }


def _table(values: np.ndarray) -> list[list[float]]:
    return values.astype(np.float32).tolist()


def counts_text(card: Card) -> str:
    """A line for each kind of terrain: how many motions were verified.

    Args:
        card: of the data.
    """
    lines = []
    for kind in KINDS:
        rows = {c["status"]: c["rows"] for c in card.counts if c["scene"] == kind}
        if rows:
            lines.append(f"{kind:<16} {rows.get('complete', 0):5d} of {sum(rows.values()):5d} verified")
    return "\n".join(lines)
