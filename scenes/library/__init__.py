"""The named scenes, one family per file; each is a function of a seed, and its docstring's first line describes it."""

from __future__ import annotations

from collections.abc import Callable

from scenes.library import (
    flat,
    narrow_flat,
    oil_platform,
    random_surfaces,
    rubble_corridor,
    rubble_field,
    rubble_with_wall,
    slippery_slope,
    stairs,
    steep_slope,
    three_corridors,
    tilted_slab,
    two_corridors,
    two_staircases,
    wide_gap,
    wider_gap,
)
from scenes.scene import Scene

NAMED_SCENES: dict[str, Callable[[int], Scene]] = {
    "flat": flat.named,
    "stairs": stairs.named,
    "rubble_field": rubble_field.named,
    "rubble_corridor": rubble_corridor.named,
    "wide_gap": wide_gap.named,
    "wider_gap": wider_gap.named,
    "steep_slope": steep_slope.named,
    "slippery_slope": slippery_slope.named,
    "narrow_flat": narrow_flat.named,
    "rubble_with_wall": rubble_with_wall.named,
    "oil_platform": oil_platform.named,
    "oil_platform_y": oil_platform.with_wind_to_y,
    "tilted_slab": tilted_slab.named,
    "random_surfaces": random_surfaces.named,
    "three_corridors": three_corridors.named,
    "two_corridors": two_corridors.named,
    "two_staircases": two_staircases.named,
}
