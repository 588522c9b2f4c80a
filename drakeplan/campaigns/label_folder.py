"""The folder of a campaign on disk: what it is, its whole shards, and nothing half-written."""

from __future__ import annotations

import contextlib
import json
from collections.abc import Callable, Iterator
from dataclasses import asdict
from pathlib import Path

import pyarrow as pa

from learning.shard_file import (
    FORMAT,
    FORMAT_VERSION,
    CampaignIdentity,
    ShardHeader,
    encode_shard,
    read_header,
    read_shard,
    shard_name,
    shard_paths,
)
from scenes.files.whole_file import write_whole
from scenes.input_error import InputError

CAMPAIGN_FILE, CARD_FILE, SESSIONS_FILE, LOCK_FILE = "campaign.json", "card.json", "sessions.jsonl", ".lock"


class LabelFolder:
    """Shards of one campaign.

    Raises:
        InputError: the folder cannot be made or written, holds data and `resume` is not set, or holds data of a campaign
            with another identity.
    """

    def __init__(self, path: Path, identity: CampaignIdentity, *, resume: bool) -> None:
        """Makes the folder, or checks the one that is there.

        Args:
            path: the folder; it is made where it does not exist.
            identity: of the campaign.
            resume: whether shards may be there already.
        """
        self.path, self.identity = Path(path), identity
        try:
            self.path.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise InputError(f"{path}: cannot be made a folder ({error.strerror or error})") from None
        manifest = self.path / CAMPAIGN_FILE
        if manifest.exists():
            if not resume:
                raise InputError(f"{path}: holds a campaign already: go on with --resume, or name another folder")
            self._check(manifest)
        elif shard_paths(self.path):
            raise InputError(f"{path}: holds shards without {CAMPAIGN_FILE}: name another folder")
        else:
            facts = {"format": FORMAT, "format_version": FORMAT_VERSION, **asdict(identity)}
            write_whole(manifest, (json.dumps(facts, indent=2) + "\n").encode())

    @contextlib.contextmanager
    def locked(self) -> Iterator[None]:
        """Keeps other processes from collecting into this folder meanwhile."""
        import fcntl  # not on Windows

        with (self.path / LOCK_FILE).open("w") as file:
            try:
                fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except OSError:
                raise InputError(f"{self.path}: another process is collecting into this folder") from None
            yield

    def whole_shards(self, tell: Callable[[str], None]) -> dict[int, tuple[ShardHeader, int]]:
        """Header and number of rows of each shard that is whole and of this campaign; damaged ones are made again."""
        whole = {}
        for number, path in shard_paths(self.path).items():
            try:
                header, table = read_shard(path)
            except InputError as error:
                tell(f"{error}: made again")
                continue
            if (header.fingerprint, header.shard) != (self.identity.fingerprint, number):
                raise InputError(f"{path}: comes from another campaign: remove it or name another folder")
            whole[number] = header, table.num_rows
        return whole

    def write(self, shard: int, table: pa.Table, header: ShardHeader) -> None:
        """Adds a shard in one step.

        Args:
            shard: its number.
            table: its rows.
            header: facts of the shard that are stored with it.

        Raises:
            InputError: it cannot be written, because the disk is full for instance; the folder is as it was.
        """
        write_whole(self.path / shard_name(shard), encode_shard(table, header))

    def headers(self) -> dict[Path, ShardHeader]:
        """The header of every shard, in order."""
        return {path: read_header(path) for path in shard_paths(self.path).values()}

    def add_session(self, facts: dict[str, object]) -> None:
        """Notes which code goes on with the campaign."""
        lines = [json.dumps(session, sort_keys=True) for session in [*self.sessions(), facts]]
        write_whole(self.path / SESSIONS_FILE, ("\n".join(lines) + "\n").encode())

    def sessions(self) -> list[dict[str, object]]:
        """What was noted, in order."""
        path = self.path / SESSIONS_FILE
        try:
            return [json.loads(line) for line in path.read_text(encoding="utf-8").splitlines()]
        except FileNotFoundError:
            return []
        except (OSError, ValueError) as error:
            raise InputError(f"{path}: expected one JSON object a line ({error})") from None

    def _check(self, manifest: Path) -> None:
        theirs = read_identity(manifest)
        if difference := self.identity.difference(theirs):
            raise InputError(f"{self.path}: cannot be resumed, it was made with {difference}")


def read_identity(manifest: Path) -> CampaignIdentity:
    """The campaign that a folder holds, from its file.

    Raises:
        InputError: unreadable, or of another format.
    """
    try:
        facts = json.loads(manifest.read_text(encoding="utf-8"))
        found = facts.pop("format"), facts.pop("format_version")
        known = CampaignIdentity(**{**facts, "schema": tuple(facts["schema"])})
    except (OSError, ValueError, KeyError, TypeError, AttributeError) as error:
        raise InputError(f"{manifest}: expected the description of a campaign ({error})") from None
    if found != (FORMAT, FORMAT_VERSION):
        raise InputError(f"{manifest}: expected {FORMAT} version {FORMAT_VERSION}, got {found[0]} version {found[1]}")
    return known
