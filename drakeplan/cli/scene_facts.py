"""What is said of a scene: counts, areas, extent, start and goal."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from scenes.scene import Scene


def scene_facts(scene: Scene) -> dict[str, object]:
    """For a machine; the notes of its reading are in it."""
    import dataclasses

    from scenes.terrain.packed_terrain import pack_terrain
    from scenes.terrain.usable_area import usable_area

    lowest, highest = scene.terrain.extent
    start, goal = scene.start, scene.goal
    floor = pack_terrain(scene.terrain).floor
    areas = dataclasses.asdict(usable_area(scene.terrain))
    frictions = [s.friction for s in scene.terrain.surfaces]
    return {
        "name": scene.name,
        "surfaces": len(scene.terrain.surfaces),
        "for_feet": sum(bool(s.allows("left_foot")) for s in scene.terrain.surfaces),
        "for_palms": sum(bool(s.allows("left_palm")) for s in scene.terrain.surfaces),
        "floors": int((floor < 0).sum() + len(set(floor[floor >= 0].tolist()))),
        "areas": {f"{key}_m2": round(value, 4) for key, value in areas.items()},
        "friction": sorted(set(frictions)),
        "obstacles": len(scene.terrain.obstacles),
        "triangles": len(scene.terrain.triangles),
        "from": [round(float(v), 3) for v in lowest],
        "to": [round(float(v), 3) for v in highest],
        "start": None if start is None else {"xyz": list(start.xyz), "yaw": start.yaw, "contacts": len(start.stance)},
        "goal": None if goal is None else {"xyz": list(goal.xyz), "radius": goal.radius, "yaw": goal.yaw},
        "robot": scene.robot,
        "disturbances": len(scene.disturbances),
        "origin_offset": None if scene.origin_offset is None else list(scene.origin_offset),
        "notes": list(scene.notes),
    }


def print_facts(facts: Mapping[str, object], notes: Sequence[str]) -> None:
    """For a person, a line each.

    Args:
        facts: of a scene; notes in them are left out.
        notes: of its reading.
    """
    for key, value in facts.items():
        if key != "notes" and value not in (None, []):
            print(f"{key.replace('_', ' '):<12} {_words(value)}")
    for note in notes:
        print(f"note         {note}")


def _words(value: object) -> str:
    if isinstance(value, Mapping):
        return ", ".join(f"{key} {_words(item)}" for key, item in value.items() if item is not None)
    if isinstance(value, list):
        return " ".join(_words(item) for item in value)
    return f"{value:g}" if isinstance(value, float) else str(value)
