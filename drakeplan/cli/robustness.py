"""`drakeplan robustness`: how likely a plan is to arrive under pushes."""

from __future__ import annotations

import shutil
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import tyro

from drakeplan.cli.arguments import Packages, Triples
from scenes.input_error import InputError

if TYPE_CHECKING:
    from drakeplan.plan.plan import Plan
    from drakeplan.robustness.report import RobustnessReport
    from scenes.disturbance import Disturbance
    from scenes.robots.robot import Robot

TASK_TIMEOUT = 600.0  # [s] of the few moments that a worker tries in a row
ABOUT = """Tries every push of the scene at every 0.1 s of a plan, and says how likely the robot is to arrive without a fall.

A push is an instant change of the robot's momentum. First the robot tries to come to rest with the contacts it holds, then
with one new contact of a foot or a palm, the likeliest first, by a whole-body program. What captures was checked; what does not
is no proof that nothing would.
Pushes come from the scene (`disturbances`), from another one (--scene), or from --impulse.
--out writes the plan with what was found; its page then shows when the plan is at risk and which contact would save it.
A stopped evaluation goes on where it was when the same command is given again.

examples:
  drakeplan robustness plan.h5
  drakeplan robustness plan.h5 --out tried.h5 --html tried.html
  drakeplan robustness plan.h5 --impulse 0 30 0 0 -30 0 --pairs 0.2 --json
  drakeplan robustness plan.h5 --map ground.png

exit status: 0 done, 2 the plan cannot be read, has no motion, or there are no pushes"""


@dataclass(frozen=True)
class Arguments:
    """Arguments of `drakeplan robustness`."""

    plan: Annotated[str, tyro.conf.Positional, tyro.conf.arg(metavar="PLAN.h5")]
    """the plan file"""
    scene: Annotated[str | None, tyro.conf.arg(metavar="SCENE", help_behavior_hint="")] = None
    """scene whose pushes are tried (default: the plan's own)"""
    impulse: Annotated[Triples, tyro.conf.arg(metavar="X Y Z", help_behavior_hint="")] = ()
    """a push [kg m/s] in place of the scene's, everywhere; X Y Z X Y Z gives two"""
    probability: Annotated[float, tyro.conf.arg(metavar="P")] = 0.01
    """of --impulse: that one of them happens within 0.1 s"""
    samples: Annotated[int, tyro.conf.arg(metavar="N")] = 10
    """capture contacts that are tried for each push, the likeliest first"""
    pairs: Annotated[float, tyro.conf.arg(metavar="SHARE")] = 1.0
    """share of moments and pushes that is tried, drawn at random; below 1 the result has an interval"""
    no_palms: bool = False
    """palms may not catch the robot"""
    seed: Annotated[int, tyro.conf.arg(metavar="N")] = 0
    """of what --pairs draws"""
    workers: Annotated[int, tyro.conf.arg(metavar="N")] = 2
    """processes on this machine"""
    robot: Annotated[str | None, tyro.conf.arg(metavar="NAME", help_behavior_hint="")] = None
    """robot name or robot file (default: found by the plan's name and the SHA-256 of its model)"""
    package: Packages = ()
    """folder of package://NAME addresses in the robot's model; may be given several times"""
    out: Annotated[str | None, tyro.conf.arg(metavar="PLAN2.h5", help_behavior_hint="")] = None
    """write the plan with what was found"""
    html: Annotated[str | None, tyro.conf.arg(metavar="PAGE.html", help_behavior_hint="")] = None
    """write a page that plays it"""
    map: Annotated[str | None, tyro.conf.arg(metavar="PICTURE.png", help_behavior_hint="")] = None
    """draw the greatest push that each foothold of the plan survives, as the networks see it"""
    json: bool = False
    """one JSON object on standard output"""


def run(arguments: Arguments) -> int:
    """Tries the pushes and says what came of them."""
    _check(arguments)
    from drakeplan.plan.plan_file import read_plan, require_writable, write_plan
    from drakeplan.plan.robot_of_plan import RobotMark, find_robot
    from scenes.robots.addresses import read_packages

    outputs = [path for path in (arguments.out, arguments.html, arguments.map) if path is not None]
    for path in outputs:
        require_writable(path)
    if len({Path(path).resolve() for path in outputs}) < len(outputs):
        raise InputError("two of --out, --html and --map name the same file")
    plan = read_plan(arguments.plan)
    if plan.centroidal is None:
        raise InputError(f"{arguments.plan}: a plan of contacts only: it has no states that could be pushed")
    packages = read_packages(arguments.package)
    robot = find_robot(RobotMark.of(plan), arguments.robot, packages)
    disturbances = _disturbances(arguments, plan)
    report = try_pushes(arguments, plan, robot, disturbances)
    tried = replace(plan, robustness=report.found)
    files: dict[str, str] = {}
    if arguments.out is not None:
        write_plan(tried, arguments.out)
        files["plan"] = arguments.out
    if arguments.html is not None:
        from drakeplan.playback import write_page

        write_page(tried, arguments.html, robot)
        files["html"] = arguments.html
    if arguments.map is not None:
        from drakeplan.robustness.push_map import draw_push_map

        draw_push_map(plan, robot, arguments.map, palms=not arguments.no_palms)
        files["map"] = arguments.map
    if arguments.json:
        from drakeplan.cli.output import print_json

        print_json({"plan": arguments.plan, **report.as_dict(), "files": files})
    else:
        print(report.text())
        for name, path in files.items():
            print(f"  {name:<10}{path}")
    return 0


def try_pushes(
    arguments: Arguments, plan: Plan, robot: Robot, disturbances: tuple[Disturbance, ...]
) -> RobustnessReport:
    """All pushes, by several processes, with a progress bar; what is done is kept until all is.

    Args:
        arguments: of the command.
        plan: with dynamics.
        robot: of the plan.
        disturbances: what may push it.
    """
    from drakeplan.campaigns.engine import CollectOptions
    from drakeplan.campaigns.push_trials import PushTrialsCampaign, file_sha256, read_trials, region_of
    from drakeplan.cli.campaign_bar import Crew, collect_aloud
    from drakeplan.robustness.moments import moments_of
    from drakeplan.robustness.report import report_of
    from scenes.robots.addresses import read_packages

    packages = tuple((name, str(place)) for name, place in read_packages(arguments.package).items())
    campaign = PushTrialsCampaign(
        str(Path(arguments.plan).resolve()),
        file_sha256(arguments.plan),
        str(robot.source) if robot.given_by_path else robot.name,
        tuple(region_of(d) for d in disturbances),
        arguments.samples,
        arguments.pairs,
        not arguments.no_palms,
        packages,
    )
    folder = Path(f"{arguments.out or arguments.plan}.pushes-{campaign.mark(arguments.seed)}")
    options = CollectOptions(campaign.num_tasks(), arguments.seed, tasks_per_shard=1)
    crew = Crew(arguments.workers, None, TASK_TIMEOUT)
    card = collect_aloud(
        campaign, str(folder), options, crew, rows="pushes", resume=True, unit="block", again="the same command"
    )
    if card.quarantined:
        raise InputError(
            f"{arguments.plan}: some moments could not be tried: {card.quarantined[0]}; remove {folder} to try them again"
        )
    rows = read_trials(folder)
    if not len(rows["moment"]) and arguments.pairs < 1.0:
        shutil.rmtree(folder)
        raise InputError(f"--pairs {arguments.pairs:g}: draws no push of this plan: give a larger share")
    report = report_of(moments_of(plan), rows, campaign.parameters, arguments.pairs)
    shutil.rmtree(folder)
    return report


def _disturbances(arguments: Arguments, plan: Plan) -> tuple[Disturbance, ...]:
    """What may push the robot: of the command, of another scene, or of the plan's."""
    import numpy as np

    from scenes.disturbance import Disturbance
    from scenes.files.scene_file import scene_from_yaml

    if arguments.impulse:
        return (Disturbance(np.array(arguments.impulse), arguments.probability),)
    if arguments.scene is not None:
        from drakeplan.cli.output import read_scene_aloud

        scene = read_scene_aloud(arguments.scene, 0)
    else:
        scene = scene_from_yaml(plan.scene_yaml, f"plan of {plan.scene_name}", mesh_triangles=plan.triangles)
    if not scene.disturbances:
        raise InputError(f"scene {scene.name} has no pushes: add `disturbances` to its file, or give --impulse X Y Z")
    return scene.disturbances


def _check(arguments: Arguments) -> None:
    """Raises InputError for a number that cannot be."""
    for name, least in (("samples", 0), ("seed", 0), ("workers", 1)):
        if getattr(arguments, name) < least:
            raise InputError(f"--{name}: expected {least} or more, got {getattr(arguments, name)}")
    if not 0.0 < arguments.pairs <= 1.0:
        raise InputError(f"--pairs: expected a share above 0 and at most 1, got {arguments.pairs:g}")
    if not 0.0 <= arguments.probability <= 1.0:
        raise InputError(f"--probability: expected 0 to 1, got {arguments.probability:g}")
    for impulse in arguments.impulse:
        if not all(abs(value) <= 1000.0 for value in impulse):
            raise InputError("--impulse: expected three numbers X Y Z, at most 1000 kg m/s each")
