import json
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp
from mcap.reader import make_reader
from mcap.writer import Writer
from mcap_protobuf.decoder import DecoderFactory

from cellwatt import Alarm, Batch, Channel, Energy, Event, Interval, Prediction, RecordingError, Stream, Task, Tick
from cellwatt.record import Health, Recording, RecordSettings
from cellwatt.record.messages import decode, encode
from cellwatt.record.rows import SampleRows

from .making import (
    ARM,
    HEADER,
    METER,
    PERIOD,
    SESSION,
    batch_of,
    bits,
    frames_of,
    name_of,
    same_entry,
    started,
    stream_of,
    write_chunks,
)

INT64 = st.integers(-(2**63), 2**63 - 1)


@st.composite
def batches(draw):
    """Any bits a batch can hold, also those no driver should send."""
    channels = draw(st.integers(0, 5) | st.just(200))
    n = draw(st.integers(1, 7))
    arrays = {
        "time": draw(hnp.arrays(np.int64, n, elements=INT64)),
        "bound": draw(hnp.arrays(np.int64, n, elements=INT64)),
        "quality": draw(hnp.arrays(np.uint8, n)),
        "device_time": draw(st.none() | hnp.arrays(np.int64, n, elements=INT64)),
    }
    patterns = draw(hnp.arrays(np.uint64, (n, min(channels, 5)), elements=st.integers(0, 2**64 - 1)))
    values = np.resize(patterns.view(np.float64), (n, channels))
    source = draw(st.sampled_from(["arm", "supply"]))
    stream = stream_of(channels, f"stream_{channels}")
    return Batch(source, stream, draw(st.integers(0, 2**40)), draw(INT64), values=values, **arrays)


def numbered(chunks):
    """The same with sequence numbers that rise within a file and span less than 2**32, as the recorder's do."""
    following: dict[str, int] = {}

    def continued(item):
        if isinstance(item, Tick):
            return item
        topic = f"{item.source}/{item.stream.name}"
        first = following.get(topic, item.sequence)
        following[topic] = first + len(item)
        return replace(item, sequence=first)

    return [[continued(item) for item in chunk] for chunk in chunks]


@settings(deadline=None, max_examples=40)
@given(
    chunks=st.lists(
        st.lists(batches() | st.builds(Tick, st.integers(0, 2**63 - 1)), min_size=1, max_size=6), max_size=4
    )
)
def test_everything_comes_back_in_order_in_blocks_and_to_the_bit(chunks, tmp_path_factory):
    chunks = numbered(chunks)
    folder = tmp_path_factory.mktemp("rec")
    write_chunks(folder, chunks)
    recording = Recording.open(folder)
    back, expected = list(recording.entries()), [item for chunk in chunks for item in chunk]
    assert len(back) == len(expected)
    assert all(map(same_entry, back, expected))
    assert not recording.damage


def test_sequence_numbers_pass_32_bits(tmp_path):
    first = 2**32 - 3
    sent = [batch_of(first, 2), batch_of(first + 2, 4), batch_of(first + 6, 1)]
    write_chunks(tmp_path, [sent])
    recording = Recording.open(tmp_path)
    assert [b.sequence for b in recording.entries()] == [2**32 - 3, 2**32 - 1, 2**32 + 3]
    assert recording.batches("arm", "rtde").sequence.tolist() == list(range(first, first + 7))


GROUPS, SPREAD = {"brakes": 65.0, "unexplained": 0.25}, {"brakes": 0.25, "unexplained": 0.5}
ENERGY = Energy("arm", "task_1", "speed=0.60", 4, SESSION, SESSION + 9, 65.25, GROUPS, 0.5, 9.0, 14.0)
ENERGY = replace(ENERGY, group_uncertainty=SPREAD)
RESULTS = [
    Interval("arm", 1, SESSION, SESSION + 5, (1, 3), (0.5, -0.25), (0.0, 1.0), (0.1, 0.2), False, False),
    Task("arm", "task_1", "ab12", "speed=0.60", 0.6, SESSION, SESSION + 9, (1, 2, 3), 4),
    ENERGY,
    Prediction("power", 7, (SESSION, SESSION + 20), {"power": (1.5, float("inf"))}, {"power": "W"}),
    Alarm("a1", "joint_fault", "error", True, SESSION, SESSION + 1, "elbow", "arm", 3, (2,), 9, {"power_W": 12.5}),
]


def test_results_events_and_health_come_back(tmp_path):
    event = Event(SESSION, "arm", "connected", "UR10e", {"serial": "2019", "rate_Hz": 500.0})
    health = Health(SESSION + 2, {"sources": {"arm": {"state": "ok"}}})
    write_chunks(tmp_path, [[*RESULTS, event, health]])
    recording = Recording.open(tmp_path)
    assert list(recording.results()) == RESULTS
    assert list(recording.events()) == [event]
    assert list(recording.health()) == [health]
    assert list(recording.entries()) == []


def test_an_energy_recorded_before_groups_had_uncertainties_is_read():
    body = json.loads(encode(ENERGY))
    del body["group_uncertainty"]
    assert decode(Energy, json.dumps(body).encode()) == replace(ENERGY, group_uncertainty={})


def test_numbers_that_json_lacks_stay_valid_json(tmp_path):
    alarm = replace(RESULTS[-1], evidence={"residual_W": float("nan"), "count": np.int64(3), "axes": np.arange(2)})
    write_chunks(tmp_path, [[alarm]])
    with (tmp_path / name_of()).open("rb") as file:
        ((_, _, message),) = make_reader(file).iter_messages("/alarm")

    def refuse(text):
        raise AssertionError(f"{text} is not JSON")

    evidence = json.loads(message.data, parse_constant=refuse)["evidence"]
    assert evidence == {"residual_W": "NaN", "count": 3, "axes": [0, 1]}


def test_the_mcap_library_reads_every_value(tmp_path):
    sent = [batch_of(0, 3), batch_of(3, 1)]
    frame = frames_of(0, 2)
    write_chunks(tmp_path, [[sent[0], Tick(SESSION)], [frame, sent[1], RESULTS[0]]])
    with (tmp_path / name_of()).open("rb") as file:
        reader = make_reader(file, validate_crcs=True, decoder_factories=[DecoderFactory()])
        raw = list(reader.iter_decoded_messages("/raw/arm/rtde", log_time_order=False))
        frames = list(reader.iter_decoded_messages("/frame", log_time_order=False))
        ticks = list(reader.iter_messages("/tick"))
        statistics = reader.get_summary().statistics
        (attached, *_) = reader.iter_attachments()
    assert statistics.message_count == 4 + 1 + 2 + 1
    assert json.loads(attached.data)["cell"] == "weld-3"
    samples = [(b, i) for b in sent for i in range(len(b))]
    assert len(raw) == len(samples)
    for (_, channel, message, decoded), (batch, i) in zip(raw, samples, strict=True):
        assert message.sequence == batch.sequence + i
        assert message.log_time == batch.time[i]
        assert message.publish_time == batch.arrival
        assert decoded.device_time == batch.device_time[i]
        assert decoded.bound == batch.bound[i]
        assert decoded.quality == batch.quality[i]
        assert [getattr(decoded, f"joint_{j}_position") for j in range(1, 7)] == batch.values[i].tolist()
        fields = json.loads(channel.metadata["fields"])
        assert fields["joint_6_position"] == {"channel": "joint_6.position", "unit": "rad"}
    for i, (_, _, message, decoded) in enumerate(frames):
        assert message.log_time == frame.time[i]
        assert decoded.arm_joint_2_position == frame.values[i, 1]
        assert list(decoded.quality) == frame.quality[i].tolist()
        assert list(decoded.bound) == frame.bound[i].tolist()
    assert json.loads(ticks[0][2].data) == {"time": SESSION}


async def test_the_header_and_declarations_come_back(tmp_path):
    kinds = (Channel("tool.closed", "1", "discrete"), Channel("energy", "J", "counter", "linear"))
    supply = Stream("hmc8015", (Channel("supply.power", "W"), *kinds), 10.0, "host")
    header = replace(HEADER, streams={"arm": (ARM,), "supply": (supply,)})
    async with started(RecordSettings(folder=tmp_path), header) as recorder:
        assert recorder.put(batch_of(0, 2))
        assert recorder.put(batch_of(0, 2, stream=supply, source="supply", device=False))
    recording = Recording.open(tmp_path)
    assert recording.header == replace(header, number=1)
    assert recording.streams == {"arm": (ARM,), "supply": (supply,)}
    assert (recording.start, recording.end) == (SESSION, SESSION + 2_000_000)


def test_a_file_sorted_and_rechunked_by_other_tools_is_still_read(tmp_path):
    items = [batch_of(0, 20), batch_of(0, 20, stream=METER, source="supply"), frames_of(0, 4), RESULTS[0]]
    write_chunks(tmp_path, [items])
    path, other = tmp_path / name_of(), tmp_path / "sorted.mcap"
    with path.open("rb") as old, other.open("wb") as new:
        reader, writer, known = make_reader(old), Writer(new, chunk_size=500), {}
        writer.start()
        for schema, channel, message in reader.iter_messages():
            if channel.id not in known:
                number = writer.register_schema(schema.name, schema.encoding, schema.data)
                declared = (channel.topic, channel.message_encoding, number, channel.metadata)
                known[channel.id] = writer.register_channel(*declared)
            times = {"log_time": message.log_time, "publish_time": message.publish_time}
            writer.add_message(known[channel.id], data=message.data, sequence=message.sequence, **times)
        writer.finish()
    before, after = Recording.open(path), Recording.open(other)
    assert [len(b) for b in after.entries()] == [1] * 40
    for source, stream in (("arm", "rtde"), ("supply", "meter")):
        for name in ("sequence", "arrival", "time", "bound", "values", "quality", "device_time"):
            one, two = (getattr(r.batches(source, stream), name) for r in (before, after))
            assert bits(one) == bits(two), name
    assert bits(after.frames_table().values) == bits(before.frames_table().values)
    assert list(after.results()) == RESULTS[:1]
    assert not after.damage


def test_a_block_of_which_another_tool_left_samples_out_ends_there():
    """What follows is of other blocks, that arrived at other times, though all of it looks alike."""
    rows = SampleRows("arm", ARM)
    first, second = (rows.encode(batch, 3) for batch in (batch_of(0, 3), batch_of(3, 2)))
    data = np.concatenate([np.delete(first, 1), second]).tobytes()
    found, at = [], 0
    while at < len(data):
        batch, at = rows.decode(data, at, first.itemsize - 9, len(found))
        found.append(batch)
    assert [len(batch) for batch in found] == [1, 1, 2]
    assert [int(batch.time[0]) for batch in found] == [SESSION + n * PERIOD for n in (0, 2, 3)]


def test_what_cannot_be_opened_is_said_in_one_line(tmp_path):
    with pytest.raises(RecordingError, match="No such file"):
        Recording.open(tmp_path / "absent.mcap")
