"""Who gets in: logins, sessions, forged requests, other hosts, and the headers of every answer."""

from __future__ import annotations

import asyncio
import ssl
from collections.abc import AsyncIterator
from dataclasses import asdict
from http.cookies import SimpleCookie
from pathlib import Path
from typing import Any

import aiohttp
import pytest

from cellwatt.door.settings import tls_context
from cellwatt.outlets.page.access import HEADERS, POLICY
from cellwatt.outlets.page.app import names_in
from cellwatt.outlets.page.outlet import PageSettings
from tests.daemon.outlets.page.cell import (
    API,
    HASH,
    PASSWORD,
    USERS,
    Served,
    Stream,
    alarm,
    client,
    csrf,
    log_in,
    served,
    status,
)
from tests.daemon.outlets.zenoh.test_link import certificates

__all__ = ["certificates"]

LOCKED = [
    f"{API}/state",
    f"{API}/stream",
    f"{API}/curves",
    f"{API}/alarms",
    f"{API}/reports",
    f"{API}/reports/a/x.html",
    f"{API}/mismatch",
    "/api/plant",
    "/api/plant/stream",
    "/api/nothing",
]


@pytest.fixture
async def page(tmp_path: Path) -> AsyncIterator[Served]:
    async with served(tmp_path, users=USERS) as found:
        found.feed.take_item("alarm", asdict(alarm(1)))
        found.feed.take_health(status([{**asdict(alarm(1)), "acknowledged": None}]))
        yield found


@pytest.fixture
async def browser() -> AsyncIterator[aiohttp.ClientSession]:
    async with client() as found:
        yield found


async def code_of(browser: aiohttp.ClientSession, url: str, **more: Any) -> int:
    async with browser.get(url, **more) as response:
        return response.status


# logins -------------------------------------------------------------------------------------------


async def test_nothing_of_the_cell_is_told_without_a_login(browser: aiohttp.ClientSession, page: Served) -> None:
    for path in LOCKED:
        async with browser.get(page.url + path) as response:
            assert response.status == 401, path
            assert await response.json() == {"error": "log in first"}
    async with browser.get(f"{page.url}/api/site") as response:
        told = await response.json()
        assert (told["site"], told["cells"], told["user"], told["may_act"]) == (None, [], None, False)
        assert told["login_needed"] is True
    header = await csrf(browser, page.url)
    for what in ("acknowledge", "shelve", "unshelve"):
        body = {"id": "alarm-1", "name": "ada", "note": "", "minutes": 5}
        async with browser.post(f"{page.url}{API}/{what}", json=body, headers=header) as response:
            assert response.status == 401
    assert page.orders == []


async def test_a_login_lasts_until_it_is_ended(browser: aiohttp.ClientSession, page: Served) -> None:
    assert await log_in(browser, page.url, "ada") == 200
    assert await code_of(browser, f"{page.url}{API}/state") == 200
    async with browser.get(f"{page.url}/api/site") as response:
        told = await response.json()
        assert (told["user"], told["may_act"], told["login_needed"]) == ("ada", True, False)
        assert told["cells"] != []
    stolen = {"Cookie": "; ".join(f"{c.key}={c.value}" for c in browser.cookie_jar)}
    assert await code_of(browser, f"{page.url}{API}/state", headers=stolen) == 200
    header = await csrf(browser, page.url)
    async with browser.post(f"{page.url}/api/logout", headers=header) as response:
        assert response.status == 200
    assert await code_of(browser, f"{page.url}{API}/state") == 401
    async with aiohttp.ClientSession() as thief:
        assert await code_of(thief, f"{page.url}{API}/state", headers=stolen) == 401


async def test_a_logout_ends_the_streams_of_that_login_alone(page: Served) -> None:
    async with client() as mine, client() as other:
        await log_in(mine, page.url, "ada")
        await log_in(other, page.url, "ada")
        async with mine.get(f"{page.url}{API}/stream") as first, other.get(f"{page.url}{API}/stream") as second:
            header = await csrf(mine, page.url)
            async with mine.post(f"{page.url}/api/logout", headers=header):
                pass
            with pytest.raises(EOFError):
                await Stream(first).until("never")
            page.feed.take_gap("still here")
            assert await Stream(second).until("gap") == {"text": "still here"}


async def test_the_cookie_is_out_of_reach(browser: aiohttp.ClientSession, page: Served) -> None:
    header = await csrf(browser, page.url)
    before = {c.value for c in browser.cookie_jar}
    body = {"name": "ada", "password": PASSWORD}
    async with browser.post(f"{page.url}/api/login", json=body, headers=header) as response:
        (set_cookie,) = response.headers.getall("Set-Cookie")
    (cookie,) = SimpleCookie(set_cookie).values()
    assert cookie.key == "cellwatt-0"
    assert (cookie["httponly"], cookie["samesite"], cookie["path"]) == (True, "Strict", "/")
    assert len(cookie.value) == 43
    assert cookie.value not in before, "a login begins with a new token"


async def test_who_may_look_may_not_act(page: Served) -> None:
    async with client() as browser:
        await log_in(browser, page.url, "eve")
        header = await csrf(browser, page.url)
        body = {"id": "alarm-1", "name": "ada", "note": ""}
        async with browser.post(f"{page.url}{API}/acknowledge", json=body, headers=header) as response:
            assert response.status == 403
            assert "you may look, but not act" in (await response.json())["error"]
    assert page.orders == []


async def test_the_name_of_the_login_is_what_counts(browser: aiohttp.ClientSession, page: Served) -> None:
    await log_in(browser, page.url, "ada")
    header = await csrf(browser, page.url)
    body = {"id": "alarm-1", "name": "somebody else", "note": "seen"}
    async with browser.post(f"{page.url}{API}/acknowledge", json=body, headers=header) as response:
        assert response.status == 200
    assert page.orders == [{"what": "acknowledge", "alarm": "alarm-1", "name": "ada", "note": "seen"}]


@pytest.mark.parametrize("user", ["ada", "nobody"])
async def test_tries_at_passwords_have_to_wait(browser: aiohttp.ClientSession, page: Served, user: str) -> None:
    header = await csrf(browser, page.url)
    answers = []
    for _ in range(8):
        body = {"name": user, "password": "guess"}
        async with browser.post(f"{page.url}/api/login", json=body, headers=header) as response:
            answers.append((response.status, (await response.json())["error"], response.headers.get("Retry-After")))
    assert answers[:5] == [(401, "this name and password do not fit", None)] * 5
    assert answers[5][0] == 429
    assert answers[5][1].startswith("too many tries: wait ")
    assert int(str(answers[5][2])) >= 1
    # Behind a proxy on this PC everybody has this address: it must not lock out others.
    assert await log_in(browser, page.url, "ada") == (429 if user == "ada" else 200)
    assert page.page.counts["failed logins"] == 5


@pytest.mark.parametrize(
    "body", [{"name": "ada"}, {"name": "ada", "password": 5}, {"name": "ada", "password": ""}, [], 5]
)
async def test_half_a_login_is_none(browser: aiohttp.ClientSession, page: Served, body: Any) -> None:
    header = await csrf(browser, page.url)
    async with browser.post(f"{page.url}/api/login", json=body, headers=header) as response:
        assert response.status == 400


async def test_where_there_are_no_users_nobody_logs_in(browser: aiohttp.ClientSession, tmp_path: Path) -> None:
    async with served(tmp_path) as page:
        assert await log_in(browser, page.url, "ada") == 409


# forged requests ----------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "headers",
    [
        {"X-CSRF-Token": ""},
        {"X-CSRF-Token": "0" * 64},
        {"X-CSRF-Token": "ß"},
        {"Origin": "http://evil.example"},
        {"Origin": "null"},
        {"Origin": "http://[::1"},
        {"Sec-Fetch-Site": "cross-site"},
        {"Sec-Fetch-Site": "same-site"},
    ],
)
async def test_what_another_site_posts_is_refused(
    browser: aiohttp.ClientSession, page: Served, headers: dict[str, str]
) -> None:
    await log_in(browser, page.url, "ada")
    forged = {**await csrf(browser, page.url), **headers}
    body = {"id": "alarm-1", "note": ""}
    async with browser.post(f"{page.url}{API}/acknowledge", json=body, headers=forged) as response:
        assert response.status == 403
    assert page.orders == []


@pytest.mark.parametrize(
    ("head", "status"),
    [
        (b"POST /api/logout HTTP/1.1\r\nHost: 127.0.0.1\r\nCookie: %s=\xff\r\nX-CSRF-Token: \xff\r\n", 403),
        (b"GET /api/site HTTP/1.1\r\nHost: 127.0.0.1\r\nCookie: %s=\xff\r\n", 200),
        (b"GET / HTTP/1.1\r\nHost: elsewhere.exam\xd0ple\r\n", 421),
        (b"GET / HTTP/1.1\r\nHost: 127.0.0.1:1@evil.example\r\n", 421),
    ],
)
async def test_headers_that_are_no_text_are_no_mistake_of_ours(page: Served, head: bytes, status: int) -> None:
    reader, writer = await asyncio.open_connection(*page.url.removeprefix("http://").split(":"))
    cookie = page.gate.cookie.encode()
    writer.write(head.replace(b"%s", cookie) + b"Connection: close\r\nContent-Length: 0\r\n\r\n")
    answer = await reader.read()
    assert int(answer.split(b" ")[1]) == status
    writer.close()
    await writer.wait_closed()


async def test_our_own_page_may_post(browser: aiohttp.ClientSession, page: Served) -> None:
    await log_in(browser, page.url, "ada")
    own = {**await csrf(browser, page.url), "Origin": page.url, "Sec-Fetch-Site": "same-origin"}
    async with browser.post(
        f"{page.url}{API}/acknowledge", json={"id": "alarm-1", "note": ""}, headers=own
    ) as response:
        assert response.status == 200


async def test_a_form_cannot_post(browser: aiohttp.ClientSession, page: Served) -> None:
    header = await csrf(browser, page.url)
    async with browser.post(f"{page.url}/api/login", data={"name": "ada"}, headers=header) as response:
        assert response.status == 415


async def test_the_proof_of_one_browser_is_none_of_another(page: Served) -> None:
    async with client() as mine, client() as other:
        await log_in(mine, page.url, "ada")
        await log_in(other, page.url, "ada")
        body = {"id": "alarm-1", "note": ""}
        header = await csrf(other, page.url)
        async with mine.post(f"{page.url}{API}/acknowledge", json=body, headers=header) as response:
            assert response.status == 403


@pytest.mark.parametrize(
    ("host", "code"),
    [
        ("localhost:8480", 200),
        ("127.0.0.1", 200),
        ("[::1]:8480", 200),
        ("LOCALHOST.", 200),
        ("evil.example", 421),
        ("evil.example:8480", 421),
        ("192.0.2.1:8480", 421),
        ("localhost.evil.example", 421),
    ],
)
async def test_a_page_of_this_pc_has_no_other_name(tmp_path: Path, host: str, code: int) -> None:
    async with served(tmp_path) as page, client() as browser:
        for path in ("/", "/api/site", f"{API}/state"):
            assert await code_of(browser, page.url + path, headers={"Host": host}) == code


@pytest.mark.parametrize(
    ("host", "code"), [("192.0.2.1:80", 200), ("weld-3.plant", 200), ("hmi", 200), ("evil.example", 421)]
)
async def test_a_page_of_the_network_has_its_names_and_addresses(tmp_path: Path, host: str, code: int) -> None:
    async with (
        served(tmp_path, listen="0.0.0.0:0", open=True, names=["weld-3.plant", "HMI"]) as page,
        client() as browser,
    ):
        url = page.url.replace("0.0.0.0", "127.0.0.1")
        assert await code_of(browser, f"{url}/api/site", headers={"Host": host}) == code


async def test_an_open_page_is_to_look_at(tmp_path: Path) -> None:
    async with served(tmp_path, listen="0.0.0.0:0", open=True) as page, client() as browser:
        page.feed.take_item("alarm", asdict(alarm(1)))
        url = page.url.replace("0.0.0.0", "127.0.0.1")
        header = await csrf(browser, url)
        body = {"id": "alarm-1", "name": "x", "note": ""}
        async with browser.post(f"{url}{API}/acknowledge", json=body, headers=header) as response:
            assert response.status == 403


# headers and TLS ----------------------------------------------------------------------------------


async def test_every_answer_has_its_headers(browser: aiohttp.ClientSession, page: Served, tmp_path: Path) -> None:
    await log_in(browser, page.url, "ada")
    await asyncio.to_thread((tmp_path / "x.html").write_text, "x")
    page.archive.files["x.html"] = tmp_path / "x.html"
    paths = ["/", "/assets/main-1a2b.js", "/assets/none", "/favicon.svg", "/none", "/api/site", *LOCKED]
    for path in (*paths, f"{API}/reports/x.html"):
        async with browser.get(page.url + path) as response:
            check_headers(response, path.endswith("x.html") and response.status == 200)
    async with browser.post(page.url + "/api/login") as response:
        assert response.status == 403
        check_headers(response)
    async with browser.get(page.url + "/", headers={"Host": "evil.example"}) as response:
        assert response.status == 421
        check_headers(response)
    async with browser.options(page.url + "/api/site") as response:
        assert response.status in (403, 405)
        check_headers(response)


def check_headers(response: aiohttp.ClientResponse, report: bool = False) -> None:
    got = response.headers
    for name, value in HEADERS.items():
        if name not in ("Cache-Control", "Content-Security-Policy"):
            assert got[name] == value
    assert (got["Content-Security-Policy"] == POLICY) is not report
    assert got["Server"] == "cellwatt"
    assert "unsafe" not in POLICY
    if response.content_type in ("application/json", "text/event-stream"):
        assert got["Cache-Control"] == "no-store"
    assert "Strict-Transport-Security" not in got


async def test_over_tls_the_browser_is_bound_to_it(tmp_path: Path, certificates: Path) -> None:
    files = {"certificate": certificates / "cell", "key": certificates / "cell.key"}
    settings = PageSettings(**files)
    context = await asyncio.to_thread(tls_context, settings)
    trusting = await asyncio.to_thread(ssl.create_default_context, cafile=str(certificates / "ca"))
    async with served(tmp_path, context=context, users=USERS, **files) as page:
        assert page.url.startswith("https://")
        connector = aiohttp.TCPConnector(ssl=trusting)
        async with aiohttp.ClientSession(connector=connector) as browser:
            url = page.url.replace("127.0.0.1", "localhost")
            async with browser.get(f"{url}/api/site") as response:
                assert response.status == 200
                assert response.headers["Strict-Transport-Security"].startswith("max-age=")
                (cookie,) = SimpleCookie(response.headers["Set-Cookie"]).values()
                assert cookie.key == "__Host-cellwatt-0"
                assert cookie["secure"] is True


def test_names_of_a_certificate_are_names_of_the_page(certificates: Path) -> None:
    assert "localhost" in names_in(certificates / "cell")
    assert names_in(None) == ()
    assert names_in(certificates / "cell.key") == ()


async def test_a_password_is_in_no_answer_and_no_log(
    browser: aiohttp.ClientSession, page: Served, caplog: pytest.LogCaptureFixture
) -> None:
    caplog.set_level("DEBUG")
    await log_in(browser, page.url, "ada", "wrong horse")
    await log_in(browser, page.url, "ada")
    async with browser.get(f"{page.url}/api/site") as response:
        told = await response.text()
    for secret in (PASSWORD, "wrong horse", HASH):
        assert secret not in caplog.text
        assert secret not in told
