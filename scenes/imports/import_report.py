"""What an import did: counts of what was read, merged, dropped, filled; hints where a file looks other than meant."""

from __future__ import annotations

from dataclasses import dataclass, field


@dataclass(frozen=True)
class Change:
    """Something that became of a part of a file.

    Attributes:
        what: a verb: dropped, merged, filled, turned, cut, flattened.
        count: of how many things.
        things: what they are.
        why: the reason, in words.
    """

    what: str
    count: int
    things: str
    why: str

    def text(self) -> str:
        """One line."""
        return f"{self.what} {self.count} {self.things}: {self.why}"


@dataclass(frozen=True)
class ImportReport:
    """What an import did.

    Attributes:
        file: that was read.
        kind: heights, points, mesh, regions, polygons or boxes.
        read: what the file holds: things and their number.
        changes: what was changed on the way.
        notes: what else was said on the way, one line each.
        hints: what looks other than it was meant, and the option that mends it.
        noise: root mean square of the distances of what was measured from the surfaces that it became [m], None where
            nothing was measured.
        explained: share of what was measured that lies on surfaces, None as above.
    """

    file: str
    kind: str
    read: dict[str, int]
    changes: tuple[Change, ...] = ()
    notes: tuple[str, ...] = ()
    hints: tuple[str, ...] = field(default=())
    noise: float | None = None
    explained: float | None = None

    def facts(self) -> dict[str, object]:
        """For a machine."""
        return {
            "file": self.file,
            "kind": self.kind,
            "read": self.read,
            "changes": [
                {"what": c.what, "count": c.count, "things": c.things, "why": c.why} for c in self.changes if c.count
            ],
            "noise_m": self.noise,
            "share_on_surfaces": self.explained,
            "notes": list(self.notes),
            "hints": list(self.hints),
        }

    def lines(self) -> list[tuple[str, str]]:
        """For a person: a word and what is said under it."""
        read = ", ".join(f"{number} {things}" for things, number in self.read.items())
        lines = [("read", f"{self.file} as {self.kind}: {read}")]
        lines += [(c.what, c.text().removeprefix(f"{c.what} ")) for c in self.changes if c.count]
        if self.noise is not None and self.explained is not None:
            lines.append(("noise", f"{1e3 * self.noise:.2g} mm RMS; {self.explained:.1%} lie on surfaces"))
        lines += [("note", note) for note in self.notes]
        lines += [("hint", hint) for hint in self.hints]
        return lines
