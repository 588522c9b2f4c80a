"""The steps of both feet as the torso sees them: pairs of feet about it, and how one more step moves it (Lin 2020 sec. 5.5).

The torso frame T has its origin at the mean of the feet and the mean of their headings.

    feet about T, of a step (x, y, theta) of one foot seen from the other      Lin 2020 eq. 5.5
        yaw_stand = -theta / 2      yaw_step = theta / 2      p_step = -p_stand = R(yaw_stand) (x, y) / 2
    one more step of either foot moves the mean to (p_new + p_stand) / 2       its translation v is the nearest cell
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from scenes.transition_model import TransitionModel

CELL = 0.1  # [m] edge of a cell of the torso's grid
DIRECTIONS = 12  # of motion, 30 deg each (Lin & Berenson 2017 sec. IV.E)


@dataclass(frozen=True, eq=False)
class TorsoSteps:
    """Pairs of feet about the torso, and one more step from each.

    Attributes:
        pairs: (G, 2, 3) x, y [m] and yaw [rad] of left and right foot in T.
        translations: (V, 2) of the torso, in cells along x and y of T; row k is translation k.
        pair: (A,) pair that each further step starts from; ascending.
        mover: (A,) foot that makes it, 0 left, 1 right.
        place: (A, 3) x, y [m] and yaw [rad] of the new foot in T.
        translation: (A,) number of the translation that it makes.
        direction: (A,) number of the direction of motion, 0 about +x of T, counter-clockwise; -1 where the mean does not move.
    """

    pairs: np.ndarray
    translations: np.ndarray
    pair: np.ndarray
    mover: np.ndarray
    place: np.ndarray
    translation: np.ndarray
    direction: np.ndarray

    @property
    def direction_of_translation(self) -> np.ndarray:
        """(V,) the direction of motion of each translation, -1 for the one that stays."""
        return _directions(self.translations * CELL)


def torso_steps(model: TransitionModel, longest: float) -> TorsoSteps:
    """All pairs of feet that a transition model knows, and all further steps.

    Args:
        model: of the steps.
        longest: how far a foot moves in one step at most [m].
    """
    pairs, steps = [], (model.mirrored(True)[0], model.mirrored(False)[0])
    for mover in (0, 1):
        x, y, turn = steps[mover].T
        c, s = np.cos(0.5 * turn), -np.sin(0.5 * turn)
        half = 0.5 * np.column_stack([c * x - s * y, s * x + c * y])
        moved = np.column_stack([half, 0.5 * turn])
        pairs += [np.stack([moved, -moved] if mover == 0 else [-moved, moved], axis=1)]
    pairs = np.concatenate(pairs)
    number, movers, places, shift = [], [], [], []
    for k, pair in enumerate(pairs):
        for mover in (0, 1):
            x, y, yaw = pair[1 - mover]
            c, s = np.cos(yaw), np.sin(yaw)
            there = steps[mover]
            place = np.column_stack(
                [x + c * there[:, 0] - s * there[:, 1], y + s * there[:, 0] + c * there[:, 1], yaw + there[:, 2]]
            )
            place = place[np.hypot(*(place[:, :2] - pair[mover, :2]).T) <= longest]
            number += [k] * len(place)
            movers += [mover] * len(place)
            places.append(place)
            shift.append(0.5 * (place[:, :2] + (x, y)))
    place, moved = np.concatenate(places), np.concatenate(shift)
    translations, translation = np.unique(np.round(moved / CELL).astype(np.int64), axis=0, return_inverse=True)
    return TorsoSteps(
        pairs, translations, np.array(number), np.array(movers), place, translation.reshape(-1), _directions(moved)
    )


def _directions(moved: np.ndarray) -> np.ndarray:
    """(n,) number of the direction of each motion (n, 2), -1 where there is none."""
    sector = 2 * np.pi / DIRECTIONS
    angle = np.arctan2(moved[:, 1], moved[:, 0])  # halves are rounded away from straight ahead, to either side
    number = (np.sign(angle) * np.floor(np.abs(angle) / sector + 0.5)).astype(np.int64) % DIRECTIONS
    return np.where(np.hypot(*moved.T) < 1e-6, -1, number)
