"""``cellwatt watch`` towards cells that answer, over TLS and without, and towards nobody."""

from __future__ import annotations

import json
import re
import socket
import subprocess
import sys
from collections import Counter
from pathlib import Path

import pytest

from cellwatt.commands import replay, watch
from cellwatt.results import Prediction
from cellwatt.subscriber import Message
from tests.daemon.commands.calling import Call, call
from tests.daemon.outlets.zenoh.fake_cell import CELL, SITE
from tests.daemon.outlets.zenoh.processes import Child, free_port
from tests.daemon.outlets.zenoh.test_link import certificates

__all__ = ["call", "certificates"]

SECONDS = ("--json", "--seconds", "3", "--topic", "health")


QUICKLY = ("--patience", "0.5")


@pytest.fixture
def hurried(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("cellwatt.outlets.zenoh.link._ATTEMPT", 0.2)


def test_a_dead_address_is_one_line_and_an_error(call: Call, hurried: None) -> None:
    endpoint = f"tcp/127.0.0.1:{free_port()}"
    ended = call("watch", "--connect", endpoint, "--site", SITE, "--cell", CELL, *QUICKLY, "--json")
    assert ended == (3, "", f"cellwatt: {endpoint}: no answer (connection refused)\n")


def test_another_name_is_told_the_cells_that_are_there(call: Call, live: tuple[Child, str]) -> None:
    ended = call("watch", "--connect", live[1], "--site", SITE, "--cell", "weld-9", "--patience", "3")
    assert ended == (3, "", f"cellwatt: {live[1]}: no cell {SITE}/weld-9 is on the bus; it has {SITE}/{CELL}\n")


def test_without_a_cell_all_of_the_site_are_listed(call: Call, live: tuple[Child, str]) -> None:
    where = ("watch", "--connect", live[1], "--site", SITE)
    told = json.loads(call(*where, "--json").out)
    assert (told["cell"], told["state"], told["sources"], told["alarms"]) == (CELL, "green", 0, [])
    ended = call(*where)
    assert (ended.code, ended.err) == (0, "")
    assert ended.out == f"{CELL} is green: 0 of 0 sources ok, 0 samples received, 0 lost, no alarm\n"
    assert call(*where, "--verify", __file__).code == 2, "the key of one cell says nothing of the others"
    other = call("watch", "--connect", live[1], "--site", "plant-9", "--json")
    assert other == (3, "", "cellwatt: no cell of site plant-9 is heard\n")


def test_where_no_zenoh_answers_it_says_what_to_check(call: Call, hurried: None) -> None:
    with socket.create_server(("127.0.0.1", 0)) as mute:
        endpoint = f"tcp/127.0.0.1:{mute.getsockname()[1]}"
        ended = call("watch", "--connect", endpoint, "--site", SITE, "--cell", CELL, *QUICKLY)
    assert (ended.code, ended.out, ended.err.count("\n")) == (3, "", 1)
    assert ended.err.startswith(f"cellwatt: {endpoint}: the port answers but refuses the session: check user and")


def test_it_prints_lines(call: Call, live: tuple[Child, str]) -> None:
    live[0].send(alarm={"number": 7})
    ended = call("watch", "--connect", live[1], "--site", SITE, "--cell", CELL, "--seconds", "2")
    assert (ended.code, ended.err) == (0, "")
    assert "error: Joint 7 needs more power than it should." in ended.out
    # Red by the alarm, where that came before the first line on how the cell stands.
    assert re.search(rf"{SITE}/{CELL} is (red|green): 0 of 0 sources ok", ended.out)
    only = call("watch", "--connect", live[1], "--site", SITE, "--cell", CELL, "--topic", "alarm", "--seconds", "1")
    assert "error: Joint 7 needs" in only.out
    assert "is green" not in only.out


def test_it_waits_for_a_cell_as_long_as_it_takes(live: tuple[Child, str]) -> None:
    """Nobody answers at first; it says so once, and goes on when the cell is there."""
    port = free_port()
    endpoint = f"tcp/127.0.0.1:{port}"
    command = [sys.executable, "-m", "cellwatt.commands", "watch"]
    how = ["--connect", endpoint, "--site", SITE, "--cell", CELL, "--json", "--topic", "health", "--wait", *QUICKLY]
    watching = subprocess.Popen([*command, *how], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    assert watching.stdout is not None
    assert watching.stderr is not None
    try:
        assert watching.stderr.readline() == f"waiting: {endpoint}: no answer (connection refused)\n"
        with Child("cell_process", listen=[endpoint]) as cell:
            cell.ready()
            assert json.loads(watching.stdout.readline())["kind"] == "health"
    finally:
        watching.kill()
        watching.communicate()


def test_a_cell_over_tls(call: Call, certificates: Path) -> None:
    endpoint = f"tls/localhost:{free_port()}"
    files = {"root_ca": "ca", "certificate": "cell", "key": "cell.key"}
    tls = {name: str(certificates / file) for name, file in files.items()}
    viewer = ("--ca", tls["root_ca"], "--certificate", tls["certificate"], "--key", tls["key"])
    with Child("cell_process", listen=[endpoint], tls=tls) as cell:
        cell.ready()
        ended = call("watch", "--connect", endpoint, "--site", SITE, "--cell", CELL, *viewer, *SECONDS)
        assert (ended.code, ended.err) == (0, "")
        assert "health" in [json.loads(line)["kind"] for line in ended.out.splitlines()]
        strange = ("--ca", tls["certificate"])  # an authority that has not signed the cell's certificate
        refused = call("watch", "--connect", endpoint, "--site", SITE, "--cell", CELL, *strange, *QUICKLY)
        assert (refused.code, refused.out, refused.err.count("\n")) == (3, "", 1)
        assert "refuses the session: check user and password, the certificates" in refused.err


def test_json_has_null_where_there_is_no_number(capsys: pytest.CaptureFixture[str]) -> None:
    """``NaN`` is no JSON: other programs stop at it."""
    missing = Prediction("power", 7, (1,), {"supply.power": (float("nan"),)}, {"supply.power": "W"})
    watch._print_json([Message("prediction/power", 1, 7, False, missing)])
    list(replay._shown([missing], Counter(), as_json=True))
    watched, replayed = map(json.loads, capsys.readouterr().out.replace("NaN", "not JSON").splitlines())
    assert watched["content"]["outputs"] == replayed["outputs"] == {"supply.power": [None]}
