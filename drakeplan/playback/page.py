"""Turns meshcat's static page into the page people open: a title, a legend, and a time that the address can name."""

from __future__ import annotations

import html

from drakeplan.plan import Plan
from drakeplan.playback.animation import FORCE_COLOUR
from drakeplan.playback.still import COM_COLOUR, EFFECTOR_COLOURS, GOAL_COLOUR

# Play, pause and a time slider in sight; meshcat's own are two clicks deep in its panel.
# `#t=3.5` in the address stops the motion there; `&still` hides the control panel, `&bare` the legend too.
CONTROLS = """
<div id="plan-time" hidden>
  <button type="button" aria-label="play or pause">||</button>
  <input type="range" min="0" max="1" step="any" value="0" aria-label="time"><output></output>
</div>
<script>
  (function () {
    const wanted = new URLSearchParams(location.hash.slice(1));
    for (const name of ["still", "bare"]) if (wanted.has(name)) document.body.classList.add(name);
    const [bar, button, slider, clock] = ["", " button", " input", " output"].map(
      (part) => document.querySelector("#plan-time" + part));
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
    button.onclick = () => (animator().playing ? animator().pause() : animator().play());
    slider.oninput = () => seek(parseFloat(slider.value));
    const wait = setInterval(() => {
      if (animator().actions.length === 0) return;
      clearInterval(wait);
      slider.max = animator().duration;
      bar.hidden = false;
      if (wanted.has("t")) {
        animator().play();
        seek(Math.min(Math.max(parseFloat(wanted.get("t")) || 0, 0), animator().duration));
      }
      if (!wanted.has("still")) show();
    }, 20);
  })();
</script>
"""

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
  #plan-time button { width: 30px; border: 0; background: none; font-size: 15px; cursor: pointer; }
  #plan-time[hidden], body.still #plan-time,
  body.still .dg.main, body.still .dg.ac, body.bare #plan-legend { display: none !important; }
</style>
"""


def finished_page(meshcat_page: str, plan: Plan) -> str:
    """The page with its title, legend and time slider; everything in it is inline.

    Args:
        meshcat_page: what `Meshcat.StaticHtml` gives.
        plan: whose page it is.
    """
    title = html.escape(f"{plan.scene_name} · {plan.robot} · drakeplan")
    page = meshcat_page.replace("<title>Drake MeshCat</title>", f"<title>{title}</title>", 1)
    head, body_end, tail = page.rpartition("</body>")
    return head + STYLE + _legend(plan) + CONTROLS + body_end + tail


def _legend(plan: Plan) -> str:
    contacts = [int((plan.contacts.effector == e).sum()) for e in range(len(plan.effectors))]
    shown = [
        (_css(EFFECTOR_COLOURS[name]), f"{name.replace('_', ' ')} ({count})")
        for name, count in zip(plan.effectors, contacts, strict=True)
        if count
    ]
    if plan.motion is not None:
        shown += [(_css(COM_COLOUR), "centre of mass"), (_css(FORCE_COLOUR), "contact force")]
    shown.append((_css(GOAL_COLOUR), "goal"))
    facts = f"{len(plan.stances)} stances"
    facts += f", {plan.duration:.1f} s" if plan.motion is not None else ", contacts only: no motion was found"
    entries = "".join(f'<span><i style="background:{colour}"></i>{html.escape(text)}</span> ' for colour, text in shown)
    heading = f"<b>{html.escape(plan.scene_name)}</b> &middot; {html.escape(plan.robot)} &middot; {html.escape(facts)}"
    return f'\n<div id="plan-legend">{heading}<br>{entries}</div>\n'


def _css(colour: object) -> str:
    r, g, b = (round(255 * getattr(colour, key)()) for key in "rgb")
    return f"rgb({r},{g},{b})"
