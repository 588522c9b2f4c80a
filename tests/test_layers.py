"""The four floors import downwards only, and each floor keeps its promises about what it imports."""

from __future__ import annotations

import ast
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
FLOORS = ["scenes", "optimization", "learning", "drakeplan"]  # from the ground up
ALONE = ROOT / "drakeplan" / "verifier"  # imports relatively, so that its folder runs wherever it is copied to
SOURCES = sorted(p for floor in FLOORS for p in (ROOT / floor).rglob("*.py"))


def imported(path: Path) -> set[str]:
    """Every module that a file imports, at any depth of nesting."""
    modules = set()
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            modules |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            where = f"{path}:{node.lineno}"
            assert node.level == 0 or path.parent == ALONE, f"{where}: packages import each other by absolute name"
            assert node.level < 2, f"{where}: reaches out of its folder"
            if not node.level:
                modules.add(node.module or "")
    return modules


@pytest.mark.parametrize("path", SOURCES, ids=lambda p: str(p.relative_to(ROOT)))
def test_a_package_imports_only_those_below_it(path: Path) -> None:
    floor = FLOORS.index(path.relative_to(ROOT).parts[0])
    above = set(FLOORS[floor + 1 :]) | {"tests", "tutorials"}
    assert not {m for m in imported(path) if m.split(".")[0] in above}


@pytest.mark.parametrize("path", SOURCES, ids=lambda p: str(p.relative_to(ROOT)))
def test_only_training_imports_torch(path: Path) -> None:
    if path.relative_to(ROOT).parts[:2] == ("learning", "training"):
        return
    assert not {m for m in imported(path) if m.split(".")[0] == "torch"}


def test_the_search_knows_no_robots() -> None:
    allowed = {"numpy", "numba", "drakeplan"} | set(sys.stdlib_module_names)
    for path in (ROOT / "drakeplan" / "search").rglob("*.py"):
        for module in imported(path):
            top = module.split(".")[0]
            assert top in allowed, f"{path.name} imports {module}"
            assert top != "drakeplan" or module.startswith("drakeplan.search"), f"{path.name} imports {module}"


def test_the_public_face_keeps_its_promises() -> None:
    code = "import drakeplan; [getattr(drakeplan, name) for name in drakeplan.__all__]; print(len(drakeplan.__all__))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert int(done.stdout) > 0


@pytest.mark.train
def test_planning_does_not_import_torch_even_where_it_is_installed() -> None:
    code = "import torch, sys; print(torch.__version__)"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.startswith("2.")
    code = "import drakeplan, drakeplan.query.planning, drakeplan.cli, sys; sys.exit('torch' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0
