"""Where a robot's mesh files lie: package://, model:// and file:// addresses, and paths beside the model."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

from scenes.input_error import InputError

SCHEMES = ("package://", "model://")
NAME_IN_MANIFEST = re.compile(r"<name>\s*([^<\s]+)\s*</name>")
MAX_MANIFEST_BYTES = 100_000


@dataclass(frozen=True)
class Addresses:
    """Resolves the addresses in one robot's model.

    Attributes:
        source: the robot file, for errors.
        folders: name in package:// addresses -> folder.
        confined: whether every file must lie inside one of the folders, as in an installed package.
    """

    source: str
    folders: Mapping[str, Path] = field(default_factory=dict)
    confined: bool = False

    def resolve(self, address: str, base: Path) -> Path:
        """The file that an address names.

        Args:
            address: as the model has it.
            base: folder of the model, where relative paths begin.

        Raises:
            InputError: an unknown package, a path out of the package's folders, or no such file.
        """
        scheme = next((s for s in SCHEMES if address.startswith(s)), None)
        if scheme is not None:
            name, _, rest = address.removeprefix(scheme).lstrip("/").partition("/")
            path = (self._folder(name, address, base) / rest).resolve()
        else:
            path = (base / address.removeprefix("file://")).resolve()
        if self.confined and not any(path.is_relative_to(folder) for folder in self.folders.values()):
            raise InputError(f"{self.source}: {address}: leads out of the package's folders")
        if not is_file(path):
            raise InputError(f"{self.source}: {address}: there is no file {path}")
        return path

    def _folder(self, name: str, address: str, base: Path) -> Path:
        if name in self.folders:
            return self.folders[name]
        if self.confined:
            raise InputError(f"{self.source}: {address}: package.folders does not name {name!r}")
        above = next((f for f in [base, *base.parents] if f.name == name or _manifest_name(f) == name), None)
        if above is None:
            raise InputError(
                f"{self.source}: {address}: package {name!r} is not known: add --package {name}=DIR with its folder"
            )
        return above


def is_file(path: Path) -> bool:
    """Whether there is such a file; a name that no file can have is none."""
    try:
        return path.is_file()
    except (OSError, ValueError):
        return False


def _manifest_name(folder: Path) -> str:
    """The name in a ROS package's manifest in this folder, "" without one."""
    manifest = folder / "package.xml"
    try:
        if not manifest.is_file() or manifest.stat().st_size > MAX_MANIFEST_BYTES:
            return ""
        found = NAME_IN_MANIFEST.search(manifest.read_text(encoding="utf-8", errors="replace"))
    except OSError:
        return ""
    return found.group(1) if found else ""


def read_packages(entries: tuple[str, ...], option: str = "--package") -> dict[str, Path]:
    """Package folders from words NAME=DIR.

    Args:
        entries: as the user writes them.
        option: where they come from, for errors.

    Raises:
        InputError: a word of another form, or no such folder.
    """
    folders: dict[str, Path] = {}
    for entry in entries:
        name, equals, folder = entry.partition("=")
        if not equals or not name or not folder:
            raise InputError(f"{option}: expected NAME=DIR, got {entry!r}")
        path = Path(folder).expanduser().resolve()
        if not path.is_dir():
            raise InputError(f"{option}: {name}: there is no folder {path}")
        folders[name] = path
    return folders
