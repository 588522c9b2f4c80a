"""Public functions say what their arguments are; the share that does may only grow."""

from __future__ import annotations

import ast
from collections.abc import Iterator
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
LEAST = {"scenes": 0.97, "optimization": 0.92, "learning": 1.0, "drakeplan": 0.99}  # raise these when the share grows


def arguments(function: ast.FunctionDef) -> list[str]:
    """Names of a function's arguments, but for self and cls."""
    every = [*function.args.posonlyargs, *function.args.args, *function.args.kwonlyargs]
    return [a.arg for a in every if a.arg not in ("self", "cls")]


def public_functions(tree: ast.Module) -> Iterator[ast.FunctionDef]:
    """Functions and methods without a leading underscore in their name or their class's; constructors too."""
    for node in tree.body:
        if isinstance(node, ast.FunctionDef) and not node.name.startswith("_"):
            yield node
        if isinstance(node, ast.ClassDef) and not node.name.startswith("_"):
            for method in node.body:
                if isinstance(method, ast.FunctionDef) and (method.name == "__init__" or method.name[0] != "_"):
                    yield method


def is_explained(function: ast.FunctionDef) -> bool:
    """Whether a docstring has a section of arguments that names every one of them."""
    text = ast.get_docstring(function) or ""
    _, _, section = text.partition("Args:")
    said = {
        word for line in section.splitlines() if ":" in line for word in line.split(":")[0].replace(",", " ").split()
    }
    return all(name in said for name in arguments(function))


def counts(package: str) -> tuple[int, int]:
    """Public functions of two or more arguments that explain them all, and all of these."""
    explained = total = 0
    for path in sorted((ROOT / package).rglob("*.py")):
        for function in public_functions(ast.parse(path.read_text(encoding="utf-8"))):
            if len(arguments(function)) >= 2:
                total += 1
                explained += is_explained(function)
    return explained, total


@pytest.mark.parametrize("package", LEAST)
def test_public_functions_of_two_or_more_arguments_say_what_each_is(package: str) -> None:
    explained, total = counts(package)
    assert explained >= LEAST[package] * total, f"{explained} of {total}"


def test_a_function_that_leaves_an_argument_out_is_counted_as_such() -> None:
    whole, part = ast.parse(
        'def f(a, b):\n    """F.\n\n    Args:\n        a, b: numbers.\n    """\ndef g(a, b):\n    """a, b"""'
    ).body
    assert isinstance(whole, ast.FunctionDef) and isinstance(part, ast.FunctionDef)
    assert is_explained(whole) and not is_explained(part)


if __name__ == "__main__":
    for name in LEAST:
        print(name, *counts(name))
