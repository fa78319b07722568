"""Two plants and headquarters in network namespaces: routers with TLS, cells behind NAT, lines that are cut."""

from __future__ import annotations

import subprocess
import time
from itertools import accumulate
from pathlib import Path

import pytest

from tests.daemon.outlets.zenoh.plants import network, trial
from tests.daemon.outlets.zenoh.plants.network import PORT
from tests.daemon.outlets.zenoh.test_link_cut import reached, received
from tests.patience import PATIENCE

REASON = network.missing()
pytestmark = [pytest.mark.skipif(REASON is not None, reason=str(REASON)), pytest.mark.timeout(4 * PATIENCE)]


def reaches(net: network.Network, place: str, address: str, port: int = PORT) -> bool:
    """Whether a TCP connection comes about."""
    code = f"import socket; socket.create_connection(({address!r}, {port}), 1.0)"
    return subprocess.run([*net.inside(place), "python3", "-c", code], capture_output=True, check=False).returncode == 0


def test_nobody_reaches_a_cell_and_cells_reach_their_router_alone(tmp_path: Path) -> None:
    with trial.plants(tmp_path) as running:
        cell, consumer = running.cell(1), running.consumer(1)
        running.ready(consumer)
        assert reaches(running.net, "cell1", "10.88.0.1")
        assert not reaches(running.net, "hq", "192.168.0.2", 22)
        assert not reaches(running.net, "plant1", "192.168.0.2", 22)
        cell.publish(100.0)
        consumer.until(lambda: reached(consumer, trial.RAW, 50), "half a second of samples")
        made = cell.answer("published", halt=True)
        trial.caught_up(consumer, made)
        trial.assert_whole(consumer, made)


@pytest.mark.slow
def test_a_cut_longer_than_the_lease_on_a_narrow_line_with_a_limit(tmp_path: Path) -> None:
    """The links are given up and made anew; the past comes within its limit, and live data beside it.

    The other plant goes on, and both get everything.
    """
    limit, patience = 300e3, 2 * PATIENCE
    with trial.plants(tmp_path) as running:
        cells = [running.cell(n, backfill="300 kB/s") for n in network.PLANTS]
        consumers = [running.consumer(n) for n in network.PLANTS]
        board = running.board(1)
        running.ready(*consumers)
        for cell in cells:
            cell.publish(2000.0)
        for consumer in consumers:
            trial.begun(consumer)
        running.net.narrow(1, 1.2e6)
        time.sleep(1.0)
        running.net.cut(1)
        time.sleep(12.0)
        live = board.said[-1]["live"]
        running.net.restore(1)
        back = time.monotonic()
        trial.caught_up(consumers[0], cells[0].answer("published", tell=True), patience)
        caught, live = time.monotonic() - back, board.said[-1]["live"] - live
        time.sleep(1.0)
        made = [cell.answer("published", halt=True) for cell in cells]
        for consumer, whole in zip(consumers, made, strict=True):
            trial.caught_up(consumer, whole, patience)
            trial.assert_whole(consumer, whole)
        late = sum(m["count"] for m in received(consumers[0], trial.RAW) if m["backfilled"])
        account = cells[0].answer("account", account=True)
    assert made[0]["samples"] >= 20_000 and late > 15_000
    assert account["residue"] == 0 and account["dropped"] == {}
    assert account["counters"]["answers held back"] > 0
    assert account["counters"]["bytes of the past"] < limit * (caught + 20.0)
    assert live > 0  # live data came before the past was all there


@pytest.mark.slow
def test_a_gate_that_swallows_packets_in_silence(tmp_path: Path) -> None:
    with trial.plants(tmp_path) as running:
        cell, consumer = running.cell(2), running.consumer(2)
        running.ready(consumer)
        cell.publish(500.0)
        trial.begun(consumer)
        running.net.swallow(2)
        before = cell.answer("published", tell=True)["samples"]
        consumer.until(lambda: cell.answer("published", tell=True)["samples"] > before + 6000, "12 s")
        running.net.pass_again(2)
        made = cell.answer("published", halt=True)
        trial.caught_up(consumer, made, 2 * PATIENCE)
        trial.assert_whole(consumer, made)


@pytest.mark.slow
def test_what_the_record_no_longer_has_is_told_as_lost(tmp_path: Path) -> None:
    """The disk budget is spent during the cut: what is gone is told, with its count, and the rest comes."""
    with trial.plants(tmp_path) as running:
        cell, consumer = running.cell(1, file_size="60 kB", keep="1 MB"), running.consumer(1)
        running.ready(consumer)
        cell.publish(50.0)
        trial.begun(consumer)
        cell.answer("published", halt=True)
        running.net.cut(1)
        past = cell.answer("published", 4 * PATIENCE, samples=86_400)
        cell.publish(50.0)
        time.sleep(12.0)
        running.net.restore(1)
        trial.caught_up(consumer, past, 4 * PATIENCE)
        made = cell.answer("published", halt=True)
        trial.caught_up(consumer, made, 4 * PATIENCE)
        raw = received(consumer, trial.RAW)
    assert [m["first"] for m in raw] == [0, *accumulate(m["count"] for m in raw[:-1])], "each sample once"
    lost = [m for m in raw if "gap" in m]
    assert {m["gap"] for m in lost} == {"no longer in the record of the cell"}
    assert sum(m["count"] for m in lost) > 1000
    assert all(m["values"] == [*range(m["first"], m["first"] + m["count"])] for m in raw if "gap" not in m)
    # All that the record still had came: it is more than a tenth of what the cell made.
    assert sum(m["count"] for m in raw if "gap" not in m) > 0.1 * made["samples"]
