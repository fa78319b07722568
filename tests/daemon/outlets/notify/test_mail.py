"""Mail to a real SMTP server: encrypted or not at all, once, and to all who are to get it."""

from __future__ import annotations

import json
import ssl
import time
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from cellwatt.outlets.notify import courier as module
from cellwatt.outlets.notify.courier import UNDELIVERED
from tests.daemon.outlets.notify.cell import View, alarm, offered, running
from tests.daemon.outlets.notify.servers import Mailbox, mail_server
from tests.patience import eventually


@pytest.fixture(autouse=True)
def _troubled_at_once(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "FAILING", 0.0)


def to(box: Mailbox, **more: Any) -> dict[str, Any]:
    values = {"host": "localhost", "port": box.port, "from": "weld-3@plant.example", "to": ["shift@plant.example"]}
    return {"shift": {"mail": {**values, **more}}}


async def test_starttls_login_and_the_mail_itself(tmp_path: Path, certificates: Path, tls: ssl.SSLContext) -> None:
    async with (
        mail_server(starttls=tls, login=True) as box,
        running(View(tmp_path), to(box, ca=certificates / "ca", user="cell", password="right-password")) as made,
    ):
        await offered(made, alarm(3, statement="Gelenk 3 ist um 12 Nm zu schwer — prüfen"), "shift: sent")
    assert (box.encrypted, box.login) == ([True], "cell")
    ((addresses, mail),) = box.mails
    assert addresses == ["shift@plant.example"]
    assert mail["Subject"] == "[plant-1/weld-3] error: Gelenk 3 ist um 12 Nm zu schwer — prüfen"
    assert mail["From"] == "weld-3@plant.example"
    assert mail["Message-ID"].endswith("@plant.example>")
    assert mail["Auto-Submitted"] == "auto-generated"
    assert "since:    2027-01-15 08:00:00 UTC\njoint:    3 of arm" in mail.get_content().replace("\r\n", "\n")
    assert made.trouble() is None


async def test_a_server_without_starttls_gets_nothing(tmp_path: Path) -> None:
    async with mail_server() as box, running(View(tmp_path), to(box)) as made:
        await offered(made, alarm(1), "shift: retried", 3)
        trouble = str(made.trouble())
    assert "STARTTLS" in trouble
    assert trouble.endswith("nothing is sent unencrypted")
    assert box.mails == []


async def test_a_server_that_nobody_vouches_for_gets_nothing(tmp_path: Path, tls: ssl.SSLContext) -> None:
    for settings in ({"tls": "tls"}, {}):
        server = mail_server(tls=tls) if settings else mail_server(starttls=tls)
        async with server as box, running(View(tmp_path), to(box, **settings)) as made:
            made.offer(alarm(1))
            await eventually(lambda: made.trouble())
            assert "its certificate is not trusted" in str(made.trouble())
        assert box.mails == []
        (tmp_path / "notify.jsonl").unlink()


async def test_a_wrong_password_is_tried_again_and_not_told(
    tmp_path: Path, certificates: Path, tls: ssl.SSLContext
) -> None:
    known = {"ca": certificates / "ca", "user": "cell"}
    async with mail_server(starttls=tls, login=True) as box:
        async with running(View(tmp_path), to(box, **known, password="wrong-password")) as made:
            await offered(made, alarm(1), "shift: retried", 2)
            trouble = str(made.trouble())
        assert "the login as cell is refused: 535" in trouble
        assert "wrong-password" not in trouble
        async with running(View(tmp_path), to(box, **known, password="right-password")) as after:
            await eventually(lambda: box.mails)
            await eventually(lambda: after.account.counters["shift: sent"])


async def test_an_address_that_defers_or_is_refused_holds_up_no_other(tmp_path: Path) -> None:
    first, late, gone = everybody = [f"{name}@plant.example" for name in ("first", "late", "gone")]
    async with mail_server() as box, running(View(tmp_path), to(box, tls="none", to=everybody)) as made:
        box.rcpt = {late: ["452 4.2.2 mailbox full"] * 10_000, gone: ["550 5.1.1 unknown"]}
        await offered(made, alarm(1), "shift: undelivered")
        await eventually(lambda: len(box.mails) == 1)
        made.offer(alarm(2))
        await eventually(lambda: len(box.mails) == 3)
        assert [addresses for addresses, _ in box.mails].count([first]) == 2, "both alarms, though another defers"
        assert f"shift {late} cannot be reached (mail by localhost:{box.port}): 452" in str(made.trouble())
        box.rcpt.clear()
        await eventually(lambda: made.account.counters["shift: sent"] == 5)
    got = sorted((addresses, str(mail["Subject"]).split()[3]) for addresses, mail in box.mails)
    assert got == [([first], "1"), ([first], "2"), ([gone], "2"), ([late], "1"), ([late], "2")]
    reasons = [json.loads(line) for line in (tmp_path / UNDELIVERED).read_text().splitlines()]
    assert [(each["to"], each["reason"]) for each in reasons] == [(f"shift {gone}", "550 5.1.1 unknown")]


async def test_a_server_that_asks_for_a_login_or_tls_is_tried_again(tmp_path: Path) -> None:
    async with mail_server() as box, running(View(tmp_path), to(box, tls="none")) as made:
        box.data = ["530 5.7.0 Must issue a STARTTLS command first"]
        made.offer(alarm(1))
        await eventually(lambda: "does the server require user and password, or tls?" in str(made.trouble()))
        await eventually(lambda: made.account.counters["shift: sent"])
    assert made.account.counters["shift: undelivered"] == 0


async def test_refused_for_good(tmp_path: Path) -> None:
    async with mail_server() as box, running(View(tmp_path), to(box, tls="none")) as made:
        box.data = ["554 5.7.1 looks like spam"]
        await offered(made, alarm(1), "shift: undelivered")
        assert "554 5.7.1 looks like spam" in str(made.trouble())
        await offered(made, alarm(2), "shift: sent")
        assert made.trouble() is None
    assert ["Joint 2" in mail["Subject"] for _, mail in box.mails] == [True]
    assert (tmp_path / UNDELIVERED).stat().st_mode & 0o777 == 0o600


async def test_a_server_that_is_silent_after_the_mail(tmp_path: Path) -> None:
    async with mail_server() as box, running(View(tmp_path), to(box, tls="none"), timeout=0.3) as made:
        box.hang = 1
        await offered(made, alarm(1), "shift: sent")
    assert len(box.mails) == 2  # it took the first and did not say so: the Message-ID shows that they are one
    assert len({mail.as_bytes() for _, mail in box.mails}) == 1


async def test_a_clock_that_is_set_gives_no_message_up(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    async with mail_server() as box, running(View(tmp_path), to(box, tls="none"), give_up=3600.0) as made:
        box.data = ["451 later"]
        years = SimpleNamespace(monotonic=time.monotonic, time_ns=lambda: time.time_ns() + (not box.data) * 10**17)
        monkeypatch.setattr(module, "time", years)
        await offered(made, alarm(1), "shift: sent")
    assert not made.account.counters["shift: undelivered"]


async def test_nobody_there(tmp_path: Path) -> None:
    async with mail_server() as box:
        settings = to(box, tls="none")
    async with running(View(tmp_path), settings, give_up=0.2) as made:
        await offered(made, alarm(1), "shift: undelivered")
        assert "given up after 0.0 h: Connection refused" in str(made.trouble())
    reason = json.loads((tmp_path / UNDELIVERED).read_text())["reason"]
    assert reason.endswith("Connection refused")
