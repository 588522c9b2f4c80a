"""Turns meshcat's static page into the page people open: a title, a legend, and a time that the address can name."""

from __future__ import annotations

import html
import json
from collections.abc import Sequence

from drakeplan.plan.plan import Plan
from drakeplan.playback.animation import FORCE_COLOUR
from drakeplan.playback.guide_path import MODE_COLOURS, guide_of
from drakeplan.playback.push_rose import OUTCOMES, risk_bar
from drakeplan.playback.pushes import PUSH_COLOUR
from drakeplan.playback.still import COM_COLOUR, EFFECTOR_COLOURS, GOAL_COLOUR, PREDICTED_COLOUR, predicted_com
from drakeplan.playback.supports import SUPPORT_COLOUR, SUPPORTS
from scenes.disturbance import PERIOD
from scenes.scene import Scene

# Play, pause and a time slider in sight; meshcat's own are two clicks deep in its panel.
# `#t=3.5` in the address stops the motion there; `&still` hides the control panel, `&bare` the legend too,
# `&supports=0` the support polygons.
CONTROLS = """
<div id="plan-time" hidden>
  <button type="button" aria-label="play or pause">||</button>
  <input type="range" min="0" max="1" step="any" value="0" aria-label="time"><output></output>
  <label><input type="checkbox" checked>supports</label>
</div>
<script>
  (function () {
    const wanted = new URLSearchParams(location.hash.slice(1));
    for (const name of ["still", "bare"]) if (wanted.has(name)) document.body.classList.add(name);
    const [bar, button, slider, clock, supports] = ["", " button", " input", " output", " label input"].map(
      (part) => document.querySelector("#plan-time" + part));
    const layer = () => {
      viewer.set_property(SUPPORTS, "visible", supports.checked);
      viewer.set_dirty();
    };
    const animator = () => viewer.animator;
    const seek = (time) => {
      animator().pause();
      animator().seek(time);
      animator().display_progress(time);
    };
    const show = () => {
      if (document.activeElement !== slider || animator().playing) slider.value = animator().time;
      clock.textContent = animator().time.toFixed(1) + " s";
      button.textContent = animator().playing ? "||" : "\u25b6";
      requestAnimationFrame(show);
    };
    supports.onchange = layer;
    button.onclick = () => (animator().playing ? animator().pause() : animator().play());
    slider.oninput = () => seek(parseFloat(slider.value));
    const wait = setInterval(() => {
      if (animator().actions.length === 0) return;
      clearInterval(wait);
      slider.max = animator().duration;
      bar.hidden = false;
      supports.checked = wanted.get("supports") !== "0";
      layer();
      if (wanted.has("t")) {
        animator().play();
        seek(Math.min(Math.max(parseFloat(wanted.get("t")) || 0, 0), animator().duration));
      }
      if (!wanted.has("still")) show();
    }, 20);
  })();
</script>
""".replace("SUPPORTS", json.dumps(SUPPORTS.strip("/").split("/")))

STYLE = """
<style>
  #plan-legend {
    position: fixed; left: 16px; bottom: 16px; padding: 10px 14px; border-radius: 8px;
    background: rgba(255, 255, 255, 0.82); color: #222; font: 13px/1.55 system-ui, sans-serif;
    box-shadow: 0 1px 6px rgba(0, 0, 0, 0.18); pointer-events: none;
  }
  #plan-legend b { font-size: 14px; }
  #plan-legend i {
    display: inline-block; width: 12px; height: 12px; margin-right: 7px; border-radius: 3px; vertical-align: -1px;
  }
  #plan-legend span { white-space: nowrap; margin-right: 12px; }
  #plan-time {
    position: fixed; left: 50%; top: 14px; transform: translateX(-50%); padding: 6px 12px; border-radius: 8px;
    background: rgba(255, 255, 255, 0.82); color: #222; font: 13px system-ui, sans-serif; white-space: nowrap;
    box-shadow: 0 1px 6px rgba(0, 0, 0, 0.18);
  }
  #plan-time input { width: 36vw; vertical-align: middle; margin: 0 8px; }
  #plan-time .track { position: relative; display: inline-block; }
  #plan-time .track i { position: absolute; left: 8px; right: 8px; top: -5px; height: 6px; border-radius: 3px; }
  #plan-time label { margin-left: 14px; }
  #plan-time label input { width: auto; margin: 0 5px 0 0; }
  #plan-time button { width: 30px; border: 0; background: none; font-size: 15px; cursor: pointer; }
  #plan-time[hidden], body.still #plan-time,
  body.still .dg.main, body.still .dg.ac, body.bare #plan-legend { display: none !important; }
</style>
"""


def finished_page(meshcat_page: str, plan: Plan, scene: Scene) -> str:
    """The page of a plan with its title, legend and time slider; everything in it is inline.

    Args:
        meshcat_page: what `Meshcat.StaticHtml` gives.
        plan: whose page it is.
        scene: the plan's.
    """
    contacts = [int((plan.contacts.effector == e).sum()) for e in range(len(plan.effectors))]
    shown = [
        (_css(EFFECTOR_COLOURS[name]), f"{name.replace('_', ' ')} ({count})")
        for name, count in zip(plan.effectors, contacts, strict=True)
        if count
    ]
    if plan.motion is not None:
        shown += [
            (_css(COM_COLOUR), "centre of mass"),
            (_css(FORCE_COLOUR), "contact force"),
            (_css(SUPPORT_COLOUR), "what carries a foot or palm"),
        ]
    if predicted_com(plan) is not None:
        shown.append((_css(PREDICTED_COLOUR), "centre of mass as the search predicted it"))
    guide = {segment.words: _css(MODE_COLOURS[segment.mode]) for segment in guide_of(plan)}
    shown += [(colour, words) for words, colour in guide.items()]
    controls = CONTROLS
    if plan.robustness is not None:
        shown += [(_css(colour), f"push: {name}") for name, colour in OUTCOMES]
        bar = f'<span class="track"><i style="background:{risk_bar(plan)}"></i><input type="range"'
        controls = controls.replace('<input type="range"', bar, 1).replace("<output>", "</span><output>", 1)
    facts = f"{len(plan.stances)} stances"
    facts += f", {plan.duration:.1f} s" if plan.motion is not None else ", contacts only: no motion was found"
    if plan.robustness is not None:
        facts += f", {100 * plan.robustness.p_success:.1f} % likely to arrive under pushes"
    return _dressed(meshcat_page, [plan.scene_name, plan.robot, facts], [*shown, *_of_scene(scene)], controls)


def finished_scene_page(meshcat_page: str, scene: Scene) -> str:
    """The page of a scene without a plan, with its title and legend.

    Args:
        meshcat_page: as `Meshcat.StaticHtml` gives it.
        scene: whose name and colours are shown.
    """
    return _dressed(meshcat_page, [scene.name, _count(len(scene.terrain.surfaces), "surface")], _of_scene(scene), "")


def _count(number: int, thing: str) -> str:
    return f"{number} {thing}" + ("s" if number != 1 else "")


def _of_scene(scene: Scene) -> list[tuple[str, str]]:
    """Colour and text of the legend's entries that a scene brings."""
    shown = [(_css(GOAL_COLOUR), "goal")] if scene.goal is not None else []
    if scene.disturbances:
        count = sum(len(d.impulses) for d in scene.disturbances)
        likely = ", ".join(f"{100 * d.probability:.3g} %" for d in scene.disturbances[:4])
        more = ", ..." if len(scene.disturbances) > 4 else ""
        shown.append((_css(PUSH_COLOUR), f"pushes ({count}), {likely}{more} in {PERIOD} s"))
    return shown


def _dressed(meshcat_page: str, words: Sequence[str], shown: Sequence[tuple[str, str]], controls: str) -> str:
    """The page with a title, a legend of colours and texts, and controls."""
    title = html.escape(" · ".join([*words[:2], "drakeplan"]))
    page = meshcat_page.replace("<title>Drake MeshCat</title>", f"<title>{title}</title>", 1)
    head, body_end, tail = page.rpartition("</body>")
    entries = "".join(f'<span><i style="background:{colour}"></i>{html.escape(text)}</span> ' for colour, text in shown)
    heading = " &middot; ".join([f"<b>{html.escape(words[0])}</b>", *(html.escape(word) for word in words[1:])])
    legend = f'\n<div id="plan-legend">{heading}<br>{entries}</div>\n'
    return head + STYLE + legend + controls + body_end + tail


def _css(colour: object) -> str:
    r, g, b = (round(255 * getattr(colour, key)()) for key in "rgb")
    return f"rgb({r},{g},{b})"
