"""Parts of work on local workers: what serial work gives, and nothing of them is left; names of schedulers."""

from __future__ import annotations

import os
import re
import tempfile
from collections.abc import Iterator
from pathlib import Path

import click
import psutil
import pytest
from click.testing import CliRunner

from cellwatt import CellwattError, ConfigError
from cellwatt.commands.options import with_scheduler
from cellwatt.progress import Stage
from cellwatt.scheduler import scheduled, spread, workers
from cellwatt.tables.names import called
from tests.daemon.scheduler import parts
from tests.daemon.scheduler.parts import Item
from tests.left_behind import children


@pytest.fixture(scope="module")
def _local() -> Iterator[None]:
    with scheduled("local:2"):
        spread(abs, [1, 2], "start")
        yield


@pytest.mark.leaves_behind  # connections between those that go on
@pytest.mark.usefixtures("_local")
class TestOnWorkers:
    def test_results_are_those_of_serial_work_in_the_order_of_the_items(self) -> None:
        expected = [parts.spectrum(seed) for seed in range(30)]
        assert spread(parts.spectrum, range(30), "spectra") == expected

    def test_a_users_names_of_columns_are_known_there(self) -> None:
        with called([("tau", "Moment{}")]):
            assert spread(parts.known, ["Moment1", "Moment2", "Other1"], "names") == [True, True, False]
        assert spread(parts.known, ["Moment1", "Moment2"], "names") == [False, False]

    def test_what_is_shared_comes_once_to_each(self) -> None:
        found = spread(parts.scaled, [float(n) for n in range(20)], "scaled", shared={"scale": 2.5})
        assert [value for value, *_ in found] == [2.5 * n for n in range(20)]
        assert len({process for _, process, _ in found} - {os.getpid()}) == len({told[1:] for told in found}) == 2

    def test_the_first_item_that_fails_is_told_though_a_later_one_failed_before(self) -> None:
        with pytest.raises(ConfigError, match=r"^line 4: wrong$") as told:
            spread(parts.fails, range(40), "lines")
        assert [problem.message for problem in told.value.problems] == ["line 4: wrong"]

    def test_a_bug_comes_with_the_place_where_it_is(self) -> None:
        with pytest.raises(ZeroDivisionError) as told:
            spread(parts.breaks, range(4), "numbers")
        assert str(told.value) == "by zero"
        assert "parts.py" in str(told.value.__cause__) and "breaks" in str(told.value.__cause__)

    def test_an_error_that_cannot_be_sent_comes_in_words(self) -> None:
        with pytest.raises(CellwattError, match=r"^OddError: odd 0 1$"):
            spread(parts.odd, range(4), "numbers")

    def test_work_inside_an_item_is_serial(self) -> None:
        assert spread(parts.nested, [1, 2], "outside") == [(True, [1, 1]), (True, [2, 2])]

    def test_linear_algebra_has_one_thread(self) -> None:
        assert spread(parts.threads, [1, 2], "threads") == [1, 1]

    def test_progress_is_told(self) -> None:
        told = Stage("where", 6)
        pool = workers()
        assert pool is not None
        pool.run(parts.where, range(6), None, told)
        assert (told.done, told.name) == (6, "where")

    def test_a_path_means_the_same_as_here(self, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
        (tmp_path / "a").write_bytes(b"1")
        monkeypatch.chdir(tmp_path)
        assert spread(parts.content, [Path("a"), tmp_path / "a"], "files") == [("a", b"1"), (str(tmp_path / "a"), b"1")]

    def test_a_worker_that_is_killed_is_told_with_the_items_it_may_have_had(self, tmp_path: Path) -> None:
        with pytest.raises(CellwattError, match="a worker process was killed: is there enough memory") as told:
            spread(parts.dies, [Item(number, tmp_path) for number in range(8)], "numbers")
        assert re.match(r"numbers, at item [1-4] of 8 \(Item\(number=[0-3], ", str(told.value))
        assert spread(abs, [-1, -2], "after it") == [1, 2]


def test_nothing_is_left_of_local_workers(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    monkeypatch.setenv("OMP_NUM_THREADS", "2")
    monkeypatch.chdir(tmp_path)
    (tmp_path / "signal.py").write_text("raise ImportError('a file of the user stands in for a module')")
    before, others = dict(os.environ), children()
    with scheduled("local:1"):
        assert spread(abs, [-1, -2], "numbers") == [1, 2]
        assert spread(pow, [2, 3], "numbers", shared=2) == [4, 9]
        process = psutil.Process()
        everyone = [process, *process.children(recursive=True)]
        assert not [c for p in everyone for c in p.net_connections() if c.status == psutil.CONN_LISTEN]
    assert dict(os.environ) == before
    assert set(children()) == set(others) and list(tmp_path.iterdir()) == [tmp_path / "signal.py"]


@pytest.mark.parametrize(("text", "count"), [("local", len(os.sched_getaffinity(0))), ("local:3", 3)])
def test_local_workers_start_with_the_first_items_that_are_several(text: str, count: int) -> None:
    others = children()
    with scheduled(text):
        assert spread(abs, [-1], "numbers") == [1]
        assert set(children()) == set(others) and workers()._count == count


@pytest.mark.parametrize("text", ["", "locale", "local:0", "tcp://host:8786"])
def test_the_option_refuses_what_names_none_before_the_command_begins(text: str) -> None:
    @click.command()
    @with_scheduler
    def command() -> None:
        raise AssertionError

    done = CliRunner().invoke(command, ["--scheduler", text])
    assert isinstance(done.exception, ConfigError)
    assert str(done.exception).startswith(f"{text!r} names no scheduler: expected local, or local:2")


def test_without_one_the_work_is_serial(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    with scheduled(None):
        assert spread(pow, [2, 3], "numbers", shared=2) == [4, 9]
        assert spread(str, [Path("a"), Path("b")], "paths") == ["a", "b"]
