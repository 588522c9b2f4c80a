"""`drakeplan robots add` and `drakeplan robots check`."""

from __future__ import annotations

import re
import sys
import time
from pathlib import Path
from typing import TYPE_CHECKING

from scenes.effector import EFFECTORS
from scenes.files.whole_file import require_writable
from scenes.input_error import InputError
from scenes.robots.addresses import read_packages
from scenes.robots.robot import ROBOTS, load_robot, own_robots_folder

if TYPE_CHECKING:
    from drakeplan.cli.robots import Arguments
    from drakeplan.robot_setup.describe import Description


def add(arguments: Arguments) -> int:
    """Describes a model and writes its robot file."""
    from drakeplan.robot_setup.model_source import find_model_source

    found = find_model_source(arguments.robot, read_packages(arguments.package))
    name = _name(arguments, found.file)
    folder = _folder(arguments, name)
    file = folder / f"{name}.yaml"
    picture = Path(arguments.picture) if arguments.picture is not None else folder / f"{name}.png"
    require_writable(picture)
    from drakeplan.robot_setup.describe import describe_robot
    from drakeplan.robot_setup.pictures import write_pictures
    from drakeplan.robot_setup.robot_file import write_robot_file

    given = {e: link for e in EFFECTORS if (link := getattr(arguments, e)) is not None}
    began = time.perf_counter()
    description = describe_robot(found, name, given, seed=arguments.seed, say=_say)
    write_robot_file(description, file)
    robot = load_robot(file, found.packages)
    _say("draw")
    write_pictures(robot, picture)
    seconds = time.perf_counter() - began
    wanted = arguments.name or name
    if arguments.json:
        from drakeplan.cli.output import print_json
        from drakeplan.cli.robots import robot_facts

        print_json(
            {
                **robot_facts(robot),
                "file": str(file),
                "picture": str(picture),
                "notes": description.notes,
                "seconds": round(seconds, 2),
            }
        )
        return 0
    _report(description)
    by = wanted if arguments.out is None else str(file)
    print(f"\nwritten      {file}\npicture      {picture}")
    print(f"next         drakeplan robots check {by}\n             drakeplan plan stairs --robot {by}")
    return 0


def _say(line: str) -> None:
    print(f"  {line} ...", file=sys.stderr)


def _name(arguments: Arguments, model: Path) -> str:
    name = (
        arguments.name if arguments.name is not None else re.sub(r"[^\w.+-]+", "_", model.stem).strip("_.") or "robot"
    )
    if not re.fullmatch(r"\w[\w .+-]{0,63}", name):
        raise InputError(
            f"--name {name}: expected letters, digits, spaces and . + - _, at most 64, the first a letter or digit"
        )
    if (ROBOTS / name / f"{name}.yaml").is_file() and arguments.out is None:
        raise InputError(f"--name {name}: a robot of this name comes with drakeplan: choose another")
    return name


def _folder(arguments: Arguments, name: str) -> Path:
    folder = Path(arguments.out).expanduser() if arguments.out is not None else own_robots_folder() / name
    file = folder / f"{name}.yaml"
    if file.exists() and not arguments.replace:
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


def check(arguments: Arguments) -> int:
    """Asks what a robot can do; 0 when it can do all of it, else 1."""
    if arguments.picture is not None:
        require_writable(arguments.picture)
    robot = load_robot(arguments.robot, read_packages(arguments.package))
    from drakeplan.robot_setup.check import check_robot

    if arguments.picture is not None:
        from drakeplan.robot_setup.pictures import write_pictures

        write_pictures(robot, arguments.picture)
    findings = []
    for finding in check_robot(robot, seed=arguments.seed, say=_say):
        findings.append(finding)
        if not arguments.json:
            print(f"{finding.name:<8} {'yes' if finding.ok else 'NO':<4} {finding.says}", flush=True)
            if not finding.ok and finding.keys:
                print(f"{'':<13} look at {', '.join(finding.keys)} in {robot.source}")
    able = all(f.ok for f in findings)
    if arguments.json:
        from drakeplan.cli.output import print_json

        print_json(
            {
                "robot": robot.name,
                "ok": able,
                "findings": [{"name": f.name, "ok": f.ok, "says": f.says, "keys": list(f.keys)} for f in findings],
            }
        )
    return 0 if able else 1
