"""`drakeplan robots add` and `drakeplan robots check`."""

from __future__ import annotations

import re
import sys
import time
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from drakeplan.cli.robot_facts import robot_facts
from scenes.effector import EFFECTORS
from scenes.files.whole_file import require_writable
from scenes.input_error import InputError
from scenes.robots.robot import ROBOTS, load_robot, own_robots_folder

if TYPE_CHECKING:
    from drakeplan.robot_setup.description import Description


@dataclass(frozen=True)
class Wanted:
    """What a user may choose about a robot to add.

    Attributes:
        name: of the robot; None for the model file's.
        out: folder of the robot file; None for the user's data folder.
        picture: PNG file; None for one beside the robot file.
        links: effector -> link, of those that the user names.
        replace: whether a robot file that is there is replaced.
    """

    name: str | None
    out: str | None
    picture: str | None
    links: Mapping[str, str]
    replace: bool


def add(model: str, packages: Mapping[str, Path], wanted: Wanted, seed: int, as_json: bool) -> int:
    """Describes a model and writes its robot file.

    Args:
        model: path, or PACKAGE/FILE.
        packages: folders of package:// addresses by package name.
        wanted: what the user chooses.
        seed: of random postures.
        as_json: whether one JSON object is printed.
    """
    from drakeplan.robot_setup.model_source import find_model_source

    found = find_model_source(model, packages)
    name = _name(wanted, found.file)
    folder = _folder(wanted, name)
    file = folder / f"{name}.yaml"
    picture = Path(wanted.picture) if wanted.picture is not None else folder / f"{name}.png"
    require_writable(picture)
    from drakeplan.robot_setup.describe import describe_robot
    from drakeplan.robot_setup.pictures import write_pictures
    from drakeplan.robot_setup.robot_file import write_robot_file

    began = time.perf_counter()
    description = describe_robot(found, name, wanted.links, seed=seed, say=_say)
    write_robot_file(description, file)
    robot = load_robot(file, packages)
    _say("draw")
    write_pictures(robot, picture)
    if as_json:
        from drakeplan.cli.output import print_json

        files = {"file": str(file), "picture": str(picture)}
        seconds = round(time.perf_counter() - began, 2)
        print_json({**robot_facts(robot), **files, "notes": description.notes, "seconds": seconds})
        return 0
    _report(description)
    by = name if wanted.out is None else str(file)
    print(f"\nwritten      {file}\npicture      {picture}")
    print(f"next         drakeplan robots check {by}\n             drakeplan plan stairs --robot {by}")
    return 0


def _say(line: str) -> None:
    print(f"  {line} ...", file=sys.stderr)


def _name(wanted: Wanted, model: Path) -> str:
    name = wanted.name
    if name is None:
        name = re.sub(r"[^\w.+-]+", "_", model.stem).strip("_.") or "robot"
    if not re.fullmatch(r"\w[\w .+-]{0,63}", name):
        raise InputError(
            f"--name {name}: expected letters, digits, spaces and . + - _, at most 64, the first a letter or digit"
        )
    if (ROBOTS / name / f"{name}.yaml").is_file() and wanted.out is None:
        raise InputError(f"--name {name}: a robot of this name comes with drakeplan: choose another")
    return name


def _folder(wanted: Wanted, name: str) -> Path:
    folder = Path(wanted.out).expanduser() if wanted.out is not None else own_robots_folder() / name
    file = folder / f"{name}.yaml"
    if file.exists() and not wanted.replace:
        raise InputError(f"{file}: there is a robot of this name: add --replace, or choose another --name")
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(f"{folder}: cannot be made ({error.strerror}): choose a folder with --out DIR") from None
    require_writable(file)
    return folder


def _report(d: Description) -> None:
    """What was found, and from where."""
    f = d.figures
    assert f is not None
    print(f"robot        {d.name}, {d.mass:.1f} kg, from {d.found.file}")
    print(f"base         {d.base}")
    print(f"torso        {d.limbs.torso}: {d.limbs.origin['torso']}")
    parts = [*d.soles, *(d.palms or ())]
    for effector, part in zip(EFFECTORS, parts, strict=False):
        half = part.half_extent if isinstance(part.half_extent, tuple) else (part.half_extent, part.half_extent)
        size = " x ".join(f"{2e3 * v:.0f}" for v in half)
        print(f"{effector.replace('_', ' '):<12} {part.body}, {size} mm: {d.limbs.origin.get(effector, '')}")
    print(f"stands       CoM {f.com_height[1]:.2f} m high, feet {f.foot_separation[1]:.2f} m apart")
    low, high = f.leg_reach
    print(
        f"legs         reach {low:.2f} to {high:.2f} m, steps to {f.max_foot_translation:g} m, {f.max_step_height:g} m high"
    )
    if f.arm_reach is not None:
        print(f"arms         reach {f.arm_reach[0]:.2f} to {f.arm_reach[1]:.2f} m")
    if d.changes.fixed:
        print(f"held still   {len(d.changes.fixed)} joints, of head and fingers; {d.origin['fingers']}")
    if d.changes.ignored_pairs:
        pairs = ", ".join(f"{a} + {b}" for a, b in d.changes.ignored_pairs)
        print(f"may touch    {pairs}")
    for note in d.notes:
        print(f"note         {note}")


def check(name: str, packages: Mapping[str, Path], picture: str | None, seed: int, as_json: bool) -> int:
    """Asks what a robot can do; 0 when it can do all of it, else 1.

    Args:
        name: of the robot, or its robot file.
        packages: folders of package:// addresses by package name.
        picture: PNG file to draw the robot in; None for none.
        seed: of the crossings.
        as_json: whether one JSON object is printed.
    """
    if picture is not None:
        require_writable(picture)
    robot = load_robot(name, packages)
    from drakeplan.robot_setup.check import check_robot

    if picture is not None:
        from drakeplan.robot_setup.pictures import write_pictures

        write_pictures(robot, picture)
    findings = []
    for finding in check_robot(robot, seed=seed, say=_say):
        findings.append(finding)
        if not as_json:
            print(f"{finding.name:<8} {'yes' if finding.ok else 'NO':<4} {finding.says}", flush=True)
            if not finding.ok and finding.keys:
                print(f"{'':<13} look at {', '.join(finding.keys)} in {robot.source}")
    able = all(f.ok for f in findings)
    if as_json:
        from drakeplan.cli.output import print_json

        print_json(
            {
                "robot": robot.name,
                "ok": able,
                "findings": [{"name": f.name, "ok": f.ok, "says": f.says, "keys": list(f.keys)} for f in findings],
            }
        )
    return 0 if able else 1
