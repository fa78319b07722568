"""A whole daemon with passwords in its settings file: nothing that it keeps, publishes, answers or logs holds one."""

from __future__ import annotations

import asyncio
import json
from pathlib import Path
from typing import Any

import pytest

from cellwatt.emulation import EmulatorProcess
from cellwatt.outlets.zenoh.keys import QUESTIONS
from cellwatt.outlets.zenoh.link import open_session
from cellwatt.record import Recording
from tests.system.running import free_port, running
from tests.system.test_daemon import ur
from tests.system.test_one_daemon_a_folder import cellwatt
from tests.system.test_processes import RAW

pytestmark = [pytest.mark.system, pytest.mark.timeout(300)]

SECRET = "hunter2-night-shift"


@pytest.mark.slow
async def test_a_password_in_the_file_is_told_nowhere(tmp_path: Path) -> None:
    async with EmulatorProcess("ur", "--listen", "127.0.0.1:0") as device:
        text = (
            f"# {SECRET}\nsources:\n{ur('arm', device.address)}"
            f"  welder: {{driver: abb, host: 127.0.0.1, port: {free_port()}, password: {SECRET}}}\n"
            f"  other: {{driver: abb, host: 127.0.0.1, port: {free_port()}, egm: [], password: '{SECRET}'}}\n"
        )
        async with running(tmp_path, text) as (daemon, audience):
            await audience.until(lambda a: a.received[RAW] > 100 and len(a.alarms) >= 2)
            daemon.file.write_text(daemon.file.read_text().replace("sources:", "frames: {rate: 25 Hz}\nsources:"))
            daemon.hang_up()
            await audience.until(lambda a: any(e.kind == "reloaded" for e in a.events))
            answers = await asyncio.to_thread(asked, audience._daemon.link)
            _, doctor = await cellwatt("doctor", "--seconds", "1", "--patience", "1", "--json", str(daemon.file))
            assert await daemon.stop() == 0
        assert any('"***"' in answer for answer in answers)
        told = [*answers, json.dumps(audience.status, default=str), repr(audience.alarms), repr(audience.events)]
        told += [daemon.log, doctor]
    recording = Recording.open(tmp_path / "record")
    told += [recording.header.settings, repr(list(recording.events())), repr(list(recording.health()))]
    told += [path.read_bytes().decode("latin-1") for path in recording.paths]
    for text in told:
        assert SECRET not in text
    assert '"***"' in recording.header.settings


def asked(link: Any) -> list[str]:
    """What the daemon answers to every question that one can ask."""
    with open_session(link) as session:
        keys = [f"cellwatt/test/test/{key}" for key in ("**", *(f"@/{question}" for question in QUESTIONS))]
        found = [reply for key in keys for reply in session.get(key, timeout=10)]
        return [reply.ok.payload.to_bytes().decode("latin-1") for reply in found if reply.ok is not None]
