"""A source from its first try to its end: states, pauses between tries, events, numbers of samples."""

from __future__ import annotations

import asyncio
from contextlib import asynccontextmanager

import numpy as np
import pytest

from cellwatt import Batch, ConnectError, Event, ProtocolError, Quality, Reading, WrongDeviceError
from cellwatt.runtime.source import Source, next_pause
from tests.daemon.runtime.at_once import at_once
from tests.daemon.runtime.fakes import (
    DEVICES,
    STREAM,
    FakeDriver,
    FakeSettings,
    answer,
    fail,
    give,
    last,
    until,
)

NOBODY = ConnectError("no device answers at 192.0.2.1:30004")


class Cellar:
    """What a source gives its cell."""

    def __init__(self, sequence=None):
        self.batches: list[Batch] = []
        self.events: list[Event] = []
        self.source = Source(
            "arm",
            FakeDriver,
            FakeSettings(host="arm"),
            lambda: 1_000_000_000,
            self.batches.append,
            self.events.append,
            sequence,
        )

    @property
    def told(self):
        return [event.kind for event in self.events]


@asynccontextmanager
async def running(*orders, sequence=None):
    """A source that runs until the end of the context; its device does what it is told."""
    DEVICES["arm"].tell(*orders)
    cellar = Cellar(sequence)
    task = asyncio.create_task(cellar.source.run())
    try:
        yield cellar
    finally:
        task.cancel()
        await asyncio.wait([task])
        assert task.cancelled(), "a source ends only as it was cancelled"
        assert DEVICES["arm"].open == 0, "the device was let go"


async def tries(n):
    await until(lambda: len(DEVICES["arm"].runs) >= n)
    return np.diff(DEVICES["arm"].runs[:n]).tolist()


@at_once
async def test_a_source_starts():
    async with running(answer, give(3)) as cellar:
        assert cellar.source.status()["state"] == "starting"
        await DEVICES["arm"].done()
        status = cellar.source.status()
        assert (status["state"], status["error"]) == ("ok", None)
        assert status["identity"]["model"] == "Model"
        assert cellar.told == ["connected"]
        assert cellar.events[0].text == "arm: Maker Model 2.3 answers"
        assert [b.sequence for b in cellar.batches] == [0, 1, 2]
        assert status["last_sequence"] == {"supply": 2}


@at_once
async def test_a_source_is_well_with_its_first_number():
    async with running(answer, give(1), fail(NOBODY), answer) as cellar:
        source = cellar.source
        await DEVICES["arm"].done()
        assert source.status()["state"] == "starting", "it answers again, and has given no number since"
        assert source.status()["streams"]["supply"]["blank"] == ["bus.voltage", "bus.current"]
        source.emit(Reading(STREAM, np.full((1, 2), np.nan), 1))
        assert source.status()["state"] == "starting"
        source.emit(Reading(STREAM, np.array([[np.inf, 1.0], [np.nan, -np.inf]]), 2))
        assert source.status()["state"] == "ok"
        assert [b.quality.tolist() for b in cellar.batches[-2:]] == [[Quality.MISSING], [Quality.GOOD, Quality.MISSING]]
        assert not np.isinf(cellar.batches[-1].values).any(), "an infinite number is none"
        assert source.account.counters["infinite values"] == 2 and "infinite values" in source.account.anomalies
        assert source.status()["streams"]["supply"]["blank"] == ["bus.voltage"]
        source.emit(Reading(STREAM, np.array([[230.0, np.nan]]), 3))
        assert source.status()["streams"]["supply"]["blank"] == []
        source.account.expect(4)


@at_once
async def test_a_channel_that_gives_no_number_any_more_is_named(monkeypatch):
    monkeypatch.setattr("cellwatt.runtime.source.BLANK", 0.0)
    async with running(answer, give(1)) as cellar:
        source = cellar.source
        await DEVICES["arm"].done()

        def looked_at(voltage):
            for _ in range(5):
                source.emit(Reading(STREAM, np.array([[voltage, 1.0]]), 1))
                source.account.expect(1)
            return source.status()["streams"]["supply"]["blank"]

        assert looked_at(230.0) == []
        assert looked_at(np.nan) == ["bus.voltage"]
        source.emit(Reading(STREAM, np.array([[230.0, 1.0]]), 3))
        source.account.expect(1)
        assert source.status()["streams"]["supply"]["blank"] == []


@at_once
async def test_nobody_answers(no_jitter):
    async with running(*[fail(NOBODY)] * 7) as cellar:
        assert await tries(8) == pytest.approx([0.5, 1, 2, 4, 8, 10, 10])
        status = cellar.source.status()
        assert (status["state"], status["error"]) == ("retrying", str(NOBODY))
        assert status["counters"]["restarts"] == 7
        assert cellar.told == ["lost"], "the same reason is told once"
        assert cellar.events[0].text == f"arm: {NOBODY}; trying again in 0.5 s"


@pytest.mark.parametrize("error", [NOBODY, WrongDeviceError("another arm"), KeyError("mistake")])
def test_no_pause_is_longer_than_a_fifth_above_the_longest(error):
    pause = 0.25
    for jitter in np.random.default_rng(0).random(200):
        pause = next_pause(pause, error, jitter)
        assert 0.4 <= pause <= 12.0


@at_once
async def test_a_wrong_device_is_tried_slowly_from_the_start(no_jitter):
    wrong = WrongDeviceError("192.0.2.1 is a UR5e\x1b[2J,\nthe settings say UR10e")
    async with running(fail(wrong), fail(wrong)) as cellar:
        assert await tries(3) == pytest.approx([10, 10])
        assert cellar.source.status()["error"] == "192.0.2.1 is a UR5e [2J, the settings say UR10e", "one line"


@at_once
async def test_a_connection_that_lasted_resets_the_pause(no_jitter):
    async with running(*[fail(NOBODY)] * 5, answer, last(6.0), fail(NOBODY)):
        pauses = await tries(7)
        assert pauses[4:] == pytest.approx([8.0, 6.0 + 0.5])


@at_once
async def test_a_connection_that_is_lost_at_once_does_not(no_jitter):
    flap = (answer, last(4.0), fail(NOBODY))
    async with running(*flap, *flap, *flap):
        assert await tries(4) == pytest.approx([4.5, 5, 6])


@at_once
async def test_a_failure_in_mid_stream_breaks_no_numbers():
    garbage = ProtocolError("a frame of 7 bytes, expected 9")
    async with running(answer, give(3), fail(garbage), answer, give(2)) as cellar:
        await DEVICES["arm"].done()
        assert cellar.told == ["connected", "lost", "reconnected"]
        assert [b.sequence for b in cellar.batches] == [0, 1, 2, 3, 4]
        assert [b.values[0, 0] for b in cellar.batches] == [0, 1, 2, 3, 4]
        status = cellar.source.status()
        assert (status["state"], status["error"]) == ("ok", None)
        assert (status["expected"], status["received"], status["residue"]) == (5, 5, 0)


@pytest.mark.parametrize("error", [KeyError("joint_7"), asyncio.CancelledError()])
@at_once
async def test_a_driver_with_a_mistake_or_cancelled_by_its_own_library_is_run_again(caplog, error):
    async with running(answer, fail(error), answer) as cellar:
        await DEVICES["arm"].done()
        assert cellar.told == ["connected", "lost", "reconnected"]
        assert cellar.source.status()["counters"]["driver bugs"] == 1
    assert "arm: the FakeDriver driver failed" in caplog.text
    assert "Traceback" in caplog.text


@at_once
async def test_a_driver_that_ends_is_run_again(monkeypatch):
    async def ends(self):
        DEVICES["arm"].runs.append(asyncio.get_running_loop().time())

    monkeypatch.setattr(FakeDriver, "run", ends)
    async with running() as cellar:
        await tries(3)
        assert "the driver ended without being stopped" in cellar.source.status()["error"]


def test_samples_without_a_number_are_marked_missing():
    cellar = Cellar()
    nan = np.nan
    values = np.array([[1.0, 2.0], [nan, 2.0], [nan, nan]])
    cellar.source.emit(Reading(STREAM, values, 10**9, asked=9 * 10**8))
    assert cellar.batches[0].quality.tolist() == [Quality.GOOD, Quality.GOOD, Quality.MISSING]
    clipped = np.full(3, Quality.CLIPPED, np.uint8)
    cellar.source.emit(Reading(STREAM, values, 2 * 10**9, quality=clipped))
    assert cellar.batches[1].quality.tolist() == [Quality.CLIPPED] * 3, "what the driver says of them stays"
