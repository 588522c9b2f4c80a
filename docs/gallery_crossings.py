"""The crossings of the gallery: what `docs/make_gallery.py` plans and the page shows."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Crossing:
    """One page of the gallery.

    Attributes:
        name: of its files.
        arguments: of `drakeplan plan`.
        title: a few words.
        about: a sentence or two.
    """

    name: str
    arguments: str
    title: str
    about: str

    @property
    def command(self) -> str:
        """What a reader types."""
        return f"drakeplan plan {self.arguments} --html {self.name}.html"


CROSSINGS = (
    Crossing("rubble_corridor", "rubble_corridor --seed 0", "Rubble corridor",
             "Tilted stones between two walls; palms lean on one of them."),
    Crossing("rubble_field", "rubble_field --seed 0", "Rubble field", "Twelve stones tilted up to 20 degrees, feet alone."),
    Crossing("stairs", "stairs", "Stairs", "Five treads of 15 cm and a landing."),
    Crossing("tilted_slab", "tilted_slab", "Tilted slab",
             "Tipped sideways by 30 degrees: friction 0.5 holds no foot there without a palm on the wall."),
    Crossing("random_surfaces", "random_surfaces --seed 3 --planner parallel", "Random surfaces",
             "Quadrilaterals that cut each other; search and stored plans at once."),
    Crossing("two_corridors", "two_corridors --planner guided", "Rooms and corridors",
             "A guiding path of the torso, cut into segments."),
    Crossing("two_staircases", "two_staircases --planner guided", "Rooms and staircases",
             "Nine stairs between two rooms, half of them rubble."),
    Crossing("three_corridors", "three_corridors --heuristic traversability", "Three corridors",
             "Learned traversability leads the search away from the sparse ones."),
    Crossing("slippery_slope",
             "slippery_slope --dynamics exact --cone second_order --shift 0.3 --swing 0.6",
             "Slippery slope", "27 degrees at friction 0.5: nobody can stand there, so the robot keeps moving."),
    Crossing("wide_gap", "wide_gap", "Gap of 0.5 m", "A stride of 0.72 m with feet of 0.22 m."),
    Crossing("rubble_with_wall", "rubble_with_wall --seed 1 --capture swing", "Pushed beside a wall",
             "The steps stay where a palm could catch the robot."),
    Crossing("oil_platform", "oil_platform --capture worst-case", "Platform in the wind",
             "The longer way round, sheltered from the gusts."),
    Crossing("darpa", "hpp/darpa --start -3.6 0 0 --goal 3.9 0", "DARPA rubble",
             "A mesh of hpp-environments, read as it is."),
    Crossing("talos_corridor", "rubble_corridor --seed 0 --robot talos", "Rubble corridor, talos",
             "The same corridor for the robot of PAL Robotics."),
    Crossing("g1_field", "rubble_field --seed 0 --robot g1", "Rubble field, g1", "The small robot of Unitree."),
    Crossing("jvrc1_stairs", "stairs --robot jvrc1", "Stairs, jvrc1", "The model of the Japan Virtual Robotics Challenge."),
)  # fmt: skip
FIRST = CROSSINGS[0]  # plays on the start page
