"""InfluxDB is kept up to date: what is new first, then what it missed; nothing lost, nothing twice."""

from __future__ import annotations

import asyncio
import ssl
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager, nullcontext
from datetime import UTC, datetime
from itertools import chain
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from cellwatt import RecordingError
from cellwatt.outlets.historian import HistorianSettings, InfluxSettings
from cellwatt.outlets.historian.client import REFUSED, judge, reason_of
from cellwatt.outlets.historian.outlet import HistorianOutlet
from cellwatt.outlets.remote import LONGEST_WAIT, NotNowError, RefusedError, wait_of
from tests.daemon.outlets.historian.made import (
    ANOTHER,
    CELL,
    SESSION,
    SITE,
    Recorded,
    S,
    alarm,
    energy,
    frames,
    row_truth,
    task,
)
from tests.daemon.outlets.historian.parsing import parse
from tests.daemon.outlets.historian.server import Fake
from tests.daemon.outlets.zenoh.fake_cell import FakeView
from tests.doing import doing
from tests.patience import eventually


def outlet_of(url: str, record: Path | None, **settings: Any) -> HistorianOutlet:
    influx = InfluxSettings(**{"url": url, "database": "plant", "every": 0.02, **settings})
    return HistorianOutlet("historian", HistorianSettings(influx=influx), FakeView(SESSION, record_folder=record))


@asynccontextmanager
async def running(outlet: HistorianOutlet) -> AsyncIterator[HistorianOutlet]:
    async with doing(outlet.run()) as task:
        yield outlet
        assert not task.done(), task


class Cell:
    """Frames that are recorded, and then offered to an outlet."""

    def __init__(self, record: Path) -> None:
        self.recorded = Recorded(record)

    async def seconds(self, count: int, *outlets: HistorianOutlet, results: bool = True) -> None:
        first = self.recorded.second
        await asyncio.to_thread(self.recorded.seconds, count, results)
        for second in range(first, first + count):
            for outlet in outlets:
                outlet.offer(frames(50 * second, 50))
                if results and second % 5 == 2:
                    at = SESSION + second * S + S // 2
                    for result in (alarm(second, at), energy(second, at), task(second, at)):
                        outlet.offer(result)


@pytest.fixture
def cell(record: Path) -> Any:
    made = Cell(record)
    yield made
    made.recorded.close()


def check(server: Fake, seconds: range) -> None:
    assert [row.time for row in server.rows] == [row_truth(second)["time"] for second in seconds]
    for row, second in zip(server.rows, seconds, strict=True):
        truth = {k: v for k, v in row_truth(second).items() if "." in k and v is not None}
        assert {k: v for k, v in row.fields.items() if k != "quality"} == pytest.approx(truth)
        assert row.tags == {"site": SITE, "cell": CELL}


async def settled(server: Fake, count: int) -> None:
    await eventually(lambda: len(server.rows) >= count, f"{count} rows")


async def test_rows_and_results_arrive(record: Path, cell: Cell) -> None:
    async with Fake().open() as server, running(outlet_of(server.url, record)) as outlet:
        await cell.seconds(12, outlet)
        await settled(server, 12)
        check(server, range(12))
        kinds = [p.measurement for p in server.points.values() if p.measurement != "cellwatt"]
        assert sorted(kinds) == sorted([f"cellwatt_{kind}" for kind in ("alarm", "energy", "task")] * 2)
        assert outlet.trouble() is None
        assert outlet.account.residue == 0
    request = server.requests[0]
    assert request.path_qs == "/write?db=plant&precision=ns"
    assert request.headers["Content-Encoding"] == "gzip"


async def test_patterns_that_fit_no_channel_are_told(caplog: pytest.LogCaptureFixture) -> None:
    async with Fake().open() as server, running(outlet_of(server.url, None, channels=("arm.mode", "leg.*"))) as outlet:
        outlet.offer(frames(0, 50))
        await settled(server, 1)
    assert "influx: no channel matches leg.*" in caplog.text
    assert outlet.account.counters["influx: patterns that fit no channel"] == 1
    assert set(server.rows[0].fields) == {"arm.mode", "quality"}


async def test_items_that_come_too_fast_are_filled_in(
    record: Path, cell: Cell, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Here before the outlet runs, and has read how far the one before it came."""
    monkeypatch.setattr("cellwatt.outlets.forward.BLOCKS", 4)
    async with Fake().open() as server:
        outlet = outlet_of(server.url, record)
        await cell.seconds(20, outlet)
        async with running(outlet):
            await settled(server, 1)
            await cell.seconds(4, outlet, results=False)
            await settled(server, 24)
    check(server, range(24))


async def test_a_record_that_cannot_be_read_holds_up_nothing_new(
    record: Path, cell: Cell, monkeypatch: pytest.MonkeyPatch
) -> None:
    def broken(*_: Any, **__: Any) -> None:
        raise RecordingError("x.mcap: cannot be read: Input/output error")

    monkeypatch.setattr("cellwatt.outlets.forward.read", broken)
    async with Fake().open() as server, running(outlet_of(server.url, record)) as outlet:
        await cell.seconds(8, outlet, results=False)
        await settled(server, 7)
        await eventually(lambda: outlet.trouble(), "the trouble")
        assert "x.mcap: cannot be read" in str(outlet.trouble())
        await cell.seconds(4, outlet, results=False)
        await settled(server, 11)
    check(server, range(1, 12))


async def test_lines_refused_for_good_are_kept_apart(record: Path, cell: Cell) -> None:
    bad = str(row_truth(5)["time"])
    async with Fake().open() as server, running(outlet_of(server.url, record)) as outlet:
        server.refuses = lambda line: line.endswith(bad)
        await cell.seconds(12, outlet, results=False)
        await settled(server, 11)
        await eventually(lambda: outlet.account.missed["influx: refused"], "the refusal")
    assert [(row.time - SESSION) // S - 1 for row in server.rows] == [0, 1, 2, 3, 4, *range(6, 12)]
    reason, line = (record / REFUSED).read_text().splitlines()[:2]
    assert reason.startswith("# 400: partial write: field type conflict")
    assert line.endswith(bad)


async def test_a_server_that_refuses_all_is_asked_a_bounded_number_of_times() -> None:
    async with Fake().open() as server, running(outlet_of(server.url, None, batch=1000)) as outlet:
        server.refuses = lambda _: True
        for second in range(300):
            outlet.offer(frames(50 * second, 50))
        await eventually(lambda: outlet.account.missed["influx: refused"] == 300, "all refused")
    assert len(server.batches) <= 64 + 64


async def test_batches_that_are_too_large_are_halved() -> None:
    async with Fake().open() as server, running(outlet_of(server.url, None)) as outlet:
        server.answers.append((413, "", {}))
        for second in range(8):
            outlet.offer(frames(50 * second, 50))
        await eventually(lambda: outlet.account.snapshot()["received"] == 8, "the last answer")
    assert [len(lines) for lines in server.batches] == [4, 4]


@pytest.mark.parametrize("limits", [{"batch": 3}, {"batch": 1000, "queue": 3}])
async def test_new_lines_wait_for_the_next_attempt_or_for_a_whole_batch(
    monkeypatch: pytest.MonkeyPatch, limits: dict[str, int]
) -> None:
    """A queue that is smaller than a batch is sent when it is full."""
    now = [1000.0]
    monkeypatch.setattr("cellwatt.outlets.forward.time", SimpleNamespace(monotonic=lambda: now[0]))
    async with Fake().open() as server, running(outlet := outlet_of(server.url, None, **limits)):
        forwarder = outlet._influx
        assert forwarder is not None
        for second, (waiting, sent) in enumerate([(0, 1), (1, 1), (2, 1), (0, 4), (1, 4)]):
            outlet.offer(frames(50 * second, 50))
            await eventually(
                lambda w=waiting, n=sent: (
                    len(forwarder._pending) == w and len(server.rows) == n and not forwarder._items
                ),
                f"{waiting} wait after row {second}",
            )
        now[0] += 0.02
        await eventually(lambda: outlet.account.snapshot()["received"] == 5, "the last answer")
    assert [len(lines) for lines in server.batches] == [1, 3, 1]


async def test_a_server_that_asks_to_wait_is_waited_for() -> None:
    async with Fake().open() as server, running(outlet_of(server.url, None)) as outlet:
        server.answers += [(429, "full", {"Retry-After": "0"})]
        server.answers += [(429, "", {"Retry-After": "Wed, 21 Oct 2015 07:28:00 GMT"})] * 5
        server.answers += [(503, "busy", {"Retry-After": "3600"})]
        outlet.offer(frames(0, 50))
        await eventually(lambda: str(outlet.trouble()).endswith("429: full; trying again in 0.5 s"), "no storm")
        # Six times after the shortest pause: our own pauses would have taken half a minute.
        await eventually(lambda: len(server.requests) == 7, "the seventh request", 20)
        told = "503: busy; trying again in 3600.0 s"
        await eventually(lambda: str(outlet.trouble()).endswith(told), "the trouble")


async def test_a_certificate_that_is_not_trusted_is_told(tls: ssl.SSLContext) -> None:
    async with Fake().open(tls) as server, running(outlet_of(server.url, None)) as outlet:
        outlet.offer(frames(0, 50))
        await eventually(lambda: outlet.trouble(), "the trouble")
        assert "its certificate is not trusted" in str(outlet.trouble())


async def test_a_row_that_new_channels_cut_is_sent_in_two() -> None:
    end = str(row_truth(1)["time"])
    async with Fake().open() as server, running(outlet_of(server.url, None)) as outlet:
        for block in (frames(0, 75), frames(75, 0), frames(75, 25, layout=ANOTHER)):
            outlet.offer(block)
        await eventually(lambda: outlet.account.snapshot()["received"] == 3, "the rows")
    cut = [parse(line) for line in chain(*server.batches) if line.endswith(end)]
    means = [float(np.mean(np.arange(*span) / 7)) for span in ((50, 75), (75, 100))]
    assert [point.fields["arm.joint_1.position"] for point in cut] == pytest.approx(means)


async def test_what_comes_between_two_settings_is_sent_by_the_later() -> None:
    async with Fake().open() as server:
        before, after = outlet_of(server.url, None), outlet_of(server.url, None)
        before.offer(frames(0, 100))
        after.succeed(before)
        async with running(after):
            await eventually(lambda: after.account.snapshot()["received"] == 2, "the answer")
        async with running(before):
            pass  # it has none of them any more
    assert len([*chain(*server.batches)]) == 2


async def test_version_2() -> None:
    v2 = {"database": None, "org": "my plant", "bucket": "cells", "token": "s3cret"}
    async with Fake().open() as server, running(outlet_of(server.url, None, **v2)) as outlet:
        outlet.offer(frames(0, 50))
        await settled(server, 1)
    assert server.requests[0].path == "/api/v2/write"
    assert dict(server.requests[0].query) == {"org": "my plant", "bucket": "cells", "precision": "ns"}
    assert server.requests[0].headers["Authorization"] == "Token s3cret"


NOW = datetime(2026, 11, 24, 12, 0, 0, tzinfo=UTC)


@pytest.mark.parametrize(
    ("header", "seconds"),
    [
        (None, None),
        ("-5", 0.0),
        ("1e9", LONGEST_WAIT),
        ("soon", None),
        ("5 Nov 01 01:28777777777777777 GMT", None),
        ("Tue, 24 Nov 2026 12:00:30 GMT", 30.0),
    ],
)
def test_retry_after(header: str | None, seconds: float | None) -> None:
    assert wait_of(header, NOW) == seconds


@pytest.mark.parametrize(
    ("status", "text", "error"),
    [(204, "", None), (200, "", None), *((status, "", RefusedError) for status in (400, 413, 422)),
     *((status, "", NotNowError) for status in (302, 401, 404, 429, 500, 503)),
     (500, '{"error": "[shard 7] partial write: field type conflict dropped=1"}', RefusedError),
     (500, '{"error": "partial write"}', NotNowError),  # a cluster with a node down
     (503, '{"error": "partial write: hinted handoff queue not empty"}', NotNowError)],
)  # fmt: skip
def test_answers_mean(status: int, text: str, error: type[Exception] | None) -> None:
    with nullcontext() if error is None else pytest.raises(error):
        judge(status, text, {})


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        ('{"error": "a\\nb"}', "a b"),
        ("[" * 3000, "[" * 500),
    ],
)
def test_reasons(text: str, reason: str) -> None:
    assert reason_of(text) == reason


def test_settings_say_what_is_open_and_keep_secrets(tmp_path: Path) -> None:
    far = {"url": "http://influx.example", "org": "o", "bucket": "b", "token": "s3cret", "open": True}
    settings = HistorianSettings.model_validate({"influx": {**far, "ca": str(tmp_path / "no.pem")}})
    first, second = settings.warnings()
    assert "are sent unencrypted (open: true)" in first
    assert "cannot be read" in second
    assert "s3cret" not in repr(settings)


async def test_much_that_waits_does_not_hold_up_the_loop() -> None:
    """As after a request that hung: the loop's own watch fails this test where it is held up."""
    async with running(outlet_of("http://127.0.0.1:9", None, rate=50.0)) as outlet:
        for second in range(60):
            outlet.offer(frames(50 * second, 50))
        await eventually(lambda: not outlet._influx._items, "the lines")  # type: ignore[union-attr]
