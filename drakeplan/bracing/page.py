"""A page that shows a braced plan in Meshcat: wall, ramp, palm contacts, and the key postures of every step one after the other.

Between key postures joints and base are interpolated: it is a picture of the plan, not a motion.
"""

# pydrake's stubs take the first parameter of ndarray for its type, and reject every array.
# pyright: reportArgumentType=false, reportCallIssue=false

from __future__ import annotations

import itertools
from pathlib import Path

import numpy as np
from pydrake.geometry import Cylinder, Meshcat, MeshcatParams, MeshcatVisualizer, MeshcatVisualizerParams, Rgba, Role
from pydrake.math import RigidTransform, RotationMatrix
from pydrake.multibody.parsing import Parser
from pydrake.multibody.plant import AddMultibodyPlantSceneGraph
from pydrake.systems.framework import DiagramBuilder

from drakeplan.bracing.braced_planner import BracedPlan
from drakeplan.bracing.wall_frame import MODEL_FILE
from drakeplan.playback import HOST
from drakeplan.playback.still import light_and_look
from drakeplan.playback.view import View
from scenes.files.whole_file import write_whole
from scenes.library.braced_ramp import BracedRamp
from scenes.robots.bracer.make_bracer import PALM_RADIUS
from scenes.terrain.surface import Surface

PALM_COLOURS = (Rgba(0.87, 0.10, 0.10), Rgba(0.10, 0.66, 0.16))  # left red, right green, as in Lin 2020 fig. 5.8
WALL, RAMP, PIPE = Rgba(0.72, 0.72, 0.74), Rgba(0.80, 0.76, 0.70), Rgba(0.55, 0.35, 0.25)
STEP, DRIVE = 1.0, 0.7  # [s] of a palm's step, and of driving on
FRAMES = 8  # between two key postures
EXTENT = 4.0  # [m] about the middle that is lit


def write_braced_page(plan: BracedPlan, ramp: BracedRamp, path: str | Path) -> None:
    """Writes the page in one step; everything in it is inline.

    Args:
        plan: to show.
        ramp: its scene.
        path: the HTML file.

    Raises:
        InputError: the file cannot be written.
    """
    meshcat = Meshcat(MeshcatParams(host=HOST, show_stats_plot=False))
    _draw(meshcat, plan, ramp)
    builder = DiagramBuilder()
    plant, scene_graph = AddMultibodyPlantSceneGraph(builder, 0.0)
    Parser(plant).AddModels(str(MODEL_FILE))
    plant.Finalize()
    parameters = MeshcatVisualizerParams()
    parameters.role, parameters.prefix = Role.kIllustration, "bracer"
    visualizer = MeshcatVisualizer.AddToBuilder(builder, scene_graph, meshcat, parameters)
    diagram = builder.Build()
    context = diagram.CreateDefaultContext()
    inner, base = plant.GetMyMutableContextFromRoot(context), plant.GetBodyByName("base")
    recording = visualizer.StartRecording(False)
    recording.set_autoplay(True)
    for time, X_WB, q in _frames(plan):
        context.SetTime(time)
        plant.SetPositions(inner, np.concatenate([np.zeros(7), q]))
        plant.SetFreeBodyPose(inner, base, X_WB)
        diagram.ForcedPublish(context)
    visualizer.StopRecording()
    visualizer.PublishRecording()
    Path(path).parent.mkdir(parents=True, exist_ok=True)
    write_whole(path, meshcat.StaticHtml().encode())


def _frames(plan: BracedPlan) -> list[tuple[float, RigidTransform, np.ndarray]]:
    """Times, base poses and joint positions, key postures first and last."""
    keys, time = [], 0.0
    for X_WB, (before, after) in zip(plan.base, plan.postures, strict=True):
        keys += [(time, X_WB, before), (time + STEP, X_WB, after)]
        time += STEP + DRIVE
    frames = []
    for (t0, X0, q0), (t1, X1, q1) in itertools.pairwise(keys):
        for share in np.arange(FRAMES) / FRAMES:
            p = X0[:3, 3] + share * (X1[:3, 3] - X0[:3, 3])
            pose = RigidTransform(RotationMatrix(X0[:3, :3]), p)
            frames.append((t0 + share * (t1 - t0), pose, q0 + share * (q1 - q0)))
    last = keys[-1]
    return [*frames, (last[0], RigidTransform(RotationMatrix(last[1][:3, :3]), last[1][:3, 3]), last[2])]


def _draw(meshcat: Meshcat, plan: BracedPlan, ramp: BracedRamp) -> None:
    """All that does not move, light and camera."""
    for surface, colour in ((ramp.ground, RAMP), *((s, WALL) for s in ramp.wall.surfaces)):
        _polygon(meshcat, surface, colour)
    for k, triangle in enumerate(ramp.wall.triangles):
        face = np.array([[0], [1], [2]], np.int32)
        meshcat.SetTriangleMesh(
            f"/scene/pipe/{k}", triangle.T, face, PIPE, False, 1.0, Meshcat.SideOfFaceToRender.kDoubleSide
        )
    across = RotationMatrix.MakeXRotation(np.pi / 2)  # a disc on the wall
    for palm, colour in enumerate(PALM_COLOURS):
        for k, point in enumerate(np.unique(plan.palms[:, palm].round(6), axis=0)):
            path = f"/scene/palms/{palm}/{k}"
            meshcat.SetObject(path, Cylinder(PALM_RADIUS, 0.01), colour)
            meshcat.SetTransform(path, RigidTransform(across, point))
    middle = 0.5 * (ramp.start + ramp.goal)
    look = View(middle + np.array([-1.6, -3.4, 2.8]), middle + np.array([0.0, -0.5, -0.4]))
    light_and_look(meshcat, look, EXTENT)


def _polygon(meshcat: Meshcat, surface: Surface, colour: Rgba) -> None:
    k = np.arange(1, len(surface.vertices) - 1)
    fan = np.stack([np.zeros_like(k), k, k + 1]).astype(np.int32)
    side = Meshcat.SideOfFaceToRender.kDoubleSide
    meshcat.SetTriangleMesh(f"/scene/{surface.name}", surface.vertices.T, fan, colour, False, 1.0, side)
