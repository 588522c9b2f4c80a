"""The body that a walking robot floats on becomes the root of its URDF.

Models often begin elsewhere: a massless link that stands for the floor, a link "world" that Drake would fix to the world,
an empty link above the pelvis.
"""

from __future__ import annotations

from lxml import etree  # type: ignore[attr-defined]

from scenes.input_error import InputError
from scenes.robots.urdf_pose import inverse_origin

WORLD = "world"  # the name that Drake takes for its own world body
WELDED, FREE = "fixed", "floating"


def stand_on(base_body: str, root: etree._Element, source: str) -> None:
    """Makes `base_body` the root of the model; links above it that are empty go, others hang below it.

    Args:
        base_body: name of the link that floats.
        root: the URDF's root element, which is changed.
        source: the robot file, for errors.

    Raises:
        InputError: the link moves relative to one above it that has a mass or a shape, or has no mass itself.
    """
    if base_body == WORLD:
        raise InputError(f"{source}: base_body: {WORLD!r} stands still in Drake: name the robot's first body below it")
    links = {e.get("name"): e for e in root.findall("link")}
    above = {_end(j, "child"): j for j in root.findall("joint")}
    _check_tree(links, above, source)
    way, name = [], base_body
    while name in above:
        way.append(above[name])
        name = _end(above[name], "parent")
        if len(way) > len(links):
            raise InputError(f"{source}: the model's joints go round in a circle through {base_body!r}")
    for k, joint in enumerate(way):
        kind, parent = joint.get("type"), _end(joint, "parent")
        rest = [_end(j, "parent") for j in way[k:]]
        if all(_empty(links, above, p, way) for p in rest) and kind in (WELDED, FREE):
            for p in rest:
                if p in links:
                    root.remove(links[p])
            for j in way[k:]:
                root.remove(j)
            break
        if kind != WELDED or parent == WORLD:
            raise InputError(
                f"{source}: base_body: {base_body!r} hangs on link {parent!r} by the {kind} joint {joint.get('name')!r}, "
                f"and a robot that walks floats: name its first body, or fix that joint"
            )
        _turn_round(joint)
    _check_mass(base_body, root, source)


def _end(joint: etree._Element, tag: str) -> str:
    element = joint.find(tag)
    return "" if element is None else element.get("link", "")


def _check_tree(links: dict[str, etree._Element], above: dict[str, etree._Element], source: str) -> None:
    for child, joint in above.items():
        for name in (child, _end(joint, "parent")):
            if name not in links and name != WORLD:
                raise InputError(f"{source}: joint {joint.get('name')!r}: the model has no link {name!r}")
    roots = [name for name in links if name not in above]
    if len(roots) > 1:
        raise InputError(f"{source}: links {roots[0]!r} and {roots[1]!r} hang on nothing: a robot has one root")


def _empty(
    links: dict[str, etree._Element], above: dict[str, etree._Element], name: str, way: list[etree._Element]
) -> bool:
    """Whether a link above the base has no mass, no shape and no other child."""
    children = [j for j in above.values() if _end(j, "parent") == name and j not in way]
    link = links.get(name)
    return not children and (link is None or all(link.find(tag) is None for tag in ("inertial", "collision", "visual")))


def _turn_round(joint: etree._Element) -> None:
    """Makes a fixed joint's child its parent."""
    parent, child = joint.find("parent"), joint.find("child")
    a, b = parent.get("link"), child.get("link")
    parent.set("link", b)
    child.set("link", a)
    origin = inverse_origin(joint)
    for old in joint.findall("origin"):
        joint.remove(old)
    joint.insert(0, origin)


def _check_mass(base_body: str, root: etree._Element, source: str) -> None:
    """The base or something welded to it needs a mass: Drake cannot move a massless body freely."""
    welded, waiting = {base_body}, [base_body]
    while waiting:
        name = waiting.pop()
        for joint in root.findall("joint"):
            ends = _end(joint, "parent"), _end(joint, "child")
            if joint.get("type") == WELDED and name in ends:
                new = set(ends) - welded
                welded |= new
                waiting += new
    masses = (link.find("inertial/mass") for link in root.findall("link") if link.get("name") in welded)
    if not any(mass is not None and float(mass.get("value", "0")) > 0.0 for mass in masses):
        raise InputError(f"{source}: base_body: {base_body!r} has no mass: name the body that carries the legs")
