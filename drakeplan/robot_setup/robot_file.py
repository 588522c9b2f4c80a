"""The robot file of a description: YAML with a comment at each value that says where it comes from."""

from __future__ import annotations

from collections.abc import Collection
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from drakeplan.robot_setup.description import Description
from scenes.effector import EFFECTORS
from scenes.files.whole_file import write_whole
from scenes.robots.schema import FrameEntry

HEADER = """# {name}, described by `drakeplan robots add`. Metres, radians, kilograms. Every value may be changed by hand;
# `drakeplan robots check {file}` tries what the robot can do with it.
# Frame T: origin at the mean of the feet, yaw the mean of their yaws (Lin 2020 eq. 3.1 without the z offset).
"""
"""Opening lines of a robot file."""


def frame_name(effector: str, bodies: Collection[str]) -> str:
    """What an end effector's contact frame is called: as the end effector, unless the model has a link of that name.

    Args:
        effector: one of `EFFECTORS`.
        bodies: names of the model's links.
    """
    return effector if effector not in bodies else f"{effector}_contact"


def frame_words(body: str, X_BE: np.ndarray) -> FrameEntry:
    """A frame as a robot file has it: position and roll, pitch, yaw, rounded to 0.1 mm and 0.1 mrad.

    Args:
        body: that it sits on.
        X_BE: (4, 4) pose in the body.
    """
    R = Rotation.from_matrix(X_BE[:3, :3])
    if abs(X_BE[2, 0]) > 1.0 - 1e-9:  # pitch of a right angle: yaw is free, and 0
        roll = np.arctan2(-X_BE[1, 2], X_BE[1, 1])
        rpy = np.array([roll, -np.sign(X_BE[2, 0]) * 0.5 * np.pi, 0.0])
    else:
        rpy = R.as_euler("xyz")
    return FrameEntry(body=body, xyz=_triple(X_BE[:3, 3]), rpy=_triple(rpy))


def _triple(values: np.ndarray) -> tuple[float, float, float]:
    x, y, z = (round(float(v), 4) + 0.0 for v in values)
    return x, y, z


def write_robot_file(description: Description, file: Path) -> None:
    """Writes the robot file, whole or not at all.

    Args:
        description: of the robot; without figures those are placeholders to measure with.
        file: to write.

    Raises:
        InputError: the file cannot be written.
    """
    write_whole(file, robot_file_text(description, file).encode())


def robot_file_text(d: Description, file: Path) -> str:
    """The text of the robot file.

    Args:
        d: what was found.
        file: where it will lie, for the comment that names it.
    """
    lines = [HEADER.format(name=d.name, file=_quoted(str(file)) if " " in str(file) else file)]
    lines += ["format: drakeplan-robot", "version: 1", f"name: {_quoted(d.name)}"]
    lines += _model(d)
    origin = "the frame above, with x ahead and z up" if d.base in d.changes.frames else "the model's root"
    lines += [f"base_body: {_quoted(d.base)}        # {origin}"]
    lines += [f"torso_body: {_quoted(d.limbs.torso)}        # {d.limbs.origin['torso']}"]
    lines += _effectors(d) + _nominal(d) + _figures(d)
    return "\n".join(lines) + "\n"


def _model(d: Description) -> list[str]:
    if d.found.package is not None:
        package = d.found.package
        folders = ", ".join(f"{_quoted(k)}: {_quoted(v)}" for k, v in package.folders.items())
        lines = ["package:", f"  distribution: {_quoted(package.distribution)}", f"  folders: {{{folders}}}"]
        lines += [f"  urdf: {_quoted(package.urdf)}"]
    else:
        lines = [f"model: {_quoted(str(d.found.file))}", "changes:"]
    lines += [
        "  # Soles: the largest rectangle on the flat of each foot. Palms: the end of each hand, where it leans on a wall."
    ]
    lines += ["  frames:"]
    for name, frame in d.changes.frames.items():
        xyz, rpy = (_numbers(v) for v in (frame.xyz, frame.rpy))
        lines.append(f"    {_quoted(name)}: {{body: {_quoted(frame.body)}, xyz: {xyz}, rpy: {rpy}}}")
    if d.changes.fixed:
        lines += [f"  # Joints that do not help to walk or lean; {d.origin['fingers']}.", "  fixed:"]
        lines += [f"    {_quoted(name)}: {angle:g}" for name, angle in d.changes.fixed.items()]
    if d.changes.collide_as_drawn:
        bodies = ", ".join(_quoted(b) for b in d.changes.collide_as_drawn)
        lines += [
            "  # Feet and hands without collision shapes take those they are drawn with.",
            f"  collide_as_drawn: [{bodies}]",
        ]
    if d.changes.one_hull:
        lines += ["  one_hull:        # a hand and its fingers are one convex shape"]
        lines += [f"    - [{', '.join(_quoted(b) for b in group)}]" for group in d.changes.one_hull]
    if d.changes.ignored_pairs:
        lines += [
            "  # Neighbours whose convex shapes overlap near the nominal posture; the limits of their joints keep them apart."
        ]
        pairs = ", ".join(f"[{_quoted(a)}, {_quoted(b)}]" for a, b in d.changes.ignored_pairs)
        lines += [f"  ignored_pairs: [{pairs}]"]
    return lines


def _effectors(d: Description) -> list[str]:
    lines = [
        "effectors:        # half_extent: along x (toes, fingers), along y; overhang of the foot beyond that: front, back, side;",
        "                  # force_limit in multiples of M g; com_reach: greatest distance of the CoM",
    ]
    f = d.figures
    frames = [n for n in d.changes.frames if n.removesuffix("_contact") in EFFECTORS]
    for e, part in enumerate([*d.soles, *(d.palms or ())]):
        foot = e < 2
        half = part.half_extent if isinstance(part.half_extent, tuple) else (part.half_extent, part.half_extent)
        force = 0.4 if f is None else (f.foot_force if foot else f.palm_force)
        reach = 2.0 if f is None else f.com_reach[0 if foot else 1]
        over = getattr(part, "overhang", (0.0, 0.0, 0.0))
        overhang = f", overhang: {_numbers(over, 3)}" if any(over) else ""
        why = d.limbs.origin.get(EFFECTORS[e], "")
        lines.append(
            f"  {EFFECTORS[e]}: {{frame: {frames[e]}, half_extent: {_numbers(half, 3)}{overhang}, force_limit: {force:g}, "
            f"com_reach: {reach:g}}}        # on {part.body}: {why}"
        )
    return lines


def _nominal(d: Description) -> list[str]:
    lines = ["nominal:          # stands balanced, knees bent, arms clear; what is not named stands at 0"]
    lines += [f"  {_quoted(name)}: {angle:g}" for name, angle in d.standing.angles.items()]
    return lines if len(lines) > 1 else ["nominal: {}"]


def _figures(d: Description) -> list[str]:
    f = d.figures
    if f is None:
        leg, side = d.standing.leg_length, 0.5 * d.standing.separation
        arm = [f"shoulder: [0, {side}, {1.5 * leg}]", f"arm_reach: [0.1, {leg}]", f"max_palm_translation: {leg}"]
        return [
            f"hip: [0, {side}, {leg}]",
            f"leg_reach: [{0.3 * leg}, {leg}]",
            f"com_height: [{0.5 * leg}, {leg}, {1.2 * leg}]",
            f"torso_box: {{centre: [0, 0, {1.3 * leg}], size: [0.2, 0.4, {leg}]}}",
            f"max_foot_translation: {leg}",
            f"max_step_height: {0.3 * leg}",
            f"foot_separation: [{side}, {2 * side}]",
            *(arm if d.palms is not None else []),
        ]
    lines = ["# Points in T."]
    if f.shoulder is not None and f.arm_reach is not None:
        lines += [f"shoulder: {_numbers(f.shoulder)}        # where the first three axes of the left arm meet"]
        lines += [
            f"arm_reach: {_numbers(f.arm_reach)}        # shoulder to palm; measured over random postures, the least is 0.3 of the most"
        ]
    lines += [
        f"hip: {_numbers(f.hip)}        # where the first three axes of the left leg meet",
        f"leg_reach: {_numbers(f.leg_reach)}        # hip to sole; measured likewise",
        f"com_height: {_numbers(f.com_height)}        # over flat feet: squatting (at least 0.55 of the next), nominal, stretched",
        f"torso_box: {{centre: {_numbers(f.torso_centre)}, size: {_numbers(f.torso_size)}}}        # trunk, head and shoulders",
        f"max_foot_translation: {f.max_foot_translation:g}        # 0.8 of the leg",
    ]
    if f.max_palm_translation is not None:
        lines += [f"max_palm_translation: {f.max_palm_translation:g}        # as a foot"]
    lines += [
        f"max_step_height: {f.max_step_height:g}        # 0.34 of the leg",
        f"foot_separation: {_numbers(f.foot_separation)}        # least without collision, and of the nominal posture",
    ]
    return lines


def _numbers(values: tuple[float, ...], digits: int = 4) -> str:
    return "[" + ", ".join(f"{round(v, digits) + 0.0:g}" for v in values) + "]"


def _quoted(text: str) -> str:
    """A YAML scalar: plain where that is safe, else in double quotes."""
    import json
    import re

    plain = re.fullmatch(r"[A-Za-z_][\w./-]*", text) and text.lower() not in (
        "yes",
        "no",
        "on",
        "off",
        "true",
        "false",
        "null",
        "y",
        "n",
    )
    return text if plain else json.dumps(text)
