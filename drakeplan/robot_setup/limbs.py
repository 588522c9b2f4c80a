"""Which links are feet, hands and torso: by symmetry of names, by height, and by what hangs on what."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from drakeplan.robot_setup.link_tree import LinkTree
from scenes.effector import EFFECTORS
from scenes.input_error import InputError

SIDES = (
    ("left", "right"), ("Left", "Right"), ("LEFT", "RIGHT"), ("l", "r"), ("L", "R"), ("links", "rechts"), ("izq", "der"),
)  # fmt: skip
TOE = re.compile(r"toe", re.IGNORECASE)
FINGER = re.compile(
    r"finger|thumb|index|middle|pinky|little|(?<![a-z])ring|gripper|knuckle|claw|jaw|tip|hand$|hand_(?=[a-z]*_?\d)",
    re.IGNORECASE,
)
ARM = re.compile(r"arm|shoulder|elbow|wrist|hand", re.IGNORECASE)  # names of joints that no leg has
LEAST_LEG, LEAST_ARM = 3, 3  # joints
BELOW = 0.2  # [m] from the first joint of a leg down to its sole, at least
MIRRORED = 0.03  # [m] by which two links may miss being mirror images


@dataclass(frozen=True)
class Limbs:
    """The parts of a humanoid.

    Attributes:
        feet: links of the left and the right foot.
        hands: links of the left and the right hand, None for a robot without arms.
        torso: link that carries the arms; the base where there are none.
        origin: part -> how it was found, in words.
    """

    feet: tuple[str, str]
    hands: tuple[str, str] | None
    torso: str
    origin: dict[str, str]


def mirror_name(name: str, names: set[str]) -> str | None:
    """The name of the same link on the right, None for a link that is not on the left.

    Args:
        name: of a link.
        names: of all links.
    """
    for left, right in SIDES:
        for match in re.finditer(left, name):
            if len(left) == 1 and not _is_token(name, match.start()):
                continue
            other = name[: match.start()] + right + name[match.end() :]
            if other in names and other != name:
                return other
    for left, right in SIDES:  # several places at once, as in L_hand_l1
        other = re.sub(rf"(?<![A-Za-z]){left}(?![a-z])", right, name)
        if other in names and other != name:
            return other
    return None


def _is_token(name: str, at: int) -> bool:
    """Whether a single letter stands for a side: at an end, beside _ or a digit, or as in LHip, lHip."""
    before, after = name[at - 1 : at], name[at + 1 : at + 2]
    starts = not before or before in "_-./ " or (before.islower() and name[at].isupper())
    ends = not after or after in "_-./ " or after.isdigit() or after.isupper()
    return starts and ends


def find_limbs(tree: LinkTree, given: dict[str, str]) -> Limbs:
    """Finds feet, hands and torso.

    Args:
        tree: of the robot.
        given: effector -> link or body that the user names.

    Raises:
        InputError: the model has no pair of legs, or the user names what is not there.
    """
    owner = {body: name for name, link in tree.links.items() for body in link.bodies}
    for effector, body in given.items():
        if body not in owner:
            raise InputError(f"--{effector.replace('_', '-')}: the model has no link {body!r}")
    chosen = {effector: owner[body] for effector, body in given.items()}
    _complete(tree, chosen, owner)
    origin = {
        e: "named by you" if e in given else f"mirrors {chosen[EFFECTORS[EFFECTORS.index(e) ^ 1]]}" for e in chosen
    }
    pairs = list(_pairs(tree, owner))
    if EFFECTORS[0] in chosen:
        feet = (chosen[EFFECTORS[0]], chosen[EFFECTORS[1]])
    else:
        feet = _find_feet(tree, pairs)
        origin |= dict.fromkeys(EFFECTORS[:2], "the lowest links of the two legs")
    _check_feet(tree, feet)
    if EFFECTORS[2] in chosen:
        _check_hands(tree, (chosen[EFFECTORS[2]], chosen[EFFECTORS[3]]), feet)
        hands: tuple[str, str] | None = (chosen[EFFECTORS[2]], chosen[EFFECTORS[3]])
    else:
        hands = _find_hands(tree, pairs, feet)
        origin |= dict.fromkeys(EFFECTORS[2:], "the last links of the two arms before any fingers") if hands else {}
    torso = _shared(tree, *hands) if hands else tree.root
    origin["torso"] = "where the arms meet" if hands else "the base: the robot has no arms"
    return Limbs(feet, hands, torso, origin)


def _check_feet(tree: LinkTree, feet: tuple[str, str]) -> None:
    for foot, option in zip(feet, ("--left-foot", "--right-foot"), strict=True):
        if _joints(tree, foot) < LEAST_LEG:
            raise InputError(
                f"{option}: {foot!r} hangs on {_joints(tree, foot)} joints, a leg has {LEAST_LEG} at least"
            )
    if feet[0] in tree.way(feet[1]) or feet[1] in tree.way(feet[0]):
        raise InputError(f"--left-foot, --right-foot: {feet[0]!r} and {feet[1]!r} are of one leg")


def _check_hands(tree: LinkTree, hands: tuple[str, str], feet: tuple[str, str]) -> None:
    legs = {n for foot in feet for n in tree.below(tree.way(foot)[1])}
    for hand, option in zip(hands, ("--left-palm", "--right-palm"), strict=True):
        if hand in legs:
            raise InputError(f"{option}: {hand!r} is part of a leg")
    shared = tree.way(_shared(tree, *hands))
    if min(_joints(tree, hand) for hand in hands) < len(shared) - 1 + LEAST_ARM:
        raise InputError(
            f"--left-palm, --right-palm: expected the ends of two arms with {LEAST_ARM} joints or more each, got {hands[0]!r} "
            f"and {hands[1]!r}"
        )


def _complete(tree: LinkTree, chosen: dict[str, str], owner: dict[str, str]) -> None:
    """Adds the other side of a foot or hand that the user names alone."""
    bodies = set(owner)
    for left, right in (EFFECTORS[:2], EFFECTORS[2:]):
        for known, missing in ((left, right), (right, left)):
            if known not in chosen or missing in chosen:
                continue
            names = [b for b in tree.links[chosen[known]].bodies]
            backwards = {other: b for b in bodies if (other := mirror_name(b, bodies))}
            found = next(
                (m for b in names if (m := mirror_name(b, bodies) if known == left else backwards.get(b))), None
            )
            if found is None:
                raise InputError(
                    f"--{missing.replace('_', '-')}: expected it beside --{known.replace('_', '-')}: no link mirrors "
                    f"{chosen[known]!r} by its name"
                )
            chosen[missing] = owner[found]


def _pairs(tree: LinkTree, owner: dict[str, str]) -> Iterator[tuple[str, str]]:
    """Links that mirror each other, left and right: by their names, else by where they are."""
    bodies = set(owner)
    seen: set[tuple[str, str]] = set()
    for name, link in tree.links.items():
        for body in link.bodies:
            other = mirror_name(body, bodies)
            pair = (name, owner[other]) if other else None
            if pair and pair[0] != pair[1] and pair not in seen:
                seen.add(pair)
                yield pair
    if seen:
        return
    for a in tree.links:
        for b in tree.links:
            p, q = tree.origin(a), tree.origin(b)
            alike = abs(tree.links[a].mass - tree.links[b].mass) < 1e-3 * max(tree.links[a].mass, 1e-6)
            if p[1] > MIRRORED and np.linalg.norm(p * [1, -1, 1] - q) < MIRRORED and alike:
                yield a, b


def _joints(tree: LinkTree, name: str) -> int:
    return len(tree.way(name)) - 1


def _lowest(tree: LinkTree, name: str) -> float:
    points = tree.links[name].points
    return float(points[:, 2].min()) if len(points) else float(tree.origin(name)[2])


def _find_feet(tree: LinkTree, pairs: list[tuple[str, str]]) -> tuple[str, str]:
    legs = [
        (a, b)
        for a, b in pairs
        if min(_joints(tree, a), _joints(tree, b)) >= LEAST_LEG
        and not (tree.children(a) or tree.children(b))
        and max(_lowest(tree, a), _lowest(tree, b)) < tree.origin(tree.way(a)[1])[2] - BELOW
        and not any(ARM.search(tree.links[n].joint or n) for n in tree.way(a)[1:])
    ]
    if not legs:
        lone = [n for n in tree.links if not tree.children(n) and _joints(tree, n) >= LEAST_LEG]
        low = min(lone, key=lambda n: _lowest(tree, n), default=None)
        hint = f"; the lowest limb ends in {low!r}, and no other link mirrors it" if low else ""
        raise InputError(
            f"the model has no pair of legs with {LEAST_LEG} joints or more each{hint}: name the feet with --left-foot LINK "
            "--right-foot LINK"
        )
    pair = min(legs, key=lambda p: _lowest(tree, p[0]) + _lowest(tree, p[1]))
    while all(_is_toe(tree, name) for name in pair):  # toes are welded to the foot
        parents = tuple(tree.links[name].parent or name for name in pair)
        if parents[0] == parents[1] or _joints(tree, parents[0]) < LEAST_LEG:
            break
        pair = (parents[0], parents[1])
    return pair


def _is_toe(tree: LinkTree, name: str) -> bool:
    return bool(TOE.search(name) or TOE.search(tree.links[name].joint or ""))


def _find_hands(tree: LinkTree, pairs: list[tuple[str, str]], feet: tuple[str, str]) -> tuple[str, str] | None:
    legs = {n for foot in feet for n in tree.below(tree.way(foot)[1])}
    ends = [(a, b) for a, b in pairs if not tree.children(a) and a not in legs and b not in legs]
    best: tuple[float, tuple[str, str]] | None = None
    for a, b in ends:
        meet = _shared(tree, a, b)
        hands = tuple(_with_shape(tree, meet, _before_fingers(tree, meet, end)) for end in (a, b))
        ways = [tree.way(h)[tree.way(h).index(meet) :] if meet in tree.way(h) else [] for h in hands]
        if min(map(len, ways)) <= LEAST_ARM or hands[0] == hands[1]:
            continue
        length = sum(float(np.linalg.norm(tree.origin(p) - tree.origin(q))) for p, q in pairwise(ways[0]))
        if best is None or length > best[0] + 1e-6:
            best = (length, (hands[0], hands[1]))
    return None if best is None else best[1]


def _before_fingers(tree: LinkTree, meet: str, end: str) -> str:
    """The last link on the way to `end` before the arm branches or fingers begin."""
    way = tree.way(end)
    hand = way[way.index(meet) + 1]
    for link in way[way.index(meet) + 2 :]:
        siblings = tree.children(tree.links[link].parent or "")
        if len(siblings) > 1 or FINGER.search(tree.links[link].joint or ""):
            break
        hand = link
    return hand


def _with_shape(tree: LinkTree, meet: str, hand: str) -> str:
    """The hand, or the last link above it that has a shape."""
    while not any(len(tree.links[n].points) for n in tree.below(hand)):
        parent = tree.links[hand].parent
        if parent is None or parent == meet:
            break
        hand = parent
    return hand


def _shared(tree: LinkTree, a: str, b: str) -> str:
    """The last link that is on the way to both."""
    return [x for x, y in zip(tree.way(a), tree.way(b), strict=False) if x == y][-1]
