"""How well the momenta of the played motion follow the dynamics, iteration by iteration, and without the feedback.

The last gap is taken from the plan as it would be written, by Drake: momenta of (q, v) at every frame less the plan's,
linear between its knots. The gaps of the iterations are the motion stage's own.
"""

from __future__ import annotations

import time

import numpy as np

from drakeplan.bench.table import BenchOptions, BenchTable
from drakeplan.context import QueryContext
from drakeplan.motion.maker import MotionMaker, MotionOptions, MotionResult
from drakeplan.query.options import PlanOptions
from drakeplan.query.planning import plan_scene
from drakeplan.query.warm_up import warm_up
from optimization.inverse_kinematics.whole_body_ik import WholeBodyIK
from optimization.kinodynamic.momentum_gap import PROMISED, Gap, MomentumGap
from scenes.files.scene_source import load_scene
from scenes.robots.plant import RobotPlant, build_plant
from scenes.robots.robot import load_robot

SCENES = ("flat", "stairs", "rubble_field", "rubble_corridor", "tilted_slab", "narrow_flat")
MESHES = {"hpp/darpa": ((-3.6, 0.0, 0.0), (3.9, 0.0))}
MAX_SEEDS = 5
DEADLINE = 10.0  # [s] of search


def run(options: BenchOptions) -> BenchTable:
    """Named scenes with seeds 0 to 4, the mesh once."""
    robot = load_robot(options.robot)
    ik = WholeBodyIK(robot)
    warm_up(robot, ik)
    plant = build_plant(robot)
    cases = [(name, seed, None, None) for name in SCENES for seed in range(min(options.seeds, MAX_SEEDS))]
    cases += [(name, 0, start, goal) for name, (start, goal) in MESHES.items()]
    rows, notes, kept = [], [], 0
    for name, seed, start, goal in cases:
        scene = load_scene(name, seed=seed)
        query = PlanOptions(seed=seed, dynamics="quasi-static", start=start, goal=goal, deadline=DEADLINE)
        found = plan_scene(scene, robot, query)
        if found.plan is None:
            notes.append(f"{name} seed {seed}: {found.reason}")
            continue
        stances = found.plan.contact_sequence()
        context = QueryContext(scene, robot, ik)
        motions = []
        for feedback in (True, False):
            maker = MotionMaker(context, MotionOptions(feedback=feedback))
            began = time.process_time()
            motions.append((maker.run(stances, lambda event: None), time.process_time() - began))
        row = _row(plant, motions)
        kept += bool(row[0])
        rows.append((f"{name} {seed}", found.status == "complete", *row[1:]))
        options.tell(f"{name} seed {seed}: {found.status}, {motions[0][1]:.1f} s")
    columns = (
        "plan", "verified", "iterations", "k RMS after each [N m s]", "k RMS", "k worst", "l RMS", "l worst", "com worst mm",
        "torque share", "CPU s", "no feedback: k RMS", "k worst", "l RMS", "l worst", "CPU s",
    )  # fmt: skip
    notes.append(f"{kept} of {len(rows)} motions within {PROMISED}, RMS and in brackets worst, at every frame (50 Hz).")
    notes.append(
        "CPU s: key postures, dynamics and motion, one process; without feedback the same stage follows the CoM."
    )
    return BenchTable(
        "kinodynamic",
        "Momenta of the motion less the dynamics'",
        columns,
        tuple(rows),
        tuple(notes),
        most_seeds=MAX_SEEDS,
    )


def _row(plant: RobotPlant, motions: list[tuple[MotionResult, float]]) -> tuple[object, ...]:
    """Whether the first motion keeps what is promised, then its cells and those of the one without feedback."""
    (motion, seconds), (peer, peer_seconds) = motions
    if motion.centroidal is None or not len(motion.q):
        return (False, 0, motion.reason, *(float("nan"),) * 11)
    gap = plan_gap(plant, motion)
    peer_gap = plan_gap(plant, peer) if len(peer.q) else MomentumGap(*(Gap(np.nan, np.nan),) * 3)
    each = ", ".join(f"{g.angular.rms:.2f}" for g in motion.gaps)
    return (
        gap.within(PROMISED), len(motion.gaps), each, gap.angular.rms, gap.angular.worst, gap.linear.rms,
        gap.linear.worst, 1e3 * gap.com.worst, motion.torque.share if motion.torque else float("nan"), seconds,
        peer_gap.angular.rms, peer_gap.angular.worst, peer_gap.linear.rms, peer_gap.linear.worst, peer_seconds,
    )  # fmt: skip


def plan_gap(robot_plant: RobotPlant, motion: MotionResult) -> MomentumGap:
    """Drake's CoM and momenta of a motion at every frame, less those of its dynamics.

    Args:
        robot_plant: Drake's model of the robot.
        motion: with its dynamics.
    """
    plant, context = robot_plant.plant, robot_plant.plant.CreateDefaultContext()
    c = motion.centroidal
    assert c is not None
    com, momentum = np.empty((len(motion.t), 3)), np.empty((len(motion.t), 6))
    for n, (q, v) in enumerate(zip(motion.q, motion.v, strict=True)):
        plant.SetPositions(context, q)
        plant.SetVelocities(context, v)
        com[n] = plant.CalcCenterOfMassPositionInWorld(context)
        spatial = plant.CalcSpatialMomentumInWorldAboutPoint(context, com[n])
        momentum[n] = np.concatenate([spatial.rotational(), spatial.translational()])
    planned = [
        np.stack([np.interp(motion.t, c.t, x[:, i]) for i in range(3)], axis=1)
        for x in (c.com, c.linear_momentum, c.angular_momentum)
    ]
    return MomentumGap(
        Gap.of(com - planned[0]), Gap.of(momentum[:, 3:] - planned[1]), Gap.of(momentum[:, :3] - planned[2])
    )
