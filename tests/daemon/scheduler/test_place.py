"""Names of schedulers, and what is said of those that are none."""

from __future__ import annotations

import sys
from pathlib import Path

import click
import pytest
from click.testing import CliRunner

from cellwatt import CellwattError, ConfigError
from cellwatt.commands.scheduling import with_scheduler
from cellwatt.scheduler import scheduled, spread
from cellwatt.scheduler.hosts import PACKAGES, check_versions
from cellwatt.scheduler.place import Place, parse_place


@pytest.mark.parametrize(
    ("text", "place"),
    [
        ("local", Place()),
        ("local:3", Place(workers=3)),
        ("tcp://plant.example:8786", Place("tcp://plant.example:8786")),
        ("tcp://[::1]:8786/", Place("tcp://[::1]:8786")),
        ("tls://10.0.0.2:8786", Place("tls://10.0.0.2:8786")),
    ],
)
def test_names_of_schedulers(text: str, place: Place) -> None:
    assert parse_place(text) == place


@pytest.mark.parametrize(
    "text",
    [
        "",
        "locale",
        "local:0",
        "local:-1",
        "host:8786",
        "http://host:80",
        "tcp://host",
        "tcp://:8786",
        "tcp://host:99999",
    ],
)
def test_what_names_no_scheduler_is_refused(text: str) -> None:
    with pytest.raises(ValueError, match="names no scheduler: expected local, local:2"):
        parse_place(text)
    with pytest.raises(ConfigError, match="names no scheduler"), scheduled(text):
        raise AssertionError


def test_the_option_refuses_it_before_the_command_begins() -> None:
    @click.command()
    @with_scheduler
    def command() -> None:
        raise AssertionError

    done = CliRunner().invoke(command, ["--scheduler", "http://host"])
    assert done.exit_code == 2
    assert "'http://host' names no scheduler: expected local" in done.output


def test_without_one_the_work_is_serial() -> None:
    with scheduled(None):
        assert spread(abs, [-1, -2], "numbers") == [1, 2]
        assert spread(pow, [2, 3], "numbers", shared=2) == [4, 9]


def test_a_missing_package_names_the_extra(monkeypatch: pytest.MonkeyPatch) -> None:
    for name in [name for name in sys.modules if name.startswith("cellwatt.scheduler.hosts")]:
        monkeypatch.delitem(sys.modules, name)
    monkeypatch.setitem(sys.modules, "dask.config", None)
    monkeypatch.setitem(sys.modules, "dask", None)
    expected = r"needs the package dask.*: pip install 'cellwatt\[scale\]'"
    with pytest.raises(ConfigError, match=expected), scheduled("tcp://127.0.0.1:9"):
        raise AssertionError


def test_tls_needs_certificates() -> None:
    expected = r"tls://127\.0\.0\.1:9 needs certificates: set DASK_DISTRIBUTED__COMM__TLS"
    with pytest.raises(ConfigError, match=expected), scheduled("tls://127.0.0.1:9"):
        raise AssertionError


class Told:
    """A client that tells versions."""

    def __init__(self, scheduler: dict[str, str | None], worker: dict[str, str | None]) -> None:
        ours = {"python": "3.11.7.final.0", "cellwatt": "1.2", "numpy": "2.0", "distributed": "2026.8"}
        self._told = {"scheduler": _versions(ours | scheduler), "client": _versions(ours)}
        self._told["workers"] = {"tcp://a:1": _versions(ours), "tcp://b:2": _versions(ours | worker), "tcp://c:3": None}

    def get_versions(self, packages: tuple[str, ...]) -> object:
        assert packages == PACKAGES
        return self._told


def _versions(told: dict[str, str | None]) -> dict[str, object]:
    return {"host": {"python": told["python"]}, "packages": {k: v for k, v in told.items() if k != "python"}}


@pytest.mark.parametrize(
    ("scheduler", "worker", "text"),
    [
        ({}, {"cellwatt": None}, "the worker tcp://b:2 is refused: it has no cellwatt, here is cellwatt 1.2"),
        ({}, {"cellwatt": "1.1"}, "the worker tcp://b:2 is refused: it has cellwatt 1.1, here is cellwatt 1.2"),
        ({}, {"python": "3.13.1.final.0"}, "tcp://b:2 is refused: it has Python 3.13, here is Python 3.11"),
        ({"cellwatt": None}, {}, "the scheduler at tcp://s:1 is refused: it has no cellwatt, here is cellwatt 1.2"),
    ],
)
def test_other_versions_are_refused(scheduler: dict[str, str | None], worker: dict[str, str | None], text: str) -> None:
    with pytest.raises(CellwattError) as told:
        check_versions(Told(scheduler, worker), "tcp://s:1")
    assert text in str(told.value)


def test_the_same_versions_are_welcome() -> None:
    check_versions(Told({}, {"python": "3.11.9.final.0"}), "tcp://s:1")


def test_relative_paths_stay_relative_here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    assert spread(str, [Path("a"), Path("b")], "paths") == ["a", "b"]
