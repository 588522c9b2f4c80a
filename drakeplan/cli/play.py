"""`drakeplan play`: a plan in the browser, live or as a page."""

from __future__ import annotations

import signal
import sys
import threading
from dataclasses import dataclass
from typing import Annotated

import tyro

from drakeplan.cli.arguments import Packages
from scenes.input_error import InputError

ABOUT = """Shows a plan in the browser: terrain, robot, contacts, forces, torques, path of the centre of mass, time bar.

Without --html it serves the page on this machine alone (localhost) until Ctrl-C. With --html it writes one page that
needs no server and no network; `page.html#t=3.5` opens it stopped at 3.5 s. --beside shows a second plan at its side;
one time bar drives both.

keys: space plays and pauses, left and right go to the contact change before and after, + and - change the speed, F
follows the robot

examples:
  drakeplan play plan.h5
  drakeplan play plan.h5 --port 7010
  drakeplan play plan.h5 --html plan.html
  drakeplan play plan.h5 --beside other.h5 --html both.html"""

PORTS = (1024, 65535)


@dataclass(frozen=True)
class Arguments:
    """Arguments of `drakeplan play`."""

    plan: Annotated[str, tyro.conf.Positional, tyro.conf.arg(metavar="PLAN.h5")]
    """the plan file"""
    beside: Annotated[str | None, tyro.conf.arg(metavar="OTHER.h5")] = None
    """show this plan at the other's right"""
    robot: Annotated[str | None, tyro.conf.arg(metavar="NAME", help_behavior_hint="")] = None
    """robot name or robot file, of both plans (default: found by a plan's name and the SHA-256 of its model)"""
    package: Packages = ()
    """folder of package://NAME addresses in the robot's model; may be given several times"""
    port: Annotated[int | None, tyro.conf.arg(metavar="N")] = None
    """serve on this port (default: the first free one from 7000)"""
    html: Annotated[str | None, tyro.conf.arg(metavar="PAGE.html")] = None
    """write this page and exit; with --port, also serve the plan"""
    json: bool = False
    """one JSON object on standard output"""


def run(arguments: Arguments) -> int:
    """Writes the page, serves it, or both."""
    from drakeplan.plan.plan_file import read_plan, require_writable
    from drakeplan.plan.robot_of_plan import RobotMark, find_robot
    from scenes.files.whole_file import write_whole
    from scenes.robots.addresses import read_packages

    if arguments.port is not None and not PORTS[0] <= arguments.port <= PORTS[1]:
        raise InputError(f"--port: expected {PORTS[0]} to {PORTS[1]}, got {arguments.port}")
    if arguments.html is not None:
        require_writable(arguments.html)
    packages = read_packages(arguments.package)
    files = [arguments.plan, *([] if arguments.beside is None else [arguments.beside])]
    plans = [read_plan(file) for file in files]
    robots = [find_robot(RobotMark.of(plan), arguments.robot, packages) for plan in plans]

    from drakeplan.playback import beside_page_html, page_html

    if arguments.beside is None:
        page = page_html(plans[0], robots[0])
    else:
        page = beside_page_html((plans[0], plans[1]), (files[0], files[1]), (robots[0], robots[1]))
    if arguments.html is not None:
        write_whole(arguments.html, page.encode())
    if arguments.html is not None and arguments.port is None:
        _tell(arguments, plans[0].status, None)
        return 0

    from drakeplan.playback.server import PageServer

    over = threading.Event()
    before = {end: signal.signal(end, lambda *_: over.set()) for end in (signal.SIGINT, signal.SIGTERM)}
    server = PageServer(page, arguments.port)
    _tell(arguments, plans[0].status, server.url)
    print("serving until Ctrl-C", file=sys.stderr)
    over.wait()
    server.close()
    for end, handler in before.items():
        signal.signal(end, handler)
    return 0


def _tell(arguments: Arguments, status: str, url: str | None) -> None:
    """Where the page is, on standard output."""
    if arguments.json:
        from drakeplan.cli.output import print_json

        beside = {} if arguments.beside is None else {"beside": arguments.beside}
        print_json({"plan": arguments.plan, **beside, "status": status, "html": arguments.html, "url": url})
    else:
        print(url or arguments.html)
    sys.stdout.flush()
