"""Where a mesh lies: beside the scene file, in an installed package, or among the meshes of hpp-environments."""

from __future__ import annotations

import re
from functools import cache
from importlib import metadata
from pathlib import Path, PurePosixPath

from scenes.input_error import InputError, unknown_name
from scenes.meshes.mesh_file import MESH_SUFFIXES

PACKAGE_SCHEME = "package://"
HPP_PACKAGE = "hpp_environments"
HPP_FOLDER = PurePosixPath("meshes/multicontact")


def mesh_path(reference: str, folder: Path | None, where: str) -> Path:
    """The file that a scene file's `file:` names.

    Args:
        reference: a path relative to the scene file, in its folder or below, or `package://<package>/<path>`.
        folder: of the scene file; None where there is none, and only packages can be named.
        where: source and key, for errors.

    Raises:
        InputError: an absolute path, one that climbs out of its folder or package, or an unknown package.
    """
    if reference.startswith(PACKAGE_SCHEME):
        package, _, rest = reference.removeprefix(PACKAGE_SCHEME).partition("/")
        root = package_folder(package)
        if root is None:
            raise InputError(f"{where}: no installed package has a folder share/{package}{_hint(package)}")
        return _inside(root, rest, where, f"the package {package}")
    if folder is None:
        raise InputError(f"{where}: expected package://..., a path has no folder to start from here")
    return _inside(folder, reference, where, "the scene file's folder")


@cache
def package_folder(package: str) -> Path | None:
    """The folder share/<package> that an installed Python distribution of that name carries, or None."""
    if not re.fullmatch(r"[A-Za-z0-9][A-Za-z0-9_.-]*", package):
        return None
    try:
        distribution = metadata.distribution(package.replace("_", "-"))
    except metadata.PackageNotFoundError:
        return None
    for file in distribution.files or ():
        parts = file.parts
        for i in range(len(parts) - 2):
            if parts[i : i + 2] == ("share", package):
                folder = Path(str(distribution.locate_file(PurePosixPath(*parts[: i + 2]))))
                return folder.resolve() if folder.is_dir() else None
    return None


@cache
def hpp_meshes() -> dict[str, str]:
    """Name after `hpp/` and `package://` reference of every mesh of hpp-environments; empty when it is not installed.

    The planners' own meshes go by their bare name, those of other folders by folder/name. Of two formats of one mesh
    the STL is meant, unless the suffix is given.
    """
    root = package_folder(HPP_PACKAGE)
    if root is None:
        return {}
    found: dict[str, str] = {}
    files = [p for p in (root / "meshes").rglob("*") if p.suffix.lower() in MESH_SUFFIXES]
    for file in sorted(files, key=lambda p: (p.suffix != ".stl", str(p))):
        path = PurePosixPath(file.relative_to(root).as_posix())
        name = path.relative_to(HPP_FOLDER) if path.is_relative_to(HPP_FOLDER) else path.relative_to("meshes")
        reference = f"{PACKAGE_SCHEME}{HPP_PACKAGE}/{path}"
        found.setdefault(str(name.with_suffix("")), reference)
        found[str(name)] = reference
    return found


def hpp_reference(name: str) -> str:
    """The `package://` reference of the mesh called `hpp/<name>`.

    Raises:
        InputError: the package is not installed, or has no such mesh (the nearest names are given).
    """
    meshes = hpp_meshes()
    if not meshes:
        raise InputError(f"hpp/{name}: its meshes are not installed{_hint(HPP_PACKAGE)}")
    if name not in meshes:
        raise unknown_name("mesh", f"hpp/{name}", (f"hpp/{known}" for known in meshes))
    return meshes[name]


def _inside(root: Path, rest: str, where: str, whose: str) -> Path:
    """root/rest, where rest neither starts at a root nor climbs out of this one by dots or links."""
    path = PurePosixPath(rest)
    if not rest or "\\" in rest or "\0" in rest or path.is_absolute() or ".." in path.parts or path.drive:
        raise InputError(f"{where}: expected a path inside {whose}, got {rest!r}")
    file = root / path
    if not file.resolve().is_relative_to(root.resolve()):
        raise InputError(f"{where}: expected a path inside {whose}, {rest!r} leads out of it")
    return file


def _hint(package: str) -> str:
    return ", install them with: pip install --no-deps hpp-environments" if package == HPP_PACKAGE else ""
