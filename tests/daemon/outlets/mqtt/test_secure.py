"""TLS with an authority of our own, certificates and passwords, at a real Mosquitto."""

from __future__ import annotations

import ssl
import subprocess
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

import pytest

from cellwatt.errors import OutletError
from tests.daemon.door.made import write_certificates
from tests.daemon.outlets.mqtt.broker import PROGRAM, Broker, ears, needs_mosquitto
from tests.daemon.outlets.mqtt.cell import ROOT, Cell, outlet_of, serving

pytestmark = needs_mosquitto


class Secured(NamedTuple):
    broker: Broker
    folder: Path

    @property
    def url(self) -> str:
        return f"mqtts://127.0.0.1:{self.broker.port}"

    def told(self, **more: Any) -> dict[str, Any]:
        """Settings of an outlet that is let in."""
        names = {"ca": "ca", "certificate": "cell", "key": "cell.key"}
        return {k: str(self.folder / v) for k, v in names.items()} | {"user": "cell", "password": "hush"} | more


@pytest.fixture
def secured(tmp_path: Path, certificates: Path) -> Iterator[Secured]:
    passwords = tmp_path / "passwords"
    passwords.write_text("")
    tool = Path(PROGRAM or "").parent.parent / "bin" / "mosquitto_passwd"
    if not tool.exists():
        pytest.skip("the program mosquitto_passwd is not installed")
    subprocess.run([tool, "-b", passwords, "cell", "hush"], check=True, capture_output=True)
    broker = Broker(
        tmp_path,
        f"cafile {certificates}/ca",
        f"certfile {certificates}/cell",
        f"keyfile {certificates}/cell.key",
        "require_certificate true",
        "allow_anonymous false",
        f"password_file {passwords}",
    )
    broker.start()
    yield Secured(broker, certificates)
    broker.kill()


async def test_rows_arrive_through_tls_with_certificate_and_password(secured: Secured) -> None:
    cell = Cell()
    outlet = outlet_of(cell, secured.url, **secured.told())
    context = ssl.create_default_context(cafile=secured.folder / "ca")
    context.load_cert_chain(secured.folder / "cell", secured.folder / "cell.key")
    async with (
        ears(secured.broker, f"{ROOT}/#", username="cell", password="hush", tls_context=context) as heard,
        serving(outlet, cell),
    ):
        await heard.until(f"{ROOT}/availability")
        outlet.offer(cell.frames(5))
        await heard.until(f"{ROOT}/frame", 5)


@pytest.mark.parametrize(
    ("more", "words"),
    [
        ({"password": "wrong"}, "the broker reports: not authorized; check user and password"),
        ({"ca": "ca"}, "its certificate is not trusted: .*"),
        ({"ca": "none.pem"}, "ca: .*none.pem cannot be read: No such file"),
        ({"certificate": None, "key": None}, "the broker closed the connection"),
    ],
)
async def test_whom_the_broker_or_we_do_not_trust_is_told_why(
    secured: Secured, tmp_path: Path, more: dict[str, Any], words: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    write_certificates(tmp_path)  # of another authority
    monkeypatch.setattr("cellwatt.outlets.mqtt.link.ANSWER", 1.0)
    told = {k: str(tmp_path / v) if k == "ca" else v for k, v in more.items()}
    told = {k: v for k, v in secured.told(**told).items() if v is not None}
    with pytest.raises(OutletError, match=words):
        await outlet_of(Cell(), secured.url, **told).run()
