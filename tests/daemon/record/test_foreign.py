"""MCAP files of other writers, and recordings of cellwatt without samples: told apart, named with what they hold."""

import io
import json
import struct
import tempfile
import tracemalloc

import pytest
from click.testing import CliRunner
from mcap.writer import CompressionType, Writer

from cellwatt.commands import export, plot, replay
from cellwatt.errors import RecordingError
from cellwatt.record import Recording
from cellwatt.record.foreign import records
from cellwatt.record.messages import Health
from tests.daemon.record.making import SESSION, write_chunks

TOPIC = "/frame"


def written(path, *, profile="ros2", encoding="cdr", schema=("geometry_msgs/msg/Pose", "ros2msg"), **settings):
    with path.open("wb") as file:
        writer = Writer(file, **settings)
        writer.start(profile=profile, library="another")
        number = writer.register_schema(*schema, b"float64 x\n")
        channel = writer.register_channel(TOPIC, encoding, number)
        for i in range(100):
            data = json.dumps({"q": i}).encode()
            writer.add_message(channel, log_time=10**18 + i, publish_time=10**18 + i, data=data)
        writer.finish()
    return path


@pytest.mark.parametrize(
    "settings",
    [{}, {"use_chunking": False}, {"compression": CompressionType.LZ4}, {"use_summary_offsets": False}],
    ids=["indexed", "fastwrite", "lz4", "plain"],
)
def test_a_file_of_another_writer_is_refused_with_what_it_holds(tmp_path, settings):
    path = written(tmp_path / "a.mcap", **settings)
    expected = r"a\.mcap: not a recording of cellwatt: it has /frame \(ros2, cdr\) of geometry_msgs/msg/Pose"
    with pytest.raises(RecordingError, match=expected):
        Recording.open(path)


@pytest.mark.parametrize("kind", [CompressionType.ZSTD, CompressionType.LZ4])
def test_a_chunk_that_unpacks_to_more_than_it_claims_is_damage(kind):
    made, size = io.BytesIO(), 64 << 20
    writer = Writer(made, compression=kind)
    writer.start()
    writer.add_message(writer.register_channel(TOPIC, "json", 0), log_time=1, publish_time=1, data=bytes(size))
    writer.finish()
    claimed = made.getvalue().replace(struct.pack("<QQQ", 1, 1, size + 66), struct.pack("<QQQ", 1, 1, 1000))
    tracemalloc.start()
    try:
        with tempfile.TemporaryFile() as file, pytest.raises(ValueError, match="more than the 1,000 bytes"):
            file.write(claimed)
            list(records(file))
        assert tracemalloc.get_traced_memory()[1] < 16 << 20
    finally:
        tracemalloc.stop()


def test_one_that_was_cut_off_is_named_too(tmp_path):
    path = written(tmp_path / "a.mcap", use_chunking=False, profile="", encoding="json", schema=("frame", "jsonschema"))
    path.write_bytes(path.read_bytes()[:2000])
    with pytest.raises(RecordingError, match=r"it has /frame \(jsonschema, json\) of frame$"):
        Recording.open(path)


@pytest.mark.parametrize("command", [(plot, ["--out", "o"]), (replay, []), (export, ["--json", "--out", "o"])])
def test_commands_agree_and_none_ends_with_success(tmp_path, monkeypatch, command):
    monkeypatch.chdir(tmp_path)
    run, options = command
    foreign = CliRunner().invoke(run.command, [*options, str(written(tmp_path / "a.mcap"))])
    assert isinstance(foreign.exception, RecordingError)
    assert "not a recording of cellwatt: it has /frame" in str(foreign.exception)
    (tmp_path / "own").mkdir()
    write_chunks(tmp_path / "own", [[Health(SESSION, {"cpu": 1})]])
    own = CliRunner().invoke(run.command, [*options, str(tmp_path / "own")])
    assert isinstance(own.exception, RecordingError)
    assert "neither frames nor samples in this recording; it has /health (1)" in str(own.exception)
