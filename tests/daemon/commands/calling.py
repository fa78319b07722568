"""The command line in this process, with the parts of the runtime's tests."""

from __future__ import annotations

import sys
from collections.abc import Callable
from importlib.metadata import EntryPoint, entry_points
from pathlib import Path
from typing import NamedTuple

import pytest

from cellwatt.commands import main
from tests.daemon.conftest import Registered
from tests.daemon.runtime import fakes

SKELETON = EntryPoint("skeleton", "cellwatt.testing.skeleton:SkeletonDriver", "cellwatt.drivers")
CELL = """\
site: plant
cell: weld
sources:
  arm: {driver: fake, host: arm}
"""


class Ended(NamedTuple):
    """How a call ended. A mistake of ours has its traceback in ``err``."""

    code: int
    out: str
    err: str


Call = Callable[..., Ended]


def points_with(*more: EntryPoint) -> Callable[[str], list[EntryPoint]]:
    """Stands for ``importlib.metadata.entry_points``: the commands, the parts of the runtime's tests, and more."""

    def points(group: str) -> list[EntryPoint]:
        found = entry_points(group=group) if group == "cellwatt.commands" else fakes.entry_points(group)
        return [*found, *(point for point in more if point.group == group)]

    return points


@pytest.fixture
def call(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], registered: Registered) -> Call:
    """Calls ``cellwatt ARGUMENTS…``."""

    monkeypatch.setenv("CELLWATT_TRACEBACK", "1")
    registered(points_with(SKELETON))
    for parts in (fakes.DEVICES, fakes.JUDGES, fakes.RECEIVERS):
        parts.clear()

    def run(*arguments: object) -> Ended:
        monkeypatch.setattr(sys, "argv", ["cellwatt", *map(str, arguments)])
        capsys.readouterr()
        with pytest.raises(SystemExit) as ended:
            main()
        assert isinstance(ended.value.code, int)
        return Ended(ended.value.code, *capsys.readouterr())

    return run


@pytest.fixture
def cell(tmp_path: Path) -> Path:
    """The settings file of a cell of one source."""
    file = tmp_path / "weld.yaml"
    file.write_text(CELL)
    return file
