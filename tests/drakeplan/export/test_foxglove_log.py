"""The log, read by mcap's own reader: Drake's poses, the plan's joints and forces."""

import json

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from drakeplan.export import export_plan
from drakeplan.export.samples import sample_motion
from drakeplan.plan.body_poses import body_poses
from scenes.robots.robot import load_robot

pytest.importorskip("mcap", reason="pip install 'drakeplan[export]'")
pytest.importorskip("mcap_protobuf", reason="pip install 'drakeplan[export]'")
pytest.importorskip("foxglove_schemas_protobuf", reason="pip install 'drakeplan[export]'")

OFFSET = [431250.0, 5411000.0, 12.0]  # [m] of `map_plan`


def read_log(path):
    """(topic -> list of (log time [ns], message), topic -> schema, metadata)."""
    from mcap.reader import make_reader
    from mcap_protobuf.decoder import DecoderFactory

    messages, schemas = {}, {}
    with path.open("rb") as file:
        reader = make_reader(file, decoder_factories=[DecoderFactory()])
        for schema, channel, message, decoded in reader.iter_decoded_messages():
            messages.setdefault(channel.topic, []).append((message.log_time, decoded))
            schemas[channel.topic] = schema.name
        return messages, schemas, {m.name: m.metadata for m in reader.iter_metadata()}


@pytest.fixture(scope="module")
def log(stepping_plan, tmp_path_factory):
    path = tmp_path_factory.mktemp("log") / "plan.mcap"
    export_plan(stepping_plan, "mcap", path)
    return read_log(path)


def test_topics_have_foxgloves_schemas_and_begin_at_time_0(log, stepping_plan):
    messages, schemas, metadata = log
    assert schemas == {
        "/tf": "foxglove.FrameTransforms",
        "/joint_states": "foxglove.JointStates",
        "/com": "foxglove.PoseInFrame",
        "/robot": "foxglove.SceneUpdate",
        "/terrain": "foxglove.SceneUpdate",
        "/contacts": "foxglove.SceneUpdate",
    }
    for topic in ("/tf", "/joint_states", "/com"):
        stamps = np.array([time for time, _ in messages[topic]])
        assert np.allclose(1e-9 * stamps, stepping_plan.motion.t, atol=1e-9)
    assert [messages[topic][0][0] for topic in schemas] == [0] * len(schemas)
    assert json.loads(metadata["drakeplan"]["plan"])["robot"] == "escher"


def test_frames_of_all_links_are_drakes(log, stepping_plan):
    frames = log[0]["/tf"]
    chosen = list(range(0, len(frames), 97))
    poses = body_poses(load_robot("escher"), stepping_plan.motion.q[chosen], ())
    samples = sample_motion(stepping_plan)
    for k, frame in enumerate(chosen):
        found = {t.child_frame_id: t for t in frames[frame][1].transforms}
        assert set(found) == {*poses, "centre_of_mass"}
        for name, X_WB in poses.items():
            p, q = found[name].translation, found[name].rotation
            assert found[name].parent_frame_id == "world"
            assert np.array_equal([p.x, p.y, p.z], X_WB[k, :3, 3])
            turned = Rotation.from_quat([q.x, q.y, q.z, q.w]).as_matrix()
            assert np.abs(turned - X_WB[k, :3, :3]).max() < 1e-12
        com = found["centre_of_mass"].translation
        assert np.array_equal([com.x, com.y, com.z], samples.com[frame])


def test_joints_are_the_plans(log, stepping_plan):
    samples = sample_motion(stepping_plan)
    for k in (0, 200, 490):
        joints = log[0]["/joint_states"][k][1].joints
        assert tuple(j.name for j in joints) == samples.joint_names
        assert np.array_equal([j.position for j in joints], samples.joint_position[k])
        assert np.array_equal([j.velocity for j in joints], samples.joint_velocity[k])


def test_arrows_are_the_forces_at_their_centres_of_pressure(log, stepping_plan):
    """Together they carry the weight of a robot that stands still."""
    samples = sample_motion(stepping_plan)
    for time, update in log[0]["/contacts"]:
        k = int(np.argmin(np.abs(samples.t - 1e-9 * time)))
        total = np.zeros(3)
        (entity,) = update.entities
        for arrow in entity.arrows:
            q, p = arrow.pose.orientation, arrow.pose.position
            along = Rotation.from_quat([q.x, q.y, q.z, q.w]).apply([1.0, 0.0, 0.0])
            total += 1000.0 * (arrow.shaft_length + arrow.head_length) * along
            assert np.nanmin(np.linalg.norm(samples.cop[k] - [p.x, p.y, p.z], axis=1)) == 0.0
        assert np.abs(total - samples.force[k].sum(axis=0)).max() < 2.0  # forces below 1 N have no arrow
    assert abs(total[2] - 9.81 * stepping_plan.mass) < 2.0  # at rest in the end


def test_shapes_of_links_move_with_their_frames_and_the_terrain_does_not(log):
    robot = log[0]["/robot"][0][1].entities
    assert all(entity.frame_locked and entity.frame_id == entity.id for entity in robot)
    pelvis = next(entity for entity in robot if entity.id == "pelvis")
    assert [len(pelvis.cubes), len(pelvis.cylinders), len(pelvis.spheres)] == [2, 2, 2]  # a capsule is three of these
    terrain = {entity.id: entity for entity in log[0]["/terrain"][0][1].entities}
    assert set(terrain) == {"plates", "walls", "obstacles"}
    assert len(terrain["obstacles"].triangles[0].points) == 36  # a box
    heights = [point.z for point in terrain["plates"].triangles[0].points]
    assert abs(max(heights)) < 0.002


def test_a_georeferenced_world_stands_in_its_map(map_plan, tmp_path):
    export_plan(map_plan, "mcap", tmp_path / "map.mcap")
    messages, _, _ = read_log(tmp_path / "map.mcap")
    for _, frames in messages["/tf"][::200]:
        (world,) = (t for t in frames.transforms if t.child_frame_id == "world")
        assert world.parent_frame_id == "map"
        assert [world.translation.x, world.translation.y, world.translation.z] == OFFSET


@pytest.mark.parametrize("direction", [[1, 0, 0], [-1, 0, 0], [0, 0, 1], [0.6, 0, -0.8], [-1, 1e-9, 0]])
def test_an_arrow_turns_from_x_to_its_direction(direction):
    from drakeplan.export.foxglove_scene import _from_x_to

    unit = np.array(direction, float) / np.linalg.norm(direction)
    assert np.allclose(Rotation.from_quat(_from_x_to(unit)).apply([1.0, 0.0, 0.0]), unit, atol=1e-8)
