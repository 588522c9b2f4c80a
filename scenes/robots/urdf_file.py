"""A URDF file as an XML tree, checked before anything is made of it."""

from __future__ import annotations

from collections import Counter
from pathlib import Path

from lxml import etree  # type: ignore[attr-defined]

from scenes.input_error import InputError

MAX_URDF_BYTES = 20_000_000
XACRO = "http://www.ros.org/wiki/xacro"


def read_urdf(path: Path) -> etree._Element:
    """The root element of a URDF, comments removed.

    Raises:
        InputError: the file is too large, no XML, no URDF, a xacro file, or declares a document type.
    """
    try:
        if path.stat().st_size > MAX_URDF_BYTES:
            raise InputError(f"{path}: larger than {MAX_URDF_BYTES} bytes, which no robot model is")
        parser = etree.XMLParser(resolve_entities=False, no_network=True, remove_comments=True)
        tree = etree.parse(str(path), parser)
    except etree.XMLSyntaxError as error:
        raise InputError(f"{path}: not XML ({error})") from None
    except OSError as error:
        raise InputError(f"{path}: cannot be read ({error.strerror or error})") from None
    if tree.docinfo.internalDTD is not None:
        raise InputError(f"{path}: declares a document type, expected a plain URDF")
    root = tree.getroot()
    if root.tag != "robot":
        raise InputError(f"{path}: expected a URDF, whose root element is <robot>, got <{root.tag}>")
    if any(isinstance(e.tag, str) and e.tag.startswith(f"{{{XACRO}}}") for e in root.iter()):
        raise InputError(f"{path}: a xacro file: expand it first: xacro MODEL.urdf.xacro > MODEL.urdf")
    _check_names(root, path)
    return root


def _check_names(root: etree._Element, path: Path) -> None:
    for tag in ("link", "joint"):
        names = [e.get("name") for e in root.findall(tag)]
        if not all(names):
            raise InputError(f"{path}: a {tag} without a name: give it one")
        for name, count in Counter(names).items():
            if count > 1:
                raise InputError(f"{path}: {tag} {name!r} is there twice: give one of them another name")
