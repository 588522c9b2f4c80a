"""Questions of capture as seen from the standing foot, so that place, heading and side need not be learned.

Frame F: origin at the contact point of the standing foot, x along the foot's heading, z up; where the right foot stands,
everything in a mirror at the plane y = 0, so that the standing foot is always the left one.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from optimization.capture.question import MIRROR, MIRROR_TURN, CaptureQuestion
from optimization.capture.sampling import CAPTURE_MOTIONS
from scenes.effector import RIGHT_FOOT
from scenes.input_error import InputError

NUM_MOTIONS = len(CAPTURE_MOTIONS)
STAY, FOOT, SAME_PALM, OPPOSITE_PALM = range(NUM_MOTIONS)


@dataclass(frozen=True, eq=False)
class FootFrame:
    """Frame F of one standing foot.

    Attributes:
        p_WC: (3,) contact point in W [m].
        turn: (3, 3) R_FW, rotation about z by minus the heading.
        mirrored: whether the right foot stands.
    """

    p_WC: np.ndarray
    turn: np.ndarray
    mirrored: bool

    @classmethod
    def of(cls, p_WC: np.ndarray, R_WC: np.ndarray, effector: int) -> FootFrame:
        """Frame F of a contact.

        Args:
            p_WC: (3,) contact point in W [m].
            R_WC: (3, 3) contact frame in W.
            effector: index of the foot among the end effectors.
        """
        heading = np.hypot(R_WC[0, 0], R_WC[1, 0])
        c, s = R_WC[0, 0] / heading, R_WC[1, 0] / heading
        turn = np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]])
        return cls(np.asarray(p_WC, float), turn, effector == RIGHT_FOOT)

    def points(self, p_W: np.ndarray) -> np.ndarray:
        """(..., 3) points of W in F [m]."""
        return self.vectors(p_W - self.p_WC)

    def vectors(self, v_W: np.ndarray) -> np.ndarray:
        """(..., 3) vectors of W in F."""
        v = v_W @ self.turn.T
        return v * [1.0, -1.0, 1.0] if self.mirrored else v

    def axial(self, v_W: np.ndarray) -> np.ndarray:
        """(..., 3) axial vectors of W in F, angular momenta among them."""
        v = v_W @ self.turn.T
        return v * MIRROR_TURN if self.mirrored else v

    def rotations(self, R_W: np.ndarray) -> np.ndarray:
        """(..., 3, 3) contact frames of W in F; in the mirror the y axis is turned about, so that they stay right-handed."""
        R = self.turn @ R_W
        return MIRROR @ R @ MIRROR if self.mirrored else R


@dataclass(frozen=True, eq=False)
class CaptureViews:
    """n questions about stances of one foot, in frame F.

    Attributes:
        motion: (n,) index into `CAPTURE_MOTIONS`.
        foot_R: (n, 3, 3) frame of the standing foot's contact.
        p_new: (n, 3) new contact [m], 0 where none is made.
        R_new: (n, 3, 3) its frame, identity where none is made.
        com: (n, 3) [m].
        velocity: (n, 3) of the CoM after the push [m/s].
        spin: (n, 3) angular momentum about the CoM over the mass [m^2/s].
    """

    motion: np.ndarray
    foot_R: np.ndarray
    p_new: np.ndarray
    R_new: np.ndarray
    com: np.ndarray
    velocity: np.ndarray
    spin: np.ndarray

    def __len__(self) -> int:
        return len(self.motion)

    def take(self, rows: np.ndarray) -> CaptureViews:
        """These rows of it, by index or mask."""
        return CaptureViews(
            self.motion[rows], self.foot_R[rows], self.p_new[rows], self.R_new[rows], self.com[rows],
            self.velocity[rows], self.spin[rows],
        )  # fmt: skip


def motion_of(question: CaptureQuestion) -> int:
    """Index into `CAPTURE_MOTIONS` of what a question asks.

    Raises:
        InputError: the stance holds other than one foot, or the new contact is made by that foot.
    """
    held = [e for e, contact in enumerate(question.stance.contacts) if contact is not None]
    if len(held) != 1 or held[0] > RIGHT_FOOT or question.moving == held[0]:
        raise InputError("capture: networks know stances of one foot, and new contacts of the three others")
    if question.moving < 0:
        return STAY
    if question.moving <= RIGHT_FOOT:
        return FOOT
    return SAME_PALM if question.moving - 2 == held[0] else OPPOSITE_PALM


def view_of(question: CaptureQuestion, mass: float) -> CaptureViews:
    """One question in frame F, as arrays of one row.

    Args:
        question: about a stance of one foot.
        mass: of the robot [kg].

    Raises:
        InputError: as `motion_of`.
    """
    motion = motion_of(question)
    foot = next(contact for contact in question.stance.contacts if contact is not None)
    frame = FootFrame.of(foot.p_WC, foot.R_WC, question.stance.contacts.index(foot))
    new = question.new_contact
    return CaptureViews(
        np.array([motion]),
        frame.rotations(foot.R_WC[None]),
        np.zeros((1, 3)) if new is None else frame.points(new.p_WC[None]),
        np.eye(3)[None] if new is None else frame.rotations(new.R_WC[None]),
        frame.points(question.com[None]),
        frame.vectors(question.linear_momentum[None]) / mass,
        frame.axial(question.angular_momentum[None]) / mass,
    )
