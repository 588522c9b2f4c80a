"""`drakeplan collect`: gathers labels for surrogates, with as many workers as there are."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated, Literal

import tyro

from drakeplan.cli.arguments import Packages
from scenes.input_error import InputError, unknown_name

if TYPE_CHECKING:
    from drakeplan.campaigns.braced_wall import BracedWallCampaign
    from drakeplan.campaigns.capture import CaptureCampaign
    from drakeplan.campaigns.card import Card
    from drakeplan.campaigns.dynamics import DynamicsCampaign
    from drakeplan.campaigns.motions import MotionsCampaign
    from drakeplan.campaigns.traversability import TraversabilityCampaign

CAMPAIGNS = {
    "dynamics": "what the centroidal program says of contact transitions, in random tilted environments",
    "capture": "whether a pushed robot comes to rest, where it stands or with one new contact",
    "motions": "verified whole-body motions on random terrain, with contacts and forces: data to train tracking policies with",
    "traversability": "from how many pairs of feet about a torso pose the search steps on, in such environments",
}
NAMES = "\n".join(f"  {name:<14}  {about}" for name, about in CAMPAIGNS.items())
ABOUT = f"""Gathers training data for surrogates into a folder of Parquet shards.

The same seed gives the same rows for any number of workers. A killed campaign continues with --resume; its files are
the same bit for bit. A larger --count with --resume adds to what is there.

dynamics: an environment gives up to 20 labels of each transition category, about 155 in total, in some seconds of work; 1700
give 20 000 of each. With --shift 0.6 --swing 0.4 --feet-only they are those that planning against pushes walks by (--capture).
capture: a task asks 32 questions of each capture motion in 8 s; 625 give 20 000 of each. traversability: an environment gives
144 labels of each motion mode, in half a second with fixed footholds and in some seconds else; 140 give 20 000 of each.
motions: a task is one query, of some seconds; seven kinds of terrain in turn. A task without a verified motion has a row that says why.

campaigns:
{NAMES}

examples:
  drakeplan collect dynamics --count 4 --out labels
  drakeplan collect dynamics --count 1700 --out labels --workers 2 --resume
  drakeplan collect dynamics --count 8500 --out labels --cluster tcp://head:8786
  drakeplan collect dynamics --count 700 --shift 0.6 --swing 0.4 --feet-only --out walking
  drakeplan collect capture --count 1600 --out captures --workers 2
  drakeplan collect motions --robot g1 --count 1000 --out motions --workers 2
  drakeplan collect traversability --count 1500 --out footsteps --workers 2
  drakeplan collect traversability --count 1500 --footholds fixed --out documented"""


@dataclass(frozen=True)
class Arguments:
    """Arguments of `drakeplan collect`."""

    campaign: Annotated[str, tyro.conf.Positional, tyro.conf.arg(metavar="CAMPAIGN")]
    """what to collect"""
    count: int = 0
    """total number of environments, of capture: of tasks (required)"""
    out: Annotated[str, tyro.conf.arg(metavar="DIR")] = ""
    """folder for the data (required)"""
    workers: int = 2
    """processes on this machine"""
    cluster: Annotated[str | None, tyro.conf.arg(metavar="ADDRESS")] = None
    """dask scheduler whose workers are used instead (extra `cluster`)"""
    seed: int = 0
    """of all random numbers"""
    robot: Annotated[str, tyro.conf.arg(metavar="NAME")] = "escher"
    """robot name or robot file; traversability also knows bracer: palms on walls, in fixed steps"""
    package: Packages = ()
    """folder of package://NAME addresses in the robot's model; may be given several times"""
    friction: Annotated[float, tyro.conf.arg(metavar="MU")] = 0.5
    """of every surface"""
    footholds: Literal["snapped", "fixed"] = "snapped"
    """of traversability: whether feet and palms move to the nearest foothold, or are lost as in Lin & Berenson 2017"""
    shift: float = 1.0
    """of dynamics: time in which the CoM shifts before each step [s]"""
    swing: float = 1.0
    """of dynamics: time in which a foot or palm moves [s]"""
    feet_only: bool = False
    """of dynamics: no palms, and all labels of an environment from steps"""
    task_timeout: Annotated[float, tyro.conf.arg(metavar="S")] = 600.0
    """time limit of one environment [s]; an environment that exceeds it is set aside (quarantine)"""
    resume: bool = False
    """continue the campaign in the folder"""
    json: bool = False
    """one JSON object on standard output"""


def run(arguments: Arguments) -> int:
    """Collects, with a progress bar, and says what came out."""
    _check(arguments)
    from drakeplan.campaigns.engine import CollectOptions
    from drakeplan.cli.campaign_bar import Crew, collect_aloud

    options = CollectOptions(arguments.count, arguments.seed)
    crew = Crew(arguments.workers, arguments.cluster, arguments.task_timeout)
    card = collect_aloud(
        _campaign(arguments),
        arguments.out,
        options,
        crew,
        rows="motions" if arguments.campaign == "motions" else "labels",
        resume=arguments.resume,
    )
    _report(card, arguments)
    return 0


def _check(arguments: Arguments) -> None:
    from drakeplan.query.options import MOST_FRICTION

    if arguments.campaign not in CAMPAIGNS:
        raise unknown_name("campaign", arguments.campaign, CAMPAIGNS)
    for name, least in (("count", 1), ("workers", 1), ("seed", 0)):
        if getattr(arguments, name) < least:
            raise InputError(f"--{name}: expected {least} or more, got {getattr(arguments, name)}")
    if not arguments.out:
        raise InputError("--out: expected a folder for the data")
    if not 0 < arguments.friction <= MOST_FRICTION:
        raise InputError(f"--friction: expected more than 0, at most {MOST_FRICTION:g}, got {arguments.friction:g}")
    if arguments.task_timeout <= 0:
        raise InputError(f"--task-timeout: expected more than 0, got {arguments.task_timeout:g}")


def _campaign(
    arguments: Arguments,
) -> DynamicsCampaign | CaptureCampaign | MotionsCampaign | TraversabilityCampaign | BracedWallCampaign:
    from drakeplan.campaigns.braced_wall import BracedWallCampaign
    from drakeplan.campaigns.capture import CaptureCampaign
    from drakeplan.campaigns.dynamics import DynamicsCampaign
    from drakeplan.campaigns.motions import MotionsCampaign
    from drakeplan.campaigns.traversability import TraversabilityCampaign
    from drakeplan.timing.step_timing import Timing
    from scenes.robots.addresses import read_packages

    packages = tuple((name, str(folder)) for name, folder in read_packages(arguments.package).items())
    if arguments.campaign == "dynamics":
        return DynamicsCampaign(
            robot=arguments.robot,
            friction=arguments.friction,
            timing=Timing(arguments.shift, arguments.swing),
            feet_only=arguments.feet_only,
            packages=packages,
        )
    if arguments.campaign == "capture":
        return CaptureCampaign(robot=arguments.robot, friction=arguments.friction, packages=packages)
    if arguments.campaign == "motions":
        return MotionsCampaign(robot=arguments.robot, friction=arguments.friction, packages=packages)
    if arguments.robot == "bracer":
        return BracedWallCampaign()
    return TraversabilityCampaign(
        robot=arguments.robot, friction=arguments.friction, footholds=arguments.footholds, packages=packages
    )


def _report(card: Card, arguments: Arguments) -> None:
    if arguments.json:
        from dataclasses import asdict

        from drakeplan.cli.output import print_json

        print_json({"status": "collected", "folder": arguments.out, **asdict(card)})
        return
    from drakeplan.campaigns import capture, dynamics, motions, traversability

    counts_text = {
        "dynamics": dynamics.counts_text,
        "capture": capture.counts_text,
        "motions": motions.counts_text,
    }
    print(counts_text.get(arguments.campaign, traversability.counts_text)(card))
    what = "motions and refusals" if arguments.campaign == "motions" else "labels"
    print(f"{card.rows} {what} of {card.tasks} environments in {arguments.out}, {len(card.quarantined)} in quarantine")
    print(f"sha256 {card.sha256}")
