"""A folder read while its cell writes: files grow, are closed, repaired and removed at every step of the reader."""

import itertools
from collections.abc import Callable
from pathlib import Path

import pytest

from cellwatt.record import Header, Recording, reader, recover, survey
from cellwatt.record.encoder import Encoder
from cellwatt.record.header import PART
from cellwatt.record.openfile import OpenFile
from cellwatt.report import Provenance
from tests.daemon.record.making import CELL, SESSION, batch_of, name_of, write_chunks

CHUNK = 50
"""Samples of a chunk; a closed file has 100, the open one 150 at first."""


class Writer:
    """A cell's writer: two closed files, a third one open."""

    def __init__(self, folder: Path) -> None:
        folder.mkdir()
        self.folder, self.written = folder, 200
        for number in (1, 2):
            first = 100 * (number - 1)
            write_chunks(folder, [[batch_of(first, CHUNK)], [batch_of(first + CHUNK, CHUNK)]], number=number)
        self._begin(3)
        for _ in range(3):
            self.grow()

    def _begin(self, number: int) -> None:
        self.number = number
        self.file = OpenFile(self.folder / name_of(number), Header("plant-1", CELL, SESSION, number=number))
        self._encoder = Encoder(self.file)

    def grow(self) -> None:
        self._encoder.add(batch_of(self.written, CHUNK))
        self.file.write_chunk()
        self.written += CHUNK

    def close(self) -> None:
        self.file.finish()
        self.file.publish()

    def rotate(self) -> None:
        self.grow()
        self.close()
        self._begin(self.number + 1)
        self.grow()

    def write_in_part(self) -> None:
        """Half of a chunk's bytes have reached the file."""
        with self.file.part.open("ab") as file:
            file.write(b"\x06" + (500).to_bytes(8, "little") + b"half of a chunk")

    def remove_oldest(self) -> None:
        (self.folder / name_of(1)).unlink(missing_ok=True)

    def crash_and_repair(self) -> None:
        """The writer dies and the next one closes the file in place."""
        self.file.release()
        assert recover(self.file.part) is not None


def at_step(number: int, act: Callable[[], None], monkeypatch: pytest.MonkeyPatch) -> Callable[[], bool]:
    """Let ``act`` happen before the reader's step ``number``: a listing, an open or the read of a chunk.

    Gives a function that is true once it has happened.
    """
    counted, happened = itertools.count(), False

    def stepping(step: Callable) -> Callable:
        def taken(*arguments, **options):
            nonlocal happened
            if next(counted) == number:
                happened = True
                act()
            return step(*arguments, **options)

        return taken

    monkeypatch.setattr(survey, "_listed", stepping(survey._listed))
    monkeypatch.setattr(survey, "open_file", stepping(survey.open_file))
    monkeypatch.setattr(reader, "chunk_data", stepping(reader.chunk_data))
    return lambda: happened


def read_at_every_step(tmp_path: Path, action: str) -> list[tuple[Recording, list[int], list[int], Writer]]:
    """Open, read, read again, with the action before each step in turn: the recording, both reads, and the writer."""
    found = []
    for number in itertools.count():
        writer = Writer(folder := tmp_path / f"{action}-{number}")
        with pytest.MonkeyPatch.context() as patch:
            happened = at_step(number, getattr(writer, action), patch)
            recording = Recording.open(folder)
            reads = [recording.batches("arm", "rtde").sequence.tolist() for _ in range(2)]
        writer.file.release()
        if not happened():
            assert number > 15, "all listings, opens and chunks of three files"
            return found
        found.append((recording, *reads, writer))
    raise AssertionError


@pytest.mark.parametrize("action", ["grow", "close", "rotate", "write_in_part", "crash_and_repair"])
def test_whatever_happens_all_that_was_there_at_the_opening_is_read_twice_the_same(tmp_path, action):
    ends = set()
    for recording, first, second, writer in read_at_every_step(tmp_path, action):
        assert first == second == list(range(len(first))), "whole, in order, once"
        assert 350 <= len(first) <= writer.written and len(first) % CHUNK == 0
        assert recording.damage == []
        ends.add(len(first))
    # What came after the opening is not read; what came before it is.
    assert ends == {"grow": {350, 400}, "rotate": {350, 400, 450}}.get(action, {350})


def test_what_is_removed_meanwhile_is_told_with_its_time_or_the_recording_begins_later(tmp_path):
    told = []
    for recording, first, second, _ in read_at_every_step(tmp_path, "remove_oldest"):
        lost = [str(d) for d in recording.damage]
        whole, rest = list(range(350)), list(range(100, 350))
        assert (first, second) in ((whole, whole), (whole, rest), (rest, rest))
        # Less than all is read silently only where it was gone before the folder was listed.
        assert bool(lost) == (second == rest) or recording.start > SESSION
        told += lost
    span = "2026-11-21 09:59:23.290 UTC to 2026-11-21 09:59:23.488 UTC"
    assert f"{name_of(1)}: was removed before it could be read" in told
    assert f"{name_of(1)}: was removed while the recording was read; its data are missing: {span}" in told


def test_the_newest_file_tells_that_it_is_being_written_and_up_to_when(tmp_path, caplog):
    writer = Writer(tmp_path / "made")
    recording = Recording.open(tmp_path / "made")
    assert recording.unfinished == (writer.file.part,)
    part = f"{name_of(3)}{PART}"
    assert caplog.messages == [
        f"{part}: is still being written, or was left open: read up to 2026-11-21 09:59:23.988 UTC"
    ]
    writer.close()
    caplog.clear()
    assert Recording.open(tmp_path / "made").unfinished == () and not caplog.messages


def test_a_file_that_was_just_begun_is_no_damage(tmp_path):
    writer = Writer(tmp_path / "made")
    writer.close()
    writer._begin(4)
    for content in (writer.file.part.read_bytes(), b""):
        writer.file.part.write_bytes(content)
        recording = Recording.open(tmp_path / "made")
        assert recording.damage == [] and len(recording.batches("arm", "rtde")) == 350
    writer.file.release()


def test_a_pages_origin_of_a_folder_that_is_being_written(tmp_path, monkeypatch):
    """A page tells the digest of each file that it was made from; one may be closed or removed meanwhile."""
    writer = Writer(tmp_path / "made")
    within = Path.rglob

    def closed_after_listing(self, pattern):
        found = list(within(self, pattern))
        writer.close()
        writer.remove_oldest()
        return iter(found)

    monkeypatch.setattr(Path, "rglob", closed_after_listing)
    files = Provenance.here([tmp_path / "made"]).files
    digests = {Path(name).name: digest for name, digest in files.items()}
    assert digests[name_of(1)] == "removed meanwhile"
    assert len(digests[name_of(3) + PART]) == 64
