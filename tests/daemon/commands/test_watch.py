"""``cellwatt watch`` towards cells that answer, over TLS and without, and towards nobody."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from tests.daemon.commands.calling import Call, call
from tests.daemon.publish.fake_cell import CELL, SITE
from tests.daemon.publish.processes import Child, free_port
from tests.daemon.publish.test_link import certificates

__all__ = ["call", "certificates"]

SECONDS = ("--json", "--seconds", "3", "--topic", "health")


@pytest.mark.parametrize("seconds", [(), ("--seconds", "0.5")])
def test_a_dead_address_is_one_line_and_an_error(
    call: Call, monkeypatch: pytest.MonkeyPatch, seconds: tuple[str, ...]
) -> None:
    monkeypatch.setattr("cellwatt.publish.link._ATTEMPTS", (0.2, 0.2))
    monkeypatch.setattr("cellwatt.publish.link.PATIENCE", 0.5)
    endpoint = f"tcp/127.0.0.1:{free_port()}"
    ended = call("watch", "--connect", endpoint, "--site", SITE, "--cell", CELL, *seconds)
    assert ended.code == 3
    assert ended.err == f"cellwatt: {endpoint}: nobody answers (connection refused)\n"


def health(out: str) -> list[str]:
    return [json.loads(line)["kind"] for line in out.splitlines()]


def test_a_cell_over_tls(call: Call, certificates: Path) -> None:
    endpoint = f"tls/localhost:{free_port()}"
    files = {"root_ca": "ca", "certificate": "cell", "key": "cell.key"}
    tls = {name: str(certificates / file) for name, file in files.items()}
    viewer = ("--ca", tls["root_ca"], "--certificate", tls["certificate"], "--key", tls["key"])
    with Child("cell_process", listen=[endpoint], tls=tls) as cell:
        cell.ready()
        ended = call("watch", "--connect", endpoint, "--site", SITE, "--cell", CELL, *viewer, *SECONDS)
        assert (ended.code, ended.err) == (0, "")
        assert "health" in health(ended.out)
