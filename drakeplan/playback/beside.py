"""Puts the views of two static meshcat pages into one: what both draw alike stands in it once."""

from __future__ import annotations

import json
import re

MESSAGE = re.compile(
    r'fetch\("data:application/octet-binary;base64,([A-Za-z0-9+/=]*)"\)\s*\.then\(res => res\.arrayBuffer\(\)\)\s*'
    r"\.then\(buffer => viewer\.handle_command_bytearray\(new Uint8Array\(buffer\)\)\);"
)
ASSET = re.compile(r'casAssets\["[^"]*"\] = "[^"]*";')
LOADER = """
    document.body.classList.add("beside");
    const second = document.createElement("div");
    second.id = "plan-second";
    second.append(document.createElement("div"));
    document.body.append(second);
    var planViewers = [viewer, new MeshCat.Viewer(second.firstChild)];
    const messages = MESSAGES.map((text) => Uint8Array.from(atob(text), (letter) => letter.charCodeAt(0)));
    ORDERS.forEach((order, k) => order.forEach((m) => planViewers[k].handle_command_bytearray(messages[m])));
"""


def joined(first: str, second: str) -> str:
    """A page with the views of both, the first on the left.

    Args:
        first: what `Meshcat.StaticHtml` gives.
        second: of another meshcat.

    Raises:
        RuntimeError: Drake writes its pages in another way than this function knows.
    """
    messages: dict[str, int] = {}
    orders = []
    for page in (first, second):
        found = MESSAGE.findall(page)
        if not found or len(found) != page.count("handle_command_bytearray(new Uint8Array(buffer))"):
            raise RuntimeError("Drake's static page has messages of an unknown form")
        orders.append([messages.setdefault(text, len(messages)) for text in found])
    spans = [match.span() for match in MESSAGE.finditer(first)]
    loader = LOADER.replace("MESSAGES", json.dumps(list(messages))).replace("ORDERS", json.dumps(orders))
    known = set(ASSET.findall(first))
    assets = "\n".join(asset for asset in ASSET.findall(second) if asset not in known)
    return f"{first[: spans[0][0]]}{assets}\n{loader}{first[spans[-1][1] :]}"
