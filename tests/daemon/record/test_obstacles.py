"""What stands in the way of recording is told before the daemon is started."""

from __future__ import annotations

import errno
import os
import resource
from pathlib import Path
from unittest.mock import Mock

import pytest

from cellwatt.record import folder
from cellwatt.record.folder import Obstacles, obstacles
from cellwatt.record.settings import EvidenceSettings, RecordSettings, default_folder


def test_no_trouble_are_a_folder_that_can_be_made_and_a_recording_that_is_gone(tmp_path: Path) -> None:
    assert obstacles(RecordSettings(folder=tmp_path / "a" / "b", keep=1e6)) == Obstacles()
    assert list(tmp_path.iterdir()) == [], "the folder is not made"
    (tmp_path / "weld.mcap").symlink_to(tmp_path / "gone")
    assert obstacles(RecordSettings(folder=tmp_path, keep=1e6)) == Obstacles()


def test_a_folder_of_somebody_else_as_root_sees_it(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    refused = Mock(side_effect=PermissionError(errno.EACCES, os.strerror(errno.EACCES)))
    monkeypatch.setattr(folder, "TemporaryFile", refused)
    monkeypatch.setenv("USER", "anna")
    told = obstacles(RecordSettings(folder=tmp_path / "record")).refusal
    assert f"cannot be created in {tmp_path} by user anna" in told
    found = obstacles(RecordSettings(folder=tmp_path))
    assert "cannot be written by user anna (Permission denied)" in found.warnings[0]
    assert found.refusal == ""  # a daemon starts, and says so itself


def test_a_disk_that_is_too_small_for_what_is_to_be_kept(tmp_path: Path) -> None:
    (told,) = obstacles(RecordSettings(folder=tmp_path, keep=1e18)).warnings
    assert "keep allows 1000000000.0 GB, evidence.keep 2.0 GB: the disk will become full" in told
    (told,) = obstacles(RecordSettings(folder=tmp_path, keep=1e6, evidence=EvidenceSettings(keep=1e18))).warnings
    assert "keep allows 0.0 GB, evidence.keep 1000000000.0 GB" in told
    none = EvidenceSettings(keep=1e18, severity="none")
    assert obstacles(RecordSettings(folder=tmp_path, keep=1e6, evidence=none)) == Obstacles()


def test_a_folder_that_takes_no_byte(tmp_path: Path) -> None:
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (0, before[1]))
    try:
        (told,) = obstacles(RecordSettings(folder=tmp_path, keep=1e6)).warnings
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)
    assert "cannot be written by user" in told
    assert "(File too large)" in told


@pytest.mark.parametrize(
    ("user", "environment", "expected"),
    [
        (0, {}, "/var/lib/cellwatt/weld"),
        (1000, {}, "/home/anna/.local/state/cellwatt/weld"),
        (1000, {"XDG_STATE_HOME": "/state"}, "/state/cellwatt/weld"),
        (1000, {"XDG_STATE_HOME": "state"}, "/home/anna/.local/state/cellwatt/weld"),
        (990, {"STATE_DIRECTORY": "/var/lib/cellwatt/weld-3"}, "/var/lib/cellwatt/weld-3"),
        (0, {"STATE_DIRECTORY": "/var/lib/a:/var/lib/b"}, "/var/lib/a"),
    ],
)
def test_the_folder_where_none_is_named(
    monkeypatch: pytest.MonkeyPatch, user: int, environment: dict[str, str], expected: str
) -> None:
    for name in ("STATE_DIRECTORY", "XDG_STATE_HOME"):
        monkeypatch.delenv(name, raising=False)
    for name, value in {"HOME": "/home/anna", **environment}.items():
        monkeypatch.setenv(name, value)
    monkeypatch.setattr(os, "geteuid", lambda: user)
    assert default_folder("weld") == Path(expected)
