"""What a browser really shows: the page is rendered by headless Chromium and its pixels are looked at."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import matplotlib.image
import numpy as np
import pytest

from drakeplan import playback
from drakeplan.plan.plan import Plan
from drakeplan.playback.picture import find_browser, take_picture

pytestmark = [
    pytest.mark.browser,
    pytest.mark.slow,
    pytest.mark.skipif(find_browser() is None, reason="no Chromium on this machine (Debian: apt-get install chromium)"),
]

SIZE = (1000, 600)
ENOUGH = 30  # pixels that a contact patch of the plan covers at least
EFFECTOR_HUES = {"left foot": 0.0, "right foot": 125.0, "left palm": 187.0, "right palm": 308.0}  # [deg]
SUPPORT_HUE = 55.0  # [deg]; the goal's and the forces' are below 45


@dataclasses.dataclass(frozen=True)
class Seen:
    """What can be told from a picture, in pixels."""

    contacts: dict[str, int]
    terrain: int
    robot: int
    robot_centre: float  # column
    supports: int


def look(picture: Path) -> Seen:
    """Counts pixels by colour. The legend, which has the same colours, must be hidden."""
    rgb = matplotlib.image.imread(picture)[..., :3].astype(float)
    high, low = rgb.max(axis=2), rgb.min(axis=2)
    chroma = high - low
    r, g, b = np.moveaxis(rgb, 2, 0)
    spread = np.where(chroma > 0, chroma, 1.0)
    hue = np.select([high == r, high == g], [((g - b) / spread) % 6, (b - r) / spread + 2], (r - g) / spread + 4) * 60
    vivid = (chroma > 0.45) & (chroma > 0.65 * high)
    contacts = {
        name: int((vivid & (np.abs((hue - wanted + 180) % 360 - 180) < 12)).sum())
        for name, wanted in EFFECTOR_HUES.items()
    }
    stone = (r >= b) & (chroma < 0.2) & (high > 0.3) & (high < 0.85)  # the sky is bluer than red
    dark = (high < 0.22) & (chroma < 0.1)  # joints, soles and palms of the robot; nothing else is so dark and so large
    columns = np.nonzero(dark)[1]
    centre = float(columns.mean()) if len(columns) else float("nan")
    yellow = (chroma > 0.4) & (np.abs(hue - SUPPORT_HUE) < 6)
    return Seen(contacts, int(stone.sum()), int(dark.sum()), centre, int(yellow.sum()))


def shows_the_plan(seen: Seen) -> bool:
    """Terrain, robot and the contacts of every end effector."""
    return min(seen.contacts.values()) >= ENOUGH and seen.terrain > 10_000 and seen.robot > 1500


@pytest.fixture(scope="module")
def page(strolling_plan: Plan, tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("page") / "plan.html"
    playback.write_page(strolling_plan, path)
    return path


def picture_of(page: Path, time: float | None = None, *, supports: bool = True) -> Seen:
    png = page.with_suffix(f".{time}.{supports}.png")
    take_picture(page, png, time=time, size=SIZE, legend=False, supports=supports)
    return look(png)


def test_terrain_robot_and_contacts_of_every_end_effector_are_in_the_picture(page: Path) -> None:
    seen = picture_of(page, time=2.0)
    assert shows_the_plan(seen), seen


def test_the_robot_walks_when_time_goes_on(page: Path, strolling_plan: Plan) -> None:
    early, late = picture_of(page, time=0.3), picture_of(page, time=strolling_plan.duration - 0.3)
    assert abs(late.robot_centre - early.robot_centre) > 0.1 * SIZE[0]


def test_what_carries_is_seen_through_the_feet_unless_the_layer_is_off(page: Path) -> None:
    """The soles hide their patches, so that only what is drawn over them can show there."""
    assert picture_of(page, time=1.0).supports > 3 * ENOUGH
    assert picture_of(page, time=1.0, supports=False).supports < ENOUGH


def test_a_plan_of_contacts_alone_shows_no_robot(strolling_plan: Plan, tmp_path: Path) -> None:
    playback.write_page(
        dataclasses.replace(strolling_plan, phases=None, centroidal=None, motion=None), tmp_path / "contacts.html"
    )
    seen = picture_of(tmp_path / "contacts.html")
    assert min(seen.contacts.values()) >= ENOUGH
    assert seen.terrain > 10_000
    assert not shows_the_plan(seen)


def test_a_page_that_draws_nothing_would_be_noticed(page: Path, tmp_path: Path) -> None:
    """The same page without its messages: chromium still ends well and writes a picture."""
    text = page.read_text(encoding="utf-8").replace("viewer.handle_command_bytearray(", "void (")
    blank = tmp_path / "blank.html"
    blank.write_text(text, encoding="utf-8")
    seen = picture_of(blank)
    assert not shows_the_plan(seen)
    assert max(seen.contacts.values()) < ENOUGH
