"""Who gets in: logins, sessions, forged requests, other hosts, and the headers of every answer."""

from __future__ import annotations

import asyncio
import ssl
from collections.abc import AsyncIterator
from http.cookies import SimpleCookie
from pathlib import Path
from typing import Any

import aiohttp
import pytest

from cellwatt.outlets.page.app import FOLDER, names_in
from cellwatt.outlets.page.gate import HEADERS, POLICY, _netlocs
from tests.daemon.outlets.page.cell import (
    API,
    HASH,
    PASSWORD,
    USERS,
    Served,
    Stream,
    client,
    csrf,
    get,
    log_in,
    served,
)

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
async def page() -> AsyncIterator[Served]:
    async with served(users=USERS) as found:
        yield found


async def code_of(browser: aiohttp.ClientSession, url: str, method: str = "GET", **more: Any) -> int:
    async with browser.request(method, url, **more) as response:
        return response.status


# logins -------------------------------------------------------------------------------------------


async def test_nothing_of_the_cell_is_told_without_a_login(browser: aiohttp.ClientSession, page: Served) -> None:
    for path in LOCKED:
        assert await get(browser, page.url + path, 401) == {"error": "log in first"}
    told = await get(browser, f"{page.url}/api/site")
    assert (told["site"], told["cells"], told["user"], told["may_act"]) == (None, [], None, False)
    assert told["login_needed"] is True
    header = await csrf(browser, page.url)
    for what in ("acknowledge", "shelve", "unshelve"):
        body = {"id": "alarm-1", "name": "ada", "note": "", "minutes": 5}
        assert await code_of(browser, f"{page.url}{API}/{what}", "POST", json=body, headers=header) == 401
    assert page.orders == []


async def test_a_login_lasts_until_it_is_ended(browser: aiohttp.ClientSession, page: Served) -> None:
    assert await log_in(browser, page.url, "ada") == 200
    assert await code_of(browser, f"{page.url}{API}/state") == 200
    told = await get(browser, f"{page.url}/api/site")
    assert (told["user"], told["may_act"], told["login_needed"]) == ("ada", True, False)
    assert told["cells"] != []
    stolen = {"Cookie": "; ".join(f"{c.key}={c.value}" for c in browser.cookie_jar)}
    assert await code_of(browser, f"{page.url}{API}/state", headers=stolen) == 200
    header = await csrf(browser, page.url)
    assert await code_of(browser, f"{page.url}/api/logout", "POST", headers=header) == 200
    assert await code_of(browser, f"{page.url}{API}/state") == 401
    async with aiohttp.ClientSession() as thief:
        assert await code_of(thief, f"{page.url}{API}/state", headers=stolen) == 401


async def test_a_logout_ends_the_streams_of_that_login_alone(page: Served) -> None:
    async with client() as mine, client() as other:
        await log_in(mine, page.url, "ada")
        await log_in(other, page.url, "ada")
        async with mine.get(f"{page.url}{API}/stream") as first, other.get(f"{page.url}{API}/stream") as second:
            await code_of(mine, f"{page.url}/api/logout", "POST", headers=await csrf(mine, page.url))
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


async def test_who_may_act_does_so_by_the_name_of_the_login(page: Served) -> None:
    body = {"id": "alarm-1", "name": "somebody else", "note": "seen"}
    for name, code in {"eve": 403, "ada": 200}.items():
        async with client() as browser:
            await log_in(browser, page.url, name)
            own = {**await csrf(browser, page.url), "Origin": page.url, "Sec-Fetch-Site": "same-origin"}
            url, form = f"{page.url}{API}/acknowledge", code if name == "eve" else 415
            assert await code_of(browser, url, "POST", data=body, headers=own) == form, "a form cannot post"
            assert await code_of(browser, url, "POST", json=body, headers=own) == code
    assert page.orders == [{"what": "acknowledge", "alarm": "alarm-1", "name": "ada", "note": "seen"}]


@pytest.mark.parametrize("user", ["ada", "nobody"])
async def test_tries_at_passwords_have_to_wait(browser: aiohttp.ClientSession, page: Served, user: str) -> None:
    header = await csrf(browser, page.url)
    answers = []
    for _ in range(8):
        body = {"name": user, "password": "guess"}
        async with browser.post(f"{page.url}/api/login", json=body, headers=header) as response:
            answers.append((response.status, (await response.json())["error"], response.headers.get("Retry-After")))
    assert answers[:5] == [(401, "wrong name or password", None)] * 5
    assert answers[5][0] == 429
    assert answers[5][1].startswith("too many tries: wait ")
    assert int(str(answers[5][2])) >= 1
    # Behind a proxy on this PC everybody has this address: it must not lock out others.
    assert await log_in(browser, page.url, "ada") == (429 if user == "ada" else 200)
    assert page.page.counts["failed logins"] == 5


async def test_half_a_login_is_none(browser: aiohttp.ClientSession, page: Served) -> None:
    header = await csrf(browser, page.url)
    for body in ({"name": "ada"}, {"name": "ada", "password": 5}, []):
        assert await code_of(browser, f"{page.url}/api/login", "POST", json=body, headers=header) == 400


# forged requests ----------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("origin", "hosts"),
    [
        ("https://Weld-3.plant", ("weld-3.plant", "weld-3.plant:443")),
        ("http://weld-3.plant", ("weld-3.plant", "weld-3.plant:80")),
        ("http://[::1", ()),
    ],
)
def test_a_proxy_may_add_the_port_of_the_scheme_to_the_host(origin: str, hosts: tuple[str, ...]) -> None:
    assert _netlocs(origin) == hosts


async def test_what_another_site_posts_is_refused(browser: aiohttp.ClientSession, page: Served) -> None:
    await log_in(browser, page.url, "ada")
    own, url = await csrf(browser, page.url), f"{page.url}{API}/acknowledge"
    async with client() as other:
        await log_in(other, page.url, "ada")
        proof_of_another = await csrf(other, page.url)
    for headers in (
        proof_of_another,
        {"X-CSRF-Token": "0" * 64},
        {"X-CSRF-Token": "ß"},
        {"Origin": "http://evil.example"},
        {"Origin": "null"},
        {"Origin": "http://[::1"},
        {"Sec-Fetch-Site": "same-site"},
    ):
        body = {"id": "alarm-1", "note": ""}
        assert await code_of(browser, url, "POST", json=body, headers={**own, **headers}) == 403, headers
    assert page.orders == []


async def test_headers_that_are_no_text_are_no_mistake_of_ours(page: Served) -> None:
    for head, code in (
        (b"POST /api/logout HTTP/1.1\r\nHost: 127.0.0.1\r\nCookie: %s=\xff\r\nX-CSRF-Token: \xff\r\n", 403),
        (b"GET /api/site HTTP/1.1\r\nHost: 127.0.0.1\r\nCookie: %s=\xff\r\n", 200),
        (b"GET / HTTP/1.1\r\nHost: elsewhere.exam\xd0ple\r\n", 421),
        (b"GET / HTTP/1.1\r\nHost: 127.0.0.1:1@evil.example\r\n", 421),
    ):
        reader, writer = await asyncio.open_connection(*page.url.removeprefix("http://").split(":"))
        cookie = page.page._gate.cookie.encode()
        writer.write(head.replace(b"%s", cookie) + b"Connection: close\r\nContent-Length: 0\r\n\r\n")
        assert int((await reader.read()).split(b" ")[1]) == code, head
        writer.close()
        await writer.wait_closed()


LOCAL = ("localhost:8480", "[::1]:8480", "LOCALHOST.")
STRANGE = ("evil.example:8480", "192.0.2.1:8480", "localhost.evil.example")


async def test_a_page_of_this_pc_has_no_other_name() -> None:
    async with served() as page, client() as browser:
        for host, code in {**dict.fromkeys(LOCAL, 200), **dict.fromkeys(STRANGE, 421)}.items():
            for path in ("/", f"{API}/state"):
                assert await code_of(browser, page.url + path, headers={"Host": host}) == code, host


async def test_a_page_of_the_network_has_its_names_and_addresses() -> None:
    network = {"listen": "0.0.0.0:0", "open": True, "names": ["weld-3.plant", "HMI"]}
    async with served(**network) as page, client() as browser:
        url = page.url.replace("0.0.0.0", "127.0.0.1")
        for host, code in {"192.0.2.1:80": 200, "weld-3.plant": 200, "hmi": 200, "evil.example": 421}.items():
            assert await code_of(browser, f"{url}/api/site", headers={"Host": host}) == code, host


# headers and TLS ----------------------------------------------------------------------------------


async def test_every_answer_has_its_headers(browser: aiohttp.ClientSession, page: Served) -> None:
    await log_in(browser, page.url, "ada")
    script = next(FOLDER.glob("assets/*.js")).name
    paths = ["/", f"/assets/{script}", "/assets/none", "/favicon.svg", "/none", "/api/site", *LOCKED]
    for path in paths:
        async with browser.get(page.url + path) as response:
            check_headers(response)
    evil = {"Host": "evil.example"}
    for method, path, more, codes in (
        ("POST", "/api/login", {}, (403,)),
        ("GET", "/", evil, (421,)),
        ("OPTIONS", "/api/site", {}, (403, 405)),
    ):
        async with browser.request(method, page.url + path, headers=more) as response:
            assert response.status in codes
            check_headers(response)


def check_headers(response: aiohttp.ClientResponse) -> None:
    got = response.headers
    assert {name: got[name] for name in HEADERS if name != "Cache-Control"} | {"Cache-Control": "no-store"} == HEADERS
    assert got["Server"] == "cellwatt"
    assert "unsafe" not in POLICY
    if response.content_type in ("application/json", "text/event-stream"):
        assert got["Cache-Control"] == "no-store"
    assert "Strict-Transport-Security" not in got


async def test_over_tls_the_browser_is_bound_to_it(certificates: Path) -> None:
    files = {"certificate": certificates / "cell", "key": certificates / "cell.key"}
    trusting = await asyncio.to_thread(ssl.create_default_context, cafile=str(certificates / "ca"))
    async with served(users=USERS, **files) as page:
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
