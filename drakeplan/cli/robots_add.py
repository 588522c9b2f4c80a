"""`drakeplan robots add` and `drakeplan robots check`."""

from __future__ import annotations

import sys
import time
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from drakeplan.cli.robot_facts import robot_facts
from scenes.effector import EFFECTORS
from scenes.files.whole_file import require_writable
from scenes.robots.robot import load_robot

if TYPE_CHECKING:
    from drakeplan.robot_setup.description import Description


def add(model: str, packages: Mapping[str, Path], wanted: Mapping[str, Any], as_json: bool) -> int:
    """Describes a model and writes its robot file.

    Args:
        model: path, or PACKAGE/FILE.
        packages: folders of package:// addresses by package name.
        wanted: further arguments of `drakeplan.robot_setup.add.add_robot`.
        as_json: whether one JSON object is printed.
    """
    from drakeplan.robot_setup.add import add_robot

    began = time.perf_counter()
    added = add_robot(model, packages=packages, say=_say, **wanted)
    if as_json:
        from drakeplan.cli.output import print_json

        files = {"file": str(added.file), "picture": str(added.picture)}
        seconds = round(time.perf_counter() - began, 2)
        print_json({**robot_facts(added.robot), **files, "notes": added.description.notes, "seconds": seconds})
        return 0
    _report(added.description)
    by = added.robot.name if wanted["folder"] is None else str(added.file)
    print(f"\nwritten      {added.file}\npicture      {added.picture}")
    print(f"next         drakeplan robots check {by}\n             drakeplan plan stairs --robot {by}")
    return 0


def _say(line: str) -> None:
    print(f"  {line} ...", file=sys.stderr)


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
