"""The example of docs/outlets/zenoh.md for an untrusted network, as it is printed: real sessions, attacks on it."""

from __future__ import annotations

import asyncio
import re
import shlex
import sys
from collections.abc import AsyncIterator, Iterator
from contextlib import ExitStack, asynccontextmanager, contextmanager
from datetime import UTC, datetime, timedelta
from itertools import count
from pathlib import Path
from typing import Any

import pytest
import yaml
import zenoh

from cellwatt import OutletError
from cellwatt.commands.secure import command
from cellwatt.door.certificates import Pair, issue, new_authority
from cellwatt.outlets.zenoh import ZenohOutlet, ZenohSettings
from cellwatt.outlets.zenoh.link import LinkSettings, TlsSettings, open_session
from cellwatt.subscriber import Subscriber
from tests.calling import called
from tests.daemon.outlets.zenoh.fake_cell import CELL, SITE, FakeView, alarm, batch
from tests.daemon.outlets.zenoh.processes import ROOT, free_port
from tests.daemon.outlets.zenoh.serving import serving
from tests.daemon.outlets.zenoh.test_processes import programs
from tests.patience import PATIENCE, eventually

PAGE = (ROOT / "docs" / "outlets" / "zenoh.md").read_text()
SECTION = PAGE[PAGE.index("## On a network that you do not trust") : PAGE.index("## Signatures")]
EXAMPLE = re.findall(r"^cellwatt secure (.*)$", SECTION, re.MULTILINE)
PROGRAM = next(p for p in programs("outlets/zenoh.md") if "anna/zenoh.yaml" in p)
ALARMS = f"cellwatt/{SITE}/{CELL}/alarm/**"
FORGED = f"cellwatt/{SITE}/{CELL}/alarm/error/joint_fault"


def secure(*arguments: str, folder: Path | None = None) -> str:
    """Calls ``cellwatt secure``; what goes wrong is raised."""
    return called(command, *arguments, *(["--in", folder] if folder else []))


class Site:
    """A folder that the example made, and links of its members; files name their port, which is given out late."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.port = free_port()

    def text(self, path: str) -> str:
        """A file of the example, with the port of this test."""
        names = "|".join(p.name for p in self.folder.iterdir() if p.is_dir())
        text = (self.folder / path).read_text().replace("7447", str(self.port)).replace("0.0.0.0", "127.0.0.1")
        return re.sub(rf"\b({names})/(?=\w+\.(pem|key|pub))", rf"{self.folder}/\1/", text)

    def settings(self, member: str) -> dict[str, Any]:
        found: dict[str, Any] = yaml.safe_load(self.text(f"{member}/zenoh.yaml"))["zenoh"]
        return found

    def link(self, member: str) -> LinkSettings:
        return LinkSettings(**{k: v for k, v in self.settings(member).items() if k != "sign"})

    def authority(self) -> Pair:
        return Pair(*((self.folder / "private" / name).read_bytes() for name in ("ca.pem", "ca.key")))

    def session(self, member: str) -> zenoh.Session:
        return open_session(self.link(member), patience=PATIENCE)

    @contextmanager
    def sessions(self, *members: str) -> Iterator[list[zenoh.Session]]:
        with ExitStack() as stack:
            yield [stack.enter_context(self.session(member)) for member in members]

    @contextmanager
    def router(self) -> Iterator[None]:
        """``zenohd`` in this process: the same router, with the file that was written for it."""
        file = self.folder / "plant-router" / "run.json5"
        file.write_text(self.text("plant-router/zenohd.json5"))
        with zenoh.open(zenoh.Config.from_file(str(file))):
            yield

    @asynccontextmanager
    async def cell(self, name: str = CELL) -> AsyncIterator[ZenohOutlet]:
        view = FakeView(cell=name)
        view.record(batch(0, 100))
        outlet = ZenohOutlet("zenoh", ZenohSettings(**self.settings(name)), view)
        async with serving(outlet):
            yield outlet


def make(folder: Path, monkeypatch: pytest.MonkeyPatch, lines: list[str] = EXAMPLE) -> Site:
    """Run the example's commands as they are printed; only the router's name is one that this PC has."""
    monkeypatch.chdir(folder)
    for line in lines:
        secure(*shlex.split(line.replace("--host plant-router", "--host localhost")))
        if line.startswith("init"):
            monkeypatch.chdir(folder / "secure")
    return Site(folder / "secure")


@pytest.fixture
def site(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Site:
    return make(tmp_path, monkeypatch)


@pytest.fixture
def router(site: Site) -> Iterator[Site]:
    with site.router():
        yield site


def test_the_page_prints_the_settings_that_are_written(site: Site) -> None:
    written = (site.folder / "weld-3" / "zenoh.yaml").read_text().replace("localhost", "plant-router")
    assert written in re.sub(r"^ {4}", "", SECTION, flags=re.MULTILINE)


async def test_the_program_of_the_page_hears_the_cell(router: Site) -> None:
    (router.folder / "anna" / "zenoh.yaml").write_text(router.text("anna/zenoh.yaml"))
    program = router.folder / "program.py"
    program.write_text(PROGRAM)
    async with router.cell() as outlet:
        run = await asyncio.create_subprocess_exec(
            sys.executable, "-u", str(program), cwd=router.folder, stdout=asyncio.subprocess.PIPE
        )
        assert run.stdout is not None
        line = asyncio.create_task(run.stdout.readline())
        raised = count()
        try:
            await eventually(lambda: outlet.offer(alarm(next(raised))) or line.done(), "a line of the program")
            assert re.match(rb"alarm \d+ Alarm\(id='alarm-\d+'", line.result())
        finally:
            run.kill()
            await run.communicate()


async def test_a_viewer_cannot_speak_in_the_cells_name(router: Site) -> None:
    """An alarm that a viewer, another cell or a name without rights puts under a cell's key reaches nobody."""
    secure("viewer", "dora", folder=router.folder)  # its certificate is good, the running router has no rule for it
    got: list[bytes] = []
    with router.sessions("andon", "weld-3", "anna", "andon", "weld-4", "dora") as (listener, owner, *attackers):
        listener.declare_subscriber(ALARMS, lambda sample: got.append(sample.payload.to_bytes()))

        def put_all() -> bool:
            for i, attacker in enumerate(attackers):
                attacker.put(FORGED, f"forged {i}")
            owner.put(FORGED, "genuine")
            return len(got) >= 20

        await eventually(put_all, "what the owner of the key puts")
    assert set(got) == {b"genuine"}


async def test_nobody_but_the_cell_answers_for_it(router: Site) -> None:
    question = f"cellwatt/{SITE}/{CELL}/@/status"
    with router.sessions("anna", "anna", "andon", "weld-4") as (asking, *attackers):
        for attacker in attackers:
            attacker.declare_queryable(question, lambda q: q.reply(question, b"forged"))
        async with router.cell():
            await eventually(lambda: answers(asking, question), "the cell's answer")
            found = [a for _ in range(5) for a in answers(asking, question)]
    assert found
    assert not [a for a in found if a == b"forged"]


def answers(session: zenoh.Session, question: str) -> list[bytes]:
    return [r.ok.payload.to_bytes() for r in session.get(question, timeout=1.0) if r.ok is not None]


async def test_what_each_may_see_and_ask(router: Site) -> None:
    secure("viewer", "dora", folder=router.folder)
    roots = {cell: f"cellwatt/{SITE}/{cell}" for cell in ("weld-3", "weld-4")}
    names = ("anna", "andon", "weld-3", "dora")
    seen: dict[str, set[str]] = {name: set() for name in names}
    answered: dict[str, list[str]] = {}
    with router.sessions(*names) as sessions:
        members = dict(zip(names, sessions, strict=True))
        for name, session in members.items():
            for root in roots.values():
                session.declare_subscriber(f"{root}/health", lambda s, n=name: seen[n].add(str(s.key_expr)))
        async with router.cell("weld-3"), router.cell("weld-4"):
            await eventually(
                lambda: len(seen["andon"]) == 2 and seen["anna"] and seen["weld-3"], "health of both cells"
            )
            await eventually(lambda: answers(members["anna"], f"{roots['weld-3']}/@/status"), "an answer")
            for name, session in members.items():
                answered[name] = [cell for cell, root in roots.items() if answers(session, f"{root}/@/status")]
    assert {name: {key.split("/")[2] for key in keys} for name, keys in seen.items()} == {
        "anna": {"weld-3"},
        "andon": {"weld-3", "weld-4"},
        "weld-3": {"weld-3"},
        "dora": set(),
    }
    assert answered == {"anna": ["weld-3"], "andon": [], "weld-3": ["weld-3"], "dora": []}


def stranger(site: Site, what: str) -> TlsSettings:
    """TLS settings of somebody who must not get in."""
    ours, now = site.authority(), datetime.now(UTC)
    own = {"certificate": site.folder / "certificate", "key": site.folder / "key"}
    if what == "none":
        return TlsSettings(root_ca=site.folder / "anna" / "ca.pem")
    signed = (ours, now - timedelta(days=400)) if what == "expired" else (new_authority(SITE, now), now)
    made = issue(signed[0], "anna", (), signed[1])
    own["certificate"].write_bytes(made.certificate)
    own["key"].write_bytes(made.key)
    return TlsSettings(root_ca=site.folder / "anna" / "ca.pem", **own)


@pytest.mark.parametrize("what", ["none", "expired", "foreign"])
def test_without_a_right_certificate_there_is_no_link(router: Site, what: str) -> None:
    link = router.link("anna").model_copy(update={"tls": stranger(router, what)})
    with pytest.raises(OutletError, match="refuses the session: check user and password, the certificates"):
        open_session(link, patience=0.5)


def test_a_members_certificate_cannot_pose_as_the_router(site: Site) -> None:
    """Its certificate does not say that it may serve."""
    own = site.link("anna").tls
    assert own is not None
    fake = LinkSettings(mode="router", listen=(f"tls/127.0.0.1:{site.port}",), tls=own)
    link = site.link("weld-3")
    assert link.tls is not None
    victim = link.model_copy(update={"tls": link.tls.model_copy(update={"verify_name": False})})
    with open_session(fake), pytest.raises(OutletError, match="refuses the session"):
        open_session(victim, patience=0.5)


async def test_a_link_ends_with_its_certificate(router: Site) -> None:
    soon = issue(router.authority(), "anna", (), datetime.now(UTC), days=4 / 86400)
    (router.folder / "anna" / "cert.pem").write_bytes(soon.certificate)
    (router.folder / "anna" / "key.pem").write_bytes(soon.key)
    with router.session("anna") as session:
        assert list(session.info.routers_zid())
        await eventually(lambda: not list(session.info.routers_zid()), "the end of the link")


async def test_a_cell_that_listens_itself(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    lines = ["init secure --site plant-1", "cell weld-3 --host localhost", "viewer anna", "viewer andon --live-only"]
    site = make(tmp_path, monkeypatch, lines)
    assert "access_control" in site.settings("weld-3")["options"]
    written = yaml.safe_load((site.folder / "weld-3" / "zenoh.yaml").read_text())["zenoh"]
    assert written["listen"] == ["tls/0.0.0.0:7447"]
    assert ZenohSettings(**written).open is False  # the network is let in with TLS and rules alone
    got: list[bytes] = []
    async with site.cell() as outlet, Subscriber(SITE, CELL, site.link("anna"), want=("alarm",)) as cell:
        with site.session("andon") as listener, site.session("anna") as attacker:
            listener.declare_subscriber(ALARMS, lambda sample: got.append(sample.payload.to_bytes()))
            raised, first = count(), asyncio.create_task(asyncio.to_thread(cell.receive, PATIENCE))
            speak = lambda: attacker.put(FORGED, "forged") or outlet.offer(alarm(next(raised)))  # noqa: E731
            await eventually(lambda: speak() or first.done(), "an alarm at the viewer")
            await eventually(lambda: got, "alarms at the other viewer")
            assert answers(attacker, f"cellwatt/{SITE}/{CELL}/@/status")
            assert not answers(listener, f"cellwatt/{SITE}/{CELL}/@/status")
        link = site.link("anna").model_copy(update={"tls": stranger(site, "foreign")})
        with pytest.raises(OutletError, match="refuses the session"):
            await asyncio.to_thread(open_session, link, patience=0.5)
    assert b"forged" not in got
