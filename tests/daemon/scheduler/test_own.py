"""A scheduler and workers as processes of their own, some of which die."""

from __future__ import annotations

import signal
from collections.abc import Callable, Iterator
from importlib.metadata import version
from pathlib import Path
from threading import Thread

import pytest

from cellwatt import CellwattError, Event
from cellwatt.scheduler import hosts, scheduled, spread
from tests.daemon.commands.calling import Call, call
from tests.daemon.record.making import SESSION, batch_of, frames_of, stream_of, write_chunks
from tests.daemon.record.test_roundtrip import RESULTS
from tests.daemon.scheduler import parts
from tests.daemon.scheduler.parts import Item
from tests.daemon.scheduler.processes import Scheduler, scheduler
from tests.patience import wait_until

__all__ = ["call"]


@pytest.fixture(scope="module")
def own(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Scheduler]:
    """Two workers with nannies, who start them again."""
    with scheduler(tmp_path_factory.mktemp("own")) as started:
        started.work("--nworkers", "2")
        yield started


@pytest.fixture
def another(tmp_path: Path) -> Iterator[Scheduler]:
    """A scheduler without workers, to be killed."""
    with scheduler(tmp_path) as started:
        yield started


def items(folder: Path, n: int = 8) -> list[Item]:
    return [Item(number, folder) for number in range(n)]


@pytest.fixture
def _when_begun(tmp_path: Path) -> Iterator[Callable[[Callable[[], object]], None]]:
    threads: list[Thread] = []

    def do(what: Callable[[], object]) -> None:
        def then() -> None:
            wait_until((tmp_path / "begun").exists, "the first item")
            what()

        threads.append(Thread(target=then))
        threads[-1].start()

    yield do
    for thread in threads:
        thread.join()


def test_results_are_those_of_serial_work(own: Scheduler) -> None:
    with scheduled(own.address):
        found = spread(parts.spectrum, range(20), "spectra")
    assert found == [parts.spectrum(seed) for seed in range(20)]


def test_a_worker_that_dies_changes_nothing(own: Scheduler, tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    with scheduled(own.address):
        assert spread(parts.dies_once, items(tmp_path), "numbers") == list(range(8))
    assert (tmp_path / "died").exists()
    assert capfd.readouterr() == ("", "")


@pytest.mark.slow
def test_an_item_that_kills_its_workers_is_named(own: Scheduler, tmp_path: Path) -> None:
    with scheduled(own.address):
        with pytest.raises(CellwattError) as told:
            spread(parts.dies, items(tmp_path), "numbers")
        assert spread(abs, [-1, -2], "after it") == [1, 2]
    assert str(told.value).startswith("numbers: item ")
    assert str(told.value).endswith("of it or of one beside it: have they enough memory?")
    assert (tmp_path / "calls").read_text().split().count("3") == 2


def test_workers_that_come_and_go_have_what_is_shared(own: Scheduler, tmp_path: Path) -> None:
    with scheduled(own.address):
        found = spread(parts.dies_once_shared, items(tmp_path), "numbers", shared=10)
    assert found == [10 * number for number in range(8)]


def test_a_scheduler_that_is_killed_ends_the_work_in_one_line(
    another: Scheduler, tmp_path: Path, _when_begun: Callable[..., None], capfd: pytest.CaptureFixture[str]
) -> None:
    worker = another.work("--no-nanny")
    _when_begun(another.process.kill)
    with pytest.raises(CellwattError) as told, scheduled(another.address):
        spread(parts.waits, items(tmp_path), "numbers")
    assert str(told.value) == (
        f"numbers: the scheduler at {another.address} is gone, or has dropped this work: "
        "start it again, then this command"
    )
    assert capfd.readouterr() == ("", "")
    (tmp_path / "over").touch()
    assert worker.poll() is None or worker.returncode is not None


def test_a_ctrl_c_ends_the_work_and_leaves_the_workers(own: Scheduler, tmp_path: Path) -> None:
    with own.python("from tests.daemon.scheduler import parts; parts.command()", own.address, tmp_path) as command:
        wait_until((tmp_path / "begun").exists, "the first item")
        command.send_signal(signal.SIGINT)
        err = command.communicate()[1].decode().splitlines()
    assert (err[-1], command.returncode) == ("KeyboardInterrupt", -signal.SIGINT)
    (tmp_path / "over").touch()
    with scheduled(own.address):
        assert spread(abs, [-1, -2], "after it") == [1, 2]


@pytest.mark.leaves_behind  # the thread of dask's client, which ends with the command
def test_nobody_answers(capfd: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("cellwatt.scheduler.hosts.CONNECT", 0.3)
    expected = "^the scheduler at tcp://127.0.0.1:9 does not answer; start it with: dask scheduler --port 9$"
    with pytest.raises(CellwattError, match=expected), scheduled("tcp://127.0.0.1:9"):
        raise AssertionError
    assert capfd.readouterr() == ("", "")


@pytest.mark.slow
def test_a_scheduler_without_workers_is_told_and_then_one_of_another_version(
    another: Scheduler, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with monkeypatch.context() as patch:
        patch.setattr(hosts, "WORKERLESS", 0.2)
        expected = f"{another.address} has had no worker for .*; start one with: dask worker {another.address}"
        with scheduled(another.address), pytest.raises(CellwattError, match=expected):
            spread(abs, [1, 2], "numbers")
    about = tmp_path / "other" / "cellwatt-0.0.1.dist-info" / "METADATA"
    about.parent.mkdir(parents=True)
    about.write_text("Metadata-Version: 2.1\nName: cellwatt\nVersion: 0.0.1\n")
    another.work("--no-nanny", path=about.parents[1])
    with pytest.raises(CellwattError) as told, scheduled(another.address):
        spread(abs, [1, 2], "numbers")
    ours = version("cellwatt")
    assert str(told.value).startswith("the worker tcp://127.0.0.1:")
    assert str(told.value).endswith(
        f" is refused: it has cellwatt 0.0.1, here is cellwatt {ours}; install the same there"
    )


@pytest.fixture
def recordings(tmp_path: Path) -> Path:
    folder = tmp_path / "recordings"
    folder.mkdir()
    for number in (1, 2):
        first = (number - 1) * 20
        rows = [batch_of(first, 20), frames_of(first, 10)]
        rows.append(batch_of(first, 20, stream=stream_of(2, "meter"), source="supply", device=False))
        write_chunks(folder, [rows, [*RESULTS, Event(SESSION, "arm", "connected", "up")]], number=number)
    return folder


def test_export_writes_the_same_bytes(own: Scheduler, recordings: Path, tmp_path: Path, call: Call) -> None:
    rows = {"arm.rtde.parquet": 40, "supply.meter.parquet": 40, "frames.parquet": 20}
    rows |= {"results.jsonl": 10, "events.jsonl": 2}
    for out, more in (("serial", ()), ("spread", ("--scheduler", own.address))):
        ended = call("export", recordings, "--out", tmp_path / out, "--quiet", *more)
        assert (ended.code, ended.err) == (0, "")
        assert ended.out == "".join(f"{tmp_path / out / name}: {n} rows\n" for name, n in rows.items())
    written = {path.name: path.read_bytes() for path in (tmp_path / "serial").iterdir()}
    assert written.keys() == rows.keys()
    assert {path.name: path.read_bytes() for path in (tmp_path / "spread").iterdir()} == written
    refused = call("export", recordings, "--out", tmp_path / "spread", "--quiet", "--scheduler", own.address)
    assert refused.code == 3
    assert "arm.rtde.parquet is there already: choose another folder" in refused.err
