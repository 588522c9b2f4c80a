"""Plans in other tools' formats.

A format is one module (`drakeplan.export.formats` lists them). Exporters make bytes; `export_plan` writes them, the named
file last, so that whoever sees it finds all that goes with it. The same plan gives the same bytes.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from drakeplan.export.formats import FORMATS, ExportOptions, Product, find_format, load_exporter
from scenes.input_error import InputError

if TYPE_CHECKING:
    from drakeplan.plan.plan import Plan
    from scenes.robots.robot import Robot

__all__ = ["FORMATS", "ExportOptions", "Exported", "export_plan"]


@dataclass(frozen=True)
class Exported:
    """What an export wrote.

    Attributes:
        files: paths, the one that was asked for first.
        facts: what is in them.
    """

    files: tuple[Path, ...]
    facts: dict[str, object]


def export_plan(
    plan: Plan, format: str, file: str | Path, *, robot: Robot | None = None, rate: int = ExportOptions.rate
) -> Exported:
    """Writes a plan in another tool's format.

    Args:
        plan: what to write.
        format: one of `FORMATS`.
        file: where; some formats put further files beside it, named after it.
        robot: the plan's robot; None: found by its name and the SHA-256 of its model, where the format needs it.
        rate: rows per second of `tracking` [Hz].

    Raises:
        InputError: no such format, a package that it needs is missing, the plan has no motion, its robot is not here, or
            the file cannot be written.
    """
    from drakeplan.export.source import Source
    from drakeplan.plan.robot_of_plan import RobotMark, find_robot
    from scenes.files.whole_file import require_writable

    file, found, options = Path(file), find_format(format), ExportOptions(rate)
    require_writable(file)
    if found.needs_motion and plan.motion is None:
        raise InputError(f"a plan of contacts only: there is no motion for --to {format}; --to contacts exports it")
    if found.needs_robot and robot is None:
        robot = find_robot(RobotMark.of(plan))
    product = load_exporter(found).export(Source(plan, robot), file, options)
    return Exported(_write(product, file), {"format": format, **product.facts})


def _write(product: Product, file: Path) -> tuple[Path, ...]:
    """Writes all files, each in one step and the main one last; takes back new ones when that fails."""
    from scenes.files.whole_file import require_writable, write_whole

    made: list[Path] = []
    try:
        for name, content in product.beside.items():
            path = file.parent / name
            _make_folder(path.parent, made)
            require_writable(path)
            if not path.exists():
                made.append(path)
            write_whole(path, content)
        write_whole(file, product.main)
    except BaseException:
        _remove(made)
        raise
    return (file, *(file.parent / name for name in product.beside))


def _make_folder(folder: Path, made: list[Path]) -> None:
    """Makes a folder where it is missing, and notes that in `made`."""
    try:
        if folder.is_dir():
            return
        folder.mkdir()
    except OSError as error:
        raise InputError(f"{folder}: cannot be made ({error.strerror or error})") from None
    made.append(folder)


def _remove(paths: list[Path]) -> None:
    import contextlib

    for path in reversed(paths):
        with contextlib.suppress(OSError):
            path.rmdir() if path.is_dir() else path.unlink()
