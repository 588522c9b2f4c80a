"""The data of one centroidal problem: mass and patches, contacts over time, where it starts, what it tracks."""

from __future__ import annotations

from collections.abc import Hashable
from dataclasses import dataclass, field

import numpy as np

from optimization.centroidal.contact_schedule import ContactSchedule
from scenes.contact import support_corners
from scenes.effector import EFFECTORS
from scenes.input_error import InputError


@dataclass(frozen=True, eq=False)
class CentroidalProblem:
    """What a centroidal program is about; everything in SI and W.

    Attributes:
        schedule: contacts and knots (N).
        mass: M [kg].
        half_extent: (E, 2) half length (x) and half width (y) of each sole or palm patch [m]; what of it touches, the
            contacts say.
        initial_com: (3,) CoM at knot 0 [m].
        initial_linear_momentum: (3,) [kg m/s].
        initial_angular_momentum: (3,) about the CoM [N m s].
        com_reference: (N, 3) CoM to track softly (weight `com_tracking`), and the centre of `com_box`; or None [m].
        com_box: (N, 3) half widths of hard bounds around `com_reference`, inf where free; or None [m].
        angular_momentum_reference: (N, 3) angular momentum to track instead of zero; or None [N m s].
    """

    schedule: ContactSchedule
    mass: float
    half_extent: np.ndarray
    initial_com: np.ndarray
    initial_linear_momentum: np.ndarray = field(default_factory=lambda: np.zeros(3))
    initial_angular_momentum: np.ndarray = field(default_factory=lambda: np.zeros(3))
    com_reference: np.ndarray | None = None
    com_box: np.ndarray | None = None
    angular_momentum_reference: np.ndarray | None = None

    def __post_init__(self) -> None:
        if not (np.isfinite(self.mass) and self.mass > 0):
            raise InputError(f"centroidal problem: mass must be a finite number > 0 kg, got {self.mass}")
        shape = (self.schedule.num_knots, 3)
        self._array("half_extent", (len(EFFECTORS), 2))
        for name in ("initial_com", "initial_linear_momentum", "initial_angular_momentum"):
            self._array(name, (3,))
        self._array("com_reference", shape)
        self._array("com_box", shape, infinite=True)
        self._array("angular_momentum_reference", shape)
        if (self.half_extent < 0).any():
            raise InputError("centroidal problem: half_extent must not be negative")
        if self.com_box is not None and (self.com_reference is None or (self.com_box < 0).any()):
            raise InputError("centroidal problem: com_box needs a com_reference and half widths >= 0")
        for number, contact in enumerate(self.schedule.contacts):
            if not (np.isfinite(contact.friction) and contact.friction >= 0):
                held = np.flatnonzero((self.schedule.active == number).any(axis=1))
                where = f", held from {self.schedule.phase_name(int(held[0]))}" if len(held) else ""
                raise InputError(
                    f"centroidal problem: friction of contact {number} ({contact.effector}{where}) must be a finite number "
                    f">= 0, got {contact.friction}"
                )

    @property
    def supports(self) -> np.ndarray:
        """(C, V, 2) corners of the supports of the schedule's contacts in their frames [m], the last one repeated."""
        return support_corners(self.schedule.contacts, self.half_extent)

    def _array(self, name: str, shape: tuple[int, ...], infinite: bool = False) -> None:
        value = getattr(self, name)
        if value is None:
            return
        array = np.array(value, dtype=float)
        if array.shape != shape:
            raise InputError(f"centroidal problem: {name} must have shape {shape}, got {array.shape}")
        if np.isnan(array).any() or not (infinite or np.isfinite(array).all()):
            raise InputError(f"centroidal problem: {name} must be finite")
        array.setflags(write=False)
        object.__setattr__(self, name, array)


def structure(problem: CentroidalProblem) -> Hashable:
    """What must be equal for a program to take another problem's numbers without being rebuilt.

    Which contacts are active when, how many corners their supports have, and what is tracked and bounded. Poses, friction,
    patches, mass, times and momenta are free.
    """
    schedule = problem.schedule
    tracked = (problem.com_reference, problem.com_box, problem.angular_momentum_reference)
    contacts = (len(schedule.contacts), problem.supports.shape[1])
    return (*contacts, schedule.active.shape, schedule.active.tobytes(), *(t is None for t in tracked))
