"""The wheel is whole: installed where nothing of this checkout can be seen, it plans, with weights, robots and scenes inside."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
import sysconfig
import venv
import zipfile
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
PACKAGES = ("scenes", "optimization", "learning", "drakeplan")
WHERE = """
import json
import drakeplan, learning, optimization, scenes
from drakeplan import list_scenes, robot_names
from learning.surrogate import load_surrogate
from scenes.robots.robot import load_robot
homes = [m.__file__ for m in (drakeplan, learning, optimization, scenes)]
print(json.dumps([homes, robot_names(), sorted(list_scenes()), load_surrogate(load_robot("escher")).card["cone"]]))
"""


@pytest.fixture(scope="module")
def wheel(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Built from a copy, so that nothing is left in the checkout."""
    source, out = tmp_path_factory.mktemp("source"), tmp_path_factory.mktemp("wheel")
    for name in PACKAGES:
        shutil.copytree(ROOT / name, source / name, ignore=shutil.ignore_patterns("__pycache__"))
    for name in ("pyproject.toml", "README.md", "LICENSE"):
        shutil.copy(ROOT / name, source / name)
    command = [sys.executable, "-m", "pip", "wheel", "--quiet", "--no-deps", "--no-build-isolation", "-w", str(out)]
    done = subprocess.run([*command, str(source)], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    (built,) = out.glob("drakeplan-*.whl")
    return built


@pytest.fixture(scope="module")
def python(wheel: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The interpreter of an environment that has the wheel, and the dependencies but no editable install."""
    home = tmp_path_factory.mktemp("environment")
    venv.EnvBuilder(with_pip=False, symlinks=True).create(home)
    interpreter = home / "bin" / "python"
    paths = {"base": str(home), "platbase": str(home)}
    site = Path(sysconfig.get_path("purelib", scheme="venv", vars=paths))
    with zipfile.ZipFile(wheel) as archive:
        archive.extractall(site)
    _lend_compiled_kernels(site)
    # A folder that a .pth file names is searched, but its own .pth files are not read: no finder of this checkout.
    (site / "dependencies.pth").write_text(sysconfig.get_path("purelib") + "\n")
    return interpreter


def _lend_compiled_kernels(site: Path) -> None:
    """Copies what numba has compiled from these very sources, which takes minutes: it asks for the same time stamps."""
    for package in PACKAGES:
        for path in (ROOT / package).rglob("*.py"):
            installed = site / path.relative_to(ROOT)
            if installed.read_bytes() == path.read_bytes():
                shutil.copystat(path, installed)
        for kernel in (ROOT / package).rglob("*.nb[ic]"):
            beside = site / kernel.relative_to(ROOT)
            beside.parent.mkdir(exist_ok=True)
            shutil.copy2(kernel, beside)


def run(python: Path, *arguments: str, cwd: Path) -> str:
    clean = {k: v for k, v in os.environ.items() if not k.startswith("PYTHON")}
    done = subprocess.run([str(python), *arguments], capture_output=True, text=True, cwd=cwd, env=clean, timeout=900)
    assert done.returncode == 0, done.stderr
    return done.stdout


def test_every_python_file_of_the_packages_is_in_it_and_they_say_that_they_are_typed(wheel: Path) -> None:
    inside = set(zipfile.ZipFile(wheel).namelist())
    for package in PACKAGES:
        for path in (ROOT / package).rglob("*.py"):
            assert path.relative_to(ROOT).as_posix() in inside
        assert f"{package}/py.typed" in inside
    assert not [name for name in inside if name.startswith(("tests", "tutorials", "docs"))]


@pytest.mark.slow
def test_it_plans_level_ground_with_its_own_weights_robots_and_scenes(python: Path, tmp_path: Path) -> None:
    homes, robots, scenes, cone = json.loads(run(python, "-c", WHERE, cwd=tmp_path))
    site = str(python.parent.parent)
    assert all(home.startswith(site) for home in homes), homes
    assert {"escher", "jvrc1"} <= set(robots) and "flat" in scenes and cone == "inner"
    words = ("-m", "drakeplan", "plan", "flat", "--goal", "0.5", "0", "--out", "plan.h5", "--json")
    report = json.loads(run(python, *words, cwd=tmp_path))
    assert report["verified"]["holds"]
    assert report["transitions_judged"]["learned"] > 0
    run(python, "-m", "drakeplan", "verify", "plan.h5", cwd=tmp_path)


@pytest.mark.slow
@pytest.mark.skipif(shutil.which("setpriv") is None, reason="setpriv takes root's right to write anywhere away")
def test_it_runs_where_neither_the_installation_nor_home_can_be_written(python: Path, tmp_path: Path) -> None:
    """As in an image on a cluster: permission bits count once the capabilities of root are gone."""
    site = Path(run(python, "-c", "import scenes; print(scenes.__path__[0])", cwd=tmp_path).strip()).parent
    folders = [f for package in PACKAGES for f in [site / package, *(site / package).rglob("*")] if f.is_dir()]
    home, scratch = tmp_path / "home", tmp_path / "scratch"
    home.mkdir(mode=0o555)
    scratch.mkdir()
    drop = ["setpriv", "--bounding-set=-all", "--inh-caps=-all"] if os.getuid() == 0 else []
    clean = {k: v for k, v in os.environ.items() if not k.startswith(("PYTHON", "XDG", "NUMBA"))}
    clean |= {"HOME": str(home), "TMPDIR": str(scratch)}
    words = [*drop, str(python), "-m", "drakeplan", "scenes", "export", "flat", str(scratch / "flat.yaml")]
    try:
        for folder in folders:
            folder.chmod(0o555)
        probe = [*drop, str(python), "-c", f"open({str(site / 'scenes' / 'x')!r}, 'w')"]
        if subprocess.run(probe, capture_output=True, env=clean).returncode == 0:
            pytest.skip("this machine's root writes everywhere")
        for _ in range(2):
            done = subprocess.run(words, capture_output=True, text=True, env=clean, cwd=scratch, timeout=300)
            assert done.returncode == 0, done.stderr
            assert done.stderr.count("can be written") == 1, done.stderr
            assert str(scratch) in done.stderr
    finally:
        for folder in folders:
            folder.chmod(0o755)
    (temporary,) = scratch.glob("drakeplan-*")
    assert temporary.stat().st_mode & 0o077 == 0  # nobody else can put kernels there
