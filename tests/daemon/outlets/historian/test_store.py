"""A file of a lake is there whole, or not at all."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from cellwatt.outlets.historian.store import FolderStore, s3_options

PATH = "frames/day=2026-11-21/a.parquet"


@pytest.fixture
def store(tmp_path: Path) -> FolderStore:
    return FolderStore(tmp_path)


@pytest.mark.parametrize("at", ["write", "rename"])
def test_one_that_is_killed_leaves_what_was_there(
    store: FolderStore, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, at: str
) -> None:
    class Killed(BaseException):
        pass

    seen: list[bytes | None] = []

    def look() -> bytes | None:
        seen.append((tmp_path / PATH).read_bytes() if (tmp_path / PATH).exists() else None)
        return seen[-1]

    def killed(*_: object) -> None:
        look()
        raise Killed

    for before in (None, b"first"):
        with monkeypatch.context() as patch:
            patch.setattr(*((os, "fsync") if at == "write" else (Path, "replace")), killed)
            with pytest.raises(Killed):
                store.put(PATH, b"second")
        assert look() == before
        assert store.names("frames") == ([] if before is None else ["day=2026-11-21/a.parquet"])
        store.put(PATH, b"first")
    assert seen == [None, None, b"first", b"first"]


def test_options_of_s3() -> None:
    assert s3_options(None, None, None, None) == {}
    assert s3_options("https://minio.example:9000", None, ("a", "b"), "ca.pem") == {
        "endpoint_override": "minio.example:9000",
        "scheme": "https",
        "region": "us-east-1",
        "access_key": "a",
        "secret_key": "b",
        "tls_ca_file_path": "ca.pem",
    }
