"""What a browser really shows: the page runs in headless Chromium, its keys are pressed and its pixels are looked at.

A browser takes seconds to start, so that all questions about a page are asked in one go, by a script at its end.
"""

from __future__ import annotations

import base64
import dataclasses
import html
import io
import json
import re
import subprocess
import tempfile
from pathlib import Path

import matplotlib.image
import numpy as np
import pytest

from drakeplan import playback
from drakeplan.plan.plan import Plan
from drakeplan.playback.contact_timeline import contact_timeline
from drakeplan.playback.friction_used import friction_used
from drakeplan.playback.picture import FLAGS, find_browser, take_picture
from drakeplan.playback.share_colours import palette

pytestmark = [
    pytest.mark.browser,
    pytest.mark.slow,
    pytest.mark.skipif(find_browser() is None, reason="no Chromium on this machine (Debian: apt-get install chromium)"),
]

SIZE = (1000, 600)
ENOUGH = 30  # pixels that a contact patch of the plan covers at least
EFFECTOR_HUES = {"left foot": 0.0, "right foot": 125.0, "left palm": 187.0, "right palm": 308.0}  # [deg]
SUPPORT_HUE = 55.0  # [deg]; the goal's is below 45
PATIENCE = 120.0  # [s]

# Without a screen Chromium draws no frames while virtual time runs; timers stand in for them.
FRAMES = "<script>window.requestAnimationFrame = (draw) => setTimeout(() => draw(performance.now()), 16);</script>"
# What every script below may use. `said` is what Python gets.
TOOLS = """
const said = {}, bar = document.getElementById("plan-time");
const frames = async (n) => { while (n--) await new Promise(requestAnimationFrame); };
const press = async (key) => {
  document.body.dispatchEvent(new KeyboardEvent("keydown", {key, bubbles: true, cancelable: true}));
  await frames(2);
};
const part = (name) => document.querySelector("#plan-time ." + name);
const box = (name) => part(name + " input");
const go = async (time) => { const range = bar.querySelector("[type=range]"); range.value = time; range.oninput(); await frames(2); };
const views = () => window.planViewers || [viewer];
const picture = (view = viewer) => {
  view.renderer.shadowMap.needsUpdate = true;
  return view.capture_image(WIDTH, HEIGHT).split(",")[1];
};
for (const view of views()) {  // what nobody looks at is drawn small and with the shadows it has
  view.dom_element.style.width = view.dom_element.style.height = "50px";
  view.set_3d_pane_size();
  view.renderer.shadowMap.autoUpdate = false;
}
const words = (k = 0) => document.querySelectorAll(".plan-caption")[k].textContent;
""".replace("WIDTH", str(SIZE[0])).replace("HEIGHT", str(SIZE[1]))


def ask(page: Path, script: str, options: str = "") -> dict:
    """Runs a script in the page and gives what it said."""
    browser = find_browser()
    assert browser is not None
    asked = page.with_name(f"{page.stem}_asked.html")
    text = page.read_text(encoding="utf-8").replace("<head>", f"<head>{FRAMES}", 1)
    head, end, tail = text.rpartition("</body>")
    body = f"""<pre id="said"></pre><script>(async () => {{ {TOOLS}
      try {{ while (bar.hidden) await frames(1); {script} }} catch (error) {{ said.error = error.stack; }}
      document.getElementById("said").textContent = JSON.stringify(said) + ";";
    }})();</script>"""
    asked.write_text(head + body + end + tail, encoding="utf-8")
    with tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as profile:
        command = [browser, *FLAGS, f"--user-data-dir={profile}", f"--window-size={SIZE[0]},{SIZE[1]}"]
        command += ["--virtual-time-budget=20000", "--dump-dom", f"{asked.as_uri()}#{options}"]
        done = subprocess.run(command, capture_output=True, text=True, timeout=PATIENCE, check=False)
    found = re.findall(r'<pre id="said">(\{.*?\});</pre>', done.stdout, flags=re.DOTALL)
    assert found, done.stderr[-2000:]
    answer = json.loads(html.unescape(found[-1]))
    assert "error" not in answer, answer["error"]
    return answer


@dataclasses.dataclass(frozen=True)
class Seen:
    """What can be told from a picture, in pixels."""

    contacts: dict[str, int]
    terrain: int
    robot: int
    robot_centre: float  # column
    supports: int


def look(picture: Path | str) -> Seen:
    """Counts pixels by colour, in a file or in base64. Legends, which have the same colours, must not be in it."""
    png = io.BytesIO(base64.b64decode(picture)) if isinstance(picture, str) else picture
    rgb = matplotlib.image.imread(png, format="png")[..., :3].astype(float)
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


# ---- one plan

ONE_PLAN = """
  said.buttons = [...bar.querySelectorAll("button, input")].map((b) => b.getAttribute("aria-label") || b.parentElement.className);
  said.outside = performance.getEntriesByType("resource").map((r) => r.name).filter((name) => !name.startsWith("data:"));
  const time = () => viewer.animator.time;
  said.stepped = [];
  for (const key of ["ArrowRight", "ArrowRight", "ArrowRight", "ArrowLeft", "ArrowLeft", "ArrowLeft"]) {
    await press(key);
    said.stepped.push([time(), words(), viewer.animator.playing]);
  }
  said.speeds = [];
  for (const key of "+++-------") {
    await press(key);
    said.speeds.push(viewer.animator.mixer.timeScale);
  }
  said.shown_speed = part("speed").textContent;
  await press(" "); said.plays = viewer.animator.playing;
  await press(" "); said.still_plays = viewer.animator.playing;

  const eye = () => viewer.camera.position.toArray(), aim = () => viewer.controls.target.toArray();
  await go(1.0); said.before = [eye(), aim()];
  await press("f"); said.follows = [box("follow").checked, aim()];
  await go(3.0); said.followed = aim();
  await press("F"); said.after = [eye(), aim()];

  await go(1.0);
  for (const layer of ["supports", "forces"]) {
    box(layer).click();
    said["without_" + layer] = picture();
    box(layer).click();
  }
  said.early = picture();
  const cone = (name) => viewer.scene_tree.find(["drakeplan", "forces", name, "head", "cone", "<object>"]).object;
  const colour = (name) => cone(name).material.color.getHexString();
  said.colours = { left_foot: colour("left_foot"), right_foot: colour("right_foot") };
  if (!box("torques").checked) box("torques").click();
  await frames(2);
  said.bars = [...document.querySelectorAll(".plan-torques div")].map((row) => [...row.children].map((c) => c.textContent));
  await go(DURATION - 0.3); said.late = picture();
  viewer.set_property(["drakeplan"], "visible", false); said.nothing = picture();
"""


@pytest.fixture(scope="module")
def said(strolling_plan: Plan, tmp_path_factory: pytest.TempPathFactory) -> dict:
    path = tmp_path_factory.mktemp("page") / "plan über.html"
    playback.write_page(strolling_plan, path)
    return ask(path, ONE_PLAN.replace("DURATION", str(strolling_plan.duration)), "t=0")


def test_every_button_is_there_and_nothing_is_fetched(said: dict) -> None:
    assert said["buttons"] == [
        "previous contact change", "play or pause", "next contact change", "time", "slower", "faster",
        "follow", "supports", "forces", "torques",
    ]  # fmt: skip
    assert all(name.startswith("file:") and name.endswith(".html") for name in said["outside"])


def test_arrow_keys_step_through_the_contact_changes_and_stop_there(said: dict, strolling_plan: Plan) -> None:
    changes = contact_timeline(strolling_plan).changes
    times = [row[0] for row in said["stepped"]]
    np.testing.assert_allclose(times, [changes[0], changes[1], changes[2], changes[1], changes[0], 0.0], atol=2e-3)
    stances = [int(re.findall(r"stance (\d+) of 11", row[1])[0]) for row in said["stepped"]]
    assert stances == [2, 3, 4, 3, 2, 1]
    assert said["stepped"][0][1].startswith(f"{changes[0]:.1f} s")
    assert not any(row[2] for row in said["stepped"])
    assert "left palm" in said["stepped"][2][1] or "left palm" not in said["stepped"][0][1]


def test_plus_and_minus_change_the_speed_within_a_tenth_and_four(said: dict) -> None:
    assert said["speeds"] == [2, 4, 4, 2, 1, 0.5, 0.25, 0.1, 0.1, 0.1]
    assert said["shown_speed"] == "0.1×"


def test_space_plays_and_pauses(said: dict) -> None:
    assert (said["plays"], said["still_plays"]) == (True, False)


def test_the_camera_follows_the_centre_of_mass_and_returns(said: dict, strolling_plan: Plan) -> None:
    assert strolling_plan.centroidal is not None
    checked, aim = said["follows"]
    assert checked
    for target, t in ((aim, 1.0), (said["followed"], 3.0)):
        x, y, z = strolling_plan.centroidal.com_at(t)
        np.testing.assert_allclose(target, [x, z, -y], atol=3e-3)  # three.js has y up; keyframes are 1 mm off at most
    np.testing.assert_allclose(said["after"], said["before"], atol=1e-9)


def test_terrain_robot_and_contacts_of_every_end_effector_are_in_the_picture(said: dict) -> None:
    assert shows_the_plan(look(said["without_forces"]))


def test_a_page_that_draws_nothing_would_be_noticed(said: dict) -> None:
    seen = look(said["nothing"])
    assert not shows_the_plan(seen)
    assert max(seen.contacts.values()) < ENOUGH


def test_the_robot_walks_when_time_goes_on(said: dict) -> None:
    assert abs(look(said["late"]).robot_centre - look(said["early"]).robot_centre) > 0.1 * SIZE[0]


def test_what_carries_is_seen_through_the_feet_unless_the_layer_is_off(said: dict) -> None:
    """The soles hide their patches, so that only what is drawn over them can show there."""
    assert look(said["without_forces"]).supports > 3 * ENOUGH
    assert look(said["without_supports"]).supports < look(said["early"]).supports - 2 * ENOUGH


def test_arrows_have_the_colour_of_the_friction_that_they_use(said: dict, strolling_plan: Plan) -> None:
    assert strolling_plan.centroidal is not None
    knot = int(np.searchsorted(strolling_plan.centroidal.t, 1.0 + 1e-6, side="right")) - 1
    used = friction_used(strolling_plan)[knot]
    for effector, name in enumerate(("left_foot", "right_foot")):
        assert "#" + said["colours"][name] == palette()[min(round(100 * used[effector]), 100)]
    assert said["early"] != said["without_forces"]


def test_torques_are_listed_largest_first(said: dict) -> None:
    percents = [int(row[2].removesuffix(" %")) for row in said["bars"]]
    assert len(percents) == 12
    assert percents == sorted(percents, reverse=True)
    assert len({row[1] for row in said["bars"]}) == 12


# ---- contacts alone, and two plans


def test_a_plan_of_contacts_alone_shows_no_robot(strolling_plan: Plan, tmp_path: Path) -> None:
    page = tmp_path / "contacts.html"
    playback.write_page(dataclasses.replace(strolling_plan, phases=None, centroidal=None, motion=None), page)
    take_picture(page, tmp_path / "contacts.png", size=SIZE, legend=False, supports=False)
    seen = look(tmp_path / "contacts.png")
    assert min(seen.contacts.values()) >= ENOUGH
    assert seen.terrain > 10_000
    assert not shows_the_plan(seen)


TWO_PLANS = """
  const times = () => views().map((view) => view.animator.actions[0].time);
  const eyes = () => views().map((view) => view.camera.position.toArray());
  await go(2.0); said.times = times(); said.words = [words(0), words(1)]; said.eyes = eyes();
  await press("ArrowRight"); said.changed = [parseFloat(bar.querySelector("[type=range]").value), words(0), words(1)];
  views()[1].dom_element.dispatchEvent(new PointerEvent("pointerdown"));
  views()[1].camera.position.x += 1.0; await frames(2); said.moved = eyes();
  said.pictures = views().map(picture);
  await go(DURATION); said.end = [...times(), words(1)];
"""


def test_one_time_bar_drives_two_plans_and_their_cameras_move_together(strolling_plan: Plan, tmp_path: Path) -> None:
    contacts = dataclasses.replace(strolling_plan, phases=None, centroidal=None, motion=None)
    page = tmp_path / "both.html"
    playback.write_beside_page((strolling_plan, contacts), page, ("walked.h5", "contacts.h5"))
    said = ask(page, TWO_PLANS.replace("DURATION", "11"), "t=0")
    assert said["times"] == [pytest.approx(2.0), pytest.approx(2.0)]
    assert said["words"][0].startswith("2.0 s · stance 4 of 11")
    assert said["words"][1].startswith("stance 3 of 11")  # without a motion a stance takes a second
    assert said["changed"][0] == pytest.approx(2.4, abs=2e-3)
    assert "stance 5 of 11" in said["changed"][1]
    np.testing.assert_allclose(said["eyes"][0], said["eyes"][1])
    np.testing.assert_allclose(said["moved"][0], said["moved"][1])
    assert said["moved"][0][0] == pytest.approx(said["eyes"][0][0] + 1.0)
    walked, only_contacts = map(look, said["pictures"])
    assert walked.robot > 5 * only_contacts.robot  # which is what is dark without one
    assert min(only_contacts.contacts.values()) >= ENOUGH / 3
    assert said["end"][0] == pytest.approx(strolling_plan.duration, abs=0.04)
    assert "stance 11 of 11" in said["end"][2]
