"""Turns meshcat's static page into the page people open: a title, a legend, and a time that the address can name."""

from __future__ import annotations

import html

from drakeplan.plan import Plan
from drakeplan.playback.animation import FORCE_COLOUR
from drakeplan.playback.still import COM_COLOUR, EFFECTOR_COLOURS, GOAL_COLOUR

# `#t=3.5` in the address stops the motion there; `&still` hides the control panel, `&bare` the legend too.
SEEK = """
<script>
  (function () {
    const wanted = new URLSearchParams(location.hash.slice(1));
    for (const name of ["still", "bare"]) if (wanted.has(name)) document.body.classList.add(name);
    if (!wanted.has("t")) return;
    const wait = setInterval(() => {
      const animator = viewer.animator;
      if (animator.actions.length === 0) return;
      clearInterval(wait);
      const time = Math.min(Math.max(parseFloat(wanted.get("t")) || 0, 0), animator.duration);
      animator.play();
      animator.pause();
      animator.seek(time);
      animator.display_progress(time);
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
  body.still .dg.main, body.still .dg.ac, body.bare #plan-legend { display: none !important; }
</style>
"""


def finished_page(meshcat_page: str, plan: Plan) -> str:
    """The page with its title, legend and seek script; everything in it is inline.

    Args:
        meshcat_page: what `Meshcat.StaticHtml` gives.
        plan: whose page it is.
    """
    title = html.escape(f"{plan.scene_name} · {plan.robot} · drakeplan")
    page = meshcat_page.replace("<title>Drake MeshCat</title>", f"<title>{title}</title>", 1)
    head, body_end, tail = page.rpartition("</body>")
    return head + STYLE + _legend(plan) + SEEK + body_end + tail


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
