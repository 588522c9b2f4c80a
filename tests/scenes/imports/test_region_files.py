"""Planar regions of IHMC's software, lists of polygons, lists of boxes."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from scenes.imports.box_list import json_boxes, table_boxes
from scenes.imports.ihmc_regions import _axis_angle, _from_vertical, regions_of
from scenes.imports.outline import Outline
from scenes.imports.outline_surfaces import surfaces_of_outlines
from scenes.imports.polygon_file import json_polygons, polygons_of
from scenes.imports.text_file import table_of
from scenes.input_error import InputError
from scenes.terrain.surface import Surface
from scenes.terrain.usable_area import covered_area

SQUARE = [[-0.2, 0.1], [0.2, 0.1], [0.2, -0.1], [-0.2, -0.1]]  # clockwise, as in IHMC's files
LINE = "regionId: {id}, index: {index}, origin: 1.0, 2.0, 0.5, {turn}, concave hull size: 4, number of convex polygons: 1, [4]\n"
LEVEL, TILTED = "normal: 0.0, 0.0, 1.0", "orientation: 0.0, 1.0, 0.0, 0.3"


def corners(points: list[list[float]], times: int = 1, end: str = "\n") -> str:
    return "".join(f"{x}, {y}{end}" for x, y in points) * times


def folder(path: Path, end: str = "\n") -> Path:
    path.mkdir()
    (path / "header.txt").write_bytes(
        (LINE.format(id=11, index=1, turn=LEVEL) + LINE.format(id=11, index=2, turn=TILTED)).replace("\n", end).encode()
    )
    for index in (1, 2):
        (path / f"region11_{index}").write_bytes(corners(SQUARE, 2, end).encode())
    return path


def expect_two(found: list[Outline]) -> None:
    assert [o.name for o in found] == ["region11_1", "region11_2"]
    np.testing.assert_allclose(
        found[0].rings[0], np.column_stack([SQUARE, np.zeros(4)]) + np.array([1, 2, 0.5]), atol=1e-12
    )
    c, s = np.cos(0.3), np.sin(0.3)
    x, y = np.array(SQUARE).T
    np.testing.assert_allclose(found[1].rings[0], np.stack([1 + c * x, 2 + y, 0.5 - s * x], axis=1), atol=1e-12)
    surfaces, _ = surfaces_of_outlines(found, 0.5)
    np.testing.assert_allclose([surface.normal for surface in surfaces], [[0, 0, 1], [s, 0, c]], atol=1e-9)


@pytest.mark.parametrize("end", ["\n", "\r\n"])
def test_a_folder_of_ihmc_has_its_regions_where_origin_and_turn_put_them(tmp_path: Path, end: str) -> None:
    path = folder(tmp_path / "20171215_PlanarRegion", end)
    expect_two(regions_of(path))
    expect_two(regions_of(path / "header.txt"))


def test_one_file_of_sections_says_the_same_and_a_sensor_moves_it(tmp_path: Path) -> None:
    text = LINE.format(id=11, index=1, turn=LEVEL) + LINE.format(id=11, index=2, turn=TILTED)
    text += "".join(f"*\nregion11_{index}\n{corners(SQUARE, 2)}" for index in (2, 1))
    (tmp_path / "one.txt").write_text(text)
    expect_two(regions_of(tmp_path / "one.txt"))
    sensor = "sensor position: 10.0, 0.0, 1.0, sensor orientation: 0.0, 0.0, 1.0, 1.5707963267948966\n"
    (tmp_path / "seen.txt").write_text(sensor + text)
    moved, plain = regions_of(tmp_path / "seen.txt")[0].rings[0], regions_of(tmp_path / "one.txt")[0].rings[0]
    np.testing.assert_allclose(moved, np.stack([10 - plain[:, 1], plain[:, 0], 1 + plain[:, 2]], axis=1), atol=1e-9)


def test_the_short_form_turns_by_its_quaternion(tmp_path: Path) -> None:
    (tmp_path / "maze.txt").write_text(
        "PR_0\nRBT,( 5.000,  5.000,  0.000 ), ( 0.000,  0.000,  0.000,  1.000 )\n-5, -5, 0.0\n5, -5, 0\n5, 5, 0\n-5, 5, 0\n"
        "PR_1\nRBT,( 2.000,  5.000,  1.000 ), ( 0.000,  0.707,  0.000,  0.707 )\n-1, -3, 0\n1, -3, 0\n1, 3, 0\n-1, 3, 0\n"
    )
    floor, wall = regions_of(tmp_path / "maze.txt")
    np.testing.assert_allclose(floor.rings[0].min(axis=0), [0, 0, 0], atol=1e-9)
    np.testing.assert_allclose(
        [wall.rings[0].min(axis=0), wall.rings[0].max(axis=0)], [[2, 2, 0], [2, 8, 2]], atol=1e-9
    )


@given(st.tuples(*[st.floats(-1, 1)] * 3).filter(lambda n: np.linalg.norm(n) > 1e-3))
def test_the_turn_from_the_vertical_to_a_normal_is_the_shortest(normal: tuple[float, float, float]) -> None:
    unit = np.array(normal) / np.linalg.norm(normal)
    R = _from_vertical(np.array(normal))
    np.testing.assert_allclose(R[:, 2], unit, atol=1e-9)
    np.testing.assert_allclose(R @ R.T, np.eye(3), atol=1e-9)
    assert np.trace(R) == pytest.approx(1 + 2 * unit[2], abs=1e-9)  # its angle is that between the two


def test_an_axis_and_an_angle_turn_as_rodrigues_says() -> None:
    R = _axis_angle(np.array([0.0, 0.0, 2.0, np.pi / 2]))
    np.testing.assert_allclose(R @ [1, 0, 0], [0, 1, 0], atol=1e-12)


@pytest.mark.parametrize(
    ("change", "expected"),
    [
        (lambda t: t.replace("region11_2\n", "region12_1\n"), "expected a section '* region11_2'"),
        (lambda t: t.replace("origin: 1.0, 2.0, 0.5", "origin: 1.0, NaN, 0.5"), "expected 3 finite numbers"),
        (lambda t: t.replace("hull size: 4", "hull size: 40"), "expected 44 corners"),
        (lambda t: t.replace(", [4]", ", [4, 4]"), "1 convex polygons, but 2 sizes"),
        (lambda t: t.replace("normal", "normale"), "line 1: expected 'regionId"),
        (lambda t: t.replace("-0.2, 0.1\n", "-0.2\n"), "expected 2 finite numbers"),
    ],
)
def test_wrong_files_of_ihmc_are_refused_with_the_line(tmp_path: Path, change, expected: str) -> None:
    text = LINE.format(id=11, index=1, turn=LEVEL) + LINE.format(id=11, index=2, turn=TILTED)
    text += "".join(f"*\nregion11_{index}\n{corners(SQUARE, 2)}" for index in (1, 2))
    (tmp_path / "one.txt").write_text(change(text))
    with pytest.raises(InputError) as error:
        regions_of(tmp_path / "one.txt")
    assert expected in str(error.value)


def test_a_region_file_that_is_missing_is_named(tmp_path: Path) -> None:
    path = folder(tmp_path / "some")
    (path / "region11_2").unlink()
    with pytest.raises(InputError, match="expected a file region11_2"):
        regions_of(path)


# Polygons ----------------------------------------------------------------------------------------------------------

FLOOR = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [1.0, 1.0, 0.0], [0.0, 1.0, 0.0]]
STEP = [[1.0, 0.0, 0.1], [1.3, 0.0, 0.1], [1.3, 1.0, 0.1], [1.0, 1.0, 0.1]]


def columns(ring: list[list[float]]) -> list[list[float]]:
    return np.array(ring).T.tolist()


@pytest.mark.parametrize(
    ("name", "data"),
    [
        ("rows.json", json.dumps([FLOOR, STEP])),
        ("columns.json", json.dumps([columns(FLOOR), columns(STEP)])),
        ("phases.json", json.dumps([[FLOOR], [FLOOR, STEP], [STEP]])),
        ("named.json", json.dumps({"surfaces": [{"vertices": FLOOR}, {"vertices": columns(STEP)}]})),
        ("bom.json", "\ufeff" + json.dumps([FLOOR, STEP], indent=1).replace("\n", "\r\n")),
        ("blocks.txt", "\n\n".join("\n".join(f"{x} {y} {z}" for x, y, z in ring) for ring in (FLOOR, STEP))),
        ("blocks3n.txt", "\n\n".join("\n".join(" ".join(map(str, row)) for row in columns(r)) for r in (FLOOR, STEP))),
    ],
)
def test_lists_of_corners_by_rows_and_by_columns_are_the_same_surfaces(name: str, data: str) -> None:
    surfaces, _ = surfaces_of_outlines(polygons_of(data.encode(), Path(name)), 0.5)
    assert len(surfaces) == 2
    for surface, ring in zip(surfaces, (FLOOR, STEP), strict=True):
        np.testing.assert_allclose(np.sort(surface.vertices, axis=0), np.sort(ring, axis=0), atol=1e-9)
        assert surface.normal[2] == pytest.approx(1.0)


def test_arrays_of_polygons_may_be_filled_up_with_nan(tmp_path: Path) -> None:
    rings = np.full((2, 5, 3), np.nan)
    rings[0, :4], rings[1, :4] = FLOOR, STEP
    for array in (rings, rings.transpose(0, 2, 1)):
        np.save(tmp_path / "a.npy", array)
        found = polygons_of((tmp_path / "a.npy").read_bytes(), tmp_path / "a.npy")
        assert [len(o.rings[0]) for o in found] == [4, 4]


def test_triangles_as_columns_are_told_by_their_neighbours() -> None:
    triangle = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.5], [0.0, 2.0, 0.25]]
    by_rows = json_polygons([triangle, FLOOR], Path("a.json"))[0].rings[0]
    by_columns = json_polygons([columns(triangle), columns(FLOOR)], Path("a.json"))[0].rings[0]
    np.testing.assert_allclose(by_rows, by_columns)


def test_a_polygon_with_a_hole_is_convex_pieces_around_the_hole() -> None:
    hole = [[0.4, 0.4, 0.0], [0.6, 0.4, 0.0], [0.6, 0.7, 0.0], [0.4, 0.7, 0.0]]
    wanted = {
        "name": "deck",
        "outline": FLOOR,
        "holes": [hole],
        "friction": 0.8,
        "contact": ["left_foot", "right_foot"],
    }
    surfaces, changes = surfaces_of_outlines(json_polygons([wanted], Path("a.json")), 0.5)
    assert covered_area(surfaces) == pytest.approx(1.0 - 0.06)
    assert all(s.friction == 0.8 and s.name.startswith("deck/") and not s.allows("left_palm") for s in surfaces)
    assert [c.what for c in changes] == ["cut"]


def test_what_is_no_region_is_dropped_and_said_and_twins_are_one() -> None:
    bent = [[2, 0, 0], [3, 0, 0.02], [3, 1, 0], [2, 1, 0.02]]
    bow = [[2, 0, 0], [3, 1, 0], [3, 0, 0], [2, 1, 0]]
    thin = [[2, 0, 0], [3, 0, 0], [3, 1e-6, 0]]
    rolled = FLOOR[2:] + FLOOR[:2]
    outlines = [
        Outline(str(k), (np.array(ring, float),))
        for k, ring in enumerate((FLOOR, bent, bow, thin, rolled, FLOOR[::-1], STEP[::-1]))
    ]
    surfaces, changes = surfaces_of_outlines(outlines, 0.5)
    assert [s.name for s in surfaces] == ["0", "6"]
    assert all(s.normal[2] > 0.99 for s in surfaces)
    told = {(c.what, c.count, c.why.partition(":")[0]) for c in changes}
    assert told == {
        ("dropped", 1, "not flat within 5 mm"),
        ("dropped", 1, "their outline crosses itself"),
        ("dropped", 1, "they have no area to speak of"),
        ("merged", 2, "listed more than once"),
        ("turned", 1, "they faced down, where nothing can touch them"),
    }


@settings(max_examples=40)
@given(
    radii=st.lists(st.floats(0.3, 1.0), min_size=5, max_size=12),
    tilt=st.floats(-0.6, 0.6),
    yaw=st.floats(-3, 3),
    lift=st.floats(-0.002, 0.002),
)
def test_the_pieces_of_a_star_cover_it_and_nothing_else(
    radii: list[float], tilt: float, yaw: float, lift: float
) -> None:
    angle = np.linspace(0, 2 * np.pi, len(radii), endpoint=False)
    flat = np.stack([radii * np.cos(angle), radii * np.sin(angle)], axis=1)
    R = _axis_angle(np.array([np.cos(yaw), np.sin(yaw), 0.0, tilt]))
    ring = np.column_stack([flat, lift * np.cos(3 * angle)]) @ R.T + [5.0, -3.0, 1.0]
    surfaces, _ = surfaces_of_outlines([Outline("star", (ring,))], 0.5)
    x, y = flat.T
    area = 0.5 * abs(x @ np.roll(y, -1) - y @ np.roll(x, -1))
    assert covered_area(surfaces) == pytest.approx(area, rel=0.02, abs=2e-3)
    for surface in surfaces:
        assert surface.normal @ R[:, 2] > np.cos(np.deg2rad(1.5))
        assert isinstance(surface, Surface)  # which checks that it is convex and flat


@pytest.mark.parametrize(
    ("value", "expected"),
    [
        ({"nothing": []}, "expected a list of polygons"),
        ({"polygons": []}, "holds no polygons"),
        ([[[0, 0, 0], [1, 0, 0]]], "at least three corners"),
        ([{"vertices": FLOOR, "mu": 1}], "unknown key 'mu'"),
        ([{"vertices": FLOOR, "friction": -1}], "friction: expected a number"),
        ([{"vertices": FLOOR, "contact": ["foot"]}], "contact: expected some of"),
        ([{"vertices": FLOOR, "normal": [0, 1]}], "normal: expected [x, y, z]"),
        (["floor"], "expected a polygon"),
    ],
)
def test_wrong_polygons_are_refused_with_their_place(value: object, expected: str) -> None:
    with pytest.raises(InputError) as error:
        json_polygons(value, Path("a.json"))
    assert expected in str(error.value)


# Boxes -------------------------------------------------------------------------------------------------------------


def test_boxes_of_json_and_csv_are_the_same() -> None:
    listed = [{"name": "crate", "size": [0.4, 0.3, 0.2], "xyz": [1, 2, 0.1], "rpy": [0, 0, 0.5]}, {"size": [1, 1, 1]}]
    table = "name;size_x;size_y;size_z;x;y;z;roll;pitch;yaw\ncrate;0.4;0.3;0.2;1;2;0.1;0;0;0.5\n;1;1;1;0;0;0;0;0;0\n"
    bare = "sx,sy,sz,x,y,z,yaw\n0.4,0.3,0.2,1,2,0.1,0.5\n1,1,1,0,0,0,0\n"
    path = Path("a")
    for boxes in (
        json_boxes(listed, path),
        json_boxes({"boxes": listed}, path),
        table_boxes(table_of(table, path), path),
        table_boxes(table_of(bare, path), path),
    ):
        np.testing.assert_allclose(
            [np.concatenate([b.size, b.xyz, b.rpy]) for b in boxes],
            [[0.4, 0.3, 0.2, 1, 2, 0.1, 0, 0, 0.5], [1, 1, 1, 0, 0, 0, 0, 0, 0]],
        )
    assert [b.name for b in table_boxes(table_of(table, path), path)] == ["crate", ""]


@pytest.mark.parametrize(
    ("value", "expected"),
    [
        ([{"size": [1, 1, 0]}], "size: expected lengths above 0"),
        ([{"size": [1, 1]}], "boxes[0].size: expected three finite numbers"),
        ([{"size": [1, 1, 1], "xyz": [0, float("nan"), 0]}], "boxes[0].xyz"),
        ([{"size": [1, 1, 1], "pose": 3}], "unknown key 'pose'"),
        ([], "expected a list"),
    ],
)
def test_wrong_boxes_are_refused_with_their_place(value: object, expected: str) -> None:
    with pytest.raises(InputError) as error:
        json_boxes(value, Path("a.json"))
    assert expected in str(error.value)
