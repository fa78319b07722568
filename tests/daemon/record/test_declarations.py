"""Headers and declarations whose checksums are right and that are no use all the same: found by ``python -m fuzz``."""

import json
import struct
import zlib
from dataclasses import asdict
from io import FileIO

import pytest
from mcap.records import Channel, Schema

from cellwatt.record import Recording
from cellwatt.record.chunks import parse_attachment, read_at
from cellwatt.record.decoder import track_of, tracks_of
from cellwatt.record.encoder import Encoder
from cellwatt.record.header import Header
from cellwatt.record.openfile import OpenFile

from .making import ARM, CELL, HEADER, SESSION, batch_of, name_of

DECLARED = asdict(ARM)
DEEP = "[" * 100_000
GOOD = json.loads(HEADER.to_json())


@pytest.mark.parametrize(
    "text",
    [
        "[]",
        DEEP,
        json.dumps(GOOD | {"streams": {"arm": [5]}}),
        json.dumps(GOOD | {"session": 1 << 63}),
        json.dumps(GOOD | {"cell": {}}),
    ],
)
def test_a_header_that_is_none(text):
    with pytest.raises(ValueError, match="this version cannot read the header") as error:
        Header.from_json(text.encode())
    assert "\n" not in str(error.value)


@pytest.mark.parametrize(
    ("declaration", "first"),
    [
        (json.dumps(DECLARED), "soon"),
        (json.dumps(DECLARED), str(1 << 64)),
        (DEEP, "0"),
        (json.dumps(DECLARED | {"channels": {}}), "0"),
        (json.dumps(DECLARED | {"channels": DECLARED["channels"] * 400}), "0"),
    ],
)
def test_a_declaration_that_is_none(declaration, first):
    channel = Channel(1, "/raw/arm/rtde", "protobuf", {"source": "arm", "declaration": declaration, "first": first}, 1)
    with pytest.raises(ValueError, match="/raw/arm/rtde has a declaration that this version does not know"):
        track_of(channel)
    assert tracks_of({1: channel})[0] == {}


def test_a_damaged_declaration_costs_its_channel_alone(tmp_path):
    file = OpenFile(tmp_path / name_of(), Header("s", CELL, SESSION, number=1))
    Encoder(file).add(batch_of(0, 3))
    schema = Schema(0, b"", "protobuf", "x")
    number = file.define("/raw/arm/other", "protobuf", schema, {"source": "arm", "declaration": "{", "first": "0"})
    file.add_message(number, 0, SESSION, b"")
    file.finish()
    file.publish()
    recording = Recording.open(tmp_path)
    assert len(recording.batches("arm", "rtde")) == 3
    assert [str(d).split(" has a declaration")[0] for d in recording.damage] == [f"{name_of()}: /raw/arm/other"]


def test_a_length_beyond_all_memory_is_damage():
    """An attachment of 2⁶⁴ - 1 bytes, its checksum right."""
    body = struct.pack("<QQII", 0, 0, 0, 0) + b"\xff" * 8
    with pytest.raises(ValueError, match=r"an? attachment record is damaged"):
        parse_attachment(body + struct.pack("<I", zlib.crc32(body)))


def test_places_that_no_file_has_are_empty(tmp_path):
    path = tmp_path / "file"
    path.write_bytes(b"abc")
    with FileIO(path, "rb") as file:
        assert read_at(file, 1 << 62, 1) == b"bc"
        assert read_at(file, 4, 1 << 63) == b""
