"""What a library keeps of a plan: contacts and key configurations in a frame of the plan's own, about 20 KB a file.

Frame L has its origin at the mean of the first feet, x towards the mean of the last feet in plan view, z up: two plans in
their frames are aligned as Lin 2020 sec. 4.4.1 asks for.
"""

from __future__ import annotations

import hashlib
import json
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from safetensors import SafetensorError, safe_open
from safetensors.numpy import save
from scipy.spatial.transform import Rotation

from drakeplan.experience.key_motion import KeyMotion, key_motion
from drakeplan.plan.plan import Plan
from scenes.contact import Contact, contact_heading
from scenes.effector import EFFECTORS, is_foot
from scenes.input_error import InputError

FORMAT, VERSION = "drakeplan-stored-plan", 1
ABOUT = "drakeplan"  # the entry of the file's metadata that holds a JSON object
SUFFIX = ".safetensors"
# motion modes: which palms a plan uses beside the feet, indices into `EFFECTORS`
MODE_PALMS: dict[str, tuple[int, ...]] = {"feet": (), "left_palm": (2,), "right_palm": (3,), "all": (2, 3)}
MODES = tuple(MODE_PALMS)
SHORTEST = 0.3  # [m] a plan of less has no direction
MAX_BYTES = 1 << 22  # a file larger than this is no stored plan
ROUNDING = 1e-6  # [m] by which a stance may fall back and still count as a new end


@dataclass(frozen=True, eq=False)
class Outline:
    """The contacts of a plan, all that retrieval looks at.

    Attributes:
        position: (C, 3) contact points in L [m].
        quaternion: (C, 4) orientation of the contact frames in L, (w, x, y, z).
        effector: (C,) index into `EFFECTORS`.
        first: (C,) index of the stance in which each contact appears first.
        distance: (S,) horizontal distance of each stance's mean of the feet from the first one's, D of Lin 2020 eq. 5.14 [m].
    """

    position: np.ndarray
    quaternion: np.ndarray
    effector: np.ndarray
    first: np.ndarray
    distance: np.ndarray

    @property
    def length(self) -> float:
        """How far the plan leads, l_mp of Lin 2020 sec. 5.8.1 [m]."""
        return float(self.distance.max())

    def ends(self) -> np.ndarray:
        """Stances at which the plan may be cut: those farther from the start than any before (Lin 2020 sec. 5.8.1)."""
        farthest = np.maximum.accumulate(self.distance)
        return np.flatnonzero(self.distance >= farthest - ROUNDING)

    def as_bytes(self) -> bytes:
        """For the index of a library: two counts, then all numbers as 8-byte floats."""
        rows = np.column_stack([self.position, self.quaternion, self.effector, self.first])
        counts = np.array([len(rows), len(self.distance)], np.float64)
        return np.concatenate([counts, rows.ravel(), self.distance]).astype("<f8").tobytes()

    @staticmethod
    def from_bytes(data: bytes) -> Outline:
        """The reverse of `as_bytes`."""
        numbers = np.frombuffer(data, "<f8")
        num_contacts = int(numbers[0])
        rows = numbers[2 : 2 + 9 * num_contacts].reshape(-1, 9)
        whole = rows[:, 7:].astype(np.int64)
        return Outline(rows[:, :3], rows[:, 3:7], whole[:, 0], whole[:, 1], numbers[2 + 9 * num_contacts :])


@dataclass(frozen=True, eq=False)
class StoredPlan:
    """A plan as a library keeps it.

    Attributes:
        outline: its contacts.
        stances: (S, 4) index into the contacts, -1 where free.
        phases: (P, 4) the same for each stretch of time in which what carries is constant.
        t: (N,) of the key configurations [s].
        q: (N, nq) key configurations in L.
        phase: (N,) index into `phases`.
        share: (N,) how far along its phase each key configuration is.
        robot: name of the robot.
        robot_model_sha256: hash of its model file.
        facts: what it was made on and by; must fit JSON.
    """

    outline: Outline
    stances: np.ndarray
    phases: np.ndarray
    t: np.ndarray
    q: np.ndarray
    phase: np.ndarray
    share: np.ndarray
    robot: str
    robot_model_sha256: str
    facts: dict[str, object] = field(default_factory=dict)

    @property
    def mode(self) -> str:
        """The motion mode: which palms it uses."""
        used = tuple(sorted({2, 3} & set(self.outline.effector.tolist())))
        return next(mode for mode, palms in MODE_PALMS.items() if palms == used)

    @property
    def name(self) -> str:
        """Sixteen hexadecimal digits that its contacts determine."""
        return hashlib.sha256(self.outline.as_bytes()).hexdigest()[:16]

    def key_motion(self) -> KeyMotion:
        """What is adapted, in frame L; its contacts lie on no surface yet."""
        contacts = []
        matrices = Rotation.from_quat(self.outline.quaternion[:, [1, 2, 3, 0]]).as_matrix()
        for position, R, e in zip(self.outline.position, matrices, self.outline.effector, strict=True):
            X = np.eye(4)
            X[:3, :3], X[:3, 3] = R, position
            heading = contact_heading(X) if is_foot(EFFECTORS[e]) else float(np.arctan2(X[1, 0], X[0, 0]))
            contacts.append(Contact(EFFECTORS[e], 0, X, 0.5, heading))
        q = self.q.copy()
        q[:, :4] /= np.linalg.norm(q[:, :4], axis=1, keepdims=True)  # files hold single precision
        return KeyMotion(tuple(contacts), self.stances, self.phases, self.t, q, self.phase, self.share)

    def as_bytes(self) -> bytes:
        """The file's content; equal plans give equal bytes."""
        arrays = {
            "position": self.outline.position.astype(np.float64),
            "quaternion": self.outline.quaternion.astype(np.float64),
            "effector": self.outline.effector.astype(np.int8),
            "stances": self.stances.astype(np.int16),
            "phases": self.phases.astype(np.int16),
            "t": self.t.astype(np.float32),
            "q": self.q.astype(np.float32),
            "phase": self.phase.astype(np.int16),
            "share": self.share.astype(np.float32),
        }
        about = {
            "format": FORMAT,
            "version": VERSION,
            "robot": self.robot,
            "robot_model_sha256": self.robot_model_sha256,
            "facts": self.facts,
        }
        # One entry: safetensors writes several in an order that changes from call to call.
        metadata = {ABOUT: json.dumps(about, sort_keys=True)}
        return save({name: np.ascontiguousarray(array) for name, array in arrays.items()}, metadata)


def store_plan(plan: Plan) -> StoredPlan:
    """What a library keeps of a plan.

    Args:
        plan: complete.

    Raises:
        InputError: the plan has no motion, or leads less than `SHORTEST` far.
    """
    motion = key_motion(plan)
    feet = motion.feet_means()
    ahead = feet[-1] - feet[0]
    if np.hypot(*ahead[:2]) < SHORTEST:
        raise InputError(f"expected a plan of {SHORTEST:g} m or more, this one leads {np.hypot(*ahead[:2]):.2f} m")
    yaw = float(np.arctan2(ahead[1], ahead[0]))
    X_WL = plan_pose(feet[0], yaw)
    motion = motion.placed(np.linalg.inv(X_WL))
    facts = {"scene": plan.scene_name, "friction": round(float(plan.contacts.friction.min()), 6)}
    facts |= {key: plan.provenance[key] for key in ("seed", "planner") if key in plan.provenance}
    return StoredPlan(
        _outline(motion), motion.stances, motion.phases, motion.t - motion.t[0], motion.q, motion.phase, motion.share,
        plan.robot, plan.robot_model_sha256, facts,
    )  # fmt: skip


def plan_pose(origin: np.ndarray, yaw: float) -> np.ndarray:
    """(4, 4) pose of a plan's frame.

    Args:
        origin: (3,) mean of the first feet [m].
        yaw: of the way ahead [rad].
    """
    X = np.eye(4)
    X[:2, :2] = [[np.cos(yaw), -np.sin(yaw)], [np.sin(yaw), np.cos(yaw)]]
    X[:3, 3] = origin
    return X


def read_stored_plan(path: str | Path) -> StoredPlan:
    """Reads a file of a library.

    Raises:
        InputError: missing, damaged, foreign, of another version, or holding data that cannot be.
    """
    path = Path(path)
    try:
        size = path.stat().st_size
    except OSError as error:
        raise InputError(f"{path}: no such stored plan ({error.strerror})") from None
    if size > MAX_BYTES:
        raise InputError(f"{path}: {size} bytes, a stored plan has at most {MAX_BYTES}")
    try:
        with safe_open(path, framework="numpy") as file:
            about = json.loads((file.metadata() or {})[ABOUT])
            found = about["format"], about["version"]
            known = found == (FORMAT, VERSION)
            arrays = {name: file.get_tensor(name) for name in file.keys()} if known else {}  # noqa: SIM118  (no mapping)
        stored = _from_arrays(arrays, about) if known else None
    except (SafetensorError, OSError, ValueError, KeyError, TypeError, IndexError, RecursionError) as error:
        raise InputError(f"{path}: damaged stored plan ({error})") from None
    if stored is None:
        raise InputError(f"{path}: expected {FORMAT} version {VERSION}, got {found[0]} version {found[1]}")
    return stored


def _from_arrays(arrays: dict[str, np.ndarray], about: dict[str, object]) -> StoredPlan:
    """The plan of a file; raises ValueError on data that cannot be."""
    stances, phases = arrays["stances"].astype(np.int64), arrays["phases"].astype(np.int64)
    position, quaternion = arrays["position"], arrays["quaternion"]
    t, q, share = (arrays[name].astype(float) for name in ("t", "q", "share"))
    effector, phase = arrays["effector"].astype(np.int64), arrays["phase"].astype(np.int64)
    num_contacts, num = len(position), len(t)
    shapes = {
        "position": (position, (num_contacts, 3)), "quaternion": (quaternion, (num_contacts, 4)),
        "effector": (effector, (num_contacts,)), "stances": (stances, (len(stances), len(EFFECTORS))),
        "phases": (phases, (len(phases), len(EFFECTORS))), "t": (t, (num,)), "phase": (phase, (num,)),
        "share": (share, (num,)), "q": (q, (num, max(q.shape[-1], 7) if q.ndim else 7)),
    }  # fmt: skip
    for name, (array, shape) in shapes.items():
        if array.shape != shape:
            raise ValueError(f"{name} has shape {array.shape}, expected {shape}")
    if not all(np.isfinite(a).all() for a in (position, quaternion, t, q, share)):
        raise ValueError("a number is not finite")
    if len(stances) < 2 or not len(phases) or not num or (np.diff(t) <= 0.0).any():
        raise ValueError("stances, phases or times that cannot be")
    if (np.linalg.norm(quaternion, axis=1) < 0.5).any() or (np.linalg.norm(q[:, :4], axis=1) < 0.5).any():
        raise ValueError("a quaternion of no length")
    for table in (stances, phases):
        _check_table(table, effector)
    if (stances[:, :2] < 0).any():
        raise ValueError("a stance without a foot")
    if not 0 <= phase.min() <= phase.max() < len(phases):
        raise ValueError("a configuration names no phase")
    outline = Outline(position, quaternion, effector, _first(stances, num_contacts), _distance(position, stances))
    return StoredPlan(
        outline, stances, phases, t, q, phase, share,
        str(about["robot"]), str(about["robot_model_sha256"]), dict(about["facts"]),  # type: ignore[call-overload]
    )  # fmt: skip


def _check_table(table: np.ndarray, effector: np.ndarray) -> None:
    """Raises ValueError unless every entry of a stance or phase is -1 or names a contact of its column's end effector."""
    if table.min() < -1 or table.max() >= len(effector):
        raise ValueError("a table names no contact")
    column = np.broadcast_to(np.arange(len(EFFECTORS)), table.shape)
    if (effector[table[table >= 0]] != column[table >= 0]).any():
        raise ValueError("a contact stands in another end effector's column")


def _outline(motion: KeyMotion) -> Outline:
    position = np.array([c.p_WC for c in motion.contacts])
    turns = Rotation.from_matrix(np.array([c.R_WC for c in motion.contacts])).as_quat()
    quaternion = np.ascontiguousarray(turns[:, [3, 0, 1, 2]])
    effector = np.array([EFFECTORS.index(c.effector) for c in motion.contacts])
    first, distance = _first(motion.stances, len(position)), _distance(position, motion.stances)
    return Outline(position, quaternion, effector, first, distance)


def _first(stances: np.ndarray, count: int) -> np.ndarray:
    """(C,) index of the stance in which each contact appears first."""
    first = np.full(count, len(stances) - 1)
    for s in range(len(stances) - 1, -1, -1):
        first[stances[s][stances[s] >= 0]] = s
    return first


def _distance(position: np.ndarray, stances: np.ndarray) -> np.ndarray:
    """(S,) horizontal distance of each stance's mean of the feet from the first one's [m]."""
    feet = position[stances[:, :2], :2].mean(axis=1)
    return np.linalg.norm(feet - feet[0], axis=1)
