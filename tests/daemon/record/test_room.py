"""What stands in the way of recording is told before the daemon is started."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from cellwatt.record.room import troubles
from cellwatt.record.settings import RecordSettings


def test_a_folder_that_can_be_made_is_no_trouble_and_is_not_made(tmp_path: Path) -> None:
    assert troubles(RecordSettings(folder=tmp_path / "a" / "b", keep=1e6)) == ()
    assert list(tmp_path.iterdir()) == []


def test_a_file_in_the_way(tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    (told,) = troubles(RecordSettings(folder=tmp_path / "file" / "record"))
    assert told == f"folder {tmp_path / 'file' / 'record'} cannot be made: {tmp_path / 'file'} is no folder"


@pytest.mark.skipif(os.geteuid() == 0, reason="root may write anywhere")
def test_a_folder_of_somebody_else(tmp_path: Path) -> None:
    tmp_path.chmod(0o500)
    (told,) = troubles(RecordSettings(folder=tmp_path / "record"))
    assert "cannot be made in" in told


def test_a_folder_of_somebody_else_as_root_sees_it(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(os, "access", lambda *_: False)
    monkeypatch.setenv("USER", "anna")
    (told,) = troubles(RecordSettings(folder=tmp_path / "record"))
    assert f"cannot be made in {tmp_path} by user anna" in told
    assert "cannot be written by user anna" in troubles(RecordSettings(folder=tmp_path))[0]


def test_a_disk_that_is_too_small_for_what_is_to_be_kept(tmp_path: Path) -> None:
    (told,) = troubles(RecordSettings(folder=tmp_path, keep=1e18))
    assert "keep asks for 1000000000.0 GB: the disk will run full" in told
