"""From a model to a robot's description: each part is found, each number measured or guessed, and all of it is said."""

from __future__ import annotations

import tempfile
from collections.abc import Callable, Mapping
from pathlib import Path

import numpy as np

from drakeplan.robot_setup.description import Description
from drakeplan.robot_setup.draft import draft, find_base, mimicking
from drakeplan.robot_setup.figures import make_figures
from drakeplan.robot_setup.fists import closed_fingers
from drakeplan.robot_setup.limbs import Limbs, find_limbs
from drakeplan.robot_setup.link_tree import LinkTree
from drakeplan.robot_setup.model_source import FoundModel
from drakeplan.robot_setup.palms import find_palms
from drakeplan.robot_setup.robot_file import frame_name, frame_words, write_robot_file
from drakeplan.robot_setup.soles import find_soles, heading
from drakeplan.robot_setup.standing import find_standing
from drakeplan.robot_setup.symmetry import MirroredJoint, mirrored_joints
from drakeplan.robot_setup.touching import always_touching
from scenes.effector import EFFECTORS
from scenes.input_error import InputError
from scenes.robots.schema import FrameEntry, ModelChanges

FRONT = "front"  # name of the frame that becomes the base where the model's own base does not face ahead
UPRIGHT = (  # how a base may stand: z up as most, y up as in computer graphics, x up
    np.eye(3),
    np.array([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]]),
    np.array([[0.0, 0, -1], [0, 1, 0], [1, 0, 0]]),
)
TURNED = np.cos(np.deg2rad(2.0))  # a base that faces ahead within this angle stays
AHEAD = np.array([1.0, 0.0, 0.0])  # where the robot faces in W, once it is upright
SMALLEST, LARGEST = 0.2, 10.0  # [m] of a robot: others are in millimetres or inches
LONGER = 0.02  # [m] that a hand is drawn beyond its collision shapes, from where on what is drawn counts


def describe_robot(
    found: FoundModel,
    name: str,
    given: Mapping[str, str] | None = None,
    *,
    seed: int = 0,
    say: Callable[[str], None] = lambda line: None,
) -> Description:
    """Finds everything that a robot file needs; takes some seconds, with large meshes a minute.

    Args:
        found: the model.
        name: of the robot.
        given: effector -> link that the user names.
        seed: of the random postures.
        say: takes a line for each step.

    Raises:
        InputError: the model is no humanoid that stands on flat feet; the line says what is missing.
    """
    try:
        return _describe(found, name, dict(given or {}), seed, say)
    except InputError as error:
        raise error if str(found.file) in str(error) else InputError(f"{found.file}: {error}") from None


def _describe(
    found: FoundModel, name: str, given: Mapping[str, str], seed: int, say: Callable[[str], None]
) -> Description:
    say("read the model")
    base = find_base(found)
    tree, limbs, R_WB = _upright(found, base, given)
    notes: list[str] = []
    say("close the fingers, hold the head still")
    fixed, fingers = _welds(tree, limbs, AHEAD)
    drawn = _drawn_only(tree, limbs)
    changes = ModelChanges(fixed=fixed, one_hull=_hulls(tree, limbs), collide_as_drawn=drawn)
    tree = draft(found, base, changes, R_WB)
    limbs = _renamed(tree, limbs)
    say("find soles and palms")
    soles = find_soles(tree, limbs.feet)
    palms = None if limbs.hands is None else find_palms(tree, limbs.hands, limbs.torso, AHEAD)
    if limbs.hands is not None and palms is None:
        notes.append(
            f"the hands ({limbs.hands[0]}, {limbs.hands[1]}) have no shape that could lean on a wall: plans use the feet alone"
        )
        limbs = Limbs(limbs.feet, None, limbs.torso, limbs.origin)
    elif limbs.hands is None:
        notes.append("no arms with a hand were found: plans use the feet alone")
    mirrored = _mirrored(tree, limbs, notes)
    say("stand")
    standing = find_standing(tree, soles, palms, mirrored, R_WB.T, seed=seed)
    if isinstance(standing, str):
        raise InputError(standing)
    say("look for bodies that always touch")
    pairs = always_touching(tree, standing.q, seed=seed)
    frames: dict[str, FrameEntry] = {}
    bodies = {b for link in tree.links.values() for b in link.bodies}
    front = next(n for k in range(9) if (n := FRONT + "_" * k) not in bodies)
    if R_WB[0, 0] < TURNED or R_WB[2, 2] < TURNED:
        frames[front] = frame_words(base, np.block([[R_WB.T, np.zeros((3, 1))], [np.zeros((1, 3)), np.ones((1, 1))]]))
        notes.append(f"the base {base!r} does not face ahead with z up: a frame {front!r} on it becomes the base")
    for e, part in enumerate([*soles, *(palms or ())]):
        frames[frame_name(EFFECTORS[e], bodies)] = frame_words(part.body, part.X_BE)
    description = Description(
        found=found,
        name=name,
        base=front if front in frames else base,
        changes=changes.model_copy(update={"frames": frames, "ignored_pairs": pairs}),
        limbs=limbs,
        soles=soles,
        palms=palms,
        standing=standing,
        notes=notes,
        origin={**limbs.origin, "fingers": fingers},
    )
    _note_doubts(tree, description, mimicking(found))
    say("measure reaches")
    _measure(tree, description, seed)
    return description


def _upright(found: FoundModel, base: str, given: Mapping[str, str]) -> tuple[LinkTree, Limbs, np.ndarray]:
    """The robot upright with its toes along x of W, its limbs, and (3, 3) the axes of W in its base's, transposed."""
    first: InputError | None = None
    for R_WB in UPRIGHT:
        tree = draft(found, base, ModelChanges(), R_WB)
        _check_size(tree)
        try:
            limbs = find_limbs(tree, dict(given))
        except InputError as error:
            first = first or error
            continue
        if not _feet_below(tree, limbs):
            first = first or InputError("the feet are not below the joints that their legs begin with")
            continue
        front = heading(tree, limbs.feet)
        R_WF = np.column_stack([front, np.cross([0.0, 0.0, 1.0], front), [0.0, 0.0, 1.0]])
        if R_WF[0, 0] > 1.0 - 1e-9:
            return tree, limbs, R_WB
        return draft(found, base, ModelChanges(), R_WF.T @ R_WB), limbs, R_WF.T @ R_WB
    assert first is not None
    raise first


def _check_size(tree: LinkTree) -> None:
    points = np.concatenate([tree.origin(n)[None] for n in tree.links] + [link.points for link in tree.links.values()])
    size = float(np.ptp(points, axis=0).max())
    if not SMALLEST < size < LARGEST:
        raise InputError(f"the robot is {size:.3g} m large: lengths are metres; is the model in another unit?")


def _feet_below(tree: LinkTree, limbs: Limbs) -> bool:
    for foot in limbs.feet:
        down = tree.origin(tree.way(foot)[1]) - tree.origin(foot)
        if down[2] < 0.5 * float(np.linalg.norm(down)):
            return False
    return True


def _welds(tree: LinkTree, limbs: Limbs, front: np.ndarray) -> tuple[dict[str, float], str]:
    """Angles of the joints that do not help to walk and lean; and how many of them are fingers, in words."""
    moving = {tree.links[n].joint for end in (*limbs.feet, *(limbs.hands or ())) for n in tree.way(end)[1:]}
    fixed: dict[str, float] = {}
    for hand in limbs.hands or ():
        points = np.concatenate([tree.links[n].points for n in tree.below(hand)])
        way = tree.way(hand)
        before = next(
            (n for n in reversed(way[:-1]) if np.linalg.norm(tree.origin(n) - tree.origin(hand)) > 0.05), way[0]
        )
        out = (points.mean(axis=0) if len(points) else tree.origin(hand) + front) - tree.origin(before)
        fixed |= closed_fingers(tree, hand, out / max(float(np.linalg.norm(out)), 1e-9))
    fingers = len(fixed)
    for link in tree.links.values():
        if link.joint is not None and link.joint not in moving and link.joint not in fixed:
            joint = tree.plant.GetJointByName(link.joint)
            fixed[link.joint] = float(np.clip(0.0, joint.position_lower_limits()[0], joint.position_upper_limits()[0]))
    return {k: round(v, 4) + 0.0 for k, v in fixed.items()}, (
        f"{fingers} finger joints are closed as far as they go" if fingers else "there are no fingers"
    )


def _drawn_only(tree: LinkTree, limbs: Limbs) -> list[str]:
    """Bodies to collide as they are drawn, for want of another shape: all of a model that has none.

    Else those of a foot or hand without any, and of a hand that is drawn longer than it collides: a rubber hand on a wrist.
    """
    if all(link.drawn_only or not len(link.points) for link in tree.links.values()):
        return sorted(body for link in tree.links.values() for body in link.drawn)
    found = [
        b for foot in limbs.feet for n in tree.below(foot) if tree.links[n].drawn_only for b in tree.links[n].drawn
    ]
    for hand in limbs.hands or ():
        for link in (tree.links[n] for n in tree.below(hand)):
            low, high = (
                (link.points.min(axis=0), link.points.max(axis=0)) if len(link.points) else (np.zeros(3), np.zeros(3))
            )
            for body, drawn in link.drawn.items():
                beyond = max(float((drawn.max(axis=0) - high).max()), float((low - drawn.min(axis=0)).max()))
                if link.drawn_only or beyond > LONGER:
                    found.append(body)
    return sorted(found)


def _hulls(tree: LinkTree, limbs: Limbs) -> list[list[str]]:
    """A hand and its fingers become one convex shape."""
    groups = []
    for hand in limbs.hands or ():
        moved = tree.links[hand].moved
        bodies = [b for n in tree.below(hand) for b in tree.links[n].bodies]
        if len(bodies) > 1 and _welded_below(tree, moved, bodies):
            groups.append([moved, *(b for b in bodies if b != moved)])
    return groups


def _welded_below(tree: LinkTree, hand: str, bodies: list[str]) -> bool:
    """Whether every body hangs below the hand's own body, which the one shape will sit on."""
    parents = {}
    for index in tree.plant.GetJointIndices():
        joint = tree.plant.get_joint(index)
        parents[joint.child_body().name()] = joint.parent_body().name()
    for body in bodies:
        while body != hand:
            if body not in parents:
                return False
            body = parents[body]
    return True


def _renamed(tree: LinkTree, limbs: Limbs) -> Limbs:
    """The same parts in a tree whose welds have joined links."""
    owner = {body: name for name, link in tree.links.items() for body in link.bodies}
    hands = None if limbs.hands is None else (owner[limbs.hands[0]], owner[limbs.hands[1]])
    return Limbs((owner[limbs.feet[0]], owner[limbs.feet[1]]), hands, owner[limbs.torso], limbs.origin)


def _mirrored(tree: LinkTree, limbs: Limbs, notes: list[str]) -> list[MirroredJoint]:
    found: list[MirroredJoint] = []
    for what, ends in (("legs", limbs.feet), ("arms", limbs.hands)):
        if ends is None:
            continue
        left, right = (tree.way(end) for end in ends)
        shared = sum(a == b for a, b in zip(left, right, strict=False))
        joints = [[str(tree.links[n].joint) for n in way[shared:]] for way in (left, right)]
        pairs = mirrored_joints(tree, *joints)
        if pairs is None:
            notes.append(f"the {what} are no mirror images of each other: the posture may stand crooked")
        found += pairs or []
    return found


def _note_doubts(tree: LinkTree, d: Description, mimics: set[str]) -> None:
    way = tree.way(d.limbs.feet[0])
    shared = sum(a == b for a, b in zip(way, tree.way(d.limbs.feet[1]), strict=False))
    leg = len(way) - shared
    if leg < 6:
        d.notes.append(
            f"a leg has {leg} joints: soles stay flat on level ground, tilted stones and turns may be out of reach"
        )
    if d.limbs.hands is not None:
        arm = len(tree.way(d.limbs.hands[0])) - len(tree.way(d.limbs.torso))
        if arm < 6:
            d.notes.append(f"an arm has {arm} joints: a palm cannot lie flat on every wall")
    if d.changes.collide_as_drawn:
        d.notes.append(f"no collision shape: {', '.join(d.changes.collide_as_drawn)}; what is drawn takes its place")
    if mimics:
        d.notes.append(f"{len(mimics)} joints mimic others: they are welded at 0, unless `fixed` names them")
    if d.soles[0].tilt > np.deg2rad(15.0):
        d.notes.append(f"the soles are {np.degrees(d.soles[0].tilt):.0f} deg off level at the model's zero posture")
    if d.standing.arms_clear < 0.005:
        d.notes.append("in the nominal posture the arms touch the body: change `nominal` if they need not")


def _measure(tree: LinkTree, d: Description, seed: int) -> None:
    from optimization.inverse_kinematics.robot_reach import measure_reach
    from scenes.robots.plant import build_plant
    from scenes.robots.robot import load_robot

    with tempfile.TemporaryDirectory(prefix="drakeplan-robot-") as scratch:
        file = Path(scratch) / f"{d.name}.yaml"
        write_robot_file(d, file)
        robot = load_robot(file, d.found.packages)
        d.mass = robot.mass
        try:
            measured = measure_reach(build_plant(robot), seed=seed)
        except (RuntimeError, np.linalg.LinAlgError) as error:
            raise InputError(f"its reach could not be measured ({error})") from None
    d.figures = make_figures(tree, d.limbs, d.soles, d.standing, measured, d.mass)
    if min(d.figures.torso_size) <= 0.0:
        raise InputError(
            f"the trunk hangs below the hips: are {d.limbs.feet[0]!r} and {d.limbs.feet[1]!r} the foot links?"
        )
