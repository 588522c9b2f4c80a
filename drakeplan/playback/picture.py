"""A still picture of a playback page, taken by headless Chromium."""

from __future__ import annotations

import shutil
import subprocess
import tempfile
from pathlib import Path

from scenes.input_error import InputError

BROWSERS = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable")
# A software renderer that works without a display; `--use-gl=swiftshader` gives a blank page and exit status 0.
FLAGS = (
    "--headless=new",
    "--no-sandbox",
    "--use-angle=swiftshader",
    "--enable-unsafe-swiftshader",
    "--hide-scrollbars",
)
VIRTUAL_TIME = 4000  # [ms] of virtual time that the page runs
PATIENCE = 180.0  # [s]


def find_browser() -> str | None:
    """The command of a Chromium on this machine, None where there is none."""
    return next((path for name in BROWSERS if (path := shutil.which(name))), None)


def take_picture(
    page: str | Path,
    picture: str | Path,
    *,
    time: float | None = None,
    size: tuple[int, int] = (1600, 900),
    legend: bool = True,
    supports: bool = True,
) -> None:
    """Writes a PNG of the page.

    Args:
        page: what `write_page` wrote.
        picture: where to write.
        time: at which the motion is stopped [s]; None lets it play.
        size: width and height in pixels.
        legend: whether the legend is shown.
        supports: whether the support polygons of the contacts that are held are shown.

    Raises:
        InputError: no browser, or it made no picture; a blank one is not noticed here.
    """
    browser = find_browser()
    if browser is None:
        raise InputError(f"pictures need Chromium: none of {', '.join(BROWSERS)} is installed (Debian: chromium)")
    picture = Path(picture).resolve()
    picture.unlink(missing_ok=True)
    options = "still" + ("" if legend else "&bare") + ("" if supports else "&supports=0")
    options += "" if time is None else f"&t={time}"
    with tempfile.TemporaryDirectory(prefix="drakeplan-browser-", ignore_cleanup_errors=True) as profile:
        command = [
            browser,
            *FLAGS,
            f"--user-data-dir={profile}",
            f"--window-size={size[0]},{size[1]}",
            f"--virtual-time-budget={VIRTUAL_TIME}",
            f"--screenshot={picture}",
            f"{Path(page).resolve().as_uri()}#{options}",
        ]
        try:
            done = subprocess.run(command, capture_output=True, text=True, timeout=PATIENCE, check=False)
        except subprocess.TimeoutExpired:
            raise InputError(f"{browser} took more than {PATIENCE:.0f} s for a picture of {page}") from None
    if not picture.is_file():
        said = done.stderr.strip().splitlines()[-1:] or ["nothing said"]
        raise InputError(f"{browser} made no picture of {page} (exit {done.returncode}: {said[0]})")
