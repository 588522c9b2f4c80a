"""The documentation site builds without complaint, needs no network, and its reference is complete."""

from __future__ import annotations

import ast
import importlib.util
import json
import os
import re
import subprocess
import sys
import types
from pathlib import Path

import lxml.html
import pytest
import yaml

import drakeplan
from drakeplan.cli import COMMANDS
from drakeplan.cli.arguments import parse
from drakeplan.contact_planning.planner import PLANNERS
from drakeplan.playback.picture import FLAGS, find_browser
from scenes.files import scene_schema
from scenes.files.scene_file import scene_from_yaml
from scenes.robots import schema as robot_schema

ROOT = Path(__file__).resolve().parents[1]
DOCS = ROOT / "docs"
NEEDS = ("mkdocs", "material", "mkdocstrings", "mkdocstrings_handlers.python", "nbconvert", "latex2mathml")
MOST_FIGURE, MOST_PREVIEW = 60_000, 40_000  # [bytes]
RESOURCES = (
    "//script[@src]/@src | //link[@rel='stylesheet' or @rel='icon' or @rel='preload' or @rel='preconnect']/@href | "
    "//img/@src | //iframe/@src | //source/@src | //video/@src | //object/@data | //embed/@src"
)


def missing_packages() -> list[str]:
    """What `make docs` needs and is not installed."""

    def is_there(name: str) -> bool:
        try:
            return importlib.util.find_spec(name) is not None
        except ModuleNotFoundError:
            return False

    return [name for name in NEEDS if not is_there(name)]


needs_mkdocs = pytest.mark.skipif(bool(missing_packages()), reason=f"not installed: {', '.join(missing_packages())}")


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The site, built in strict mode: a link or anchor that leads nowhere fails here."""
    folder = tmp_path_factory.mktemp("site")
    words = [sys.executable, "-m", "mkdocs", "build", "--strict", "--site-dir", str(folder)]
    environment = os.environ | {"NO_MKDOCS_2_WARNING": "1"}
    done = subprocess.run(words, cwd=ROOT, capture_output=True, text=True, check=False, env=environment, timeout=120)
    assert done.returncode == 0, done.stderr
    return folder


@pytest.fixture(scope="module")
def pages(site: Path) -> dict[Path, lxml.html.HtmlElement]:
    """Every page, parsed; played plans are no pages of the theme."""
    paths = [path for path in site.rglob("*.html") if path.parent.name != "gallery" or path.name == "index.html"]
    return {path: lxml.html.parse(str(path)).getroot() for path in paths}


def crossings() -> types.ModuleType:
    """The list of the gallery, which lies beside the scripts that use it."""
    spec = importlib.util.spec_from_file_location("gallery_crossings", DOCS / "gallery_crossings.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module  # dataclasses look it up
    spec.loader.exec_module(module)
    return module


def is_external(address: str) -> bool:
    return re.match(r"(?:[a-z]+:)?//", address) is not None


def external(css: str) -> list[str]:
    """Addresses that a style sheet takes from the network."""
    found = re.findall(r"url\(\s*['\"]?([^'\")]+)", css) + re.findall(r"@import\s+['\"]([^'\"]+)", css)
    return [address for address in found if is_external(address)]


@needs_mkdocs
@pytest.mark.slow
def test_no_page_takes_anything_from_the_network(pages: dict[Path, lxml.html.HtmlElement], site: Path) -> None:
    assert len(pages) > 50
    for path, page in pages.items():
        outside = [address for address in page.xpath(RESOURCES) if is_external(address)]
        assert not outside, f"{path.relative_to(site)}: {outside}"
        assert not external(" ".join(page.xpath("//style/text() | //@style"))), path
    for path in site.rglob("*.css"):
        assert not external(path.read_text(encoding="utf-8")), path


@needs_mkdocs
@pytest.mark.slow
def test_every_link_and_anchor_in_the_built_pages_leads_somewhere(
    pages: dict[Path, lxml.html.HtmlElement], site: Path
) -> None:
    anchors = {path: set(page.xpath("//@id | //a/@name")) for path, page in pages.items()}
    for path, page in pages.items():
        if path.name == "404.html":  # its addresses begin at the top of a server
            continue
        for address in page.xpath("//a/@href | //img/@src | //iframe/@src | //script/@src | //link/@href"):
            if re.match(r"[a-z]+:", address) or is_external(address):
                continue
            target, _, anchor = address.partition("#")
            there = (path.parent / target).resolve() if target else path
            there = there / "index.html" if there.is_dir() else there
            assert there.is_file(), f"{path.relative_to(site)}: {address}"
            assert not anchor or there not in anchors or anchor in anchors[there], (
                f"{path.relative_to(site)}: {address}"
            )


@needs_mkdocs
@pytest.mark.slow
def test_every_public_name_and_every_command_is_in_the_reference(
    pages: dict[Path, lxml.html.HtmlElement], site: Path
) -> None:
    reference = {path: page for path, page in pages.items() if path.parent == site / "reference"}
    anchors = [anchor for page in reference.values() for anchor in page.xpath("//@id")]
    assert not [name for name in drakeplan.__all__ if anchors.count(f"drakeplan.{name}") != 1]
    commands = reference[site / "reference" / "commands.html"]
    assert set(COMMANDS) <= set(commands.xpath("//h2/@id"))
    text = commands.text_content()
    assert not [name for name in COMMANDS if f"usage: drakeplan {name} " not in text]
    assert "╭" not in text


@needs_mkdocs
@pytest.mark.slow
def test_every_notebook_and_every_decision_has_a_page(pages: dict[Path, lxml.html.HtmlElement], site: Path) -> None:
    formulas = 0
    for path in (ROOT / "tutorials").glob("*.ipynb"):
        page = pages[site / "tutorials" / f"{path.stem}.html"]
        formulas += len(page.xpath("//math"))
        assert not page.xpath("//*[self::p or self::li or self::td][contains(text(), '$')]"), path
        assert (site / "tutorials" / path.name).read_bytes() == path.read_bytes()
    assert formulas > 20
    for path in (DOCS / "decisions").glob("*.md"):
        assert (site / "decisions" / ("index.html" if path.stem == "README" else f"{path.stem}.html")).is_file()


@needs_mkdocs
@pytest.mark.slow
@pytest.mark.browser
@pytest.mark.skipif(find_browser() is None, reason="no Chromium on this machine (Debian: apt-get install chromium)")
def test_the_search_works_from_a_folder(site: Path, tmp_path: Path) -> None:
    """Browsers refuse workers there; assets/iframe-worker.js stands in for them."""
    words = [str(find_browser()), *FLAGS, f"--user-data-dir={tmp_path}", "--virtual-time-budget=8000", "--dump-dom"]
    address = f"{(site / 'changelog.html').as_uri()}?q=elastic+strip"
    done = subprocess.run([*words, address], capture_output=True, text=True, check=False, timeout=120)
    assert re.search(r"\d+ matching documents", done.stdout)
    assert "decisions/elastic-strip.html" in done.stdout


def tables(page: str) -> dict[str, list[str]]:
    """Heading -> the keys in the first column of the table below it."""
    text = (DOCS / "reference" / page).read_text(encoding="utf-8")
    sections = re.split(r"(?m)^## (.+)$", text)
    return {
        title: re.findall(r"(?m)^\| `([^`]+)` \|", body)
        for title, body in zip(sections[1::2], sections[2::2], strict=True)
    }


def first_block(page: str, language: str) -> str:
    """The first block of code of this language on a page of the reference."""
    text = (DOCS / "reference" / page).read_text(encoding="utf-8")
    return re.split(rf"(?m)^```(?:{language})?$", text)[1]


def test_documented_keys_of_scene_files_are_those_of_the_schema() -> None:
    models = {
        "Scene": scene_schema.SceneEntry,
        "Surface": scene_schema.SurfaceEntry,
        "Mesh": scene_schema.MeshEntry,
        "Height map": scene_schema.HeightMapEntry,
        "Obstacle": scene_schema.ObstacleEntry,
        "Disturbance": scene_schema.DisturbanceEntry,
        "Region": scene_schema.RegionEntry,
        "Start": scene_schema.StartEntry,
        "Stance": scene_schema.StanceEntry,
        "Contact": scene_schema.ContactEntry,
        "Goal": scene_schema.GoalEntry,
        "Pose": scene_schema.PoseEntry,
    }
    documented = tables("scene-file.md")
    assert set(models.values()) == entries_of(scene_schema)
    assert {title: sorted(keys) for title, keys in documented.items()} == {
        title: sorted(model.model_fields) for title, model in models.items()
    }


def test_documented_keys_of_robot_files_are_those_of_the_schema() -> None:
    models = {
        "Robot": robot_schema.RobotEntry,
        "End effector": robot_schema.EffectorEntry,
        "Torso box": robot_schema.TorsoBoxEntry,
        "Changes": robot_schema.ModelChanges,
        "Frame": robot_schema.FrameEntry,
    }
    documented = tables("robot-file.md")
    package = set(robot_schema.PackageEntry.model_fields) - set(robot_schema.ModelChanges.model_fields)
    assert sorted(documented.pop("Package")) == sorted(package)
    assert {*models.values(), robot_schema.PackageEntry} == entries_of(robot_schema)
    assert {title: sorted(keys) for title, keys in documented.items()} == {
        title: sorted(model.model_fields) for title, model in models.items()
    }


def entries_of(module: types.ModuleType) -> set[type]:
    """The models of a schema that hold keys."""
    models = [
        value for value in vars(module).values() if isinstance(value, type) and value.__module__ == module.__name__
    ]
    return {model for model in models if getattr(model, "model_fields", None)}


def test_the_examples_of_the_file_formats_are_right() -> None:
    scene = scene_from_yaml(first_block("scene-file.md", "yaml"), "the page's example")
    assert scene.start is not None
    assert scene.goal is not None
    assert [surface.name for surface in scene.terrain.surfaces] == ["ground", "stone", "far", "wall"]
    robot = robot_schema.RobotEntry.model_validate(yaml.safe_load(first_block("robot-file.md", "yaml")))
    assert robot.model == "escher.urdf"


def test_python_on_the_pages_compiles_and_uses_public_names() -> None:
    blocks = 0
    for path in DOCS.rglob("*.md"):
        for block in re.findall(r"(?ms)^```python\n(.*?)^```$", path.read_text(encoding="utf-8")):
            blocks += 1
            for node in ast.walk(ast.parse(block, str(path))):
                if (
                    isinstance(node, ast.Attribute)
                    and isinstance(node.value, ast.Name)
                    and node.value.id == "drakeplan"
                ):
                    assert hasattr(drakeplan, node.attr), f"{path.relative_to(ROOT)}: drakeplan.{node.attr}"
    assert blocks > 5


def test_every_planner_has_a_page_with_its_command() -> None:
    for name in PLANNERS:
        text = (DOCS / "planners" / f"{name}.md").read_text(encoding="utf-8")
        assert text.startswith(f"# {name}\n")
        assert "$ drakeplan plan " in text
        assert name == "search" or f"--planner {name}" in text
        for word in ("**When.**", "**What it guarantees.**", "**What it costs.**"):
            assert word in text


def test_the_gallery_has_a_small_picture_and_the_facts_of_every_crossing_and_its_command_parses() -> None:
    from drakeplan.cli import plan

    facts = json.loads((DOCS / "gallery" / "facts.json").read_text(encoding="utf-8"))
    listed = crossings().CROSSINGS
    assert sorted(facts) == sorted(c.name for c in listed)
    for crossing in listed:
        assert 1000 < (DOCS / "gallery" / f"{crossing.name}.webp").stat().st_size <= MOST_PREVIEW
        words = crossing.command.removeprefix("drakeplan plan ").split()
        assert parse(plan.Arguments, "drakeplan plan", words, about="").html == f"{crossing.name}.html"


def test_figures_are_small_and_each_is_shown() -> None:
    shown = " ".join(path.read_text(encoding="utf-8") for path in DOCS.rglob("*.md"))
    for path in (DOCS / "figures").iterdir():
        assert path.stat().st_size <= MOST_FIGURE, path
        assert f"figures/{path.name}" in shown, path


def test_the_checks_see_what_is_wrong() -> None:
    assert is_external("https://a.example/x.js")
    assert is_external("//a.example/x.js")
    assert not is_external("assets/x.js")
    assert external("@import 'https://a.example/f.css'; b {background: url(//a.example/f.png)}") == [
        "//a.example/f.png",
        "https://a.example/f.css",
    ]
    assert not external("a {background: url(data:image/svg+xml;charset=utf-8,<svg/>)}")
