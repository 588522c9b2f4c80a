"""Which side of a face is outside."""

import numpy as np
import pytest
import trimesh

from scenes.meshes.mesh_orientation import Bodies, single_faces, turn_outward
from scenes.pose import pose_matrix
from scenes.terrain.polygon import area_vectors


def block(size, centre):
    return trimesh.creation.box(size, transform=pose_matrix(centre, (0, 0, 0))).triangles


def inside_out(triangles):
    return triangles[:, ::-1]


def volume(triangles):
    return np.einsum("ki,ki->", triangles[:, 0], np.cross(triangles[:, 1], triangles[:, 2])) / 6


SHEET = np.array([[[0, 0, 0], [1, 0, 0], [1, 1, 0]], [[0, 0, 0], [1, 1, 0], [0, 1, 0]]], float)


def outward_of(triangles):
    """(K, 3, 3) the triangles turned outward, and what was turned."""
    bodies, notes = turn_outward(Bodies(triangles))
    return bodies.triangles, notes


def single_of(triangles):
    """(K, 3, 3) the triangles each on one side, and what was taken away."""
    bodies, notes = single_faces(Bodies(triangles))
    return bodies.triangles, notes


def test_a_good_mesh_is_left_alone():
    both = np.concatenate([block((1, 1, 1), (0, 0, 0)), block((1, 1, 1), (3, 0, 0)), SHEET + 5])
    turned, notes = outward_of(both)
    np.testing.assert_array_equal(turned, both)
    assert notes == ()


def test_a_body_that_is_inside_out_is_turned_and_that_is_said():
    good, bad = block((1, 1, 1), (0, 0, 0)), inside_out(block((1, 1, 2), (3, 0, 0)))
    turned, notes = outward_of(np.concatenate([good, bad]))
    assert volume(turned) == pytest.approx(3.0)
    assert notes == ("1 closed bodies were inside out and were turned",)


def test_a_cavity_and_a_room_keep_their_faces_inward():
    shell = np.concatenate([block((2, 2, 2), (0, 0, 0)), inside_out(block((1, 1, 1), (0, 0, 0)))])
    room = np.concatenate([inside_out(block((9, 9, 3), (0, 0, 1.5))), block((1, 1, 1), (0, 0, 0.6))])
    for triangles in (shell, room):
        turned, notes = outward_of(triangles)
        np.testing.assert_array_equal(turned, triangles)
        assert notes == ()


@pytest.mark.parametrize("wrong", [[0], [3, 4, 7], list(range(5))])
def test_faces_that_disagree_with_their_neighbours_are_turned(wrong):
    triangles = block((1, 2, 3), (0.5, 0, 0)).copy()
    triangles[wrong] = triangles[wrong][:, ::-1]
    turned, notes = outward_of(triangles)
    assert volume(turned) == pytest.approx(6.0)
    assert notes == (f"{len(wrong)} faces disagreed with their neighbours and were turned",)


def test_a_ground_sheet_drawn_face_down_is_turned_only_where_nothing_faces_up():
    turned, notes = outward_of(inside_out(SHEET))
    np.testing.assert_array_equal(turned, SHEET)
    assert notes == ("1 sheets faced down with nothing facing up and were turned",)
    ceiling = inside_out(SHEET) + np.array([0, 0, 2.5])
    both = np.concatenate([SHEET, ceiling])
    np.testing.assert_array_equal(outward_of(both)[0], both)


def test_bodies_are_what_hangs_together_and_closed_is_what_has_no_rim():
    bodies = Bodies(np.concatenate([block((1, 1, 1), (0, 0, 0)), block((1, 1, 1), (3, 0, 0))[:-1], SHEET + 9]))
    assert bodies.count == 3
    assert sorted(bodies.closed()) == [False, False, True]
    assert bodies.closed()[bodies.body[0]]
    near = bodies.near(np.array([0.4, 0, 0]), np.array([2.0, 1, 1]))
    np.testing.assert_array_equal(np.flatnonzero(near), np.arange(12))


@pytest.mark.parametrize("seed", range(4))
def test_a_closed_body_drawn_from_both_sides_is_one_body_turned_outward(seed: int) -> None:
    """Whichever side comes first in the file, face by face."""
    body = block((1.0, 0.6, 0.2), (0, 0, 0))
    both = np.concatenate([body, body[:, ::-1]])[np.random.default_rng(seed).permutation(2 * len(body))]
    single, notes = single_of(both)
    outward, _ = outward_of(single)
    assert len(outward) == len(body)
    assert "12 faces had a twin turned the other way" in notes[0]
    assert (area_vectors(outward) * outward.mean(axis=1)).sum(axis=1).min() > 0


def test_a_sheet_drawn_from_both_sides_faces_up() -> None:
    for both in (np.concatenate([SHEET, SHEET[:, ::-1]]), np.concatenate([SHEET[:, ::-1], SHEET])):
        single, notes = single_of(both)
        assert len(single) == 2
        assert (area_vectors(single)[:, 2] > 0).all()
        assert len(notes) == 1


def test_blocks_side_by_side_keep_the_face_that_they_share() -> None:
    left, right = block((1, 1, 1), (0, 0, 0)), block((1, 1, 1), (1, 0, 0))
    both = np.concatenate([left, right])
    single, notes = single_of(both)
    assert len(single) == len(both)
    assert notes == ()
