"""The page on plan files names every attribute and dataset that there is, with its unit and meaning."""

from __future__ import annotations

import re
from pathlib import Path

import h5py
import pytest

from drakeplan.plan.plan import Plan
from drakeplan.plan.plan_file import DATASETS, write_plan

PAGE = Path(__file__).resolve().parents[3] / "docs" / "reference" / "plan-file.md"


@pytest.fixture(scope="module")
def documented() -> dict[str, list[list[str]]]:
    """Heading -> rows of the table below it, the cells without backticks."""
    sections = re.split(r"(?m)^## (.+)$", PAGE.read_text(encoding="utf-8"))
    return {
        title: [[cell.strip(" `") for cell in row.split("|")[1:-1]] for row in re.findall(r"(?m)^\| `.+\|$", body)]
        for title, body in zip(sections[1::2], sections[2::2], strict=True)
    }


def test_datasets(documented: dict[str, list[list[str]]]) -> None:
    rows = {name: (unit, meaning) for name, _, unit, meaning in documented["Datasets"]}
    assert rows == {name: (unit or "-", meaning) for name, (unit, meaning) in DATASETS.items()}


def test_shapes_and_attributes(documented: dict[str, list[list[str]]], strolling_plan: Plan, tmp_path: Path) -> None:
    """Letters stand for sizes; the same letter is the same size everywhere but in padding."""
    write_plan(strolling_plan, tmp_path / "plan.h5")
    sizes: dict[str, int] = {}
    with h5py.File(tmp_path / "plan.h5") as file:
        assert sorted(row[0] for row in documented["Attributes"]) == sorted(file.attrs)
        assert not [key for key in file["motion"].attrs if f"`{key}`" not in PAGE.read_text(encoding="utf-8")]
        for name, shape, _, _ in documented["Datasets"]:
            if name not in file:
                continue
            letters = re.findall(r"\w+", shape.split(")")[0]) if shape.startswith("(") else []
            assert len(letters) == file[name].ndim, name
            for letter, size in zip(letters, file[name].shape, strict=True):
                assert sizes.setdefault(letter, size) == size if not letter.isdecimal() else int(letter) == size, name
    assert {"C", "E", "N", "P", "S", "T", "nq", "nv"} <= set(sizes)
