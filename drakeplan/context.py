"""What all steps of one query share; each part is computed once, on first use."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import Generic, TypeVar

from drakeplan.contact_planning.torso_grid import TorsoGrid
from drakeplan.deadline import Deadline
from optimization.balance.friction import DEFAULT_CONE, FrictionCone
from optimization.balance.reserve import ALL, Reserve
from optimization.inverse_kinematics.whole_body_ik import WholeBodyIK
from scenes.effector import EFFECTORS
from scenes.footholds.start_stance import check_goal, floor_notes, start_stance
from scenes.robots.plant import RobotPlant, build_plant
from scenes.robots.robot import Robot
from scenes.scene import Goal, Scene
from scenes.stance import Stance
from scenes.terrain.packed_terrain import PackedTerrain, pack_terrain

Made = TypeVar("Made")


class _MadeOnce(Generic[Made]):
    """A property that is made on first use, for a context and for those that differ in deadline or reserve alone."""

    def __init__(self, make: Callable[[QueryContext], Made]) -> None:
        self._make, self.__doc__ = make, make.__doc__

    def __get__(self, context: QueryContext, owner: type) -> Made:
        made, name = context.made, self._make.__name__
        if name not in made:
            made[name] = self._make(context)
        return made[name]  # type: ignore[return-value]


@dataclass(frozen=True, eq=False)
class QueryContext:
    """A scene and a robot with what is made of them once: every planner, motion and attempt of a query takes it from here.

    Attributes:
        scene: terrain, start and goal.
        robot: the robot that crosses the scene.
        ik: its inverse kinematics, with its kinematics and body capsules.
        cone: friction cone of the whole query.
        deadline: when the query has to stop.
        full_soles: whether all of every sole has to rest on something; else a part of it may (`Contact.support`).
        reserve: what is left unused of friction and supports.
        made: what was made on first use, by name; one for all contexts of a query.
    """

    scene: Scene
    robot: Robot
    ik: WholeBodyIK
    cone: FrictionCone = DEFAULT_CONE
    deadline: Deadline = field(default_factory=Deadline)
    full_soles: bool = False
    reserve: Reserve = ALL
    made: dict[str, object] = field(default_factory=dict, repr=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "cone", FrictionCone(self.cone))  # a name is taken too

    def until(self, deadline: Deadline) -> QueryContext:
        """The same context with another deadline.

        Args:
            deadline: the other one.
        """
        return replace(self, deadline=deadline)

    def keeping(self, reserve: Reserve) -> QueryContext:
        """The same context with another reserve of friction and supports."""
        return replace(self, reserve=reserve)

    @_MadeOnce
    def packed(self) -> PackedTerrain:
        """The terrain as arrays for compiled code."""
        return pack_terrain(self.scene.terrain)

    @_MadeOnce
    def robot_plant(self) -> RobotPlant:
        """Drake's plant of the robot alone."""
        return build_plant(self.robot)

    @_MadeOnce
    def usable_palms(self) -> tuple[int, ...]:
        """The robot's palms that may touch some surface: indices into `EFFECTORS`."""
        return tuple(e for e in self.robot.palms if self.scene.terrain.surfaces_for(EFFECTORS[e]))

    @_MadeOnce
    def start(self) -> Stance:
        """The first stance.

        Raises:
            InputError: the scene has no start, or no ground takes both soles there.
        """
        return start_stance(self.scene, self.packed, self.robot, self.full_soles)

    @_MadeOnce
    def goal(self) -> Goal:
        """The goal at the height of its floor.

        Raises:
            InputError: the scene has no goal, or no ground takes a sole near it.
        """
        return check_goal(self.scene, self.packed, self.robot, float(self.start.feet_mean()[2]), self.full_soles)

    @_MadeOnce
    def floor_notes(self) -> list[str]:
        """A line for each of start and goal that had several floors to choose from."""
        return floor_notes(self.scene, self.packed, self.robot, self.start, self.goal, self.full_soles)

    @_MadeOnce
    def torso_grid(self) -> TorsoGrid:
        """Distances of the torso to the goal; it grows on demand, and what has grown serves every attempt."""
        return TorsoGrid(self.packed, self.robot, self.goal)

    @_MadeOnce
    def scene_on_ground(self) -> Scene:
        """The scene with start and goal at the height of the ground that they were set down on."""
        start = self.scene.start
        if start is not None and not start.stance:
            start = replace(start, xyz=(start.xyz[0], start.xyz[1], float(self.start.feet_mean()[2])))
        return replace(self.scene, start=start, goal=self.goal)
