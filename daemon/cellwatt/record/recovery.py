"""Closes files left open by a crash, a power cut or a full disk, and reports what was lost."""

from __future__ import annotations

import contextlib
import itertools
import os
from collections.abc import Mapping
from dataclasses import dataclass, field
from io import FileIO
from pathlib import Path

from cellwatt.files import open_file, sync_folder, write_all
from cellwatt.record.chunks import read_at
from cellwatt.record.container import Chunk, closing
from cellwatt.record.decoder import Track, tracks_of
from cellwatt.record.encoder import Encoder, Item
from cellwatt.record.folder import files_of
from cellwatt.record.header import DAMAGED, PART, closed_name
from cellwatt.record.openfile import OpenFile, lock
from cellwatt.record.reader import numbered_items
from cellwatt.record.scan import Damage, Scan, scan
from cellwatt.record.survey import guess_header
from cellwatt.results import Event, Result


@dataclass(frozen=True, slots=True)
class Recovery:
    """Result of the recovery of one file that was left open.

    ``result`` is the closed file, ``None`` if it held no message or could not be repaired (then
    ``problem`` is the reason and the file is unchanged). ``missing`` counts by topic the messages that are absent
    according to their numbers. ``aside`` is the file of the unreadable bytes, if there were any.
    """

    part: Path
    result: Path | None = None
    messages: int = 0
    size: int = 0
    unreadable: int = 0
    missing: Mapping[str, int] = field(default_factory=dict)
    damage: tuple[Damage, ...] = ()
    aside: Path | None = None
    problem: str = ""

    def __str__(self) -> str:
        name = self.part.name.removesuffix(PART)
        if self.problem:
            return f"{self.part.name}: {self.problem}"
        if self.result is None and not self.size:
            return f"{self.part.name}: was empty and has been removed"
        recovered = f"{name}: {self.messages} messages recovered" if self.result else f"{name}: held no message"
        if not self.unreadable and not self.missing:
            return f"{recovered}, nothing lost except data still in memory"
        lost = [f"{n} of {topic}" for topic, n in sorted(self.missing.items())]
        if self.unreadable:
            lost.append(f"{self.unreadable} bytes unreadable ({'; '.join(dict.fromkeys(d.what for d in self.damage))})")
        where = f"; stored as {self.aside.name}" if self.aside else ""
        return f"{recovered}, lost: {', '.join(lost)}{where}"


def left_open(folder: Path, cell: str) -> list[Path]:
    """Files of a cell that were not closed, newest first."""
    return [stored.path for stored in reversed(files_of(folder, cell)) if not stored.closed]


def recover(part: Path) -> Recovery | None:
    """Close one file that was left open; ``None`` if its writer is alive or the file is gone.

    Unreadable bytes are never deleted: they are moved to a file with the suffix ``.damaged``.
    Raises nothing: the reason that prevents the repair (a full or read-only disk) is in ``problem``, and calling
    again later is safe, also after a crash during the repair.
    """
    try:
        with open_file(part, write=True) as file:
            lock(file)
            return _repair(file, part)
    except (FileNotFoundError, BlockingIOError):
        return None
    except OSError as error:
        return Recovery(part, problem=f"cannot be repaired now: {error.strerror}; it is unchanged")


def _repair(file: FileIO, part: Path) -> Recovery:
    target = closed_name(part)
    if target.exists():
        copy = _free_name(part.with_name(part.name + DAMAGED))
        part.rename(copy)
        return Recovery(part, problem=f"{target.name} exists already; moved to {copy.name}")
    found = scan(file, part)
    aside: Path | None = None
    result: Path | None = target
    if not found.contents.chunks:
        result = None
        aside = _set_aside_whole(part) if found.damage else None
        part.unlink(missing_ok=True)
    elif found.closed and not found.damage:
        os.fsync(file.fileno())
        part.rename(target)
    elif found.torn:
        aside = _set_aside(file, found, target)
        # The incomplete end is cut off, and the end of the file is written in its place.
        file.truncate(found.end)
        file.seek(found.end)
        write_all(file, found.tail + closing(found.contents, found.end + len(found.tail)))
        os.fsync(file.fileno())
        part.rename(target)
    else:
        _rewrite(file, found, target)
        aside = _set_aside_whole(part)
    sync_folder(part.parent)
    return Recovery(
        part=part,
        result=result,
        messages=found.contents.counts.total(),
        size=found.size,
        unreadable=sum(d.length for d in found.damage),
        missing=dict(found.missing),
        damage=tuple(found.damage),
        aside=aside,
    )


def _free_name(path: Path) -> Path:
    """An unused name for a file of unreadable bytes."""
    numbered = (path.with_suffix(f".{n}{DAMAGED}") for n in itertools.count(2))
    return path if not path.exists() else next(p for p in numbered if not p.exists())


def _set_aside_whole(part: Path) -> Path:
    aside = _free_name(part.with_name(part.name.removesuffix(PART) + DAMAGED))
    part.rename(aside)
    return aside


def _set_aside(file: FileIO, found: Scan, target: Path) -> Path | None:
    """Copy an incomplete end to another file, unless it holds only zeros."""
    tail = read_at(file, found.size - found.end, found.end)
    if not tail.strip(b"\0"):
        return None
    aside = _free_name(target.with_name(target.name + DAMAGED))
    with FileIO(aside, "xb") as out:
        write_all(out, tail)
        os.fsync(out.fileno())
    return aside


def _rewrite(file: FileIO, found: Scan, target: Path) -> None:
    """Write all readable items into a new file beside the old one, and set ``found.contents`` to its contents."""
    tracks, _ = tracks_of(found.contents.channels)
    temporary = target.with_name(f".{target.name}.new")
    temporary.with_name(temporary.name + PART).unlink(missing_ok=True)  # left by a crash during a rewrite
    out = OpenFile(temporary, found.header or guess_header(found.path, found.contents))
    try:
        encoder = Encoder(out)
        for chunk in found.contents.chunks:
            try:
                items = numbered_items(file, chunk, tracks, tracks)
            except ValueError as error:
                found.damage.append(Damage(found.path, chunk.offset, chunk.length, str(error)))
                items = _sound(file, chunk, tracks)
            for number, item in items:
                encoder.add(item, number if isinstance(item, Result | Event) else None)
            out.write_chunk()
        out.finish()
        out.publish()
        temporary.rename(target)
    finally:
        out.discard()
    found.missing.update(found.contents.by_topic() - out.contents.by_topic())
    found.contents = out.contents


def _sound(file: FileIO, chunk: Chunk, tracks: Mapping[int, Track]) -> list[tuple[int, Item]]:
    """The items, in order, of the channels of a chunk that are fully readable."""
    sound = set[int]()
    for number in tracks:
        with contextlib.suppress(ValueError):
            numbered_items(file, chunk, tracks, {number})
            sound.add(number)
    return numbered_items(file, chunk, tracks, sound) if sound else []
