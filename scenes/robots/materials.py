"""The materials of a URDF as Drake takes them: one colour for each name, and no name without a colour."""

from __future__ import annotations

from lxml import etree  # type: ignore[attr-defined]


def settle_materials(root: etree._Element) -> None:
    """Gives a second colour of the same name another name, and removes materials that are defined nowhere.

    ROS takes the first or the last of them without a word; Drake refuses the model.

    Args:
        root: the URDF's root element, which is changed.
    """
    colours: dict[str | None, tuple[float, ...] | None] = {}
    used = list(root.iter("material"))
    for material in sorted(used, key=lambda m: m.getparent() is not root):  # those for the whole robot first
        name, colour, texture = material.get("name"), material.find("color"), material.find("texture")
        if colour is None and texture is None:
            if name not in colours:
                material.getparent().remove(material)
            continue
        look = None if colour is None else tuple(float(v) for v in colour.get("rgba", "").split())
        if colours.setdefault(name, look) != look:
            material.set(
                "name", next(n for k in range(len(used) + 1) if colours.setdefault(n := f"{name}_{k}", look) == look)
            )
