"""A cell whose certificate is renewed while it serves: SIGHUP puts the new one in force, and nothing is lost."""

from __future__ import annotations

import asyncio
import re
import ssl
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from click.testing import CliRunner

from cellwatt.commands.secure import command
from cellwatt.emulation import EmulatorProcess
from cellwatt.subscriber import LinkSettings
from tests.patience import eventually
from tests.system.running import Audience, Daemon, free_port, numbers, ur

pytestmark = [pytest.mark.system, pytest.mark.timeout(120)]


class SecureDaemon(Daemon):
    """A daemon that listens with certificates of ``cellwatt secure``, in whose folder its settings stand."""

    def __init__(self, folder: Path, text: str) -> None:
        self.number = free_port()
        for line in (
            ["init", str(folder), "--site", "test"],
            ["cell", "test", "--host", "localhost"],
            ["viewer", "anna"],
        ):
            self.secure(folder, *line)
        super().__init__(folder, text, self.number)

    @staticmethod
    def secure(folder: Path, *arguments: str) -> None:
        at = [] if arguments[0] == "init" else ["--in", str(folder)]
        CliRunner().invoke(command, [*arguments, *at], catch_exceptions=False, standalone_mode=False)

    def settings(self, member: str) -> dict[str, Any]:
        """What was written for a member, with the port and the folder of this test."""
        text = (self.folder / member / "zenoh.yaml").read_text().replace("7447", str(self.number))
        text = re.sub(
            rf"\b{member}/(?=\w+\.(pem|key|pub))", f"{self.folder}/{member}/", text.replace("0.0.0.0", "127.0.0.1")
        )
        found: dict[str, Any] = yaml.safe_load(text)["zenoh"]
        return found

    def write(self, text: str) -> None:
        zenoh = yaml.safe_dump({"zenoh": self.settings("test")})
        self.file.write_text(f"site: test\ncell: test\n{text}\nrecord: {{folder: {self.folder / 'record'}}}\n{zenoh}")

    @property
    def link(self) -> LinkSettings:
        return LinkSettings(**{k: v for k, v in self.settings("anna").items() if k != "sign"})

    async def served(self) -> bytes:
        """The certificate that whoever connects is shown."""
        anna = self.folder / "anna"
        context = ssl.create_default_context(cafile=str(anna / "ca.pem"))
        context.load_cert_chain(anna / "cert.pem", anna / "key.pem")
        _, writer = await asyncio.open_connection("localhost", self.number, ssl=context)
        shown = writer.get_extra_info("ssl_object").getpeercert(binary_form=True)
        writer.transport.abort()  # an orderly end fails on what the router still sends
        await writer.wait_closed()
        assert shown is not None
        return bytes(shown)


async def test_a_renewed_certificate_is_in_force_after_a_reload_and_nothing_is_lost(tmp_path: Path) -> None:
    async with EmulatorProcess("ur", "--listen", "127.0.0.1:0") as device:
        daemon = SecureDaemon(tmp_path / "plant", f"sources:\n{ur('arm', device.address)}")
        async with daemon, Audience(daemon) as audience:
            await audience.until(lambda a: a.received["raw/arm/rtde"] > 500)
            before = await daemon.served()
            daemon.secure(daemon.folder, "renew", "test")
            assert await daemon.served() == before, "it is the reload that puts it in force"
            daemon.hang_up()

            async def renewed() -> bool:
                try:
                    return await daemon.served() != before
                except OSError:  # between the two listeners
                    return False

            await eventually(renewed, "the renewed certificate")
            got = audience.received["raw/arm/rtde"]
            await audience.until(lambda a: a.received["raw/arm/rtde"] > got + 1000)
            assert not audience.gaps
            assert audience.source("arm")["missed"] == {}, "the device's connection was not touched"
        assert (np.diff(numbers(audience.batches["raw/arm/rtde"])) == 1).all()
