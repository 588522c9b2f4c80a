"""Turns meshcat's static page into the page people open: a title, legends, and the controls of a plan."""

from __future__ import annotations

import html
import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from drakeplan.playback.animation import FORCES
from drakeplan.playback.legend import Entry, Legend
from drakeplan.playback.share_colours import palette
from drakeplan.playback.still import COM
from drakeplan.playback.supports import SUPPORTS

HERE = Path(__file__).parent
CONTROLS = """
<div id="plan-time" hidden>
  <div class="time">
    <button type="button" class="previous" aria-label="previous contact change" title="to the contact change before (left arrow)">
      <svg width="13" height="13" viewBox="0 0 13 13"><path d="M0 0h2.5v13H0zM13 0v13L3 6.5z"/></svg></button>
    <button type="button" class="play" aria-label="play or pause" title="play or pause (space)">
      <svg class="go" width="13" height="13" viewBox="0 0 13 13"><path d="M1 0v13L13 6.5z"/></svg>
      <svg class="pause" width="13" height="13" viewBox="0 0 13 13"><path d="M1 0h4v13H1zM8 0h4v13H8z"/></svg></button>
    <button type="button" class="next" aria-label="next contact change" title="to the next contact change (right arrow)">
      <svg width="13" height="13" viewBox="0 0 13 13"><path d="M10.5 0H13v13h-2.5zM0 0v13L10 6.5z"/></svg></button>
    RANGE
    <output class="clock"></output>
  </div>
  <div class="layers">
    <span><button type="button" class="slower" aria-label="slower" title="slower (-)">&minus;</button><output class="speed"></output
    ><button type="button" class="faster" aria-label="faster" title="faster (+)">+</button></span>
    <label class="follow" title="the camera goes with the robot (F)"><input type="checkbox">follow</label>
    <label class="supports" title="what carries"><input type="checkbox" checked>supports</label>
    <label class="forces" title="contact forces"><input type="checkbox" checked>forces</label>
    <label class="torques" title="joint torques as shares of the actuators' limits"><input type="checkbox">torques</label>
  </div>
</div>
"""
RANGE = '<input type="range" min="0" max="1" step="any" value="0" aria-label="time">'
CAPTION = '<div class="plan-caption" hidden><b></b><span></span></div>'
TORQUES = '<div class="plan-torques"><h2>torque / limit</h2></div>'


@dataclass(frozen=True)
class Pane:
    """What is written over one view.

    Attributes:
        legend: its heading and colours.
        data: what `page.js` needs of the plan; None for a scene without one.
        risk: CSS background of a bar over the time bar; "" for none.
    """

    legend: Legend
    data: Mapping[str, object] | None = None
    risk: str = ""


def finished_page(meshcat_page: str, panes: Sequence[Pane], *, linked: bool = False) -> str:
    """The page with its title, legends and, where there are plans, controls; everything in it is inline.

    Args:
        meshcat_page: what `Meshcat.StaticHtml` gives, or `beside.joined` for two panes.
        panes: one or two.
        linked: whether the cameras of two panes move together.
    """
    words = panes[0].legend.heading
    title = html.escape(" · ".join([*words[:2], "drakeplan"]))
    page = meshcat_page.replace("<title>Drake MeshCat</title>", f"<title>{title}</title>", 1)
    head, body_end, tail = page.rpartition("</body>")
    parts = ["\n<style>\n", _asset("page.css"), "</style>\n", *(_over(pane) for pane in panes)]
    plans = [pane.data for pane in panes if pane.data is not None]
    if plans:
        scale = f'<span class="track"><i style="background:{panes[0].risk}"></i>{RANGE}</span>'
        parts += [CONTROLS.replace("RANGE", scale if panes[0].risk else RANGE, 1), _script(plans, linked)]
    return head + "".join(parts) + body_end + tail


def _over(pane: Pane) -> str:
    """What lies over a view."""
    heading, *words = (html.escape(word) for word in pane.legend.heading)
    heading = " &middot; ".join([f"<b>{heading}</b>", *words])
    entries = " ".join(map(_entry, pane.legend.entries))
    legend = f'<details class="plan-legend" open><summary>{heading}</summary>{entries}</details>'
    caption = CAPTION if pane.data is not None else ""
    torques = TORQUES if pane.data is not None and pane.data["torques"] else ""
    return f'<div class="plan-pane">{caption}{torques}{legend}</div>\n'


def _entry(entry: Entry) -> str:
    text = html.escape(entry.text)
    if entry.until:
        return f'<span>{text}<i class="scale" style="background:{entry.fill}"></i>{html.escape(entry.until)}</span>'
    return f'<span><i style="background:{entry.fill}"></i>{text}</span>'


def _script(plans: Sequence[Mapping[str, object]], linked: bool) -> str:
    com, forces, supports = (path.strip("/").split("/") for path in (COM, FORCES, SUPPORTS))
    data = {"plans": plans, "palette": palette(), "linked": linked, "com": com, "forces": forces, "supports": supports}
    text = json.dumps(data, separators=(",", ":")).replace("<", "\\u003c")  # no tag can end the script
    return f'<script id="plan-data" type="application/json">{text}</script>\n<script>\n{_asset("page.js")}</script>\n'


def _asset(name: str) -> str:
    return (HERE / name).read_text(encoding="utf-8")
