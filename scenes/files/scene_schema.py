"""The keys of a scene file, their types and limits, and a one-line error for the first violation."""

from __future__ import annotations

import difflib
from typing import Annotated, Literal

from pydantic import BaseModel, BeforeValidator, ConfigDict, Field, ValidationError
from pydantic_core import ErrorDetails

from scenes.files.strict_yaml import key_path
from scenes.input_error import InputError

FORMAT = "drakeplan-scene"
VERSION = 1
FAR = 1e5  # [m] no coordinate is farther out; beyond it doubles lose the micrometre
MAX_CORNERS = 100

GEOREFERENCED = 1e8  # [m] no easting or northing is larger
Number = Annotated[float, Field(strict=True, allow_inf_nan=False, ge=-FAR, le=FAR)]
Easting = Annotated[float, Field(strict=True, allow_inf_nan=False, ge=-GEOREFERENCED, le=GEOREFERENCED)]
Positive = Annotated[float, Field(strict=True, allow_inf_nan=False, gt=0, le=FAR)]
Friction = Annotated[float, Field(strict=True, allow_inf_nan=False, ge=0, le=10)]
Probability = Annotated[float, Field(strict=True, allow_inf_nan=False, ge=0, le=1)]
Name = Annotated[str, Field(strict=True, min_length=1, max_length=200)]
Triple = tuple[Number, Number, Number]


def _open_height(place: object) -> object:
    """A place of two numbers with its third left open."""
    return [*place, None] if isinstance(place, list) and len(place) == 2 else place


Point = tuple[Easting, Easting, Number]  # may be georeferenced: see scenes.terrain.georeference
Place = Annotated[tuple[Easting, Easting, Number | None], BeforeValidator(_open_height)]
Effector = Literal["left_foot", "right_foot", "left_palm", "right_palm"]


class _Strict(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True)


class PoseEntry(_Strict):
    """A pose: xyz [m] and rpy [rad]."""

    xyz: Point = (0.0, 0.0, 0.0)
    rpy: Triple = (0.0, 0.0, 0.0)


class SurfaceEntry(_Strict):
    """A convex planar polygon, counter-clockwise seen from outside [m]."""

    name: Name | None = None
    vertices: Annotated[list[Point], Field(min_length=3, max_length=MAX_CORNERS)]
    normal: Triple | None = None
    friction: Friction | None = None
    contact: list[Effector] | None = None


class MeshEntry(_Strict):
    """A mesh file, where its frame lies, and how much larger to make it."""

    file: Name
    pose: PoseEntry = PoseEntry()
    scale: Positive = 1.0


class HeightMapEntry(_Strict):
    """An npz file with an array `height` [m], the edge of its cells, where its first height lies, and its friction."""

    file: Name
    resolution: Annotated[float, Field(strict=True, allow_inf_nan=False, ge=1e-3, le=FAR)]
    origin: tuple[Easting, Easting] = (0.0, 0.0)
    friction: Friction | None = None


class ObstacleEntry(_Strict):
    """A box [m]; with `contact` its sides are surfaces for these end effectors, else nothing may touch it."""

    name: Name | None = None
    box: tuple[Positive, Positive, Positive]
    pose: PoseEntry = PoseEntry()
    friction: Friction | None = None
    contact: list[Effector] | None = None


class RegionEntry(_Strict):
    """A box [m] in which the centre of mass is pushed."""

    box: tuple[Positive, Positive, Positive]
    pose: PoseEntry = PoseEntry()


class DisturbanceEntry(_Strict):
    """Impulses [kg m/s] and their probability per 0.1 s."""

    region: RegionEntry | None = None
    impulses: Annotated[list[Triple], Field(min_length=1)]
    probability: Probability


class ContactEntry(_Strict):
    """One end effector on one surface."""

    surface: Name
    xyz: Point
    rpy: Triple = (0.0, 0.0, 0.0)


class StanceEntry(_Strict):
    """The contacts to start from."""

    left_foot: ContactEntry | None = None
    right_foot: ContactEntry | None = None
    left_palm: ContactEntry | None = None
    right_palm: ContactEntry | None = None


class StartEntry(_Strict):
    """The mean of the feet [m] and the heading [rad], or a whole stance; without a third number any floor."""

    xyz: Place | None = None
    yaw: Number | None = None
    stance: StanceEntry | None = None


class GoalEntry(_Strict):
    """Where the mean of the feet should end [m], how near, and the heading [rad]; without a third number any floor."""

    xyz: Place
    radius: Positive = 0.2
    yaw: Number | None = None


class SceneEntry(_Strict):
    """A whole scene file."""

    format: Literal["drakeplan-scene"]
    version: Literal[1]
    name: Name | None = None
    robot: Name | None = None
    friction: Friction = 0.5
    surfaces: list[SurfaceEntry] = []
    meshes: list[MeshEntry] = []
    origin_offset: Point | None = None
    heightmaps: list[HeightMapEntry] = []
    obstacles: list[ObstacleEntry] = []
    disturbances: list[DisturbanceEntry] = []
    start: StartEntry | None = None
    goal: GoalEntry | None = None


def parse_scene(data: object, source: str) -> SceneEntry:
    """The entries of a scene file that has been read into plain data.

    Args:
        data: what the YAML text holds: mappings, lists, numbers and texts.
        source: the file's name, for errors.

    Raises:
        InputError: one line with the source, the key and what was expected there.
    """
    if not isinstance(data, dict) or data.get("format") != FORMAT:
        raise InputError(f"{source}: format: expected a scene file that says 'format: {FORMAT}'")
    version = data.get("version")
    if type(version) is not int or version != VERSION:
        raise InputError(f"{source}: version: expected {VERSION}, the one that this drakeplan reads, got {version!r}")
    try:
        return SceneEntry.model_validate(data)
    except ValidationError as error:
        problems = error.errors(include_url=False, include_context=True)
        # A misspelt key shows up as unknown and as missing: the unknown one is what the user can see.
        first = next((p for p in problems if p["type"] == "extra_forbidden"), problems[0])
        more = f" (and {len(problems) - 1} more)" if len(problems) > 1 else ""
        raise InputError(f"{source}: {_explain(first)}{more}") from None


def _explain(problem: ErrorDetails) -> str:
    path = list(problem["loc"])
    where, got, kind = key_path(path), _shorten(problem["input"]), problem["type"]
    limits = problem.get("ctx", {})
    if kind == "extra_forbidden":
        known = sorted(_model_at(path[:-1]).model_fields)
        near = difflib.get_close_matches(str(path[-1]), known, n=1)
        meant = f"did you mean {near[0]!r}?" if near else f"expected some of {', '.join(known)}"
        return f"{where}: unknown key, {meant}"
    if kind == "missing" and isinstance(path[-1], int):
        return f"{key_path(path[:-1])}: expected at least {path[-1] + 1} entries, got {path[-1]}"
    if kind == "missing":
        return f"{where}: missing, expected {_what(path)}"
    if kind == "finite_number":
        return f"{where}: expected a finite number, got {got}"
    if kind in ("float_type", "int_type", "float_parsing"):
        return f"{where}: expected a number, got {got}"
    if kind in ("greater_than", "greater_than_equal", "less_than", "less_than_equal"):
        sign = {"gt": "more than", "ge": "at least", "lt": "less than", "le": "at most"}
        key, limit = next(iter(limits.items()))
        return f"{where}: expected {sign[key]} {limit:g}, got {got}"
    if kind in ("too_short", "too_long", "string_too_short", "string_too_long"):
        counts = {k: limits[k] for k in ("min_length", "max_length") if k in limits}
        sign = {"min_length": "at least", "max_length": "at most"}
        key, limit = next(iter(counts.items()))
        return f"{where}: expected {sign[key]} {limit} {'letter(s)' if 'string' in kind else 'entries'}, got {got}"
    if kind in ("model_type", "model_attributes_type", "dict_type"):
        return f"{where}: expected a mapping like {{key: value}}, got {got}"
    if kind in ("list_type", "tuple_type"):
        return f"{where}: expected a list like [a, b, c], got {got}"
    if kind == "string_type":
        return f"{where}: expected text, got {got}"
    if kind == "literal_error":
        return f"{where}: expected {limits.get('expected', 'another value')}, got {got}"
    return f"{where}: {problem['msg']}, got {got}"


def _shorten(value: object) -> str:
    text = repr(value)
    return text if len(text) <= 60 else text[:57] + "..."


def _what(path: list[str | int]) -> str:
    """What a missing entry should have been."""
    shapes = {"vertices": "a list of [x, y, z]", "xyz": "[x, y, z]", "box": "[x, y, z] edge lengths"}
    return shapes.get(str(path[-1]), "a value")


def _model_at(path: list[str | int]) -> type[_Strict]:
    """The model that holds the entry of this path; keys decide it, so a walk over the file's own words is enough."""
    models: dict[str, type[_Strict]] = {
        "surfaces": SurfaceEntry,
        "meshes": MeshEntry,
        "heightmaps": HeightMapEntry,
        "obstacles": ObstacleEntry,
        "disturbances": DisturbanceEntry,
        "pose": PoseEntry,
        "region": RegionEntry,
        "start": StartEntry,
        "stance": StanceEntry,
        "goal": GoalEntry,
        "left_foot": ContactEntry,
        "right_foot": ContactEntry,
        "left_palm": ContactEntry,
        "right_palm": ContactEntry,
    }
    keys = [key for key in path if isinstance(key, str)]
    return models[keys[-1]] if keys else SceneEntry
