"""The four floors import downwards only, and each floor keeps its promises about what it imports."""

from __future__ import annotations

import ast
import subprocess
import sys
from functools import cache
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
FLOORS = ["scenes", "optimization", "learning", "drakeplan"]  # from the ground up
ALONE = ROOT / "drakeplan" / "verifier"  # imports relatively, so that its folder runs wherever it is copied to
SOURCES = sorted(p for floor in FLOORS for p in (ROOT / floor).rglob("*.py"))


@cache
def imports_in(text: str) -> tuple[ast.Import | ast.ImportFrom, ...]:
    """Every import of a source text, at any depth of nesting; a text is parsed once for all tests."""
    return tuple(node for node in ast.walk(ast.parse(text)) if isinstance(node, ast.Import | ast.ImportFrom))


def imports_of(path: Path) -> tuple[ast.Import | ast.ImportFrom, ...]:
    return imports_in(path.read_text(encoding="utf-8"))


@cache
def imported(path: Path) -> set[str]:
    """Every module that a file imports."""
    modules = set()
    for node in imports_of(path):
        if isinstance(node, ast.Import):
            modules |= {alias.name for alias in node.names}
        else:
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


def test_only_training_imports_torch() -> None:
    importers = [path.relative_to(ROOT) for path in SOURCES if "torch" in {m.split(".")[0] for m in imported(path)}]
    assert importers
    assert not [path for path in importers if path.parts[:2] != ("learning", "training")]


def test_the_search_knows_no_robots() -> None:
    allowed = {"numpy", "numba", "drakeplan"} | set(sys.stdlib_module_names)
    sources = [path for path in SOURCES if path.is_relative_to(ROOT / "drakeplan" / "search")]
    assert len(sources) > 1
    for path in sources:
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


def import_edges(root: Path, sources: list[Path]) -> dict[Path, set[Path]]:
    """The files that each file imports: lazy and TYPE_CHECKING imports count, and so do relative ones.

    A name that a package's `__init__` imports and hands on counts as an import of the file that defines it.
    """
    files = {".".join(path.relative_to(root).with_suffix("").parts).removesuffix(".__init__"): path for path in sources}
    imports = {path: imports_of(path) for path in sources}

    def module_of(path: Path, node: ast.ImportFrom) -> str:
        package = path.relative_to(root).parent.parts[: None if node.level < 2 else 1 - node.level]
        return ".".join([*(package if node.level else ()), *([node.module] if node.module else [])])

    def home(module: str, name: str) -> Path | None:
        if f"{module}.{name}" in files:
            return files[f"{module}.{name}"]
        path = files.get(module)
        if path is None or path.name != "__init__.py":
            return path
        for node in imports[path]:
            if isinstance(node, ast.ImportFrom) and name in {alias.asname or alias.name for alias in node.names}:
                given = next(alias.name for alias in node.names if (alias.asname or alias.name) == name)
                return home(module_of(path, node), given)
        return path

    edges: dict[Path, set[Path]] = {}
    for path, nodes in imports.items():
        reached: set[Path | None] = set()
        for node in nodes:
            if isinstance(node, ast.Import):
                reached |= {files.get(alias.name) for alias in node.names}
            else:
                reached |= {home(module_of(path, node), alias.name) for alias in node.names}
        edges[path] = {other for other in reached if other is not None} - {path}
    return edges


def import_circles(root: Path, sources: list[Path]) -> set[frozenset[str]]:
    """The groups of files that import each other, directly or through others, by path from `root`."""
    edges = import_edges(root, sources)

    def reachable(start: Path) -> set[Path]:
        found: set[Path] = set()
        waiting = [start]
        while waiting:
            new = edges[waiting.pop()] - found
            found |= new
            waiting += new
        return found

    reach = {path: reachable(path) for path in sources}
    return {
        frozenset(str(b.relative_to(root)) for b in sources if b in reach[a] and a in reach[b])
        for a in sources
        if a in reach[a]
    }


def test_no_files_import_each_other_in_a_circle() -> None:
    assert import_circles(ROOT, SOURCES) == set()


@pytest.mark.parametrize(
    ("first", "second"),
    [
        ("from room.b import B", "from room.a import A"),
        ("import room.b", "def late() -> None:\n    from room import a"),
        ("from room import B", "if TYPE_CHECKING:\n    from .a import A"),
        ("from .b import B", "from . import a"),
    ],
)
def test_a_made_up_circle_is_found(tmp_path: Path, first: str, second: str) -> None:
    room = tmp_path / "room"
    room.mkdir()
    text = {"__init__": "from room.b import B", "a": first, "b": second, "c": "from room import B"}
    for name, line in text.items():
        (room / f"{name}.py").write_text(line + "\n")
    sources = sorted(room.glob("*.py"))
    assert import_circles(tmp_path, sources) == {frozenset({"room/a.py", "room/b.py"})}
    (room / "b.py").write_text("B = 1\n")
    assert import_circles(tmp_path, sources) == set()


@pytest.mark.parametrize(("floor", "most"), [("scenes", 12), ("optimization", 4), ("drakeplan", 8)])
def test_the_top_of_a_package_holds_few_files(floor: str, most: int) -> None:
    assert len([p for p in (ROOT / floor).glob("*.py") if p.name != "__init__.py"]) <= most


def test_no_file_is_longer_than_450_lines() -> None:
    long = {str(p.relative_to(ROOT)) for p in SOURCES if len(p.read_text(encoding="utf-8").splitlines()) > 450}
    assert long == set()
