"""Plans the crossings of the gallery and writes their playing pages and previews into docs/gallery.

What has been made with the same command is not made again. The pages are large and stay out of the repository; the
previews and docs/gallery/facts.json belong to it. Previews need Chromium (Debian: apt-get install chromium).

    .venv/bin/python docs/make_gallery.py            # all
    .venv/bin/python docs/make_gallery.py stairs     # one, planned anew
    .venv/bin/python docs/make_gallery.py --first    # what the start page plays, unless it is there
"""

from __future__ import annotations

import json
import shlex
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from gallery_crossings import CROSSINGS, FIRST, Crossing
from make_picture import middle_of_the_longest_palm_contact
from PIL import Image

import drakeplan
from drakeplan.playback.picture import find_browser, take_picture
from scenes.files.whole_file import write_whole

GALLERY = Path(__file__).with_name("gallery")
PLANS = Path(__file__).resolve().parents[1] / "build" / "gallery"
FACTS = GALLERY / "facts.json"
SIZE = (1280, 720)
PREVIEW = (640, 360)
MOST_BYTES = 40_000  # of a preview


def main(words: list[str]) -> int:
    """Makes what is missing, a line each; 1 when a crossing was not planned."""
    named = {c.name: c for c in CROSSINGS}
    unknown = [word for word in words if word not in named and word != "--first"]
    if unknown:
        print(f"unknown: {', '.join(unknown)}; expected --first or some of {', '.join(named)}", file=sys.stderr)
        return 2
    anew = [word for word in words if word in named]
    wanted = [FIRST] if "--first" in words else [named[word] for word in anew] or list(CROSSINGS)
    failed = 0
    for k, crossing in enumerate(wanted, 1):
        began = time.perf_counter()
        said = "there already" if crossing.name not in anew and is_made(crossing) else make(crossing)
        failed += said.startswith("no plan")
        print(f"[{k} of {len(wanted)}] {crossing.name}: {said} ({time.perf_counter() - began:.0f} s)", flush=True)
    return int(failed > 0)


def is_made(crossing: Crossing) -> bool:
    """Whether its page is there and comes from this command."""
    stamp = PLANS / f"{crossing.name}.txt"
    page = GALLERY / f"{crossing.name}.html"
    return page.is_file() and stamp.is_file() and stamp.read_text(encoding="utf-8") == crossing.command


def make(crossing: Crossing) -> str:
    """Plans it, writes page, preview and facts; returns what came of it."""
    PLANS.mkdir(parents=True, exist_ok=True)
    plan_file, page = PLANS / f"{crossing.name}.h5", GALLERY / f"{crossing.name}.html"
    words = [*shlex.split(crossing.arguments), "--json", "--out", str(plan_file), "--html", str(page)]
    done = subprocess.run(
        [sys.executable, "-m", "drakeplan", "plan", *words], capture_output=True, text=True, check=False
    )
    if done.returncode:
        return f"no plan: {(done.stderr.strip().splitlines() or ['nothing said'])[-1]}"
    plan = drakeplan.read_plan(plan_file)
    if find_browser() is not None:
        preview(plan, page, GALLERY / f"{crossing.name}.webp")
    note_facts(crossing, plan)
    (PLANS / f"{crossing.name}.txt").write_text(crossing.command, encoding="utf-8")
    return f"{plan.duration:.0f} s of motion"


def preview(plan: drakeplan.Plan, page: Path, picture: Path) -> None:
    """Photographs the page where a palm holds, else half way, as small as `MOST_BYTES` asks."""
    with tempfile.TemporaryDirectory() as folder:
        shot = Path(folder) / "shot.png"
        take_picture(page, shot, time=middle_of_the_longest_palm_contact(plan), size=SIZE, legend=False)
        small = Image.open(shot).convert("RGB").resize(PREVIEW, Image.Resampling.LANCZOS)
    for quality in range(90, 30, -10):
        small.save(picture, quality=quality, method=6)
        if picture.stat().st_size <= MOST_BYTES:
            return


def note_facts(crossing: Crossing, plan: drakeplan.Plan) -> None:
    """Adds what its card says to the list."""
    facts = json.loads(FACTS.read_text(encoding="utf-8")) if FACTS.is_file() else {}
    palms = sum(plan.effectors[e].endswith("_palm") for e in plan.contacts.effector)
    facts[crossing.name] = {
        "stances": len(plan.stances),
        "contacts": len(plan.contacts),
        "palms": int(palms),
        "duration": round(plan.duration, 1),
    }
    write_whole(FACTS, json.dumps(facts, indent=1, sort_keys=True).encode() + b"\n")


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
