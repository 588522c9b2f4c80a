"""The kinematics of any floating-base robot that Drake has loaded, read once and evaluated in microseconds.

`Kinematics.from_plant` reads a finalized MultibodyPlant into the arrays of `optimization.multibody.kinematic_tree`, whose
numba functions agree with Drake to rounding. The class serves Python; kernels take `Kinematics.tree` and call those.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import BodyIndex, Joint, PrismaticJoint, RevoluteJoint, RigidBody, WeldJoint

from optimization.multibody.kinematic_tree import (
    KinematicTree,
    center_of_mass,
    com_jacobian,
    difference,
    forward,
    frame_jacobian,
    frame_pose,
    integrate,
    momentum_matrix,
    point_jacobian,
)

__all__ = [
    "KinematicTree",
    "Kinematics",
    "center_of_mass",
    "com_jacobian",
    "difference",
    "forward",
    "frame_jacobian",
    "frame_pose",
    "integrate",
    "momentum_matrix",
    "point_jacobian",
]


@dataclass(frozen=True, eq=False)
class Kinematics:
    """Forward kinematics, Jacobians and momentum of one floating-base robot.

    Attributes:
        tree: the packed arrays, for use inside numba.
        frames: names of the E frames, in the order in which poses and Jacobians come.
        joint_names: names of the joints 1 .. n-1, in the order of v[6:].
        bodies: body name -> (link index, (4, 4) X_LB pose of the body in the link's frame [m]).
    """

    tree: KinematicTree
    frames: tuple[str, ...]
    joint_names: tuple[str, ...]
    bodies: dict[str, tuple[int, np.ndarray]]

    @staticmethod
    def from_plant(plant: MultibodyPlant, frames: Sequence[str]) -> Kinematics:
        """Reads a finalized plant that holds one robot with a quaternion floating base.

        Joints may be revolute, prismatic or welds, with any fixed frame on either side. What is welded to the world
        (terrain) is ignored.

        Args:
            plant: finalized; its positions are those of the robot alone.
            frames: names of frames fixed in the robot's bodies, the end effectors first.

        Raises:
            ValueError: no or several floating bases, a joint of another type, or positions that are not the robot's.
        """
        return _read_plant(plant, tuple(frames))

    @property
    def num_positions(self) -> int:
        """nq = 7 + joints."""
        return 6 + len(self.tree.parent)

    @property
    def num_velocities(self) -> int:
        """nv = 6 + joints."""
        return 5 + len(self.tree.parent)

    @property
    def total_mass(self) -> float:
        """Mass of the robot [kg]."""
        return self.tree.total_mass

    def link_poses(self, q: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """R_WL (n, 3, 3) and p_WL (n, 3) [m] of every link frame; see `bodies` for where Drake's bodies sit in them."""
        q = self._checked(q, self.num_positions)
        n = len(self.tree.parent)
        R, p = np.empty((n, 3, 3)), np.empty((n, 3))
        forward(self.tree, q, R, p)
        return R, p

    def body_pose(self, q: np.ndarray, body: str) -> np.ndarray:
        """(4, 4) X_WB of the body of this name [m].

        Args:
            q: (nq,) positions in Drake's order.
            body: name of a body of the model.
        """
        link, X_LB = self.bodies[body]
        R, p = self.link_poses(q)
        X_WL = np.eye(4)
        X_WL[:3, :3], X_WL[:3, 3] = R[link], p[link]
        return X_WL @ X_LB

    def effector_poses(self, q: np.ndarray) -> np.ndarray:
        """(E, 4, 4) X_WE of the named frames [m]."""
        R, p = self.link_poses(q)
        X_WE = np.tile(np.eye(4), (len(self.frames), 1, 1))
        for e in range(len(self.frames)):
            frame_pose(self.tree, R, p, e, X_WE[e, :3, :3], X_WE[e, :3, 3])
        return X_WE

    def com(self, q: np.ndarray) -> np.ndarray:
        """(3,) centre of mass in W [m]."""
        R, p = self.link_poses(q)
        com = np.empty(3)
        center_of_mass(self.tree, R, p, com)
        return com

    def effector_jacobians(self, q: np.ndarray) -> np.ndarray:
        """(E, 6, nv) Jacobians of (w_WE, v_WE) in W with respect to v."""
        R, p = self.link_poses(q)
        J = np.empty((len(self.frames), 6, self.num_velocities))
        for e in range(len(self.frames)):
            frame_jacobian(self.tree, R, p, e, J[e])
        return J

    def com_jacobian(self, q: np.ndarray) -> np.ndarray:
        """(3, nv) Jacobian of the centre of mass's velocity in W with respect to v."""
        R, p = self.link_poses(q)
        com, J = np.empty(3), np.empty((3, self.num_velocities))
        com_jacobian(self.tree, R, p, com, J)
        return J

    def momentum_matrix(self, q: np.ndarray) -> np.ndarray:
        """(6, nv) centroidal momentum matrix: angular [kg m^2/s] about the CoM, then linear [kg m/s], in W."""
        R, p = self.link_poses(q)
        com, A = np.empty(3), np.empty((6, self.num_velocities))
        momentum_matrix(self.tree, R, p, com, A)
        return A

    def integrate(self, q: np.ndarray, v: np.ndarray, dt: float) -> np.ndarray:
        """(nq,) positions after moving at constant v for dt [s], the quaternion by the exponential map.

        Args:
            q: (nq,) positions in Drake's order.
            v: (nv,) velocity [rad/s, m/s].
            dt: [s].
        """
        out = np.empty(self.num_positions)
        integrate(self._checked(q, self.num_positions), self._checked(v, self.num_velocities), dt, out)
        return out

    def difference(self, q1: np.ndarray, q2: np.ndarray) -> np.ndarray:
        """(nv,) the velocity that takes q1 to q2 in one second: integrate(q1, v, 1) = q2.

        Args:
            q1, q2: (nq,) positions in Drake's order.
        """
        out = np.empty(self.num_velocities)
        difference(self._checked(q1, self.num_positions), self._checked(q2, self.num_positions), out)
        return out

    @staticmethod
    def _checked(x: np.ndarray, size: int) -> np.ndarray:
        x = np.array(x, dtype=float)  # a copy: to numba a read-only array is of another type, compiled anew
        if x.shape != (size,):
            raise ValueError(f"expected {size} numbers, got an array of shape {x.shape}")
        return x


def limb_links(tree: KinematicTree, effector: int) -> list[int]:
    """Links from the one that carries an end effector up to the first below the base.

    Args:
        tree: of the robot.
        effector: index into `EFFECTORS`.
    """
    chain = [int(tree.frame_link[effector])]
    while tree.parent[chain[-1]] > 0:
        chain.append(int(tree.parent[chain[-1]]))
    return chain


@dataclass(frozen=True)
class _Attached:
    """A body and where it sits in its link."""

    body: RigidBody
    link: int
    X_LB: np.ndarray


def _read_plant(plant: MultibodyPlant, frames: tuple[str, ...]) -> Kinematics:
    base = _floating_base(plant)
    children: dict[BodyIndex, list[Joint]] = {}
    for index in plant.GetJointIndices():
        joint = plant.get_joint(index)
        children.setdefault(joint.parent_body().index(), []).append(joint)

    joints = _moving_joints(plant, base, children)
    link_of_joint = {joint.index(): 1 + i for i, joint in enumerate(joints)}
    n = 1 + len(joints)
    parent, prismatic = np.full(n, -1), np.zeros(n, np.bool_)
    X_PF = np.tile(np.eye(4), (n, 1, 1))
    attached = {base.index(): _Attached(base, 0, np.eye(4))}
    waiting = [base.index()]
    while waiting:
        at = attached[waiting.pop()]
        for joint in children.get(at.body.index(), ()):
            X_LF = at.X_LB @ joint.frame_on_parent().GetFixedPoseInBodyFrame().GetAsMatrix4()
            X_MB = np.linalg.inv(joint.frame_on_child().GetFixedPoseInBodyFrame().GetAsMatrix4())
            child = joint.child_body()
            if isinstance(joint, WeldJoint):
                attached[child.index()] = _Attached(child, at.link, X_LF @ joint.X_FM().GetAsMatrix4() @ X_MB)
            else:
                link = link_of_joint[joint.index()]
                X_aligned = _frame_with_z(_axis(joint))
                parent[link], prismatic[link] = at.link, isinstance(joint, PrismaticJoint)
                X_PF[link] = X_LF @ X_aligned
                attached[child.index()] = _Attached(child, link, X_aligned.T @ X_MB)
            waiting.append(child.index())
    if (parent[1:] >= np.arange(1, n)).any():
        raise ValueError("a joint's velocity comes before its parent's")

    mass, p_LLcm, I_LLcm_L = _link_inertias(plant, n, attached.values())
    frame_link, X_LE = _named_frames(plant, frames, attached)
    lower, upper, speed = (np.array(x, dtype=float).reshape(n - 1) for x in _limits(joints))
    tree = KinematicTree(
        parent.astype(np.int64),
        prismatic,
        X_PF[:, :3, :3].copy(),
        X_PF[:, :3, 3].copy(),
        mass,
        p_LLcm,
        I_LLcm_L,
        frame_link,
        X_LE[:, :3, :3].copy(),
        X_LE[:, :3, 3].copy(),
        lower,
        upper,
        speed,
        float(mass.sum()),
    )
    return Kinematics(
        tree, frames, tuple(j.name() for j in joints), {a.body.name(): (a.link, a.X_LB) for a in attached.values()}
    )


def _floating_base(plant: MultibodyPlant) -> RigidBody:
    floating = [plant.get_body(index) for index in plant.GetFloatingBaseBodies()]
    if len(floating) != 1 or not floating[0].has_quaternion_dofs():
        names = [body.name() for body in floating]
        raise ValueError(f"expected one floating base with a quaternion, the plant has {names or 'none'}")
    base = floating[0]
    if base.floating_positions_start() != 0:
        raise ValueError(f"the positions of the base {base.name()!r} must come first")
    return base


def _moving_joints(plant: MultibodyPlant, base: RigidBody, children: dict[BodyIndex, list[Joint]]) -> list[Joint]:
    """The joints of the tree below `base` that move, in the order of their velocities."""
    joints: list[Joint] = []
    waiting = [base.index()]
    while waiting:
        for joint in children.get(waiting.pop(), ()):
            if joint.type_name() not in (RevoluteJoint.kTypeName, PrismaticJoint.kTypeName, WeldJoint.kTypeName):
                raise ValueError(f"joint {joint.name()!r} is {joint.type_name()}, expected revolute, prismatic or weld")
            if not isinstance(joint, WeldJoint):
                joints.append(joint)
            waiting.append(joint.child_body().index())
    joints.sort(key=lambda joint: joint.velocity_start())
    owned = [(joint.position_start(), joint.velocity_start()) for joint in joints]
    if owned != [(7 + i, 6 + i) for i in range(plant.num_velocities() - 6)]:
        raise ValueError("the plant has positions that are not the robot's")
    return joints


def _axis(joint: Joint) -> np.ndarray:
    if isinstance(joint, RevoluteJoint):
        return np.array(joint.revolute_axis())
    assert isinstance(joint, PrismaticJoint)
    return np.array(joint.translation_axis())


def _frame_with_z(axis: np.ndarray) -> np.ndarray:
    """(4, 4) rotation whose z is the unit `axis`; exact when the axis is a coordinate axis."""
    x = np.zeros(3)
    x[np.argmin(np.abs(axis))] = 1.0
    x -= (x @ axis) * axis
    x /= np.linalg.norm(x)
    X = np.eye(4)
    X[:3, :3] = np.stack([x, np.cross(axis, x), axis], axis=1)
    return X


def _link_inertias(
    plant: MultibodyPlant, n: int, attached: Iterable[_Attached]
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Mass (n,), centre of mass (n, 3) and inertia about it (n, 3, 3) of the links, their bodies summed, in L."""
    context = plant.CreateDefaultContext()
    mass, moment, about_L = np.zeros(n), np.zeros((n, 3)), np.zeros((n, 3, 3))
    for a in attached:
        M_BBo_B = a.body.CalcSpatialInertiaInBodyFrame(context)
        m, R, p = M_BBo_B.get_mass(), a.X_LB[:3, :3], a.X_LB[:3, 3]
        c_B = np.array(M_BBo_B.get_com())
        about_cm = M_BBo_B.CalcRotationalInertia().CopyToFullMatrix3() - m * _parallel(c_B)
        c_L = p + R @ c_B
        mass[a.link] += m
        moment[a.link] += m * c_L
        about_L[a.link] += R @ about_cm @ R.T + m * _parallel(c_L)
    p_LLcm = moment / np.maximum(mass, 1e-300)[:, None]
    I_LLcm_L = about_L - mass[:, None, None] * np.array([_parallel(p) for p in p_LLcm])
    return mass, p_LLcm, I_LLcm_L


def _parallel(p: np.ndarray) -> np.ndarray:
    """|p|^2 1 - p p^T: what a unit mass at p adds to the inertia about the origin."""
    return (p @ p) * np.eye(3) - np.outer(p, p)


def _named_frames(
    plant: MultibodyPlant, frames: tuple[str, ...], attached: dict[BodyIndex, _Attached]
) -> tuple[np.ndarray, np.ndarray]:
    links, poses = np.zeros(len(frames), np.int64), np.zeros((len(frames), 4, 4))
    for e, name in enumerate(frames):
        frame = plant.GetFrameByName(name)
        at = attached[frame.body().index()]
        links[e] = at.link
        poses[e] = at.X_LB @ frame.GetFixedPoseInBodyFrame().GetAsMatrix4()
    return links, poses


def _limits(joints: list[Joint]) -> tuple[list[float], list[float], list[float]]:
    """Lower and upper position limits and the speed limit (the tighter of the two directions) of each joint."""
    lower = [joint.position_lower_limits()[0] for joint in joints]
    upper = [joint.position_upper_limits()[0] for joint in joints]
    speed = [min(-j.velocity_lower_limits()[0], j.velocity_upper_limits()[0]) for j in joints]
    return lower, upper, speed
