"""Two plants and headquarters in network namespaces: routers with TLS, cells behind NAT, lines that are cut."""

from __future__ import annotations

import subprocess
import time
from pathlib import Path
from typing import Any

import pytest

from tests.daemon.outlets.zenoh.plants import network, trial
from tests.daemon.outlets.zenoh.plants.network import PORT
from tests.patience import PATIENCE

REASON = network.missing()
pytestmark = [pytest.mark.skipif(REASON is not None, reason=str(REASON)), pytest.mark.timeout(4 * PATIENCE)]


def assert_whole(found: dict[str, Any], due: int) -> None:
    """Everything that the cell made came once, in order, with its own values."""
    assert found["due"] == found["got"] >= due, found
    assert {found[what] for what in ("told as lost", "holes", "twice", "wrong")} == {0}, found


def reaches(net: network.Network, place: str, address: str, port: int = PORT) -> bool:
    """Whether a TCP connection comes about."""
    code = f"import socket; socket.create_connection(({address!r}, {port}), 1.0)"
    return subprocess.run([*net.inside(place), "python3", "-c", code], capture_output=True, check=False).returncode == 0


def test_nobody_reaches_a_cell_and_cells_reach_their_router_alone(tmp_path: Path) -> None:
    with trial.plants(tmp_path) as running:
        cell, recorder = running.cell(1, 100.0), running.consumer(1)
        running.ready()
        assert reaches(running.net, "cell1", "10.88.0.1")
        assert not reaches(running.net, "hq", "192.168.0.2", 22)
        assert not reaches(running.net, "plant1", "192.168.0.2", 22)
        cell.send(run=None)
        trial.begun(recorder)  # its interest has come through both routers
        recorder.until(lambda: trial.topics(recorder)[trial.RAW]["count"] >= 50, "half a second of samples")
        made = cell.answer("ran", halt=True)
        trial.caught_up(recorder, made, PATIENCE)
        assert_whole(trial.judged(recorder, made), 50)


@pytest.mark.slow
def test_a_line_that_is_cut_loses_nothing_and_the_other_plant_does_not_notice(tmp_path: Path) -> None:
    found = trial.cut_and_catch_up(tmp_path, 1.5, 500.0, before=0.3, after=0.3, patience=PATIENCE)
    cut_off, other = found["plants"]
    assert_whole(cut_off, 700)
    assert_whole(other, 700)
    account = found["cell"]["account"]
    assert account["residue"] == 0
    assert account["dropped"] == {}


@pytest.mark.slow
def test_a_cut_longer_than_the_lease_on_a_narrow_line_with_a_limit(tmp_path: Path) -> None:
    """The links are given up and made anew; the past comes within its limit, and live data beside it."""
    limit = 300e3
    found = trial.cut_and_catch_up(
        tmp_path, 12.0, 2000.0, line=1.2e6, backfill="300 kB/s", before=1.0, after=1.0, patience=2 * PATIENCE
    )
    for plant in found["plants"]:
        assert_whole(plant, 20_000)
    counters = found["cell"]["account"]["counters"]
    assert found["plants"][0]["backfilled"] > 15_000
    assert counters["answers held back"] > 0
    assert counters["bytes of the past"] < limit * (found["caught_up_s"] + 20.0)
    assert found["live"] > 0  # live data came before the past was all there


@pytest.mark.slow
def test_a_gate_that_swallows_packets_in_silence(tmp_path: Path) -> None:
    with trial.plants(tmp_path) as running:
        cell, recorder = running.cell(2, 500.0), running.consumer(2)
        running.ready()
        cell.send(run=None)
        trial.begun(recorder)
        running.net.swallow(2)
        before = cell.answer("told", tell=True)["samples"]
        recorder.until(lambda: cell.answer("told", tell=True)["samples"] > before + 6000, "12 s")
        running.net.pass_again(2)
        made = cell.answer("ran", halt=True)
        trial.caught_up(recorder, made, 2 * PATIENCE)
        assert_whole(trial.judged(recorder, made), 6000)


@pytest.mark.slow
def test_what_the_record_no_longer_has_is_told_as_lost(tmp_path: Path) -> None:
    """The disk budget is spent during the cut: what is gone is told, with its count, and the rest comes."""
    with trial.plants(tmp_path) as running:
        cell, recorder = running.cell(1, 1.0, file_size="60 kB", keep="3 MB"), running.consumer(1)
        running.ready()
        cell.send(run=None)
        trial.begun(recorder)
        cell.answer("ran", halt=True)
        running.net.cut(1)
        past = cell.answer("past", 4 * PATIENCE, past=24.0)
        cell.send(run=None)
        time.sleep(12.0)
        running.net.restore(1)
        trial.caught_up(recorder, past, 4 * PATIENCE)
        made = cell.answer("ran", halt=True)
        trial.caught_up(recorder, made, 4 * PATIENCE)
        plant = trial.judged(recorder, made)
    assert plant["due"] == plant["got"] + plant["told as lost"]
    assert plant["told as lost"] > 1000
    assert plant["got"] > 1000
    assert {plant[what] for what in ("holes", "twice", "wrong")} == {0}
    assert list(plant["reasons"]) == ["no longer in the record of the cell"]
    # All that the record still had came: its 3 MB are more than a tenth of what the cell made.
    assert plant["got"] > 0.1 * plant["due"]
