"""Copies of what lies at URLs: made once for each version, whole or not at all."""

from __future__ import annotations

import os
from collections.abc import Iterator
from pathlib import Path
from unittest.mock import Mock

import fsspec
import pytest

from cellwatt import CellwattError, ConfigError
from cellwatt.fetch import MissingError, fetch, is_url


@pytest.fixture(autouse=True)
def home(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    return tmp_path / "cache" / "cellwatt"


@pytest.fixture
def store() -> Iterator[fsspec.AbstractFileSystem]:
    found = fsspec.filesystem("memory")
    yield found
    found.store.clear()
    found.pseudo_dirs[:] = [""]


def test_urls_and_paths() -> None:
    assert all(map(is_url, ("s3://bucket/key", "memory://a", "file:///a", "simplecache::s3://bucket/a")))
    assert not any(map(is_url, ("/a", "a/b", "a:b", "run-1.mcap", "C:/a", "")))


def test_a_file_is_fetched_once(store: fsspec.AbstractFileSystem, home: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    store.pipe("/plant/run.mcap", b"first")
    path = fetch("memory://plant/run.mcap")
    assert (path.name, path.read_bytes()) == ("run.mcap", b"first")
    assert path.is_relative_to(home)
    with monkeypatch.context() as patch:
        patch.setattr(store, "open", None)
        assert fetch("memory://plant/run.mcap") == path
    assert [entry.name[0] != "." for entry in home.iterdir()] == [True]


@pytest.mark.parametrize(("tag", "content"), [("created", b"second, which is longer"), ("Last-Modified", b"other")])
def test_another_version_has_a_copy_of_its_own(
    store: fsspec.AbstractFileSystem, monkeypatch: pytest.MonkeyPatch, tag: str, content: bytes
) -> None:
    """Also of a web server that tells only when a file was changed."""
    info = store.info
    monkeypatch.setattr(
        store, "info", lambda path: {k: v for k, v in info(path).items() if k != "created"} | {tag: now}
    )
    copies = []
    for now in (b"first", content):
        store.pipe("/plant/run.mcap", now)
        copies.append(fetch("memory://plant/run.mcap"))
    assert [copy.read_bytes() for copy in copies] == [b"first", content]


def test_a_folder_is_fetched_with_those_below(store: fsspec.AbstractFileSystem) -> None:
    store.pipe({"/plant/runs/a.mcap": b"a", "/plant/runs/day/b.mcap": b"b", "/plant/other": b"c"})
    path = fetch("memory://plant/runs/")
    assert path.name == "runs"
    found = {str(file.relative_to(path)): file.read_bytes() for file in path.rglob("*") if file.is_file()}
    assert found == {"a.mcap": b"a", "day/b.mcap": b"b"}


def test_a_folder_that_grows_is_not_fetched_again(
    store: fsspec.AbstractFileSystem, monkeypatch: pytest.MonkeyPatch
) -> None:
    for name in ("monday", "tuesday"):
        store.pipe(f"/plant/runs/{name}.mcap", name.encode())
        with monkeypatch.context() as patch:
            patch.setattr(store, "open", fetched := Mock(side_effect=store.open))
            path = fetch("memory://plant/runs")
        assert [call.args[0] for call in fetched.call_args_list] == [f"/plant/runs/{name}.mcap"]
        assert (path / f"{name}.mcap").read_bytes() == name.encode()
    assert (path / "monday.mcap").stat().st_nlink == 3  # with the folder before, and itself


def test_what_is_cut_off_leaves_nothing(
    store: fsspec.AbstractFileSystem, home: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    store.pipe("/plant/run.mcap", b"whole")
    with monkeypatch.context() as patch:
        info = store.info("/plant/run.mcap")
        patch.setattr(store, "info", lambda path, **_: info | {"size": 99})
        with pytest.raises(CellwattError, match=r"5 of 99 bytes received of .*run\.mcap: try again"):
            fetch("memory://plant/run.mcap")
    assert list(home.iterdir()) == []


def test_a_store_that_tells_no_size_gives_what_it_has(
    store: fsspec.AbstractFileSystem, monkeypatch: pytest.MonkeyPatch
) -> None:
    store.pipe("/plant/run.csv", b"t,q_1")
    info = store.info("/plant/run.csv")
    monkeypatch.setattr(store, "info", lambda path, **_: info | {"size": None})
    assert fetch("memory://plant/run.csv").read_bytes() == b"t,q_1"


def test_what_nobody_used_for_long_is_removed(store: fsspec.AbstractFileSystem, home: Path) -> None:
    store.pipe({"/plant/a": b"a", "/plant/b": b"b", "/plant/c": b"c"})
    old, kept = fetch("memory://plant/a"), fetch("memory://plant/b")
    os.utime(old.parent, (0, 0))
    fetch("memory://plant/c")
    assert (old.exists(), kept.exists()) == (False, True)
    (home / ".part-of-another").symlink_to(home / "gone")  # as if its process had just finished it
    assert fetch("memory://plant/a").read_bytes() == b"a"


@pytest.mark.parametrize(
    ("url", "kind", "text"),
    [
        ("memory://plant/none", MissingError, "memory://plant/none does not exist"),
        ("plant://a/b", ConfigError, "plant://a/b cannot be fetched: Protocol not known: plant"),
        ("gs://bucket/key", ConfigError, "a package is missing: Please install gcsfs"),
        ("s3://bucket", ConfigError, "s3://bucket cannot be fetched: expected s3://bucket/key"),
    ],
)
@pytest.mark.usefixtures("store")
def test_what_cannot_be_fetched_is_told(url: str, kind: type[Exception], text: str) -> None:
    with pytest.raises(kind) as told:
        fetch(url)
    assert text in str(told.value)


def test_a_name_that_leads_out_of_the_folder_is_refused(
    store: fsspec.AbstractFileSystem, monkeypatch: pytest.MonkeyPatch
) -> None:
    store.pipe({"/plant/runs/a": b"a"})
    bad = {"/plant/runs/../../../x": {"size": 1, "type": "file"}}
    monkeypatch.setattr(store, "find", lambda *_, **__: bad)
    with pytest.raises(CellwattError, match="whose name leads out of the folder"):
        fetch("memory://plant/runs")


def test_no_access_asks_for_the_credentials(store: fsspec.AbstractFileSystem, monkeypatch: pytest.MonkeyPatch) -> None:
    error = OSError("When getting information: AWS Error ACCESS_DENIED during HeadObject operation")
    monkeypatch.setattr(store, "info", Mock(side_effect=error))
    told = r"cannot be fetched: no access; are the credentials in the environment\? When"
    with pytest.raises(CellwattError, match=told):
        fetch("memory://plant/run.mcap")
