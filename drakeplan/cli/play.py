"""`drakeplan play`: a plan in the browser, live or as a page."""

from __future__ import annotations

import signal
import sys
from dataclasses import dataclass
from typing import Annotated

import tyro

from drakeplan.cli.arguments import Packages
from scenes.input_error import InputError

ABOUT = """Shows a plan in the browser: terrain, robot, contacts, forces, path of the centre of mass, time slider.

Without --html it serves the plan on this machine alone (localhost) until Ctrl-C. With --html it writes one page that
needs no server and no network; `page.html#t=3.5` opens it stopped at 3.5 s.

examples:
  drakeplan play plan.h5
  drakeplan play plan.h5 --port 7010
  drakeplan play plan.h5 --html plan.html"""

PORTS = (1024, 65535)


@dataclass(frozen=True)
class Arguments:
    """Arguments of `drakeplan play`."""

    plan: Annotated[str, tyro.conf.Positional, tyro.conf.arg(metavar="PLAN.h5")]
    """the plan file"""
    robot: Annotated[str | None, tyro.conf.arg(metavar="NAME", help_behavior_hint="")] = None
    """robot name or robot file (default: found by the plan's name and the SHA-256 of its model)"""
    package: Packages = ()
    """folder of package://NAME addresses in the robot's model; may be given several times"""
    port: Annotated[int | None, tyro.conf.arg(metavar="N")] = None
    """serve on this port (default: the first free one from 7000)"""
    html: Annotated[str | None, tyro.conf.arg(metavar="PAGE.html")] = None
    """write this page and exit; with --port, also serve the plan"""
    json: bool = False
    """one JSON object on standard output"""


def run(arguments: Arguments) -> int:
    """Writes the page, serves the plan, or both."""
    from drakeplan.cli.output import print_json
    from drakeplan.plan.plan_file import read_plan, require_writable
    from drakeplan.plan.robot_of_plan import RobotMark, find_robot
    from scenes.robots.addresses import read_packages

    if arguments.port is not None and not PORTS[0] <= arguments.port <= PORTS[1]:
        raise InputError(f"--port: expected {PORTS[0]} to {PORTS[1]}, got {arguments.port}")
    if arguments.html is not None:
        require_writable(arguments.html)
    plan = read_plan(arguments.plan)
    robot = find_robot(RobotMark.of(plan), arguments.robot, read_packages(arguments.package))
    if arguments.html is not None:
        from drakeplan.playback import write_page

        write_page(plan, arguments.html, robot)
        if arguments.port is None:
            if arguments.json:
                print_json({"plan": arguments.plan, "status": plan.status, "html": arguments.html, "url": None})
            else:
                print(arguments.html)
            return 0
    from drakeplan.playback import open_meshcat, show_plan

    ends = {signal.SIGINT, signal.SIGTERM}
    before = signal.pthread_sigmask(signal.SIG_BLOCK, ends)  # for Meshcat's threads too
    meshcat = open_meshcat(arguments.port)
    show_plan(plan, meshcat, robot)
    if arguments.json:
        print_json({"plan": arguments.plan, "status": plan.status, "html": arguments.html, "url": meshcat.web_url()})
    else:
        print(meshcat.web_url())
    sys.stdout.flush()
    print("serving until Ctrl-C", file=sys.stderr)
    signal.sigwait(ends)
    signal.pthread_sigmask(signal.SIG_SETMASK, before)
    return 0
