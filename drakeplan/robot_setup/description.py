"""What was found of a robot: the parts of its robot file, before they are written."""

from __future__ import annotations

from dataclasses import dataclass, field

from drakeplan.robot_setup.figures import Figures
from drakeplan.robot_setup.limbs import Limbs
from drakeplan.robot_setup.model_source import FoundModel
from drakeplan.robot_setup.palms import Palm
from drakeplan.robot_setup.soles import Sole
from drakeplan.robot_setup.standing import Standing
from scenes.robots.schema import ModelChanges


@dataclass(eq=False)
class Description:
    """What was found of a robot.

    Attributes:
        found: the model.
        name: of the robot.
        base: body that floats.
        changes: frames, welds and collision pairs that the model needs.
        limbs: feet, hands and torso.
        soles: of both feet.
        palms: of both hands; None for a robot without.
        standing: the nominal posture.
        figures: reaches and limits.
        mass: [kg].
        notes: what a user should know, a line each.
        origin: key of the robot file -> where its value comes from.
    """

    found: FoundModel
    name: str
    base: str
    changes: ModelChanges
    limbs: Limbs
    soles: tuple[Sole, Sole]
    palms: tuple[Palm, Palm] | None
    standing: Standing
    figures: Figures | None = None
    mass: float = 0.0
    notes: list[str] = field(default_factory=list)
    origin: dict[str, str] = field(default_factory=dict)
