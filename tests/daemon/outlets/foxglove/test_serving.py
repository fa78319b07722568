"""A live cell in the eyes of a client that speaks the Foxglove protocol, beside the same cell's recording."""

from __future__ import annotations

import asyncio
import base64
import json
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from mcap.reader import make_reader
from mcap_protobuf.decoder import DecoderFactory

from cellwatt import Frames
from cellwatt.errors import ConfigError
from cellwatt.frames import cut
from cellwatt.outlets.foxglove import serve
from cellwatt.outlets.zenoh.link import LinkSettings
from cellwatt.record import Health
from tests.blocks import frames_of, layout_of
from tests.daemon.outlets.foxglove.cell import HEALTH, LOGGED, TOLD, UNITS, frames
from tests.daemon.outlets.foxglove.client import Client
from tests.daemon.outlets.foxglove.paths import found
from tests.daemon.outlets.foxglove.shown import shown
from tests.daemon.outlets.foxglove.test_layout import PACKAGED
from tests.daemon.outlets.page.recorded import recording as written
from tests.daemon.outlets.zenoh.fake_cell import CELL, EPOCH, SITE
from tests.patience import eventually

DRAWN = {"/log"}


@dataclass
class Seen:
    """Blocks of frames that were told, what a client from the start was told, a later one, and how the server ended."""

    blocks: list[Frames]
    first: Client
    later: Client
    ended: tuple[int, list[str], str]

    @property
    def frames(self) -> Frames:
        """The frames that were told after the client had subscribed."""
        heard = self.first.told["/frame"][0].time
        whole = frames(0, sum(map(len, self.blocks)))
        return cut(whole, int(np.searchsorted(whole.time, heard)), len(whole))


def complete(client: Client, last: int) -> bool:
    counts = {topic: len(told) for topic, told in client.told.items()}
    results = all(counts.get(f"/{kind}") for kind in ("interval", "task", "energy", "prediction"))
    lines = counts.get("/event") == 2 and counts.get("/alarm") == 5 and counts.get("/log") == len(LOGGED)
    return bool(results and lines and client.told["/frame"] and client.told["/frame"][-1].time == last)


async def observe() -> Seen:
    async with shown(frames) as cell:
        blocks = [frames(i, 1) for i in range(cell.begun)]
        async with Client(cell.port) as first:
            await eventually(lambda: first.told["/health"], "health")
            blocks += (frames(cell.begun, 7), frames(cell.begun + 7, 5))
            for block in blocks[-2:]:
                cell.outlet.offer(block)
            for item in TOLD:
                cell.outlet.offer(item)
            cell.outlet.health(HEALTH)
            amber = lambda: any(m["status"] == HEALTH for m in first.decoded("/health"))  # noqa: E731
            last = int(blocks[-1].time[-1])
            await eventually(lambda: complete(first, last) and amber(), "all of it")
        async with Client(cell.port) as later:
            await eventually(lambda: len(later.told["/log"]) == 2, "what still holds")
            await eventually(lambda: len(later.told["/alarm"]) == 2, "the alarms that are up")
        ended = await cell.end()
    return Seen(blocks, first, later, ended)


@pytest.fixture(scope="module")
def seen() -> Seen:
    return asyncio.run(observe())


@pytest.fixture(scope="module")
def recording(seen: Seen, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The same cell's recording."""
    items = [*seen.blocks, *TOLD, Health(EPOCH + 9000, HEALTH)]
    return written(tmp_path_factory.mktemp("recording"), [items], session=EPOCH, cell=CELL)


def read(file: Path) -> Iterator[tuple[Any, Any, Any, Any]]:
    """Schema, channel, message and decoded message of a file, in the order of their times."""
    of_json: Any = SimpleNamespace(decoder_for=lambda encoding, _: json.loads if encoding == "json" else None)
    with file.open("rb") as opened:
        yield from make_reader(opened, decoder_factories=[DecoderFactory(), of_json]).iter_decoded_messages()


def test_frames_arrive_as_they_were_published(seen: Seen) -> None:
    sent = seen.frames
    told = seen.first.decoded("/frame")
    names = [name.replace(".", "_") for name in UNITS]
    assert [m.time for m in seen.first.told["/frame"]] == sent.time.tolist()
    np.testing.assert_array_equal([[getattr(m, name) for name in names] for m in told], sent.values)
    assert [list(m.quality) for m in told] == sent.quality.tolist()
    assert [list(m.bound) for m in told] == sent.bound.tolist()


def test_the_log_tells_alarms_that_are_new_or_over_and_events(seen: Seen) -> None:
    lines = [(m.level, m.message, m.name) for m in seen.first.decoded("/log")]
    # In the order of their topic; an alarm that only has other figures is no new line.
    assert [line for line in lines if line[2] == "arm"] == LOGGED[:4]
    assert [line for line in lines if line[2] != "arm"] == LOGGED[4:]
    assert seen.first.channels["/log"]["schemaName"] == "foxglove.Log"
    stamps = [m.timestamp.seconds * 10**9 + m.timestamp.nanos for m in seen.first.decoded("/log")]
    assert stamps == [m.time for m in seen.first.told["/log"]]


def test_who_comes_later_is_told_what_still_holds(seen: Seen) -> None:
    assert {m.message for m in seen.later.decoded("/log")} == {"Joint 1 needs more power.", "Joint 3 needs more power."}
    standing = {m["id"]: m["evidence"]["residual_W"] for m in seen.later.decoded("/alarm")}
    assert standing == {"a.1": 13.0, "a.3": 12.5}
    assert not seen.later.told["/event"]


def test_the_clock_is_the_cells_and_never_goes_back(seen: Seen) -> None:
    assert seen.first.info["capabilities"] == ["time"]
    assert seen.first.times == sorted(set(seen.first.times))
    assert seen.first.times


def test_it_ends_cleanly_and_says_what_it_sent(seen: Seen) -> None:
    code, lines, errors = seen.ended
    assert (code, lines[-1], errors) == (0, "ended", "")
    assert lines[-2].startswith("Foxglove: ")
    assert "messages sent on" in lines[-2]
    assert "slow" not in lines[-2]


def test_topics_schemas_and_bytes_are_those_of_the_recording(seen: Seen, recording: Path) -> None:
    live = seen.first
    recorded: dict[str, list[bytes]] = {}
    for schema, channel, message, _ in read(recording):
        advertised = live.channels[channel.topic]
        assert (advertised["encoding"], advertised["schemaName"]) == (channel.message_encoding, schema.name)
        assert advertised["schemaEncoding"] == schema.encoding
        if channel.message_encoding == "protobuf":
            assert base64.b64decode(advertised["schema"]) == schema.data
        else:
            assert json.loads(advertised["schema"])["properties"].keys() == json.loads(schema.data)["properties"].keys()
        recorded.setdefault(channel.topic, []).append(message.data)
    assert recorded.keys() == live.channels.keys() - DRAWN
    for topic in recorded.keys() - {"/health"}:
        told = [m.data for m in live.told[topic]]
        assert told == recorded[topic][-len(told) :], topic
        assert topic == "/frame" or len(told) == len(recorded[topic])


def test_the_app_can_read_every_schema(seen: Seen) -> None:
    """It reads neither ``anyOf`` nor a field without a type."""
    for channel in seen.first.channels.values():
        if channel["encoding"] == "json":
            schema = json.loads(channel["schema"])
            assert schema["type"] == "object"
            for name, about in schema["properties"].items():
                kinds = {"string", "number", "integer", "boolean", "object", "array"}
                assert about["type"] in kinds, f"{channel['topic']}.{name}"
                assert about["type"] != "array" or about["items"]["type"] in kinds


def panels(kind: str = "") -> dict[str, dict[str, Any]]:
    layout = json.loads(PACKAGED.read_text())
    return {name: config for name, config in layout["configById"].items() if name.startswith(kind)}


def paths() -> list[str]:
    series = [path["value"] for config in panels().values() for path in config.get("paths", ())]
    return series + [config["topicPath"] for config in panels().values() if "topicPath" in config]


def test_every_path_of_the_packaged_layout_leads_to_values_live_and_recorded(seen: Seen, recording: Path) -> None:
    live = {topic: seen.first.decoded(topic) for topic in seen.first.told}
    recorded: dict[str, list[Any]] = {}
    for _, channel, _, decoded in read(recording):
        recorded.setdefault(channel.topic, []).append(decoded)
    assert len(paths()) > 15
    for path in paths():
        at_rest = found(recorded, path)
        assert at_rest, path
        moving = found(live, path)
        assert moving, path
        if not path.startswith("/health"):
            known = [value for value in moving if value == value]
            assert known == [value for value in at_rest if value == value][-len(known) :], path
    assert found(live, '/prediction{model=="power"}.outputs.power[-1]') == [302.5]
    assert "amber" in found(live, "/health.status.state")
    assert panels("RosOut")["RosOut!log"]["topicToRender"] in live


async def test_other_channels_start_the_server_anew_where_it_was() -> None:
    async with shown() as cell:  # without frames it serves all the same, after a while
        async with Client(cell.port) as client:
            await eventually(lambda: client.told["/health"], "health")
            assert "/frame" not in client.channels
            cell.outlet.offer(frames(0, 1))
            await eventually(lambda: client.ended, "the end of the connection")
        async with Client(cell.port) as client:  # it may join before the frame that made the server start anew is told
            await eventually(lambda: client.told["/health"], "health")
            cell.outlet.offer(frames(1, 1))
            sent = frames(1, 1).time[0]
            await eventually(lambda: sent in [told.time for told in client.told["/frame"]], "a frame")
            cell.outlet.offer(wide(2, 1))
            await eventually(lambda: client.ended, "the end of the connection")
        async with Client(cell.port) as client:
            await eventually(lambda: "/frame" in client.channels, "the other channels")
            assert b"arm_c_199" in base64.b64decode(client.channels["/frame"]["schema"])
        assert (await cell.end())[0] == 0


def wide(first: int, count: int) -> Frames:
    layout = layout_of({f"arm.c_{i}": "W" for i in range(200)}, 1000.0)
    numbers = np.arange(first, first + count)
    return frames_of(layout, first, EPOCH + numbers * layout.step, numbers[:, None] + np.zeros(200))


def test_it_stays_on_this_pc() -> None:
    link = LinkSettings(mode="client", connect=("tcp/127.0.0.1:1",))
    for host in ("0.0.0.0", "::", "192.0.2.7", "plant-pc"):
        with pytest.raises(ConfigError, match=f"not opened on {host}; .* ssh -L 8765:127.0.0.1:8765") as told:
            serve(link, SITE, CELL, host=host)
        assert "\n" not in str(told.value)


@pytest.mark.slow
async def test_a_port_that_is_taken_is_one_line() -> None:
    async with shown() as cell:
        with pytest.raises(AssertionError, match=f"^Foxglove cannot listen on 127.0.0.1:{cell.port}: [^\n]*\n$"):
            async with shown(port=cell.port):
                pass
