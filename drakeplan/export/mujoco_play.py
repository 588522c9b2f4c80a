"""Plays a plan in MuJoCo.

`drakeplan export PLAN.h5 --to mujoco` writes this file beside an MJCF and a folder with the motion. It needs mujoco
(pip install mujoco), not drakeplan.

    python FILE_play.py                the planned motion in the viewer, posture by posture
    python FILE_play.py --headless     no window: compare model and plan, and print
    python FILE_play.py --physics      simulate: position servos follow the plan, with its torques fed forward
"""

# pyright: reportMissingImports=false, reportAttributeAccessIssue=false

from __future__ import annotations

import argparse
import sys
import time
from pathlib import Path

import numpy as np

try:
    import mujoco
except ImportError:
    sys.exit("mujoco is not installed: pip install mujoco")

FOLDER = Path(__file__).resolve().parent
ASSETS = FOLDER / (Path(__file__).stem.removesuffix("_play") + "_assets")
FALLEN = 0.3  # [m] the base is this far from the plan


class Motion:
    """The planned motion and the model that makes it.

    Attributes:
        model: MuJoCo's.
        data: MuJoCo's.
        arrays: of motion.npz.
    """

    def __init__(self) -> None:
        """Reads the MJCF and the motion."""
        with np.load(ASSETS / "motion.npz", allow_pickle=False) as file:
            self.arrays = dict(file)
        self.model = mujoco.MjModel.from_xml_path(str(FOLDER / str(self.arrays["model"])))
        self.data = mujoco.MjData(self.model)
        self.servos = self.model.actuator_trnid[:, 0]  # the joint of each

    def at(self, name: str, t: float) -> np.ndarray:
        """Values of an array at a time of the plan, linear between its samples.

        Args:
            name: of the array, one row for each sample.
            t: time of the plan [s].
        """
        times, values = self.arrays["t"], self.arrays[name]
        k = int(np.clip(np.searchsorted(times, t, side="right") - 1, 0, max(len(times) - 2, 0)))
        if k + 1 >= len(times):
            return values[-1]
        u = np.clip((t - times[k]) / (times[k + 1] - times[k]), 0.0, 1.0)
        return (1.0 - u) * values[k] + u * values[k + 1]

    def show(self, t: float) -> None:
        """Puts the model into the planned posture."""
        self.data.qpos[:] = self.at("qpos", t)
        self.data.qpos[3:7] /= np.linalg.norm(self.data.qpos[3:7])
        self.data.qvel[:] = self.at("qvel", t)
        self.data.time = t
        mujoco.mj_forward(self.model, self.data)

    def begin(self) -> None:
        """Puts the model at rest into the first posture."""
        self.show(float(self.arrays["t"][0]))
        self.data.qvel[:] = 0.0

    def step(self) -> None:
        """Simulates one step; servos aim where their spring and damper give the planned torque besides."""
        t = self.data.time
        stiffness, damping = self.model.actuator_gainprm[:, 0], -self.model.actuator_biasprm[:, 2]
        q, v = self.at("qpos", t), self.at("qvel", t)
        wanted = q[self.model.jnt_qposadr[self.servos]]
        speed = v[self.model.jnt_dofadr[self.servos]]
        self.data.ctrl[:] = wanted + (damping * speed + self.at("torque", t)) / stiffness
        mujoco.mj_step(self.model, self.data)


def compare(motion: Motion) -> int:
    """Plays all frames without a window and prints how the model agrees with the plan; 0 where it does."""
    model, data, arrays = motion.model, motion.data, motion.arrays
    names = [str(name) for name in arrays["effectors"]]
    com = sole = depth = 0.0
    for k, t in enumerate(arrays["t"]):
        motion.show(t)
        com = max(com, float(np.linalg.norm(data.subtree_com[1] - arrays["com"][k])))
        for name, contact in zip(names, arrays["contact"][k], strict=True):
            if contact >= 0:
                place = arrays["contact_X_WC"][contact][:3, 3]
                sole = max(sole, float(np.linalg.norm(data.body(name).xpos - place)))
        depth = max([depth, *(-data.contact.dist)])
    print(f"model           {model.njnt - 1} joints, {mujoco.mj_getTotalmass(model):.3f} kg, {model.ngeom} geoms")
    print(
        f"motion          {len(arrays['t'])} frames, {arrays['t'][-1] - arrays['t'][0]:.2f} s, {model.nkey} keyframes"
    )
    print(f"soles, palms    {1e3 * sole:.3f} mm at most from the planned contacts")
    print(f"CoM             {1e3 * com:.3f} mm at most from the planned course")
    print(f"penetration     {1e3 * depth:.3f} mm at most")
    return 0 if sole < 0.01 and com < 0.05 else 1


def simulate(motion: Motion, watch: object | None) -> int:
    """Simulates the motion and prints whether the robot arrives; 0 when it does.

    Args:
        motion: what is played.
        watch: a viewer, or None.
    """
    motion.begin()
    end, began, away = float(motion.arrays["t"][-1]), time.time(), 0.0
    while motion.data.time < end:
        motion.step()
        away = float(np.linalg.norm(motion.data.qpos[:3] - motion.at("qpos", motion.data.time)[:3]))
        if away > FALLEN or not np.isfinite(away):
            break
        if watch is not None:
            if not watch.is_running():
                return 0
            watch.sync()
            time.sleep(max(0.0, motion.data.time - (time.time() - began)))
    arrived = motion.data.time >= end
    word = "arrived" if arrived else f"fell at {motion.data.time:.2f} s of {end:.2f} s"
    print(f"physics         {word}, base {1e3 * away:.0f} mm from the plan")
    return 0 if arrived else 1


def watch_motion(motion: Motion, physics: bool) -> int:
    """Opens the viewer and plays the motion again and again.

    Args:
        motion: what is played.
        physics: whether it is simulated.
    """
    import mujoco.viewer

    times = motion.arrays["t"]
    motion.begin()
    with mujoco.viewer.launch_passive(motion.model, motion.data) as viewer:
        while viewer.is_running():
            if physics:
                simulate(motion, viewer)
                continue
            began = time.time()
            while viewer.is_running() and (elapsed := time.time() - began) <= times[-1] - times[0] + 1.0:
                motion.show(min(float(times[0]) + elapsed, float(times[-1])))
                viewer.sync()
                time.sleep(0.01)
    return 0


def main(words: list[str] | None = None) -> int:
    """Plays the motion as the command line asks."""
    parser = argparse.ArgumentParser(description="Plays a plan in MuJoCo.")
    parser.add_argument("--headless", action="store_true", help="no window: compute and print")
    parser.add_argument("--physics", action="store_true", help="simulate instead of showing posture by posture")
    chosen = parser.parse_args(words)
    motion = Motion()
    if not chosen.headless:
        return watch_motion(motion, chosen.physics)
    return simulate(motion, None) if chosen.physics else compare(motion)


if __name__ == "__main__":
    sys.exit(main())
