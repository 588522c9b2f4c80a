"""Which bodies of a robot touch each other as it stands."""

# pydrake's stubs read "float64[3, 1]" as a shape and refuse every array.
# pyright: reportArgumentType=false, reportCallIssue=false, reportAttributeAccessIssue=false, reportReturnType=false

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path


def touching_pairs(urdf: Path, nominal: Mapping[str, float], distance: float) -> set[tuple[str, str]]:
    """Names of bodies nearer to each other than `distance` [m] with the joints at `nominal` [rad] and else 0.

    Args:
        urdf: the model file.
        nominal: joint angles by name [rad]; other joints stand at 0.
        distance: bodies nearer than this are named [m].
    """
    from pydrake.multibody.plant import AddMultibodyPlantSceneGraph
    from pydrake.systems.framework import DiagramBuilder

    from scenes.robots.drake_parser import add_model, reading, set_joint

    builder = DiagramBuilder()
    plant, scene_graph = AddMultibodyPlantSceneGraph(builder, time_step=0.0)
    add_model(plant, urdf)
    with reading(urdf):
        plant.Finalize()
    diagram = builder.Build()
    context = diagram.CreateDefaultContext()
    plant_context = plant.GetMyContextFromRoot(context)
    for joint, angle in nominal.items():
        set_joint(plant.GetJointByName(joint), plant_context, angle)
    inspector = scene_graph.model_inspector()
    query = plant.get_geometry_query_input_port().Eval(plant_context)
    pairs = set()
    for pair in query.ComputeSignedDistancePairwiseClosestPoints(distance):
        frames = (inspector.GetFrameId(g) for g in (pair.id_A, pair.id_B))
        pairs.add(tuple(sorted(plant.GetBodyFromFrameId(f).name() for f in frames)))
    return pairs
