"""Where a stranger's model lies: a file by its path, or a file inside an installed Python package."""

from __future__ import annotations

import importlib.metadata
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path, PurePosixPath

from scenes.input_error import InputError
from scenes.robots.adapter import ModelSource, package_source
from scenes.robots.addresses import Addresses, is_file
from scenes.robots.model_file import MODEL_SUFFIXES
from scenes.robots.schema import ModelChanges, PackageEntry

MOST_NAMED = 12  # models of a package that a message lists


@dataclass(frozen=True)
class FoundModel:
    """A model file, and the words that a robot file says of it.

    Attributes:
        file: its absolute path.
        packages: folders of package:// addresses that the user gave.
        package: the package's entry, None for a file by its path.
    """

    file: Path
    packages: Mapping[str, Path]
    package: PackageEntry | None = None

    def source(self, changes: ModelChanges) -> ModelSource:
        """What the adapter takes.

        Args:
            changes: frames, welds and collision pairs to add.
        """
        if self.package is not None:
            entry = PackageEntry.model_validate({**self.package.model_dump(), **changes.model_dump()})
            return package_source(entry, source=str(self.file), packages=self.packages)
        return ModelSource(self.file, Addresses(str(self.file), self.packages), changes)


def find_model_source(model: str, packages: Mapping[str, Path]) -> FoundModel:
    """The model that a user names.

    Args:
        model: path of a URDF, SDF or MJCF file, or PACKAGE/FILE, where PACKAGE is a Python distribution that is
            installed and FILE the end of the path of one of its models.
        packages: folders of package:// addresses by package name.

    Raises:
        InputError: there is no such file, it is no model, or it is several.
    """
    path = Path(model).expanduser()
    if is_file(path):
        if path.suffix.lower() == ".xacro":
            raise InputError(f"{model}: expand the file first: xacro {path.name} > {path.name.split('.')[0]}.urdf")
        if path.suffix.lower() not in MODEL_SUFFIXES:
            raise InputError(f"{model}: expected a model that ends in one of {', '.join(MODEL_SUFFIXES)}")
        return FoundModel(path.resolve(), packages)
    distribution, slash, end = model.partition("/")
    try:
        installed = importlib.metadata.distribution(distribution) if distribution.strip() else None
    except importlib.metadata.PackageNotFoundError:
        installed = None
    if installed is None or path.is_absolute():
        hint = f", and no Python package {distribution} is installed" if slash and not path.is_absolute() else ""
        raise InputError(f"{model}: there is no such file{hint}")
    return _in_package(model, installed, end, packages)


def _in_package(
    model: str, installed: importlib.metadata.Distribution, end: str, packages: Mapping[str, Path]
) -> FoundModel:
    site = Path(str(installed.locate_file("")))
    files = [PurePosixPath(str(f)) for f in installed.files or () if PurePosixPath(str(f)).suffix in MODEL_SUFFIXES]
    found = [f for f in files if f"/{f}".endswith(f"/{end}")] if end else files
    if len(found) != 1:
        names = ", ".join(sorted({f.name if not end else str(f) for f in found or files})[:MOST_NAMED])
        what = f"{len(found)} models end in {end!r}" if found and end else "which of its models?"
        if end and not found:
            what = f"no model of the package ends in {end!r}"
        raise InputError(f"{model}: {what.rstrip('?')}: {names}" if names else f"{model}: the package has no model")
    name = str(installed.metadata["Name"])
    top = found[0].parts[: 3 if found[0].parts[0] == "cmeel.prefix" else 1]
    folder = PurePosixPath(*top) if ".." not in found[0].parts else None
    if folder is None:  # data outside site-packages: the file itself is all that can be named
        return FoundModel(Path(str(installed.locate_file(str(found[0])))).resolve(), packages)
    entry = PackageEntry(
        distribution=name,
        folders={folder.name: str(folder)},
        urdf=f"package://{folder.name}/{found[0].relative_to(folder)}",
    )
    return FoundModel((site / found[0]).resolve(), packages, entry)
