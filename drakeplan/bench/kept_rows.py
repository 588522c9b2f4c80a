"""Rows of a long benchmark, kept in a file as they are made: a run that was stopped goes on from there."""

from __future__ import annotations

import json
from collections.abc import Hashable
from pathlib import Path

from drakeplan.campaigns.card import session_facts


class KeptRows:
    """A JSON line for each row; rows of other code than the one that runs do not count."""

    def __init__(self, path: Path) -> None:
        """Reads the rows that this code has made.

        Args:
            path: of the file; made, with its folder, when the first row comes.
        """
        self._path, self._code = path, session_facts()["sources_sha256"]
        self.rows: dict[Hashable, dict] = {}
        lines = path.read_text(encoding="utf-8").splitlines() if path.exists() else []
        for line in lines:
            try:
                kept = json.loads(line)
            except json.JSONDecodeError:  # the last line of a run that was killed
                continue
            if kept.get("code") == self._code:
                self.rows[kept["key"]] = kept["row"]

    def add(self, key: str, row: dict) -> None:
        """Keeps a row.

        Args:
            key: what the row is about; a later one of the same key replaces it.
            row: its numbers and texts.
        """
        self.rows[key] = row
        self._path.parent.mkdir(parents=True, exist_ok=True)
        with self._path.open("a", encoding="utf-8") as file:
            file.write(json.dumps({"code": self._code, "key": key, "row": row}) + "\n")
