"""`drakeplan library`: plans to retrieve and adapt."""

from __future__ import annotations

import sys
from collections import Counter
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import tyro

from drakeplan.cli.arguments import Packages
from scenes.input_error import InputError

if TYPE_CHECKING:
    from drakeplan.experience.library import Library
    from drakeplan.experience.retrieval import Candidate

ABOUT = """Builds a library of plans, adds plans to one, lists it, or says which of its plans fit a scene.

A library is a folder: a file of about 20 KB for each plan and an index. `drakeplan plan SCENE --planner adapt --library DIR`
uses it. Without --library these commands mean the one that comes with the robot, which cannot be changed.

build plans in random environments with the search, in some seconds each. Its data lie in DIR/campaign until all plans are
added; Ctrl-C loses at most eight environments a worker, --resume goes on.
add takes plan files of any planner; one that is nearly the same as a stored plan is left out.

examples:
  drakeplan library build --library plans --count 40
  drakeplan library build --library plans --count 400 --workers 2 --resume
  drakeplan library add plan.h5 other.h5 --library plans
  drakeplan library list --library plans
  drakeplan library match random_surfaces --seed 3"""
SHOWN = 10  # plans that match prints
TASK_TIMEOUT = 1200.0  # [s] of one environment


@dataclass(frozen=True)
class Arguments:
    """Arguments of `drakeplan library`."""

    action: Annotated[
        Literal["build", "add", "list", "match"],
        tyro.conf.Positional,
        tyro.conf.arg(metavar="build|add|list|match"),
    ]
    """what to do"""
    what: Annotated[tuple[str, ...], tyro.conf.Positional, tyro.conf.arg(metavar="[PLAN.h5 ... | SCENE]")] = ()
    """with add: plan files; with match: a scene"""
    library: Annotated[str, tyro.conf.arg(metavar="DIR")] = ""
    """folder of the library (default: the one that comes with the robot)"""
    robot: Annotated[str, tyro.conf.arg(metavar="NAME")] = "escher"
    """robot name or robot file"""
    package: Packages = ()
    """folder of package://NAME addresses in the robot's model; may be given several times"""
    count: int = 0
    """with build: total number of environments"""
    most: Annotated[int | None, tyro.conf.arg(metavar="N", help_behavior_hint="")] = None
    """with build: plans of each motion mode at most (default: all)"""
    friction: Annotated[float, tyro.conf.arg(metavar="MU")] = 0.5
    """with build: of every surface"""
    workers: int = 1
    """with build: processes on this machine"""
    cluster: Annotated[str | None, tyro.conf.arg(metavar="ADDRESS", help_behavior_hint="")] = None
    """with build: dask scheduler whose workers are used instead (extra `cluster`)"""
    resume: bool = False
    """with build: go on with the campaign in the library's folder"""
    seed: int = 0
    """with build: of all random numbers; with match: of random scenes"""
    json: bool = False
    """one JSON object on standard output"""


def run(arguments: Arguments) -> int:
    """Does what `action` says."""
    if arguments.action in ("build", "list") and arguments.what:
        raise InputError(f"drakeplan library {arguments.action}: unexpected argument {arguments.what[0]!r}")
    if arguments.action in ("build", "add") and not arguments.library:
        raise InputError("--library: expected the folder of the library that plans are added to")
    return {"build": _build, "add": _add, "list": _list, "match": _match}[arguments.action](arguments)


def _build(arguments: Arguments) -> int:
    from drakeplan.campaigns.engine import CollectOptions
    from drakeplan.campaigns.library_build import add_campaign
    from drakeplan.campaigns.stored_plans import PlansCampaign
    from drakeplan.cli.campaign_bar import Crew, collect_aloud
    from drakeplan.experience.library import Library
    from drakeplan.query.options import MOST_FRICTION
    from scenes.robots.addresses import read_packages
    from scenes.robots.robot import load_robot

    for name, least in (("count", 1), ("workers", 1), ("seed", 0)):
        if getattr(arguments, name) < least:
            raise InputError(f"--{name}: expected {least} or more, got {getattr(arguments, name)}")
    if arguments.most is not None and arguments.most < 1:
        raise InputError(f"--most: expected 1 or more, got {arguments.most}")
    if not 0 < arguments.friction <= MOST_FRICTION:
        raise InputError(f"--friction: expected more than 0, at most {MOST_FRICTION:g}, got {arguments.friction:g}")
    packages = read_packages(arguments.package)
    library = Library.create(arguments.library, load_robot(arguments.robot, packages))
    campaign = PlansCampaign(
        arguments.robot, arguments.friction, packages=tuple((n, str(folder)) for n, folder in packages.items())
    )
    folder = str(Path(arguments.library) / "campaign")
    options = CollectOptions(arguments.count, arguments.seed)
    crew = Crew(arguments.workers, arguments.cluster, TASK_TIMEOUT)
    card = collect_aloud(campaign, folder, options, crew, rows="plans", resume=arguments.resume)
    report = add_campaign(library, folder, card, arguments.most)
    if arguments.json:
        from drakeplan.cli.output import print_json

        print_json({"status": "built", "folder": arguments.library, **asdict(report)})
    else:
        print(f"{report.plans} verified plans of {report.environments} environments; {report.added} added, "
              f"{report.alike} left out: stored already, or nearly the same"
              + (f"; {report.spare} not needed" if report.spare else ""))  # fmt: skip
        _print_modes(library)
    return 0


def _add(arguments: Arguments) -> int:
    from drakeplan.experience.library import Library
    from drakeplan.experience.stored_plan import store_plan
    from drakeplan.plan.plan_file import read_plan
    from drakeplan.plan.robot_of_plan import RobotMark, find_robot

    if not arguments.what:
        raise InputError("drakeplan library add: expected one plan file or more")
    plans = [(file, read_plan(file)) for file in arguments.what]  # all are read before anything is added
    stored = []
    for file, plan in plans:
        try:
            stored.append((file, store_plan(plan)))
        except InputError as error:
            raise InputError(f"{file}: {error}") from None
    if not Library.is_at(arguments.library):
        Library.create(arguments.library, find_robot(RobotMark.of(plans[0][1])))
    library = Library(arguments.library)
    additions = [(file, library.add(plan)) for file, plan in stored]
    if arguments.json:
        from drakeplan.cli.output import print_json

        rows = [{"file": file, **asdict(addition)} for file, addition in additions]
        print_json({"status": "added", "folder": arguments.library, "plans": rows})
        return 0
    for file, addition in additions:
        what = f"added as {addition.name}" if addition.added else f"left out: {addition.name} is as good as the same"
        far = f" ({addition.distance:.2f} m from the nearest)" if addition.distance < float("inf") else ""
        print(f"{file}: {what}{far}")
    return 0


def _list(arguments: Arguments) -> int:
    from drakeplan.experience.library import MODES, clusters

    library = _open(arguments)
    if not arguments.json:
        _print_modes(library)
        return 0
    from drakeplan.cli.output import print_json

    modes = {}
    for mode in MODES:
        entries = library.entries(mode)
        modes[mode] = {
            "plans": [{"name": e.name, "length": e.length, "cluster": e.cluster} for e in entries],
            "representatives": [entries[group[0]].name for group in clusters(entries)],
        }
    print_json({"folder": str(library.path), "robot": library.robot, "modes": modes, "facts": library.facts})
    return 0


def _match(arguments: Arguments) -> int:
    """Which plans would be tried on a scene, in this order."""
    import itertools

    import numpy as np

    from drakeplan.cli.output import print_json, read_scene_aloud
    from drakeplan.context import QueryContext
    from drakeplan.experience.adapt_planner import PIECE_RADIUS
    from drakeplan.experience.retrieval import candidates, usable_modes
    from drakeplan.experience.terrain_regions import TURN, TerrainRegions
    from drakeplan.experience.way import next_place, torso_way
    from optimization.inverse_kinematics.whole_body_ik import WholeBodyIK
    from scenes.robots.addresses import read_packages
    from scenes.robots.robot import load_robot

    if len(arguments.what) != 1:
        raise InputError("drakeplan library match: expected one scene")
    robot = load_robot(arguments.robot, read_packages(arguments.package))
    library = _open(arguments)
    context = QueryContext(read_scene_aloud(arguments.what[0], arguments.seed), robot, WholeBodyIK(robot))
    feet = np.array([c.p_WC for c in context.start.contacts[:2] if c is not None])
    place, is_last = next_place(context, torso_way(context), feet.mean(axis=0))
    radius = context.goal.radius if is_last else PIECE_RADIUS
    entries = [entry for mode in usable_modes(context, True) for entry in library.entries(mode)]
    table = TerrainRegions(context, feet, place, TURN).table(True)
    found = list(itertools.islice(candidates(entries, table, feet, place, radius), SHOWN))
    if arguments.json:
        rows = [_facts(c) for c in found]
        facts = {"scene": arguments.what[0], "folder": str(library.path), "to": place.tolist(), "is_goal": is_last}
        print_json({**facts, "plans": rows})
        return 0
    if not is_last:
        print(f"the way bends: plans for its first piece, to ({place[0]:.2f}, {place[1]:.2f})")
    if not found:
        print("no stored plan leads from the start towards the goal")
        return 0
    print("plan              mode        length m  leads  distance m  worst contact m")
    for c in found:
        leads = "all" if c.reaches else "part"
        print(
            f"{c.entry.name}  {c.entry.mode:<10}  {c.entry.length:8.2f}  {leads:<5}  {c.distance:10.3f}  {c.worst:15.3f}"
        )
    return 0


def _facts(candidate: Candidate) -> dict[str, object]:
    entry = candidate.entry
    return {"name": entry.name, "mode": entry.mode, "length": entry.length, "reaches": candidate.reaches,
            "distance": candidate.distance, "worst": candidate.worst}  # fmt: skip


def _open(arguments: Arguments) -> Library:
    """The library that was named, or the one of the robot; damaged files are said."""
    from drakeplan.experience.library import Library
    from drakeplan.experience.shipped import library_folder
    from scenes.robots.addresses import read_packages
    from scenes.robots.robot import load_robot

    robot = load_robot(arguments.robot, read_packages(arguments.package))
    library = Library(library_folder(robot, arguments.library), robot)
    for note in library.notes:
        print(f"note: {note}", file=sys.stderr)
    return library


def _print_modes(library: Library) -> None:
    from drakeplan.experience.library import MODES, clusters

    print(f"{library.path}: {len(library)} plans of {library.robot}")
    for mode in MODES:
        entries = library.entries(mode)
        if entries:
            sizes = Counter(entry.cluster for entry in entries)
            longest = max(entry.length for entry in entries)
            print(f"  {mode:<10}  {len(entries):4d} plans in {len(clusters(entries)):3d} clusters of up to "
                  f"{max(sizes.values())}, up to {longest:.1f} m")  # fmt: skip
