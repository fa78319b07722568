"""The outlet: recipients apart from each other, groups, people's words, restarts and new settings."""

from __future__ import annotations

import asyncio
from pathlib import Path

import pytest
from aiohttp import web

from cellwatt import AlarmBook
from cellwatt.outlets.notify import courier as module
from tests.daemon.outlets.notify.cell import EPOCH, View, alarm, event, offered, outlet, running
from tests.daemon.outlets.notify.servers import Web, hook, web_server
from tests.daemon.outlets.zenoh.fake_cell import Journal
from tests.patience import eventually


def told(server: Web, path: str = "/") -> list[tuple[str, int]]:
    return [
        (one["happened"], one["joint"]) for call in server.calls if call.path == path for one in call.json["alarms"]
    ]


def stand(view: View, *up: int, acknowledged: tuple[int, ...] = (), shelved: tuple[int, ...] = ()) -> None:
    """Have the book of the cell say so."""
    view.alarms = AlarmBook()
    for number in up:
        view.alarms.take(alarm(number))
    for number in acknowledged:
        view.alarms.acknowledge(alarm(number).id, "Ada", "", EPOCH)
    for number in shelved:
        view.alarms.shelve(alarm(number).id, 2 * EPOCH, "Ada", "", EPOCH)


async def test_one_that_hangs_and_one_that_refuses_delay_nobody(tmp_path: Path) -> None:
    over = asyncio.Event()

    async def silent(_: web.BaseRequest) -> web.StreamResponse:
        await over.wait()
        return web.Response()

    async with web_server() as hangs, web_server() as refuses, web_server() as takes:
        hangs.answers, refuses.answers = [silent], [500] * 10_000
        async with running(View(tmp_path), {"a": hook(hangs), "b": hook(refuses), "c": hook(takes)}) as made:
            for number in range(1, 6):
                made.offer(alarm(number))
                await eventually(lambda: ("raised", number) in told(takes))  # noqa: B023
            assert len(hangs.calls) == 1
            over.set()
            await eventually(lambda: len(told(hangs)) == 5)
            refuses.answers.clear()
            await eventually(lambda: made.account.counters["b: sent"] == 2)
        assert [joint for _, joint in told(takes)] == [1, 2, 3, 4, 5]
        assert len(hangs.calls) == 2  # what came meanwhile went as one


async def test_alarms_of_a_moment_go_as_one(tmp_path: Path) -> None:
    async with web_server() as server, running(View(tmp_path), {"desk": hook(server, group=0.3)}) as made:
        for number in (1, 2, 3):
            made.offer(alarm(number))
        made.offer(alarm(2, active=False))
        await eventually(lambda: server.calls)
    assert told(server) == [("raised", 1), ("raised", 2), ("raised", 3), ("cleared", 2)]
    assert made.account.counters["desk: grouped"] == 3


async def test_repeats_until_acknowledged_and_not_on_the_shelf(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "LOOK", 0.01)
    view = View(tmp_path)
    async with web_server() as server, running(view, {"desk": hook(server, repeat=60.0)}) as made:
        object.__setattr__(made.settings.to["desk"], "repeat", 0.05)  # the least in settings is a minute
        made.offer(alarm(1))
        made.offer(alarm(2))
        stand(view, 1, 2)
        made.health({})
        await eventually(lambda: told(server).count(("repeated", 1)) >= 2)
        stand(view, 1, 2, acknowledged=(1,))
        made.offer(event("acknowledged", alarm(1).id))
        await eventually(lambda: not made._fresh.is_set())
        count = told(server).count(("repeated", 2))
        await eventually(lambda: told(server).count(("repeated", 2)) >= count + 2)
        before = told(server).count(("repeated", 1))
        await eventually(lambda: told(server).count(("repeated", 2)) >= count + 5)
        assert told(server).count(("repeated", 1)) == before
        stand(view, 2, shelved=(2,))
        made.offer(alarm(1, active=False))
        await eventually(lambda: ("cleared", 1) in told(server))
        before = told(server).count(("repeated", 2))
    assert told(server).count(("repeated", 2)) <= before + 1


async def test_what_is_shelved_before_it_is_told_is_told_after_the_shelf(tmp_path: Path) -> None:
    view = View(tmp_path)
    async with web_server() as server, running(view, {"desk": hook(server, group=0.3)}) as made:
        made.offer(alarm(1))
        made.offer(alarm(2))
        stand(view, 1, 2, shelved=(1,))
        made.offer(event("shelved", alarm(1).id))
        await eventually(lambda: server.calls)
        assert told(server) == [("raised", 2)]
        stand(view, 1, 2)
        made.health({})
        await eventually(lambda: told(server) == [("raised", 2), ("raised", 1)])


async def test_an_alarm_on_the_shelf_is_not_over_because_the_daemon_restarted(tmp_path: Path) -> None:
    async with web_server() as server:
        async with running(View(tmp_path), {"desk": hook(server)}) as before:
            await offered(before, alarm(1), "desk: sent")
        view = View(tmp_path, session=1)  # long ago: alarms that were not raised again are over
        stand(view, 1, shelved=(1,))
        async with running(view, {"desk": hook(server)}) as after:
            await offered(after, alarm(2), "desk: sent")
            stand(view, 1)
            await offered(after, alarm(3), "desk: sent", 2)
            stand(view)
            after.offer(alarm(1, active=False))
            await eventually(lambda: ("cleared", 1) in told(server))
    assert told(server) == [("raised", 1), ("raised", 2), ("raised", 3), ("cleared", 1)]


@pytest.mark.parametrize("record", [True, False])
async def test_new_settings_go_on_where_the_old_ones_were(tmp_path: Path, record: bool) -> None:
    view = View(tmp_path, record=record)
    async with web_server() as server:
        async with running(view, {"desk": hook(server)}) as before:
            await offered(before, alarm(1), "desk: sent")
        before.offer(alarm(2))  # the daemon hands over until the outlet after it is there
        stand(view, 1, 2)
        async with running(view, {"desk": hook(server), "new": hook(server, "new")}, before) as after:
            after.offer(alarm(1, active=False))
            await eventually(lambda: told(server) == [("raised", 1), ("raised", 2), ("cleared", 1)])
            await eventually(lambda: ("raised", 2) in told(server, "/new"))


async def test_alarms_for_one_who_is_no_recipient_any_more_are_counted(tmp_path: Path) -> None:
    async with web_server() as server:
        to = {"desk": hook(server), "old": hook(server, "old", group=3600.0)}
        async with running(View(tmp_path), to) as before:
            await offered(before, alarm(1), "desk: sent")
        async with running(View(tmp_path), {"desk": hook(server)}, before) as after:
            await eventually(lambda: after.account.counters["old, no recipient any more: alarms not told"] == 1)


async def test_the_journal_fills_what_a_process_that_ended_did_not_tell(tmp_path: Path) -> None:
    journal = Journal(alarm(1), alarm(2))
    async with web_server() as server:
        async with running(View(tmp_path, journal=journal), {"desk": hook(server)}) as before:
            before.offer(alarm(1))
            before.offer(alarm(2))
            await eventually(lambda: len(told(server)) == 2)
            await eventually(lambda: before._ledger.of("desk").flight is None)
        journal.items += [alarm(1, active=False), alarm(3), alarm(4), alarm(4, active=False)]
        async with running(View(tmp_path, journal=journal), {"desk": hook(server)}):
            await eventually(lambda: len(told(server)) == 4)
            assert sorted(told(server)[2:]) == [("cleared", 1), ("raised", 3)]


async def test_an_attempt_under_way_is_noted_when_the_outlet_ends(tmp_path: Path) -> None:
    goes_on = asyncio.Event()

    async def slow(_: web.BaseRequest) -> web.StreamResponse:
        await goes_on.wait()
        return web.Response()

    async with web_server() as server:
        server.answers = [slow]
        made = outlet(View(tmp_path), {"desk": hook(server)})
        task = asyncio.create_task(made.run())
        made.offer(alarm(1))
        await eventually(lambda: server.calls)
        task.cancel()
        await asyncio.sleep(0)
        goes_on.set()
        with pytest.raises(asyncio.CancelledError):
            await task
        async with running(View(tmp_path), {"desk": hook(server)}) as after:
            await offered(after, alarm(2), "desk: sent")
        assert told(server) == [("raised", 1), ("raised", 2)]


async def test_a_ledger_that_cannot_be_written_is_told_and_alarms_go_out(tmp_path: Path) -> None:
    folder = tmp_path / "gone"
    async with web_server() as server, running(View(tmp_path), {"desk": hook(server)}, folder=str(folder)) as made:
        made.offer(alarm(1))
        await eventually(lambda: server.calls)
        assert f"{folder}/notify.jsonl cannot be written" in str(made.trouble())
        folder.mkdir()
        made.health({})
        await eventually(lambda: made.trouble() is None)
    assert (folder / "notify.jsonl").exists()
