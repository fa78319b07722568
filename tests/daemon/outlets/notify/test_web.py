"""Webhooks, ntfy and Home Assistant by real servers."""

from __future__ import annotations

import asyncio
import json
import ssl
from pathlib import Path
from typing import Any

import pytest
from aiohttp import web

from cellwatt.outlets.notify import courier as module
from cellwatt.outlets.notify.courier import UNDELIVERED
from cellwatt.outlets.notify.web import sign
from tests.daemon.outlets.notify.cell import View, alarm, offered, running
from tests.daemon.outlets.notify.servers import hook, web_server
from tests.patience import eventually

SECRET = "a secret of the plant"


@pytest.fixture(autouse=True)
def _troubled_at_once(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "FAILING", 0.0)


async def test_the_same_message_until_it_is_taken(tmp_path: Path) -> None:
    async with web_server() as server:
        server.answers = [500, 401, 429, 403, 404]
        to = {"desk": {"webhook": {"url": f"{server.url}/hook", "secret": SECRET}}}
        async with running(View(tmp_path), to) as made:
            await offered(made, alarm(3), "desk: sent")
            assert made.trouble() is None
        assert len(server.calls) == 6
        assert made.account.counters["desk: retried"] == 5
        assert len({call.body for call in server.calls}) == 1
        assert len({call.headers["webhook-id"] for call in server.calls}) == 1
        for call in server.calls:
            head = call.headers
            expected = sign(SECRET, head["webhook-id"], int(head["webhook-timestamp"]), call.body)
            assert head["webhook-signature"] == expected
        told = server.calls[0].json
        assert told["id"] == server.calls[0].headers["webhook-id"]
        assert told["subject"] == "[plant-1/weld-3] error: Joint 3 is loaded 12 Nm more than it should be"
        assert told["alarms"][0]["evidence"] == {"residual_Nm": 12.04}


async def test_a_redirect_is_not_followed(tmp_path: Path) -> None:
    async def elsewhere(_: web.BaseRequest) -> web.StreamResponse:
        return web.Response(status=307, headers={"Location": "/other"})

    async with web_server() as server, running(View(tmp_path), {"desk": hook(server, "geheim")}) as made:
        server.answers = [elsewhere]
        made.offer(alarm(1))
        await eventually(lambda: made.trouble())
        trouble = str(made.trouble())
        await eventually(lambda: made.account.counters["desk: sent"])
    assert [call.path for call in server.calls] == ["/geheim", "/geheim"]
    assert "307 Temporary Redirect" in trouble
    assert "geheim" not in trouble


async def test_a_body_that_never_ends_holds_nothing_up(tmp_path: Path) -> None:
    over = asyncio.Event()

    async def endless(request: web.BaseRequest) -> web.StreamResponse:
        response = web.StreamResponse()
        await response.prepare(request)
        await response.write(b"x")
        await over.wait()
        return response

    async with web_server() as server, running(View(tmp_path), {"desk": hook(server)}, timeout=60.0) as made:
        server.answers = [endless]
        await offered(made, alarm(1), "desk: sent")
        over.set()
    assert len(server.calls) == 1


@pytest.mark.parametrize("status", [400, 422])
async def test_refused_for_good(tmp_path: Path, status: int) -> None:
    async with web_server() as server, running(View(tmp_path), {"desk": hook(server)}) as made:
        server.answers = [status]
        await offered(made, alarm(1), "desk: undelivered")
        assert f": {status} " in str(made.trouble())
    assert len(server.calls) == 1
    kept = json.loads((tmp_path / UNDELIVERED).read_text())
    assert kept["reason"].startswith(f"{status} ")
    assert kept["alarms"][0]["id"] == alarm(1).id


async def test_ntfy(tmp_path: Path) -> None:
    async with web_server() as server:
        ntfy = {"ntfy": {"url": server.url, "topic": "weld-alarms", "token": "tk_geheim"}}
        async with running(View(tmp_path), {"phone": ntfy}, page="https://weld-3.plant.example:8480") as made:
            await offered(made, alarm(1), "phone: sent")
            await offered(made, alarm(1, active=False), "phone: sent", 2)
        raised, cleared = (call.json for call in server.calls)
        assert server.calls[0].headers["Authorization"] == "Bearer tk_geheim"
        assert server.calls[0].path == "/"
        assert (raised["topic"], raised["priority"], raised["tags"]) == ("weld-alarms", 5, ["rotating_light"])
        assert raised["title"].startswith("[plant-1/weld-3] error: Joint 1")
        assert raised["click"] == "https://weld-3.plant.example:8480/cell/plant-1/weld-3/alarms"
        assert (cleared["priority"], cleared["tags"]) == (3, ["white_check_mark"])
        assert raised["sequence_id"] != cleared["sequence_id"]


async def test_home_assistant(tmp_path: Path) -> None:
    async with web_server() as server:
        app = {"home_assistant": {"url": f"{server.url}/", "service": "mobile_app_shift", "token": "geheim-1"}}
        async with running(View(tmp_path), {"app": app}) as made:
            await offered(made, alarm(1), "app: sent")
        (call,) = server.calls
        assert call.path == "/api/services/notify/mobile_app_shift"
        assert call.headers["Authorization"] == "Bearer geheim-1"
        assert call.json["title"].startswith("[plant-1/weld-3] error")
        assert set(call.json) == {"title", "message", "data"}


async def test_https_by_an_authority_of_the_plant(tmp_path: Path, certificates: Path, tls: ssl.SSLContext) -> None:
    async with web_server(tls) as server:
        to: dict[str, Any] = {
            "trusted": {"webhook": {"url": server.url, "ca": certificates / "ca"}},
            "distrusted": {"webhook": {"url": server.url}},
        }
        async with running(View(tmp_path), to) as made:
            await offered(made, alarm(1), "trusted: sent")
            await eventually(lambda: made.account.counters["distrusted: retried"])
            assert "distrusted cannot be reached (webhook by https://localhost" in str(made.trouble())
            assert "its certificate is not trusted" in str(made.trouble())
        assert len(server.calls) == 1
