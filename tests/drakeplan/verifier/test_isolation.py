"""The verifier stands alone."""

from __future__ import annotations

import ast
import graphlib
import json
import shutil
import subprocess
import sys
from pathlib import Path

from drakeplan import verifier

FOLDER = Path(verifier.__file__).parent


MODULES = sorted(path.stem for path in FOLDER.glob("*.py"))


def parsed() -> dict[str, ast.Module]:
    """The syntax tree of every module of the package by its name."""
    return {name: ast.parse((FOLDER / f"{name}.py").read_text(encoding="utf-8")) for name in MODULES}


def test_the_verifier_shares_no_code_with_what_it_judges() -> None:
    allowed = {"numpy", "scipy", "h5py", "yaml", "shapely", "pydrake"} | set(sys.stdlib_module_names)
    for name, tree in parsed().items():
        for node in ast.walk(tree):
            if isinstance(node, ast.Import):
                imported = [alias.name for alias in node.names]
            elif isinstance(node, ast.ImportFrom) and node.level == 0:
                imported = [node.module or ""]
            elif isinstance(node, ast.ImportFrom):
                assert node.level == 1, f"{name}, line {node.lineno}: reaches out of the folder"
                assert node.module in MODULES, f"{name}, line {node.lineno}: no such module in the folder"
                continue
            elif isinstance(node, ast.Call) and isinstance(node.func, ast.Name):
                assert node.func.id not in ("__import__", "exec", "eval"), f"{name}, line {node.lineno}"
                continue
            else:
                continue
            for module in imported:
                top = module.split(".")[0]
                assert top in allowed - {"importlib", "runpy"}, f"{name}, line {node.lineno} imports {module}"


def test_no_module_imports_itself_by_way_of_others() -> None:
    imports = {
        name: {n.module for n in ast.walk(tree) if isinstance(n, ast.ImportFrom) and n.level == 1}
        for name, tree in parsed().items()
    }
    graphlib.TopologicalSorter(imports).prepare()  # raises CycleError


def test_the_folder_alone_judges_a_plan_without_the_packages(good: Path, tmp_path: Path) -> None:
    shutil.copytree(FOLDER, tmp_path / "judge", ignore=shutil.ignore_patterns("__pycache__"))
    code = (
        "import sys, runpy\n"
        "for name in ('drakeplan', 'scenes', 'optimization', 'learning'): sys.modules[name] = None  # no import\n"
        f"sys.path.insert(0, {str(tmp_path)!r})\n"
        f"sys.argv = ['judge', {str(good)!r}, '--json']\n"
        "runpy.run_module('judge', run_name='__main__')  # as python -m judge\n"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False, cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    assert json.loads(done.stdout)["holds"] is True
