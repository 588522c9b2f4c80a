"""Scene files: YAML in, `Scene` out, and back without loss.

A plan file keeps the scene without the meshes it was planned on: their faces stand among the surfaces there, and only
their names, `mesh:<mesh>/<number>`, tell that a mesh is their body. `scene_from_yaml(..., mesh_triangles=...)` puts the
two together again. Read alone, such surfaces are plates like any other, and a note says so.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from scenes.contact import NEAR_LEVEL, Contact
from scenes.disturbance import Disturbance
from scenes.effector import EFFECTORS, is_foot
from scenes.files.box_sides import box_sides
from scenes.files.scene_schema import (
    ContactEntry,
    DisturbanceEntry,
    HeightMapEntry,
    MeshEntry,
    ObstacleEntry,
    PoseEntry,
    SceneEntry,
    StartEntry,
    SurfaceEntry,
    parse_scene,
)
from scenes.files.scene_writer import scene_to_yaml, write_scene
from scenes.files.strict_yaml import load_yaml, read_text
from scenes.input_error import InputError, unknown_name
from scenes.meshes.height_map import import_height_map
from scenes.meshes.mesh_import import MESH_PREFIX, MeshImport, check_up_axis, import_mesh, mesh_name
from scenes.meshes.mesh_path import mesh_path
from scenes.pose import pose_matrix
from scenes.scene import Goal, Scene, Start
from scenes.terrain.georeference import FAR, is_far, offset_for, offset_note, to_local
from scenes.terrain.polygon import flattened
from scenes.terrain.surface import Surface
from scenes.terrain.terrain import Box, Terrain, TriangleMesh

__all__ = ["read_scene", "scene_from_yaml", "scene_to_yaml", "write_scene"]

NORMAL_AGREES = np.cos(np.deg2rad(5.0))  # how well a given normal has to fit the polygon
CONTACT_OFF = 0.01  # [m] how far a given contact may lie off its surface
CONTACT_TILT = np.cos(np.deg2rad(2.0))  # how well its z axis has to fit the surface normal
FLATTENED = (1e-5, 5e-3)  # [m] corners farther than the first off their best plane are moved onto it, up to the second
TWIN_CORNERS = 1e-6  # [m] corners nearer than this are one
FAR_TWINS = 1e-3  # [m] the same where coordinates are so large that rounding could turn a smaller edge round


def read_scene(path: str | Path) -> Scene:
    """The scene in a file; what had to be changed is in its notes.

    Raises:
        InputError: one line with the file, the key and what was expected there.
    """
    path = Path(path)
    return scene_from_yaml(read_text(path), str(path), folder=path.parent, name=path.stem)


def scene_from_yaml(
    text: str,
    source: str,
    *,
    folder: Path | None = None,
    name: str = "scene",
    mesh_triangles: np.ndarray | None = None,
) -> Scene:
    """The scene in a YAML text.

    Args:
        text: of a scene file.
        source: what to call it in errors.
        folder: where relative mesh files start; None where there is none.
        name: of the scene if the text has none.
        mesh_triangles: (K, 3, 3) every obstacle and mesh of the scene, as a plan file keeps them beside the text [m].
            Surfaces called `mesh:...` are then faces of a mesh made of those that belong to no box.

    Raises:
        InputError: one line with the source, the key and what was expected there.
    """
    entry = parse_scene(load_yaml(text, source), source)
    notes: list[str] = []
    entry, offset = _localised(entry, notes)
    surfaces = [
        _surface(e, i, entry.friction, source, notes, FAR_TWINS if offset else TWIN_CORNERS)
        for i, e in enumerate(entry.surfaces)
    ]
    boxes = [_box(e, i) for i, e in enumerate(entry.obstacles)]
    kept = _kept_mesh(surfaces, boxes, mesh_triangles, notes)
    obstacles: list[Box | TriangleMesh] = [*boxes, *kept]
    flags = [bool(kept) and surface.name.startswith(MESH_PREFIX) for surface in surfaces]
    for wanted, box in zip(entry.obstacles, boxes, strict=True):
        rough = entry.friction if wanted.friction is None else wanted.friction
        sides = box_sides(box, wanted.contact or [], rough)
        surfaces += sides
        flags += [False] * len(sides)
    given = offset
    imported, offset = _meshes(entry.meshes, entry.friction, source, folder, offset)
    if given is None and offset is not None:
        entry, _ = _localised(entry, notes, offset)  # start and goal of a mesh that has told its offset
    if imported and not any(surface.allows("left_foot") for surface in surfaces):
        check_up_axis(m.obstacle for m in imported)
    imported += _height_maps(entry.heightmaps, entry.friction, source, folder, offset)
    for mesh in imported:
        obstacles.append(mesh.obstacle)
        surfaces += mesh.surfaces
        flags += [True] * len(mesh.surfaces)
        notes += mesh.notes
    terrain = _terrain(surfaces, obstacles, flags, source)
    _note_degrees(entry, notes)
    goal = entry.goal and Goal(_place(entry.goal.xyz), entry.goal.radius, entry.goal.yaw)
    return Scene(
        name=entry.name or name,
        terrain=terrain,
        start=entry.start and _start(entry.start, terrain, source),
        goal=goal,
        robot=entry.robot,
        disturbances=tuple(_disturbance(e) for e in entry.disturbances),
        origin_offset=offset,
        notes=tuple(f"{source}: {note}" for note in notes),
    )


def _kept_mesh(
    surfaces: list[Surface], boxes: list[Box], mesh_triangles: np.ndarray | None, notes: list[str]
) -> list[TriangleMesh]:
    """The mesh of the triangles that a plan file keeps, less those of boxes; a note where surfaces of meshes have lost theirs."""
    if mesh_triangles is not None:
        rest = _without_boxes(mesh_triangles, boxes)
        return [TriangleMesh("meshes", rest)] if len(rest) else []
    count = sum(surface.name.startswith(MESH_PREFIX) for surface in surfaces)
    if count:
        notes.append(
            f"{count} surfaces called {MESH_PREFIX}... come from mesh files that are not listed: used as plates of 2 cm"
        )
    return []


def _terrain(surfaces: list[Surface], obstacles: list[Box | TriangleMesh], flags: list[bool], source: str) -> Terrain:
    """The terrain of a scene file.

    Raises:
        InputError: two of one name, no surface, or something is too far away.
    """
    _check_names([o.name for o in obstacles], "obstacles", source)
    _check_names([s.name for s in surfaces], "surfaces", source)
    if not surfaces:
        raise InputError(f"{source}: surfaces: expected at least one, listed here or from a mesh")
    terrain = Terrain(tuple(surfaces), tuple(obstacles), tuple(flags))
    if terrain_reach(terrain) > FAR:
        raise InputError(
            f"{source}: reaches {terrain_reach(terrain):.3g} m from its origin, expected at most 100 km; "
            "give an origin_offset in the middle of the map"
        )
    return terrain


def _localised(
    entry: SceneEntry, notes: list[str], offset: tuple[float, float, float] | None = None
) -> tuple[SceneEntry, tuple[float, float, float] | None]:
    """The entries without the offset of a georeferenced map, and the offset: given, or found where surfaces need one."""
    offset = offset or entry.origin_offset
    far = [v for surface in entry.surfaces for v in surface.vertices if abs(v[0]) > FAR or abs(v[1]) > FAR]
    far += [box.pose.xyz for box in entry.obstacles if is_far(box.pose.xyz)]
    far += [(*m.origin, 0.0) for m in entry.heightmaps if is_far(m.origin)]
    if offset is None and far:
        offset = offset_for(np.array(far))
        notes.append(offset_note(offset))
    if offset is None:
        return entry, None

    def local(xyz: Sequence[float]) -> tuple[float, float, float]:
        x, y, z = to_local(np.array(xyz, float), offset).tolist()
        return x, y, z

    def place(xyz: tuple[float, float, float | None]) -> tuple[float, float, float | None]:
        x, y, z = local((*xyz[:2], xyz[2] or 0.0))
        return x, y, None if xyz[2] is None else z

    def moved(pose: PoseEntry) -> PoseEntry:
        return pose.model_copy(update={"xyz": local(pose.xyz)})

    surfaces = [
        s.model_copy(update={"vertices": [tuple(v) for v in to_local(np.array(s.vertices, float), offset).tolist()]})
        for s in entry.surfaces
    ]
    boxes = [box.model_copy(update={"pose": moved(box.pose)}) for box in entry.obstacles]
    disturbances = [
        d
        if d.region is None
        else d.model_copy(update={"region": d.region.model_copy(update={"pose": moved(d.region.pose)})})
        for d in entry.disturbances
    ]
    start, goal = entry.start, entry.goal
    if start is not None and start.xyz is not None:
        start = start.model_copy(update={"xyz": place(start.xyz)})
    if start is not None and start.stance is not None:
        held = {e: c.model_copy(update={"xyz": local(c.xyz)}) for e, c in start.stance if c is not None}
        start = start.model_copy(update={"stance": start.stance.model_copy(update=held)})
    if goal is not None:
        goal = goal.model_copy(update={"xyz": place(goal.xyz)})
    update = {"surfaces": surfaces, "obstacles": boxes, "disturbances": disturbances, "start": start, "goal": goal}
    return entry.model_copy(update=update), offset


def _note_degrees(entry: SceneEntry, notes: list[str]) -> None:
    for key, end in (("start", entry.start), ("goal", entry.goal)):
        if end is not None and end.yaw is not None and abs(end.yaw) > 2 * np.pi:
            notes.append(
                f"{key}.yaw: {end.yaw:g} rad is more than a turn, as if it were in degrees: files hold radians, "
                f"{end.yaw:g} deg are {np.deg2rad(end.yaw):.4g} rad"
            )


def terrain_reach(terrain: Terrain) -> float:
    """How far out the terrain's farthest coordinate lies [m]."""
    return float(np.abs(terrain.extent).max())


def _pose(pose: PoseEntry) -> np.ndarray:
    return pose_matrix(pose.xyz, pose.rpy)


def _surface(
    entry: SurfaceEntry, index: int, friction: float, source: str, notes: list[str], twins_within: float
) -> Surface:
    """The surface of an entry, turned over where its `normal` or the feet that should stand on it ask for it."""
    where = f"surfaces[{index}]"
    vertices = np.array(entry.vertices, float)
    name = entry.name or f"surface_{index}"
    flat, off_plane = flattened(vertices)
    if FLATTENED[0] < off_plane <= FLATTENED[1]:
        vertices = flat
        notes.append(
            f"{where}: {name!r} is not flat; its corners were moved onto the best plane, by up to {1e3 * off_plane:.2g} mm"
        )
    twins = np.flatnonzero(np.linalg.norm(vertices - np.roll(vertices, -1, axis=0), axis=1) < twins_within)
    if len(twins):
        first, second = int(twins[0]), (int(twins[0]) + 1) % len(vertices)
        raise InputError(f"{source}: {where}.vertices: expected corners apart, [{first}] and [{second}] are the same")
    effectors = None if entry.contact is None else frozenset(entry.contact)
    try:
        surface = Surface(name, vertices, friction if entry.friction is None else entry.friction, effectors)
    except InputError as error:
        problem = str(error).removeprefix(f"surface {name!r}: ")
        key, _, rest = problem.partition(" ")
        raise InputError(f"{source}: {where}.{key}: {name!r} {rest}") from None
    if entry.normal is not None:
        length = np.linalg.norm(entry.normal)
        along = 0.0 if length < 1e-9 else float(surface.normal @ entry.normal) / length
        if abs(along) < NORMAL_AGREES:
            n = ", ".join(f"{x:.3g}" for x in surface.normal)
            raise InputError(f"{source}: {where}.normal: expected [{n}] or its opposite, got {list(entry.normal)}")
        if along < 0:
            surface = surface.flipped()
            notes.append(f"{where}: {name!r} is clockwise seen from the side of its normal; its order was reversed")
    if _is_upside_down(surface, given=entry.normal is not None):
        surface = surface.flipped()
        notes.append(f"{where}: {name!r} faced down; it was flipped so that feet can stand on it")
    return surface


def _is_upside_down(surface: Surface, *, given: bool) -> bool:
    """Whether a polygon is meant for feet and faces down.

    Feet are named in `contact`, or nobody is and neither feet nor palms could use it as it lies; a normal that was
    given makes the latter a ceiling.
    """
    if surface.normal[2] >= 0:
        return False
    if surface.effectors is not None:
        return any(is_foot(effector) for effector in surface.effectors)
    return not given and not any(surface.allows(effector) for effector in EFFECTORS)


def _box(entry: ObstacleEntry, index: int) -> Box:
    return Box(entry.name or f"obstacle_{index}", np.array(entry.box), _pose(entry.pose))


def _without_boxes(triangles: np.ndarray, obstacles: Sequence[Box]) -> np.ndarray:
    """(K, 3, 3) the triangles that are not, to a micrometre, those of a box."""
    if not obstacles:
        return triangles
    boxes = np.concatenate([o.triangles() for o in obstacles]).reshape(-1, 9)
    known = {row.tobytes() for row in np.round(boxes, 5) + 0.0}
    keep = [row.tobytes() not in known for row in np.round(triangles.reshape(-1, 9), 5) + 0.0]
    return triangles[keep]


def _meshes(
    entries: list[MeshEntry],
    friction: float,
    source: str,
    folder: Path | None,
    offset: tuple[float, float, float] | None,
) -> tuple[list[MeshImport], tuple[float, float, float] | None]:
    """The meshes, and the offset that was given or that the first georeferenced one has told."""
    imported, names = [], set()
    for i, entry in enumerate(entries):
        where = f"{source}: meshes[{i}].file"
        path = mesh_path(entry.file, folder, where)
        name = stem = mesh_name(path)
        while name in names:
            name = f"{stem}_{i}"
            stem = name
        names.add(name)
        scale = entry.scale if "scale" in entry.model_fields_set else None
        try:
            mesh = import_mesh(
                path,
                reference=entry.file,
                name=name,
                X_WM=_pose(entry.pose),
                scale=scale,
                friction=friction,
                origin_offset=offset,
            )
        except InputError as error:
            raise InputError(f"{where}: {error}") from None
        offset = offset or mesh.origin_offset
        imported.append(mesh)
    return imported, offset


def _height_maps(
    entries: list[HeightMapEntry],
    friction: float,
    source: str,
    folder: Path | None,
    offset: tuple[float, float, float] | None,
) -> list[MeshImport]:
    imported = []
    for i, entry in enumerate(entries):
        where = f"{source}: heightmaps[{i}].file"
        path = mesh_path(entry.file, folder, where)
        shift = offset[:2] if offset is not None and is_far(entry.origin) else (0.0, 0.0)
        try:
            imported.append(
                import_height_map(
                    path,
                    reference=entry.file,
                    name=f"{mesh_name(path)}_map{i}" if i else f"{mesh_name(path)}_map",
                    resolution=entry.resolution,
                    origin=entry.origin,
                    friction=friction if entry.friction is None else entry.friction,
                    shift=shift,
                )
            )
        except InputError as error:
            raise InputError(f"{where}: {error}") from None
    return imported


def _check_names(names: list[str], key: str, source: str) -> None:
    seen: dict[str, int] = {}
    for i, name in enumerate(names):
        if not name.isprintable():
            raise InputError(f"{source}: {key}[{i}].name: expected printable text, got {name!r}")
        if name in seen:
            raise InputError(f"{source}: {key}[{i}].name: {name!r} is the name of {key}[{seen[name]}] already")
        seen[name] = i


def _start(entry: StartEntry, terrain: Terrain, source: str) -> Start:
    if entry.stance is None:
        if entry.xyz is None:
            raise InputError(f"{source}: start: expected xyz or stance")
        return Start(_place(entry.xyz), entry.yaw or 0.0)
    if entry.xyz is not None or entry.yaw is not None:
        raise InputError(f"{source}: start: expected xyz and yaw, or stance, not both")
    given = [(e, getattr(entry.stance, e)) for e in EFFECTORS]
    contacts = tuple(_contact(e, c, terrain, source) for e, c in given if c is not None)
    feet = [c for c in contacts if is_foot(c.effector)]
    if not feet:
        raise InputError(f"{source}: start.stance: expected a foot on the ground")
    mean = np.mean([c.p_WC for c in feet], axis=0)
    yaw = np.arctan2(sum(np.sin(c.heading) for c in feet), sum(np.cos(c.heading) for c in feet))
    return Start((float(mean[0]), float(mean[1]), float(mean[2])), float(yaw), contacts)


def _place(xyz: tuple[float, float, float | None]) -> tuple[float, float, float]:
    """The place with NaN for a height that is left open."""
    x, y, z = xyz
    return x, y, np.nan if z is None else z


def _contact(effector: str, entry: ContactEntry, terrain: Terrain, source: str) -> Contact:
    where = f"{source}: start.stance.{effector}"
    names = [surface.name for surface in terrain.surfaces]
    if entry.surface not in names:
        raise InputError(f"{where}.surface: {unknown_name('surface', entry.surface, names)}")
    index = names.index(entry.surface)
    surface = terrain.surfaces[index]
    if not surface.allows(effector):
        raise InputError(f"{where}.surface: {surface.name!r} does not take a {effector}")
    X_WC = pose_matrix(entry.xyz, entry.rpy)
    height = float((X_WC[:3, 3] - surface.centroid) @ surface.normal)
    edges = np.roll(surface.vertices, -1, axis=0) - surface.vertices
    inward = np.cross(surface.normal, edges) / np.linalg.norm(edges, axis=1, keepdims=True)
    inside = float(((X_WC[:3, 3] - surface.vertices) * inward).sum(axis=1).min())
    if abs(height) > CONTACT_OFF or inside < -CONTACT_OFF:
        raise InputError(
            f"{where}.xyz: expected a point on {surface.name!r}, this one is {height:.3g} m above its plane and "
            f"{max(-inside, 0.0):.3g} m outside its edges"
        )
    if X_WC[:3, 2] @ surface.normal < CONTACT_TILT:
        raise InputError(f"{where}.rpy: expected the z axis along the normal of {surface.name!r}")
    return Contact(effector, index, X_WC, surface.friction, _heading(effector, X_WC[:3, :3]))


def _heading(effector: str, R_WC: np.ndarray) -> float:
    """Yaw of the level direction whose projection on the contact's plane is its x axis [rad]; 0 for fingers up."""
    if not is_foot(effector) and abs(R_WC[2, 2]) < NEAR_LEVEL:
        return 0.0
    level = R_WC[2, 2] * R_WC[:2, 0] - R_WC[2, 0] * R_WC[:2, 2]
    return float(np.arctan2(level[1], level[0]))


def _disturbance(entry: DisturbanceEntry) -> Disturbance:
    region = entry.region
    return Disturbance(
        np.array(entry.impulses, float),
        entry.probability,
        None if region is None else region.box,
        None if region is None else _pose(region.pose),
    )
